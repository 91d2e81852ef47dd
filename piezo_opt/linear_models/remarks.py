"""What to doubt about a fitted transfer function."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from piezo_opt.units import show

if TYPE_CHECKING:
    from piezo_opt.linear_models.transfer import TransferFit


def remarks(fit: TransferFit) -> tuple[str, ...]:
    """Sentences on poles that the sampling or the length cannot show, and on what is left over."""
    return (*_fast(fit), *_slow(fit), *_unstable(fit), *_weak(fit), *_coloured(fit), *_stopped(fit))


def beyond_sampling(fit: TransferFit) -> tuple[complex, ...]:
    """Poles faster than half the sampling rate, one of each pair [1/s]."""
    half = np.pi / min(one.step for one in fit.question.records.records)
    return tuple(complex(x) for x in fit.poles if abs(x) > half and x.imag >= 0.0)


def _fast(fit: TransferFit) -> list[str]:
    step = min(one.step for one in fit.question.records.records)
    found = beyond_sampling(fit)
    if not found:
        return []
    rates = " and ".join(show(abs(x) / (2.0 * np.pi), "Hz") for x in found)
    plural = len(found) > 1
    return [
        f"{'Poles' if plural else 'A pole'} at {rates} {'lie' if plural else 'lies'} above half "
        f"the sampling rate ({show(0.5 / step, 'Hz')}): at {show(1.0 / step, 'Hz')} nothing there "
        "is identifiable, and other poles fit as well. Sample faster."
    ]


def _slow(fit: TransferFit) -> list[str]:
    longest = max(one.duration for one in fit.question.records.records)
    slow = [x for x in fit.poles if abs(x) < 1.0 / longest]
    if not slow:
        return []
    return [
        f"A pole of {show(1.0 / max(abs(slow[0]), 1e-300), 's')} is slower than the record of "
        f"{show(longest, 's')} is long: it stands for a drift, and the gain at rest with it."
    ]


def _unstable(fit: TransferFit) -> list[str]:
    if bool(np.all(fit.poles.real < 0.0)):
        return []
    return ["The model is unstable; ask with stable=True for one that is not."]


def _weak(fit: TransferFit) -> list[str]:
    wide = [
        x
        for x, sigma in zip(fit.poles, fit.pole_sigma, strict=True)
        if float(np.hypot(*sigma)) > 0.5 * abs(x) and x.imag >= 0.0
    ]
    if not wide:
        return []
    rates = " and ".join(show(abs(x) / (2.0 * np.pi), "Hz") for x in wide)
    return [
        f"The record does not determine the pole{'s' if len(wide) > 1 else ''} at {rates}: the "
        "interval is as wide as the value. Ask for fewer poles, or record more."
    ]


def _coloured(fit: TransferFit) -> list[str]:
    if all(one.white or not one.conclusive for one in fit.whiteness):
        return []
    return [
        "What is left over is not white, and the intervals are those of a white error: they are "
        "too narrow. More poles, or an effect that is not linear."
    ]


def _stopped(fit: TransferFit) -> list[str]:
    return [] if fit.poles_found.converged else ["The fit had not settled when it was stopped."]
