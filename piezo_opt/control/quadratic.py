"""A dense quadratic program of a few unknowns, by Mehrotra's predictor and corrector.

    min 1/2 x'H x + g'x   with   A x <= b

Source: Nocedal & Wright (2006), Numerical Optimization, 2nd ed., sec. 16.6.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_MOST: Final = 60
_TOLERANCE: Final = 1e-10


def solve(
    h: FloatArray, g: FloatArray, a: FloatArray, b: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The minimum (n,) and the multipliers (m,).

    Args:
        h: (n, n), positive definite.
        g: (n,).
        a, b: (m, n), (m,); some point satisfies all rows with room to spare.
    """
    x = np.zeros(g.size)
    # Rows of one length, so that slacks compare.
    size = np.maximum(np.linalg.norm(a, axis=1), 1e-300)
    a, b = a / size[:, np.newaxis], b / size
    slack = np.maximum(b - a @ x, 1.0)
    dual = np.ones(b.size)
    scale = 1.0 + float(np.abs(g).max())
    for _ in range(_MOST):
        down = h @ x + g + a.T @ dual
        left = a @ x + slack - b
        gap = float(slack @ dual) / b.size
        off = max(float(np.abs(down).max()) / scale, float(np.abs(left).max()), gap / scale)
        if off < _TOLERANCE:
            break
        weight = dual / slack
        factor = h + a.T @ (weight[:, np.newaxis] * a)

        def toward(
            complement: FloatArray, f: FloatArray = factor, w: FloatArray = weight,
            d: FloatArray = down, e: FloatArray = left, s: FloatArray = slack,
        ) -> tuple[FloatArray, FloatArray, FloatArray]:  # fmt: skip
            """Step of x, slack and dual for slack * dual to fall by ``complement``."""
            dx = np.asarray(np.linalg.solve(f, -d - a.T @ (w * e - complement / s)), dtype=float)
            ds = -e - a @ dx
            return dx, ds, -(complement + w * s * ds) / s

        try:
            _, ds, dd = toward(slack * dual)
            reach = min(_longest(slack, ds), _longest(dual, dd))
            ahead = float((slack + reach * ds) @ (dual + reach * dd)) / b.size
            centre = (ahead / gap) ** 3 * gap
            # Where the predictor gets nowhere its square is no guide.
            dx, ds, dd = toward(slack * dual + reach * reach * ds * dd - centre)
        except np.linalg.LinAlgError:
            break  # as close as numbers of this length come
        reach = 0.995 * min(_longest(slack, ds), _longest(dual, dd), 1.0 / 0.995)
        x, slack, dual = x + reach * dx, slack + reach * ds, dual + reach * dd
    return x, dual / size


def _longest(value: FloatArray, step: FloatArray) -> float:
    """How far a step keeps positive numbers positive, 1 at most."""
    falling = step < 0.0
    return float(min(1.0, np.min(-value[falling] / step[falling], initial=1.0)))
