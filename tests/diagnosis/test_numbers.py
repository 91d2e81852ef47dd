"""What counts as a number of a model, and where a record that is cut out of a motion begins."""

from __future__ import annotations

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.diagnosis import diagnose
from piezo_opt.diagnosis.evidence import numbers
from piezo_opt.effects import AmplifierLag, Creep, Effect, SensorLag, SlewLimit
from tests.diagnosis.plants import MOVING, NOISE, STILL, TRUTH, but, clock, fitted, measured, rich

KNOWN = {name: TRUTH[name] for name in STILL.parameters if name in TRUTH}


@pytest.mark.parametrize(
    ("effect", "own"),
    [
        (AmplifierLag(), {"share": 1.0, "tau": 2e-3}),
        (SensorLag(poles=2), {"share": 1.0, "tau": 1.3e-3, "zeta": 1.1}),
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


def test_behind_mechanics_a_lag_begins_where_it_was_too() -> None:
    """What lags before them they take up, wherever they begin; what lags behind them they cannot.

    Nor may a lag before them begin anywhere: it would always beat a delay.
    """
    time, inside = clock(1050), slice(50, None)
    own = {"share": 1.0, "tau": 2e-3}
    drive = 30.0 - 30.0 * np.cos(2.0 * np.pi * (45.0 - 19.0 * time) * time)
    whole = measured(MOVING, time, drive, (SensorLag(), own))
    cut = po.Measurement(
        time[inside], whole.drive[inside], whole.position[inside], allow_saturated=True
    )
    known = {name: TRUTH[name] for name in MOVING.parameters if name in TRUTH}
    start = {**known, **{f"sensor_lag.{k}": v for k, v in own.items()}}
    fit = po.solve(po.Identification(MOVING + SensorLag(), cut), start=start)
    assert fit.rms == pytest.approx(NOISE, rel=0.1)
    assert numbers(fit) == len(fit.names) - 1
    held = po.Identification(MOVING + SensorLag(), cut, fixed={"initial.sensor_lag.z": 0.0})
    assert po.solve(held, start=start).rms > 2.0 * NOISE
    before = po.solve(po.Identification(MOVING + AmplifierLag(), cut))
    assert not any("amplifier_lag.z" in name for name in before.names)


def test_creep_begins_anywhere_in_the_displacement_and_not_within_a_part_of_the_stroke() -> None:
    """Held at 100 V for ten time constants its elements have followed three strokes."""
    time, still = clock(4000), 2000
    moving = 100.0 + 0.5 * rich(time)
    drive = np.concatenate([np.full(still, moving[0]), moving])
    hidden = Creep(elements=1), {"c": 0.05, "tau": 0.2}
    whole = measured(STILL, clock(6000), drive, hidden).position[still:]
    record = po.Measurement(time, moving, whole, allow_saturated=True)
    fit = po.solve(po.Identification(STILL + hidden[0], record), start={**KNOWN, "creep.c": 0.03})
    assert fit.rms == pytest.approx(NOISE, rel=0.05)
    assert fit.values["creep.c"] == pytest.approx(0.05, rel=0.2)
    assert fit.values["initial.creep.z"] > 2.0 * np.ptp(record.position)
    found = diagnose(fitted(STILL, record), withhold=but("creep", "drift", "sensor_lag"))
    assert [step.name for step in found.steps] == ["creep"]
    assert found.verdict == "missing"
