"""Bootstrap and profile likelihood: right where the answer is known, resumed, spread."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

import piezo_opt as po
from piezo_opt.identification.blocks import block_length, drawn
from piezo_opt.measurement import FloatArray
from tests.identification.truth import LINE, STILL, TRUTH, loops, record

TIME, DRIVE = loops(400)
NOISE = 3e-9
STRAIGHT = {name: TRUTH[name] for name in ("piezo_gain.d", "offset.y0")}


@pytest.fixture(scope="module")
def fit() -> po.Fit:
    question = po.Identification(
        STILL, record(STILL, TRUTH, TIME, DRIVE, noise=NOISE), start=po.Start.REST
    )
    return po.solve(question)


def reddened(white: FloatArray, memory: float) -> FloatArray:
    """Noise of a first-order autoregression with this memory, of unit variance."""
    red = np.empty_like(white)
    red[0] = white[0]
    for k in range(1, white.size):
        red[k] = memory * red[k - 1] + np.sqrt(1.0 - memory**2) * white[k]
    return red


def test_blocks_follow_the_memory_of_the_noise() -> None:
    generator = np.random.default_rng(0)
    white = [generator.normal(size=4000) for _ in range(20)]
    assert np.median([block_length(w) for w in white]) <= 2
    # Politis and White, AR(1) with coefficient r: g = 2 r / (1 - r^2) of the spectrum at zero.
    ideal = (1.5 * (2 * 0.9 / (1 - 0.9**2)) ** 2 * 4000) ** (1 / 3)
    found = np.median([block_length(reddened(w, 0.9)) for w in white])
    assert found == pytest.approx(ideal, rel=0.25)
    assert block_length(np.zeros(50)) == 1


def test_blocks_keep_neighbours_together() -> None:
    series = np.arange(100.0)
    got = drawn(series, 10, np.random.default_rng(1))
    assert got.size == 100
    steps = np.diff(got) % 100
    assert np.sum(steps == 1) >= 90
    assert np.unique(drawn(series, 1, np.random.default_rng(1))).size < 80  # with replacement


def test_on_white_noise_the_deviations_are_those_of_the_covariance(fit: po.Fit) -> None:
    found = po.bootstrap(fit, 400, seed=1)
    assert found.blocks == (1,)
    for name in fit.names:
        assert found.std[name] == pytest.approx(fit.std[name], rel=0.15)
        assert abs(found.bias[name]) < 0.2 * found.std[name]
        low, high = found.interval(name)
        assert low < fit.values[name] < high
        assert high - low == pytest.approx(2 * 1.96 * fit.std[name], rel=0.25)
    correlation = found.covariance / np.outer(*[np.sqrt(np.diag(found.covariance))] * 2)
    np.testing.assert_allclose(correlation, fit.correlation, atol=0.15)


def test_on_coloured_noise_blocks_tell_the_truth_and_single_draws_do_not() -> None:
    clean = record(LINE, STRAIGHT, TIME, DRIVE)
    asked = po.Identification(LINE, clean, start=po.Start.REST)
    offsets, blocks, singly = [], [], []
    for seed in range(60):
        noise = NOISE * reddened(np.random.default_rng(seed).normal(size=TIME.size), 0.8)
        fit = po.solve(asked.with_records(clean.with_(position=clean.position + noise)))
        offsets.append(fit.values["offset.y0"])
        if seed < 8:
            blocks.append(po.bootstrap(fit, 60).std["offset.y0"])
            singly.append(po.bootstrap(fit, 60, block=1).std["offset.y0"])
    truth = np.std(offsets)
    assert np.median(blocks) == pytest.approx(truth, rel=0.35)
    assert np.median(singly) < 0.55 * truth


def test_an_estimate_at_its_bound_has_a_one_sided_interval() -> None:
    clean = record(STILL, {**TRUTH, "bouc_wen.gamma": 0.0}, TIME, DRIVE, noise=NOISE)
    asked = po.Identification(
        STILL, clean, start=po.Start.REST, bounds={"bouc_wen.gamma": (0.0, 1.0)}
    )
    fit = po.solve(asked)
    low, high = po.bootstrap(fit, 100).interval("bouc_wen.gamma")
    assert low == 0.0
    assert 0.0 < high < 5e-3
    profile = po.profile_likelihood(fit, ["bouc_wen.gamma"])["bouc_wen.gamma"]
    assert profile.open[0]
    assert profile.interval[0] == 0.0
    assert 0.0 < profile.interval[1] < 5e-3


def test_priors_are_drawn_with_the_readings(fit: po.Fit) -> None:
    """A prior far sharper than the data: the deviation is that of the prior."""
    sharp = 0.1 * fit.std["bouc_wen.beta"]
    asked = replace(
        fit.question, noise=NOISE, priors={"bouc_wen.beta": po.Prior(TRUTH["bouc_wen.beta"], sharp)}
    )
    found = po.bootstrap(po.solve(asked), 200)
    assert found.std["bouc_wen.beta"] == pytest.approx(sharp, rel=0.15)


def test_a_replicate_depends_on_seed_and_number_alone(fit: po.Fit, tmp_path: Path) -> None:
    whole = po.bootstrap(fit, 24, seed=3)
    with ThreadPoolExecutor(2) as pool:
        spread = po.bootstrap(fit, 24, seed=3, executor=pool)
    np.testing.assert_array_equal(whole.estimates, spread.estimates)
    assert np.any(po.bootstrap(fit, 24, seed=4).estimates != whole.estimates)
    log = tmp_path / "replicates.h5"

    def stop(done: int, _of: int) -> None:
        if done == 9:
            raise KeyboardInterrupt

    first = po.bootstrap(fit, 24, seed=3, log=log, progress=stop)
    assert first.interrupted
    assert len(first.estimates) == 9
    seen: list[int] = []
    resumed = po.bootstrap(fit, 24, seed=3, log=log, progress=lambda done, _: seen.append(done))
    assert seen == list(range(10, 25))
    np.testing.assert_array_equal(resumed.estimates, whole.estimates)
    with pytest.raises(po.InputError, match="another question"):
        po.bootstrap(fit, 24, seed=4, log=log)
    with pytest.raises(po.InputError, match="another question"):
        po.profile_likelihood(fit, log=log)


def test_where_the_model_is_linear_the_profile_is_student_s_interval() -> None:
    asked = po.Identification(
        LINE, record(LINE, STRAIGHT, TIME, DRIVE, noise=NOISE), start=po.Start.REST
    )
    fit = po.solve(asked)
    found = po.profile_likelihood(fit, level=0.9)
    for name in fit.names:
        np.testing.assert_allclose(found.interval(name), fit.interval(name, 0.9), rtol=1e-6)
        one = found[name]
        # A straight line: tau is the distance in deviations.
        np.testing.assert_allclose(
            one.tau, (one.values - one.value) / fit.std[name], rtol=1e-4, atol=1e-9
        )


def test_where_it_is_not_the_ends_are_where_the_cost_says(fit: po.Fit) -> None:
    short = fit.question.campaign.records[0].slice(stop=0.6)
    little = po.solve(fit.question.with_records(short))
    name = "bouc_wen.beta"
    profile = po.profile_likelihood(little, [name])[name]
    wanted = little.rms**2 * little.residuals.size
    freedom = little.residuals.size - len(little.names)
    limit = stats.t.ppf(0.975, freedom) ** 2 * wanted / freedom
    for end, is_open in zip(profile.interval, profile.open, strict=True):
        if is_open:
            continue
        held = po.solve(replace(little.question, fixed={name: end}), start=little)
        above = held.rms**2 * held.residuals.size - wanted
        assert above == pytest.approx(limit, rel=0.02)
    assert not all(profile.open)
    lower, upper = (abs(end - profile.value) for end in profile.interval)
    assert max(lower, upper) > 1.02 * min(lower, upper)  # which no covariance says


def test_a_direction_without_a_limit_is_open() -> None:
    """A loop that the drive never closes: beta and gamma are not seen apart."""
    time = np.linspace(0.0, 1.0, 200)
    rising = record(STILL, TRUTH, time, 20.0 * time, noise=NOISE)
    fit = po.solve(po.Identification(STILL, rising, start=po.Start.REST, values=TRUTH))
    found = po.profile_likelihood(fit, ["bouc_wen.beta", "piezo_gain.d"])
    assert found["bouc_wen.beta"].open == (True, True)
    assert np.abs(found["bouc_wen.beta"].tau).max() < 0.1
    assert "bouc_wen.beta: the data set no limit in either direction." in str(found)
    assert found.to_dict()["parameters"]["bouc_wen.beta"]["open"] == [True, True]
    assert found["piezo_gain.d"].open == (False, False)


def test_walks_are_spread_and_resumed(fit: po.Fit, tmp_path: Path) -> None:
    log, names = tmp_path / "walks.h5", ["bouc_wen.alpha", "piezo_gain.d"]
    alone = po.profile_likelihood(fit, names)
    with ThreadPoolExecutor(2) as pool:
        together = po.profile_likelihood(fit, names, executor=pool, log=log)
    seen: list[int] = []
    again = po.profile_likelihood(fit, names, log=log, progress=lambda d, _: seen.append(d))
    assert seen == []
    for name in names:
        assert alone.interval(name) == together.interval(name) == again.interval(name)


def test_what_makes_no_sense_is_refused(fit: po.Fit) -> None:
    with pytest.raises(po.InputError, match="at least 20"):
        po.bootstrap(fit, 5)
    with pytest.raises(po.InputError, match="between 0 and 1"):
        po.profile_likelihood(fit, level=95)
    with pytest.raises(po.ModelError, match=r"was not estimated; the unknowns are piezo_gain\.d"):
        po.profile_likelihood(fit, ["bouc_wen.n"])
