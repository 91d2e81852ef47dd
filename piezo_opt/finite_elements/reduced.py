"""From finite elements to a few modes: frequency response, transfer function, priors of a model.

With modes of unit mass, u_s the static shape under one volt and c the mean of the top along z,

    y(s) / V = D + sum_k g_k / (1 + 2 zeta s / omega_k + s^2 / omega_k^2)
    g_k = c(phi_k) phi_k' M u_s,        D = c(u_s) - sum_k g_k

The part D of the modes left out follows at once. The charge does so with the force of one volt
theta_k = omega_k^2 phi_k' M u_s:

    Q(s) / V = C_s - sum_k (theta_k / omega_k)^2 (1 - 1 / (1 + 2 zeta s / omega_k + ...))

Source: Preumont (2011), Vibration Control of Active Structures, 3rd ed., sec. 2.5 (modal truncation
with the static contribution of what is left out); the minus sign makes C_s the capacitance at rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_opt.errors import InputError
from piezo_opt.finite_elements.body import Body, FloatArray
from piezo_opt.finite_elements.modes import modes
from piezo_opt.finite_elements.statics import static
from piezo_opt.finite_elements.system import System
from piezo_opt.physics import Expected

ComplexArray = NDArray[np.complex128]

_DUMB = 1e-9
"""Share of the static gain below which a mode does not move the tip: rounding and symmetry."""


@final
@dataclass(frozen=True, eq=False)
class Reduced:
    """A body as the sum of its modes, from the voltage to the top and to the charge.

    Attributes:
        gain: static displacement of the top a volt [m/V].
        capacitance: static charge a volt [F].
        frequencies: (n,) of the modes that the voltage moves [Hz].
        gains: (n,) g_k, share of each in the static gain [m/V].
        forces: (n,) theta_k, generalised force of one volt [N/sqrt(kg)/V].
        damping: zeta, of every mode.
    """

    gain: float
    capacitance: float
    frequencies: FloatArray
    gains: FloatArray
    forces: FloatArray
    damping: float

    @property
    def omegas(self) -> FloatArray:
        """(n,) [rad/s]."""
        return np.asarray(2.0 * np.pi * self.frequencies)

    def response(self, frequencies: ArrayLike) -> ComplexArray:
        """Displacement of the top a volt (m,) at frequencies (m,) [Hz]."""
        turned = self._turned(frequencies)
        return np.asarray(self.gain + (turned - 1.0) @ self.gains)

    def charge(self, frequencies: ArrayLike) -> ComplexArray:
        """Charge a volt (m,) at frequencies (m,) [Hz]; j omega times it is the admittance."""
        turned = self._turned(frequencies)
        return np.asarray(self.capacitance + (turned - 1.0) @ (self.forces / self.omegas) ** 2)

    def state_space(self) -> Any:
        """The same as a ``StateSpace`` of python-control: volts in, metres out."""
        import control

        omega = self.omegas
        n = omega.size
        none, one = np.zeros((n, n)), np.eye(n)
        a = np.block([[none, one], [-np.diag(omega**2), -2.0 * self.damping * np.diag(omega)]])
        b = np.concatenate([np.zeros(n), omega**2])[:, None]
        c = np.concatenate([self.gains, np.zeros(n)])[None, :]
        return control.ss(a, b, c, [[self.gain - float(self.gains.sum())]])

    def transfer_function(self, count: int = 3) -> Any:
        """Of the modes that move the top most, as a ``TransferFunction`` of python-control.

        Numerator and denominator of many modes overflow their digits: three are six powers of s.
        """
        import control

        strongest = np.sort(np.argsort(-np.abs(self.gains))[:count])
        found = control.tf([self.gain - float(self.gains[strongest].sum())], [1.0])
        for k in strongest:
            omega = float(self.omegas[k])
            found = found + control.tf(
                [float(self.gains[k]) * omega**2], [1.0, 2.0 * self.damping * omega, omega**2]
            )
        return found

    def expected(self, tolerance: float) -> dict[str, Expected]:
        """What a dynamic model's parameters are expected to be, by full name.

        ``piezo_gain.d`` is the static gain; ``second_order.omega`` the mode with the largest share
        in it.

        Args:
            tolerance: share by which material and geometry may be off; a frequency goes with the
                root of a stiffness and gets half of it.

        Raises:
            InputError: a tolerance that is no positive share, or no mode moves the top.
        """
        if self.gains.size == 0:
            raise InputError("no mode moves the top: ask reduced() for more of them")
        main = float(self.omegas[np.argmax(np.abs(self.gains))])
        return {
            "piezo_gain.d": Expected.within(self.gain, tolerance, "static finite elements"),
            "second_order.omega": Expected.within(main, 0.5 * tolerance, "modal finite elements"),
        }

    def _turned(self, frequencies: ArrayLike) -> ComplexArray:
        """(m, n) each mode's response over its static one."""
        ratio = np.asarray(frequencies, dtype=np.float64)[:, None] / self.frequencies[None, :]
        return np.asarray(1.0 / (1.0 - ratio**2 + 2j * self.damping * ratio))


def reduced(what: Body | System, count: int = 10, *, damping: float = 0.01) -> Reduced:
    """The lowest modes of a body that its voltage moves.

    Args:
        what: a body, or its system with driven electrodes.
        count: modes looked for, those that the voltage does not move among them.
        damping: zeta of every mode: finite elements do not know it.

    Raises:
        InputError: the support leaves the body loose, or damping is negative.
    """
    if not 0.0 <= damping < 1.0:
        raise InputError(f"damping is {damping:g}; give a ratio from 0 to below 1, 0.01 for 1 %")
    system = what if isinstance(what, System) else System(what)
    rest = static(system, 1.0)
    found = modes(system, count)
    body = system.body
    at_rest = np.column_stack([rest.displacement, np.zeros(body.nodes)]).ravel()
    inertia = (system.matrices.mass @ at_rest).reshape(-1, 4)[:, :3]
    share = np.einsum("kna,na->k", found.shapes, inertia)
    gains = share * found.tip
    forces = share * (2.0 * np.pi * found.frequencies) ** 2
    heard = np.abs(gains) > _DUMB * abs(rest.tip)
    return Reduced(
        gain=rest.tip,
        capacitance=rest.capacitance,
        frequencies=found.frequencies[heard],
        gains=gains[heard],
        forces=forces[heard],
        damping=damping,
    )
