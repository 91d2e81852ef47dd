"""What is assumed of an absent effect: its shapes, and the size of its gate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from piezo_opt.diagnosis.advice.gate import allowed, gate_of, null_of
from piezo_opt.diagnosis.base_point import BasePoint
from piezo_opt.effects.base import Effect, Parameter
from piezo_opt.identification.unknowns import limits
from piezo_opt.measurement import Measurement


@final
@dataclass(frozen=True, eq=False)
class Member:
    """An absent effect with the shapes and the size that are assumed of it.

    ``size`` counts from the gate's null; ``grid`` are the shapes that it may take instead.
    """

    effect: Effect
    shapes: Mapping[str, float]
    size: float
    grid: tuple[Mapping[str, float], ...]

    def assumed(self) -> dict[str, float]:
        """Own parameters by name, the gate among them."""
        gate = gate_of(self.effect)
        return {**self.shapes, self.effect.gate or "": null_of(gate) + self.size}


def sized(point: BasePoint, group: Sequence[Effect]) -> list[Member]:
    """Members of a group at their best shapes, each as large as the best of them explains."""
    drafts: list[tuple[Member, float, float]] = []
    for member in typical(point, group, variants=True):
        best, best_gain, best_length = member, -1.0, 0.0
        for d in point.directions(member.effect, member.grid):
            length = float(np.linalg.norm(d.projected))
            if length <= 1e-9 * float(np.linalg.norm(d.whole)):
                continue
            along = float(d.projected @ point.residual)
            gain = abs(along) / length if allowed(member.effect, along) else 0.0
            if gain > best_gain:
                way = float(np.sign(along)) if gain > 0.0 else float(np.sign(member.size))
                best_gain, best_length = gain, length
                best = replace(member, shapes=d.shapes, size=way)
        drafts.append((best, best_gain, best_length))
    explained = max(gain for _, gain, _ in drafts)
    if explained <= 0.0:
        explained = float(np.linalg.norm(point.residual))
    members = []
    for member, _, length in drafts:
        if length == 0.0:
            members.append(member)
            continue
        gate = gate_of(member.effect)
        size = float(np.clip(null_of(gate) + member.size * explained / length, *gate.bounds))
        members.append(replace(member, size=size - null_of(gate)))
    return members


def typical(point: BasePoint, effects: Sequence[Effect], *, variants: bool = False) -> list[Member]:
    """Effects that the model can take, in the middle of their typical ranges.

    Variants of one name stand for each other unless all ``variants`` are asked for.
    """
    channels = tuple(point.question.campaign.records[0].channels)
    members: dict[tuple[object, ...], Member] = {}
    for effect in effects:
        key = (effect.name, *effect.options.items()) if variants else (effect.name,)
        taken = effect.name in point.question.model or key in members
        if taken or point.question.model.refusal(effect, channels) is not None:
            continue
        gate = gate_of(effect)
        try:
            grid = tuple(point.grid(effect))
        except Exception:
            # A user's effect may raise whatever it likes; the scores have reported it.
            continue

        def distance(shapes: Mapping[str, float], effect: Effect = effect) -> float:
            return sum(
                abs(_middle(effect.parameters[name]) - value) / effect.parameters[name].scale
                if min(value, _middle(effect.parameters[name])) <= 0.0
                else abs(float(np.log(value / _middle(effect.parameters[name]))))
                for name, value in shapes.items()
            )

        size = _middle(gate) - null_of(gate)
        if size == 0.0:
            size = gate.scale
        wide = (*grid, *_slower(effect, grid, point.question.campaign.records))
        members[key] = Member(effect, min(grid, key=distance), size, wide)
    return list(members.values())


def _slower(
    effect: Effect, grid: Sequence[Mapping[str, float]], records: tuple[Measurement, ...]
) -> list[dict[str, float]]:
    """Points beyond a grid of shapes: a refit may stretch a time constant past the record."""
    found: list[dict[str, float]] = []
    for name in grid[0]:
        if effect.parameters[name].unit != "s":
            continue
        longest = max(shapes[name] for shapes in grid)
        last = next(shapes for shapes in grid if shapes[name] == longest)
        _, high = limits(effect.parameters[name], records)
        found += [{**last, name: longest * k} for k in (3.0, 10.0) if longest * k <= 1.001 * high]
    return found


def _middle(parameter: Parameter) -> float:
    """The middle of the typical range: geometric where it has one sign, else half its end."""
    low, high = parameter.typical or (parameter.nominal, parameter.nominal)
    if low * high > 0.0:
        return float(np.sign(low) * np.sqrt(low * high))
    return 0.5 * max(low, high, key=abs)
