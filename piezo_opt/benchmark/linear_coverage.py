"""Do the 95 % intervals of a black-box fit hold the truth?

A resonance of 20 Hz with a zero is driven by a held random binary signal and read with
white noise, 200 times with other seeds. Each time poles, zero and gain at rest get intervals.
Each interval should hold the truth in 90 to 99 % of the seeds.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from piezo_opt.linear_models import fit_transfer
from piezo_opt.linear_models.transfer import half_width
from piezo_opt.measurement import Between, Measurement

SEEDS, SAMPLES, STEP, NOISE = 200, 300, 2e-3, 1e-7
OMEGA = 2.0 * np.pi * 20.0
NAMES = ("pole, real part", "pole, imaginary part", "zero", "gain at rest")


def plant() -> Any:
    """The transfer function."""
    import control

    return control.tf([0.8e-9 * OMEGA**2, 80e-9 * OMEGA**2], [1.0, 0.2 * OMEGA, OMEGA**2])


def record(seed: int) -> Measurement:
    """One record."""
    import control

    chance = np.random.default_rng(seed)
    drive = np.repeat(50.0 * chance.integers(0, 2, SAMPLES // 10), 10)
    time = np.asarray(STEP * np.arange(SAMPLES), dtype=np.float64)
    exact = control.c2d(control.ss(plant()), STEP, "zoh")
    reading = np.asarray(control.forced_response(exact, time, drive).outputs).ravel()
    reading = reading + NOISE * chance.standard_normal(SAMPLES)
    return Measurement(time=time, drive=drive, position=reading, between=Between.HELD)


def inside(seed: int) -> list[bool]:
    """Whether each interval holds the truth."""
    fit = fit_transfer(record(seed), 2, 1)
    system, wide = plant(), half_width(fit)
    pole = next(p for p in system.poles() if p.imag > 0.0)
    k = int(np.argmax(fit.poles.imag))
    return [
        bool(abs(fit.poles[k].real - pole.real) < wide * fit.pole_sigma[k, 0]),
        bool(abs(fit.poles[k].imag - pole.imag) < wide * fit.pole_sigma[k, 1]),
        bool(abs(fit.zeros[0].real - system.zeros()[0].real) < wide * fit.zero_sigma[0, 0]),
        bool(abs(fit.dc_gain - float(system.dcgain())) < wide * fit.dc_gain_sigma),
    ]


def linear_coverage(seeds: int = SEEDS) -> dict[str, float]:
    """Share of seeds whose interval holds the truth, by what it is an interval of."""
    shares = np.mean([inside(seed) for seed in range(seeds)], axis=0)
    return dict(zip(NAMES, shares.tolist(), strict=True))
