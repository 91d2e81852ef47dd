"""How sure, by fitting again and again to readings that could have been."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.choosing import expected, whole
from piezo_opt.errors import NO_FIT, InputError
from piezo_opt.identification.blocks import block_length, drawn
from piezo_opt.identification.log import Entry, Log, fingerprint
from piezo_opt.identification.monitor import Monitor
from piezo_opt.identification.objective import Objective
from piezo_opt.identification.outcome import Ending
from piezo_opt.identification.problem import Prior
from piezo_opt.identification.result import Fit
from piezo_opt.identification.solvers.levenberg_marquardt import LevenbergMarquardt
from piezo_opt.identification.unknowns import Unknowns, theta_of, unknowns
from piezo_opt.measurement import Campaign
from piezo_opt.simulation import Accuracy
from piezo_opt.spread import Lost, spread

FloatArray = NDArray[np.float64]
Counted = Callable[[int, int], None]
"""Progress: done, in all."""

SCHEMA: Final = "piezo_opt/bootstrap/1"
_FEWEST: Final = 20
"""Replicates below which no percentile of 95 % exists."""
_DIFFER: Final = "the fit's model, records, bounds, loss, values, or the seed"


@final
@dataclass(frozen=True, eq=False)
class Bootstrap:
    """Estimates from replicated records.

    Attributes:
        fit: what was replicated.
        names: the unknowns (k).
        estimates: (replicates, k) in SI units.
        blocks: length of the blocks of each record's residuals; 1 means one by one.
        failed: replicates without an estimate, in sentences.
        interrupted: whether there are fewer replicates than were asked for.
    """

    fit: Fit
    names: tuple[str, ...]
    estimates: FloatArray
    blocks: tuple[int, ...]
    failed: tuple[str, ...]
    interrupted: bool

    @property
    def std(self) -> Mapping[str, float]:
        """Standard deviation of each unknown over the replicates."""
        return self._by_name(self.estimates.std(axis=0, ddof=1))

    @property
    def bias(self) -> Mapping[str, float]:
        """Mean of the replicates minus the estimate: what the model's curvature does to it."""
        return self._by_name(self.estimates.mean(axis=0) - self._centre)

    @property
    def covariance(self) -> FloatArray:
        """(k, k) over the replicates."""
        return np.atleast_2d(np.cov(self.estimates, rowvar=False))

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Percentile interval of an unknown.

        It stays within the bounds, and is one-sided where many replicates end at one.

        Source: Efron & Tibshirani (1993), An Introduction to the Bootstrap, ch. 13.
        """
        column = self.estimates[:, self.names.index(name)]
        low, high = np.quantile(column, [0.5 - 0.5 * level, 0.5 + 0.5 * level])
        return float(low), float(high)

    @property
    def _centre(self) -> FloatArray:
        return np.array([self.fit.values[n] for n in self.names])

    def _by_name(self, row: FloatArray) -> Mapping[str, float]:
        return dict(zip(self.names, row.tolist(), strict=True))

    def to_dict(self, level: float = 0.95) -> dict[str, Any]:
        """Plain data, SI units, with a ``schema`` key."""
        std, bias = self.std, self.bias
        return {
            "schema": SCHEMA,
            "method": "bootstrap",
            "level": level,
            "replicates": len(self.estimates),
            "block_lengths": list(self.blocks),
            "failed": list(self.failed),
            "interrupted": self.interrupted,
            "parameters": {
                n: {
                    "value": self.fit.values[n],
                    "low": self.interval(n, level)[0],
                    "high": self.interval(n, level)[1],
                    "std": std[n],
                    "bias": bias[n],
                    "unit": self.fit.unit(n),
                }
                for n in self.names
            },
        }

    def __str__(self) -> str:
        how = "one by one" if max(self.blocks) == 1 else (
            f"in blocks of {', '.join(str(b) for b in self.blocks)} samples"
        )  # fmt: skip
        lines = [
            f"Bootstrap: {len(self.estimates)} replicates, residuals drawn {how}"
            f"{', interrupted' if self.interrupted else ''}.",
            "",
            f"  {'parameter':<28} {'value':>12} {'95 % from':>12} {'to':>12} {'bias/std':>9}  unit",
        ]
        std, bias = self.std, self.bias
        for n in self.names:
            low, high = self.interval(n)
            off = bias[n] / std[n] if std[n] > 0 else 0.0
            lines.append(
                f"  {n:<28} {self.fit.values[n]:>12.6g} {low:>12.6g} {high:>12.6g} {off:>+9.2f}  "
                f"{self.fit.unit(n)}"
            )
        if self.failed:
            lines += ["", f"{len(self.failed)} replicates have no estimate: {self.failed[0]}"]
        return "\n".join(lines)


@final
@dataclass(frozen=True, eq=False)
class _Task:
    """What all replicates share; travels to each worker once."""

    fit: Fit
    unknown: Unknowns
    centre: FloatArray
    accuracy: tuple[Accuracy, ...]
    blocks: tuple[int, ...]
    seed: int


def bootstrap(
    fit: Fit,
    replicates: int = 200,
    *,
    seed: int = 0,
    block: int | None = None,
    executor: Executor | None = None,
    log: str | Path | None = None,
    progress: Counted | None = None,
) -> Bootstrap:
    """Fit again to modelled readings with residuals drawn anew, many times.

    A replicate's reading is ``y* = yhat + sqrt(N / (N - k)) (r_drawn - mean r)``, its residuals
    drawn with replacement, one by one where they are white and else in blocks that keep their
    correlation; priors are drawn as well. Every replicate is fitted from the estimate, with the
    same bounds. It asks nothing of the shape of the cost, so it is right where intervals from the
    covariance are not: near bounds, and along curved valleys. It does ask that the model is right.

    Args:
        fit: a converged fit.
        replicates: 200 for deviations, 1000 and more for intervals.
        seed: of the draws; a replicate depends on it and on its number alone.
        block: [samples] length of the blocks; found from the residuals unless given.
        executor: fits replicates in parallel: any of ``concurrent.futures`` or of Dask.
        log: HDF5 file that keeps every replicate; a second call goes on where the first stopped.
        progress: called with (replicates done, replicates in all).

    Returns:
        the estimates, those that there are after an interrupt (Ctrl-C).

    Raises:
        InputError: fewer than 20 replicates, nothing was estimated, or the log is of another fit.

    Sources: Efron & Tibshirani (1993), An Introduction to the Bootstrap, ch. 9; Kunsch (1989),
    Annals of Statistics 17(3), 1217-1241 (blocks).
    """
    expected(Fit, fit, "The fit", "what solve returns")
    whole(replicates, "replicates", 0)
    whole(seed, "seed", 0)
    if replicates < _FEWEST or (block is not None and block < 1):
        raise InputError(
            f"bootstrap(replicates={replicates}, block={block}): give at least {_FEWEST} "
            "replicates and blocks of at least one sample."
        )
    if not fit.names:
        raise InputError("bootstrap: the fit has no unknowns; free some of its parameters.")
    task = _task(fit, seed, block)
    kept: Log | None = None
    if log is not None:
        beside = (seed, task.blocks, [a.substeps for a in task.accuracy])
        asked = fingerprint(fit.question, task.unknown, task.centre, *beside)
        kept = Log(log, "piezo_opt/replicates/1", asked, _DIFFER)
    found = {e.index: e for e in (kept.entries() if kept else ()) if e.index < replicates}
    todo = [i for i in range(replicates) if i not in found]
    interrupted = False
    try:
        for at, answer in spread(_replicate, task, todo, executor):
            lost = isinstance(answer, Lost)
            one = _failure(todo[at], answer.sentence) if isinstance(answer, Lost) else answer
            found[one.index] = one
            if kept and not lost:
                kept.append(one)
            if progress is not None:
                progress(len(found), replicates)
    except KeyboardInterrupt:
        interrupted = True
    ended = [found[i] for i in sorted(found)]
    good = [e.arrays["theta"] for e in ended if not e.told["why"]]
    if len(good) < 2:
        if interrupted:
            raise KeyboardInterrupt
        why = next((str(e.told["why"]) for e in ended), "interrupted")
        raise InputError(f"bootstrap: no replicate could be fitted ({why}); look at the fit first.")
    failed = tuple(str(e.told["why"]) for e in ended if e.told["why"])
    return Bootstrap(fit, task.unknown.names, np.array(good), task.blocks, failed, interrupted)


def _task(fit: Fit, seed: int, block: int | None) -> _Task:
    unknown = unknowns(fit.question, fit.values)
    blocks = tuple(
        block or block_length(fit.residual(i)) for i in range(len(fit.question.campaign.records))
    )
    # The trace of the search, and results of many starts, are of no use there.
    light = replace(fit, starts=(), trace=replace(fit.trace, values=np.zeros((0, 0))))
    return _Task(light, unknown, theta_of(unknown, fit.values), fit.accuracy, blocks, seed)


def _replicate(task: _Task, index: int) -> Entry:
    """One replicate, fitted from the estimate."""
    fit, generator = task.fit, np.random.default_rng([task.seed, index])
    inflated = np.sqrt(fit.residuals.size / max(1, fit.residuals.size - len(fit.names)))
    records = []
    for i, record in enumerate(fit.records):
        residual = fit.residual(i)
        position = np.array(fit.readings[i])
        noise = drawn(residual, task.blocks[i], generator)
        position[record.counted] += inflated * (noise - residual.mean())
        records.append(record.with_(position=position, allow_saturated=True))
    question = replace(fit.question, records=Campaign(tuple(records)))
    members = tuple(
        m if m.prior is None else replace(m, prior=_moved(m.prior, theta, generator))
        for m, theta in zip(task.unknown.members, task.centre.tolist(), strict=True)
    )
    unknown = replace(task.unknown, members=members)
    objective = Objective(
        question, unknown, task.centre, Monitor(unknown.names), accuracy=task.accuracy
    )
    try:
        found = LevenbergMarquardt().minimise(objective, task.centre)
    except NO_FIT as error:
        return _failure(index, str(error))
    if found.ending is Ending.FAILED:
        return _failure(index, found.sentence)
    return Entry(index, {"theta": found.theta}, {"why": ""})


def _moved(prior: Prior, theta: float, generator: np.random.Generator) -> Prior:
    """What could have been known beforehand, were the estimate the truth."""
    return replace(prior, mean=theta + float(generator.normal(scale=prior.std)))


def _failure(index: int, sentence: str) -> Entry:
    return Entry(index, {"theta": np.zeros(0)}, {"why": sentence or "the fit failed"})
