"""``piezo-opt track``: what it prints and writes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from click.testing import CliRunner, Result

from piezo_opt.benchmark.filmed import Scene, film
from piezo_opt.cli import app
from piezo_opt.readers import read


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["track", *(str(one) for one in arguments)])


def test_a_video_and_its_drive_become_a_record(tmp_path: Path) -> None:
    scene = Scene(shape=(72, 90), half=16.0, seed=5)
    rng = np.random.default_rng(1)
    time = np.arange(40) / 25.0
    x = 45.0 + 4.0 * np.sin(2.0 * np.pi * time)
    video, volts = tmp_path / "tip.mkv", tmp_path / "volts.csv"
    film(video, (scene.picture(a, 36.0) + rng.normal(0, 1.0, scene.shape) for a in x), time)
    rows = (f"{t},{50.0 + 40.0 * np.sin(2.0 * np.pi * t)}\n" for t in time.tolist())
    volts.write_text("time [s],voltage [V]\n" + "".join(rows))
    told = ("--scale", "0.1725um/px", "--reference", "4,36", "--box", "32,23,26,26")
    out, picture, data = (tmp_path / name for name in ("out.csv", "out.png", "out.json"))
    done = run(video, *told, "--drive", volts, "--out", out, "--picture", picture, "--json", data)
    assert done.exit_code == 0, done.output
    assert done.stdout.startswith("40 of 40 frames tell a distance: it moves by 1.3")
    record = read(out)
    assert len(record) == 40
    assert np.corrcoef(record.drive, record.position)[0, 1] > 0.9999
    assert picture.stat().st_size > 20_000
    found = json.loads(data.read_text())
    assert found["schema"] == "piezo_opt/track/1"
    assert len(found["distance"]) == 40
    again = run(video, *told, "--out", out)
    assert again.exit_code == 2
    assert "exists already" in again.output
    late = run(video, *told, "--drive", volts, "--delay", "9 s")
    assert late.exit_code == 2
    assert "say when it began" in late.output
