"""A fitted actuator as a linear system around a constant drive."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import casadi as ca
import control
import numpy as np

from piezo_opt.assembly import System, assemble
from piezo_opt.choosing import expected
from piezo_opt.effects import Model
from piezo_opt.errors import ModelError
from piezo_opt.identification import Fit
from piezo_opt.symbolic import one_at_a_time
from piezo_opt.units import quantity
from piezo_opt.values import Values


def linearise(
    plant: Fit | Model,
    values: Mapping[str, float] | None = None,
    *,
    at: float | str = 0.0,
    delay_order: int = 3,
) -> control.StateSpace:
    """Small motions around rest at a constant drive, from the drive [V] to the reading [m].

        x' = A x + B u + E u',   y = C x + D u

    The loop moves with the drive's rate, u'. With z = x - E u that leaves

        z' = A z + (B + A E) u,   y = C z + (D + C E) u

    At u' = 0 the loop has the slope that it has after a reversal, which is that of small signals.
    A state that nothing moves (the loop's own) is left out. A delay becomes a Pade approximation.

    Args:
        plant: a fit, or a model with ``values``.
        values: SI values by full name; those of the fit, or nominal ones, where none are given.
        at: the constant drive, [V] or with a unit.
        delay_order: order of the approximation of a delay.

    Raises:
        ModelError: the model needs channels, or its reading follows the rate of the drive.

    Source: Franklin, Powell & Emami-Naeini (2015), Feedback Control of Dynamic Systems, ch. 9.
    """
    expected((Fit, Model), plant, "The plant", "a fit, or a model with values")
    model = plant.model if isinstance(plant, Fit) else plant
    known = plant.values.of_record(0) if isinstance(plant, Fit) else {}
    numbers = Values.nominal(model).with_({**known, **(values or {})})
    system = assemble(model, {})
    if system.channel_names:
        raise ModelError(
            f"The model needs the channel {system.channel_names[0]}, which a controller does not "
            "have: linearise it without the effect that needs it."
        )
    n, u0 = len(system.state_names), quantity(at, "V")
    p = numbers.vector(system.parameter_names)
    rest = system.start(0.0, u0, np.zeros(0), p, np.zeros(n))
    a, b, e, c, d, f = (np.asarray(one, dtype=float) for one in _slopes(system)(rest, u0, 0.0, p))
    if np.abs(f).max(initial=0.0) > 0.0:
        raise ModelError(
            "The reading of this model follows the rate of the drive at once, which no state-space "
            "system does: leave out the effect that does it, or give it mechanics."
        )
    inner, through = b + a @ e, d + c @ e
    moved = (np.abs(a).max(axis=1, initial=0.0) > 0.0) | (np.abs(inner[:, 0]) > 0.0)
    names = [k for k, own in zip(system.state_names, moved, strict=True) if own]
    linear = control.ss(
        a[np.ix_(moved, moved)], inner[moved], c[:, moved], through,
        states=names, inputs=["drive"], outputs=["reading"],
    )  # fmt: skip
    if system.delay is None:
        return linear
    behind = float(system.delay(p))
    return control.series(control.ss(control.tf(*control.pade(behind, delay_order))), linear)


@lru_cache(maxsize=64)
@one_at_a_time
def _slopes(system: System) -> ca.Function:
    """``(x, u, u', p)`` to the slopes of rate and reading by x, u and u'."""
    x, u, du = ca.SX.sym("x", len(system.state_names)), ca.SX.sym("u"), ca.SX.sym("du")
    p, none = ca.SX.sym("p", len(system.parameter_names)), ca.SX(0, 1)
    rate = system.rate(0.0, x, u, du, none, none, p)
    reading = system.reading(0.0, x, u, du, none, none, p)
    return ca.Function(
        "slopes", [x, u, du, p],
        [ca.jacobian(e, v) for e in (rate, reading) for v in (x, u, du)],
    )  # fmt: skip
