"""Laws of plays behind a spring: their rate is right from the first moment of a stretch on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.assembly import assemble
from piezo_opt.effects import Effect, Model, Offset, PiezoGain, Spring
from piezo_opt.effects.base import Chain, Equations, Parameter, Place
from piezo_opt.effects.catalogue import CATALOGUE
from piezo_opt.measurement import FloatArray
from piezo_opt.simulation import Simulator

LAWS = [CATALOGUE[name]() for name in ("maxwell_slip", "prandtl_ishlinskii", "preisach")]


@final
@dataclass(frozen=True)
class Added(Effect):
    """A recorded voltage that adds to the drive.

    v = u + gain c
    """

    place = Place.INPUT
    requires = ("channel:added",)
    gain = Parameter("1", "gain", nominal=0.0, null=0.0)

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The outgoing drive."""
        return Equations(gives=chain.incoming.value + p.gain * chain.channels["added"].value)


@pytest.mark.parametrize("law", LAWS, ids=repr)
def test_a_spring_without_forces_follows_the_strain(law: Effect) -> None:
    """x = s. The spring moves by the rate of s, which at rest in contact is not that of a turn, and
    what that misses is made good at once: it takes no sub-steps that the law does not."""
    time = np.arange(2000) / 1e3
    drive = 50.0 + 50.0 * np.sin(6.0 * np.pi * time) * np.exp(-time)
    record = po.Measurement(time, drive, drive, allow_saturated=True)
    model = PiezoGain() + law + Offset()

    def simulator(model: Model) -> tuple[FloatArray, float]:
        nominal = {name: p.nominal for name, p in model.parameters.items()}
        chosen = Simulator(model, record, nominal).choose(nominal, 1e-6)
        return po.simulate(model, record, nominal).reading, chosen.per_sample

    strain, steps = simulator(model)
    reading, more = simulator(model + Spring())
    np.testing.assert_allclose(reading, strain, rtol=0, atol=1e-12 * np.ptp(strain))
    assert more == steps


@pytest.mark.parametrize("law", LAWS, ids=repr)
def test_a_channel_upstream_of_plays_is_no_obstacle(law: Effect) -> None:
    """The drive's rate is then that of the channel as well; what the plays become needs none."""
    time = np.arange(400) / 1e3
    drive = 50.0 - 50.0 * np.cos(6.0 * np.pi * time)
    warmer = 10.0 * time / time[-1]
    record = po.Measurement(time, drive, drive, channels={"added": warmer}, allow_saturated=True)
    model = PiezoGain() + law + Offset()
    nominal = {name: p.nominal for name, p in model.parameters.items()}
    values = {**nominal, "added.gain": 1.0}
    added = po.simulate(model + Added(), record, values).reading
    behind = model + Added() + Spring()
    for compiled in (True, False):
        run = Simulator(behind, record, values, prefer_compiled=compiled)
        reading = run.reading({**values, "spring.omega": 1e3})
        np.testing.assert_allclose(reading, added, rtol=0, atol=1e-12 * np.ptp(added))
    summed = po.Measurement(time, drive + warmer, drive, allow_saturated=True)
    expected = po.simulate(model, summed, nominal).reading
    np.testing.assert_allclose(added, expected, rtol=0, atol=1e-9 * np.ptp(expected))
    assert assemble(model + Added()).becomes is not None
