"""Fewer poles for the same response: balanced truncation, and two poles by their step response."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.errors import InputError
from piezo_opt.linear_models.criteria import StepCriteria, step_criteria
from piezo_opt.linear_models.judging import state_space
from piezo_opt.measurement import FloatArray
from piezo_opt.units import show

if TYPE_CHECKING:
    import control

    System: TypeAlias = control.StateSpace | control.TransferFunction


@final
@dataclass(frozen=True, eq=False)
class Reduced:
    """A reduced system.

    Attributes:
        system: of the order asked for.
        singular_values: (n,) Hankel singular values of the original.
        bound: no frequency's response differs by more, 2 sum of the values left out.
        unit: of the response, "m/V".
    """

    system: control.StateSpace
    singular_values: FloatArray
    bound: float
    unit: str = "1"

    @property
    def criteria(self) -> StepCriteria:
        """Overshoot, settling time and the like of the reduced system."""
        return step_criteria(self.system)

    def __str__(self) -> str:
        poles = ", ".join(f"{x:.4g}" for x in self.system.poles() if x.imag >= 0.0)
        seen = self.criteria
        return (
            f"Reduced to {self.system.nstates} of {self.singular_values.size} poles, {poles} 1/s: "
            f"no frequency's response is off by more than {show(self.bound, self.unit)}, the gain "
            f"at rest is {show(seen.final, self.unit)}.\n"
            f"A step overshoots by {100.0 * seen.overshoot:.1f} % and settles to 2 % in "
            f"{show(seen.settling_time, 's')}."
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units."""
        return {
            **{key: np.asarray(getattr(self.system, key)).tolist() for key in "ABCD"},
            "singular_values": self.singular_values.tolist(),
            "bound": self.bound,
            "step": asdict(self.criteria),
        }


def truncate(system: System, order: int, *, keep_gain: bool = False, unit: str = "1") -> Reduced:
    """Balanced truncation of a stable system, by the square-root method.

        A P + P A' + B B' = 0,    A' Q + Q A + C' C = 0,    sigma_i^2 the eigenvalues of P Q

    Args:
        system: stable.
        order: states that stay, 1 to n.
        keep_gain: whether the states left out follow at once (singular perturbation), which keeps
            the gain at rest; the bound is the same.
        unit: of the response, "m/V".

    Raises:
        InputError: unstable, or an order that the system does not have.

    Source: Moore (1981), IEEE Trans. Autom. Control 26, 17-32; Liu & Anderson (1989), Int. J.
    Control 50, 1379-1405 (the gain kept).
    """
    import control
    from scipy import linalg

    a, b, c, d = state_space(system)
    n = a.shape[0]
    if not 1 <= order <= n:
        raise InputError(f"an order of {order} is asked for: give 1 to {n}")
    if float(np.linalg.eigvals(a).real.max()) >= 0.0:
        raise InputError(
            "an unstable system cannot be balanced: fit it with stable=True, without --unstable"
        )
    # Balancing of rows and columns first: companion forms of fast systems span many decades.
    balanced, (scale, _) = linalg.matrix_balance(a, permute=False, separate=True)
    a = np.asarray(balanced, dtype=np.float64)
    b, c = np.asarray(b / scale), np.asarray(c * scale)
    reach = _factor(linalg.solve_continuous_lyapunov(a, -np.outer(b, b)))
    see = _factor(linalg.solve_continuous_lyapunov(a.T, -np.outer(c, c)))
    u, sigma, vt = np.linalg.svd(see.T @ reach)
    left = see @ u / np.sqrt(sigma)
    right = reach @ vt.T / np.sqrt(sigma)
    full = left.T @ a @ right
    into, out = left.T @ b, c @ right
    k = order
    if keep_gain and k < n:
        solve = np.linalg.solve(full[k:, k:], np.column_stack([full[k:, :k], into[k:]]))
        small = full[:k, :k] - full[:k, k:] @ solve[:, :k]
        made = (small, into[:k] - full[:k, k:] @ solve[:, k], out[:k] - out[k:] @ solve[:, :k])
        d = d - float(out[k:] @ solve[:, k])
    else:
        made = (full[:k, :k], into[:k], out[:k])
    reduced = control.ss(
        made[0], made[1][:, None], made[2][None, :], [[d]], inputs="drive", outputs="reading"
    )
    return Reduced(reduced, sigma, 2.0 * float(sigma[order:].sum()), unit)


def _factor(gramian: NDArray[np.floating]) -> FloatArray:
    """A square factor L with L L' = gramian, which rounding may have made slightly indefinite."""
    values, vectors = np.linalg.eigh(0.5 * (gramian + gramian.T))
    floor = float(values[-1]) * np.finfo(np.float64).eps
    return np.asarray(vectors * np.sqrt(np.maximum(values, floor)))


@final
@dataclass(frozen=True)
class SecondOrderShape:
    """Kp wn^2 / (s^2 + 2 zeta wn s + wn^2), and the same as 1 / (m s^2 + b s + k).

    Attributes:
        zeta: damping ratio.
        omega: natural angular frequency wn [1/s].
        gain: Kp [position_unit / drive_unit].
    """

    zeta: float
    omega: float
    gain: float

    @property
    def system(self) -> control.TransferFunction:
        """For python-control."""
        import control

        w = self.omega
        return control.tf(
            [self.gain * w**2], [1.0, 2.0 * self.zeta * w, w**2], inputs="drive", outputs="reading"
        )

    @property
    def mass_damping_stiffness(self) -> tuple[float, float, float]:
        """m, b, k of Eq. 3.6, 1/(m s^2 + b s + k), in drive_unit / position_unit and seconds."""
        top = self.gain * self.omega**2
        return 1.0 / top, 2.0 * self.zeta * self.omega / top, self.omega**2 / top


def second_order_shape(overshoot: float, settling: float, gain: float = 1.0) -> SecondOrderShape:
    """Two poles with an overshoot and a settling time.

        zeta = -ln(overshoot) / sqrt(pi^2 + ln(overshoot)^2),    wn = 4 / (zeta settling)

    Args:
        overshoot: share of the final value, between 0 and 1.
        settling: [s].
        gain: [position_unit / drive_unit].

    Raises:
        InputError: an overshoot that two poles cannot have, or a settling time that is not
            positive.

    Source: Ogata (2010), Modern Control Engineering, 5th ed., sec. 5-3; the thesis' Eqs. 3.2-3.4.
    """
    if not 0.0 < overshoot < 1.0:
        raise InputError(f"an overshoot lies between 0 and 1, not at {overshoot:g}")
    if not settling > 0.0:
        raise InputError(f"a settling time is positive, not {settling:g} s")
    log = np.log(overshoot)
    zeta = float(-log / np.hypot(np.pi, log))
    return SecondOrderShape(zeta, 4.0 / (zeta * settling), gain)


def two_poles_like(system: System) -> SecondOrderShape:
    """The two poles with the overshoot, the settling time and the final value of a system.

    Raises:
        InputError: no step criteria, or no overshoot to take a damping from.
    """
    seen = step_criteria(system)
    return second_order_shape(seen.overshoot, seen.settling_time, seen.final)
