"""One record in the forms in which instruments and programs write it.

A plain hysteretic actuator that shares nothing with the package: a chain of plays, 1000 samples
at 1 kHz.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from piezo_opt.measurement import Measurement
from piezo_opt.units import quantity

N = 1000
STEP = 1e-3
T = STEP * np.arange(N)
U = np.round(50 + 30 * np.sin(2 * np.pi * 4.2 * T) + 15 * np.sin(2 * np.pi * 10.6 * T), 6)


def _position() -> np.ndarray:
    """[um]"""
    plays = np.linspace(1.0, 12.0, 6)
    state = np.zeros(6)
    y = np.empty(N)
    for k, u in enumerate(U):
        state = np.clip(state, u - plays, u + plays)
        y[k] = 0.2 * u + 0.02 * np.sum(u - state)
    return np.round(y, 7)


Y = _position()
HEADER = "time [s],voltage [V],displacement [um]"


def rows(separator: str = ",", decimal: str = ".", tail: str = "") -> str:
    """The rows, every number with all its digits."""
    return "".join(
        separator.join(f"{v:.9g}".replace(".", decimal) for v in row) + tail + "\n"
        for row in zip(T, U, Y, strict=True)
    )


def put(folder: Path, name: str, text: str, encoding: str = "utf-8") -> Path:
    """A file with this text; line ends are written as they are."""
    file = folder / name
    file.write_bytes(text.encode(encoding))
    return file


def check(record: Measurement, *, start: float = 0.0, atol: float = 1e-12) -> None:
    """The record holds the right numbers in SI units."""
    np.testing.assert_allclose(record.time, T + start, atol=1e-9)
    np.testing.assert_allclose(record.drive, U, rtol=1e-8)
    np.testing.assert_allclose(record.position, Y * quantity("1 um", "m"), rtol=1e-8, atol=atol)
    assert (record.drive_unit, record.position_unit) == ("V", "m")
