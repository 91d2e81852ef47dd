"""Laws of plays behind a spring: their rate is right from the first moment of a stretch on."""

from __future__ import annotations

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.effects import Effect, Model, Offset, PiezoGain, Spring
from piezo_opt.effects.catalogue import CATALOGUE
from piezo_opt.measurement import FloatArray


@pytest.mark.parametrize(
    "law", [CATALOGUE[n]() for n in ("maxwell_slip", "prandtl_ishlinskii", "preisach")], ids=repr
)
def test_a_spring_without_forces_follows_the_strain(law: Effect) -> None:
    """x = s. The spring moves by the rate of s, which at rest in contact is not that of a turn."""
    time = np.arange(2000) / 1e3
    drive = 50.0 + 50.0 * np.sin(6.0 * np.pi * time) * np.exp(-time)
    record = po.Measurement(time, drive, drive, allow_saturated=True)
    model = PiezoGain() + law + Offset()

    def reading(model: Model) -> FloatArray:
        nominal = {name: p.nominal for name, p in model.parameters.items()}
        return po.simulate(model, record, nominal).reading

    strain = reading(model)
    # What is left is the way to the contact within a sub-step, once a play and turn.
    np.testing.assert_allclose(
        reading(model + Spring()), strain, rtol=0, atol=1e-4 * np.ptp(strain)
    )
