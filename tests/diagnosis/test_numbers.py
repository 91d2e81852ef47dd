"""What counts as a number of a model, and where a record that is cut out of a motion begins."""

from __future__ import annotations

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.diagnosis.rung import numbers
from piezo_opt.effects import AmplifierLag, Effect, SensorLag, SlewLimit
from tests.diagnosis.plants import NOISE, STILL, TRUTH, clock, measured

KNOWN = {name: TRUTH[name] for name in STILL.parameters if name in TRUTH}


@pytest.mark.parametrize(
    ("effect", "own"),
    [
        (AmplifierLag(), {"share": 1.0, "tau": 2e-3}),
        (SensorLag(poles=2), {"share": 1.0, "tau": 2e-3, "ratio": 0.4}),
        (SlewLimit(), {"share": 1.0, "rate": 1000.0, "tau": 1e-3}),
    ],
)
def test_a_record_cut_out_of_a_motion_begins_where_the_lag_was(
    effect: Effect, own: dict[str, float]
) -> None:
    """Else its first samples alone speak against it; where it began is no number of the model."""
    time = clock(1050)
    whole = measured(STILL, time, 30.0 - 30.0 * np.cos(2.0 * np.pi * 8.0 * time), (effect, own))
    inside = slice(50, None)
    cut = po.Measurement(
        time[inside], whole.drive[inside], whole.position[inside], allow_saturated=True
    )
    name = effect.name
    start = {**KNOWN, **{f"{name}.{k}": v for k, v in own.items()}}
    fit = po.solve(po.Identification(STILL + effect, cut), start=start)
    assert fit.rms == pytest.approx(NOISE, rel=0.1)
    begins = [n for n in fit.names if n.startswith(f"initial.{name}.")]
    assert len(begins) == sum(effect.states.values())
    assert numbers(fit) == len(fit.names) - len(begins)
    held = po.Identification(STILL + effect, cut, fixed=dict.fromkeys(begins, 0.0))
    assert po.solve(held, start=start).rms > 1.5 * NOISE
