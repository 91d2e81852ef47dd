"""One verb: question in, fit out."""

from __future__ import annotations

import math
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.choosing import expected, whole
from piezo_opt.effects.strain.bouc_wen import BoucWen
from piezo_opt.errors import NO_FIT, InputError
from piezo_opt.identification.monitor import Monitor, ProgressCallback
from piezo_opt.identification.multistart import run_starts
from piezo_opt.identification.objective import Linearised, Objective
from piezo_opt.identification.outcome import Ending, Outcome
from piezo_opt.identification.problem import Identification
from piezo_opt.identification.result import Fit
from piezo_opt.identification.solvers.base import Solution
from piezo_opt.identification.starting import another_start, starting_values
from piezo_opt.identification.statistics import blind_spots, uncertainty
from piezo_opt.identification.stuck import doubtful, explains_nothing, far_above
from piezo_opt.identification.transcription import SingleShooting, Transcription
from piezo_opt.identification.unknowns import Unknowns, theta_of, unknowns
from piezo_opt.stopping import TimeLimit
from piezo_opt.units import show
from piezo_opt.values import Values

FloatArray = NDArray[np.float64]

_MADE: Final = {"transcription": "MultipleShooting()", "solver": "NelderMead()"}
_LOST: Final = 1e-3
"""Strength of a loop over the gain below which there is none: less than a good sensor sees."""
_LEADS: Final = 0.5
"""Error over that of a loop that lags up to which one that leads is told. No piezoelectric material
makes one, so it has to explain three quarters of the power that is left."""


def solve(
    question: Identification,
    *,
    transcription: Transcription | None = None,
    solver: object | None = None,
    start: Fit | Values | Mapping[str, float] | None = None,
    starts: int = 1,
    seed: int = 0,
    executor: Executor | None = None,
    log: str | Path | None = None,
    progress: ProgressCallback | None = None,
    statistics: bool = True,
    max_time: float | None = None,
) -> Fit:
    """Estimate the unknowns of a question.

    From one start that nobody gave, a fit that ends at a bound or at ten times its noise tries
    some others of the loop and of the resonance, goes on from one that leads below it, and says so.

    Args:
        question: model, records and what is known.
        transcription: single shooting unless told otherwise.
        solver: the transcription's own unless told otherwise.
        start: values (or an earlier fit) to start from; what it lacks is found from the records.
        starts: number of starts; beyond the first they are drawn from the typical ranges.
        seed: of the random starts.
        executor: runs the starts in parallel.
        log: HDF5 file that keeps every finished start; a second call with the same question,
            seed and file goes on where the first was stopped.
        progress: called with each iterate.
        statistics: False leaves the covariance unknown (NaN), and blind spots and remarks unsaid,
            where fits are only compared; :func:`with_statistics` adds them.
        max_time: [s] after which the best so far is returned, in the main thread; None is no limit.

    Returns:
        the best fit. Ctrl-C and the limit of time return the best so far, and say so.

    Raises:
        InputError, ModelError: the question makes no sense; the sentence names the remedy.
    """
    expected(Identification, question, "The question", "Identification(model, records)")
    if start is not None:
        expected((Fit, Mapping), start, "start", "a fit, or values by name")
        if not isinstance(start, Fit | Values):  # theirs may be of a larger model
            question.check_names("start", start)
            for name, number in Values(start).items():
                question.check_bounds("start", name, number)
    for what, value, verb in (("transcription", transcription, "identify"), ("solver", solver, "")):
        if isinstance(value, type | str) or (
            value is not None and verb and not hasattr(value, verb)
        ):
            raise InputError(f"{what} is {value!r}: give one that is made, such as {_MADE[what]}.")
    whole(starts, "starts", 1)
    whole(seed, "seed", 0)
    if progress is not None and not callable(progress):
        raise InputError(f"progress is {progress!r}: give a function of one argument.")
    if executor is not None and not hasattr(executor, "submit"):
        raise InputError(f"executor is {executor!r}: give one of concurrent.futures or of Dask.")
    limit = TimeLimit(max_time)
    fit = _solved(
        question, transcription, solver, start, starts, seed, executor, log, progress, statistics,
        limit,
    )  # fmt: skip
    if fit.outcome.ending is Ending.INTERRUPTED and limit.passed:
        sentence = (
            f"The limit of {max_time:g} s was reached; this is the best so far (rms "
            f"{show(fit.rms, 'm')}). Go on with solve(question, start=fit)."
        )
        fit = replace(fit, outcome=Outcome(Ending.LIMIT, sentence))
    return fit


def _solved(
    question: Identification,
    transcription: Transcription | None,
    solver: object | None,
    start: Fit | Values | Mapping[str, float] | None,
    starts: int,
    seed: int,
    executor: Executor | None,
    log: str | Path | None,
    progress: ProgressCallback | None,
    statistics: bool,
    limit: TimeLimit,
) -> Fit:
    """The fit, interrupted or not; only the search is limited, not what is made of its result."""
    question.check_numbers()
    chosen: Transcription = SingleShooting() if transcription is None else transcription
    asked = question if start is None else question.starting_at(_numbers(start))
    scout = Monitor(())
    begin = starting_values(asked, scout)
    unknown = unknowns(asked, begin)
    theta = theta_of(unknown, {**begin, **asked.given()})
    monitor = Monitor(unknown.names, progress)
    monitor.simulations, monitor.with_sensitivities = scout.simulations, scout.with_sensitivities
    if starts > 1:
        with limit:
            runs = run_starts(
                asked, unknown, theta, chosen, solver, starts, seed, executor, log, monitor
            )
        best = Solution(runs.theta, runs.ending, runs.sentence)
        fit = _finish(asked, unknown, best, chosen, solver, monitor, statistics)
        unlogged = (runs.unlogged,) if runs.unlogged else ()
        return replace(fit, starts=runs.results, remarks=(*fit.remarks, *unlogged))
    try:
        with limit:
            solution = chosen.identify(asked, unknown, theta, solver, monitor)
    except KeyboardInterrupt:
        found = theta if monitor.best is None else monitor.best
        return _finish(
            asked, unknown, Solution(found, Ending.INTERRUPTED, ""), chosen, solver, monitor,
            statistics,
        )  # fmt: skip
    fit = _finish(asked, unknown, solution, chosen, solver, monitor, statistics)
    settled = start is not None or bool(question.priors)
    if settled or limit.passed:
        return fit
    if solution.ending is Ending.CONVERGED and doubtful(fit):
        fit = _elsewhere(fit, unknown, chosen, solver, monitor, statistics, limit)
    halted = fit.outcome.ending is Ending.INTERRUPTED or limit.passed
    turned = None if halted else _turned(fit, unknown)
    if turned is None:
        return fit
    try:
        # A start that leads nowhere may run away.
        with np.errstate(over="ignore", invalid="ignore"):
            other = _solved(
                turned, transcription, solver, None, 1, seed, executor, log, progress, statistics,
                limit,
            )  # fmt: skip
            better = other.rms < _LEADS * fit.rms
    except NO_FIT:
        return fit
    if other.outcome.ending is Ending.INTERRUPTED:
        ended = Solution(theta_of(unknown, fit.values), Ending.INTERRUPTED, "")
        return replace(fit, outcome=_outcome(ended, fit))
    return other if better else fit


def _turned(fit: Fit, unknown: Unknowns) -> Identification | None:
    """The question with a loop that leads; None where the user has said which way it turns, or the
    fit with one that lags is good."""
    question = fit.question
    loop = question.model.loop or ""
    alpha = f"{loop}.alpha"
    asked = next((u for u in unknown.members if u.name == alpha), None)
    if asked is None or not isinstance(question.model[loop], BoucWen):
        return None
    if alpha in {**question.bounds, **question.values}:
        return None
    gain = abs(question.campaign.records[0].line[0])
    lost = abs(fit.values[alpha]) < _LOST * gain
    if not (lost or doubtful(fit)):
        return None
    return replace(question, bounds={**question.bounds, alpha: (-asked.high, -asked.low)})


def _elsewhere(
    fit: Fit,
    unknown: Unknowns,
    transcription: Transcription,
    solver: object | None,
    monitor: Monitor,
    statistics: bool,
    limit: TimeLimit,
) -> Fit:
    """A doubtful fit, or a better one from another start, which its outcome tells."""
    question = fit.question
    record = question.campaign.records[0]
    try:
        with limit:
            begin = another_start(question, fit.values, record.position - fit.readings[0])
            if begin is None:
                return fit
            solution = transcription.identify(
                question, unknown, theta_of(unknown, begin), solver, monitor
            )
    except KeyboardInterrupt:
        halted = Solution(theta_of(unknown, fit.values), Ending.INTERRUPTED, "")
        return replace(fit, outcome=_outcome(halted, fit))
    except NO_FIT:
        return fit
    other = _finish(question, unknown, solution, transcription, solver, monitor, statistics)
    if not other.rms < fit.rms:
        return fit
    told = f"{other.outcome.sentence} A first start had ended at {show(fit.rms, 'm')}."
    return replace(other, outcome=replace(other.outcome, sentence=told))


def with_statistics(fit: Fit) -> Fit:
    """The same fit with covariance, blind spots and remarks, where it was solved without."""
    unknown = unknowns(fit.question, fit.values)
    theta = theta_of(unknown, fit.values)
    monitor = Monitor(unknown.names)
    objective = Objective(fit.question, unknown, theta, monitor, accuracy=fit.accuracy)
    return _stated(fit, objective, objective.linearised(theta), theta)


def _numbers(start: Fit | Values | Mapping[str, float]) -> Mapping[str, float]:
    return start.values if isinstance(start, Fit) else start


def _finish(
    question: Identification,
    unknown: Unknowns,
    solution: Solution,
    transcription: Transcription,
    solver: object | None,
    monitor: Monitor,
    statistics: bool,
) -> Fit:
    """The fit at the solution, on exact sensitivities, whatever found it."""
    theta = unknown.clip(solution.theta)
    spent = monitor.evaluations
    objective = Objective(
        question, unknown, theta, Monitor(unknown.names), accuracy=solution.accuracy
    )
    if not solution.accuracy:
        objective.refine(theta)
    known = solution.point if solution.accuracy else None
    point = objective.linearised(theta) if known is None else known
    weighted = objective.robust(point)
    k = theta.size
    fit = Fit(
        question=question,
        values=unknown.values(theta),
        names=unknown.names,
        covariance=np.full((k, k), np.nan),
        coloured=False,
        at_bound=_at_bound(unknown, theta, weighted.normal[0]),
        readings=point.readings,
        outcome=Outcome(solution.ending, ""),
        trace=monitor.trace,
        evaluations=spent,
        wall_s=monitor.elapsed_s,
        blind=(),
        remarks=(),
        accuracy=objective.accuracy,
        compiled=all(s.compiled for s in objective.simulators),
        solver=str(getattr(solver, "name", transcription.default_solver)),
        transcription=transcription.name,
    )
    fit = replace(fit, outcome=_outcome(solution, fit))
    return _stated(fit, objective, point, theta) if statistics else fit


def _stated(fit: Fit, objective: Objective, point: Linearised, theta: FloatArray) -> Fit:
    """A fit with its statistics at the solution."""
    weighted = objective.robust(point)
    scale = objective.unknowns.scale
    free = np.array([n not in fit.at_bound for n in fit.names], dtype=bool)
    if weighted.usable:
        known = uncertainty(weighted, free, objective.samples, scale)
        blind = blind_spots(fit.names, theta, scale, weighted, free)
        covariance = known.covariance * np.outer(scale, scale)
        fit = replace(fit, covariance=covariance, coloured=known.coloured, blind=blind)
    return replace(fit, remarks=_remarks(fit.question, fit))


def _at_bound(unknown: Unknowns, theta: FloatArray, gradient: FloatArray) -> tuple[str, ...]:
    """Unknowns on a bound with the cost falling outward."""
    names = []
    for k, member in enumerate(unknown.members):
        slack = 1e-9 * max(abs(theta[k]), member.scale)
        if (theta[k] - member.low <= slack and gradient[k] >= 0) or (
            member.high - theta[k] <= slack and gradient[k] <= 0
        ):
            names.append(member.name)
    return tuple(names)


def _outcome(solution: Solution, fit: Fit) -> Outcome:
    """The sentence of how it ended, with the remedy."""
    times = 0.0
    if solution.ending is Ending.CONVERGED:
        times = far_above(fit)
        sentence = (
            f"Converged after {max(0, fit.trace.rms.size - 1)} iterations: rms "
            f"{show(fit.rms, 'm')}, fit {fit.fit_percent:.1f} %."
        )
        if explains_nothing(fit):
            sentence += (
                " It explains nothing of the reading: a constant does as well. Look at the record "
                "(piezo-opt check) before its values are used."
            )
        elif times:
            sentence += (
                f" That is {times:.0f} times the noise in its highest frequencies: the model lacks "
                "something (a diagnosis names it), or this is a wrong minimum (starts=20)."
            )
        if fit.at_bound:
            sentence += (
                f" {', '.join(fit.at_bound)} ended at a bound: widen it (bounds=...) or drop the "
                "effect."
            )
    elif solution.ending is Ending.INTERRUPTED:
        sentence = (
            f"Interrupted after {fit.trace.rms.size} iterations; this is the best so far (rms "
            f"{show(fit.rms, 'm')}). Go on with solve(question, start=fit)."
        )
    else:
        sentence = solution.sentence
    promised = None
    if solution.promised is not None:
        promised = fit.rms * math.sqrt(solution.promised)
        sentence += f" Its slopes promise {show(promised, 'm')}, in place of {show(fit.rms, 'm')}."
    return Outcome(solution.ending, sentence, times, promised)


def _remarks(question: Identification, fit: Fit) -> tuple[str, ...]:
    remarks: list[str] = []
    for record in question.campaign.records:
        remarks += [f"{record.name}: {sentence}" for sentence in record.remarks]
    for record, accuracy in zip(question.campaign.records, fit.accuracy, strict=True):
        if accuracy.error > 0.1 * fit.rms:
            remarks.append(
                f"{record.name}: the integration scheme's own error is "
                f"{show(accuracy.error, 'm')}, not far below the residual."
            )
    line = _line_rms(question)
    if line < 0.98 * fit.rms:
        remarks.append(
            f"A straight line, position over drive, leaves less ({show(line, 'm')}) than this fit "
            f"({show(fit.rms, 'm')}): the solver ended in a wrong minimum. Try starts=20, or "
            "leave out what the record cannot see (the mechanics first)."
        )
    for name, effect in question.model:
        if any(s.position for s in effect.declared_states.values()):
            remarks += _motion_remarks(question, name, fit)
        if isinstance(effect, BoucWen):
            remarks += _loop_remarks(question, f"{name}.alpha", fit)
    return tuple(remarks)


def _line_rms(question: Identification) -> float:
    """Root mean square left by a straight line over the drive, one line a record [m]."""
    left = []
    for record in question.campaign.records:
        slope, intercept = record.line
        left.append((record.position - intercept - slope * record.drive)[record.counted])
    return float(np.sqrt(np.mean(np.concatenate(left) ** 2)))


def _loop_remarks(question: Identification, alpha: str, fit: Fit) -> list[str]:
    """A loop that surely leads its drive, as no piezoelectric material does."""
    stroke = np.sign(question.campaign.records[0].line[0])
    if alpha in fit.names and stroke * fit.values[alpha] < -3.0 * fit.std[alpha]:
        return [
            f"The loop leads its drive ({alpha} and the stroke have opposite signs), where that of "
            "a piezoelectric material lags: see whether the columns are drive and displacement, "
            "and whether hysteresis is compensated already."
        ]
    return []


def _motion_remarks(question: Identification, name: str, fit: Fit) -> list[str]:
    omega = fit.values.get(f"{name}.omega")
    if omega is None or f"{name}.omega" not in fit.names:
        return []
    fastest = max(r.rate for r in question.campaign.records)
    nyquist = np.pi * fastest
    spread = fit.std[f"{name}.omega"]
    if f"{name}.omega" in fit.at_bound or omega > 0.8 * nyquist:
        return [
            f"The natural frequency is not identifiable: {omega / 2 / np.pi:.4g} Hz lies at or "
            f"above what {fastest:.4g} samples/s can hold (nothing above {fastest / 2:.4g} Hz is "
            "seen). Sample faster, fix it, or leave the mechanics out."
        ]
    if not np.isfinite(spread) or spread > 0.5 * omega:
        return [
            f"The natural frequency is not identifiable from this drive "
            f"({omega / 2 / np.pi:.4g} Hz ± {spread / 2 / np.pi:.2g} Hz): excite it, fix it, or "
            "leave the mechanics out."
        ]
    return []
