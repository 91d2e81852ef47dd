"""The whole comparison: problems x contenders x starts, on any executor, kept in a log."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from importlib import metadata, resources
from pathlib import Path
from typing import Final, final

import numpy as np

from piezo_opt.benchmark.jobs import Counted, run_jobs
from piezo_opt.benchmark.optimisation.cases import CASES
from piezo_opt.benchmark.optimisation.contenders import CONTENDERS
from piezo_opt.benchmark.optimisation.posed import Posed, posed
from piezo_opt.benchmark.optimisation.result import Comparison, Result
from piezo_opt.benchmark.optimisation.run import History, run
from piezo_opt.errors import InputError
from piezo_opt.identification.log import Entry, Log

SEEDS: Final = 20
VARIANTS: Final = 4
BUDGET: Final = 400.0
"""Simulations for each unknown and one more: what a patient user would let a simplex search do."""
LIMIT_S: Final = 3.0

_FILES: Final = ("cases", "drives", "posed", "contenders", "libraries", "recording", "run")


@final
@dataclass(frozen=True)
class _Job:
    problem: str
    variant: int
    seed: int
    contender: str

    @property
    def number(self) -> int:
        """By which the log knows it."""
        return int(hashlib.sha256(repr(self).encode()).hexdigest()[:15], 16)


@final
@dataclass(frozen=True, eq=False)
class _Task:
    """What all runs share; travels to each worker once."""

    posed: dict[tuple[str, int], Posed]
    budget: float
    limit_s: float


def compare_optimisers(
    problems: Sequence[str] | None = None,
    contenders: Sequence[str] | None = None,
    *,
    seeds: int = SEEDS,
    variants: int = VARIANTS,
    budget: float = BUDGET,
    limit_s: float = LIMIT_S,
    executor: Executor | None = None,
    log: str | Path | None = None,
    progress: Counted | None = None,
) -> Comparison:
    """Let optimisers run from the same starts of the same problems, and keep what they reached.

    Seed number s is start number s of variant ``s mod variants`` of a problem. Everybody minimises
    the same cost on the same sub-steps. A simulation costs 1, one with sensitivities what it takes
    here over one without; solvers that do not simulate are charged their processor time, in
    simulations. Compiling and writing programs down is not charged; it is told.

    Args:
        problems: names out of ``CASES``; all unless given.
        contenders: names out of ``CONTENDERS``; all unless given.
        seeds: starts of each problem.
        variants: perturbed copies of each problem, 0 being the problem itself.
        budget: simulations for each unknown and one more, after which a run ends.
        limit_s: [s] of processor time after which a run in a process of its own is ended.
        executor: runs in parallel: any of ``concurrent.futures`` or of Dask.
        log: HDF5 file that keeps every run; a second call goes on from it, with more seeds,
            problems or contenders if wished.
        progress: called with (runs done, runs in all).

    Returns:
        the comparison of what was done, also when interrupted (Ctrl-C).

    Raises:
        InputError: a name that there is not, no start, or a log of another comparison.
    """
    names = _chosen("problem", problems, CASES)
    racers = _chosen("contender", contenders, CONTENDERS)
    if seeds < 1 or variants < 1 or not budget > 0 or not limit_s > 0:
        raise InputError(
            f"compare_optimisers(seeds={seeds}, variants={variants}, budget={budget}, "
            f"limit_s={limit_s}): give at least one of each, and positive limits."
        )
    jobs = [
        _Job(name, seed % variants, seed, racer)
        for name in names
        for seed in range(seeds)
        for racer in racers
    ]
    kept: Log | None = None
    if log is not None:
        kept = Log(log, "piezo_opt/races/1", _question(budget, limit_s),
                   "the package's problems or solvers, budget, or time limit")  # fmt: skip
    by_number = {job.number: job for job in jobs}
    done = {e.index: _read(e) for e in (kept.entries() if kept else ()) if e.index in by_number}
    try:
        todo = [job for job in jobs if job.number not in done]
        needed = dict.fromkeys((job.problem, job.variant) for job in todo)
        task = _Task({key: posed(*key) for key in needed}, budget, limit_s)

        def tell(count: int, _: int) -> None:
            if progress is not None:
                progress(len(jobs) - len(todo) + count, len(jobs))

        for one in run_jobs(_run, task, todo, executor, tell, _Lost(task)):
            number = _Job(one.problem, one.variant, one.seed, one.contender).number
            done[number] = one
            if kept is not None:
                kept.append(_entry(number, one))
    except KeyboardInterrupt:
        if not done:
            raise
    results = tuple(done[job.number] for job in jobs if job.number in done)
    return Comparison(names, racers, results, budget)


def _chosen(what: str, given: Sequence[str] | None, known: object) -> tuple[str, ...]:
    there = tuple(known)  # type: ignore[arg-type, var-annotated]
    wished = there if given is None else tuple(dict.fromkeys(given))
    for name in wished:
        if name not in there:
            raise InputError(f"There is no {what} '{name}': there are {', '.join(there)}.")
    if not wished:
        raise InputError(f"Name at least one {what} out of {', '.join(there)}.")
    return wished


def _question(budget: float, limit_s: float) -> str:
    """Hash of all that a run's history follows from but its own names."""
    here = resources.files(__package__)
    digest = hashlib.sha256(repr((budget, limit_s)).encode())
    for name in _FILES:
        digest.update(here.joinpath(f"{name}.py").read_bytes())
    for library in ("casadi", "scipy", "numpy"):
        digest.update(metadata.version(library).encode())
    return digest.hexdigest()


def _run(task: _Task, job: _Job) -> Result:
    at = task.posed[job.problem, job.variant]
    return _result(at, job, run(at, job.contender, job.seed, task.budget, task.limit_s))


@final
@dataclass(frozen=True, eq=False)
class _Lost:
    """The result of a run whose worker died."""

    task: _Task

    def __call__(self, job: _Job, sentence: str) -> Result:
        nothing = np.zeros(0)
        return _result(
            self.task.posed[job.problem, job.variant], job,
            History(nothing, nothing, "failed", sentence, 0.0, 0.0, 0.0),
        )  # fmt: skip


def _result(at: Posed, job: _Job, history: History) -> Result:
    _, first = at.start(job.seed)
    return Result(
        job.problem, job.variant, job.seed, job.contender, at.best.size, first, at.least,
        at.ratio, at.simulation_s, at.slopes, at.compile_s, history,
    )  # fmt: skip


_TOLD: Final = (
    "problem", "variant", "seed", "contender", "size", "first", "least", "ratio", "simulation_s",
    "slopes", "compile_s",
)  # fmt: skip


def _entry(number: int, one: Result) -> Entry:
    told = {name: getattr(one, name) for name in _TOLD}
    history = one.history
    rest = {
        name: getattr(history, name) for name in ("ending", "reason", "seconds", "cpu_s", "spent")
    }
    return Entry(number, {"prices": history.prices, "costs": history.costs}, {**told, **rest})


def _read(entry: Entry) -> Result:
    told = entry.told
    history = History(
        entry.arrays["prices"], entry.arrays["costs"], str(told["ending"]), str(told["reason"]),
        float(told["seconds"]), float(told["cpu_s"]), float(told["spent"]),
    )  # fmt: skip
    return Result(
        str(told["problem"]), int(told["variant"]), int(told["seed"]), str(told["contender"]),
        int(told["size"]), float(told["first"]), float(told["least"]), float(told["ratio"]),
        float(told["simulation_s"]), float(told["slopes"]), float(told["compile_s"]), history,
    )  # fmt: skip
