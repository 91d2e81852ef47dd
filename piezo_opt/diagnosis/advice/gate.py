"""The gate of an absent effect: where it opens from, and which way it may."""

from __future__ import annotations

from piezo_opt.effects.base import Effect, Parameter


def gate_of(effect: Effect) -> Parameter:
    """The parameter at whose null value the effect vanishes."""
    return effect.parameters[effect.gate or ""]


def null_of(gate: Parameter) -> float:
    """The value at which a gate is closed [its unit]."""
    return gate.null if gate.null is not None else 0.0


def allowed(effect: Effect, way: float) -> bool:
    """Whether a one-sided gate may move this way from its null."""
    gate = gate_of(effect)
    null = null_of(gate)
    return (way > 0.0 and gate.bounds[1] > null) or (way < 0.0 and gate.bounds[0] < null)
