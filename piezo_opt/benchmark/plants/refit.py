"""What the best refit of the base plant cannot explain: the size of a hidden effect.

Gauss-Newton on finite differences, of the bench's own plant with the bench's own numerics: the
size of an effect must not depend on the package that the bench judges.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.benchmark.plants.drives import Drive
from piezo_opt.benchmark.plants.physics import NAMES, STATIC, Array, Base, base_responses

_DAMPING = np.array([0.0, *np.geomspace(1e-8, 1e-2, 10)])
"""Trial dampings of one step, relative to the largest singular value squared: the step is taken
with all of them at once, which costs hardly more than with one."""


@final
@dataclass(frozen=True)
class Tangent:
    """The base plant's reading and its sensitivities, as an orthonormal basis.

    Attributes:
        vector: parameters in the order of NAMES.
        reading: at these parameters [m], shape (samples,).
        left, values, right: singular value decomposition of the scaled sensitivities.
        scale: of the parameters that move.
    """

    vector: Array
    reading: Array
    left: Array
    values: Array
    right: Array
    scale: Array

    def unexplained(self, change: Array) -> Array:
        """A change of the reading less what the base plant's parameters could imitate."""
        rest: Array = change - self.left @ (self.left.T @ change)
        return rest


def moved(base: Base) -> tuple[int, ...]:
    """The positions in NAMES that a refit may move."""
    names = STATIC if base.static else NAMES
    return tuple(NAMES.index(name) for name in names)


def scales(base: Base, drive: Drive) -> Array:
    """A natural size of every parameter, for differences and steps, shape (len(NAMES),)."""
    stroke = base.gain * float(np.ptp(drive.values))
    loop = base.alpha / base.width
    return np.array([
        base.gain, base.alpha, base.beta, base.beta, 1.0, base.omega, max(base.zeta, 0.02),
        stroke, loop, stroke, stroke * base.omega,
    ])  # fmt: skip


def tangent(base: Base, vector: Array, drive: Drive) -> Tangent:
    """Sensitivities by differences at one point, and their decomposition."""
    columns = moved(base)
    scale = scales(base, drive)
    vectors = np.tile(vector, (len(columns) + 1, 1))
    step = np.full(len(NAMES), 1e-3)
    step[NAMES.index("omega")] = 1e-4
    for row, column in enumerate(columns, start=1):
        vectors[row, column] += step[column] * scale[column]
    values = drive.values[drive.first :]
    readings = base_responses(base, vectors, values, drive.held, drive.rate)
    jacobian = (readings[1:] - readings[0]) / step[list(columns), None]
    left, singular, right = np.linalg.svd(jacobian.T, full_matrices=False)
    kept = singular > 1e-7 * singular[0]
    return Tangent(
        vector, readings[0], left[:, kept], singular[kept], right[kept], scale[list(columns)]
    )


def refit(base: Base, drive: Drive, reading: Array, start: Tangent, *, steps: int = 12) -> Array:
    """The residual of the best refit of the base plant to a reading [m].

    Levenberg-Marquardt until no step promises more than 3 % of the sum of squares; a parameter
    on its bound that wants to leave it is held there.
    """
    here = start
    residual: Array = reading - here.reading
    columns = np.array(moved(base))
    low, high = _bounds(base)
    values = drive.values[drive.first :]
    for _ in range(steps):
        trials, promised = _trials(here, residual, low[columns], high[columns], columns)
        before = float(residual @ residual)
        if promised < 0.03 * before:
            break
        vectors = np.tile(here.vector, (trials.shape[0], 1))
        vectors[:, columns] += trials
        vectors = np.clip(vectors, low, high)
        with np.errstate(all="ignore"):  # a step too far may overflow, and is then not taken
            readings = base_responses(base, vectors, values, drive.held, drive.rate)
            sums = np.sum((reading - readings) ** 2, axis=1)
        best = int(np.argmin(np.where(np.isfinite(sums), sums, np.inf)))
        if not sums[best] < before:
            break
        residual = reading - readings[best]
        # As good as the tangent said: only if it has more to promise is a new one worth its time.
        spent = float(sums[best]) < 1.03 * (before - promised)
        if spent and _trials(here, residual, low[columns], high[columns], columns)[1] < (
            0.01 * before
        ):
            break
        here = tangent(base, vectors[best], drive)
    return residual


def _trials(
    here: Tangent, residual: Array, low: Array, high: Array, columns: NDArray[np.intp]
) -> tuple[Array, float]:
    """Steps at every trial damping, and the decrease that the tangent promises."""
    seen = here.left.T @ residual
    shape = here.values[:, None] * here.right
    at = here.vector[columns]
    free = np.ones(columns.size, dtype=np.bool_)
    size = here.values[0] ** 2
    while True:
        left, values, right = np.linalg.svd(shape[:, free], full_matrices=False)
        kept = values > 1e-7 * here.values[0]
        left, values, right = left[:, kept], values[kept], right[kept]
        part = left.T @ seen
        steps = np.zeros((_DAMPING.size, columns.size))
        steps[:, free] = (values * part / (values**2 + _DAMPING[:, None] * size)) @ right
        steps *= here.scale
        # Outwards in the middling trial: the undamped one is too wild to decide by.
        wanted = steps[_DAMPING.size // 2]
        stuck = free & (((at <= low) & (wanted < 0.0)) | ((at >= high) & (wanted > 0.0)))
        if not stuck.any():
            return steps, float(part @ part)
        free &= ~stuck


def _bounds(base: Base) -> tuple[Array, Array]:
    """Within which the parameters stay in a refit, in the order of NAMES."""
    low = np.full(len(NAMES), -np.inf)
    high = np.full(len(NAMES), np.inf)
    for name, least, most in (
        ("alpha", 0.02 * base.alpha, 50.0 * base.alpha),
        ("beta", 0.02 * base.beta, 20.0 * base.beta),
        ("gamma", -20.0 * base.beta, 20.0 * base.beta),
        ("exponent", 1.0, 3.0),
        ("omega", 0.5 * base.omega, 2.0 * base.omega),
        ("zeta", 1e-4, 0.95),
    ):
        low[NAMES.index(name)], high[NAMES.index(name)] = least, most
    return low, high
