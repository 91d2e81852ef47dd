"""Many starts: the same every time, wherever they run, and never lost."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.identification import Ending, Progress
from piezo_opt.identification.multistart import draw
from piezo_opt.identification.objective import Objective
from piezo_opt.identification.solvers.base import Solution
from piezo_opt.identification.unknowns import theta_of, unknowns
from piezo_opt.measurement import FloatArray
from tests.identification.truth import STILL, TRUTH, loops, record

TIME, DRIVE = loops(200)
NOISE = 3e-9
QUESTION = po.Identification(STILL, record(STILL, TRUTH, TIME, DRIVE, noise=NOISE))


def finished(path: Path) -> dict[str, float]:
    """Cost of each start in a log."""
    with h5py.File(path) as file:
        return {name: float(file[name].attrs["cost"]) for name in file}


def test_starts_are_drawn_from_the_typical_ranges() -> None:
    unknown = unknowns(QUESTION, po.Values(TRUTH))
    centre = theta_of(unknown, TRUTH)
    np.testing.assert_array_equal(draw(unknown, QUESTION, centre, 7, 0), centre)
    draws = np.array([draw(unknown, QUESTION, centre, 7, i) for i in range(1, 300)])
    by_name = dict(zip(unknown.names, draws.T, strict=True))
    for name in ("piezo_gain.d", "bouc_wen.alpha", "bouc_wen.beta", "bouc_wen.gamma"):
        low, high = STILL.parameters[name].typical or (0.0, 0.0)
        assert low <= by_name[name].min() < by_name[name].max() <= high
    low, high = STILL.parameters["bouc_wen.beta"].typical or (1.0, 1.0)
    # Log-uniform where positive, uniform else.
    assert np.median(np.log(by_name["bouc_wen.beta"])) == pytest.approx(
        0.5 * np.log(low * high), abs=0.3
    )
    assert abs(np.median(by_name["bouc_wen.gamma"])) < 4e-3
    # What belongs to a record stays where it was found.
    assert np.all(by_name["initial.bouc_wen.h"] == 0.0)
    assert np.all(by_name["offset.y0"] == TRUTH["offset.y0"])


def test_a_draw_depends_on_seed_and_number_alone() -> None:
    unknown = unknowns(QUESTION, po.Values(TRUTH))
    centre = theta_of(unknown, TRUTH)
    one = draw(unknown, QUESTION, centre, 3, 5)
    np.testing.assert_array_equal(one, draw(unknown, QUESTION, centre, 3, 5))
    assert np.any(one != draw(unknown, QUESTION, centre, 3, 6))
    assert np.any(one != draw(unknown, QUESTION, centre, 4, 5))


def test_draws_stay_within_the_bounds() -> None:
    tight = replace(QUESTION, bounds={"bouc_wen.beta": (0.049, 0.051), "piezo_gain.d": (1, 2)})
    unknown = unknowns(tight, po.Values(TRUTH))
    centre = theta_of(unknown, TRUTH)
    for i in range(50):
        theta = draw(unknown, tight, centre, 0, i)
        assert np.all((theta >= unknown.low) & (theta <= unknown.high))


def test_starts_are_reproducible_and_the_best_wins() -> None:
    one, two = (po.solve(QUESTION, starts=4, seed=11) for _ in range(2))
    assert [s.index for s in one.starts] == [s.index for s in two.starts]
    assert sorted(s.index for s in one.starts) == [0, 1, 2, 3]
    assert [s.rms for s in one.starts] == [s.rms for s in two.starts]
    assert dict(one.values) == dict(two.values)
    rms = [s.rms for s in one.starts]
    assert rms == pytest.approx(sorted(rms), rel=1e-9)
    assert one.rms == pytest.approx(rms[0], rel=1e-6)
    assert one.rms < 1.1 * NOISE
    assert one.evaluations.total >= sum(s.evaluations for s in one.starts)
    assert len(one.to_dict()["starts"]) == 4


def test_the_best_of_unfinished_starts_wins() -> None:
    seen: list[Progress] = []
    short = po.LevenbergMarquardt(iterations=3)
    wrong = replace(QUESTION, values={"bouc_wen.beta": 0.3, "bouc_wen.alpha": 2e-7})
    fit = po.solve(wrong, starts=6, seed=1, solver=short, progress=seen.append)
    rms = [s.rms for s in fit.starts]
    assert rms == sorted(rms)
    assert rms[-1] > 1.5 * rms[0]
    assert fit.starts[0].index != 0
    assert fit.rms == pytest.approx(rms[0], rel=1e-3)
    # What is shown on the way is the best so far.
    shown = [p.rms for p in seen]
    assert shown == sorted(shown, reverse=True)
    assert shown[-1] == rms[0]


def test_an_executor_changes_nothing_but_the_time() -> None:
    alone = po.solve(QUESTION, starts=4, seed=11)
    with ThreadPoolExecutor(2) as pool:
        together = po.solve(QUESTION, starts=4, seed=11, executor=pool)
    key = lambda s: s.index  # noqa: E731
    for a, b in zip(sorted(alone.starts, key=key), sorted(together.starts, key=key), strict=True):
        assert (a.index, a.rms, a.values, a.evaluations) == (
            b.index,
            b.rms,
            b.values,
            b.evaluations,
        )
    assert together.rms == pytest.approx(alone.rms, rel=1e-9)


def stop_after(count: int) -> Any:
    def progress(state: Progress) -> None:
        if state.iteration == count:
            raise KeyboardInterrupt

    return progress


def test_an_interrupted_log_is_gone_on_with(tmp_path: Path) -> None:
    log = tmp_path / "starts.h5"
    stopped = po.solve(QUESTION, starts=6, seed=2, log=log, progress=stop_after(3))
    assert stopped.outcome.ending is Ending.INTERRUPTED
    assert len(stopped.starts) == 3
    first = finished(log)
    assert len(first) == 3
    steps: list[Progress] = []
    resumed = po.solve(QUESTION, starts=6, seed=2, log=log, progress=steps.append)
    assert len(steps) == 3
    assert sorted(s.index for s in resumed.starts) == list(range(6))
    assert {name: finished(log)[name] for name in first} == first
    whole = po.solve(QUESTION, starts=6, seed=2)
    assert [s.rms for s in resumed.starts] == [s.rms for s in whole.starts]
    assert dict(resumed.values) == dict(whole.values)
    # All of it done: nothing is run any more.
    again = po.solve(QUESTION, starts=6, seed=2, log=log, progress=steps.append)
    assert len(steps) == 3
    assert [s.rms for s in again.starts] == [s.rms for s in whole.starts]
    assert again.outcome.ending is whole.outcome.ending


class Stopped:
    """Levenberg-Marquardt that the user stops after some steps, or before the first."""

    name = "stopped"

    def __init__(self, steps: int) -> None:
        self.steps = steps

    def minimise(self, objective: Objective, start: FloatArray) -> Solution:
        if self.steps:
            po.LevenbergMarquardt(iterations=self.steps).minimise(objective, start)
        raise KeyboardInterrupt


def test_an_interrupt_before_anything_keeps_the_start_values() -> None:
    fit = po.solve(QUESTION, starts=3, solver=Stopped(0))
    assert fit.outcome.ending is Ending.INTERRUPTED
    assert fit.starts == ()
    assert np.isfinite(fit.rms)


def test_an_interrupt_within_a_start_keeps_its_best_and_runs_it_again(tmp_path: Path) -> None:
    far = replace(QUESTION, values={"bouc_wen.beta": 0.2, "bouc_wen.alpha": 1e-7})
    log = tmp_path / "starts.h5"
    fit = po.solve(far, starts=3, solver=Stopped(3), log=log)
    assert fit.outcome.ending is Ending.INTERRUPTED
    unmoved = po.solve(far, starts=3, solver=Stopped(0))
    assert fit.rms < 0.5 * unmoved.rms
    assert finished(log) == {}
    with pytest.raises(po.InputError, match="solver"):
        po.solve(far, starts=3, log=log)
    log.unlink()
    whole = po.solve(far, starts=3, log=log)
    assert len(finished(log)) == 3
    assert whole.rms < 1.1 * NOISE


@pytest.mark.parametrize(
    "changes",
    [
        {"fixed": {"bouc_wen.gamma": 0.0}},
        {"bounds": {"bouc_wen.beta": (0.01, 0.2)}},
        {"loss": po.Loss(po.Shape.HUBER, 1e-8)},
        {"start": po.Start.REST},
        {"noise": NOISE, "priors": {"piezo_gain.d": po.Prior(1e-7, 1e-9)}},
        {"records": record(STILL, TRUTH, TIME, DRIVE, noise=NOISE, seed=1)},
        {"records": record(STILL, TRUTH, TIME, DRIVE, noise=NOISE).with_(startup=0.5)},
        {"records": record(STILL, TRUTH, TIME, DRIVE, noise=NOISE).with_(between=po.Between.HELD)},
        {"weights": (2.0,)},
    ],
)
def test_the_log_of_another_question_is_refused(changes: dict[str, Any], tmp_path: Path) -> None:
    log = tmp_path / "starts.h5"
    at = {"values": TRUTH}
    po.solve(replace(QUESTION, **at), starts=2, log=log)
    before = log.read_bytes()
    with pytest.raises(po.InputError, match="another question") as refusal:
        po.solve(replace(QUESTION, **at, **changes), starts=2, log=log)
    assert "starts.h5" in str(refusal.value)
    assert "delete it" in str(refusal.value)
    assert log.read_bytes() == before


@pytest.mark.parametrize(
    "other",
    [
        {"solver": po.LevenbergMarquardt(tolerance=1e-6)},
        {"solver": po.ScipyLeastSquares()},
        {"transcription": po.SingleShooting(refine=False)},
        {"transcription": po.MultipleShooting()},
    ],
)
def test_the_log_of_another_solver_is_refused(other: dict[str, Any], tmp_path: Path) -> None:
    log = tmp_path / "starts.h5"
    first = po.solve(QUESTION, starts=2, log=log, solver=po.LevenbergMarquardt())
    with pytest.raises(po.InputError, match="transcription or solver differ"):
        po.solve(QUESTION, starts=2, log=log, **other)
    again = po.solve(QUESTION, starts=2, log=log, solver=po.LevenbergMarquardt())
    assert dict(again.values) == dict(first.values)


def test_another_seed_is_another_log(tmp_path: Path) -> None:
    log = tmp_path / "starts.h5"
    po.solve(QUESTION, starts=2, seed=0, log=log)
    with pytest.raises(po.InputError, match="seed"):
        po.solve(QUESTION, starts=2, seed=1, log=log)


@pytest.mark.parametrize("content", [b"", b"not a log at all", b"\x89HDF\r\n\x1a\n" + bytes(64)])
def test_an_unreadable_log_is_refused_and_left_alone(content: bytes, tmp_path: Path) -> None:
    log = tmp_path / "starts.h5"
    log.write_bytes(content)
    with pytest.raises(po.InputError, match="name another file"):
        po.solve(QUESTION, starts=2, log=log)
    assert log.read_bytes() == content


def test_a_directory_that_is_not_there_is_told_at_once(tmp_path: Path) -> None:
    with pytest.raises(po.InputError, match=r"starts\.h5: there is no folder"):
        po.solve(QUESTION, starts=2, log=tmp_path / "nowhere" / "starts.h5")
