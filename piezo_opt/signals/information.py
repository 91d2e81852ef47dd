"""What a record of a drive would tell of parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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


def log_determinant(answer: Answer, slopes: FloatArray, parameters: Sequence[str]) -> float:
    """log det root' root; what is not seen counts as the least that can be told from rounding."""
    root = _root(answer, slopes, parameters)
    strength = np.linalg.svd(root, compute_uv=False)
    least = max(_BLIND * float(strength.max(initial=0.0)), 1e-300)
    return 2.0 * float(np.log(np.maximum(strength, least)).sum())


def _root(answer: Answer, slopes: FloatArray, parameters: Sequence[str]) -> FloatArray:
    """(p, p) upper triangle whose square is the parameters' information for a noise of 1 m."""
    places = [answer.names.index(n) for n in parameters]
    others = [k for k in range(len(answer.names)) if k not in places]
    # The lower right corner of the triangle is what the last columns have to themselves.
    root = upper_triangle(slopes[:, [*others, *places]])
    return np.asarray(root[len(others) :, len(others) :])
