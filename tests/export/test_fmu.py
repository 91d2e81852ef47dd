"""Functional mock-up units in two importers that share no code."""

from __future__ import annotations

import shutil
import subprocess
import zipfile
from ctypes import c_double, c_int, c_uint
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import casadi as ca
import fmpy
import numpy as np
import pytest
from click.testing import CliRunner
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu
from numpy.typing import NDArray

import piezo_opt as po
from piezo_opt.cli import app
from piezo_opt.effects import (
    BoucWen,
    Creep,
    DeadZone,
    Delay,
    Drift,
    Model,
    Offset,
    PiezoGain,
    Preisach,
    SecondOrder,
    Temperature,
)
from piezo_opt.errors import InputError, ModelError
from piezo_opt.export import Unit, export_fmu
from piezo_opt.export.fmu.units import exponents
from piezo_opt.simulation import Simulator
from tests.export.tools import STRICT

FloatArray = NDArray[np.float64]
FOUR = PiezoGain() + BoucWen() + Creep() + SecondOrder() + Drift()
VALUES = {
    "creep.c": 0.03,
    "second_order.omega": 800.0,
    "bouc_wen.gamma": -0.005,
    "drift.rate": 1e-7,
}
TIME = 1e-3 * np.arange(201)
DRIVE = 40.0 - 40.0 * np.cos(2 * np.pi * 7.0 * TIME)
STEPS = (1, 2, 5)
"""Communication steps in milliseconds."""


def record(every: int = 1) -> po.Measurement:
    return po.Measurement(TIME[::every], DRIVE[::every], 1e-7 * DRIVE[::every], name="record")


def written(folder: Path, model: Model = FOUR, **options: Any) -> Unit:
    values = {k: v for k, v in VALUES.items() if k in model.parameters}
    return export_fmu(model, folder / "actuator.fmu", values=values, record=record(), **options)


def native(unit: Unit, every: int, model: Model = FOUR, **values: float) -> FloatArray:
    numbers = {**po.Values.nominal(model), **VALUES, **values}
    own = {k: v for k, v in numbers.items() if k in model.parameters}
    return Simulator(model, record(every), own, substeps=unit.accuracy.substeps).reading(own)


def slave(kind: Any, unit: Unit, folder: Path) -> tuple[Any, dict[str, int]]:
    """An instance by FMPy, and the references of its variables."""
    unzipped = fmpy.extract(str(unit.path), unzipdir=str(folder / "unzipped"))
    told = fmpy.read_model_description(unzipped)
    one = kind(
        guid=told.guid, unzipDirectory=unzipped, instanceName="one",
        modelIdentifier=told.coSimulation.modelIdentifier,
    )  # fmt: skip
    one.instantiate()
    return one, {v.name: v.valueReference for v in told.modelVariables}


def by_fmi2(
    unit: Unit, every: int, folder: Path, drive: str = "drive", **parameters: float
) -> FloatArray:
    """Value and rate of the drive at each step's beginning, as FMI 2.0 has it."""
    one, at = slave(FMU2Slave, unit, folder)
    one.setupExperiment(startTime=0.0)
    for name, value in parameters.items():
        one.setReal([at[name]], [value])
    one.enterInitializationMode()
    one.setReal([at[drive]], [DRIVE[0]])
    one.exitInitializationMode()
    reading = [one.getReal([at["reading"]])[0]]
    time, volts = TIME[::every], DRIVE[::every]
    for k in range(time.size - 1):
        h = time[k + 1] - time[k]
        one.setReal([at[drive]], [volts[k]])
        one.fmi2SetRealInputDerivatives(
            one.component, (c_uint * 1)(at[drive]), 1, (c_int * 1)(1),
            (c_double * 1)((volts[k + 1] - volts[k]) / h),
        )  # fmt: skip
        one.doStep(time[k], h)
        reading.append(one.getReal([at["reading"]])[0])
    one.terminate()
    one.freeInstance()
    return np.array(reading)


def by_fmi3(unit: Unit, every: int, folder: Path, drive: str = "drive") -> FloatArray:
    """The value of the drive at each step's end."""
    one, at = slave(FMU3Slave, unit, folder)
    one.enterInitializationMode(startTime=0.0)
    one.setFloat64([at[drive]], [DRIVE[0]])
    one.exitInitializationMode()
    reading = [one.getFloat64([at["reading"]])[0]]
    time, volts = TIME[::every], DRIVE[::every]
    for k in range(time.size - 1):
        one.setFloat64([at[drive]], [volts[k + 1]])
        one.doStep(time[k], time[k + 1] - time[k])
        reading.append(one.getFloat64([at["reading"]])[0])
    assert one.getFloat64([0])[0] == pytest.approx(time[-1])
    one.terminate()
    one.freeInstance()
    return np.array(reading)


def by_casadi(unit: Unit, every: int, folder: Path) -> FloatArray:
    """CasADi's importer gives rates and reading; a Runge-Kutta scheme here moves them."""
    unzipped = fmpy.extract(str(unit.path), unzipdir=str(folder / "unzipped"))
    model = ca.DaeBuilder("actuator", str(unzipped))
    assert model.u() == ["drive", "drive_rate"]
    function = model.create("f", ["t", "x", "u"], ["ode", "y"])
    x, reading = np.zeros(len(model.x())), []
    time, drive = TIME[::every], DRIVE[::every]
    cut = unit.accuracy.substeps

    def rate(t: float, x: FloatArray, u: float) -> FloatArray:
        return np.array(function(t, x, [u, slope])[0]).ravel()

    slope = 0.0
    reading = [float(function(0.0, x, [drive[0], 0.0])[1])]
    for k in range(time.size - 1):
        length, move = time[k + 1] - time[k], drive[k + 1] - drive[k]
        slope, t, u = move / length, time[k], drive[k]
        count = max(1, int(np.ceil(max(length / cut.longest, abs(move) / cut.largest_move) - 1e-6)))
        h = length / count
        for _ in range(count):
            k1 = rate(t, x, u)
            k2 = rate(t + h / 2, x + h / 2 * k1, u + slope * h / 2)
            k3 = rate(t + h / 2, x + h / 2 * k2, u + slope * h / 2)
            k4 = rate(t + h, x + h * k3, u + slope * h)
            x, t, u = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4), t + h, u + slope * h
        reading.append(float(function(t, x, [drive[k + 1], slope])[1]))
    return np.array(reading)


@pytest.mark.parametrize(
    ("options", "run"),
    [({}, by_fmi2), ({"version": "3.0"}, by_fmi3), ({"exchange": True}, by_casadi)],
    ids=["fmi2", "fmi3", "exchange"],
)
def test_importers_read_what_the_library_reads(
    options: dict[str, Any], run: Any, tmp_path: Path
) -> None:
    unit = written(tmp_path, **options)
    assert validate_fmu(str(unit.path)) == []
    assert unit.size < 200 * 1024
    with zipfile.ZipFile(unit.path) as archive:
        archive.extractall(tmp_path / "all")
    code = next((tmp_path / "all" / "sources").glob("fmi*.c"))
    strict = ["gcc", "-std=c99", *STRICT, "-O2", "-fPIC", "-c", str(code), "-o", "/dev/null"]
    subprocess.run(strict, check=True)
    for every in STEPS:
        wanted = native(unit, every)
        reading = run(unit, every, tmp_path / str(every))
        assert np.abs(reading - wanted).max() < 1e-9 * np.ptp(wanted)


@pytest.mark.parametrize(
    ("version", "run"), [("2.0", by_fmi2), ("3.0", by_fmi3)], ids=["fmi2", "fmi3"]
)
def test_a_delay_of_no_whole_step_is_the_librarys(version: str, run: Any, tmp_path: Path) -> None:
    """Told a usual step of 10 ms, and called every 1, 2 and 5 ms: the past is long enough."""
    model, late = FOUR + Delay(), {"delay.T": 13.3e-3}
    unit = export_fmu(
        model, tmp_path / "late.fmu", values={**VALUES, **late}, record=record(), step="10 ms",
        version=version,
    )  # fmt: skip
    assert validate_fmu(str(unit.path)) == []
    prompt = native(unit, 1)
    for every in STEPS:
        wanted = native(unit, every, model, **late)
        reading = run(unit, every, tmp_path / str(every), drive="command")
        assert np.abs(reading - wanted).max() < 1e-9 * np.ptp(wanted)
        assert np.abs(wanted - prompt[::every]).max() > 0.1 * np.ptp(wanted)


def test_a_delay_can_be_set(tmp_path: Path) -> None:
    model = PiezoGain() + BoucWen() + Delay()
    unit = export_fmu(
        model, tmp_path / "late.fmu", record=record(), step="1 ms",
        values={"delay.T": 1e-3, "bouc_wen.gamma": VALUES["bouc_wen.gamma"]},
    )  # fmt: skip
    wanted = native(unit, 1, model, **{"delay.T": 37.7e-3})
    reading = by_fmi2(unit, 1, tmp_path, drive="command", **{"delay.T": 37.7e-3})
    assert np.abs(reading - wanted).max() < 1e-9 * np.ptp(wanted)


def test_parameters_can_be_set(tmp_path: Path) -> None:
    """Also those of which something costly follows."""
    model = PiezoGain() + Preisach(operators=3) + Offset()
    unit = written(tmp_path, model)
    changed = {"piezo_gain.d": 2e-7, "preisach.decay": 3.0, "offset.y0": 1e-6}
    wanted = native(unit, 1, model, **changed)
    reading = by_fmi2(unit, 1, tmp_path, **changed)
    assert np.abs(reading - wanted).max() < 1e-9 * np.ptp(wanted)
    assert np.abs(native(unit, 1, model) - wanted).max() > 0.1 * np.ptp(wanted)


def test_a_whole_state_is_kept_and_set(tmp_path: Path) -> None:
    one, at = slave(FMU2Slave, written(tmp_path), tmp_path)
    one.setupExperiment(startTime=0.0)
    one.enterInitializationMode()
    one.exitInitializationMode()

    def step(drive: float) -> float:
        one.setReal([at["drive"]], [drive])
        one.doStep(0.0, 1e-3)
        return float(one.getReal([at["reading"]])[0])

    step(30.0)
    kept = one.getFMUState()
    onward = [step(u) for u in (60.0, 20.0)]
    assert [step(u) for u in (60.0, 20.0)] != onward
    one.setFMUState(kept)
    assert [step(u) for u in (60.0, 20.0)] == onward
    written_out = one.serializeFMUstate(kept)
    one.reset()
    one.setFMUState(one.deSerializeFMUstate(written_out))
    assert [step(u) for u in (60.0, 20.0)] == onward
    one.freeInstance()


def test_names_units_and_starts(tmp_path: Path) -> None:
    model = FOUR + Temperature()
    values = {**VALUES, "temperature.a": 1e-10}
    path = tmp_path / "hot.fmu"
    export_fmu(model, path, values=values, step="1 ms", version="3.0")
    told = fmpy.read_model_description(str(path))
    found = {v.name: v for v in told.modelVariables}
    for name, parameter in model.parameters.items():
        if not parameter.fixed:
            assert found[name].unit == parameter.unit
            assert found[name].description == parameter.meaning
            wanted = values.get(name, parameter.nominal)
            assert float(found[name].start) == wanted
    assert found["temperature"].causality == "input"
    assert found["creep.z[3]"].causality == "local"
    units = {unit.name: unit.baseUnit for unit in told.unitDefinitions}
    assert (units["m/V"].kg, units["m/V"].m, units["m/V"].s, units["m/V"].A) == (-1, -1, 3, 1)
    assert units["rad/s"].rad == 1


def test_exponents() -> None:
    assert exponents("V*s/m") == {"kg": 1, "m": 1, "s": -2, "A": -1}
    assert exponents("1/s^2") == {"s": -2}
    assert exponents("1") == {}
    with pytest.raises(InputError, match="furlong"):
        exponents("m/furlong")


def test_the_same_model_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
    one, two = (written(tmp_path / name).path.read_bytes() for name in ("one", "two"))
    assert one == two
    with zipfile.ZipFile(tmp_path / "one" / "actuator.fmu") as archive:
        names = archive.namelist()
    assert "modelDescription.xml" in names
    assert "sources/fmi2.c" in names
    assert not any(name.endswith(".py") for name in names)


@pytest.mark.skipif(find_spec("ziglang") is None, reason="ziglang is not installed")
def test_another_system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The compiler of the package index, for a Mac, on a computer that has no other."""
    monkeypatch.setenv("PIEZO_OPT_CC", "")
    unit = written(tmp_path, platforms=("mac",))
    with zipfile.ZipFile(unit.path) as archive:
        library = archive.read("binaries/darwin64/actuator.dylib")
    assert library[:4] == bytes.fromhex("cffaedfe")  # Mach-O, 64 bits
    assert b"fmi2DoStep" in library


def test_what_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copy(__file__, tmp_path / "there.fmu")
    refused: list[tuple[str, dict[str, Any], str]] = [
        ("there.fmu", {}, "exists already"),
        ("unit.zip", {}, r"ends with \.fmu"),
        ("unit.fmu", {"version": "1.0"}, "'2.0' or '3.0'"),
        ("unit.fmu", {"version": "3.0", "exchange": True}, "FMI 2.0"),
        ("unit.fmu", {"platforms": ("amiga",)}, "there are linux, windows"),
        ("unit.fmu", {"step": "1 s", "values": {"second_order.omega": 1e6}}, "sub-steps|stiff"),
    ]
    for name, options, words in refused:
        with pytest.raises(InputError, match=words):
            export_fmu(FOUR, tmp_path / name, **{"step": "1 ms", **options})
    with pytest.raises(InputError, match="one folder for both"):
        export_fmu(FOUR, tmp_path / "a.fmu", step="1 ms", platforms=("mac", "mac-arm"))
    with pytest.raises(ModelError, match="jump"):
        export_fmu(
            PiezoGain() + DeadZone(backlash=True), tmp_path / "a.fmu", step="1 ms", exchange=True,
            values={"dead_zone.w": 1e-7},
        )  # fmt: skip
    with pytest.raises(ModelError, match="no place for the past of the drive"):
        export_fmu(
            FOUR + Delay(), tmp_path / "a.fmu", step="1 ms", exchange=True,
            values={"delay.T": 1e-3},
        )  # fmt: skip
    monkeypatch.setenv("PIEZO_OPT_CC", "")
    monkeypatch.setattr("piezo_opt.export.fmu.build.find_spec", lambda _: None)
    with pytest.raises(InputError, match=r"piezo_opt\[cross\]"):
        export_fmu(FOUR, tmp_path / "a.fmu", step="1 ms")
    assert [f.name for f in tmp_path.iterdir()] == ["there.fmu"]


def test_the_command(tmp_path: Path) -> None:
    file, out = tmp_path / "model.toml", tmp_path / "actuator.fmu"
    file.write_text('effects = ["piezo_gain", "bouc_wen"]\n')
    arguments = [
        "export",
        "fmu",
        str(file),
        "--out",
        str(out),
        "--step",
        "1 ms",
        "--version",
        "3.0",
    ]
    found = CliRunner().invoke(app, arguments)
    assert found.exit_code == 0, found.output
    assert "FMI 3.0, co-simulation" in found.stdout
    again = CliRunner().invoke(app, arguments)
    assert again.exit_code == 2
    assert len(again.stderr.strip().splitlines()) == 1
