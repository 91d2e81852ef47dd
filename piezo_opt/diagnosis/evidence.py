"""One number by which sets are compared, on all data.

    C = N ln(e'e / N) + k ln N + 2 ln binomial(p, m)

with e the residual after the noise's filter (:mod:`colour`), N its samples, k the numbers that act
and m of p effects chosen: the extended BIC, whose last term pays for having chosen.

Sources: Schwarz (1978), Annals of Statistics 6(2), 461-464; Chen & Chen (2008), Biometrika 95(3),
759-771.
"""

from __future__ import annotations

import math

import numpy as np

from piezo_opt.diagnosis.colour import Colour
from piezo_opt.identification import Fit
from piezo_opt.simulation import INITIAL

RESOLUTION = 10.0
"""Difference of the criterion that counts as very strong evidence (Kass & Raftery 1995)."""

WORTH = 0.35
"""Unless told otherwise, an effect bears a name where without it an eighth more squares are left
(an error six per cent larger): what it does is a third of the noise, or more."""


def criterion(fit: Fit, colour: Colour, members: int, choices: int) -> float:
    """The criterion of a fit; infinite where it is not finite.

    Args:
        fit: the fit.
        colour: of the noise.
        members: effects that were chosen.
        choices: effects there were to choose from.
    """
    power = remaining(fit, colour)
    n = sum(colour.lengths)
    if not math.isfinite(power) or power <= 0.0:
        return math.inf
    return n * math.log(power / n) + charge(numbers(fit), n, members, choices)


def charge(numbers: int, samples: int, members: int, choices: int) -> float:
    """What the criterion asks for, whatever is left: k ln N + 2 ln binomial(p, m)."""
    chosen = 2.0 * math.log(math.comb(max(choices, 1), min(members, choices)))
    return numbers * math.log(max(samples, 2)) + chosen


def remaining(fit: Fit, colour: Colour) -> float:
    """Sum of squares after the noise's filter [m^2]."""
    if not colour.coefficients:
        return sum(colour.lengths) * fit.rms**2  # which a fit keeps
    e = colour.whitened(fit.residuals)
    return float(e @ e)


def worth(without: Fit, with_: Fit, colour: Colour) -> float:
    """How much of what is left a member explains: sqrt(SSR without / SSR with - 1)."""
    ratio = remaining(without, colour) / max(remaining(with_, colour), np.finfo(float).tiny)
    return math.sqrt(max(0.0, ratio - 1.0)) if math.isfinite(ratio) else math.inf


def numbers(fit: Fit) -> int:
    """How many numbers of a fit act over the whole record.

    Not those that are redundant by definition, nor where a trailing state begins: what a record
    says of that does not grow with its length.
    """
    heads = tuple(
        f"{INITIAL}{name}.{state}"
        for name, effect in fit.model for state, declared in effect.declared_states.items()
        if declared.trailing
    )  # fmt: skip
    begins = sum(name.startswith(heads) for name in fit.names)
    return len(fit.names) - begins - sum(effect.redundant for _, effect in fit.model)
