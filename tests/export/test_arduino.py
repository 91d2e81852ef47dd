"""Sketches: built with the Arduino core, run on a simulated Uno, and what they say there."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path
from threading import Timer

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

import piezo_opt as po
from piezo_opt.cli import app
from piezo_opt.control import InverseCompensation
from piezo_opt.control.feedforward import InverseState
from piezo_opt.effects import BoucWen, Creep, PiezoGain
from piezo_opt.errors import InputError, ModelError
from piezo_opt.export import export_arduino
from piezo_opt.export.c.printer import DOUBLE
from piezo_opt.export.laws import inverse_compensation
from tests.export.tools import DIAGNOSTICS, STRICT, compiler

CORE = Path("/usr/share/arduino/hardware/arduino/avr")
FLAGS = [
    "-Os", "-w", "-ffunction-sections", "-fdata-sections", "-mmcu=atmega328p", "-DARDUINO=10819",
    "-DF_CPU=16000000L", "-DARDUINO_AVR_UNO", "-DARDUINO_ARCH_AVR", "-DDECIMAL_DIG=9",
    f"-I{CORE}/cores/arduino", f"-I{CORE}/variants/standard",
]  # fmt: skip
CPP = ["-std=gnu++11", "-fpermissive", "-fno-exceptions", "-fno-threadsafe-statics"]
MODEL = PiezoGain() + BoucWen()
VALUES = {
    "piezo_gain.d": 0.2057e-6,
    "bouc_wen.alpha": 0.0805e-6,
    "bouc_wen.beta": 0.00384,
    "bouc_wen.gamma": -0.00535,
}


@pytest.fixture(scope="module")
def core(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """The objects of Arduino's own library for an Uno."""
    for tool in ("avr-gcc", "simavr"):
        compiler(tool)
    if not CORE.is_dir():
        pytest.skip("arduino-core-avr is not installed")
    folder = tmp_path_factory.mktemp("core")
    here = CORE / "cores" / "arduino"
    plain = [str(f) for end in ("*.c", "*.S") for f in here.glob(end)]
    subprocess.run(["avr-gcc", "-c", *FLAGS, "-std=gnu11", *plain], cwd=folder, check=True)
    sources = [str(f) for f in here.glob("*.cpp")]
    subprocess.run(["avr-g++", "-c", *FLAGS, *CPP, *sources], cwd=folder, check=True)
    return [str(f) for f in folder.glob("*.o")]


def rows(sketch: Path, core: list[str], count: int) -> NDArray[np.float64]:
    """The first rows that an Uno says: time [ms], signal, drive [V], reading [nm]."""
    text = (sketch / f"{sketch.name}.ino").read_text()
    (sketch / "sketch.cpp").write_text(f"#include <Arduino.h>\n{text}")
    strict = [flag for flag in FLAGS if flag != "-w"]
    subprocess.run(
        ["avr-g++", "-c", *strict, "-Wall", "-Wextra", "-Werror", *CPP, "sketch.cpp"],
        cwd=sketch, check=True,
    )  # fmt: skip
    code = [f.name for f in sketch.glob("*.c")]
    subprocess.run(
        ["avr-gcc", "-c", *strict, "-Wall", "-Werror", "-std=gnu11", *code], cwd=sketch, check=True
    )
    objects = [str(f) for f in sketch.glob("*.o")]
    subprocess.run(
        ["avr-gcc", *FLAGS, "-Wl,--gc-sections", *objects, *core, "-lm", "-o", "sketch.elf"],
        cwd=sketch, check=True,
    )  # fmt: skip
    running = subprocess.Popen(
        ["simavr", "-m", "atmega328p", "-f", "16000000", "sketch.elf"],
        cwd=sketch, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    # A sketch runs for ever: it is stopped when it has said what it is asked for.
    watch = Timer(60.0, running.kill)
    watch.start()
    said: list[str] = []
    assert running.stdout is not None
    for line in running.stdout:
        said.append(line)
        if len(said) == count:
            break
    watch.cancel()
    running.kill()
    running.wait()
    running.stdout.close()
    told = re.sub(r"\x1b\[[0-9;]*m", "", "".join(said))
    found = re.findall(r"^(\d+),(-?[\d.]+),(-?[\d.]+),(-?\d+\.\d)\.\.", told, re.MULTILINE)
    return np.array(found, dtype=float)


def test_a_triangle_on_an_uno(core: list[str], tmp_path: Path) -> None:
    sketch = tmp_path / "triangle"
    export_arduino(MODEL, sketch, values=VALUES, period="0.4 s", step="10 ms", periods=2)
    said = rows(sketch, core, 81)
    assert said.shape == (81, 4)
    np.testing.assert_array_equal(said[:, 0], 10.0 * np.arange(81))
    wanted = 125.0 * (1.0 - np.abs(2.0 * np.mod(said[:, 0] / 400.0, 1.0) - 1.0))
    np.testing.assert_allclose(said[:, 1], wanted, atol=1e-3)
    np.testing.assert_array_equal(said[:, 2], said[:, 1])
    played = po.Measurement(1e-3 * said[:, 0], wanted, 1e-7 * wanted, allow_saturated=True)
    reading = po.simulate(MODEL, played, VALUES, tolerance=1e-7).reading
    assert np.abs(1e-9 * said[:, 3] - reading).max() < 1e-5 * np.ptp(reading)


def test_a_position_is_followed_without_a_sensor(core: list[str], tmp_path: Path) -> None:
    sketch = tmp_path / "follow"
    export_arduino(
        MODEL, sketch, values=VALUES, inverse=True, high="15 um", period="1 s", step="20 ms",
        periods=1,
    )  # fmt: skip
    said = rows(sketch, core, 51)
    assert said.shape == (51, 4)
    law = InverseCompensation.of_values(MODEL, VALUES)
    state = law.begin()
    for _, wanted, drive, reading in said:
        expected, state = law.act(state, 1e-9 * wanted, 0.0, 0.02, 0.0, 150.0)
        assert drive == pytest.approx(expected, abs=2e-3)
        # A pin does not go below 0 V, where the loop has not come back yet.
        if drive > 0.0 or wanted == reading == 0.0:
            assert reading == pytest.approx(wanted, abs=2.0)
        else:
            assert 3000.0 < reading < 3250.0
    assert said[:, 2].max() == pytest.approx(128.3, abs=0.1)


def test_a_square_wave(tmp_path: Path) -> None:
    sketch = tmp_path / "square"
    found = export_arduino(
        MODEL, sketch, values=VALUES, signal="square", low="63 mV", high="63.05 V", period="1 s"
    )
    assert found.sentence == "a square of 63 mV to 63.05 V in 1 s as the drive"
    text = (sketch / "square.ino").read_text()
    assert "PERIOD_MS = 1000;" in text
    assert "phase < 0.5f ? LOW_END : HIGH_END" in text
    assert "inverse" not in text


@pytest.mark.parametrize("command", DIAGNOSTICS, ids=lambda command: command[0])
def test_the_law_in_double(command: list[str], tmp_path: Path) -> None:
    """Up, down, below zero and up again: the drive solves the equation to rounding."""
    compiler(command[0])
    law = InverseCompensation.of_values(MODEL, VALUES)
    header, source = inverse_compensation(law, "law", DOUBLE)
    (tmp_path / "law.h").write_text(header)
    (tmp_path / "law.c").write_text(source)
    (tmp_path / "main.c").write_text(
        '#include "law.h"\n#include <stdio.h>\nint main(void)\n{ law c; double r; law_init(&c);\n'
        '  while (scanf("%lf", &r) == 1) printf("%.17g\\n", law_act(&c, r, -20.0, 130.0));\n'
        "  return 0; }\n"
    )
    subprocess.run(
        [*command, *STRICT, "law.c", "main.c", "-lm", "-o", "law"], cwd=tmp_path, check=True
    )
    wanted = np.interp(np.arange(400), [0, 80, 200, 300, 399], [0.0, 16e-6, -4e-6, 9e-6, 0.0])
    done = subprocess.run(
        [tmp_path / "law"], input="\n".join(map(repr, wanted.tolist())), text=True,
        capture_output=True, check=True,
    )  # fmt: skip
    drives = np.array(done.stdout.split(), dtype=float)
    assert drives.min() == -20.0
    assert drives.max() == 130.0
    state = law.begin()
    for r, drive in zip(wanted.tolist(), drives.tolist(), strict=True):
        state = InverseState(drive, law.loop_at(state, drive))
        if -20.0 < drive < 130.0:  # the equation holds, by the library's own loop
            assert abs(r + state.loop - law.gain * drive) < 1e-19
    # Where the library's fixed point has converged, its drives are these.
    state, expected = law.begin(), []
    for r in wanted.tolist():
        drive, state = law.act(state, r, 0.0, 1.0, -20.0, 130.0)
        expected.append(drive)
    assert np.median(np.abs(drives - expected)) < 1e-12
    np.testing.assert_allclose(drives, expected, atol=5e-3)


def test_what_is_refused(tmp_path: Path) -> None:
    for options, words in (
        ({"signal": "sine"}, "there are triangle, square"),
        ({"step": "0.3 ms"}, "whole milliseconds"),
        ({"step": "40 s"}, "two samples a period"),
        ({"low": "130 V"}, "the lower end comes first"),
        ({"high": "151 V"}, "above full_scale"),
        ({"pin": -1}, "numbers from 0 on"),
        ({"inverse": True}, "'125 V' is not a quantity in m|cannot be converted|125 V"),
    ):
        with pytest.raises(InputError, match=words):
            export_arduino(MODEL, tmp_path / "out", values=VALUES, **{"high": "125 V", **options})
    with pytest.raises(InputError, match="no name in C"):
        export_arduino(MODEL, tmp_path / "my sketch", values=VALUES)
    with pytest.raises(ModelError, match="piezo_gain and bouc_wen"):
        export_arduino(PiezoGain() + Creep(), tmp_path / "out", inverse=True, high="15 um")
    assert list(tmp_path.iterdir()) == []


def test_the_command(tmp_path: Path) -> None:
    file = tmp_path / "model.toml"
    values = "\n".join(f'"{name}" = {value}' for name, value in VALUES.items())
    file.write_text(f'effects = ["piezo_gain", "bouc_wen"]\n[values]\n{values}\n')
    out = tmp_path / "follow"
    found = CliRunner().invoke(
        app, ["export", "arduino", str(file), "--out", str(out), "--inverse"]
    )
    assert found.exit_code == 0, found.output
    assert "a triangle of 0 m to 15 um in 50 s as the position" in found.stdout
    assert {f.name for f in out.iterdir()} >= {"follow.ino", "inverse.c", "actuator.c"}
