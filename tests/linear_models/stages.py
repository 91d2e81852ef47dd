"""Stages with two drives and two axes, computed without the package's own model."""

from __future__ import annotations

import numpy as np

from piezo_opt.measurement import AxesCampaign, AxesRecord

RATE, SAMPLES = 2000.0, 2000
HERTZ = np.array([90.0, 210.0, 420.0])
ZETA = np.array([0.02, 0.01, 0.03])
DELAY = 4e-4
RATE_OF_CREEP = 8.0
SHAPES = 1e-7 * np.array(
    [[[3.0, -1.0], [1.0, 2.0]], [[1.0, 1.5], [-2.0, 0.5]], [[0.7, 0.2], [0.3, -0.9]]]
)
CREEP = 1e-7 * np.array([[0.4, 0.1], [0.05, 0.3]])


def response(
    frequency: np.ndarray, softer: float = 0.0, gain: float = 1.0, lag: float = 0.0
) -> np.ndarray:
    """(K, 2, 2) of the stage; ``softer`` lowers its frequencies; gain and lag [s] of drive 2."""
    s = 2j * np.pi * frequency[:, None, None]
    made = RATE_OF_CREEP / (s + RATE_OF_CREEP) * CREEP
    for hertz, zeta, shape in zip(HERTZ * (1.0 - softer), ZETA, SHAPES, strict=True):
        omega = 2.0 * np.pi * hertz
        made = made + shape * omega**2 / (s**2 + 2.0 * zeta * omega * s + omega**2)
    return made * np.exp(-s * (DELAY + np.array([0.0, lag]))) * np.array([1.0, gain])


def realisation(
    seed: int,
    *,
    amplitude: float = 1.0,
    noise: float = 0.0,
    cube: float = 0.0,
    softer: float = 0.0,
    gain: float = 1.0,
    lag: float = 0.0,
    together: bool = False,
) -> AxesRecord:
    """Two steady periods of a random-phase multisine on every line to 0.9 of half the rate.

    Args:
        seed: of phases and noise.
        amplitude: rms of each drive [V].
        noise: of each reading [m].
        cube: reading + cube reading^3 (in units of 1e-7 m).
        softer, gain, lag: of the stage.
        together: whether both drives are the same.
    """
    chance = np.random.default_rng(seed)
    lines = np.fft.rfftfreq(SAMPLES, 1.0 / RATE)
    used = (lines > 0.0) & (lines < 0.45 * RATE)
    u = np.zeros((lines.size, 2), dtype=np.complex128)
    u[used] = np.exp(2j * np.pi * chance.random((int(used.sum()), 2)))
    if together:
        u[:, 1] = u[:, 0]
    drive = np.fft.irfft(u, n=SAMPLES, axis=0)
    drive *= amplitude / drive.std(axis=0)
    answer = np.einsum("kad,kd->ka", response(lines, softer, gain, lag), np.fft.rfft(drive, axis=0))
    clean = np.fft.irfft(answer, n=SAMPLES, axis=0)
    clean = clean + 1e-7 * cube * (clean / 1e-7) ** 3
    reading = np.tile(clean, (2, 1))
    reading = reading + noise * chance.standard_normal(reading.shape)
    return AxesRecord(np.tile(drive, (2, 1)), reading, RATE, SAMPLES, f"{amplitude:g} V, {seed}")


def campaign(count: int = 4, **of: float) -> AxesCampaign:
    """Realisations with seeds from 1 on."""
    return AxesCampaign(tuple(realisation(k + 1, **of) for k in range(count)))  # type: ignore[arg-type]
