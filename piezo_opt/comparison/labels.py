"""Short names for models side by side: what they have in common is not repeated."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from piezo_opt.effects.model import Model


def labels(models: Sequence[Model]) -> tuple[str, ...]:
    """One name for each model, all different.

    A single model is called by all its effects. Of several, the one whose effects all the others
    have too keeps its full name, and the others are called by what they add to it ("+ creep").
    Equal models are numbered.
    """
    common = [n for n in models[0].names if all(n in model for model in models)]
    found: list[str] = []
    for model in models:
        own = [n for n in model.names if n not in common]
        if len(models) > 1 and own and len(common) > 1:
            found.append("+ " + " + ".join(own))
        else:
            found.append(" + ".join(model.names))
    counts, seen = Counter(found), Counter[str]()
    for k, name in enumerate(found):
        if counts[name] > 1:
            seen[name] += 1
            found[k] = f"{name} (#{seen[name]})"
    return tuple(found)
