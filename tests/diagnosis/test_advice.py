"""Drives are what they say, and an advised experiment yields what was promised."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.diagnosis.advice import Advice, advise, reveal, write_drives
from piezo_opt.diagnosis.diagnose import Diagnosis, diagnose
from piezo_opt.diagnosis.drives import (
    Chirp,
    Excitation,
    Multisine,
    Sine,
    Staircase,
    StepAndHold,
    Triangle,
    candidate_drives,
)
from piezo_opt.effects import AmplifierLag, Creep, Delay, Drift, Load, SecondMode, SensorLag
from piezo_opt.errors import InputError
from tests.diagnosis.plants import MOVING, NOISE, STILL, clock, fitted, measured, rich, sine

RATE = 1000.0


def still_seconds(drive: Excitation) -> float:
    _, volts = drive.samples(RATE)
    return float(np.count_nonzero(np.diff(volts) == 0.0)) / RATE


def dominant(volts: np.ndarray) -> float:
    spectrum = np.abs(np.fft.rfft(volts - volts.mean()))
    return float(np.argmax(spectrum)) * RATE / volts.size


def test_a_sine() -> None:
    drive = Sine(0.0, 60.0, 4.0, 5.0)
    time, volts = drive.samples(RATE)
    assert drive.description == "sine 0..60 V, 5 Hz, 4 s"
    assert time.size == 4000
    assert dominant(volts) == 5.0
    assert (volts[0], volts.min(), volts.max()) == (0.0, 0.0, pytest.approx(60.0))


def test_a_multisine_has_its_power_on_its_lines() -> None:
    drive = Multisine(-10.0, 50.0, 4.0, 1.0, 100.0, lines=20)
    _, volts = drive.samples(RATE)
    assert (volts.min(), volts.max()) == pytest.approx((-10.0, 50.0))
    power = np.abs(np.fft.rfft(volts)[1:]) ** 2
    lines = np.flatnonzero(power > 1e-9 * power.max()) + 1
    assert drive.description == "multisine -10..50 V, 20 lines from 1 to 100 Hz, 4 s"
    assert lines.size == 20
    assert (lines[0] / 4.0, lines[-1] / 4.0) == (1.0, 100.0)
    assert power[lines - 1].max() == pytest.approx(power[lines - 1].min(), rel=1e-6)


def test_a_triangle_holds_and_has_minor_loops() -> None:
    drive = Triangle(0.0, 60.0, 8.0, 1.0, 1.0)
    time, volts = drive.samples(RATE)
    assert drive.description == "triangle 0..60 V with minor loops, 1 Hz, 1 s holds, 8 s"
    slope = np.abs(np.diff(volts)) * RATE
    assert slope[slope > 1.0] == pytest.approx(120.0, rel=1e-6)
    assert np.interp([0.5, 1.5, 1.75, 1.875, 2.25, 3.25, 3.5], time, volts) == pytest.approx(
        [60.0, 60.0, 30.0, 45.0, 0.0, 0.0, 30.0]
    )
    assert still_seconds(drive) == pytest.approx(5.0, abs=0.01)


def test_a_step_and_a_staircase() -> None:
    step = StepAndHold(0.0, 60.0, 2.0, 0.25)
    _, volts = step.samples(RATE)
    assert step.description == "step and hold of 60 V (0..60 V) after 250 ms, held 1.75 s"
    assert np.flatnonzero(np.diff(volts)).tolist() == [249]
    stairs = Staircase(0.0, 60.0, 2.0, (0.0, 0.5, 1.0, 0.25))
    _, volts = stairs.samples(RATE)
    assert volts[[0, 499, 500, 999, 1000, 1500, 1999]].tolist() == [0, 0, 30, 30, 60, 15, 15]


def test_a_chirp_goes_from_one_frequency_to_the_other() -> None:
    drive = Chirp(15.0, 45.0, 8.0, 1.0, 64.0)
    _, volts = drive.samples(RATE)
    falls = np.flatnonzero((volts[:-1] - 30.0 < 0) & (volts[1:] - 30.0 >= 0)) / RATE
    # (64 - 1) / (ln 64 / 8 s) cycles in all; one octave every 8/6 s.
    assert falls.size == pytest.approx(63.0 * 8.0 / np.log(64.0), abs=1.0)
    assert 1.0 / np.mean(np.diff(falls)[-8:]) == pytest.approx(61.0, rel=0.05)
    middle = falls[np.abs(falls - 4.0) < 0.3]
    assert 1.0 / np.mean(np.diff(middle)) == pytest.approx(8.0, rel=0.05)


def test_candidates_keep_to_the_range_and_the_time_of_the_record() -> None:
    time = clock()
    record = po.Measurement(time, 20.0 + 0.5 * sine(time), 1e-7 * time, allow_saturated=True)
    drives = candidate_drives(record, resonance=60.0)
    assert {d.kind for d in drives} == {
        "sine", "multisine", "triangle", "step and hold", "staircase", "chirp",
    }  # fmt: skip
    assert len({d.name for d in drives}) == len(drives)
    for drive in drives:
        _, volts = drive.samples(record.rate)
        assert volts.size == time.size
        assert volts.min() >= 20.0
        assert volts.max() <= 50.0
        assert np.ptp(volts) > 14.0
    chirp = next(d for d in drives if isinstance(d, Chirp))
    assert chirp.highest > 60.0
    assert max(d.frequency for d in drives if isinstance(d, Sine)) <= 20.0


def test_a_drive_file_is_written_whole_and_never_over_another(tmp_path: Path) -> None:
    drive, file = Sine(0.0, 60.0, 0.5, 4.0), tmp_path / "sine.csv"
    drive.write(file, RATE)
    lines = file.read_text().splitlines()
    assert lines[:2] == ["# sine 0..60 V, 4 Hz, 500 ms", "time [s],voltage [V]"]
    assert np.loadtxt(lines[2:], delimiter=",") == pytest.approx(np.array(drive.samples(RATE)).T)
    with pytest.raises(InputError, match="exists already"):
        Sine(0.0, 10.0, 0.5, 4.0).write(file, RATE)
    assert file.read_text().splitlines() == lines
    Sine(0.0, 10.0, 0.5, 4.0).write(file, RATE, overwrite=True)
    assert file.read_text().splitlines()[0] == "# sine 0..10 V, 4 Hz, 500 ms"
    assert [p.name for p in tmp_path.iterdir()] == ["sine.csv"]


def test_a_force_is_not_written_as_a_voltage(tmp_path: Path) -> None:
    drive = Sine(0.0, 6.0, 0.5, 4.0, unit="N")
    assert drive.description == "sine 0..6 N, 4 Hz, 500 ms"
    drive.write(tmp_path / "force.csv", RATE)
    assert (tmp_path / "force.csv").read_text().splitlines()[1] == "time [s],drive [N]"


def test_drives_that_make_no_sense_are_refused() -> None:
    with pytest.raises(InputError, match=r"sine: a drive from 60 to 0 V does not move"):
        Sine(60.0, 0.0, 1.0, 5.0)
    with pytest.raises(InputError, match="lasts 0 s"):
        StepAndHold(0.0, 60.0, 0.0, 0.0)
    with pytest.raises(InputError, match="5 samples"):
        Sine(0.0, 60.0, 1.0, 1.0).samples(5.0)


@pytest.fixture(scope="module")
def lagging() -> po.Fit:
    """A sine of 5 Hz through an amplifier that lags by 2 ms, fitted without the lag."""
    time = clock()
    hidden = AmplifierLag(), {"share": 1.0, "tau": 2e-3}
    return fitted(MOVING, measured(MOVING, time, sine(time), hidden))


@pytest.fixture(scope="module")
def split(lagging: po.Fit) -> Advice:
    return advise(lagging, [AmplifierLag(), Delay(), SensorLag()], NOISE)


def test_lags_alike_on_a_sine_are_split_by_something_fast(split: Advice) -> None:
    assert split.group == ("amplifier_lag", "delay", "sensor_lag")
    assert split.here < 1.0
    assert split.sigmas > 5.0
    assert split.drive.kind in ("chirp", "multisine", "staircase", "step and hold")
    sigmas = [t.sigmas for t in split.trials]
    assert sigmas == sorted(sigmas, reverse=True)
    assert len(sigmas) == 8
    slow = [t.sigmas for t in split.trials if isinstance(t.drive, Sine) and t.drive.frequency < 5]
    assert max(slow) < 0.1 * split.sigmas
    assert split.drive.description in split.sentence
    assert f"this record separates them by {split.here:.1f}." in split.sentence


@pytest.mark.parametrize(
    "drive", [Triangle(0.0, 60.0, 2.0, 2.0, 0.25), StepAndHold(0.0, 60.0, 2.0, 0.3)]
)
def test_the_separation_is_what_the_rivals_refit_leaves(drive: Excitation) -> None:
    """Played without noise, the rival's best fit leaves the promised sigmas times the noise."""
    time = clock()
    hidden = Creep(elements=1), {"c": 0.02, "tau": 0.6}
    base = fitted(STILL, measured(STILL, time, rich(time), hidden))
    advice = advise(base, [Creep(elements=1), Drift()], NOISE, drives=[drive])
    # A creep that began long before the record looks most like a drift.
    assert advice.trials[0].hardest == ("drift", "creep")
    at, volts = drive.samples(RATE)

    def left(true: str, rival: str, **start: float) -> float:
        effects = {"creep": Creep(elements=1), "drift": Drift()}
        played = measured(STILL, at, volts, (effects[true], advice.assumed[true]), noise=0.0)
        own = {**advice.assumed[rival], **start}
        fit = po.solve(
            po.Identification(STILL + effects[rival], played),
            start={**base.values, **{f"{rival}.{k}": v for k, v in own.items()}},
        )
        return float(np.linalg.norm(fit.residuals)) / NOISE

    # The promise is a straight line's; bent, the rival comes a fifth nearer along its start.
    assert 0.75 * advice.sigmas < left("drift", "creep", tau=3.0) < 1.06 * advice.sigmas
    assert left("creep", "drift") > advice.sigmas
    assert left("creep", "creep") < 0.1 * advice.sigmas


def test_a_group_that_is_one_and_the_same_is_not_separated_by_a_promise() -> None:
    """Of a quasi-static chain, creep of one element *is* a sensor lag of a small share."""
    time = clock()
    hidden = Creep(elements=1), {"c": 0.02, "tau": 0.1}
    base = fitted(STILL, measured(STILL, time, rich(time), hidden))
    advice = advise(base, [SensorLag(), Creep(elements=3), Creep(elements=1)], NOISE)
    assert advice.group == ("sensor_lag", "creep")
    assert advice.here < 5.0
    assert advice.sigmas < 5.0


def test_the_detectable_size_stands_out_by_five_sigmas() -> None:
    """Played at that size without noise, the base model's refit leaves 5 times the noise."""
    time = clock()
    base = fitted(MOVING, measured(MOVING, time, sine(time)))
    (advice,), never = reveal(base, [SecondMode(), Load()], NOISE)
    assert advice.group == ("second_mode",)
    assert never == ("load",)
    assert advice.here < 5.0 < advice.sigmas
    own = {**advice.assumed["second_mode"], "g": advice.detectable["second_mode"]}
    at, volts = advice.drive.samples(advice.rate)
    seen = fitted(MOVING, measured(MOVING, at, volts, (SecondMode(), own), noise=0.0))
    assert float(np.linalg.norm(seen.residuals)) / NOISE == pytest.approx(5.0, rel=0.05)
    assert f"second_mode from g = {own['g']:.4g}" in advice.sentence


def test_what_is_seen_already_is_not_advised() -> None:
    time = clock()
    base = fitted(STILL, measured(STILL, time, rich(time)))
    assert reveal(base, [Creep(elements=1)], NOISE) == ((), ())


def test_senseless_questions_are_refused(lagging: po.Fit) -> None:
    with pytest.raises(InputError, match=r"Nothing to tell apart in \(delay\)"):
        advise(lagging, [Delay()], NOISE)
    with pytest.raises(InputError, match="noise is 0 m"):
        advise(lagging, [Delay(), SensorLag()], 0.0)
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
    never = f"None of the candidate drives would show {', '.join(blind.invisible)} of a usual size"
    assert never in sentences


def test_the_advised_drive_finds_what_the_sine_hid(blind: Diagnosis) -> None:
    (advice,) = (e for e in blind.experiments if "second_mode" in e.group)
    at, volts = advice.drive.samples(advice.rate)
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
