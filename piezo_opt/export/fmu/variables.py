"""The variables of a unit: one list, from which its description and its code are written."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, final

from piezo_opt.export.c.plan import Plan

PARAMETER: Final = "parameter"
INPUT: Final = "input"
OUTPUT: Final = "output"
STATE: Final = "state"
RATE: Final = "rate"
READING: Final = "reading"


@final
@dataclass(frozen=True)
class Variable:
    """One variable.

    Attributes:
        reference: its value reference.
        name: as tools show it.
        role: parameter, input, output, state, or the rate of a state.
        unit: SI unit.
        meaning: in a few words.
        start: value at the start; None where it is calculated.
        place: where it stands in the struct of the C code; "" where it is computed.
        of: of a rate the reference of its state.
    """

    reference: int
    name: str
    role: str
    unit: str
    meaning: str
    start: float | None
    place: str
    of: int = 0


def variables(plan: Plan, exchange: bool) -> tuple[Variable, ...]:
    """All variables of a unit in order; reference 0 is the time.

    Args:
        plan: the equations.
        exchange: whether an importer integrates the states, so that it must be told their rates
            and tell the rate of every input.
    """
    found: list[Variable] = []

    def add(
        name: str, role: str, unit: str, meaning: str, start: float | None, place: str, of: int = 0
    ) -> int:
        reference = len(found) + 1
        found.append(Variable(reference, name, role, unit, meaning, start, place, of))
        return reference

    for one in plan.parameters:
        value = plan.given.values[one.full]
        add(one.full, PARAMETER, one.unit, one.meaning, value, f"one.parameters.{one.name}")
    channel_units = {} if plan.given.record is None else plan.given.record.channel_units
    inputs = [(plan.input, "V", "what is applied", 0.0)]
    for full, name in zip(plan.system.channel_names, plan.channels, strict=True):
        kelvin = full == "temperature"
        unit = "K" if kelvin else channel_units.get(full, "1")
        inputs.append((name, unit, "further input", 293.15 if kelvin else 0.0))
    for name, unit, meaning, start in inputs:
        add(name, INPUT, unit, meaning, start, f"one.{name}" if exchange else f"wanted.{name}")
        if exchange:
            per = "1/s" if unit == "1" else f"{unit}/s"
            add(f"{name}_rate", INPUT, per, f"rate of {name}", 0.0, f"one.{name}_rate")
    add(READING, OUTPUT, "m", "what the sensor reads", None, "")
    for one in plan.states:
        for k, element in enumerate(one.elements):
            full = one.full if one.size is None else f"{one.full}[{k + 1}]"
            place = f"one.states.{element}"
            state = add(full, STATE, one.unit, one.meaning, None, place)
            if exchange and one in plan.flowing:
                name = f"der({full})"
                add(name, RATE, f"{one.unit}/s", f"rate of {full}", None, f"k.{element}", state)
    return tuple(found)
