"""What the best refit of the base plant cannot explain: the size of a hidden effect.

Gauss-Newton on finite differences, of the bench's own plant with the bench's own numerics: the
size of an effect must not depend on the package that the bench judges.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

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


def refit(base: Base, drive: Drive, reading: Array, start: Tangent, *, steps: int = 10) -> Array:
    """The residual of the best refit of the base plant to a clean reading [m]."""
    here = start
    residual: Array = reading - here.reading
    columns = list(moved(base))
    values = drive.values[drive.first :]
    for count in range(1, steps + 1):
        seen = here.left.T @ residual
        size = here.values[0] ** 2
        trials = np.stack([
            here.scale * (here.right.T @ (here.values / (here.values**2 + damp * size) * seen))
            for damp in _DAMPING
        ])  # fmt: skip
        vectors = np.tile(here.vector, (len(_DAMPING), 1))
        vectors[:, columns] += trials
        vectors = _inside(base, vectors)
        with np.errstate(all="ignore"):  # a step too far may overflow, and is then not taken
            readings = base_responses(base, vectors, values, drive.held, drive.rate)
        sums = np.sum((reading - readings) ** 2, axis=1)
        best = int(np.argmin(np.where(np.isfinite(sums), sums, np.inf)))
        before = float(residual @ residual)
        if not sums[best] < before:
            return residual
        residual = reading - readings[best]
        left = here.left.T @ residual
        if count == steps or float(left @ left) < 0.03 * sums[best]:
            return residual
        here = tangent(base, vectors[best], drive)
        left = here.left.T @ residual
        if float(left @ left) < 0.03 * sums[best]:
            return residual
    return residual


def _inside(base: Base, vectors: Array) -> Array:
    """The same parameters within what the plant's equations allow."""
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
    return np.clip(vectors, low, high)
