"""Intervals hold the truth as often as they say; ones of another width would be found out."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib import import_module

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.benchmark.coverage import Coverage, coverage
from piezo_opt.diagnosis import diagnose
from piezo_opt.effects import MainsPickup, Offset, PiezoGain
from piezo_opt.identification import Ending
from piezo_opt.simulation import simulate
from problems import synthetic_recovery
from tests.diagnosis.plants import but

benchmark = import_module("piezo_opt.benchmark.coverage")

SEEDS = range(20)


@pytest.fixture(scope="module")
def seven() -> Coverage:
    """Seven parameters, 8000 samples, 0.2 % noise, from readings made by independent code."""
    clean = synthetic_recovery.clean()
    return coverage(
        synthetic_recovery.question().with_records(clean),
        synthetic_recovery.known(),
        synthetic_recovery.NOISE * float(np.ptp(clean.position)),
        seeds=SEEDS,
    )


def test_every_fit_converged_and_took_white_noise_for_white(seven: Coverage) -> None:
    assert [d.seed for d in seven.draws] == list(SEEDS)
    assert all(d.ending is Ending.CONVERGED for d in seven.draws)
    # The test for correlation errs once in a thousand.
    assert sum(d.coloured for d in seven.draws) <= 1


def test_the_stated_covariance_is_the_true_one(seven: Coverage) -> None:
    """The mean squared distance lies in its 99.9 % band, and would not for other deviations."""
    assert seven.honest(), seven
    assert not seven.honest(0.5), f"intervals half as wide pass as well: {seven}"
    assert not seven.honest(1.5), f"intervals half as wide again pass as well: {seven}"


def test_each_parameter_lies_in_its_interval(seven: Coverage) -> None:
    """15 of 20 or more: missed once in 3000 by right intervals, nearly always by halved ones."""
    assert set(seven.shares) == set(synthetic_recovery.known())
    for name, share in seven.shares.items():
        assert share >= 0.75, f"{name}: {share:.0%}\n{seven}"
    halved = [np.abs(d.errors) <= 0.5 * d.half_width for d in seven.draws]
    assert np.mean(halved, axis=0).min() < 0.75


def gain_question() -> po.Identification:
    time = np.linspace(0.0, 1.0, 200)
    drive = 50.0 * np.sin(20.0 * time)
    record = po.Measurement(time=time, drive=drive, position=1e-7 * drive + 3e-6)
    return po.Identification(PiezoGain() + Offset(), record)


TRUTH = {"piezo_gain.d": 1e-7, "offset.y0": 3e-6}


def test_a_wrong_truth_is_found_out() -> None:
    """2 % of the gain are many deviations here: nothing lies inside."""
    wrong = {**TRUTH, "piezo_gain.d": 1.02e-7}
    result = coverage(gain_question(), wrong, 1e-8, seeds=range(10))
    assert result.shares["piezo_gain.d"] == 0.0
    assert result.bias["piezo_gain.d"] < -10.0
    assert not result.honest()


def test_a_linear_question_has_the_textbook_deviation() -> None:
    """For y = d v + y0 the deviation of d is sigma / sqrt(sum (v - mean v)^2)."""
    question, noise = gain_question(), 1e-8
    result = coverage(question, TRUTH, noise, seeds=range(200))
    drive = question.campaign.records[0].drive
    assert 0.90 <= result.shares["piezo_gain.d"] <= 0.99
    assert result.spread["piezo_gain.d"] == pytest.approx(1.0, abs=0.17)  # 3.3 / sqrt(400)
    generator = np.random.default_rng(3)
    estimates = [
        np.polyfit(drive, 1e-7 * drive + generator.normal(scale=noise, size=drive.size), 1)[0]
        for _ in range(200)
    ]
    mine = np.array([d.errors[0] for d in result.draws])
    textbook = (np.array(estimates) - 1e-7) / (noise / np.linalg.norm(drive - drive.mean()))
    assert np.std(mine) == pytest.approx(np.std(textbook), rel=0.25)


def test_an_executor_changes_nothing() -> None:
    alone = coverage(gain_question(), TRUTH, 1e-8, seeds=range(4))
    seen: list[tuple[int, int]] = []
    with ThreadPoolExecutor(2) as pool:
        together = coverage(
            gain_question(), TRUTH, 1e-8, seeds=range(4), executor=pool,
            progress=lambda done, of: seen.append((done, of)),
        )  # fmt: skip
    np.testing.assert_array_equal(alone.errors, together.errors)
    assert seen == [(1, 4), (2, 4), (3, 4), (4, 4)]


def test_interrupted_it_keeps_what_is_done() -> None:
    def stop(done: int, _of: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    result = coverage(gain_question(), TRUTH, 1e-8, seeds=range(9), progress=stop)
    assert [d.seed for d in result.draws] == [0, 1]


def test_intervals_after_a_diagnosis_are_those_of_the_draws_that_found_the_effect(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    few = but("mains_pickup", "drift")  # for speed
    monkeypatch.setattr(benchmark, "diagnose", partial(diagnose, withhold=few))
    question = gain_question()
    model = question.model + MainsPickup()
    truth = {**TRUTH, "mains_pickup.a": 4e-8, "mains_pickup.phi": 0.5}
    (record,) = question.campaign.records
    reading = simulate(model, record, truth).reading
    hummed = question.with_model(model).with_records(record.with_(position=reading))
    result = coverage(hummed, truth, 1e-8, seeds=range(6), without=["mains_pickup"])
    assert set(result.names) == set(truth)
    assert result.others == ()
    assert result.shares["mains_pickup.a"] >= 0.5
    assert result.honest()
    # At a hundredth of the noise it is never found, and there is nothing to cover.
    faint = {**truth, "mains_pickup.a": 1e-10}
    reading = simulate(model, record, faint).reading
    lost = hummed.with_records(record.with_(position=reading))
    with pytest.raises(po.InputError, match="another set than the true one was found 2 times"):
        coverage(lost, faint, 1e-8, seeds=range(2), without=["mains_pickup"])


def test_what_makes_no_sense_is_refused() -> None:
    with pytest.raises(po.InputError, match="positive noise"):
        coverage(gain_question(), TRUTH, 0.0)
    with pytest.raises(po.InputError, match=r"no true value of offset\.y0"):
        coverage(gain_question(), {"piezo_gain.d": 1e-7}, 1e-8, seeds=[0])


def test_a_record_of_it() -> None:
    result = coverage(gain_question(), TRUTH, 1e-8, seeds=range(5))
    plain = result.to_dict()
    assert plain["draws"] == 5
    assert plain["share"] == dict(result.shares)
    assert "piezo_gain.d" in str(result)
