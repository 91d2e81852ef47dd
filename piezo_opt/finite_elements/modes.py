"""Natural frequencies and shapes of a body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from scipy.sparse import linalg

from piezo_opt.errors import InputError
from piezo_opt.finite_elements.body import Body, FloatArray
from piezo_opt.finite_elements.system import Circuit, System, factorised


@final
@dataclass(frozen=True, eq=False)
class Modes:
    """Modes of a body, lowest first, each of unit modal mass (phi' M phi = 1 kg).

    Attributes:
        body: the body.
        circuit: of its driven electrodes.
        frequencies: (n,) [Hz].
        shapes: (n, N, 3) displacement of the nodes, times the square root of 1 kg [m].
        potentials: (n, N) that go with them [V].
    """

    body: Body
    circuit: Circuit
    frequencies: FloatArray
    shapes: FloatArray
    potentials: FloatArray

    @property
    def tip(self) -> FloatArray:
        """(n,) mean displacement of the top along z."""
        return np.asarray(self.shapes[:, :, 2] @ self.body.over_top)


def modes(what: Body | System, count: int = 10, *, circuit: Circuit = Circuit.DRIVEN) -> Modes:
    """The lowest modes, those without strain of a loose body left out.

        (K_uu + K_up K_pp^-1 K_up') phi = omega^2 M phi

    With the electrodes driven (short-circuited) these are resonances, in an open circuit
    antiresonances. Lanczos' method on the inverse; the potentials are eliminated by solving for
    both.

    Args:
        what: a body, or a system, whose circuit holds then.
        count: how many.
        circuit: of the driven electrodes.

    Raises:
        InputError: there are not that many.
    """
    system = what if isinstance(what, System) else System(what, circuit)
    body, loose = system.body, system.body.loose
    moved = np.flatnonzero(system.moved)
    if not 1 <= count <= moved.size - loose - 2:
        raise InputError(
            f"{count} modes of {moved.size} free displacements: give 1 to "
            f"{max(0, moved.size - loose - 2)}"
        )
    mass = system.mass[moved][:, moved].tocsc()
    shift = 0.0 if loose == 0 else _shift(body)
    factors = system.factors if loose == 0 else factorised(system.stiffness - shift * system.mass)
    n = system.moved.size

    def inverse(force: FloatArray) -> FloatArray:
        right = np.zeros(n)
        right[moved] = force.ravel()
        return np.asarray(factors.solve(right)[moved])

    square = (moved.size, moved.size)
    operator = linalg.LinearOperator(square, matvec=inverse, dtype=np.float64)
    begin = np.random.default_rng(0).normal(size=moved.size)
    # The first argument is not looked at where the inverse is given.
    values, vectors = linalg.eigsh(
        operator, k=count + loose, M=mass, sigma=shift, OPinv=operator, v0=begin
    )
    order = np.argsort(values)[loose:]
    values, vectors = values[order], vectors[:, order]
    right = np.zeros((n, count))
    right[moved] = (mass @ vectors) * (values - shift)
    # One more solve with the inertia as load gives the potentials that go with each shape.
    whole = system.whole(np.asarray(factors.solve(right))).T.reshape(count, body.nodes, 4)
    top = whole[:, :, 2] @ body.over_top
    sign = np.where(top < 0.0, -1.0, 1.0)[:, None, None]
    whole = whole * sign
    return Modes(
        body=body,
        circuit=system.circuit,
        frequencies=np.sqrt(np.maximum(values, 0.0)) / (2.0 * np.pi),
        shapes=np.ascontiguousarray(whole[:, :, :3]),
        potentials=system.matrices.volts * whole[:, :, 3],
    )


def _shift(body: Body) -> float:
    """-omega^2 of a rate far below the first mode: a tenth of a sound's way through the body."""
    material = body.materials[0]
    speed = np.sqrt(material.stiffness[2, 2] / material.density)
    extent = float(np.ptp(body.points, axis=0).max())
    return -float((0.1 * speed / extent) ** 2)
