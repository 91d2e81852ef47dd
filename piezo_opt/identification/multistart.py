"""Many starts of one question: drawn with a seed, run on any executor, kept in a log."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.errors import InputError, ModelError
from piezo_opt.identification.monitor import Monitor
from piezo_opt.identification.outcome import Ending
from piezo_opt.identification.problem import Identification
from piezo_opt.identification.result import StartResult
from piezo_opt.identification.solvers.base import Solution
from piezo_opt.identification.transcription import Transcription
from piezo_opt.identification.unknowns import Unknowns

FloatArray = NDArray[np.float64]


@final
@dataclass(frozen=True, eq=False)
class Runs:
    """All starts, best first, and where the best ended."""

    results: tuple[StartResult, ...]
    theta: FloatArray
    ending: Ending
    sentence: str


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


def _run(
    question: Identification,
    unknown: Unknowns,
    theta: FloatArray,
    transcription: Transcription,
    solver: object | None,
    index: int,
) -> _Done:
    monitor = Monitor(unknown.names)
    try:
        solution = transcription.identify(question, unknown, theta, solver, monitor)
    except (ArithmeticError, ModelError) as error:
        return _Done(index, theta, np.inf, np.inf, Ending.FAILED, str(error), 0, 0,
                     np.zeros((0, theta.size)), np.zeros(0))  # fmt: skip
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
    kept = _Log(Path(log), _fingerprint(question, unknown, centre, seed)) if log else None
    done = {d.index: d for d in (kept.read(unknown) if kept else [])}
    todo = [i for i in range(starts) if i not in done]
    interrupted = False
    try:
        for one in _each(question, unknown, centre, transcription, solver, seed, executor, todo):
            done[one.index] = one
            monitor.simulations += one.simulations
            monitor.with_sensitivities += one.with_sensitivities
            # An unfinished start may be the best so far, but must be run again.
            interrupted = one.ending is Ending.INTERRUPTED
            if kept and not interrupted:
                kept.append(one)
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
    return Runs(results, best.theta, ending, best.sentence)


def _each(
    question: Identification,
    unknown: Unknowns,
    centre: FloatArray,
    transcription: Transcription,
    solver: object | None,
    seed: int,
    executor: Executor | None,
    todo: list[int],
) -> Iterator[_Done]:
    points = {i: draw(unknown, question, centre, seed, i) for i in todo}
    if executor is None:
        for i in todo:
            yield _run(question, unknown, points[i], transcription, solver, i)
        return
    futures = [
        executor.submit(_run, question, unknown, points[i], transcription, solver, i) for i in todo
    ]
    try:
        for future in as_completed(futures):
            yield future.result()
    finally:
        for future in futures:
            future.cancel()


def _fingerprint(question: Identification, unknown: Unknowns, centre: FloatArray, seed: int) -> str:
    """What must be the same for a log to be gone on with."""
    digest = hashlib.sha256()
    digest.update(json.dumps(question.model.to_dict(), sort_keys=True).encode())
    for record in question.campaign.records:
        for column in (record.time, record.drive, record.position, *record.channels.values()):
            digest.update(np.ascontiguousarray(column).tobytes())
        told = (record.between, record.period, record.startup, question.start_of(record))
        digest.update(repr((told, tuple(record.channels))).encode())
    digest.update(repr([(m.name, m.low, m.high, m.prior) for m in unknown.members]).encode())
    digest.update(repr((question.loss, question.noise, question.weights)).encode())
    digest.update(repr(sorted(unknown.kept.items())).encode())
    digest.update(centre.tobytes())
    digest.update(str(seed).encode())
    return digest.hexdigest()


@final
class _Log:
    """HDF5: attribute ``question`` (hash); one group a finished start."""

    def __init__(self, path: Path, question: str) -> None:
        import h5py

        self._path = path
        if path.exists():
            try:
                with h5py.File(path, "r") as file:
                    known = str(file.attrs.get("question", ""))
            except OSError as error:
                raise InputError(
                    f"{path}: not a readable log of starts ({error}); name another file."
                ) from None
            if known != question:
                raise InputError(
                    f"{path}: this log belongs to another question (model, records, bounds, loss, "
                    "start or seed differ); name another file or delete it."
                )
            return
        try:
            with h5py.File(path, "w") as file:
                file.attrs["question"] = question
                file.attrs["schema"] = "piezo_opt/starts/1"
        except OSError as error:
            raise InputError(
                f"{path}: a log of starts cannot be written here ({error}); name another file."
            ) from None

    def append(self, done: _Done) -> None:
        """Add one finished start and close the file, so that a crash loses nothing."""
        import h5py

        with h5py.File(self._path, "a") as file:
            group = file.create_group(f"start_{done.index:06d}")
            group["theta"] = done.theta
            group["iterates"] = done.iterates
            group["iterate_rms"] = done.iterate_rms
            for name in ("index", "cost", "rms", "sentence", "simulations", "with_sensitivities"):
                group.attrs[name] = getattr(done, name)
            group.attrs["ending"] = done.ending.value

    def read(self, unknown: Unknowns) -> list[_Done]:
        """Finished starts."""
        import h5py

        found = []
        with h5py.File(self._path, "r") as file:
            for name in file:
                group = file[name]
                if "ending" not in group.attrs or group["theta"].size != len(unknown.members):
                    continue
                a = group.attrs
                found.append(
                    _Done(
                        int(a["index"]), group["theta"][:], float(a["cost"]), float(a["rms"]),
                        Ending(a["ending"]), str(a["sentence"]), int(a["simulations"]),
                        int(a["with_sensitivities"]), group["iterates"][:],
                        group["iterate_rms"][:],
                    )
                )  # fmt: skip
        return found
