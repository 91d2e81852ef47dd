"""What a record of a drive would tell of parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import Enum
from typing import Final

import numpy as np

from piezo_opt.identification.tall import triangle as upper_triangle
from piezo_opt.signals.answer import Answer
from piezo_opt.signals.drive import FloatArray

_BLIND: Final = 1e-9
"""Share of the largest singular value below which a direction is not seen: derivatives err so."""
_PART: Final = 1e-5
"""Part in a direction from which a parameter counts as touched by it."""


def deviations(
    answer: Answer,
    values: FloatArray,
    parameters: Sequence[str],
    noise: float,
    numbers: Mapping[str, float] | None = None,
) -> dict[str, float] | None:
    """Standard deviations of parameters after a fit of one record of a drive (N,) [SI].

        C = sigma^2 (J' J)^-1,    J of all that such a fit estimates, its unknown start included

    None where the model cannot be simulated on it; infinite for what it does not see.

    Args:
        answer: of the fit.
        values: the drive [unit].
        parameters: whose deviations.
        noise: of the reading, independent from sample to sample [m].
        numbers: values of the parameters; the fit's own unless given.
    """
    told = answer.derivatives(values, numbers)
    if told is None:
        return None
    root = _root(answer, told[1], parameters)
    places = [answer.names.index(n) for n in parameters]
    _, strength, rows = np.linalg.svd(root)
    seen = strength > _BLIND * strength.max(initial=0.0)
    # A parameter with a part in a direction that is not seen has no deviation.
    lost = np.linalg.norm(rows[~seen], axis=0) > _PART
    size = np.linalg.norm(rows[seen] / strength[seen, None], axis=0)
    std = np.where(lost, np.inf, noise * size * answer.scale[places])
    return dict(zip(parameters, std.tolist(), strict=True))


class Criterion(Enum):
    """What is made small."""

    DETERMINANT = "determinant"
    """Of the covariance: the volume in which the parameters are (D-optimality)."""
    DEVIATIONS = "deviations"
    """The standard deviations of the parameters, in geometric mean, whatever their correlations."""


def merit(
    answer: Answer, slopes: FloatArray, parameters: Sequence[str], criterion: Criterion
) -> float:
    """Logarithm of the information for a noise of 1 m, p times that of one parameter.

        log det C^-1, or -sum_i log C_ii,    C = covariance of the parameters, all else estimated

    What is not seen counts as the least that can be told from rounding.
    """
    _, strength, rows = np.linalg.svd(_root(answer, slopes, parameters))
    strength = np.maximum(strength, max(_BLIND * float(strength.max(initial=0.0)), 1e-300))
    if criterion is Criterion.DETERMINANT:
        return 2.0 * float(np.log(strength).sum())
    return -2.0 * float(np.log(np.linalg.norm(rows / strength[:, None], axis=0)).sum())


def worth(
    answer: Answer, slopes: FloatArray, parameters: Sequence[str], criterion: Criterion
) -> FloatArray:
    """(N,) what each sample adds to `merit`, one on average.

        N / p (f' M^-1 f - f_o' M_o^-1 f_o), or N / p sum_i (f' M^-1 e_i)^2 / C_ii

    f the derivatives of a sample's reading, M = sum f f', M_o that of what is not asked for.
    """
    wanted = [answer.names.index(n) for n in parameters]
    base, strength, rows = np.linalg.svd(slopes, full_matrices=False)
    seen = strength > _BLIND * strength[0]
    base, strength, rows = base[:, seen], strength[seen], rows[seen]
    if criterion is Criterion.DEVIATIONS:
        through = base @ (rows[:, wanted] / strength[:, None])
        size = np.maximum((through**2).sum(axis=0), 1e-300)
        own = (through**2 / size).sum(axis=1)
    else:
        own = (base**2).sum(axis=1)
        others = np.delete(slopes, wanted, axis=1)
        if others.shape[1]:
            alone, strength, _ = np.linalg.svd(others, full_matrices=False)
            own = own - (alone[:, strength > _BLIND * strength[0]] ** 2).sum(axis=1)
    return np.asarray(np.maximum(own, 0.0) * (len(own) / len(wanted)))


def _root(answer: Answer, slopes: FloatArray, parameters: Sequence[str]) -> FloatArray:
    """(p, p) upper triangle whose square is the parameters' information for a noise of 1 m."""
    places = [answer.names.index(n) for n in parameters]
    others = [k for k in range(len(answer.names)) if k not in places]
    # The lower right corner of the triangle is what the last columns have to themselves.
    root = upper_triangle(slopes[:, [*others, *places]])
    return np.asarray(root[len(others) :, len(others) :])
