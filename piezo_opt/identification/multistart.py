"""Many starts of one question: drawn with a seed, run on any executor, kept in a log."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.errors import ModelError
from piezo_opt.identification.log import Entry, Log, fingerprint
from piezo_opt.identification.monitor import Monitor
from piezo_opt.identification.outcome import Ending
from piezo_opt.identification.problem import Identification
from piezo_opt.identification.result import StartResult
from piezo_opt.identification.solvers.base import Solution
from piezo_opt.identification.transcription import Transcription
from piezo_opt.identification.unknowns import Unknowns
from piezo_opt.spread import Lost, spread

FloatArray = NDArray[np.float64]

_DIFFER: Final = "model, records, bounds, loss, start, seed, transcription or solver"


@final
@dataclass(frozen=True, eq=False)
class Runs:
    """All starts, best first, where the best ended, and why the log lacks some of them."""

    results: tuple[StartResult, ...]
    theta: FloatArray
    ending: Ending
    sentence: str
    unlogged: str = ""


@final
@dataclass(frozen=True, eq=False)
class _Done:
    index: int
    theta: FloatArray
    cost: float
    rms: float
    ending: Ending
    sentence: str
    simulations: int
    with_sensitivities: int
    iterates: FloatArray
    iterate_rms: FloatArray


def draw(unknown: Unknowns, question: Identification, centre: FloatArray, seed: int,
         index: int) -> FloatArray:  # fmt: skip
    """Start number ``index``: the centre itself for 0, else one draw.

    A positive parameter with a typical range is drawn log-uniformly from it, another one
    uniformly; where there is none, within a factor of three of the centre. Per-record values and
    initial states stay at the centre.
    """
    if index == 0:
        return centre.copy()
    generator = np.random.default_rng([seed, index])
    theta = centre.copy()
    for k, member in enumerate(unknown.members):
        toss = generator.uniform()
        if member.local not in question.model.parameters or member.record is not None:
            continue
        parameter = question.model.parameters[member.local]
        if parameter.per_record:
            continue
        low, high = parameter.typical or (0.0, 0.0)
        if member.high <= 0.0:
            low, high = -high, -low
        low, high = max(low, member.low), min(high, member.high)
        if low < high and low > 0:
            theta[k] = low * (high / low) ** toss
        elif low < high:
            theta[k] = low + (high - low) * toss
        else:
            theta[k] = centre[k] * 3.0 ** (2.0 * toss - 1.0)
    return unknown.clip(theta)


def _run(task: _Task, job: tuple[int, FloatArray]) -> _Done:
    index, theta = job
    monitor = Monitor(task.unknown.names)
    try:
        solution = task.transcription.identify(
            task.question, task.unknown, theta, task.solver, monitor
        )
    except (ArithmeticError, ModelError) as error:
        return _failed(index, theta, str(error))
    except KeyboardInterrupt:
        if monitor.best is None:
            raise
        solution = Solution(monitor.best, Ending.INTERRUPTED, "")
    trace, spent = monitor.trace, monitor.evaluations
    rms = float(trace.rms[-1]) if trace.rms.size else float("inf")
    return _Done(
        index, solution.theta, monitor.best_cost, rms, solution.ending, solution.sentence,
        spent.simulations, spent.with_sensitivities, trace.values, trace.rms,
    )  # fmt: skip


def run_starts(
    question: Identification,
    unknown: Unknowns,
    centre: FloatArray,
    transcription: Transcription,
    solver: object | None,
    starts: int,
    seed: int,
    executor: Executor | None,
    log: str | Path | None,
    monitor: Monitor,
) -> Runs:
    """Run all starts that the log does not hold yet; the best one's iterates go to the monitor."""
    kept: Log | None = None
    if log:
        asked = fingerprint(question, unknown, centre, seed, transcription, solver)
        kept = Log(log, "piezo_opt/starts/2", asked, _DIFFER)
    done = {d.index: d for d in map(_done, kept.entries() if kept else ())}
    points = {i: draw(unknown, question, centre, seed, i) for i in range(starts) if i not in done}
    interrupted = False
    try:
        for one in _each(_Task(question, unknown, transcription, solver), points, executor):
            done[one.index] = one
            monitor.simulations += one.simulations
            monitor.with_sensitivities += one.with_sensitivities
            # An unfinished start may be the best so far, but must be run again.
            interrupted = one.ending is Ending.INTERRUPTED
            if kept and not interrupted:
                kept.append(_entry(one))
            best = min(done.values(), key=lambda d: d.cost)
            monitor.saw(best.theta, best.cost)
            monitor.iterate(best.theta, best.rms)
            if interrupted:
                break
    except KeyboardInterrupt:
        interrupted = True
    if not done:
        return Runs((), centre, Ending.INTERRUPTED, "")
    order = sorted((d for d in done.values() if d.index < starts), key=lambda d: d.cost)
    best = order[0]
    results = tuple(
        StartResult(
            d.index, d.rms, d.ending.value, dict(unknown.values(d.theta)),
            d.simulations + d.with_sensitivities,
        )
        for d in order
    )  # fmt: skip
    ending = Ending.INTERRUPTED if interrupted else best.ending
    return Runs(results, best.theta, ending, best.sentence, kept.lost if kept else "")


@final
@dataclass(frozen=True, eq=False)
class _Task:
    """What all starts share; travels to each worker once."""

    question: Identification
    unknown: Unknowns
    transcription: Transcription
    solver: object | None


def _each(
    task: _Task, points: Mapping[int, FloatArray], executor: Executor | None
) -> Iterator[_Done]:
    """Every start as it ends; one whose worker died again and again has failed."""
    jobs = list(points.items())
    for at, done in spread(_run, task, jobs, executor):
        index, theta = jobs[at]
        yield _failed(index, theta, done.sentence) if isinstance(done, Lost) else done


def _failed(index: int, theta: FloatArray, sentence: str) -> _Done:
    return _Done(
        index, theta, np.inf, np.inf, Ending.FAILED, sentence, 0, 0, np.zeros((0, theta.size)),
        np.zeros(0),
    )  # fmt: skip


def _entry(done: _Done) -> Entry:
    arrays = {name: getattr(done, name) for name in _ARRAYS}
    told = {name: getattr(done, name) for name in _TOLD}
    return Entry(done.index, arrays, {**told, "ending": done.ending.value})


def _done(entry: Entry) -> _Done:
    told = entry.told
    return _Done(
        entry.index, entry.arrays["theta"], float(told["cost"]), float(told["rms"]),
        Ending(told["ending"]), str(told["sentence"]), int(told["simulations"]),
        int(told["with_sensitivities"]), entry.arrays["iterates"], entry.arrays["iterate_rms"],
    )  # fmt: skip


_ARRAYS: Final = ("theta", "iterates", "iterate_rms")
_TOLD: Final = ("cost", "rms", "sentence", "simulations", "with_sensitivities")
