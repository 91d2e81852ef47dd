"""The ladder as it is told: an error after each thing that changed the model."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from piezo_opt.diagnosis.told import Step
from piezo_opt.effects.model import Model


@final
@dataclass(frozen=True)
class Point:
    """One point of a ladder.

    Attributes:
        label: what was done.
        rms: error on the fitted records after it [m].
        held_out: error on the held-out record after it [m], None where that is not known.
        delta_bic: by how much BIC fell, None where it was not for an effect.
    """

    label: str
    rms: float
    held_out: float | None = None
    delta_bic: float | None = None


def points(
    foot: Point, steps: Sequence[Step], final: Point, base: Model, model: Model,
    refined: Sequence[str],
) -> tuple[Point, ...]:  # fmt: skip
    """The ladder from its foot up; empty where nothing changed the model.

    What changed the model without being an effect of its own (mechanics that joined, another
    hysteresis law, an exponent freed, an effect given another shape) is a point of its own; details
    of an effect that was added came with it.

    Args:
        foot: the baseline.
        steps: effects of the answer.
        final: the error of the final model.
        base: the model at the foot.
        model: the final model.
        refined: what was needed in more detail.
    """
    joined = {name for name, effect in model if effect.structural and name not in base}
    own = {s.name: [k for k in refined if k.startswith(f"{s.name}.")] for s in steps}
    alone = [k for k in refined if k.split(".")[0] not in own]
    ways = _in_detail([*sorted(joined - set(refined)), *alone], joined)
    between = ", ".join(ways) or "reshaped"
    found = [foot]
    for step in steps:
        if not _same(step.rms_before, found[-1].rms):
            found.append(Point(between, step.rms_before, step.held_out_before))
        label = f"+ {_with_details(step.name, own[step.name])}"
        found.append(Point(label, step.rms_after, step.held_out_after, step.delta_bic))
    if not _same(final.rms, found[-1].rms):
        found.append(Point(between, final.rms, final.held_out))
    return tuple(found) if len(found) > 1 else ()


def _in_detail(refined: Sequence[str], joined: Collection[str]) -> list[str]:
    """Refinements in few words: "n free", "mains_pickup in detail", "with second_order"."""
    own: dict[str, list[str]] = {}
    for name in refined:
        effect, _, parameter = name.partition(".")
        own.setdefault(effect, []).extend([parameter] * bool(parameter))
    return [
        f"with {effect}" if effect in joined
        else f"{freed[0]} free" if len(freed) == 1 else f"{effect} in detail"
        for effect, freed in own.items()
    ]  # fmt: skip


def _with_details(name: str, details: Sequence[str]) -> str:
    if not details:
        return name
    return f"{name}, {details[0].split('.')[1]} free" if len(details) == 1 else f"{name} in detail"


def _same(one: float, other: float) -> bool:
    return bool(np.isclose(one, other, rtol=1e-6, atol=0.0))
