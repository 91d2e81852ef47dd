"""A drive as an Arduino sketch."""

from __future__ import annotations

import os
from enum import Enum
from typing import Final

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.files import replacing
from piezo_opt.signals.drive import Drive

_FLASH: Final = 14_000
"""Samples of two bytes that fit into the 32 KiB of an Uno beside the program."""

_LONGEST: Final = 1e9
"""Microseconds of one hold: half of what a difference of 32 bits can tell."""


class Output(Enum):
    """What the board gives out, and the number of its levels."""

    DIGITAL = "digital"
    """A pin that is low or high: two levels, for square waves."""
    PWM = "pwm"
    """Pulse width on a pin, 8 bits; needs a low-pass filter."""
    MCP4725 = "mcp4725"
    """A converter of 12 bits on the I2C bus."""

    @property
    def levels(self) -> int:
        """Codes from 0 to levels - 1."""
        return {"digital": 2, "pwm": 256, "mcp4725": 4096}[self.value]


def write_arduino(
    drive: Drive,
    path: str | os.PathLike[str],
    *,
    output: Output = Output.MCP4725,
    pin: int = 9,
    full_scale: tuple[float, float] | None = None,
    repeat: bool = True,
    overwrite: bool = False,
) -> None:
    """Write a sketch that plays a drive, sample by sample, on the board's microsecond clock.

    Instants add up from the start, so that periods do not drift by the time that the output takes.

    Args:
        drive: what is played.
        path: file ending in .ino.
        output: what the board gives out.
        pin: of a digital or pulse width output.
        full_scale: drive at code 0 and at the largest one [unit], through amplifier and divider;
            the drive's own range where none is given.
        repeat: play for ever, else once.
        overwrite: replace an existing file.

    Raises:
        InputError: the drive does not fit into the board's memory or the full scale, has more than
            two levels on a digital pin, or is faster than the board.
    """
    if not str(path).endswith(".ino"):
        raise InputError(f"{path}: a sketch ends in .ino")
    codes = _codes(drive, output, full_scale)
    micros = 1e6 / drive.rate
    if micros < 100.0:
        raise InputError(
            f"{drive.name}: {drive.rate:g} Hz leaves {micros:.0f} us a sample; an Uno needs 100: "
            "lower the rate"
        )
    runs, lengths = _runs(codes, max(1, min(65535, int(_LONGEST / micros))))
    if runs.size > _FLASH // 2:
        raise InputError(
            f"{drive.name}: {runs.size} changes do not fit into an Uno's memory, which holds "
            f"{_FLASH // 2}: lower the rate, or play a shorter period and repeat it"
        )
    with replacing(path, overwrite=overwrite) as temporary:
        temporary.write_text(
            _sketch(drive, output, pin, runs, lengths, micros, repeat), encoding="utf-8"
        )


def _codes(
    drive: Drive, output: Output, full_scale: tuple[float, float] | None
) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    low, high = (drive.low, drive.high) if full_scale is None else full_scale
    if not low < high or drive.low < low - 1e-9 or drive.high > high + 1e-9:
        raise InputError(
            f"{drive.name}: goes from {drive.low:g} to {drive.high:g} {drive.unit}, the full scale "
            f"from {low:g} to {high:g}: limit the drive or widen the scale"
        )
    if output is Output.DIGITAL and np.unique(drive.values).size != 2:
        raise InputError(
            f"{drive.name}: has {np.unique(drive.values).size} levels, and a digital pin two: play "
            "a square, or choose pwm or mcp4725"
        )
    share = (drive.values - low) / (high - low)
    return np.round(share * (output.levels - 1)).astype(np.int64)


def _runs(
    codes: np.ndarray[tuple[int], np.dtype[np.int64]], most: int
) -> tuple[np.ndarray[tuple[int], np.dtype[np.int64]], np.ndarray[tuple[int], np.dtype[np.int64]]]:
    """Codes and for how many samples each is held, no longer than ``most``."""
    begins = np.flatnonzero(np.diff(codes, prepend=codes[0] - 1))
    lengths = np.diff(np.append(begins, codes.size))
    pieces: list[int] = []
    held: list[int] = []
    for code, length in zip(codes[begins].tolist(), lengths.tolist(), strict=True):
        while length > 0:
            pieces.append(code)
            held.append(min(length, most))
            length -= held[-1]
    return np.array(pieces, dtype=np.int64), np.array(held, dtype=np.int64)


def _sketch(
    drive: Drive,
    output: Output,
    pin: int,
    runs: np.ndarray[tuple[int], np.dtype[np.int64]],
    lengths: np.ndarray[tuple[int], np.dtype[np.int64]],
    micros: float,
    repeat: bool,
) -> str:
    begin, put = {
        Output.DIGITAL: (
            f"pinMode({pin}, OUTPUT);", f"digitalWrite({pin}, code ? HIGH : LOW);"
        ),
        Output.PWM: (f"pinMode({pin}, OUTPUT);", f"analogWrite({pin}, code);"),
        Output.MCP4725: (
            "Wire.begin();\n  Wire.setClock(400000);",
            "Wire.beginTransmission(0x60);\n  Wire.write(code >> 8);\n"
            "  Wire.write(code & 0xFF);\n  Wire.endTransmission();",
        ),
    }[output]  # fmt: skip
    wire = "#include <Wire.h>\n" if output is Output.MCP4725 else ""
    # Whole nanoseconds, added up in 64 bits, do not drift within days.
    step = round(1e3 * micros)
    return f"""// {drive.description}
// {drive.values.size} samples at {drive.rate:g} Hz, code 0 to {output.levels - 1}.
#include <avr/pgmspace.h>
{wire}
const uint16_t CODES[] PROGMEM = {{{_listed(runs)}}};
const uint16_t HELD[] PROGMEM = {{{_listed(lengths)}}};
const uint16_t COUNT = {runs.size};
const uint64_t STEP_NS = {step}ULL;

uint32_t begun;
uint64_t due_ns = 0;

void put(uint16_t code) {{
  {put}
}}

void setup() {{
  {begin}
  begun = micros();
}}

void loop() {{
  for (uint16_t k = 0; k < COUNT; k++) {{
    put(pgm_read_word(&CODES[k]));
    due_ns += STEP_NS * pgm_read_word(&HELD[k]);
    // The clock of 32 bits runs over every 71 minutes; differences do not.
    while ((int32_t)((uint32_t)(due_ns / 1000) - (micros() - begun)) > 0) {{
    }}
  }}
{"" if repeat else "  while (true) {" + chr(10) + "  }" + chr(10)}}}
"""


def _listed(numbers: np.ndarray[tuple[int], np.dtype[np.int64]]) -> str:
    rows = [", ".join(map(str, numbers[k : k + 16].tolist())) for k in range(0, numbers.size, 16)]
    return "\n  " + ",\n  ".join(rows) + "\n"
