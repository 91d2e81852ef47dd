"""Actuators that the record allows: draws from a fit's covariance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from piezo_opt.control.identified import Identified, Source, identified
from piezo_opt.errors import InputError
from piezo_opt.values import Values

FloatArray = NDArray[np.float64]

MOST_TRIES = 100
"""Draws for each that is kept, before it is said that hardly any lies within the bounds."""


def scenarios(fit: Source, number: int, seed: int = 0) -> tuple[Values, ...]:
    """Values drawn from the normal distribution of a fit's estimates.

        theta ~ N(theta^, C),  within the bounds of the parameters

    What ended at a bound has no covariance and stays there. What belongs to the record and not to
    the actuator, its offset and initial states, is drawn along and does no harm.

    Args:
        fit: estimates with their covariance, or the JSON of a fit.
        number: how many.
        seed: of the draws.

    Raises:
        InputError: no draws asked for, no covariance, or one so wide that hardly any draw lies
            within bounds.
    """
    if number < 1:
        raise InputError(f"scenarios = {number}: give at least one")
    what = identified(fit)
    if what.covariance is None:
        raise InputError(
            "scenarios are drawn from a fit's covariance, and a model alone has none: give the "
            "fit, or its JSON"
        )
    known = np.isfinite(np.diag(what.covariance))
    names = [n for n, use in zip(what.names, known, strict=True) if use]
    mean = np.array([what.values[n] for n in names])
    spread = what.covariance[np.ix_(known, known)]
    size = np.sqrt(np.diag(spread))
    # In units of each deviation, so that metres and rad/s do not meet in one decomposition.
    unit = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(spread / np.outer(unit, unit))
    root = vectors * np.sqrt(np.clip(values, 0.0, None))
    low, high = _bounds(what, names)
    generator = np.random.default_rng(seed)
    kept: list[Values] = []
    for _ in range(MOST_TRIES * number):
        theta = mean + unit * (root @ generator.normal(size=len(names)))
        if ((theta >= low) & (theta <= high)).all():
            kept.append(what.values.with_(dict(zip(names, theta.tolist(), strict=True))))
            if len(kept) == number:
                return tuple(kept)
    raise InputError(
        "Hardly any draw from the fit's covariance lies within the bounds of its parameters: the "
        "record does not tell them; play a drive that does (piezo-opt diagnose says which)."
    )


def _bounds(what: Identified, names: list[str]) -> tuple[FloatArray, FloatArray]:
    declared = what.model.parameters
    limits = []
    for name in names:
        plain = name if name in declared else name.split("[")[0]
        asked = (what.bounds or {}).get(name)
        own = declared[plain].bounds if plain in declared else (-np.inf, np.inf)
        limits.append(asked or own)
    pairs = np.array(limits, dtype=float).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]
