"""Nelder and Mead's simplex on a constrained program: the baseline that needs no derivatives."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from piezo_opt.control.sqp import PENALTY, Found, Valued

FloatArray = NDArray[np.float64]

_NOWHERE: Final = 1e3
"""Stands for the cost where there is none."""


def simplex(
    evaluate: Callable[[FloatArray], Valued | None],
    start: FloatArray,
    low: FloatArray,
    high: FloatArray,
    *,
    tolerance: float = 1e-4,
    most: int = 4000,
    tell: Callable[[int, float], None] | None = None,
) -> Found:
    """The same program, with its constraints as an exact penalty on the cost.

    Ends where the simplex is smaller than 1e-4 in the unknowns and the cost varies over it by less
    than the tolerance.

    Args: as :func:`piezo_opt.control.sqp.minimise`.

    Source: Nelder & Mead (1965), Comput. J. 7(4), 308-313.
    """
    first = evaluate(start)
    if first is None:
        raise ArithmeticError("the function has no value at the start")
    count = 1

    def cost(x: FloatArray) -> float:
        nonlocal count
        at = evaluate(x)
        count += 1
        if at is None or not np.isfinite(at.cost):
            return _NOWHERE
        if tell is not None:
            tell(count, at.cost)
        return at.cost + PENALTY * at.violation

    answer = optimize.minimize(
        cost, start, method="Nelder-Mead", bounds=optimize.Bounds(low, high),
        options={"xatol": 1e-4, "fatol": tolerance, "maxfev": most},
    )  # fmt: skip
    end = evaluate(answer.x)
    assert end is not None
    return Found(answer.x, end, count, bool(answer.success), ((count, end.cost),))
