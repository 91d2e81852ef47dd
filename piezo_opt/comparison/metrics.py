"""How big the error is, in the measures of the field."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import final

import numpy as np

from piezo_opt.comparison.misfit import Misfit
from piezo_opt.measurement import FloatArray, Measurement

__all__ = [
    "Metrics",
    "aic",
    "bic",
    "fit_percent",
    "fpe",
    "iae",
    "largest",
    "measure",
    "mse",
    "rms",
    "uncontrolled_iae",
]


def fit_percent(measured: FloatArray, error: FloatArray) -> float:
    """``100 (1 - |e| / |y - mean y|)`` [%]: 100 is exact, 0 is no better than the mean.

    NaN for a reading that does not move.

    Args:
        measured: (N,) reading y [m].
        error: (N,) measured minus modelled e [m].

    Source: Ljung (1999), System Identification, 2nd ed., sec. 16.4 (normalised rms error).
    """
    spread = float(np.linalg.norm(measured - measured.mean()))
    if spread == 0.0:
        return float("nan")
    return 100.0 * (1.0 - float(np.linalg.norm(error)) / spread)


def mse(error: FloatArray) -> float:
    """``sum e^2 / N`` [m^2] of an error (N,) [m]."""
    return float(np.mean(error**2))


def rms(error: FloatArray) -> float:
    """``sqrt(sum e^2 / N)`` [m] of an error (N,) [m]."""
    return float(np.sqrt(np.mean(error**2)))


def largest(error: FloatArray) -> float:
    """``max |e|`` [m] of an error (N,) [m]."""
    return float(np.max(np.abs(error)))


def iae(time: FloatArray, error: FloatArray) -> float:
    """Integral of the absolute error, ``int |e| dt`` [m s], by the trapezoidal rule.

    Args:
        time: (N,) instants [s]; the steps may differ.
        error: (N,) error [m].

    Source: Graham & Lathrop (1953), Trans. AIEE 72, 273-288 (integral criteria).
    """
    size = np.abs(error)
    return float(np.dot(0.5 * (size[1:] + size[:-1]), np.diff(time)))


def fpe(error: FloatArray, unknowns: int) -> float:
    """Final prediction error, ``V (1 + d/N) / (1 - d/N)`` with ``V = sum e^2 / N`` [m^2].

    What the mean squared error would be on fresh data of the same kind; infinite when there are
    no more samples than unknowns.

    Args:
        error: (N,) error on the data fitted to [m].
        unknowns: number d of fitted unknowns.

    Source: Akaike (1969), Ann. Inst. Stat. Math. 21, 243-247; Ljung (1999), eq. 16.55.
    """
    share = unknowns / error.size
    return mse(error) * (1.0 + share) / (1.0 - share) if share < 1.0 else float("inf")


def aic(error: FloatArray, unknowns: int) -> float:
    """Akaike's criterion of a Gaussian error, ``N (ln(2 pi V) + 1) + 2 d``; smaller is better.

    Only differences between models on the same samples mean something. ``V`` in m^2.

    Args:
        error: (N,) error on the data fitted to [m].
        unknowns: number d of fitted unknowns.

    Source: Akaike (1974), IEEE Trans. Autom. Control 19, 716-723.
    """
    return _deviance(error) + 2.0 * unknowns


def bic(error: FloatArray, unknowns: int) -> float:
    """Bayesian criterion of a Gaussian error, ``N (ln(2 pi V) + 1) + d ln N``; smaller is better.

    Only differences between models on the same samples mean something. ``V`` in m^2.

    Args:
        error: (N,) error on the data fitted to [m].
        unknowns: number d of fitted unknowns.

    Source: Schwarz (1978), Ann. Stat. 6, 461-464.
    """
    return _deviance(error) + unknowns * float(np.log(error.size))


def _deviance(error: FloatArray) -> float:
    variance = mse(error)
    if variance == 0.0:
        return -float("inf")
    return error.size * (float(np.log(2.0 * np.pi * variance)) + 1.0)


def uncontrolled_iae(record: Measurement) -> float:
    """Area between the reading and the straight line through the loop's tip [m s].

        int |y - y0 - (v - v0) (y_tip - y0) / (v_tip - v0)| dt

    with (v0, y0) the first sample and the tip the sample of the largest |v - v0|. What
    hysteresis and creep alone cost a user who relies on a constant gain; a controller is
    measured against it.
    """
    drive = record.drive - record.drive[0]
    reading = record.position - record.position[0]
    tip = int(np.argmax(np.abs(drive)))
    straight = drive * (reading[tip] / drive[tip])
    return iae(record.time[record.counted], (reading - straight)[record.counted])


@final
@dataclass(frozen=True)
class Metrics:
    """The error of one model on one or several records, SI units.

    Attributes:
        samples: number N of counted samples.
        unknowns: number d of fitted unknowns.
        fit_percent: [%].
        rms, largest: [m].
        mse: [m^2].
        iae: [m s].
        fpe: [m^2]; with ``aic`` and ``bic`` None on held-out data, where nothing was fitted and
            the error itself is the answer.
    """

    samples: int
    unknowns: int
    fit_percent: float
    rms: float
    mse: float
    iae: float
    largest: float
    fpe: float | None
    aic: float | None
    bic: float | None

    def to_dict(self) -> dict[str, int | float | None]:
        """Plain data, SI units; numbers that are not finite are None."""
        return {
            name: value if value is None or np.isfinite(value) else None
            for name, value in asdict(self).items()
        }


def measure(misfits: Sequence[Misfit], unknowns: int, *, held_out: bool) -> Metrics:
    """All measures over the counted samples of one or several records together.

    The fit in percent takes each record's own mean; the integral adds up over the records.
    """
    error = np.concatenate([one.error for one in misfits])
    moved = np.concatenate([one.measured - one.measured.mean() for one in misfits])
    spread = float(np.linalg.norm(moved))
    percent = 100.0 * (1.0 - float(np.linalg.norm(error)) / spread) if spread else float("nan")
    return Metrics(
        samples=error.size,
        unknowns=unknowns,
        fit_percent=percent,
        rms=rms(error),
        mse=mse(error),
        iae=sum(iae(one.time, one.error) for one in misfits),
        largest=largest(error),
        fpe=None if held_out else fpe(error, unknowns),
        aic=None if held_out else aic(error, unknowns),
        bic=None if held_out else bic(error, unknowns),
    )
