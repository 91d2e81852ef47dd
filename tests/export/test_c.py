"""Models as C: what the compiled code reads, what compilers say to it, and what is refused."""

from __future__ import annotations

import ctypes
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

import piezo_opt as po
from piezo_opt.cli import app
from piezo_opt.effects import (
    BoucWen,
    Creep,
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
from piezo_opt.export import export_c
from piezo_opt.export.c import verb
from piezo_opt.export.c.beside import program
from piezo_opt.export.c.plan import Plan, plan, system_of
from piezo_opt.export.c.printer import DOUBLE, FLOAT, Precision
from piezo_opt.export.c.replay import replay
from piezo_opt.export.c.tangents import moved_by
from piezo_opt.export.c.writer import text
from piezo_opt.export.given import given, on
from piezo_opt.measurement import Measurement
from piezo_opt.modelfile import read_model
from piezo_opt.simulation import Simulator, Substeps
from tests.export.tools import (
    DIAGNOSTICS,
    FORMS,
    KINDS,
    STRICT,
    compiler,
    form_id,
    modelled,
    undefined_of_float,
)

FloatArray = NDArray[np.float64]
FOUR = PiezoGain() + BoucWen() + Creep() + SecondOrder()
VALUES = {"creep.c": 0.03, "second_order.omega": 800.0, "bouc_wen.gamma": -0.005}
TIME = np.arange(300) / 1e3
DRIVE = 40.0 + 35.0 * np.sin(2 * np.pi * 7.0 * TIME) + 10.0 * np.sin(2 * np.pi * 41.0 * TIME)
SUBSTEPS = Substeps(5e-6, 4.0)


def brief() -> Measurement:
    """100 samples in which the drive turns often, and the temperature rises."""
    time = np.arange(100) / 20e3
    drive = 20.0 + 35.0 * np.sin(2 * np.pi * 350 * time) + 15.0 * np.sin(2 * np.pi * 770 * time + 1)
    warm = {"temperature": 293.15 + 700.0 * time}
    return Measurement(time, drive, 1e-7 * drive, channels=warm, name="brief")


def record(name: str = "record", **channels: FloatArray) -> Measurement:
    return Measurement(TIME, DRIVE, 1e-7 * DRIVE, channels=channels, name=name)


def written(
    folder: Path, model: Model, values: dict[str, float], precision: Precision, moved: bool
) -> Any:
    """The code of a model with given sub-steps, without a check."""
    what = given(model, values)
    ready = plan(what, system_of(what), "actuator", SUBSTEPS, 1.0 / 20e3, moved)
    header, source = text(ready, precision)
    folder.mkdir(exist_ok=True)
    (folder / "actuator.c").write_text(source)
    (folder / "actuator.h").write_text(header)
    (folder / "main.c").write_text(program(ready, precision, "m"))
    return what, ready


@pytest.mark.parametrize("form", FORMS, ids=form_id)
def test_every_effect_reads_as_in_the_library(
    form: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With its derivatives; and in float, which is float: no operation is a double's."""
    cc = compiler("gcc")
    monkeypatch.setenv("PIEZO_OPT_CC", "")  # the library's other engine, which compiles nothing
    model, values = modelled(form)
    for precision in (DOUBLE, FLOAT):
        moved = precision is DOUBLE
        what, ready = written(tmp_path, model, values, precision, moved)
        if precision is FLOAT and form not in KINDS:
            break
        found = replay(
            tmp_path, "actuator", precision.name, cc, what.model, what.values,
            on(brief(), what.model), SUBSTEPS, ready.system.channel_names,
            [one.full for one in moved_by(ready)] if moved else (),
        )  # fmt: skip
        assert found.share < (1e-13 if precision is DOUBLE else 3e-6)
        assert not moved or (found.slopes is not None and found.slopes < 1e-11)
    asked = undefined_of_float(tmp_path / "actuator.c")
    # By the last of them compilers copy structs.
    known = "fabsf ceilf expf logf log1pf expm1f sqrtf sinf cosf tanhf memcpy"
    assert asked <= {*known.split()}


@pytest.mark.parametrize("late", [0.0, 0.2e-3, 1e-3, 3.7e-3])
def test_a_delay_of_any_length_is_the_librarys(late: float, tmp_path: Path) -> None:
    """Shorter than a sample, whole samples, and between; with a channel, which is not delayed."""
    compiler("gcc")
    model = FOUR + Delay() + Temperature()
    values = {**VALUES, "delay.T": late, "temperature.a": 2e-9}
    if not late:
        model = model.without("delay")
        values.pop("delay.T")
    warm = record(temperature=293.15 + 20.0 * np.sin(TIME))
    made = export_c(model, tmp_path / "out", values=values, replay=warm)
    assert made.replay is not None
    assert made.replay.share < 1e-13
    single = export_c(model, tmp_path / "float", values=values, replay=warm, precision="float")
    assert single.replay is not None
    assert single.replay.share < 5e-6
    header = (tmp_path / "out/actuator.h").read_text()
    lines = 2 + int(np.ceil(late / made_step()))
    assert ("ACTUATOR_LINES" in header) == (late > 0.0)
    assert not late or f"#define ACTUATOR_LINES {lines}\n" in header


def made_step() -> float:
    return float(TIME[1] - TIME[0])


def test_the_test_of_floats_sees_a_double(tmp_path: Path) -> None:
    (tmp_path / "actuator.c").write_text(
        "#include <math.h>\nfloat f(float x) { return (float)exp(x) * 2; }\n"
        "float g(float x) { return (float)((double)x * 0.1); }\n"
    )
    found = undefined_of_float(tmp_path / "actuator.c")
    assert {"exp", "__aeabi_f2d", "__aeabi_d2f", "__aeabi_dmul"} <= found


def test_a_model_without_states(tmp_path: Path) -> None:
    for precision in ("double", "float"):
        found = export_c(
            PiezoGain() + Drift(), tmp_path / precision, values={"drift.rate": 1e-6}, step="1 ms",
            precision=precision,
        )  # fmt: skip
        assert found.replay is not None
        assert found.replay.share < 1e-6


@pytest.mark.parametrize("command", DIAGNOSTICS, ids=lambda command: command[0])
@pytest.mark.parametrize("precision", ["double", "float"])
def test_compilers_say_nothing(command: list[str], precision: str, tmp_path: Path) -> None:
    compiler(command[0])
    export_c(
        FOUR, tmp_path / "out", values=VALUES, step="1 ms", precision=precision, sensitivities=True
    )
    for optimised in ("-O0", "-O3"):
        for file in ("actuator.c", "main.c"):
            subprocess.run(
                [*command, *STRICT, optimised, "-c", file, "-o", "/dev/null"],
                cwd=tmp_path / "out", check=True,
            )  # fmt: skip


def test_a_reader_finds_the_equations(tmp_path: Path) -> None:
    export_c(FOUR + Offset(), tmp_path / "out", values=VALUES, step="1 ms")
    header, source = ((tmp_path / "out" / f"actuator.{end}").read_text() for end in "hc")
    assert len(header.splitlines()) + len(source.splitlines()) <= 300
    assert max(map(len, (header + source).splitlines())) <= 100
    for name, parameter in FOUR.parameters.items():
        line = f"double {name.replace('.', '_')};"
        if not parameter.fixed:
            found = next(one for one in header.splitlines() if line in one)
            assert parameter.meaning in found
            assert f"[{parameter.unit}]" in found
    assert "double creep_z[3];" in header
    plain = " ".join(source.split())
    assert (
        "rates->bouc_wen_h = p->bouc_wen_alpha * drive_rate - p->bouc_wen_beta * fabs(drive_rate) "
        "* x->bouc_wen_h - p->bouc_wen_gamma * drive_rate * fabs(x->bouc_wen_h);"
    ) in plain
    assert "const double free_displacement = p->piezo_gain_d * drive - x->bouc_wen_h" in plain
    assert "rates->second_order_x = x->second_order_w;" in plain
    # No memory of its own, nothing but libm.
    assert not re.search(
        r"\b(static (?!actuator|double|void|float|inline\b)|malloc|extern (?!\"C\"))", plain
    )
    assert re.findall(r"#include (\S+)", source) == ['"actuator.h"', "<math.h>"]


def test_derivatives_are_those_of_the_library(tmp_path: Path) -> None:
    """Of a model in which everything flows and something jumps, in both precisions."""
    model = FOUR + Preisach(operators=3) + Drift()
    values = {**VALUES, "drift.rate": 1e-7}
    for precision, admitted in (("double", 1e-12), ("float", 1e-4)):
        made = export_c(
            model, tmp_path / precision, values=values, replay=record(), precision=precision,
            sensitivities=True,
        )  # fmt: skip
        assert made.replay is not None
        assert made.replay.slopes is not None
        assert 0.0 < made.replay.slopes < admitted
        assert f"derivatives agree to {made.replay.slopes:.1e}" in str(made)
    header = (tmp_path / "double/actuator.h").read_text()
    assert re.search(r"actuator_by_piezo_gain_d = 0, +/\* \[m/\(m/V\)\] \*/", header)
    assert "step_sensitivities" in (tmp_path / "double/README.md").read_text()
    plain = export_c(model, tmp_path / "plain", values=values, replay=record())
    assert plain.replay is not None
    assert plain.replay.slopes is None
    assert "by_" not in (tmp_path / "plain/actuator.h").read_text()


def test_derivatives_beside_a_delay(tmp_path: Path) -> None:
    """By all parameters but the delay itself."""
    values = {**VALUES, "delay.T": 1.7e-3}
    made = export_c(
        FOUR + Delay(), tmp_path / "out", values=values, replay=record(), sensitivities=True
    )
    assert made.replay is not None
    assert made.replay.slopes is not None
    assert made.replay.slopes < 1e-12
    assert "actuator_by_delay" not in (tmp_path / "out/actuator.h").read_text()


def test_other_derivatives_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def wrong(ready: Plan, precision: Precision) -> tuple[str, str]:
        header, source = text(ready, precision)
        return header, source.replace("rates[i].second_order_x = by[i]", "rates[i].second_order_x = 1.001 * by[i]")  # fmt: skip  # noqa: E501

    monkeypatch.setattr(verb, "text", wrong)
    with pytest.raises(ModelError, match="other derivatives than the library"):
        export_c(FOUR, tmp_path / "out", values=VALUES, replay=record(), sensitivities=True)
    assert list(tmp_path.iterdir()) == []


def test_what_does_nothing_is_not_in_the_code(tmp_path: Path) -> None:
    found = export_c(FOUR, tmp_path / "out", step="1 ms")
    assert found.pruned == ("creep",)
    assert "creep_" not in (tmp_path / "out" / "actuator.c").read_text()
    assert "creep did nothing" in (tmp_path / "out" / "README.md").read_text()


def run_many(folder: Path, real: str, drive: FloatArray, step: float) -> FloatArray:
    """The reading of a long drive, by the code as a shared library, call by call and at once."""
    cc = compiler("gcc")
    (folder / "many.c").write_text(
        '#include "actuator.h"\n'
        f"void many(long n, {real} step, const {real} *u, {real} *y)\n"
        "{ actuator a; actuator_init(&a, u[0]); y[0] = actuator_output(&a);\n"
        "  for (long i = 1; i < n; ++i) y[i] = actuator_step(&a, step, u[i]); }\n"
        f"void at_once(long n, {real} step, const {real} *u, {real} *y)\n"
        "{ actuator a; actuator_init(&a, u[0]); y[0] = actuator_output(&a);\n"
        "  actuator_run(&a, step, n / 2, u + 1, y + 1);\n"
        "  actuator_run(&a, step, n - 1 - n / 2, u + 1 + n / 2, y + 1 + n / 2); }\n"
    )
    subprocess.run(
        [cc, "-std=c99", "-O2", "-shared", "-fPIC", "many.c", "actuator.c", "-lm", "-o", "many.so"],
        cwd=folder, check=True,
    )  # fmt: skip
    kind, scalar = (
        (np.float32, ctypes.c_float) if real == "float" else (np.float64, ctypes.c_double)
    )
    given_drive = np.ascontiguousarray(drive, dtype=kind)
    reading, again = (np.zeros(drive.size, dtype=kind) for _ in range(2))
    library = ctypes.CDLL(str(folder / "many.so"))
    for run, into in ((library.many, reading), (library.at_once, again)):
        pointers = (ctypes.c_void_p(a.ctypes.data) for a in (given_drive, into))
        run(ctypes.c_long(drive.size), scalar(step), *pointers)
    np.testing.assert_array_equal(again, reading)
    return np.asarray(reading, dtype=float)


def test_a_million_steps(tmp_path: Path) -> None:
    """Double stays at rounding, float within 1e-5 of the stroke, and neither grows."""
    count, step = 1_000_000, 2.0**-10  # a number that sums up without rounding
    time = step * np.arange(count)
    drive = 50.0 + 30.0 * np.sin(0.7 * time) + 15.0 * np.sin(11.0 * time)
    model = FOUR + Drift()
    values = {**VALUES, "creep.tau": 10.0, "drift.rate": 2e-10}
    for precision, admitted in (("double", 1e-12), ("float", 1e-5)):
        folder = tmp_path / precision
        long = Measurement(time, drive, 1e-7 * drive, name="long")
        export_c(model, folder, values=values, step=step, precision=precision, substeps=2)
        substeps = Substeps(step / 2, np.inf)
        what = given(model, values)
        # A float has its own values: those of the model as it holds them.
        numbers = dict(what.values)
        if precision == "float":
            numbers = {k: float(np.float32(v)) for k, v in numbers.items()}
            long = long.with_(drive=drive.astype(np.float32).astype(float))
        wanted = Simulator(what.model, long, numbers, substeps=substeps).reading(numbers)
        apart = np.abs(run_many(folder, precision, drive, step) - wanted) / np.ptp(wanted)
        assert apart.max() < admitted
        tenth = count // 10
        assert apart[-tenth:].max() < 3.0 * apart[:tenth].max()


def test_a_mismatch_is_refused_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def wrong(ready: Plan, precision: Precision) -> tuple[str, str]:
        header, source = text(ready, precision)
        return header, source.replace("0.5 * h", "0.4999 * h")

    monkeypatch.setattr(verb, "text", wrong)
    with pytest.raises(ModelError, match="does not read what the library reads"):
        export_c(FOUR, tmp_path / "out", values=VALUES, replay=record())
    assert list(tmp_path.iterdir()) == []


def test_bad_input_gets_a_sentence(tmp_path: Path) -> None:
    there = tmp_path / "there"
    there.mkdir()
    hot = PiezoGain() + Temperature()
    for arguments, words in (
        ((FOUR, there), "exists already"),
        ((FOUR, tmp_path / "no" / "where"), "there is no such folder"),
        ((FOUR, tmp_path / "out"), "How often the code will be called"),
    ):
        with pytest.raises(InputError, match=words):
            export_c(*arguments)
    swift = {**VALUES, "second_order.omega": 1e5}
    refused: list[tuple[dict[str, Any], str]] = [
        ({"step": "-1 s"}, "is no time"),
        ({"step": "1 ms", "precision": "half"}, "'double' or 'float'"),
        ({"step": "1 ms", "name": "2nd"}, "no name in C"),
        ({"step": "1 ms", "name": "double"}, "no name in C"),
        ({"step": "1 ms", "values": {"creep.d": 1.0}}, "no parameter 'creep.d'"),
        ({"step": "1 ms", "substeps": 0}, "a whole number from 1"),
        ({"step": "1 ms", "drive": (1.0, 0.0)}, "lower end"),
        ({"step": "20 ms", "values": swift}, "sub-steps between two calls: call it at least"),
        ({"step": "1000 s", "values": swift}, "step = 1000 s: .* too stiff"),
        ({"step": "10 ms", "values": VALUES, "substeps": 1}, "take more sub-steps"),
    ]
    for options, words in refused:
        with pytest.raises(InputError, match=words):
            export_c(FOUR, tmp_path / "out", **options)
    with pytest.raises(InputError, match="'temperature' and the record has none"):
        export_c(hot, tmp_path / "out", values={"temperature.a": 1e-9}, replay=record())
    assert list(tmp_path.iterdir()) == [there]


def test_without_a_compiler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PIEZO_OPT_CC", "")
    with pytest.raises(InputError, match="no C compiler"):
        export_c(FOUR, tmp_path / "out", values=VALUES, replay=record())
    found = export_c(FOUR, tmp_path / "out", values=VALUES, step="1 ms", substeps=2)
    assert found.replay is None
    assert "no C compiler" in str(found)


@pytest.fixture(scope="module")
def fit() -> po.Fit:
    train = Measurement(TIME, DRIVE, 1e-7 * DRIVE, name="train", allow_saturated=True)
    return po.solve(po.Identification(PiezoGain() + Offset(), train))


def test_fits_and_their_files(fit: po.Fit, tmp_path: Path) -> None:
    """Whatever JSON holds a model is taken, and says the same as the object."""
    file = tmp_path / "fit.json"
    comparison, diagnosis = tmp_path / "comparison.json", tmp_path / "diagnosis.json"
    file.write_text(json.dumps(fit.to_dict()))
    comparison.write_text(json.dumps(po.compare(fit).to_dict()))
    diagnosis.write_text(json.dumps({"schema": "d", "final_model": fit.to_dict()}))
    model = tmp_path / "model.json"
    model.write_text(json.dumps({**fit.model.to_dict(), "values": dict(fit.values)}))
    wanted = export_c(fit, tmp_path / "fit")
    assert wanted.replay is not None
    # The step and the range of the drive are told by the file itself.
    alone = export_c(file, tmp_path / "alone")
    assert alone.replay is not None
    assert alone.replay.stroke == pytest.approx(wanted.replay.stroke, rel=0.01)
    source = (tmp_path / "fit" / "actuator.c").read_text()
    for path in (file, comparison, diagnosis, model):
        assert read_model(path).model == fit.model
        out = tmp_path / path.stem
        export_c(path, out if path != file else tmp_path / "of file", replay=record("other"))
        folder = out if path != file else tmp_path / "of file"
        told = (folder / "actuator.c").read_text()
        assert told.split("#include")[1] == source.split("#include")[1]


@pytest.mark.skipif(shutil.which("cmake") is None, reason="cmake is not installed")
def test_the_build_file_builds(tmp_path: Path) -> None:
    export_c(FOUR, tmp_path / "out", values=VALUES, step="1 ms")
    build = tmp_path / "build"
    for command in (
        ["cmake", "-S", tmp_path / "out", "-B", build], ["cmake", "--build", build]
    ):  # fmt: skip
        subprocess.run(command, check=True, capture_output=True)
    done = subprocess.run(
        [build / "actuator_replay"], input="time,drive\n0,0\n0.001,10\n0.002,\n", text=True,
        capture_output=True, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert done.stdout.splitlines()[0] == "time [s],reading [m]"
    assert len(done.stdout.splitlines()) == 3
    assert "numbers instead of 2" in done.stderr


def test_the_command(fit: po.Fit, tmp_path: Path) -> None:
    file, other, out = tmp_path / "fit.json", tmp_path / "other.csv", tmp_path / "out"
    file.write_text(json.dumps(fit.to_dict()))
    po.write(record("other"), other)
    found = CliRunner().invoke(
        app, ["export", "c", str(file), "--out", str(out), "--float", "--replay", str(other),
              "--sensitivities"]
    )  # fmt: skip
    assert found.exit_code == 0, found.output
    assert "replayed other (300 samples)" in found.stdout
    assert "; derivatives" in found.stdout
    assert "float piezo_gain_d;" in (out / "actuator.h").read_text()
    again = CliRunner().invoke(app, ["export", "c", str(file), "--out", str(out), "--step", "1 ms"])
    assert again.exit_code == 2
    assert again.stdout == ""
    assert again.stderr.strip() == f"{out}: exists already: choose another name, or remove it first"
