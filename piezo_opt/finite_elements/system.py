"""A body's equations with its support and electrodes put in, and their solution."""

from __future__ import annotations

from enum import Enum
from typing import Any, final

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import linalg

from piezo_opt.errors import InputError
from piezo_opt.finite_elements.assembly import Matrices, assembled
from piezo_opt.finite_elements.body import Body, FloatArray
from piezo_opt.lazy import lazy


class Circuit(Enum):
    """What the driven electrodes are connected to."""

    DRIVEN = "driven"
    """A voltage source: the potential is given."""
    OPEN = "open"
    """Nothing: they float at one potential and carry no charge."""


@final
class System:
    """Equations of a body under one circuit; what is factorised is kept.

    Unknowns x = P y + known: held displacements and given potentials are left out, the nodes of a
    floating electrode share one unknown.

    Args:
        body: the meshed body.
        circuit: of the driven electrodes.
        matrices: of the same body, where another system has assembled them.
    """

    def __init__(
        self,
        body: Body,
        circuit: Circuit = Circuit.DRIVEN,
        *,
        matrices: Matrices | None = None,
    ) -> None:
        self.body = body
        self.circuit = circuit
        self.matrices = assembled(body) if matrices is None else matrices
        held = 4 * (body.fixed // 3) + body.fixed % 3
        number = np.zeros(4 * body.nodes, dtype=np.int64)
        number[held] = number[4 * body.ground + 3] = -1
        electrode = 4 * body.driven + 3
        number[electrode] = -1
        free = np.flatnonzero(number == 0)
        number[free] = np.arange(free.size)
        size = free.size
        if circuit is Circuit.OPEN:
            number[electrode] = size
            size += 1
        kept = np.flatnonzero(number >= 0)
        self._moved = np.zeros(size, dtype=bool)
        self._moved[number[kept]] = kept % 4 != 3
        self._spread = sparse.csc_matrix(
            (np.ones(kept.size), (kept, number[kept])), shape=(4 * body.nodes, size)
        )

    @lazy
    def stiffness(self) -> Any:
        """P' K P."""
        return (self._spread.T @ self.matrices.stiffness @ self._spread).tocsc()

    @lazy
    def mass(self) -> Any:
        """P' M P; rows of potentials are empty."""
        return (self._spread.T @ self.matrices.mass @ self._spread).tocsc()

    @property
    def moved(self) -> NDArray[np.bool_]:
        """(n,) which unknowns are displacements."""
        return self._moved

    def whole(self, y: FloatArray) -> FloatArray:
        """P y: all unknowns of the body, held ones zero; (n,) or (n, k)."""
        return np.asarray(self._spread @ y)

    def reduced(self, x: FloatArray) -> FloatArray:
        """P' x."""
        return np.asarray(self._spread.T @ x)

    def drive(self, voltage: float) -> FloatArray:
        """(4 N,) the driven electrodes' potential, zero elsewhere."""
        x = np.zeros(4 * self.body.nodes)
        if self.circuit is Circuit.DRIVEN:
            x[4 * self.body.driven + 3] = voltage / self.matrices.volts
        return x

    def refuse_loose(self) -> None:
        """Refuse a body that could move without strain.

        Raises:
            InputError: the support leaves such a motion.
        """
        if self.body.loose:
            raise InputError(
                f"the support leaves {self.body.loose} of the 6 motions without strain free, so "
                "that no load has an answer: fix the base (Support.CLAMPED), or let it stand on "
                "rollers (Support.ROLLERS)"
            )

    @lazy
    def factors(self) -> Any:
        """Factors of P' K P."""
        return factorised(self.stiffness)


def factorised(matrix: Any) -> Any:
    """Factors of a symmetric quasi-definite matrix, for which no pivoting is needed.

    Raises:
        InputError: it is singular.

    Source: Vanderbei (1995), SIAM J. Optimization 5(1), 100-113.
    """
    try:
        return linalg.splu(
            matrix,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError as error:
        raise InputError(
            "the equations are singular: some node belongs to no element, or an element has no "
            "volume"
        ) from error
