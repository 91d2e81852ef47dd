"""Linear plants with known poles and zeros, simulated by python-control alone."""

from __future__ import annotations

import control
import numpy as np

from piezo_opt.measurement import Between, Measurement

STEP = 2e-3


def second_order(hertz: float = 20.0, damping: float = 0.1) -> control.TransferFunction:
    """A resonance of 80 nm/V with a zero at -100 1/s."""
    omega = 2.0 * np.pi * hertz
    return control.tf([0.8e-9 * omega**2, 80e-9 * omega**2], [1.0, 2.0 * damping * omega, omega**2])


def third_order() -> control.TransferFunction:
    """A resonance behind a lag, with one zero."""
    below = np.polymul([1.0, 2.0 * 0.03 * 250.0, 250.0**2], [1.0, 90.0])
    return control.tf([2e-7 * 250.0**2 * 0.3, 2e-7 * 250.0**2 * 90.0], below)


def steps(seed: int, samples: int, hold: int = 10) -> np.ndarray:
    """A random binary drive of 0 and 50 V."""
    chance = np.random.default_rng(seed)
    return np.repeat(50.0 * chance.integers(0, 2, samples // hold + 1), hold)[:samples]


def held(
    system: control.TransferFunction, drive: np.ndarray, noise: float = 0.0, seed: int = 0
) -> Measurement:
    """Under a held drive, sampled exactly; an offset of 3 um."""
    time = STEP * np.arange(drive.size)
    exact = control.c2d(control.ss(system), STEP, "zoh")
    reading = np.asarray(control.forced_response(exact, time, drive).outputs).ravel()
    reading = reading + 3e-6 + noise * np.random.default_rng(seed + 1).standard_normal(drive.size)
    return Measurement(time=time, drive=drive, position=reading, between=Between.HELD)


def straight(system: control.TransferFunction, time: np.ndarray, drive: np.ndarray) -> Measurement:
    """Under a drive that is straight between uneven samples: on a grid 40 times as fine."""
    fine = np.linspace(time[0], time[-1], 40 * time.size)
    merged = np.unique(np.concatenate([fine, time]))
    state = control.ss(system)
    a, b, c = (np.asarray(m) for m in (state.A, state.B, state.C))
    n = a.shape[0]
    x, reading = np.zeros(n), {merged[0]: float((c @ np.zeros(n))[0])}
    voltage = np.interp(merged, time, drive)
    from scipy.linalg import expm

    for k in range(merged.size - 1):
        h = merged[k + 1] - merged[k]
        block = np.zeros((n + 2, n + 2))
        block[:n, :n], block[:n, n], block[n, n + 1] = a * h, b[:, 0] * h, 1.0
        move = expm(block)
        x = move[:n, :n] @ x + move[:n, n] * voltage[k]
        x = x + move[:n, n + 1] * (voltage[k + 1] - voltage[k])
        reading[merged[k + 1]] = float((c @ x)[0])
    return Measurement(time=time, drive=drive, position=np.array([reading[t] for t in time]))
