"""Controllers as C: no diagnostic, no double in float, Python's own answers, faults included."""

from __future__ import annotations

import ctypes
import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import piezo_opt as po
from piezo_opt.cli import app
from piezo_opt.control import (
    LQG,
    MPC,
    PID,
    InverseCompensation,
    Limits,
    ModelPlant,
    Shaper,
    ei,
    tune_lqr,
)
from piezo_opt.errors import InputError
from piezo_opt.export.laws.mpc import memory
from piezo_opt.export.laws.verb import ADMITTED, Law
from tests.control.test_tune_lqr import LIMITS, PERIOD, SAW, STAGE, VALUES
from tests.export.tools import DIAGNOSTICS, STRICT, compiler, undefined_of_float

KINDS = ("pid", "lqg", "inverse", "shaper", "mpc", "mpc_late")
LINES = {"mpc": 800, "mpc_late": 800}


@pytest.fixture(scope="module")
def laws() -> dict[str, Law]:
    tuned = tune_lqr(STAGE, SAW, period=PERIOD, values=VALUES, limits=LIMITS, noise=5e-9)
    return {
        "pid": PID(2e6, 7.6e8, 600.0, 1e-4, largest=2e-5),
        "lqg": tuned.controller,
        "inverse": InverseCompensation(2e-7, 8e-8, 4e-3, -5e-3),
        "shaper": ei(2.0 * np.pi * 31.3, 0.03),
        "mpc": MPC(
            STAGE, VALUES, period=PERIOD, span=6e-6, horizon=15, limits=LIMITS, noise=5e-9,
            gate=2e-6,
        ),
        "mpc_late": MPC(
            STAGE, VALUES, period=PERIOD, span=6e-6, horizon=10, limits=LIMITS, noise=5e-9,
            delay=2, stroke=(-1e-6, 5e-6),
        ),
    }  # fmt: skip


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
    assert len((tmp_path / "made/controller.c").read_text().splitlines()) < LINES.get(kind, 120)
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
    assert undefined <= {"expm1f", "log1pf", "fminf", "fmaxf", "memset", "memcpy", "memmove"}


def library(folder: Path) -> ctypes.CDLL:
    compiler("gcc")
    subprocess.run(
        ["gcc", "-std=c99", "-O2", "-shared", "-fPIC", "controller.c", "-lm", "-o", "c.so"],
        cwd=folder, check=True,
    )  # fmt: skip
    return ctypes.CDLL(str(folder / "c.so"))


@pytest.mark.parametrize(
    ("kind", "count"),
    [("pid", 200_000), ("lqg", 200_000), ("mpc", 20_000), ("mpc_late", 20_000)],
)
def test_whatever_it_is_given_it_answers_within_its_limits(
    kind: str, count: int, laws: dict[str, Law], tmp_path: Path
) -> None:
    """Samples of numbers of every size, and of none."""
    po.export_controller(laws[kind], tmp_path / "made", period=PERIOD, limits=LIMITS)
    code = library(tmp_path / "made")
    code.controller_act.restype = ctypes.c_double
    code.controller_act.argtypes = [ctypes.c_void_p, ctypes.c_double, ctypes.c_double]
    memory = ctypes.create_string_buffer(1 << 16)
    code.controller_init(memory)
    generator = np.random.default_rng(1)
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


def test_predictive_control_goes_on_through_a_saturated_sensor(tmp_path: Path) -> None:
    """In the loop: lost readings, then one that says its upper end for 50 periods."""
    seen, drives, errors = _loop_with_faults(tmp_path, "double")
    status = seen["status"]
    assert (status[100:120] & 2 == 2).all()
    assert (status[20:100] & 2 == 0).all()
    # Beyond the gate it is no reading, until the patience of ten of them is at its end.
    assert (status[201:210] & 2 == 2).all()
    assert (np.abs(errors[150:200]) < 60e-9).all()
    assert np.abs(errors[100:121]).max() < 60e-9
    assert np.abs(errors[-100:]).max() < 60e-9
    assert np.isfinite(drives).all()
    _, single, off = _loop_with_faults(tmp_path / "float", "float")
    apart = np.abs(single[:100] - drives[:100])
    # Where a limit is touched the plan hangs on the sign of moves next to zero: a few jump further.
    assert np.median(apart) < 1e-6 * np.ptp(drives)
    assert apart.max() < 1e-3 * np.ptp(drives)
    assert np.std(off[-100:]) < 1.1 * np.std(errors[-100:])


def _loop_with_faults(folder: Path, precision: str) -> tuple[dict[str, Any], Any, Any]:
    law = MPC(
        STAGE, VALUES, period=PERIOD, span=6e-6, horizon=15, limits=LIMITS, noise=5e-9, gate=1e-6
    )
    folder.mkdir(exist_ok=True)
    po.export_controller(law, folder / "made", precision=precision)
    code = library(folder / "made")
    real = ctypes.c_float if precision == "float" else ctypes.c_double
    code.controller_act.restype = real
    code.controller_act.argtypes = [ctypes.c_void_p, real, real]
    own = memory(law, "controller", precision)()
    code.controller_init(ctypes.byref(own))
    plant, generator = ModelPlant(STAGE, VALUES), np.random.default_rng(3)
    count = 500
    reference = 2.5e-6 - 2e-6 * np.cos(2.0 * np.pi * np.arange(count) / 400.0)
    drives, errors, status = np.empty(count), np.empty(count), np.empty(count, dtype=int)
    reading = plant.begin(0.0)
    for k in range(count):
        seen = reading + 1e-9 * float(generator.normal())
        seen = float("nan") if 100 <= k < 120 else 10e-6 if 200 <= k < 250 else seen
        errors[k] = reading - reference[max(k - 1, 0)]
        drives[k] = code.controller_act(ctypes.byref(own), reference[k], seen)
        status[k] = own.status
        reading = plant.advance(float(drives[k]), PERIOD)
    return {"status": status}, drives, errors


def test_what_is_known_before_reaches_the_code(tmp_path: Path) -> None:
    """``act_ahead`` decides as Python does where it knows the reference of the whole horizon."""
    wave = 2.5e-6 - 2e-6 * np.cos(2.0 * np.pi * np.arange(200) / 40.0)
    law = MPC(
        STAGE, VALUES, period=PERIOD, span=6e-6, horizon=10, limits=LIMITS, noise=5e-9, delay=1,
        reference=wave,
    )  # fmt: skip
    po.export_controller(law, tmp_path / "made")
    code = library(tmp_path / "made")
    act = code.controller_act_ahead
    act.restype = ctypes.c_double
    act.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_double]
    own, state, drive = memory(law, "controller", "double")(), law.begin(), 0.0
    code.controller_init(ctypes.byref(own))
    for k in range(60):
        ahead = law.following(k, 0.0)
        reading = float(wave[k]) + 1e-8 * np.sin(k)
        got = act(ctypes.byref(own), ahead.ctypes.data, reading)
        drive, state = law.act(state, 0.0, reading, PERIOD, *LIMITS.around(drive, PERIOD))
        assert got == pytest.approx(drive, abs=1e-9)


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
    predictive = laws["mpc_late"]
    assert isinstance(predictive, MPC)
    plant = {
        "model": STAGE.to_dict(), "parameters": {n: {"value": v} for n, v in VALUES.items()},
    }  # fmt: skip
    file = tmp_path / "mpc.json"
    file.write_text(json.dumps({
        "controller": predictive.to_dict(), "period": PERIOD, "limits": LIMITS.to_dict(),
        "plant": plant,
    }))  # fmt: skip
    arguments = ["export", "controller", str(file), "--out", str(tmp_path / "mpc")]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    po.export_controller(predictive, tmp_path / "mpc_own")
    assert (tmp_path / "mpc/controller.c").read_text() == (
        tmp_path / "mpc_own/controller.c"
    ).read_text()
    with pytest.raises(InputError, match="design it anew"):
        po.export_controller(predictive, tmp_path / "other", limits=Limits(0.0, 1.0))
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
        ('{"controller": {"kind": "mpc"}, "period": 1, '
         '"limits": {"low": 0, "high": 1, "slew": null}}', "is not whole"),
        ('{"controller": {"kind": "pid"}, "period": 1}', "is not whole"),
        ('{"controller": {"kind": "odd"}, "period": 1, '
         '"limits": {"low": 0, "high": 1, "slew": null}}', "is not known here"),
    ):  # fmt: skip
        file = tmp_path / "design.json"
        file.write_text(text)
        with pytest.raises(InputError, match=words):
            po.export_controller(file, out)
    assert not out.exists()
