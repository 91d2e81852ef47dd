"""What repeats: the periods of a steady state, and a drive that plays the same again."""

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


SAME = 2.0**-10
"""Change of a drive from one period to the next, over its own size, below which it is the same: the
step of a converter of ten bits."""


def repetition(drive: FloatArray) -> int | None:
    """After how many samples an evenly sampled drive (N,) plays the same again; None if never.

    The shortest lag P, at most N / 2, with

        mean_n (u_(n+P) - u_n)^2 <= SAME^2 var(u)

    beyond the first lag at which that mean is var(u): from sample to sample every slow drive is
    nearly the same. The means of all lags are found at once, from the autocorrelation.
    """
    n = drive.size
    u = drive - drive.mean()
    power = float(u @ u) / n
    if power <= 0.0:
        return None
    spectrum = np.fft.rfft(u, 2 * n)
    products = np.fft.irfft(np.abs(spectrum) ** 2, 2 * n)[: n // 2 + 1]
    squares = np.concatenate([[0.0], np.cumsum(u**2)])
    lags = np.arange(n // 2 + 1)
    change = (squares[n - lags] + squares[n] - squares[lags] - 2.0 * products) / (n - lags)
    apart = np.flatnonzero(change > power)
    if apart.size == 0:
        return None
    again = np.flatnonzero(change[apart[0] :] <= SAME**2 * power)
    if again.size == 0:
        return None
    # The first lag below the bound lies before the one that fits best.
    first = int(apart[0] + again[0])
    while first + 1 < change.size and change[first + 1] < change[first]:
        first += 1
    return first


def noise_between(record: str, repeated: FloatArray) -> float:
    """Noise, rms in the unit of the signal, from what differs between P periods of K samples.

    sqrt(sum_pk (y_pk - mean_p y_pk)^2 / ((P - 1) K))

    Raises:
        InputError: there is one period only.
    """
    if repeated.shape[0] < 2:
        raise InputError(f"{record}: one period says nothing about noise: record at least two")
    return float(np.sqrt(np.mean(np.var(repeated, axis=0, ddof=1))))
