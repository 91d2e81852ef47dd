"""What a data sheet expects, as priors of a fit."""

from __future__ import annotations

from collections.abc import Mapping

from piezo_opt.choosing import expected as required
from piezo_opt.effects.model import Model
from piezo_opt.identification.problem import Prior
from piezo_opt.physics import Expected


def priors_from(expected: Mapping[str, Expected], model: Model) -> dict[str, Prior]:
    """Priors for those parameters that the model has, by full name.

    Args:
        expected: for instance ``Stack(...).expected(tolerance=0.2)``.
        model: others' names are left out.
    """
    required(Mapping, expected, "expected", "what Stack(...).expected() returns")
    required(Model, model, "The model", "a sum of effects")
    return {
        name: Prior(known.value, known.std)
        for name, known in expected.items()
        if name in model.parameters
    }
