"""Of a sampled plant the states that matter between the drive and the reading."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, TypeAlias, final

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from piezo_opt.errors import InputError

FloatArray = NDArray[np.float64]
Sampled: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]
"""A (n, n), B (n, 1), C (1, n)."""

KEPT: Final = 1e-4
"""Of the gain at rest: by how much the response of what is kept may be off at any frequency. The
slope of a loop around which a plant is linearised is known to a hundredth at best."""

ROUNDING: Final = 1e-7
"""Of the gain: square roots of Gramians, which are known to 1e-16, say no more of a state."""


@final
@dataclass(frozen=True, eq=False)
class Minimal:
    """A plant without the states that hardly matter.

    Attributes:
        plant: A, B, C of what is kept, each state scaled to the size to which the drive moves it.
        whole: number of states that there were.
        off: bound of the difference of the responses at any frequency, over the gain at rest.
    """

    plant: Sampled
    whole: int
    off: float

    @property
    def remarks(self) -> tuple[str, ...]:
        """A sentence where states were left out that do something."""
        kept = self.plant[0].shape[0]
        if kept == self.whole or self.off < ROUNDING:
            return ()
        return (
            f"Designed on {kept} of {self.whole} states of the linearised plant: the others change "
            f"its response by {100.0 * self.off:.1g} % of its gain at most.",
        )


def minimal(plant: Sampled) -> Minimal:
    """Balanced truncation of a stable plant.

    In balanced states the drive reaches each as well as the reading shows it, and sigma_i says how
    well. A state that the drive does not move, or that the reading does not show, has sigma = 0;
    leaving out those from k on moves the response by 2 (sigma_k + ... + sigma_n) at most, at any
    frequency. As many are left out as keep that within :data:`KEPT`. The balanced form is found
    from factors of the Gramians, which keeps the digits that their product would lose.

    Raises:
        InputError: a plant that is not stable by itself, or does not move the reading.

    Sources: Moore (1981), IEEE Trans. Autom. Control 26(1), 17-32; Glover (1984), Int. J. Control
    39(6), 1115-1193 (bound).
    """
    a, b, c = plant
    if np.abs(np.linalg.eigvals(a)).max(initial=0.0) >= 1.0:
        raise InputError(
            "The model runs away by itself at a constant drive: leave out the effect that does "
            "it, or bound its parameters."
        )
    a, b, c = _scaled(a, b, c)
    reached = _root(scipy.linalg.solve_discrete_lyapunov(a, b @ b.T))
    shown = _root(scipy.linalg.solve_discrete_lyapunov(a.T, c.T @ c))
    left, sigma, right = np.linalg.svd(shown.T @ reached)
    gain = abs(float((c @ np.linalg.solve(np.eye(a.shape[0]) - a, b))[0, 0]))
    rest = 2.0 * np.append(np.cumsum(sigma[::-1])[::-1], 0.0)
    kept = int(np.argmax(rest <= KEPT * gain))
    if not kept:
        raise InputError("The position does not follow the drive: there is nothing to control.")
    size = np.sqrt(sigma[:kept])
    into = reached @ right[:kept].T / size
    out = (shown @ left[:, :kept] / size).T
    return Minimal(
        _scaled(out @ a @ into, out @ b, c @ into), a.shape[0], float(rest[kept] / gain)
    )  # fmt: skip


def _root(gramian: ArrayLike) -> FloatArray:
    """R with R R' = W."""
    gramian = np.asarray(gramian, dtype=float)
    values, vectors = np.linalg.eigh(0.5 * (gramian + gramian.T))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _scaled(a: FloatArray, b: FloatArray, c: FloatArray) -> Sampled:
    """Each state in units of its largest value after a pulse of a volt."""
    moves, now = [], b
    for _ in range(4 * a.shape[0] + 200):
        moves.append(np.abs(now).ravel())
        now = a @ now
    size = np.max(moves, axis=0)
    size = np.where(size > 0.0, size, 1.0)
    return a * size / size[:, np.newaxis], b / size[:, np.newaxis], c * size
