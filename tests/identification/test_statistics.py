"""Intervals that hold what they promise, and sentences only on what is really hidden."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal, stats

from piezo_opt.identification.objective import Linearised
from piezo_opt.identification.statistics import (
    _autocorrelation,
    _long_run,
    blind_spots,
    uncertainty,
)
from piezo_opt.measurement import FloatArray

N = 600
CLOCK = np.linspace(0.0, 1.0, N)
LINE = np.column_stack([np.ones(N), CLOCK - 0.5])
BOTH = np.array([True, True])


def autoregressive(seed: int, phi: float) -> FloatArray:
    white = np.random.default_rng(seed).normal(size=N + 200)
    return np.asarray(signal.lfilter([1.0], [1.0, -phi], white)[200:])


def left(noise: FloatArray, j: FloatArray = LINE) -> FloatArray:
    """What least squares leaves of a noise."""
    return np.asarray(noise - j @ np.linalg.lstsq(j, noise, rcond=None)[0])


def test_white_residuals_give_the_textbook_covariance() -> None:
    residual = left(autoregressive(0, 0.0))
    known = uncertainty(Linearised(residual, LINE), BOTH, N)
    by_hand = float(residual @ residual) / (N - 2) * np.linalg.inv(LINE.T @ LINE)
    assert not known.coloured
    np.testing.assert_allclose(known.covariance, by_hand, rtol=1e-9, atol=1e-15)


def test_correlated_residuals_widen_the_intervals_by_the_inflation_of_their_spectrum() -> None:
    phi = 0.7
    ratios = []
    for seed in range(30):
        residual = left(autoregressive(seed, phi))
        known = uncertainty(Linearised(residual, LINE), BOTH, N)
        assert known.coloured
        white = float(residual @ residual) / (N - 2) * np.linalg.inv(LINE.T @ LINE)
        ratios.append(np.sqrt(known.covariance[0, 0] / white[0, 0]))
    # The mean of an AR(1) process has a variance larger by (1 + phi) / (1 - phi).
    truth = np.sqrt((1 + phi) / (1 - phi))
    assert 0.75 * truth < np.mean(ratios) < 1.1 * truth
    assert min(ratios) > 1.3


def test_correlation_never_makes_surer_than_white_noise() -> None:
    residual = left(autoregressive(3, -0.8))
    known = uncertainty(Linearised(residual, LINE), BOTH, N)
    white = float(residual @ residual) / (N - 2) * np.linalg.inv(LINE.T @ LINE)
    assert known.coloured
    assert np.all(np.diag(known.covariance) >= np.diag(white) * (1 - 1e-12))


@pytest.mark.parametrize("phi", [0.0, 0.6])
def test_intervals_cover_the_truth_as_often_as_they_say(phi: float) -> None:
    covered = np.zeros(2)
    draws, reach = 200, float(stats.t.ppf(0.975, N - 2))
    for seed in range(draws):
        noise = autoregressive(1000 + seed, phi)
        estimate = np.linalg.lstsq(LINE, noise, rcond=None)[0]
        known = uncertainty(Linearised(noise - LINE @ estimate, LINE), BOTH, N)
        covered += np.abs(estimate) <= reach * np.sqrt(np.diag(known.covariance))
    assert np.all(covered / draws > 0.85)
    assert np.all(covered / draws < 0.99)


def test_an_unknown_at_its_bound_has_no_interval_and_widens_no_other() -> None:
    residual = left(autoregressive(0, 0.0), LINE[:, :1])
    known = uncertainty(Linearised(residual, LINE), np.array([True, False]), N)
    assert np.isnan(known.covariance[1]).all()
    assert np.isnan(known.covariance[:, 1]).all()
    assert known.covariance[0, 0] == pytest.approx(float(residual @ residual) / (N - 1) / N)


def test_rows_of_priors_sharpen_but_are_no_samples() -> None:
    residual = left(autoregressive(0, 0.0))
    pinned = np.vstack([LINE, [[0.0, 1e3]]])
    known = uncertainty(Linearised(np.append(residual, 0.0), pinned), BOTH, N)
    sigma2 = float(residual @ residual) / (N - 2)
    by_hand = sigma2 * np.linalg.inv(pinned.T @ pinned)
    np.testing.assert_allclose(known.covariance, by_hand, rtol=1e-9, atol=1e-15)


def told(names: tuple[str, ...], columns: FloatArray, noise: float = 1e-3) -> tuple[str, ...]:
    k = columns.shape[1]
    residual = noise * autoregressive(0, 0.0)
    theta, free = np.ones(k), np.ones(k, dtype=bool)
    return blind_spots(names, theta, np.ones(k), Linearised(residual, columns), free)


WAVES = np.column_stack([np.sin((k + 1) * np.pi * CLOCK) for k in range(4)])
NAMES = ("piezo_gain.d", "bouc_wen.alpha", "bouc_wen.beta", "creep.c")


def test_nothing_is_said_of_a_well_posed_problem() -> None:
    assert told(NAMES, WAVES) == ()


def test_an_exact_redundancy_is_named_with_its_members_and_no_other() -> None:
    columns = WAVES.copy()
    columns[:, 2] = columns[:, 0] + 2.0 * columns[:, 1]
    (sentence,) = told(NAMES, columns)
    assert "piezo_gain.d, bouc_wen.alpha and bouc_wen.beta are redundant" in sentence
    assert "creep.c" not in sentence
    assert sentence.endswith("does not change the reading at all.")
    # J (1, 2, -1)' = 0: the direction is told with its sizes and signs.
    ways = ("piezo_gain.d -50 %, bouc_wen.alpha -100 %, bouc_wen.beta +50 %",
            "piezo_gain.d +50 %, bouc_wen.alpha +100 %, bouc_wen.beta -50 %")  # fmt: skip
    assert any(way in sentence for way in ways)


@pytest.mark.parametrize(("sign", "word"), [(1.0, "add up"), (-1.0, "cancel")])
def test_a_nearly_parallel_pair_is_named(sign: float, word: str) -> None:
    columns = WAVES[:, :3].copy()
    columns[:, 1] = sign * columns[:, 0] + 0.1 * columns[:, 3 - 1]
    columns[:, 2] = WAVES[:, 3]
    (sentence,) = told(NAMES[:3], columns)
    assert f"piezo_gain.d and bouc_wen.alpha nearly {word}" in sentence
    # cos of the angle between the columns is 1 / sqrt(1.01); the estimates have its negative.
    assert f"correlation {-sign / np.sqrt(1.01):+.4f}" in sentence


def test_what_is_not_seen_is_named() -> None:
    columns = WAVES.copy()
    columns[:, 3] *= 1e-6
    (sentence,) = told(NAMES, columns)
    assert sentence.startswith("creep.c is not seen")


def test_what_the_offset_can_explain_is_not_seen() -> None:
    columns = np.column_stack([WAVES[:, 0], np.ones(N), 3.0 * np.ones(N)])
    (sentence,) = told(("piezo_gain.d", "offset.y0", "drift.rate"), columns)
    assert "drift.rate" in sentence
    assert "piezo_gain.d" not in sentence
    assert told(("piezo_gain.d", "creep.c"), columns[:, [0, 2]]) == ()


def test_a_nuisance_alone_is_not_talked_about() -> None:
    columns = WAVES[:, :3].copy()
    columns[:, 2] *= 1e-9
    assert told((*NAMES[:2], "initial.bouc_wen.h"), columns) == ()


@pytest.mark.parametrize(("rows", "lags"), [(50, 0), (50, 7), (9, 8), (600, 150)])
@pytest.mark.parametrize("at_once", [65536, 100])
def test_the_long_run_covariance_is_its_sum_over_lags(
    rows: int, lags: int, at_once: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("piezo_opt.identification.statistics._AT_ONCE", at_once)
    generator = np.random.default_rng(rows + lags)
    j, r = generator.normal(size=(rows + 2, 4)), generator.normal(size=rows)
    columns = np.array([0, 1, 3])
    score = j[:rows, columns] * r[:, None]
    middle = score.T @ score
    for lag in range(1, lags + 1):
        cross = score[lag:].T @ score[:-lag]
        middle += (1.0 - lag / (lags + 1.0)) * (cross + cross.T)
    np.testing.assert_allclose(_long_run(j, r, lags, columns), middle, rtol=1e-10, atol=1e-10)


def test_the_autocorrelation_is_its_sum() -> None:
    r = np.random.default_rng(1).normal(size=101)
    away = r - r.mean()
    by_hand = [away[k:] @ away[:-k] / (away @ away) for k in range(1, 41)]
    np.testing.assert_allclose(_autocorrelation(r, 40), by_hand, atol=1e-12)
