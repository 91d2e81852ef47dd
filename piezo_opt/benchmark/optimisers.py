"""Problems x solvers x seeded starts: who finds the optimum, and at what price."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.benchmark.jobs import Counted, run_jobs
from piezo_opt.benchmark.table import table
from piezo_opt.errors import InputError, PiezoOptError
from piezo_opt.identification import (
    Ending,
    Identification,
    LevenbergMarquardt,
    Progress,
    SingleShooting,
    solve,
)
from piezo_opt.identification.monitor import Monitor
from piezo_opt.identification.multistart import draw
from piezo_opt.identification.objective import Objective
from piezo_opt.identification.starting import starting_values
from piezo_opt.identification.transcription import Transcription
from piezo_opt.identification.unknowns import theta_of, unknowns

FloatArray = NDArray[np.float64]

SCHEMA = "piezo_opt/race/1"


class Measure(Enum):
    """What a solver is charged for."""

    SIMULATIONS = "simulations"
    """Simulations, with and without sensitivities; the same on every machine."""
    SECONDS = "seconds"
    """Wall time on this machine."""


@final
@dataclass(frozen=True)
class Contender:
    """A way to solve: a solver within a transcription.

    Args:
        solver: None takes the transcription's own.
        transcription: how the question becomes finite.
        name: in tables; made from the other two when empty.
    """

    solver: object | None = field(default_factory=LevenbergMarquardt)
    transcription: Transcription = field(default_factory=SingleShooting)
    name: str = ""

    def __post_init__(self) -> None:
        if not self.name:
            own = getattr(self.solver, "name", "")
            shooting = isinstance(self.transcription, SingleShooting)
            parts = [own, "" if shooting and own else self.transcription.name]
            object.__setattr__(self, "name", ", ".join(p for p in parts if p))


@final
@dataclass(frozen=True)
class Run:
    """One solver from one start of one problem.

    Attributes:
        problem, contender: names.
        start: number of the start; 0 is the one found from the record.
        rms: reached [m]; infinite where nothing was.
        ending: how it ended, or ``"skipped"``.
        simulations: spent, with and without sensitivities.
        seconds: wall time, without compilation.
        reason: why it was skipped or stopped early; empty else.
    """

    problem: str
    contender: str
    start: int
    rms: float
    ending: str
    simulations: int
    seconds: float
    reason: str = ""

    def price(self, measure: Measure) -> float:
        """Simulations or seconds."""
        return float(self.simulations if measure is Measure.SIMULATIONS else self.seconds)


@final
@dataclass(frozen=True)
class Row:
    """What a contender did on a problem, over all starts.

    Attributes:
        success: share of the starts that ended at the best rms that anybody reached.
        rms: median reached [m].
        simulations, seconds: medians.
        ratio: median of the simulations over those of the cheapest contender that succeeds at
            least as often as every second start; NaN where there is none.
        reason: why there are no numbers; empty else.
    """

    problem: str
    contender: str
    success: float
    rms: float
    simulations: float
    seconds: float
    ratio: float
    reason: str


@final
@dataclass(frozen=True, eq=False)
class Profile:
    """Performance profile: share of the cases solved within a factor of the cheapest solver.

        rho_s(tau) = |{p : t_ps / min_s t_ps <= tau}| / |{p}|,   t_ps infinite where s fails

    A case p is one start of one problem; cases that nobody solves count in the denominator.

    Attributes:
        measure: what t is.
        ratios: (cases,) ascending ratios of each contender, infinite for its failures.

    Source: Dolan and More (2002), Mathematical Programming 91(2), 201-213.
    """

    measure: Measure
    ratios: Mapping[str, FloatArray]

    def share(self, contender: str, factor: float) -> float:
        """rho of one contender at one factor."""
        return float(np.mean(self.ratios[contender] <= factor))


@final
@dataclass(frozen=True, eq=False)
class Race:
    """All runs, and what follows from them.

    Attributes:
        problems, contenders: names in the order given.
        runs: in the order of problem, contender, start.
        within: relative distance from the best rms that still counts as success.
    """

    problems: tuple[str, ...]
    contenders: tuple[str, ...]
    runs: tuple[Run, ...]
    within: float

    def best(self, problem: str) -> float:
        """Smallest rms that anybody reached [m]."""
        return min((r.rms for r in self.runs if r.problem == problem), default=float("inf"))

    def solved(self, run: Run) -> bool:
        """Whether a run ended at the best rms of its problem."""
        return bool(np.isfinite(run.rms) and run.rms <= self.best(run.problem) * (1 + self.within))

    def rows(self) -> tuple[Row, ...]:
        """One row for each problem and contender."""
        rows = []
        for problem in self.problems:
            groups = {
                c: [r for r in self.runs if r.problem == problem and r.contender == c]
                for c in self.contenders
            }
            usual = {
                c: float(np.median([r.simulations for r in runs]))
                for c, runs in groups.items()
                if runs and np.mean([self.solved(r) for r in runs]) >= 0.5
            }
            # A transcription that does not simulate has no simulations to be compared by.
            cheapest = min((n for n in usual.values() if n > 0), default=float("nan"))
            rows += [
                self._row(problem, name, [r for r in runs if r.ending != "skipped"], runs, cheapest)
                for name, runs in groups.items()
                if runs
            ]
        return tuple(rows)

    def _row(
        self, problem: str, name: str, ran: Sequence[Run], runs: Sequence[Run], cheapest: float
    ) -> Row:
        reasons = "; ".join(dict.fromkeys(r.reason for r in runs if r.reason))
        if not ran:
            nothing = float("nan")
            return Row(problem, name, 0.0, nothing, nothing, nothing, nothing, reasons)
        simulations = float(np.median([r.simulations for r in ran]))
        return Row(
            problem,
            name,
            float(np.mean([self.solved(r) for r in runs])),
            float(np.median([r.rms for r in ran])),
            simulations,
            float(np.median([r.seconds for r in ran])),
            simulations / cheapest if simulations > 0 else float("nan"),
            reasons,
        )

    def profile(self, measure: Measure = Measure.SIMULATIONS) -> Profile:
        """Performance profile over all problems and starts."""
        price = {
            (r.problem, r.start, r.contender): r.price(measure) for r in self.runs if self.solved(r)
        }
        cases = sorted({(r.problem, r.start) for r in self.runs})
        ratios: dict[str, list[float]] = {c: [] for c in self.contenders}
        for case in cases:
            own = {c: price.get((*case, c), float("inf")) for c in self.contenders}
            least = min(own.values())
            for c, spent in own.items():
                ratios[c].append(spent / least if np.isfinite(spent) else float("inf"))
        return Profile(measure, {c: np.sort(np.array(r)) for c, r in ratios.items()})

    def to_dict(self) -> dict[str, Any]:
        """Plain data with a ``schema`` key."""
        return {
            "schema": SCHEMA,
            "within": self.within,
            "best_rms": {p: _finite(self.best(p)) for p in self.problems},
            "runs": [
                {
                    "problem": r.problem, "contender": r.contender, "start": r.start,
                    "rms": _finite(r.rms), "ending": r.ending, "solved": self.solved(r),
                    "simulations": r.simulations, "seconds": r.seconds, "reason": r.reason,
                }
                for r in self.runs
            ],
        }  # fmt: skip

    def __str__(self) -> str:
        lines = []
        for problem in self.problems:
            rows = [r for r in self.rows() if r.problem == problem]
            lines += [f"{problem}: best rms {1e9 * self.best(problem):.4g} nm", ""]
            cells = [
                (
                    r.contender, f"{100.0 * r.success:.0f} %", _number(1e9 * r.rms, ".4g"),
                    _number(r.simulations, ".0f"), _number(r.seconds, ".3g"),
                    _number(r.ratio, ".3g"),
                )
                for r in rows
            ]  # fmt: skip
            header = ("solver", "success", "rms [nm]", "simulations", "seconds", "ratio")
            lines += ["  " + line for line in table(header, cells).splitlines()]
            lines += [f"  {r.contender}: {r.reason}" for r in rows if r.reason]
            lines.append("")
        profile = self.profile()
        factors = ("share solved within", *(f"{f:g} x" for f in _FACTORS), "at all")
        shares = [
            (c, *(f"{profile.share(c, f):.2f}" for f in _FACTORS),
             f"{np.mean(np.isfinite(profile.ratios[c])):.2f}")
            for c in self.contenders
        ]  # fmt: skip
        return "\n".join([*lines, table(factors, shares)])


_FACTORS = (1.0, 2.0, 5.0, 10.0, 50.0)


@final
@dataclass(frozen=True, eq=False)
class _Task:
    """What all runs share; travels to each worker once."""

    problems: Mapping[str, Identification]
    contenders: Mapping[str, Contender]
    limit_s: float


@final
@dataclass(frozen=True, eq=False)
class _Job:
    problem: str
    contender: str
    start: int
    values: Mapping[str, float]


def race(
    problems: Mapping[str, Identification],
    contenders: Sequence[Contender],
    *,
    starts: int = 5,
    seed: int = 0,
    within: float = 1e-3,
    limit_s: float = 60.0,
    executor: Executor | None = None,
    progress: Counted | None = None,
) -> Race:
    """Run every contender from the same starts of every problem.

    The first start is the one found from the record, the others are drawn with the seed as a
    multi-start draws them. Models are compiled before the clock runs. A contender that refuses a
    problem is skipped with its own sentence as the reason.

    Args:
        problems: questions by name.
        contenders: with different names.
        starts: number of starts of each problem.
        seed: of the drawn starts.
        within: relative distance from the best rms that still counts as success.
        limit_s: seconds after which a run is stopped at its next iterate; it counts with what it
            has reached.
        executor: runs in parallel; wall times are then those of a busy machine.
        progress: called with (runs done, runs in all).

    Returns:
        the race, or what there is of it when interrupted (Ctrl-C).

    Raises:
        InputError: no problem, no start, no time, or two contenders of one name.
    """
    names = tuple(c.name for c in contenders)
    if not problems or starts < 1 or not limit_s > 0 or len(set(names)) != len(names) or not names:
        raise InputError(
            f"race({len(problems)} problems, contenders {', '.join(names) or 'none'}, "
            f"starts={starts}, limit_s={limit_s}): give at least one problem, contenders of "
            "different names (name=...), one start or more, and a positive time."
        )
    jobs = [
        _Job(name, contender, start, values)
        for name, question in problems.items()
        for start, values in enumerate(_starts(question, starts, seed))
        for contender in names
    ]
    task = _Task(dict(problems), dict(zip(names, contenders, strict=True)), limit_s)
    runs: list[Run] = []
    try:
        for run in run_jobs(_run, task, jobs, executor, progress, _lost):
            runs.append(run)
    except KeyboardInterrupt:
        if not runs:
            raise
    place = {name: k for k, name in enumerate((*problems, *names))}
    runs.sort(key=lambda r: (place[r.problem], place[r.contender], r.start))
    return Race(tuple(problems), names, tuple(runs), within)


def _starts(question: Identification, count: int, seed: int) -> list[Mapping[str, float]]:
    """Values of every start; simulates once with and once without sensitivities, to compile."""
    begin = starting_values(question, Monitor(()))
    unknown = unknowns(question, begin)
    own = {name: float(value) for name, value in question.values.items()}
    centre = theta_of(unknown, {**begin, **own})
    objective = Objective(question, unknown, centre, Monitor(unknown.names))
    objective.residual(centre)
    objective.linearised(centre)
    points = (draw(unknown, question, centre, seed, k) for k in range(count))
    return [dict(zip(unknown.names, point.tolist(), strict=True)) for point in points]


def _lost(job: _Job, sentence: str) -> Run:
    return Run(job.problem, job.contender, job.start, float("inf"), "failed", 0, 0.0, sentence)


def _run(task: _Task, job: _Job) -> Run:
    stopped: list[float] = []
    problem, name = job.problem, job.contender
    contender = task.contenders[name]
    try:
        fit = solve(
            task.problems[problem],
            transcription=contender.transcription,
            solver=contender.solver,
            start=job.values,
            progress=_clock(task.limit_s, stopped),
        )
    except PiezoOptError as refusal:
        return Run(problem, name, job.start, float("inf"), "skipped", 0, 0.0, str(refusal))
    except ArithmeticError as error:
        return Run(problem, name, job.start, float("inf"), "failed", 0, 0.0, str(error))
    reason = ""
    if fit.outcome.ending is Ending.INTERRUPTED:
        if not stopped:
            raise KeyboardInterrupt
        reason = f"stopped after {task.limit_s:g} s"
    return Run(
        problem, name, job.start, fit.rms, fit.outcome.ending.value, fit.evaluations.total,
        fit.wall_s, reason,
    )  # fmt: skip


def _clock(limit_s: float, stopped: list[float]) -> Callable[[Progress], None]:
    """A progress callback that ends a run the way Ctrl-C does: with the best point so far."""

    def look(now: Progress) -> None:
        if now.elapsed_s > limit_s:
            stopped.append(now.elapsed_s)
            raise KeyboardInterrupt

    return look


def _finite(number: float) -> float | None:
    return float(number) if np.isfinite(number) else None


def _number(number: float, form: str) -> str:
    return format(number, form) if np.isfinite(number) else "-"
