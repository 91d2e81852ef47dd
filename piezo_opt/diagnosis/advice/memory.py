"""What the memory of an absent effect adds to a record, wherever it starts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from piezo_opt.diagnosis.advice.gate import gate_of, null_of
from piezo_opt.diagnosis.advice.members import Member
from piezo_opt.diagnosis.base_point import BasePoint
from piezo_opt.identification.unknowns import unknowns
from piezo_opt.simulation import INITIAL, Simulator
from piezo_opt.values import Values

FloatArray = NDArray[np.float64]


def starts_of(
    point: BasePoint, member: Member, shapes: Mapping[str, float]
) -> tuple[FloatArray, ...]:
    """What a member's memory adds from its farthest start, for a gate of one, projected.

    Each (M,) [m]; none for an effect that does not remember.
    """
    effect, question = member.effect, point.question
    if not any(state.remanent for state in effect.declared_states.values()):
        return ()
    model = question.model + effect
    name = model.names[-1]
    gate = f"{name}.{effect.gate}"
    found: list[FloatArray] = []
    before = 0
    for index, record in enumerate(question.campaign.records):
        after = before + int(record.counted.sum())
        numbers = {
            **{f"{name}.{k}": p.nominal for k, p in effect.parameters.items()},
            **point.fit.values.of_record(index),
            **{f"{name}.{k}": v for k, v in {**member.assumed(), **shapes}.items()},
        }
        alone = replace(question.with_model(model), records=record, weights=())
        reach = {
            u.local: u.high
            for u in unknowns(alone, Values(numbers)).members
            if u.local.startswith(f"{INITIAL}{name}.")
        }
        if reach:
            substeps = point.fit.accuracy[index].substeps
            quickest = min(
                (v for k, v in shapes.items() if effect.parameters[k].unit == "s"), default=np.inf
            )
            simulator = Simulator(
                model,
                record,
                numbers,
                directions=tuple(reach),
                runtime=question.free,
                substeps=replace(substeps, longest=min(substeps.longest, quickest)),
            )
            slopes = simulator.with_sensitivities(numbers)[1][record.counted]
            open_by = numbers[gate] - null_of(gate_of(effect))
            for column, far in zip(slopes.T, reach.values(), strict=True):
                whole = np.zeros(point.samples)
                whole[before:after] = column * far / open_by
                if np.isfinite(whole).all():
                    found.append(point.project(whole))
        before = after
    return tuple(found)
