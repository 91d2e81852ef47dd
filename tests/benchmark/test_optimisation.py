"""Optimisers compared: prices, histories, profiles like a library's, logs, hiding."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import piezo_opt as po
from piezo_opt.benchmark.optimisation import (
    CASES,
    CONTENDERS,
    Comparison,
    Result,
    compare_optimisers,
    posed,
)
from piezo_opt.benchmark.optimisation.posed import Posed
from piezo_opt.benchmark.optimisation.profiles import (
    data_profile,
    performance_profile,
    work,
)
from piezo_opt.benchmark.optimisation.recording import Recorded, Spent
from piezo_opt.benchmark.optimisation.run import History, run
from piezo_opt.cli import app
from piezo_opt.identification.solvers.dense_program import DenseProgram
from piezo_opt.measurement import FloatArray


@pytest.fixture(scope="module")
def loops() -> Posed:
    return posed("minor_loops")


def test_there_are_enough_of_everything() -> None:
    assert len(CASES) >= 12
    assert sum(case.hard for case in CASES.values()) >= 4
    assert len(CONTENDERS) >= 14


def test_the_best_value_is_the_truth_s_or_below_it(loops: Posed) -> None:
    question, truth = CASES["minor_loops"].pose(0)
    at = np.array([truth[name] for name in loops.unknown.names])
    objective = loops.objective()
    there = objective.cost(objective.residual(at))
    assert 0.9 * there < loops.least <= there
    assert question.campaign.records[0].position.size == 300


def test_variants_differ_and_starts_do_not_depend_on_who_asks(loops: Posed) -> None:
    other = posed("minor_loops", 1)
    assert not np.allclose(other.best, loops.best, rtol=0.02)
    one, cost = loops.start(3)
    again, same = loops.start(3)
    np.testing.assert_array_equal(one, again)
    assert cost == same > 100.0 * loops.least
    reach = CASES["minor_loops"].reach
    ratio = one / loops.best
    assert np.all((ratio >= 1 / reach - 1e-9) & (ratio <= reach + 1e-9))
    assert np.any(loops.start(4)[0] != one)


def test_the_jacobian_is_checked(loops: Posed) -> None:
    assert loops.slopes < 1e-9


def test_a_simulation_is_charged_and_an_improvement_written_down(loops: Posed) -> None:
    book = Recorded(loops.objective(), 1.5, 5.0)
    start, first = loops.start(0)
    book.residual(start)
    book.residual(start)
    assert (book.spent, book.prices) == (2.0, [1.0])
    assert book.costs[0] == pytest.approx(first)
    book.linearised(loops.best)
    assert (book.spent, book.prices) == (3.5, [1.0, 3.5])
    assert book.costs[-1] == pytest.approx(loops.least)
    book.linearised(start)
    with pytest.raises(Spent):
        book.residual(start)
    assert book.spent == 5.0


@pytest.mark.parametrize(
    "name", ["gauss_newton", "scipy_exact", "scipy_differences", "nelder_mead", "nlopt_slsqp"]
)
def test_contenders_reach_the_best_known(name: str, loops: Posed) -> None:
    found = run(loops, name, 1, 400.0, 10.0)
    assert found.ending == "converged"
    assert found.costs[-1] / loops.least - 1 < 1e-6
    assert np.all(np.diff(found.prices) > 0)
    assert np.all(np.diff(found.costs) < 0)


def test_other_starts_leave_a_minimum_that_is_not_the_best() -> None:
    """Corners of play operators are minima: seed 5 ends in one from its own start."""
    plays = posed("play_operators", 1)
    alone, anew = (
        run(plays, name, 5, 400.0, 10.0) for name in ("gauss_newton", "gauss_newton_starts")
    )
    assert alone.ending == "converged"
    assert alone.costs[-1] / plays.least - 1 > 1e-4
    assert anew.costs[-1] / plays.least - 1 < 1e-6
    assert anew.spent <= 400.0 * (plays.best.size + 1)


def test_sub_steps_are_cut_where_corners_would_decide() -> None:
    history = posed("thesis_history")
    assert history.accuracy[0].substeps.times == CASES["thesis_history"].cut == 64
    found = run(history, "gauss_newton", 0, 400.0, 10.0)
    assert found.costs[-1] / history.least - 1 < 1e-6


def test_differences_pay_for_every_simulation(loops: Posed) -> None:
    exact, plain = (
        run(loops, name, 1, 400.0, 10.0) for name in ("scipy_exact", "scipy_differences")
    )
    assert plain.spent > 2.0 * exact.spent


@pytest.mark.parametrize("plugin", ["ipopt", "uno", "sqpmethod"])
def test_casadi_s_solvers_run_on_single_shooting(plugin: str, loops: Posed) -> None:
    found = run(loops, "ipopt_single" if plugin == "ipopt" else plugin, 1, 400.0, 20.0)
    assert found.costs[-1] / loops.least - 1 < 1e-5
    fit = po.solve(loops.question, solver=DenseProgram("sqpmethod"))
    assert fit.rms == pytest.approx(np.sqrt(2 * loops.least / 300), rel=1e-6)


@pytest.mark.parametrize("name", ["ipopt_multiple", "ipopt_collocation", "fatrop"])
def test_transcriptions_are_charged_their_time(name: str, loops: Posed) -> None:
    found = run(loops, name, 1, 1e5, 60.0)
    assert found.costs[-1] / loops.least - 1 < 1e-4
    assert found.prices[0] < 0.2 * found.prices[-1]  # nobody pays for writing it down
    assert found.spent > 3.0


def test_one_that_cannot_run_is_skipped_with_its_reason(loops: Posed) -> None:
    found = run(loops, "madnlp", 0, 400.0, 10.0)
    assert found.ending == "skipped"
    assert "madnlp" in found.reason


def made(histories: FloatArray, first: FloatArray, least: FloatArray) -> Comparison:
    """A comparison of histories (cases, solvers, evaluations), a cost an evaluation."""
    cases, solvers, length = histories.shape
    names = tuple(f"s{k}" for k in range(solvers))
    results = []
    for c in range(cases):
        for s in range(solvers):
            best = np.minimum.accumulate(histories[c, s])
            better = np.flatnonzero(np.diff(best, prepend=np.inf) < 0)
            history = History(better + 1.0, best[better], "converged", "", 1.0, 1.0, float(length))
            results.append(
                Result("p", 0, c, names[s], 2 + c % 3, float(first[c]), float(least[c]), 1.0, 1e-5,
                       0.0, 0.0, history)
            )  # fmt: skip
    return Comparison(("p",), names, tuple(results), 100.0)


@pytest.fixture(scope="module")
def walks() -> tuple[FloatArray, FloatArray, FloatArray]:
    generator = np.random.default_rng(3)
    steps = generator.exponential(size=(15, 4, 60)) * generator.uniform(0.1, 2.0, (15, 4, 1))
    histories = np.exp(-np.cumsum(steps, axis=2) / 4.0) * generator.uniform(0.7, 1.3, (15, 4, 60))
    histories = np.maximum(histories, 1e-6 * generator.uniform(1.0, 2.0, (15, 4, 1)))
    return histories, np.full(15, 1.4), histories.min(axis=(1, 2))


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("tolerance", [1e-1, 1e-3, 1e-5])
def test_profiles_are_those_of_optiprofiler(
    walks: tuple[FloatArray, FloatArray, FloatArray], tolerance: float
) -> None:
    """The same histories, the library's own arithmetic, every step of every staircase."""
    library = pytest.importorskip("optiprofiler.scoring")
    plotting = pytest.importorskip("optiprofiler.plotting")
    histories, first, least = walks
    cases, solvers, length = histories.shape
    whole = histories[:, :, None, :]
    theirs, _ = library.compute_convergence_work(
        merit_histories=whole, merit_outs=whole[..., -1], merit_inits=first[:, None],
        merit_mins=least[:, None], n_evals=np.full((cases, solvers, 1), length),
        tolerance=tolerance, invalid_initial=np.zeros((cases, 1), dtype=bool),
        valid_histories=np.ones(whole.shape, dtype=bool),
        valid_outs=np.ones((cases, solvers, 1), dtype=bool),
    )  # fmt: skip
    mine = made(histories, first, least)
    works, sizes = mine.works(tolerance)
    got = np.array([works[f"s{k}"] for k in range(solvers)]).T
    np.testing.assert_allclose(got, np.where(np.isnan(theirs[..., 0]), np.inf, theirs[..., 0]))
    for kind, denominator in (
        ("data", lambda c, _: sizes[c] + 1),
        ("performance", lambda c, run: np.nanmin(theirs[c, :, run], initial=np.inf)),
    ):
        at, share, _ = plotting._get_performance_data_profile_axes(theirs, denominator)
        for k, curve in enumerate(mine.profile(kind, tolerance).values()):  # type: ignore[arg-type]
            solved = np.isfinite(at[:, k])
            assert curve.at.size == solved.sum()
            np.testing.assert_allclose(curve.at, at[solved, k], rtol=1e-12)
            np.testing.assert_allclose(curve.share, share[solved, k, 0], rtol=1e-12)


def test_by_hand() -> None:
    """Two solvers, three cases: prices 3, 6, never against 6, 2, never; 2 unknowns each."""
    works = {"a": np.array([3.0, 6.0, np.inf]), "b": np.array([6.0, 2.0, np.inf])}
    data = data_profile(works, np.array([2.0, 2.0, 2.0]))
    assert data["a"](1.0) == pytest.approx(1 / 3)
    assert data["a"].reaches(2 / 3) == 2.0
    assert data["b"].reaches(0.9) == np.inf
    ratios = performance_profile(works)
    np.testing.assert_allclose(ratios["a"].at, [1.0, 3.0])
    np.testing.assert_allclose(ratios["b"].at, [1.0, 2.0])
    assert ratios["a"].last == pytest.approx(2 / 3)
    alone = performance_profile({"a": works["a"]})
    np.testing.assert_allclose(alone["a"].at, [1.0, 1.0])
    costs = np.array([4.0, 1.0])
    assert work(np.array([2.0, 5.0]), costs, 10.0, 0.0, 0.5) == 2.0
    assert work(np.array([2.0, 5.0]), costs, 10.0, 0.0, 0.05) == np.inf


def test_hiding_a_solver_recomputes_the_ratios(
    walks: tuple[FloatArray, FloatArray, FloatArray],
) -> None:
    whole = made(*walks)
    part = whole.without("s0")
    assert list(part.profile("data", 1e-3)) == ["s1", "s2", "s3"]
    before, after = (c.profile("performance", 1e-3)["s1"](1.0) for c in (whole, part))
    assert after > before
    # Data profiles of the others stay, as the best known value does not come from the race.
    low = np.full(15, 1e-7)
    whole = made(walks[0], walks[1], low)
    np.testing.assert_array_equal(
        whole.profile("data", 1e-2)["s1"].at, whole.without("s0").profile("data", 1e-2)["s1"].at
    )
    with pytest.raises(po.InputError, match="did not take part"):
        whole.without("s9")
    with pytest.raises(po.InputError, match="leaves nobody"):
        whole.without("s0", "s1", "s2", "s3")


ASKED: Mapping[str, Any] = {
    "problems": ["thesis_loop"], "contenders": ["gauss_newton", "nelder_mead_thesis", "madnlp"],
    "variants": 2,
}  # fmt: skip


def test_the_log_goes_on_and_refuses_another_race(tmp_path: Path) -> None:
    log = tmp_path / "race.h5"
    done: list[int] = []
    first = compare_optimisers(**ASKED, seeds=1, log=log, progress=lambda d, _: done.append(d))
    assert done == [1, 2, 3]
    more = compare_optimisers(**ASKED, seeds=2, log=log, progress=lambda d, _: done.append(d))
    assert done == [1, 2, 3, 4, 5, 6]
    assert len(more.results) == 6
    for one, again in zip(first.results, more.results, strict=False):
        np.testing.assert_array_equal(one.history.costs, again.history.costs)
    with pytest.raises(po.InputError, match="belongs to another question"):
        compare_optimisers(**ASKED, seeds=1, log=log, budget=10.0)
    # What is told of it.
    assert list(more.skipped) == ["madnlp"]
    assert "madnlp did not run" in str(more)
    thesis = [r for r in more.results if r.contender == "nelder_mead_thesis"]
    exact = [r for r in more.results if r.contender == "gauss_newton"]
    assert all(np.isfinite(r.price) for r in exact)
    assert all(262 < r.history.spent < 800 for r in thesis)
    assert more.lowered() == {}
    sentences = more.sentences("data", 1e-7)
    assert sentences[0].startswith("gauss_newton is the first to have solved 90 % of the 2 cases")
    json.dumps(more.to_dict())


def test_names_that_there_are_not() -> None:
    with pytest.raises(po.InputError, match="no problem 'nothing': there are thesis_loop"):
        compare_optimisers(["nothing"])
    with pytest.raises(po.InputError, match="at least one of each"):
        compare_optimisers(["thesis_loop"], seeds=0)


def test_the_command_writes_pictures_and_numbers(tmp_path: Path) -> None:
    out = tmp_path / "race"
    asked = [
        "bench", "optimisers", "--problems", "thesis_loop", "--seeds", "2",
        "--solvers", "gauss_newton,scipy_exact,nelder_mead", "--log", str(tmp_path / "race.h5"),
        "--out", str(out), "--json", str(tmp_path / "race.json"),
    ]  # fmt: skip
    result = CliRunner().invoke(app, asked)
    assert result.exit_code == 0, result.output
    assert "Performance profile at 0.001:" in result.stdout
    assert "minutes on 1 idle cores" in result.stdout
    assert sorted(p.suffix for p in out.iterdir()) == [".csv"] * 4 + [".png"] * 4
    with (out / "performance_profile_1e-03.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["solver"] for row in rows} == {"gauss_newton", "scipy_exact", "nelder_mead"}
    assert max(float(row["share"]) for row in rows) == 1.0
    told = json.loads((tmp_path / "race.json").read_text())
    assert told["schema"] == "piezo_opt/optimisers/1"
    refused = CliRunner().invoke(app, asked)
    assert refused.exit_code == 2
    again = CliRunner().invoke(app, [*asked, "--hide", "gauss_newton", "--overwrite"])
    assert again.exit_code == 0, again.output
    assert "gauss_newton" not in again.stdout
