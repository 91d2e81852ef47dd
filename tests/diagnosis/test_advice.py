"""An advised experiment yields what was promised."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.diagnosis.advice import reveal, split, write_drives
from piezo_opt.diagnosis.diagnose import Diagnosis, diagnose
from piezo_opt.effects import (
    AmplifierLag,
    Creep,
    Delay,
    Drift,
    Effect,
    Load,
    Model,
    SecondMode,
    SensorLag,
)
from piezo_opt.errors import InputError
from piezo_opt.signals import Drive
from piezo_opt.signals.answer import Answer
from tests.diagnosis.plants import MOVING, NOISE, STILL, clock, fitted, measured, rich, sine


def alternatives(base: Model, record: po.Measurement, *group: Effect) -> dict[str, po.Fit]:
    """A fit with each effect of a group."""
    first = fitted(base, record)
    return {e.name: po.solve(po.Identification(base + e, record), start=first) for e in group}


def played(drive: Drive, position: np.ndarray) -> po.Measurement:
    return po.Measurement(drive.time, drive.values, position, name="new", allow_saturated=True)


@pytest.fixture(scope="module")
def lagging() -> po.Fit:
    """A sine of 5 Hz through an amplifier that lags by 2 ms, fitted without the lag."""
    time = clock()
    hidden = AmplifierLag(), {"share": 1.0, "tau": 2e-3}
    return fitted(MOVING, measured(MOVING, time, sine(time), hidden))


def test_lags_alike_on_a_sine_are_split_by_something_fast(lagging: po.Fit) -> None:
    alike = alternatives(MOVING, lagging.records[0], AmplifierLag(), Delay())
    told = split(alike, NOISE)
    assert told.group == ("amplifier_lag", "delay")
    assert told.here < 2.0
    assert told.sigmas > 5.0
    fastest = np.abs(np.diff(told.drive.values)).max()
    assert fastest > 5.0 * np.abs(np.diff(lagging.records[0].drive)).max()
    lag = told.assumed["amplifier_lag"]
    assert lag["share"] * lag["tau"] == pytest.approx(2e-3, rel=0.05)
    assert told.drive.description in told.sentence
    assert f"this record separates them by {told.here:.1f}." in told.sentence


def test_the_separation_is_what_the_rivals_refit_leaves() -> None:
    """Played without noise, the rival's fit to both records leaves the promised sigmas more."""
    time = clock()
    hidden = Creep(elements=1), {"c": 0.02, "tau": 0.6}
    record = measured(STILL, time, sine(time), hidden)
    alike = alternatives(STILL, record, Creep(elements=1), Drift())
    advice = split(alike, NOISE)
    left = {}
    for true, rival in (("creep", "drift"), ("drift", "creep")):
        reading = Answer(alike[true], 1000.0).sharp(advice.drive.values)
        both = (record, played(advice.drive, reading))
        again = po.solve(po.Identification(alike[rival].model, both), start=alike[rival])
        more = np.sum(np.square(again.residuals)) - np.sum(np.square(alike[rival].residuals))
        left[true] = float(np.sqrt(more)) / NOISE
    assert advice.sigmas == pytest.approx(min(left.values()), rel=0.05)
    assert advice.sigmas > 5.0


def test_a_group_that_is_one_and_the_same_is_not_separated_by_a_promise() -> None:
    """Of a quasi-static chain, creep of one element *is* a sensor lag of a small share."""
    time = clock()
    hidden = Creep(elements=1), {"c": 0.02, "tau": 0.1}
    record = measured(STILL, time, rich(time), hidden)
    advice = split(alternatives(STILL, record, SensorLag(), Creep(elements=1)), NOISE)
    assert advice.group == ("sensor_lag", "creep")
    assert advice.here < 5.0
    assert advice.sigmas < 5.0
    assert "longer" in advice.sentence


def test_the_detectable_size_stands_out_by_five_sigmas() -> None:
    """Played at that size without noise, the base model's refit leaves 5 times the noise."""
    time = clock()
    base = fitted(MOVING, measured(MOVING, time, sine(time)))
    (advice,), never = reveal(base, [SecondMode(), Load()], NOISE)
    assert advice.group == ("second_mode",)
    assert never == ("load",)
    assert advice.here < 5.0 < advice.sigmas
    own = {**advice.assumed["second_mode"], "g": advice.detectable["second_mode"]}
    drive = advice.drive
    seen = fitted(
        MOVING, measured(MOVING, drive.time, drive.values, (SecondMode(), own), noise=0.0)
    )
    assert float(np.linalg.norm(seen.residuals)) / NOISE == pytest.approx(5.0, rel=0.05)
    assert f"second_mode from g = {own['g']:.4g}" in advice.sentence


def test_what_is_seen_already_is_not_advised() -> None:
    time = clock()
    base = fitted(STILL, measured(STILL, time, rich(time)))
    assert reveal(base, [Creep(elements=1)], NOISE) == ((), ())


def test_senseless_questions_are_refused(lagging: po.Fit) -> None:
    with pytest.raises(InputError, match="one model has nothing to be told apart from"):
        split({"delay": lagging}, NOISE)
    with pytest.raises(InputError, match="noise is 0 m"):
        split({"delay": lagging, "sensor_lag": lagging}, 0.0)
    with pytest.raises(InputError, match="noise is -1 m"):
        reveal(lagging, [Delay()], -1.0)


@pytest.fixture(scope="module")
def blind() -> Diagnosis:
    """A sine of 5 Hz on a plant with a second mode at 150 Hz, which it does not excite."""
    time = clock()
    hidden = SecondMode(), {"g": 0.02, "omega": 2.0 * np.pi * 150.0, "zeta": 0.02}
    return diagnose(fitted(MOVING, measured(MOVING, time, sine(time), hidden)))


def test_a_sine_of_5_hz_names_nothing_and_says_what_to_measure(blind: Diagnosis) -> None:
    assert blind.verdict == "complete"
    assert blind.steps == ()
    shown = [e for e in blind.experiments if "second_mode" in e.group]
    assert len(shown) == 1
    assert shown[0].detectable["second_mode"] < 0.02
    assert "load" in blind.invisible
    sentences = " ".join(blind.advice)
    assert "This record could not show" in sentences
    assert shown[0].drive.description in sentences
    never = f"No usual drive would show {', '.join(blind.invisible)} of a usual size"
    assert never in sentences


def test_the_advised_drive_finds_what_the_sine_hid(blind: Diagnosis) -> None:
    (advice,) = (e for e in blind.experiments if "second_mode" in e.group)
    at, volts = advice.drive.time, advice.drive.values
    hidden = SecondMode(), {"g": 0.02, "omega": 2.0 * np.pi * 150.0, "zeta": 0.02}
    again = diagnose(fitted(MOVING, measured(MOVING, at, volts, hidden)), ladder=False)
    assert again.best().name == "second_mode"


def test_a_group_gets_the_drive_that_splits_it(lagging: po.Fit) -> None:
    found = diagnose(lagging)
    assert len(found.steps) == 1
    assert {"amplifier_lag", "delay"} <= set(found.steps[0].group)
    (advice,) = found.experiments
    assert set(advice.group) == set(found.steps[0].group)
    assert advice.sigmas > 3.0 * max(1.0, advice.here)
    assert found.to_dict()["experiments"][0]["file"] == f"{advice.drive.name}.csv"


def test_experiments_are_written_as_files(blind: Diagnosis, tmp_path: Path) -> None:
    files = write_drives(blind.experiments, tmp_path)
    assert [f.name for f in files] == [f"{e.drive.name}.csv" for e in blind.experiments]
    header = files[0].read_text().splitlines()[1]
    assert header == "time [s],voltage [V]"
    with pytest.raises(InputError, match="exists already"):
        write_drives(blind.experiments, tmp_path)
    with pytest.raises(InputError, match="no such directory"):
        write_drives(blind.experiments, tmp_path / "nowhere")
