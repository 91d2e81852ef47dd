"""Controllers as C: no diagnostic, no double in float, Python's own answers, faults included."""

from __future__ import annotations

import ctypes
import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import piezo_opt as po
from piezo_opt.cli import app
from piezo_opt.control import LQG, PID, InverseCompensation, Limits, Shaper, ei, tune_lqr
from piezo_opt.errors import InputError
from piezo_opt.export.laws.verb import ADMITTED, Law
from tests.control.test_tune_lqr import LIMITS, PERIOD, SAW, STAGE, VALUES
from tests.export.tools import DIAGNOSTICS, STRICT, compiler, undefined_of_float

KINDS = ("pid", "lqg", "inverse", "shaper")


@pytest.fixture(scope="module")
def laws() -> dict[str, Law]:
    tuned = tune_lqr(STAGE, SAW, period=PERIOD, values=VALUES, limits=LIMITS, noise=5e-9)
    return {
        "pid": PID(2e6, 7.6e8, 600.0, 1e-4, largest=2e-5),
        "lqg": tuned.controller,
        "inverse": InverseCompensation(2e-7, 8e-8, 4e-3, -5e-3),
        "shaper": ei(2.0 * np.pi * 31.3, 0.03),
    }


@pytest.mark.parametrize("precision", ["double", "float"])
@pytest.mark.parametrize("kind", KINDS)
def test_it_is_replayed_and_no_compiler_complains(
    kind: str, precision: str, laws: dict[str, Law], tmp_path: Path
) -> None:
    told = po.export_controller(
        laws[kind], tmp_path / "made", period=PERIOD, limits=LIMITS, precision=precision
    )
    assert told.samples == 1200
    assert told.largest <= ADMITTED[precision]
    assert sorted(told.files) == [
        "CMakeLists.txt", "README.md", "controller.c", "controller.h", "main.c",
    ]  # fmt: skip
    assert len((tmp_path / "made/controller.c").read_text().splitlines()) < 120
    compiler("gcc")
    for name, *flags in (one for one in DIAGNOSTICS if shutil.which(one[0])):
        for file in ("controller.c", "main.c"):
            strict = [f for f in STRICT if f != "-Wdouble-promotion" or file == "controller.c"]
            subprocess.run(
                [name, *flags, *strict, "-c", file, "-o", "/dev/null"], cwd=tmp_path / "made",
                check=True,
            )  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_float_means_float(kind: str, laws: dict[str, Law], tmp_path: Path) -> None:
    po.export_controller(
        laws[kind], tmp_path / "made", period=PERIOD, limits=LIMITS, precision="float"
    )
    undefined = undefined_of_float(tmp_path / "made/controller.c")
    assert not [name for name in undefined if name.startswith("__aeabi_d")]
    assert undefined <= {"expm1f", "log1pf", "memset", "memcpy"}


def library(folder: Path) -> ctypes.CDLL:
    compiler("gcc")
    subprocess.run(
        ["gcc", "-std=c99", "-O2", "-shared", "-fPIC", "controller.c", "-lm", "-o", "c.so"],
        cwd=folder, check=True,
    )  # fmt: skip
    return ctypes.CDLL(str(folder / "c.so"))


@pytest.mark.parametrize("kind", ["pid", "lqg"])
def test_whatever_it_is_given_it_answers_within_its_limits(
    kind: str, laws: dict[str, Law], tmp_path: Path
) -> None:
    """Two hundred thousand samples of numbers of every size, and of none."""
    po.export_controller(laws[kind], tmp_path / "made", period=PERIOD, limits=LIMITS)
    code = library(tmp_path / "made")
    code.controller_act.restype = ctypes.c_double
    code.controller_act.argtypes = [ctypes.c_void_p, ctypes.c_double, ctypes.c_double]
    memory = ctypes.create_string_buffer(4096)
    code.controller_init(memory)
    generator = np.random.default_rng(1)
    count = 200_000
    given = 10.0 ** generator.uniform(-320.0, 308.0, (count, 2))
    given *= generator.choice([-1.0, 1.0], (count, 2))
    sound = generator.random((count, 2)) < 0.7
    # Afterwards it is sound, and the controller comes back.
    sound[count // 2 :] = True
    given = np.where(sound, 5e-6 * generator.random((count, 2)), given)
    lost = (generator.random((count, 2)) < 0.02) & ~sound
    given[lost] = generator.choice([np.nan, np.inf, -np.inf], int(lost.sum()))
    drives = np.array([code.controller_act(memory, r, y) for r, y in given.tolist()])
    assert np.isfinite(drives).all()
    assert drives.min() >= LIMITS.low
    assert drives.max() <= LIMITS.high
    moves = np.abs(np.diff(drives, prepend=0.0))
    assert moves.max() <= LIMITS.slew * PERIOD * (1.0 + 1e-12)
    assert np.unique(drives[-1000:]).size > 100


def test_from_the_json_of_a_design(laws: dict[str, Law], tmp_path: Path) -> None:
    """The command line reads what ``tune`` wrote, and gives the same code as Python."""
    lqg, pid, spread = laws["lqg"], laws["pid"], laws["shaper"]
    assert isinstance(lqg, LQG)
    assert isinstance(pid, PID)
    assert isinstance(spread, Shaper)
    limits = {"low": -5.0, "high": 42.0, "slew": None}
    designs = {
        "lqg": {"controller": lqg.to_dict(), "period": PERIOD, "limits": limits},
        "pid": {"controller": pid.to_dict(), "period": PERIOD, "limits": limits},
        "shaper": {
            "controller": {
                "kind": "shaper", "name": "EI", "amplitudes": spread.amplitudes.tolist(),
                "times": spread.times.tolist(),
            },
        },
    }  # fmt: skip
    for kind, data in designs.items():
        file = tmp_path / f"{kind}.json"
        file.write_text(json.dumps(data))
        arguments = ["export", "controller", str(file), "--out", str(tmp_path / kind)]
        done = CliRunner().invoke(app, [*arguments, "--period", "1 ms"])
        assert done.exit_code == 0, done.output
        assert "Replayed 1200 samples with faults" in done.stdout
        po.export_controller(
            laws[kind], tmp_path / f"{kind}_own", period=PERIOD, limits=Limits(-5.0, 42.0)
        )
        own, theirs = (
            (tmp_path / folder / "controller.c").read_text() for folder in (f"{kind}_own", kind)
        )
        assert own == theirs
    fit = tmp_path / "fit.json"
    fit.write_text(
        json.dumps(
            {
                "model": {"effects": ["piezo_gain", "bouc_wen"]},
                "parameters": {
                    "piezo_gain.d": {"value": 2e-7}, "bouc_wen.alpha": {"value": 8e-8},
                    "bouc_wen.beta": {"value": 4e-3}, "bouc_wen.gamma": {"value": -5e-3},
                },
            }
        )
    )  # fmt: skip
    arguments = ["export", "controller", str(fit), "--out", str(tmp_path / "inverse")]
    done = CliRunner().invoke(app, [*arguments, "--period", "1 ms", "--limits", "0 V", "100 V"])
    assert done.exit_code == 0, done.output


def test_taps_are_the_shaper_at_samples(laws: dict[str, Law]) -> None:
    shaper = laws["shaper"]
    assert isinstance(shaper, Shaper)
    later, weights = shaper.taps(PERIOD)
    command = np.cumsum(np.random.default_rng(0).normal(size=200))
    wanted = shaper.shaped(PERIOD * np.arange(200), command)
    padded = np.concatenate([np.full(later[-1], command[0]), command])
    own = sum(
        w * padded[later[-1] - k : later[-1] - k + 200] for k, w in zip(later, weights, strict=True)
    )
    assert own == pytest.approx(wanted, rel=1e-9)
    assert weights.sum() == pytest.approx(1.0, rel=1e-12)
    with pytest.raises(InputError, match="sample faster"):
        shaper.taps(1.0)


def test_what_cannot_be_is_one_sentence(laws: dict[str, Law], tmp_path: Path) -> None:
    out = tmp_path / "made"
    with pytest.raises(InputError, match="How often"):
        po.export_controller(laws["pid"], out)
    with pytest.raises(InputError, match="design it anew"):
        po.export_controller(laws["lqg"], out, period=2e-3)
    with pytest.raises(InputError, match="is no name in C"):
        po.export_controller(laws["pid"], out, period=1e-3, name="7")
    with pytest.raises(InputError, match="take 'double' or 'float'"):
        po.export_controller(laws["pid"], out, period=1e-3, precision="half")
    for text, words in (
        ("{}", "is not the JSON of a design"),
        ('{"controller": {"kind": "mpc"}}', "does not leave as code yet"),
        ('{"controller": {"kind": "pid"}, "period": 1}', "is not whole"),
        ('{"controller": {"kind": "odd"}, "period": 1, '
         '"limits": {"low": 0, "high": 1, "slew": null}}', "is not known here"),
    ):  # fmt: skip
        file = tmp_path / "design.json"
        file.write_text(text)
        with pytest.raises(InputError, match=words):
            po.export_controller(file, out)
    assert not out.exists()
