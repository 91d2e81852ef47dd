"""Outputs destroy nothing, and nothing is left cut short; results are never lost."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
from click.testing import CliRunner, Result

from piezo_opt import datasets, demo
from piezo_opt.cli import app
from piezo_opt.cli import solving as solving_module
from piezo_opt.errors import InputError
from piezo_opt.identification import (
    Identification,
    Progress,
    default_model,
    load_fit,
    save_fit,
    solve,
)
from piezo_opt.measurement import Measurement
from piezo_opt.readers import read, write
from piezo_opt.report import write_report

COMMAND = Path(sys.executable).with_name("piezo-opt")


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(one) for one in arguments])


def refused(result: Result, *words: str) -> None:
    assert result.exit_code == 2, result.output
    assert len(result.stderr.strip().splitlines()) == 1, result.stderr
    for word in words:
        assert word in result.stderr


@pytest.fixture
def loop(tmp_path: Path) -> Path:
    file = tmp_path / "loop.csv"
    file.write_bytes(datasets.path("thesis/hysteresis.csv").read_bytes())
    return file


@pytest.fixture
def plain(tmp_path: Path) -> Path:
    file = tmp_path / "plain.toml"
    file.write_text('effects = ["piezo_gain", "bouc_wen", "offset"]\n')
    return file


def test_an_input_is_never_an_output(loop: Path, plain: Path, tmp_path: Path) -> None:
    record, model = loop.read_bytes(), plain.read_bytes()
    link, hard = tmp_path / "link.json", tmp_path / "hard.json"
    link.symlink_to(loop)
    os.link(loop, hard)
    mine = tmp_path / "mine.py"
    mine.write_text("# nothing\n")
    for out in (loop, link, hard, tmp_path / "." / "loop.csv"):
        refused(run("fit", loop, "--json", out, "--overwrite"), "read by this command", "loop.csv")
    refused(run("fit", loop, "--model", plain, "--report", plain, "--overwrite"), "plain.toml")
    refused(run("fit", loop, "--log", loop, "--starts", 2), "--log", "read by this command")
    refused(run("compare", loop, "--test", loop, "--json", loop, "--overwrite"), "--json")
    refused(run("report", loop, "--out", loop, "--overwrite"), "read by this command")
    refused(run("check", loop, "--json", loop, "--overwrite"), "read by this command")
    refused(run("linear", loop, "--json", loop, "--overwrite"), "read by this command")
    refused(run("signal", "best", loop, "--out", loop, "--overwrite"), "read by this command")
    refused(
        run("signal", "between", loop, "--model", plain, "--model", loop, "--json", plain,
            "--overwrite"),
        "read by this command",
    )  # fmt: skip
    refused(run("export", "fmu", plain, "--out", plain, "--overwrite"), "read by this command")
    refused(
        run("simulate", loop, "--model", plain, "--out", loop, "--overwrite"),
        "read by this command",
    )
    refused(
        run("diagnose", loop, "--candidates", mine, "--json", mine, "--overwrite"),
        "read by this command",
    )
    assert (loop.read_bytes(), plain.read_bytes()) == (record, model)
    assert mine.read_text() == "# nothing\n"


def test_the_name_says_what_is_written(loop: Path, tmp_path: Path) -> None:
    for out in ("page.pdf", "page", "page.json"):
        refused(run("fit", loop, "--report", tmp_path / out), "written as .html or .htm")
        refused(run("report", loop, "--out", tmp_path / out), "written as .html or .htm")
    refused(run("signal", "triangle", "--picture", tmp_path / "a.html"), "written as .png or .svg")
    with pytest.raises(InputError, match="a report is a page"):
        write_report(tmp_path / "page.pdf", object())
    with pytest.raises(InputError, match="a fit is written as"):
        save_fit(solve(demo.question()), tmp_path / "fit.csv")
    with pytest.raises(InputError, match="overwrite is 'no'"):
        write(read(loop), loop, overwrite="no")  # type: ignore[arg-type]
    assert {one.name for one in tmp_path.iterdir()} == {"loop.csv"}


def test_a_device_is_no_file(loop: Path, tmp_path: Path) -> None:
    link, pipe = tmp_path / "null.json", tmp_path / "pipe.json"
    link.symlink_to(os.devnull)
    os.mkfifo(pipe)
    device = tmp_path / "null.csv"
    device.symlink_to(os.devnull)
    for out in (link, pipe, os.devnull):
        refused(run("fit", loop, "--json", out, "--overwrite"), "a device, a pipe or a socket")
    with pytest.raises(InputError, match="a device"):
        write(read(loop), device, overwrite=True)
    assert Path(os.devnull).is_char_device()


def test_a_link_keeps_leading_to_its_file(tmp_path: Path, loop: Path) -> None:
    there, link = tmp_path / "there.csv", tmp_path / "link.csv"
    link.symlink_to(there)
    write(read(loop), link)
    write(read(loop), link, overwrite=True)
    assert link.is_symlink()
    assert not there.is_symlink()
    assert (read(there).position == read(loop).position).all()
    circle = tmp_path / "circle.csv"
    circle.symlink_to(circle)
    with pytest.raises(InputError, match="circle"):
        write(read(loop), circle)


@pytest.mark.parametrize("name", ["a" * 300 + ".json", "é" * 200 + ".json", "a.json" + "b" * 250])
def test_a_name_that_is_too_long(loop: Path, tmp_path: Path, name: str) -> None:
    refused(run("fit", loop, "--json", tmp_path / name), "too long")
    with pytest.raises(InputError, match="too long"):
        write(read(loop), tmp_path / f"{name}.csv")


def test_the_longest_name_is_taken(loop: Path, tmp_path: Path) -> None:
    write(read(loop), tmp_path / f"{'a' * 250}.csv")
    assert len(list(tmp_path.iterdir())) == 2


def test_a_folder_that_vanishes_loses_no_result(
    loop: Path, plain: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "gone"
    folder.mkdir()

    def vanishing(question: Identification, **options: object) -> object:
        folder.rmdir()
        return solve(question, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(solving_module, "solve", vanishing)
    done = run("fit", loop, "--model", plain, "--json", folder / "fit.json")
    assert done.exit_code == 2
    assert "there is no folder" in done.stderr
    assert "Converged" in done.stdout


def test_a_report_that_cannot_be_drawn_loses_no_result(
    loop: Path, plain: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("drawing")

    monkeypatch.setattr("piezo_opt.report.write_report", broken)
    out = tmp_path / "fit.json"
    done = run("fit", loop, "--model", plain, "--json", out, "--report", tmp_path / "r.html")
    assert done.exit_code == 1
    assert "Converged" in done.stdout
    assert json.loads(out.read_text())["outcome"]["success"]
    assert "An error of the program itself" in done.stderr
    sent = Path(done.stderr.split("Please send ")[1].split(" with")[0])
    assert "ZeroDivisionError" in sent.read_text()
    sent.unlink()


SMALL = """
import resource, signal
import numpy as np
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (9000, 24000))
import piezo_opt as po
from piezo_opt.effects import BoucWen, Offset, PiezoGain
record = po.load("thesis/hysteresis")
time = np.arange(3000.0)
long = po.Measurement(time, np.sin(time), np.random.default_rng(0).normal(size=3000))
fit = po.solve(po.Identification(PiezoGain() + BoucWen() + Offset(), record), statistics=False)
for do in (
    lambda: po.write(long, "long.csv"),
    lambda: po.write(long, "long.h5"),
    lambda: po.save_fit(fit, "fit.h5"),
    lambda: po.write_report("page.html", fit),
):
    try:
        do()
    except po.InputError as error:
        print(error)
resource.setrlimit(resource.RLIMIT_FSIZE, (24000, 24000))
many = po.solve(fit.question, starts=3, log="log.h5")
print(len(many.starts), *many.remarks)
"""


def test_a_full_disk_leaves_nothing_cut_short(tmp_path: Path) -> None:
    """A limit on the size of files stands in for the disk: the same call fails in the same way."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", SMALL],
        cwd=tmp_path, capture_output=True, text=True, check=False, timeout=120,
        env={**os.environ, "PIEZO_OPT_CC": ""},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    *files, log = done.stdout.strip().splitlines()
    assert files == [
        f"{name}: cannot be written: the file is larger than the system allows"
        for name in ("long.csv", "long.h5", "fit.h5", "page.html")
    ]
    assert log.startswith("3 ")
    assert "The log ends before part" in log
    assert [path.name for path in tmp_path.iterdir()] == ["log.h5"]
    with h5py.File(tmp_path / "log.h5") as file:
        assert 0 < len(file) < 3
        assert all("index" in file[name].attrs for name in file)


def test_standard_output_that_is_full(loop: Path, plain: Path, tmp_path: Path) -> None:
    out = tmp_path / "fit.json"
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [COMMAND, "fit", loop, "--model", plain, "--json", out],
            stdout=full, stderr=subprocess.PIPE, text=True, check=False, timeout=120,
        )  # fmt: skip
    assert done.returncode == 1
    # Progress may come before it.
    assert "Standard output could not be written" in done.stderr.strip().splitlines()[-1]
    assert "Traceback" not in done.stderr
    assert json.loads(out.read_text())["outcome"]["success"]


def test_standard_output_that_is_closed(loop: Path) -> None:
    done = subprocess.run(
        ["sh", "-c", '"$@" >&-', "sh", COMMAND, "check", loop],
        stderr=subprocess.PIPE, text=True, check=False, timeout=120,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("after", [0.02, 0.1, 0.3, 0.6])
def test_ctrl_c_while_it_begins_is_no_traceback(loop: Path, after: float) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", "import piezo_opt.__main__ as m; print('up', flush=True); m.main()",
         "fit", str(loop)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout is not None
    process.stdout.readline()
    time.sleep(after)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    # Once Python itself is leaving, the system ends it, as silently.
    assert process.returncode in (0, 130, -signal.SIGINT), said
    assert "Traceback" not in said


def slow(folder: Path) -> Path:
    """A record that takes some time to fit: 40,000 samples through a resonance."""
    time_ = np.arange(40_000) / 4000.0
    drive = 40.0 * np.sin(2.0 * np.pi * (time_ + 10.0 * time_**2))
    noise = np.random.default_rng(0).normal(scale=1e-7, size=time_.size)
    file = folder / "slow.h5"
    write(Measurement(time_, drive, 2e-7 * drive + noise), file)
    return file


def test_the_limit_of_time_keeps_the_best_so_far(tmp_path: Path) -> None:
    file, out = slow(tmp_path), tmp_path / "fit.json"
    options = ("--solver", "differential-evolution", "--max-time", "0.3 s", "--json", out)
    model = tmp_path / "model.toml"
    model.write_text('effects = ["piezo_gain", "bouc_wen", "offset"]\n')
    done = run("fit", file, "--model", model, *options)
    assert done.exit_code == 0, done.output
    assert "The limit of 0.3 s was reached; this is the best so far" in done.stdout
    assert json.loads(out.read_text())["outcome"]["ending"] == "limit"
    out.unlink()
    done = run("compare", file, "--model", model, "--model", model, *options)
    assert done.exit_code == 0, done.output
    assert f"Not fitted for want of time: {model}." in done.stdout
    assert len(json.loads(out.read_text())["entries"]) == 1
    refused(run("fit", file, "--max-time", "-1 s"), "no limit")


def test_ctrl_c_in_a_comparison_compares_what_there_is(
    loop: Path, plain: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(question: Identification, **options: object) -> object:
        def stop(progress: Progress) -> None:
            if progress.iteration == 2:
                raise KeyboardInterrupt

        return solve(question, **{**options, "progress": stop})  # type: ignore[arg-type]

    monkeypatch.setattr(solving_module, "solve", stopped)
    out, page = tmp_path / "c.json", tmp_path / "c.html"
    done = run("compare", loop, "--model", plain, "--model", plain, "--json", out, "--report", page)
    assert done.exit_code == 130
    assert "Not fitted for want of time" in done.stdout
    assert len(json.loads(out.read_text())["entries"]) == 1
    assert page.is_file()
    out.unlink()
    page.unlink()
    done = run("diagnose", loop, "--model", plain, "--json", out, "--report", page)
    assert done.exit_code == 130
    assert json.loads(out.read_text())["schema"] == "piezo_opt/fit/1"
    assert page.is_file()


def test_a_saved_fit_keeps_its_mask(tmp_path: Path) -> None:
    record = datasets.load("thesis/hysteresis")
    masked = record.with_(left_out=np.arange(len(record)) == 20)
    model, _ = default_model(masked)
    fit = solve(Identification(model, masked))
    save_fit(fit, tmp_path / "fit.h5")
    assert load_fit(tmp_path / "fit.h5").rms == pytest.approx(fit.rms, rel=1e-12)
