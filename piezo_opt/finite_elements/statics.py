"""A body under a constant voltage and constant forces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.finite_elements.body import Body, FloatArray
from piezo_opt.finite_elements.system import Circuit, System


@final
@dataclass(frozen=True, eq=False)
class Static:
    """What a body does under constant loads.

    Attributes:
        body: the body.
        voltage: of the driven electrodes [V]; what they float at in an open circuit.
        displacement: (N, 3) [m].
        potential: (N,) [V].
        charge: on the driven electrodes [C].
        reaction: (N, 3) forces of the support [N].
        residual: of the free unknowns, as a share of the loads.
    """

    body: Body
    voltage: float
    displacement: FloatArray
    potential: FloatArray
    charge: float
    reaction: FloatArray
    residual: float

    @property
    def tip(self) -> float:
        """Mean displacement of the top along z [m]."""
        return float(self.body.over_top @ self.displacement[:, 2])

    @property
    def widening(self) -> float:
        """Mean growth of the width along x [m]."""
        x = self.body.points[:, 0]
        near = 1e-9 * self.body.height
        low, high = np.abs(x - x.min()) <= near, np.abs(x - x.max()) <= near
        moved = self.displacement[:, 0]
        return float(moved[high].mean() - moved[low].mean())

    @property
    def capacitance(self) -> float:
        """Charge over voltage, under no force [F]."""
        return self.charge / self.voltage


def static(what: Body | System, voltage: float = 0.0, forces: FloatArray | None = None) -> Static:
    """Displacement, potential and charge under constant loads.

    Args:
        what: a body, its electrodes driven; or a system, whose factors are used again.
        voltage: of the driven electrodes [V].
        forces: (N, 3) on the nodes [N].

    Raises:
        InputError: the support leaves the body loose, or the forces have another shape.
    """
    system = what if isinstance(what, System) else System(what)
    body, volts = system.body, system.matrices.volts
    # Where all displacements are held there is no motion to be left free.
    system.refuse_loose()
    load = np.zeros((body.nodes, 4))
    if forces is not None:
        if np.shape(forces) != (body.nodes, 3):
            raise InputError(
                f"forces have the shape {np.shape(forces)}; give one of three components for each "
                f"of the {body.nodes} nodes"
            )
        load[:, :3] = forces
    known = system.drive(voltage)
    stiffness = system.matrices.stiffness
    right = system.reduced(load.ravel() - stiffness @ known)
    y = system.factors.solve(right)
    x = known + system.whole(y)
    left = stiffness @ x - load.ravel()
    size = float(np.abs(right).max(initial=0.0)) or 1.0
    answer, rest = x.reshape(-1, 4), left.reshape(-1, 4)
    # Virtual work by one volt on the electrode, phi = a x: Q = -(K_up' u - K_pp phi).
    charge = -float(rest[body.driven, 3].sum()) / volts
    potential = volts * answer[:, 3]
    return Static(
        body=body,
        voltage=float(potential[body.driven[0]]),
        displacement=np.ascontiguousarray(answer[:, :3]),
        potential=potential,
        charge=0.0 if system.circuit is Circuit.OPEN else charge,
        reaction=_on_fixed(body, rest[:, :3]),
        residual=float(np.abs(system.reduced(left)).max(initial=0.0)) / size,
    )


def _on_fixed(body: Body, rest: FloatArray) -> FloatArray:
    found = np.zeros(3 * body.nodes)
    found[body.fixed] = rest.ravel()[body.fixed]
    return found.reshape(-1, 3)
