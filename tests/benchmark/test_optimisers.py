"""The race: starts, success, prices, profiles, skips with reasons, interruption."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, final

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.benchmark.optimisers import Contender, Measure, Race, Run, race
from piezo_opt.benchmark.table import table
from piezo_opt.identification.objective import Objective
from piezo_opt.identification.outcome import Ending
from piezo_opt.identification.solvers.base import Solution
from problems import thesis_loop


def run(problem: str, contender: str, start: int, rms: float, price: int, reason: str = "") -> Run:
    ending = "skipped" if reason and not math.isfinite(rms) else "converged"
    return Run(problem, contender, start, rms, ending, price, 0.1 * price, reason)


BY_HAND = Race(
    ("p", "q"),
    ("a", "b"),
    (
        run("p", "a", 0, 1.0, 10), run("p", "a", 1, 1.0005, 20),
        run("p", "b", 0, 1.0, 5), run("p", "b", 1, 3.0, 5),
        run("q", "a", 0, 2.0, 8), run("q", "a", 1, 2.0, 8),
        run("q", "b", 0, math.inf, 0, "b cannot"), run("q", "b", 1, math.inf, 0, "b cannot"),
    ),
    1e-3,
)  # fmt: skip


def test_success_is_measured_against_the_best_of_all() -> None:
    rows = {(r.problem, r.contender): r for r in BY_HAND.rows()}
    assert rows["p", "a"].success == 1.0
    assert rows["p", "b"].success == 0.5
    assert rows["p", "a"].simulations == 15.0
    assert rows["p", "a"].ratio == 3.0
    assert rows["p", "b"].ratio == 1.0
    assert rows["q", "b"].success == 0.0
    assert rows["q", "b"].reason == "b cannot"
    assert math.isnan(rows["q", "b"].simulations)
    assert "b: b cannot" in str(BY_HAND)


def test_the_profile_is_dolan_and_more_s() -> None:
    """Cases p0, p1, q0, q1: a has ratios 2, 1, 1, 1; b has 1 and fails three times."""
    profile = BY_HAND.profile()
    np.testing.assert_allclose(profile.ratios["a"], [1.0, 1.0, 1.0, 2.0])
    np.testing.assert_allclose(profile.ratios["b"], [1.0, math.inf, math.inf, math.inf])
    assert profile.share("a", 1.0) == 0.75
    assert profile.share("a", 2.0) == 1.0
    assert profile.share("b", 1e9) == 0.25
    seconds = BY_HAND.profile(Measure.SECONDS)
    np.testing.assert_allclose(seconds.ratios["a"], profile.ratios["a"])


@pytest.fixture(scope="module")
def loop() -> Race:
    return race(
        {"thesis_loop": thesis_loop.question()},
        [Contender(), Contender(po.ScipyLeastSquares()), Contender(po.NelderMead())],
        starts=3,
        seed=4,
    )


def test_on_the_thesis_loop_all_agree_and_the_simplex_pays(loop: Race) -> None:
    assert loop.best("thesis_loop") == pytest.approx(0.1690e-6, abs=5e-11)
    rows = {r.contender: r for r in loop.rows()}
    assert all(r.success == 1.0 for r in rows.values())
    assert rows["nelder_mead"].ratio > 10.0
    assert rows["levenberg_marquardt"].ratio < 2.0
    assert loop.profile().share("nelder_mead", 2.0) == 0.0


def test_all_contenders_begin_at_the_same_drawn_points() -> None:
    seen: dict[str, list[Any]] = {"one": [], "two": []}

    @final
    @dataclass(frozen=True)
    class Watcher:
        name: str

        def minimise(self, objective: Objective, start: Any) -> Solution:
            seen[self.name].append(start)
            return Solution(start, Ending.CONVERGED, "")

    race({"loop": thesis_loop.question()}, [Contender(Watcher(n)) for n in seen], starts=3, seed=1)
    first, second = (np.array(seen[n])[::2] for n in seen)  # each is asked again after refinement
    if len(seen["one"]) == 3:
        first, second = np.array(seen["one"]), np.array(seen["two"])
    np.testing.assert_array_equal(first, second)
    assert len(np.unique(first, axis=0)) == len(first)


def test_a_refusal_is_a_skip_with_its_sentence() -> None:
    result = race(
        {"loop": thesis_loop.question()}, [Contender(), Contender(object(), name="nothing")],
        starts=1,
    )  # fmt: skip
    row = next(r for r in result.rows() if r.contender == "nothing")
    assert row.success == 0.0
    assert "object solves nonlinear programs, not residuals" in row.reason
    skipped = next(r for r in result.to_dict()["runs"] if r["contender"] == "nothing")
    assert (skipped["rms"], skipped["ending"]) == (None, "skipped")


def test_out_of_time_a_run_counts_with_what_it_reached() -> None:
    result = race(
        {"loop": thesis_loop.question()}, [Contender(po.NelderMead())], starts=1, limit_s=1e-3
    )
    (one,) = result.runs
    assert one.reason == "stopped after 0.001 s"
    assert one.ending == "interrupted"
    assert math.isfinite(one.rms)


def test_interrupted_it_keeps_what_is_done() -> None:
    def stop(done: int, _of: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    result = race({"loop": thesis_loop.question()}, [Contender()], starts=4, progress=stop)
    assert len(result.runs) == 1


def test_an_executor_changes_nothing_but_the_clock() -> None:
    questions = {"loop": thesis_loop.question()}
    alone = race(questions, [Contender()], starts=3)
    with ThreadPoolExecutor(2) as pool:
        together = race(questions, [Contender()], starts=3, executor=pool)
    assert [(r.start, r.rms, r.simulations) for r in alone.runs] == [
        (r.start, r.rms, r.simulations) for r in together.runs
    ]


def test_contenders_need_different_names() -> None:
    with pytest.raises(po.InputError, match="different names"):
        race({"loop": thesis_loop.question()}, [Contender(), Contender()])


def test_numbers_stand_to_the_right() -> None:
    assert table(("name", "n"), [("a", "1"), ("longer", "12.5")]) == (
        "name       n\na          1\nlonger  12.5"
    )
