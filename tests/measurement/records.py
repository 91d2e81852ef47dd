"""Small records that the tests of a record spoil, cut and resample."""

from __future__ import annotations

from typing import Any

import numpy as np

from piezo_opt.measurement import Measurement


def sine(count: int = 400, rate: float = 100.0, **changes: Any) -> Measurement:
    """Sine of 1 Hz, 100 samples a period, gain 2e-7 m/V with a lag of 0.1 rad."""
    time = np.arange(count) / rate
    fields: dict[str, Any] = {
        "time": time,
        "drive": 50 * np.sin(2 * np.pi * time),
        "position": 1e-5 * np.sin(2 * np.pi * time - 0.1),
    }
    return Measurement(**(fields | changes))


def triangle(count: int = 201, **changes: Any) -> Measurement:
    time = np.linspace(0.0, 10.0, count)
    drive = 100 * (1 - np.abs(time / 5 - 1))
    fields: dict[str, Any] = {"time": time, "drive": drive, "position": 1e-7 * drive + 1e-6 * time}
    return Measurement(**(fields | changes))


def spoiled(values: np.ndarray, index: int, value: float) -> np.ndarray:
    copy = np.array(values)
    copy[index] = value
    return copy


GOOD = sine()
