"""Drives as files and as sketches: what comes out is what was made."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import h5py
import numpy as np
import pytest

from piezo_opt.errors import InputError
from piezo_opt.report.signals import preview
from piezo_opt.signals import Drive, Lines, Output, multisine, square, triangle, write_arduino

BOARD = """
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#define PROGMEM
#define OUTPUT 1
#define HIGH 1
#define LOW 0
static uint32_t now_us = 4294960000u;  // shortly before the clock of 32 bits runs over
static int puts_left = LIMIT;
static inline uint16_t pgm_read_word(const uint16_t *at) { return *at; }
static uint32_t micros() { now_us += 3; return now_us; }
static void pinMode(int, int) {}
static void told(int code) {
  printf("%u %d\\n", now_us, code);
  if (--puts_left == 0) exit(0);
}
static void digitalWrite(int, int level) { told(level); }
static void analogWrite(int, int code) { told(code); }
struct {
  int high = -1;
  void begin() {}
  void setClock(long) {}
  void beginTransmission(int address) { if (address != 0x60) exit(1); }
  void write(int byte) { if (high < 0) high = byte; else { told(high << 8 | byte); high = -1; } }
  void endTransmission() {}
} Wire;
#include "sketch.inc"
int main() { setup(); for (;;) loop(); }
"""


def played(sketch: Path, puts: int) -> tuple[np.ndarray, np.ndarray]:
    """Instants [us] and codes of a sketch, compiled for this machine against a model of a board."""
    if shutil.which("g++") is None:
        pytest.skip("no C++ compiler")
    text = sketch.read_text()
    text = "\n".join(line for line in text.splitlines() if not line.startswith("#include"))
    (sketch.parent / "sketch.inc").write_text(text)
    (sketch.parent / "board.cpp").write_text(BOARD)
    program = sketch.parent / "board"
    subprocess.run(
        ["g++", "-Wall", "-Werror", "-Wno-unused-function", f"-DLIMIT={puts}",
         "-o", str(program), str(sketch.parent / "board.cpp")],
        check=True, capture_output=True,
    )  # fmt: skip
    done = subprocess.run([str(program)], check=True, capture_output=True, text=True, timeout=20)
    table = np.array([line.split() for line in done.stdout.splitlines()], dtype=np.int64)
    return (table[:, 0] - table[0, 0]) % 2**32, table[:, 1]


def test_square_on_a_pin_is_the_thesis_appendix_c(tmp_path: Path) -> None:
    """Half a second low, half a second high, for ever, without drift."""
    write_arduino(square(0.0, 5.0, 1.0, rate=100.0), tmp_path / "square.ino", output=Output.DIGITAL)
    at, level = played(tmp_path / "square.ino", 8)
    np.testing.assert_array_equal(level, [0, 1] * 4)
    np.testing.assert_allclose(at, 500_000 * np.arange(8), atol=10)


def test_samples_on_a_converter(tmp_path: Path) -> None:
    drive = multisine(10.0, 90.0, 1.0, 40.0, 0.5, rate=400.0, seed=4)
    write_arduino(drive, tmp_path / "m.ino", full_scale=(0.0, 100.0))
    at, code = played(tmp_path / "m.ino", 150)
    step = 1e6 / 400.0
    samples = np.round(at / step).astype(int)
    np.testing.assert_allclose(at, step * samples, atol=10)
    np.testing.assert_allclose(100.0 * code / 4095, drive.values[samples % 200], atol=0.013)


def test_pulse_width_and_refusals(tmp_path: Path) -> None:
    ramp = triangle(0.0, 100.0, 1.0, rate=100.0)
    write_arduino(ramp, tmp_path / "t.ino", output=Output.PWM, pin=5, repeat=False)
    _, code = played(tmp_path / "t.ino", 50)
    assert code.max() == 250
    for kwargs, words in (
        ({"output": Output.DIGITAL}, "a digital pin two"),
        ({"full_scale": (0.0, 50.0)}, "widen the scale"),
    ):
        with pytest.raises(InputError, match=words):
            write_arduino(ramp, tmp_path / "x.ino", **kwargs)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="an Uno needs 100"):
        write_arduino(triangle(0.0, 1.0, 1.0, rate=2e4), tmp_path / "x.ino")
    with pytest.raises(InputError, match="do not fit into an Uno's memory"):
        write_arduino(triangle(0.0, 1.0, 0.1, rate=2e3), tmp_path / "x.ino")
    with pytest.raises(InputError, match=r"ends in \.ino"):
        write_arduino(ramp, tmp_path / "x.txt")


def test_files_hold_the_drive(tmp_path: Path) -> None:
    drive = triangle(0.0, 7.0, 3.0, rate=1000.0)
    drive.write(tmp_path / "d.csv")
    read = np.loadtxt(tmp_path / "d.csv", delimiter=",", skiprows=2)
    np.testing.assert_array_equal(read[:, 1], drive.values)
    np.testing.assert_array_equal(read[:, 0], drive.time)
    assert "time [s],voltage [V]" in (tmp_path / "d.csv").read_text()
    drive.write(tmp_path / "d.h5")
    with h5py.File(tmp_path / "d.h5") as file:
        np.testing.assert_array_equal(file["drive"], drive.values)
        assert file["drive"].attrs["units"] == "V"
        assert file.attrs["rate"] == 1000.0
    with pytest.raises(InputError, match="exists already"):
        drive.write(tmp_path / "d.csv")
    with pytest.raises(InputError, match=r"\.csv, \.h5 or"):
        drive.write(tmp_path / "d.txt")


def test_preview_shows_lines_and_those_left_out() -> None:
    drive = multisine(0.0, 50.0, 1.0, 40.0, 1.0, rate=200.0, lines=Lines.ODD_DETECTION, periods=2)
    above, below = preview(drive).axes
    assert above.get_ylabel() == "drive [V]"
    drawn, silent = below.lines
    np.testing.assert_allclose(drawn.get_xdata(), drive.excited)
    np.testing.assert_allclose(silent.get_xdata(), drive.silent)
    plain = preview(Drive("x", "x", triangle(0.0, 1.0, 1.0, rate=100.0).values, 100.0))
    assert len(plain.axes) == 2
