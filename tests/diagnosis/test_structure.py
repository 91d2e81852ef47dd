"""What is left is called structure when it is, and noise when it is noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

import piezo_opt as po
from piezo_opt.diagnosis.base_point import BasePoint
from piezo_opt.diagnosis.colour import crowded
from piezo_opt.diagnosis.following import follows_drive, play
from piezo_opt.diagnosis.noise import NoiseFloor, Structure, noise_floor, structure
from piezo_opt.effects import BoucWen, PrandtlIshlinskii
from piezo_opt.measurement import FloatArray
from tests.diagnosis.plants import (
    NOISE,
    STILL,
    clock,
    fitted,
    measured,
    minor_loops,
    rich,
    triangle,
)

TIME = clock()


@pytest.fixture(scope="module")
def clean() -> po.Fit:
    """The quasi-static base at its own record."""
    return fitted(STILL, measured(STILL, TIME, rich(TIME)))


def changed(clean: po.Fit, residual: FloatArray) -> po.Fit:
    """The same fit with another residual (N,)."""
    (record,) = clean.records
    other = record.with_(position=clean.readings[0] + residual)
    return replace(clean, question=replace(clean.question, records=other))


def left_by(clean: po.Fit, residual: FloatArray) -> Structure:
    """What is said of the same fit with another residual (N,)."""
    fit = changed(clean, residual)
    return structure(fit, noise_floor(fit))


def white(seed: int) -> FloatArray:
    return np.asarray(NOISE * np.random.default_rng(seed).normal(size=TIME.size))


def slow(seed: int, phi: float) -> FloatArray:
    driven = np.random.default_rng(seed).normal(size=TIME.size + 500)
    return np.asarray(NOISE * np.sqrt(1 - phi**2) * signal.lfilter([1], [1, -phi], driven)[500:])


def test_what_a_fit_leaves_is_told_on_its_own_sub_steps(
    clean: po.Fit, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To choose them anew costs as much as many fits' steps; to ask twice costs nothing."""

    def never(*_: object, **__: object) -> None:
        raise AssertionError("sub-steps are chosen anew")

    monkeypatch.setattr(po.simulation.Simulator, "choose", never)
    fit = changed(clean, slow(1, 0.9))
    assert structure(fit, noise_floor(fit)) is structure(fit, noise_floor(fit))


@pytest.mark.parametrize(
    "noise",
    [white, lambda seed: slow(seed, 0.5), lambda seed: slow(seed, 0.9)],
    ids=["white", "half", "slow"],
)
def test_noise_is_left_alone(clean: po.Fit, noise: Callable[[int], FloatArray]) -> None:
    said = [left_by(clean, noise(seed)).clues for seed in range(100)]
    assert sum(bool(s) for s in said) <= 3


def test_rounded_readings_are_left_alone(clean: po.Fit) -> None:
    step = 4.0 * NOISE
    said = []
    for seed in range(20):
        read = step * np.round((clean.readings[0] + 0.3 * white(seed)) / step)
        said.append(left_by(clean, read - clean.readings[0]).clues)
    assert sum(bool(s) for s in said) <= 1


def test_an_error_of_one_branch_is_heard(clean: po.Fit) -> None:
    drive = clean.records[0].drive
    branch = np.sign(np.gradient(drive)) * (drive - 30.0) / 30.0
    found = left_by(clean, white(0) + 2.0 * NOISE * branch)
    assert found.left
    (clue,) = (c for c in found.clues if "follows the drive" in c)
    assert "branch" in clue


def test_a_loop_of_another_roundness_is_heard(clean: po.Fit) -> None:
    (record,) = clean.records
    values = {**clean.values, "bouc_wen.n": 1.5}
    rounder = po.simulate(STILL, record, values).reading + white(0)
    fit = fitted(STILL, record.with_(position=rounder))
    assert 2.0 * NOISE < fit.rms < 4.0 * NOISE
    assert structure(fit, noise_floor(fit)).left


def test_a_cube_of_the_drive_is_heard(clean: po.Fit) -> None:
    drive = (clean.records[0].drive - 30.0) / 30.0
    found = left_by(clean, white(0) + 3.0 * NOISE * drive**3)
    assert found.left
    assert any("follows the drive" in c for c in found.clues)


def test_levels_that_follow_nothing_recorded_are_heard(clean: po.Fit) -> None:
    """From what would be worth a name on; half a second hardly tells them from slow noise."""
    level = np.where(TIME % 0.16 < 0.07, 1.0, -1.0)
    for size, heard in ((0.2, 0), (0.7, 10), (3.5, 10)):
        said = [left_by(clean, white(seed) + size * NOISE * level) for seed in range(10)]
        assert sum(any("not recorded" in c for c in one.clues) for one in said) == heard


PULSES = np.where(np.arange(2000) % 400 < 4, 1.0, 0.0)


@pytest.mark.parametrize("phi", [0.0, 0.6])
@pytest.mark.parametrize(
    "left",
    [
        np.sin(0.05 * np.arange(2000)),
        np.sin(1.5 * np.arange(2000)),
        signal.sawtooth(0.01 * np.arange(2000), 0.5),
        PULSES,
        signal.lfilter([1.0], [1.0, -2.0 * 0.97 * np.cos(0.4), 0.97**2], PULSES),
        signal.lfilter([1.0], [1.0, -0.99], PULSES),
    ],
    ids=["slow line", "fast line", "triangle", "pulses", "ringing", "relaxation"],
)
def test_what_noise_does_not_do_is_heard(clean: po.Fit, left: FloatArray, phi: float) -> None:
    """As large as the noise, beside white noise and slow noise."""
    left = NOISE * (left - left.mean()) / left.std()
    assert all(left_by(clean, slow(seed, phi) + left).left for seed in range(10))


@pytest.mark.parametrize("phi", [0.0, 0.6])
def test_what_fills_a_band_is_heard_from_twice_the_noise_on(clean: po.Fit, phi: float) -> None:
    """A hum that swells up to a tenth of the highest frequency is the likest to slow noise."""
    left = signal.chirp(np.arange(2000), 0.0, 2000, 0.05)
    left = 2.0 * NOISE * (left - left.mean()) / left.std()
    assert all(left_by(clean, slow(seed, phi) + left).left for seed in range(10))


def test_functions_of_the_drive_explain_noise_by_chance_as_often_as_stated(clean: po.Fit) -> None:
    """White, slow, and larger here than there."""
    loud = np.where(TIME % 0.5 < 0.2, 2.0, 1.0)
    for noise in (white, lambda seed: slow(seed, 0.6), lambda seed: loud * white(seed)):
        fits = [changed(clean, noise(seed)) for seed in range(150)]
        p = np.array([follows_drive(fit, BasePoint(fit))[0] for fit in fits])
        assert np.mean(p < 0.05) < 0.1
        assert 0.35 < np.mean(p < 0.5) < 0.65


@pytest.mark.parametrize("freedom", [1, 2])
def test_white_noise_is_crowded_as_often_as_stated(freedom: int) -> None:
    random = np.random.default_rng(freedom)
    found = sum(crowded(random.chisquare(freedom, 100), freedom).any() for _ in range(20_000))
    # The stretches overlap, so that less than 20 is due.
    assert 5 <= found <= 25


def test_a_stretch_that_holds_too_much_is_found_where_it_is() -> None:
    power = np.random.default_rng(0).chisquare(2.0, 1000)
    power[640:672] *= 5.0
    power[100] = 60.0
    found = crowded(power, 2)
    assert found[640:672].all()
    assert found[100]
    assert np.flatnonzero(found).min() >= 96
    assert not found[128:512].any()


def known(floor: float) -> NoiseFloor:
    return NoiseFloor(floor, 0.97 * floor, 1.03 * floor, False, "known")


@pytest.mark.parametrize(("size", "heard"), [(0.25, False), (0.6, True)])
def test_what_follows_the_drive_is_a_clue_where_it_matters(
    clean: po.Fit, size: float, heard: bool
) -> None:
    """Most of a cube the parameters can follow; what they leave must be worth a word."""
    cube = ((clean.records[0].drive - 30.0) / 30.0) ** 3
    fit = changed(clean, white(0) + size * NOISE * cube / float(np.sqrt(np.mean(cube**2))))
    said = structure(fit, known(0.94 * NOISE))
    assert any("follows the drive" in clue for clue in said.clues) is heard
    # However sure, it is none where the error is hardly above the floor.
    for above, material in ((1.05, False), (1.3, True)):
        large = changed(clean, white(0) + 3.0 * NOISE * cube)
        said = structure(large, known(large.rms / above))
        assert any("follows the drive" in clue for clue in said.clues) is material


def test_a_burst_is_heard_and_placed(clean: po.Fit) -> None:
    burst = np.where((TIME >= 1.0) & (TIME < 1.1), 4.0, 1.0)
    found = left_by(clean, burst * white(0))
    (clue,) = (c for c in found.clues if "bursts" in c)
    assert "between 50 and 55 %" in clue
    times = float(clue.rsplit("it is ", 1)[1].split(" times")[0])
    assert times == pytest.approx(4.0, rel=0.25)


def test_more_than_the_measured_noise_is_heard() -> None:
    time = clock(6000)
    # From the third period on the loop repeats.
    record = measured(STILL, time, triangle(time, 2.0), seed=1).slice(2.0).with_(period=0.5)
    fit = fitted(STILL, record)
    floor = noise_floor(fit)
    assert structure(fit, floor).clues == ()
    # Repeats with every period and follows none of the usual functions.
    repeated = np.tile(np.random.default_rng(0).normal(size=500), 8)
    changed = record.with_(position=record.position + NOISE * repeated)
    louder = replace(fit, question=replace(fit.question, records=changed))
    found = structure(louder, noise_floor(louder))
    assert any("above the measured noise" in c for c in found.clues)
    assert noise_floor(louder).rms == pytest.approx(floor.rms, rel=0.02)


def test_what_is_far_above_the_floor_is_not_called_noise(clean: po.Fit) -> None:
    """An unrecorded, slow input of its own: it follows nothing, and comes in no bursts."""
    wander = 30.0 * NOISE * np.sin(2.0 * np.pi * 3.3 / (TIME[-1] - TIME[0]) * TIME + 0.4)
    said = left_by(clean, wander + white(0))
    assert said.left
    assert any("was not recorded" in clue for clue in said.clues)
    assert not any("was not recorded" in clue for clue in left_by(clean, slow(0, 0.9)).clues)


def test_a_loop_of_another_law_is_heard() -> None:
    """A record without a word on it would call the wrong law complete at 1.4 times the noise."""
    noise = 1e-8
    law = PrandtlIshlinskii(dead_zones=0)
    fit = po.solve(po.Identification(STILL, minor_loops(law, {"r": 24.0, "rho": 3e-8}, noise)))
    assert 1.3 * noise < fit.rms < 1.6 * noise
    (clue,) = structure(fit, noise_floor(fit)).clues
    assert "a play of" in clue
    own = BoucWen(), {"alpha": 3e-8, "beta": 0.03, "gamma": 5e-3}
    right = po.solve(po.Identification(STILL, minor_loops(*own, noise)))
    assert structure(right, noise_floor(right)).clues == ()


@pytest.mark.parametrize("half", [0.02, 0.3, 5.0])
def test_a_play_follows_by_its_definition(half: float) -> None:
    random = np.random.default_rng(3)
    walk = np.cumsum(random.normal(size=600))
    stairs = np.repeat(random.normal(size=40), 15)
    for signal_ in (walk, stairs, np.concatenate([np.zeros(9), walk]), np.zeros(5), np.ones(1)):
        at, followed = float(signal_[0]), []
        for now in signal_.tolist():
            at = min(max(at, now - half), now + half)
            followed.append(at)
        np.testing.assert_array_equal(play(signal_, half), followed)
