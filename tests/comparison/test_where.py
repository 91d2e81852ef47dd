"""Planted errors are found where they were planted, and noise is left alone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from piezo_opt.comparison.misfit import Misfit
from piezo_opt.comparison.turns import directions, rests, turning_points
from piezo_opt.comparison.where import where
from piezo_opt.measurement import FloatArray, Measurement

NOISE = 1e-8
TIME = np.arange(4000) / 1000.0
DRIVES: dict[str, FloatArray] = {
    "triangle": 120.0 * np.abs(((2.0 * TIME) % 2.0) - 1.0),
    "swelling": 60.0 + 60.0 * TIME / TIME[-1] * np.sin(2.0 * np.pi * 5.0 * TIME),
    "steps": 60.0 * (np.floor(TIME / 0.5) % 2.0),
    "wandering": 10.0 * np.cumsum(np.random.default_rng(9).normal(size=TIME.size)) / 30.0,
}

Extra = Callable[[FloatArray, FloatArray], FloatArray]


def planted(drive: str, extra: Extra, seed: int = 0) -> Misfit:
    """A reading that has ``extra(time, drive)`` and white noise beyond the model's."""
    volts = DRIVES[drive]
    model = 1e-7 * volts
    noise = NOISE * np.random.default_rng(1000 + seed).normal(size=TIME.size)
    record = Measurement(
        time=TIME, drive=volts, position=model + extra(TIME, volts) + noise, allow_saturated=True
    )
    return Misfit(record, model)


def nothing(time: FloatArray, drive: FloatArray) -> FloatArray:
    return np.zeros_like(time + drive)


@pytest.mark.parametrize("drive", DRIVES)
def test_silent_on_white_noise(drive: str) -> None:
    said = [s for seed in range(40) for s in where(planted(drive, nothing, seed)).sentences]
    assert said == []


def test_a_bias_on_the_unloading_branch() -> None:
    def bias(_: FloatArray, drive: FloatArray) -> FloatArray:
        falls = np.gradient(drive) < 0
        return np.where(falls & (drive > 60.0) & (drive < 90.0), 2.1e-7, 0.0)

    found = where(planted("triangle", bias)).by_branch
    head, size = "On the unloading branch the measurement reads ", found.sentence.split(" nm")[0]
    assert found.sentence.startswith(head)
    assert float(size.removeprefix(head)) == pytest.approx(210.0, abs=3.0)
    assert found.sentence.endswith(" nm higher than the model between 60 and 90 V.")
    inside = (found.edges[:-1] >= 59.0) & (found.edges[1:] <= 91.0)
    assert found.unloading_mean[inside] == pytest.approx(2.1e-7, rel=0.03)
    assert np.abs(found.loading_mean).max() < 5e-9
    assert found.loading_count.sum() + found.unloading_count.sum() == TIME.size


def test_a_frequency_that_is_said_is_the_drives_own() -> None:
    """And not the middle of the averaged spectrum's bins, which are 4 Hz wide here."""
    time = np.arange(2000) / 1000.0
    drive = 50 + 40 * np.sin(2 * np.pi * 8.7 * time)
    noise = 1e-9 * np.random.default_rng(4).standard_normal(time.size)
    record = Measurement(time, drive, 1e-7 * drive + noise)
    found = where(Misfit(record, 0.98e-7 * drive)).by_frequency
    assert found.frequency[1] - found.frequency[0] == pytest.approx(4.0)
    told = float(found.sentence.split("most of it near ")[1].split(" Hz")[0])
    assert told == pytest.approx(8.7, abs=0.02)


def test_a_tone_of_37_hz() -> None:
    found = where(planted("wandering", lambda t, _: 3e-8 * np.sin(2 * np.pi * 37.0 * t)))
    assert "at 37 Hz" in found.by_frequency.sentence
    amplitude = float(found.by_frequency.sentence.split(" of ")[1].split(" nm")[0])
    assert amplitude == pytest.approx(30.0, rel=0.1)
    assert found.over_time.sentence == found.by_branch.sentence == ""


def test_a_harmonic_of_the_drive_is_named() -> None:
    sine = np.sin(2 * np.pi * 20.0 * TIME)
    model = 1e-7 * 50.0 * sine
    extra = 3e-8 * np.sin(2 * np.pi * 60.0 * TIME)
    noise = NOISE * np.random.default_rng(1).normal(size=TIME.size)
    record = Measurement(time=TIME, drive=50.0 * sine, position=model + extra + noise)
    assert "3 times the drive's 20 Hz" in where(Misfit(record, model)).by_frequency.sentence


def test_a_line_that_the_drive_has_itself_is_no_harmonic() -> None:
    """A drive of 20 and 60 Hz: 60 Hz is not made of 20 Hz by what the model lacks."""
    sine, third = (np.sin(2 * np.pi * f * TIME) for f in (20.0, 60.0))
    drive = 50.0 * sine + 10.0 * third
    noise = NOISE * np.random.default_rng(1).normal(size=TIME.size)
    record = Measurement(time=TIME, drive=drive, position=1e-7 * drive + 3e-8 * third + noise)
    said = where(Misfit(record, 1e-7 * drive)).by_frequency.sentence
    assert "60 Hz, where the drive has a line of its own" in said
    assert "times the drive's" not in said


def test_a_wrong_gain_follows_the_drive() -> None:
    found = where(planted("wandering", lambda _, v: 2e-8 * (v - v.mean()))).by_frequency
    assert found.coherent_share > 0.8
    assert "follows the drive" in found.sentence


def test_noise_stays_below_the_band_of_the_coherence() -> None:
    above, total = 0, 0
    for seed in range(30):
        found = where(planted("wandering", nothing, seed)).by_frequency
        above += int(np.count_nonzero(found.coherence > found.band))
        total += found.coherence.size
    assert above / total < 0.004
    assert found.coherent_share < 0.1


def test_welch_keeps_the_power() -> None:
    found = where(planted("wandering", nothing)).by_frequency
    power = float(np.sum(found.error)) * float(found.frequency[1] - found.frequency[0])
    assert power == pytest.approx(NOISE**2, rel=0.1)


def test_an_exponential_after_steps() -> None:
    def decay(time: FloatArray, drive: FloatArray) -> FloatArray:
        return np.where(drive > 30.0, 1.0, -1.0) * 5e-8 * np.exp(-(time % 0.5) / 0.05)

    found = where(planted("steps", decay)).after_events
    assert (found.kind, found.events) == ("step", 7)
    assert "after a step" in found.sentence
    assert "ahead of the model" in found.sentence
    expected = 5e-8 * np.exp(-found.since / 0.05)
    assert np.abs(found.mean - expected).max() < 4.0 * found.uncertainty.max()


def test_logarithmic_creep_is_a_slope_a_decade() -> None:
    def creep(time: FloatArray, drive: FloatArray) -> FloatArray:
        return np.where(drive > 30.0, 1.0, -1.0) * 2e-8 * np.log10((time % 0.5 + 1e-3) / 0.02)

    sentence = where(planted("steps", creep)).after_events.sentence
    slope = float(sentence.split(": ")[1].split(" nm")[0])
    assert "a decade of time" in sentence
    assert slope == pytest.approx(20.0, rel=0.15)


def test_an_error_that_grows_with_the_swing() -> None:
    found = where(planted("swelling", lambda _, v: 1e-8 * ((v - 60.0) / 20.0) ** 2)).by_amplitude
    assert found.sentence.startswith("The error grows with the swing of the drive")
    assert found.rms[-1] > 3.0 * found.rms[0]
    assert np.all(np.diff(found.swing) > 0)


def test_a_burst_in_time() -> None:
    rng = np.random.default_rng(3)
    burst = np.where((TIME >= 1.0) & (TIME < 1.2), rng.normal(size=TIME.size) * 4 * NOISE, 0.0)
    found = where(planted("wandering", lambda *_: burst)).over_time
    assert found.sentence.startswith("Between 1 s and 1.2 s")
    assert found.edges[np.argmax(found.rms)] == pytest.approx(1.0)


def test_uncounted_samples_are_not_looked_at() -> None:
    spoiled = planted("triangle", lambda t, _: np.where(t < 1.0, 1e-6, 0.0))
    whole = Misfit(spoiled.record.with_(startup=1.0), spoiled.modelled)
    assert where(spoiled).sentences
    assert where(whole).sentences == ()


def test_uneven_sampling_has_no_spectrum() -> None:
    time = np.cumsum(np.random.default_rng(0).uniform(0.5, 1.5, 200))
    record = Measurement(time=time, drive=np.sin(time), position=np.sin(time + 0.1))
    found = where(Misfit(record, np.sin(time))).by_frequency
    assert found.frequency.size == 0
    assert found.sentence == ""


def test_turns_of_a_noisy_triangle_with_holds() -> None:
    clean = np.interp(np.arange(401.0), [0, 100, 150, 250, 300, 400], [0, 1, 1, 0, 0, 1.0])
    assert turning_points(clean).tolist() == [0, 150, 300, 400]
    noisy = clean + 2e-3 * np.random.default_rng(0).normal(size=clean.size)
    turns = turning_points(noisy)
    assert turns.size == 4
    assert 100 <= turns[1] <= 151
    branch = directions(clean, turning_points(clean))
    assert branch[:151].tolist() == [1.0] * 151
    assert branch[151:301].tolist() == [-1.0] * 150
    first, last, sign = rests(noisy)
    assert sign.tolist() == [1.0, -1.0]
    assert np.abs(first - [100, 250]).max() <= 3
    assert np.abs(last - [150, 300]).max() <= 3
