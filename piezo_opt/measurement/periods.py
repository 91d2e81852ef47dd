"""A steady state that repeats: its whole periods, and what differs from one to the next."""

from __future__ import annotations

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.measurement.arrays import FloatArray
from piezo_opt.measurement.clock import Clock
from piezo_opt.units import show


def whole_periods(clock: Clock, startup: float, period: float) -> int:
    """How many periods [s] the samples after the start-up [s] cover."""
    first = int(np.argmax(clock.after(startup)))
    covered = float(clock.time[-1] - clock.time[first]) + clock.step
    return int(np.floor(covered / period + 1e-6))


def by_period(
    record: str, clock: Clock, values: FloatArray, *, startup: float, period: float | None
) -> FloatArray:
    """(periods, samples a period) of a signal (N,) after the start-up [s].

    Raises:
        InputError: there is no period, no even sampling, or no whole period is left.
    """
    if period is None:
        raise InputError(f"{record}: has no period: give one with with_(period=...)")
    if not clock.uniform:
        raise InputError(f"{record}: periods need even sampling: resample it first")
    samples = round(period / clock.step)
    first = int(np.argmax(clock.after(startup)))
    whole = (len(clock) - first) // samples
    if whole == 0:
        raise InputError(
            f"{record}: no whole period of {show(period, 's')} is left after the "
            f"start-up of {show(startup, 's')}: shorten the start-up"
        )
    return values[first : first + whole * samples].reshape(whole, samples)


def noise_between(record: str, repeated: FloatArray) -> float:
    """Noise, rms in the unit of the signal, from what differs between P periods of K samples.

    sqrt(sum_pk (y_pk - mean_p y_pk)^2 / ((P - 1) K))

    Raises:
        InputError: there is one period only.
    """
    if repeated.shape[0] < 2:
        raise InputError(f"{record}: one period says nothing about noise: record at least two")
    return float(np.sqrt(np.mean(np.var(repeated, axis=0, ddof=1))))
