"""From the question to the fit: the truth comes back, and the report says what happened."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy import signal, stats

import piezo_opt as po
from piezo_opt.identification import Ending, Progress, with_statistics
from tests.identification.truth import LINE, MOVING, STILL, TRUTH, loops, record

TIME, DRIVE = loops(300)
NOISE = 3e-9


@pytest.fixture(scope="module")
def fit() -> po.Fit:
    return po.solve(po.Identification(STILL, record(STILL, TRUTH, TIME, DRIVE, noise=NOISE)))


def test_without_noise_the_truth_comes_back() -> None:
    question = po.Identification(STILL, record(STILL, TRUTH, TIME, DRIVE))
    found = po.solve(question).values
    assert {n: found[n] for n in TRUTH} == pytest.approx(TRUTH, rel=1e-4)
    assert abs(found["initial.bouc_wen.h"]) < 1e-4 * 1e-6


def test_with_noise_the_truth_lies_in_the_intervals(fit: po.Fit) -> None:
    for name, value in TRUTH.items():
        low, high = fit.interval(name, 0.999)
        assert low < value < high
    assert fit.rms == pytest.approx(NOISE, rel=0.1)
    assert not fit.coloured
    assert fit.outcome.success
    assert fit.blind == ()


def test_intervals_are_students(fit: po.Fit) -> None:
    low, high = fit.interval("piezo_gain.d", 0.8)
    free = fit.residuals.size - len(fit.names)
    half = stats.t.ppf(0.9, free) * fit.std["piezo_gain.d"]
    assert (low, high) == pytest.approx(
        (fit.values["piezo_gain.d"] - half, fit.values["piezo_gain.d"] + half), rel=1e-12
    )


def test_correlation_is_the_scaled_covariance(fit: po.Fit) -> None:
    np.testing.assert_allclose(np.diag(fit.correlation), 1.0)
    assert np.abs(fit.correlation).max() <= 1.0 + 1e-9
    d, alpha = fit.names.index("piezo_gain.d"), fit.names.index("bouc_wen.alpha")
    by_hand = fit.covariance[d, alpha] / fit.std["piezo_gain.d"] / fit.std["bouc_wen.alpha"]
    assert fit.correlation[d, alpha] == pytest.approx(by_hand)
    assert fit.correlation[alpha, d] == pytest.approx(by_hand)


def test_the_covariance_of_a_line_is_the_textbooks() -> None:
    noise = 1e-8 * np.random.default_rng(4).normal(size=TIME.size)
    line = po.solve(po.Identification(LINE, po.Measurement(TIME, DRIVE, 1e-7 * DRIVE + noise)))
    known = stats.linregress(DRIVE, 1e-7 * DRIVE + noise)
    assert line.values["piezo_gain.d"] == pytest.approx(known.slope, rel=1e-9)
    assert line.std["piezo_gain.d"] == pytest.approx(known.stderr, rel=1e-6)
    assert line.std["offset.y0"] == pytest.approx(known.intercept_stderr, rel=1e-6)


def test_numbers_of_the_misfit(fit: po.Fit) -> None:
    y = fit.records[0].position
    left = y - fit.readings[0]
    assert fit.rms == pytest.approx(np.sqrt(np.mean(left**2)))
    norm = np.linalg.norm
    assert fit.fit_percent == pytest.approx(100 * (1 - norm(left) / norm(y - y.mean())))
    assert fit.trace.rms[-1] == pytest.approx(fit.rms, rel=1e-3)
    assert fit.trace.values.shape == (fit.trace.rms.size, len(fit.names))


def test_plain_data(fit: po.Fit, tmp_path: Path) -> None:
    fit.write_json(tmp_path / "fit.json")
    data = json.loads((tmp_path / "fit.json").read_text())
    assert data == json.loads(json.dumps(fit.to_dict()))
    assert data["schema"] == "piezo_opt/fit/1"
    assert data["outcome"]["ending"] == "converged"
    assert data["outcome"]["sentence"] == fit.outcome.sentence
    assert data["rms"] == fit.rms
    assert data["fit_percent"] == fit.fit_percent
    gain = data["parameters"]["piezo_gain.d"]
    assert gain["value"] == fit.values["piezo_gain.d"]
    assert gain["std"] == fit.std["piezo_gain.d"]
    assert gain["unit"] == "m/V"
    assert data["parameters"]["bouc_wen.n"] == {
        "value": 1.0, "std": None, "unit": "1", "estimated": False, "at_bound": False,
    }  # fmt: skip
    assert data["parameters"]["initial.bouc_wen.h"]["unit"] == "m"
    assert data["evaluations"]["total"] == fit.evaluations.total > 10
    assert 0 < data["wall_s"] == fit.wall_s
    assert list(tmp_path.iterdir()) == [tmp_path / "fit.json"]


def test_a_bound_that_holds_is_named_everywhere() -> None:
    asked = po.Identification(
        STILL, record(STILL, TRUTH, TIME, DRIVE, noise=NOISE), bounds={"bouc_wen.beta": (0.0, 0.03)}
    )
    held = po.solve(asked)
    assert held.at_bound == ("bouc_wen.beta",)
    assert held.values["bouc_wen.beta"] == 0.03
    assert np.isnan(held.std["bouc_wen.beta"])
    assert np.isfinite(held.std["piezo_gain.d"])
    assert "bouc_wen.beta ended at a bound: widen it" in held.outcome.sentence
    (row,) = [line for line in str(held).splitlines() if line.split()[:1] == ["bouc_wen.beta"]]
    assert "at bound" in row
    entry = held.to_dict()["parameters"]["bouc_wen.beta"]
    assert entry["at_bound"]
    assert entry["std"] is None
    json.dumps(held.to_dict(), allow_nan=False)


def test_it_prints_values_with_their_intervals(fit: po.Fit) -> None:
    (row,) = [line for line in str(fit).splitlines() if line.split()[:1] == ["bouc_wen.alpha"]]
    _, value, half, unit = row.split()
    assert float(value) == pytest.approx(fit.values["bouc_wen.alpha"], rel=1e-5)
    low, high = fit.interval("bouc_wen.alpha")
    assert float(half) == pytest.approx(0.5 * (high - low), rel=0.05)
    assert unit == "m/V"
    (fixed,) = [line for line in str(fit).splitlines() if line.split()[:1] == ["bouc_wen.n"]]
    assert "fixed" in fixed


def test_an_exponent_is_freed_and_comes_back() -> None:
    truth = {**TRUTH, "bouc_wen.n": 1.3, "bouc_wen.h_s": 1e-6}
    measured = record(STILL, truth, TIME, DRIVE, noise=5e-10)
    kept = po.solve(po.Identification(STILL, measured))
    freed = po.solve(po.Identification(STILL, measured, free=("bouc_wen.n",)))
    assert "bouc_wen.n" not in kept.names
    assert kept.values["bouc_wen.n"] == 1.0
    assert kept.rms > 1.5 * freed.rms
    assert freed.rms < 1.1 * 5e-10
    assert freed.values["bouc_wen.n"] == pytest.approx(1.3, abs=0.02)
    low, high = freed.interval("bouc_wen.n", 0.999)
    assert low < 1.3 < high
    told = po.solve(po.Identification(STILL, measured, fixed={"bouc_wen.n": 1.3}))
    assert told.rms < 1.1 * 5e-10


def test_a_campaign_shares_what_is_shared() -> None:
    # Two records of one actuator with zeros of their own, the second cut out of motion.
    first = record(STILL, TRUTH, TIME, DRIVE, noise=NOISE, name="first")
    zero = {**TRUTH, "offset.y0": -9e-7}
    second = record(STILL, zero, TIME, 0.8 * DRIVE, noise=NOISE, seed=1, name="second")
    cut = second.slice(1.1, None)
    fit = po.solve(po.Identification(STILL, [first, cut]))
    assert fit.rms < 1.1 * NOISE
    truth = {**TRUTH, "offset.y0[0]": 2e-7, "offset.y0[1]": -9e-7, "initial.bouc_wen.h[0]": 0.0}
    del truth["offset.y0"]
    for name, value in truth.items():
        low, high = fit.interval(name, 0.999)
        assert low < value < high, name
    # Seen from the second record's own zero of the loop, its start is far from rest.
    assert abs(fit.values["initial.bouc_wen.h[1]"]) > 10 * fit.std["initial.bouc_wen.h[1]"]
    # Two records are worth more than one.
    alone = po.solve(po.Identification(STILL, first))
    assert fit.std["bouc_wen.beta"] < alone.std["bouc_wen.beta"]
    assert "offset.y0[1]" in str(fit)
    assert fit.to_dict()["parameters"]["offset.y0[1]"]["unit"] == "m"


def test_a_shared_parameter_may_differ_from_record_to_record() -> None:
    one = record(STILL, TRUTH, TIME, DRIVE, noise=NOISE, name="one")
    stiff = {**TRUTH, "piezo_gain.d": 1.0e-7}
    two = record(STILL, stiff, TIME, DRIVE, noise=NOISE, seed=1, name="two")
    fit = po.solve(po.Identification(STILL, [one, two], per_record=("piezo_gain.d",)))
    assert fit.rms < 1.1 * NOISE
    assert fit.values["piezo_gain.d[0]"] == pytest.approx(1.2e-7, rel=5e-3)
    assert fit.values["piezo_gain.d[1]"] == pytest.approx(1.0e-7, rel=5e-3)
    shared = po.solve(po.Identification(STILL, [one, two]))
    assert shared.rms > 20 * fit.rms


def periodic(between: po.Between = po.Between.LINEAR) -> po.Measurement:
    time = np.arange(480) / 2000.0
    wave = 2 * np.pi * time / 0.08
    drive = 30.0 - 20.0 * np.cos(wave) + 6.0 * np.sin(3 * wave) + 4.0 * np.sin(8 * wave + 1.0)
    truth = {**TRUTH, "second_order.omega": 2 * np.pi * 130.0, "second_order.zeta": 0.05}
    return record(MOVING, truth, time, drive, noise=NOISE, period=0.08, between=between)


@pytest.mark.parametrize("between", [po.Between.LINEAR, po.Between.BANDLIMITED])
def test_a_periodic_record_starts_on_its_steady_state(between: po.Between) -> None:
    measured = periodic(between)
    fit = po.solve(po.Identification(MOVING, measured))
    assert not [n for n in fit.names if n.startswith("initial.")]
    assert fit.rms < 1.1 * NOISE
    assert fit.values["second_order.omega"] == pytest.approx(2 * np.pi * 130.0, rel=2e-3)
    for name in ("piezo_gain.d", "bouc_wen.alpha", "bouc_wen.beta", "offset.y0"):
        low, high = fit.interval(name, 0.9999)
        assert low < TRUTH[name] < high, name
    cycles = fit.readings[0].reshape(3, -1)
    np.testing.assert_allclose(cycles[1], cycles[0], atol=1e-3 * NOISE)
    virgin = po.solve(po.Identification(MOVING, measured, start=po.Start.REST))
    assert virgin.rms > 3 * fit.rms


def test_correlated_noise_is_noticed_and_widens_the_intervals() -> None:
    white = np.random.default_rng(3).normal(size=TIME.size)
    slow = NOISE * signal.lfilter([0.6], [1.0, -0.8], white)
    fit = po.solve(po.Identification(STILL, record(STILL, TRUTH, TIME, DRIVE, noise=slow)))
    assert fit.coloured
    assert "residuals are correlated in time" in str(fit)


def test_a_start_of_an_earlier_fit_costs_almost_nothing(fit: po.Fit) -> None:
    again = po.solve(fit.question, start=fit)
    assert again.rms == pytest.approx(fit.rms, rel=1e-9)
    assert again.evaluations.total < 0.5 * fit.evaluations.total
    np.testing.assert_array_equal(again.trace.values[0], fit.values.vector(fit.names))


def test_an_interrupt_keeps_the_best_so_far(fit: po.Fit) -> None:
    seen: list[Progress] = []

    def stop(progress: Progress) -> None:
        seen.append(progress)
        if progress.iteration == 3:
            raise KeyboardInterrupt

    wrong = {"piezo_gain.d": 3e-7, "bouc_wen.alpha": 1e-7, "bouc_wen.beta": 0.3}
    stopped = po.solve(fit.question, start=wrong, progress=stop)
    assert stopped.outcome.ending is Ending.INTERRUPTED
    assert not stopped.outcome.success
    assert stopped.outcome.sentence.startswith("Interrupted after 3 iterations")
    assert "start=fit" in stopped.outcome.sentence
    assert [p.iteration for p in seen] == [1, 2, 3]
    assert stopped.rms == pytest.approx(min(p.rms for p in seen), rel=1e-3)
    assert fit.rms < stopped.rms < seen[0].rms
    assert po.solve(fit.question, start=stopped).rms == pytest.approx(fit.rms, rel=1e-6)


def test_the_limit_of_iterations_is_told(fit: po.Fit) -> None:
    wrong = {"piezo_gain.d": 3e-7, "bouc_wen.alpha": 1e-7, "bouc_wen.beta": 0.3}
    short = po.solve(fit.question, start=wrong, solver=po.LevenbergMarquardt(iterations=2))
    assert short.outcome.ending is Ending.LIMIT
    assert "raise iterations" in short.outcome.sentence


def test_a_redundancy_is_told_unprompted() -> None:
    # On one small slow ramp the loop is a second gain.
    time = np.linspace(0.0, 1.0, 200)
    measured = record(STILL, TRUTH, time, 5.0 * time, noise=NOISE)
    fit = po.solve(po.Identification(STILL, measured, start=po.Start.REST))
    text = " ".join(fit.blind)
    assert "piezo_gain.d" in text
    assert "bouc_wen.alpha" in text
    assert "What the data cannot see:" in str(fit)


def test_an_unseen_resonance_is_remarked() -> None:
    truth = {**TRUTH, "second_order.omega": 2 * np.pi * 3000.0, "second_order.zeta": 0.05}
    measured = record(MOVING, truth, TIME, DRIVE, noise=NOISE)
    fit = po.solve(po.Identification(MOVING, measured, start=po.Start.REST))
    assert any("natural frequency is not identifiable" in r for r in fit.remarks)


def test_an_outlier_bends_the_fit_less_under_a_robust_loss() -> None:
    measured = record(STILL, TRUTH, TIME, DRIVE, noise=NOISE)
    spoilt = measured.position.copy()
    spoilt[20:300:50] += 2e-6
    spoilt = measured.with_(position=spoilt)
    plain = po.solve(po.Identification(STILL, spoilt))
    robust = po.solve(po.Identification(STILL, spoilt, loss=po.Loss(po.Shape.CAUCHY, 2 * NOISE)))
    for name in ("piezo_gain.d", "bouc_wen.beta"):
        wrong, right = plain.values[name] - TRUTH[name], robust.values[name] - TRUTH[name]
        assert abs(right) < 0.1 * abs(wrong), name


def test_statistics_can_be_left_for_later(fit: po.Fit) -> None:
    """Fits that are only compared need none; what is added later is what would have been."""
    bare = po.solve(fit.question, statistics=False)
    assert np.isnan(bare.covariance).all()
    assert (bare.blind, bare.remarks) == ((), ())
    assert bare.values == pytest.approx(fit.values)
    full = with_statistics(bare)
    np.testing.assert_allclose(full.covariance, fit.covariance, rtol=1e-6)
    assert (full.blind, full.remarks, full.coloured) == (fit.blind, fit.remarks, fit.coloured)
    assert full.outcome == bare.outcome
