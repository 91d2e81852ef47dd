"""What the made records of the comparison are driven with: time [s] and drive [V]."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def triangles() -> tuple[FloatArray, FloatArray]:
    """Triangles of many heights, 300 samples at 100 Hz."""
    time = np.arange(300) / 100.0
    corners = np.array([0.0, 60.0, -10.0, 40.0, 5.0, 60.0, 20.0, 50.0, 0.0])
    return time, np.interp(time, np.linspace(0.0, time[-1], corners.size), corners)


def chirp() -> tuple[FloatArray, FloatArray]:
    """A slow sine with a chirp from 20 to 350 Hz on top, 400 samples at 2 kHz."""
    time = np.arange(400) / 2000.0
    slow = 30.0 - 30.0 * np.cos(2.0 * np.pi * 10.0 * time)
    return time, slow + 8.0 * np.sin(2.0 * np.pi * (20.0 + 825.0 * time) * time)


def multisine() -> tuple[FloatArray, FloatArray]:
    """A multisine of 5 to 60 Hz, of 25 V rms, 600 samples at 500 Hz."""
    time = np.arange(600) / 500.0
    tones = np.arange(6, 73) / 1.2
    phases = np.random.default_rng(5).uniform(0.0, 2.0 * np.pi, tones.size)
    drive = np.sin(2.0 * np.pi * tones * time[:, None] + phases).sum(axis=1)
    drive = drive * np.minimum(1.0, time / 0.05)  # from rest
    return time, 25.0 * drive / np.sqrt(np.mean(drive**2))


def staircase() -> tuple[FloatArray, FloatArray]:
    """Steps of 0.4 s with ramps of 20 ms, 400 samples at 100 Hz."""
    time = np.arange(400) / 100.0
    levels = np.array([0.0, 50.0, 20.0, 60.0, 10.0, 40.0, 0.0, 60.0, 30.0, 0.0])
    begins = 0.4 * np.arange(levels.size)
    at = np.column_stack([begins, begins + 0.38]).ravel()
    return time, np.interp(time, at, np.repeat(levels, 2))


def slow_and_fast() -> tuple[FloatArray, FloatArray]:
    """A slow sine of growing height with a faster one on top, 400 samples at 1 kHz."""
    time = np.arange(400) / 1000.0
    slow = 30.0 * (time / time[-1]) * (1.0 - np.cos(2.0 * np.pi * 6.0 * time))
    return time, slow + 5.0 * np.sin(2.0 * np.pi * 60.0 * time)
