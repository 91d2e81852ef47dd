"""The command as a user meets it: what it prints, what it writes, how it ends."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from piezo_opt import datasets, demo
from piezo_opt.__main__ import main as begin
from piezo_opt.cli import app, choices
from piezo_opt.cli import solving as solving_module
from piezo_opt.identification import Identification, Progress, solve
from piezo_opt.measurement import Measurement
from piezo_opt.readers import read, write

LOOP = str(datasets.path("thesis/hysteresis.csv"))
PLAIN = """
effects = ["piezo_gain", "bouc_wen", "second_order"]
[fixed]
"second_order.omega" = 8.0321
"second_order.zeta" = 0.1992
"""


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(one) for one in arguments])


def refused(result: Result, *words: str) -> None:
    """One sentence on stderr, exit code 2, nothing else."""
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    assert "Traceback" not in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    for word in words:
        assert word in result.stderr


@pytest.fixture
def plain(tmp_path: Path) -> Path:
    file = tmp_path / "plain.toml"
    file.write_text(PLAIN)
    return file


@pytest.mark.parametrize(("said", "threads"), [(None, "1"), ("4", "4")])
def test_one_thread_of_linear_algebra_unless_said(
    monkeypatch: pytest.MonkeyPatch, said: str | None, threads: str
) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", said or "")
    if said is None:
        monkeypatch.delenv("OPENBLAS_NUM_THREADS")
    monkeypatch.setattr(sys, "argv", ["piezo-opt", "--version"])
    monkeypatch.setattr(sys, "stdout", sys.stdout)  # which the command wraps
    with pytest.raises(SystemExit):
        begin()
    assert os.environ["OPENBLAS_NUM_THREADS"] == threads


def test_help_has_an_example_for_each_command() -> None:
    front = run("--help")
    assert front.exit_code == 0
    for command in ("demo", "fit", "simulate", "compare", "report"):
        assert command in front.stdout
        page = run(command, "--help")
        assert page.exit_code == 0
        assert f"  piezo-opt {command}" in page.stdout
    assert run("--version").stdout.startswith("piezo-opt 0.")


def test_fit_writes_json_and_page(tmp_path: Path, plain: Path) -> None:
    out, page = tmp_path / "fit.json", tmp_path / "fit.html"
    done = run("fit", LOOP, "--model", plain, "--start", "rest", "--json", out, "--report", page)
    assert done.exit_code == 0, done.output
    assert "Where it fails" in done.stdout
    assert done.stderr == ""
    data = json.loads(out.read_text())
    assert data["schema"] == "piezo_opt/fit/1"
    assert data["rms"] == pytest.approx(1.690e-7, rel=1e-3)
    assert data["fit_percent"] == pytest.approx(96.0, abs=0.05)
    assert data["parameters"]["bouc_wen.alpha"] == {
        "value": pytest.approx(8.05e-8, rel=0.01),
        "std": pytest.approx(8.9e-9, rel=0.2),
        "unit": "m/V",
        "estimated": True,
        "at_bound": False,
    }
    assert data["evaluations"]["total"] > 0
    assert data["wall_s"] > 0
    assert data["outcome"]["success"] is True
    assert "rms 169 nm" in page.read_text(encoding="utf-8")


def test_fit_with_the_default_model_and_a_test_part(tmp_path: Path) -> None:
    out = tmp_path / "fit.json"
    done = run("fit", LOOP, "--split", "35 s", "--json", out, "--quiet")
    assert done.exit_code == 0, done.output
    assert len(done.stdout.strip().splitlines()) == 1
    data = json.loads(out.read_text())
    # What the default model leaves out, it says.
    assert any("quasi-static" in remark for remark in data["remarks"])
    assert data["held_out"]["entries"][0]["samples"] == 16


def spoiled(folder: Path, name: str, gain: float = 1.0) -> Path:
    """The thesis' loop with a thing wrong that only the check sees."""
    record = datasets.load("thesis/hysteresis")
    file = folder / name
    write(record.with_(position=gain * record.position), file)
    return file


def test_check_prints_what_it_found_and_a_fit_begins_with_it(tmp_path: Path, plain: Path) -> None:
    wrong, out = spoiled(tmp_path, "metres.csv", 1e6), tmp_path / "check.json"
    before = sorted(tmp_path.iterdir())
    done = run("check", wrong)
    assert done.exit_code == 2
    assert "Refused (unit): hysteresis: The reading moves by 14.66 m" in done.stdout
    assert "To be answered before a fit: unit." in done.stdout
    assert "⠀" in done.stdout
    assert sorted(tmp_path.iterdir()) == before
    assert run("check", LOOP, "--json", out).exit_code == 0
    told = json.loads(out.read_text())
    assert told["schema"] == "piezo_opt/check/1"
    assert told["fit_for_use"] is True
    for command in ("fit", "diagnose", "compare"):
        refused(run(command, wrong), "--mend unit takes it as um", "--accept unit")
    refused(run("report", wrong, "--out", tmp_path / "r.html"), "--mend unit")
    refused(run("fit", wrong, "--mend", "wrapped"), "nothing of that kind", "unit")
    mended = run("fit", wrong, "--model", plain, "--start", "rest", "--mend", "unit")
    assert mended.exit_code == 0, mended.output
    assert "rms 169 nm" in mended.stdout
    assert "Mended as asked (unit)." in mended.stdout


def test_a_fit_that_explains_nothing_is_an_error(tmp_path: Path) -> None:
    time = np.arange(800) / 1000.0
    noise = np.random.default_rng(0).normal(scale=1e-7, size=time.size)
    file = tmp_path / "noise.csv"
    write(Measurement(time, 50.0 * np.sin(40.0 * time), noise), file)
    done = run("fit", file)
    assert done.exit_code == 2
    assert "explains nothing of the reading" in done.stdout
    assert "look at the record with piezo-opt check" in done.stderr


def test_existing_files_are_refused_before_any_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object, **__: object) -> None:
        raise AssertionError("work was done before the outputs were checked")

    monkeypatch.setattr(solving_module, "solve", never)
    out = tmp_path / "precious.json"
    out.write_text("precious")
    refused(run("fit", LOOP, "--json", out), "precious.json", "exists already", "--overwrite")
    refused(run("fit", LOOP, "--report", out), "exists already")
    refused(run("compare", LOOP, "--json", out), "exists already")
    refused(run("report", LOOP, "--out", out), "exists already")
    refused(run("fit", LOOP, "--json", tmp_path / "no" / "x.json"), "no folder")
    refused(run("fit", LOOP, "--json", tmp_path), "is a directory")
    new = tmp_path / "new"
    refused(run("fit", LOOP, "--json", new, "--report", new), "same file")
    assert out.read_text() == "precious"


def test_overwrite_replaces(tmp_path: Path, plain: Path) -> None:
    out = tmp_path / "fit.json"
    out.write_text("old")
    assert run("fit", LOOP, "--model", plain, "--json", out, "--overwrite").exit_code == 0
    assert json.loads(out.read_text())["schema"] == "piezo_opt/fit/1"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ("empty",)),
        ("time,voltage,displacement\n0,1,2\n", ("unit",)),
        ("time [s],voltage [V],displacement [um]\n0,0,0\n1,1,nan\n", ("bad.csv",)),
        (
            "time [s],voltage [V],displacement [um]\n" + "".join(f"{k},1,{k}\n" for k in range(9)),
            ("drive is constant",),
        ),
        (
            "time [s],voltage [V],displacement [um]\n" + "".join(f"1,{k},{k}\n" for k in range(9)),
            ("repeats",),
        ),
    ],
)
def test_bad_records_get_one_sentence(tmp_path: Path, text: str, words: tuple[str, ...]) -> None:
    file = tmp_path / "bad.csv"
    file.write_text(text)
    out = tmp_path / "fit.json"
    refused(run("fit", file, "--json", out), *words)
    assert not out.exists()


def test_bad_words_get_one_sentence(tmp_path: Path) -> None:
    refused(run("fit", tmp_path / "nowhere.csv"), "no such file")
    refused(run("fit", LOOP, "--model", "creep"), "--model creep", ".toml")
    refused(run("fit", LOOP, "--period", "long"), "does not start with a number")
    refused(run("fit", LOOP, "--drive", "current"), "current")
    refused(run("fit", LOOP, "--start", "periodic"), "period")
    refused(run("compare", LOOP, "--test", LOOP, "--split", "40 s"), "--test and --split")
    wrong = tmp_path / "wrong.toml"
    wrong.write_text(PLAIN + '"second_order.mass" = 1\n')
    refused(run("fit", LOOP, "--model", wrong), "wrong.toml: fixed", "second_order.mass")
    refused(
        run("simulate", LOOP, "--model", wrong, "--out", tmp_path / "o.csv"), "second_order.mass"
    )


@pytest.mark.parametrize(
    "arguments", [("fit",), ("fit", LOOP, "--solver", "magic"), ("nothing",), ("report", LOOP)]
)
def test_usage_errors_end_with_2(arguments: tuple[str, ...]) -> None:
    done = run(*arguments)
    assert done.exit_code == 2
    assert "Traceback" not in done.output


def test_compare_on_a_part_none_has_seen(tmp_path: Path, plain: Path) -> None:
    richer = tmp_path / "richer.toml"
    richer.write_text(PLAIN.replace('"bouc_wen"', '"bouc_wen", "asymmetry"'))
    out, page = tmp_path / "c.json", tmp_path / "c.html"
    done = run(
        *("compare", LOOP, "--model", plain, "--model", richer, "--start", "rest"),
        *("--split", "35 s", "--json", out, "--report", page),
    )
    assert done.exit_code == 0, done.output
    assert "held-out record hysteresis" in done.stdout
    data = json.loads(out.read_text())
    assert [entry["label"] for entry in data["entries"]][1] == "+ asymmetry"
    assert data["held_out"] is True
    assert "Comparison on the held-out record" in page.read_text(encoding="utf-8")


def test_compare_with_another_record(tmp_path: Path, plain: Path) -> None:
    other = tmp_path / "other.h5"
    record = datasets.load("thesis/hysteresis")
    write(record.with_(position=record.position + 1e-7, name="other"), other)
    done = run("compare", LOOP, "--model", plain, "--start", "rest", "--test", other)
    assert done.exit_code == 0, done.output
    assert "held-out record other" in done.stdout


def test_simulate_replays_a_fit(tmp_path: Path, plain: Path) -> None:
    fitted, out = tmp_path / "fit.json", tmp_path / "simulated.csv"
    assert run("fit", LOOP, "--model", plain, "--start", "rest", "--json", fitted).exit_code == 0
    done = run("simulate", LOOP, "--model", fitted, "--out", out)
    assert done.exit_code == 0, done.output
    assert "169 nm rms" in done.stdout
    simulated, measured = read(out), datasets.load("thesis/hysteresis")
    assert simulated.drive == pytest.approx(measured.drive)
    error = measured.position - simulated.position
    assert float(np.sqrt(np.mean(error**2))) == pytest.approx(1.690e-7, rel=1e-3)
    refused(run("simulate", LOOP, "--model", fitted, "--out", out), "exists already")


def test_report_is_a_fit_and_a_page(tmp_path: Path, plain: Path) -> None:
    page = tmp_path / "loop.html"
    done = run("report", LOOP, "--model", plain, "--out", page, "--title", "My loop")
    assert done.exit_code == 0, done.output
    assert "<h1>My loop</h1>" in page.read_text(encoding="utf-8")
    assert str(page) in done.stdout


def test_demo_writes_where_it_is_told_and_replaces_only_itself(tmp_path: Path) -> None:
    done = run("demo", "--out", tmp_path)
    page = tmp_path / demo.PAGE
    assert done.exit_code == 0, done.output
    assert "rms 169 nm, fit 96.0" in done.stdout
    assert "67.01 um*s" in done.stdout
    assert "Where it fails" in done.stdout
    assert f"Report: {page}" in done.stdout
    assert run("demo", "--out", page).exit_code == 0
    page.write_text("precious")
    refused(run("demo", "--out", tmp_path), "no page of the demo")
    assert page.read_text() == "precious"
    refused(run("demo", "--out", tmp_path / "nowhere"), "no such folder")


def test_ctrl_c_prints_the_best_so_far(
    tmp_path: Path, plain: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(question: Identification, **options: object) -> object:
        def stop(progress: Progress) -> None:
            if progress.iteration == 2:
                raise KeyboardInterrupt

        return solve(question, **{**options, "progress": stop})  # type: ignore[arg-type]

    monkeypatch.setattr(solving_module, "solve", stopped)
    out = tmp_path / "fit.json"
    done = run("fit", LOOP, "--model", plain, "--start", "rest", "--json", out)
    assert done.exit_code == 130
    assert "best so far" in done.stdout
    assert json.loads(out.read_text())["outcome"]["ending"] == "interrupted"

    def never(*_: object, **__: object) -> object:
        raise KeyboardInterrupt

    monkeypatch.setattr(solving_module, "solve", never)
    early = run("fit", LOOP, "--model", plain)
    assert early.exit_code == 130
    assert early.stderr == "Interrupted before there was a result.\n"


def test_every_choice_offered_can_be_taken() -> None:
    for name in choices.SolverName:
        assert choices.solver(name).name
    for kind in choices.TranscriptionName:
        assert choices.transcription(kind).name


def test_another_solver_by_name(tmp_path: Path, plain: Path) -> None:
    out = tmp_path / "fit.json"
    done = run(
        *("fit", LOOP, "--model", plain, "--start", "rest", "--solver", "scipy", "--json", out)
    )
    assert done.exit_code == 0, done.output
    data = json.loads(out.read_text())
    assert data["solver"].startswith("scipy")
    assert data["rms"] == pytest.approx(1.690e-7, rel=1e-3)


def test_the_installed_command_without_a_compiler(tmp_path: Path) -> None:
    command = Path(sys.executable).with_name("piezo-opt")
    environment = {**os.environ, "PIEZO_OPT_CC": ""}
    done = subprocess.run(
        [command, "demo"],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert "no C compiler" in done.stdout
    assert "rms 169 nm" in done.stdout
    assert (tmp_path / demo.PAGE).is_file()
    failed = subprocess.run(
        [sys.executable, "-m", "piezo_opt", "fit", "nowhere.csv"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert failed.returncode == 2
    assert "nowhere.csv" in failed.stderr
    assert "Traceback" not in failed.stderr
