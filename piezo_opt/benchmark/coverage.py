"""Are the intervals honest: how often they hold the truth, over many draws of the noise."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property
from typing import Any, final

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from piezo_opt.benchmark.jobs import Counted, run_jobs
from piezo_opt.benchmark.table import table
from piezo_opt.diagnosis import diagnose
from piezo_opt.errors import InputError
from piezo_opt.identification import Ending, Identification, solve

FloatArray = NDArray[np.float64]

SCHEMA = "piezo_opt/coverage/1"


@final
@dataclass(frozen=True, eq=False)
class Draw:
    """One draw of the noise and what the fit to it says.

    Attributes:
        seed: of the noise.
        errors: (k,) estimate minus truth over the standard deviation that the fit states; NaN
            for an unknown at a bound.
        half_width: (k,) half of the interval over that standard deviation.
        distance: squared distance of the estimate from the truth in the metric of the stated
            covariance, e' C^-1 e; chi-square distributed with k degrees where C is right.
        ending: how the solver ended.
        coloured: whether the fit took its residuals for correlated.
        seconds: spent on the fit.
    """

    seed: int
    errors: FloatArray
    half_width: FloatArray
    distance: float
    ending: Ending
    coloured: bool
    seconds: float

    @property
    def inside(self) -> NDArray[np.bool_]:
        """(k,) whether each truth lies in its interval; no interval holds nothing."""
        return np.asarray(np.abs(self.errors) <= self.half_width)


@final
@dataclass(frozen=True, eq=False)
class Coverage:
    """What many draws say of the intervals.

    Attributes:
        names: the unknowns.
        level: at which the intervals were asked for.
        draws: one for each seed, in the order of the seeds.
        others: seeds for which a diagnosis found another set of effects than the true one.
    """

    names: tuple[str, ...]
    level: float
    draws: tuple[Draw, ...]
    others: tuple[int, ...] = ()

    @cached_property
    def errors(self) -> FloatArray:
        """(draws, k) errors in stated standard deviations."""
        return np.array([d.errors for d in self.draws])

    @property
    def shares(self) -> Mapping[str, float]:
        """Share of the draws in which each truth lies in its interval."""
        inside = np.array([d.inside for d in self.draws])
        return dict(zip(self.names, inside.mean(axis=0).tolist(), strict=True))

    @property
    def bias(self) -> Mapping[str, float]:
        """Mean error of each estimate in stated standard deviations; 0 +- 1/sqrt(draws)."""
        return dict(zip(self.names, self.errors.mean(axis=0).tolist(), strict=True))

    @property
    def spread(self) -> Mapping[str, float]:
        """True over stated standard deviation of each estimate; 1 where the stated one is right."""
        size = np.sqrt(np.mean(self.errors**2, axis=0))
        return dict(zip(self.names, size.tolist(), strict=True))

    def joint(self, stretch: float = 1.0) -> float:
        """Mean squared distance over its expectation k, stated deviations times ``stretch``.

        1 where the covariance is right. Unlike the shares it does not count one deviation once for
        each of several correlated unknowns.
        """
        return float(np.mean([d.distance for d in self.draws])) / len(self.names) / stretch**2

    def joint_band(self, level: float = 0.999) -> tuple[float, float]:
        """Interval of :meth:`joint` over these draws where the covariance is right."""
        freedom = len(self.names) * len(self.draws)
        low, high = stats.chi2.interval(level, freedom)
        return float(low) / freedom, float(high) / freedom

    def honest(self, stretch: float = 1.0) -> bool:
        """Whether stated deviations times ``stretch`` agree with the draws, at 99.9 %."""
        low, high = self.joint_band()
        return low <= self.joint(stretch) <= high

    def to_dict(self) -> dict[str, Any]:
        """Plain data with a ``schema`` key."""
        return {
            "schema": SCHEMA,
            "level": self.level,
            "draws": len(self.draws),
            "others": list(self.others),
            "share": dict(self.shares),
            "bias": dict(self.bias),
            "spread": dict(self.spread),
            "joint": self.joint(),
            "joint_band": list(self.joint_band()),
            "not_converged": [d.seed for d in self.draws if d.ending is not Ending.CONVERGED],
            "seconds": sum(d.seconds for d in self.draws),
        }

    def __str__(self) -> str:
        shares, bias, spread = self.shares, self.bias, self.spread
        rows = [
            (name, f"{100.0 * shares[name]:.0f} %", f"{bias[name]:+.2f}", f"{spread[name]:.2f}")
            for name in self.names
        ]
        low, high = self.joint_band()
        stuck = sum(d.ending is not Ending.CONVERGED for d in self.draws)
        seconds = sum(d.seconds for d in self.draws)
        other = f", {len(self.others)} more in which another set was found" if self.others else ""
        return "\n".join(
            [
                f"{len(self.draws)} draws{other}, intervals of {100.0 * self.level:g} %, "
                f"{stuck} not converged, {seconds:.1f} s of fitting",
                table(("parameter", "inside", "bias", "true/stated deviation"), rows),
                f"all together: {self.joint():.3f} (1 if the covariance is right; 99.9 % of such "
                f"runs lie in {low:.3f} .. {high:.3f})",
            ]
        )


@final
@dataclass(frozen=True, eq=False)
class _Task:
    """What all draws share; travels to each worker once."""

    question: Identification
    truth: Mapping[str, float]
    noise: float
    level: float
    without: tuple[str, ...]


def coverage(
    question: Identification,
    truth: Mapping[str, float],
    noise: float,
    *,
    seeds: Sequence[int] = tuple(range(100)),
    level: float = 0.95,
    without: Sequence[str] = (),
    executor: Executor | None = None,
    progress: Counted | None = None,
) -> Coverage:
    """Fit a question to many draws of white noise on readings without noise.

    Intervals are those of a model that was known, or, with effects that a diagnosis has to find
    first, those after selection: of the draws in which it found the true set. Details that were
    freed beside that are fitted and not judged.

    Args:
        question: model and records, whose positions are the truth's readings without noise; its
            unknowns are started automatically for every draw.
        truth: the value of each unknown (SI) that made the records.
        noise: standard deviation of the noise added [m].
        seeds: one draw each.
        level: of the intervals.
        without: effects of the question's model that are left to a diagnosis to find.
        executor: runs the draws in parallel.
        progress: called with (draws done, draws in all).

    Returns:
        the coverage over all draws, or over those that were done when interrupted (Ctrl-C).

    Raises:
        InputError: noise, level or seeds make no sense, or an unknown has no true value.
    """
    if not noise > 0 or not 0 < level < 1 or not seeds:
        raise InputError(
            f"coverage(noise={noise}, level={level}, {len(seeds)} seeds): give a positive noise in "
            "metres, a level between 0 and 1, and at least one seed."
        )
    task = _Task(question, truth, noise, level, tuple(without))
    names: tuple[str, ...] = ()
    draws: list[Draw] = []
    others: list[int] = []
    try:
        for named, draw in run_jobs(_draw, task, seeds, executor, progress, _lost):
            if isinstance(draw, Draw):
                names = named
                draws.append(draw)
            else:
                others.append(draw)
    except KeyboardInterrupt:
        if not draws:
            raise
    if not draws:
        raise InputError(f"coverage: another set than the true one was found {len(others)} times")
    order = {seed: k for k, seed in enumerate(seeds)}
    ordered = tuple(sorted(draws, key=lambda d: order[d.seed]))
    return Coverage(names, level, ordered, tuple(sorted(others)))


def _lost(seed: int, sentence: str) -> tuple[tuple[str, ...], Draw | int]:
    raise InputError(f"coverage: seed {seed}: {sentence}")


def _draw(job: _Task, seed: int) -> tuple[tuple[str, ...], Draw | int]:
    """What a draw says; its seed where a diagnosis found another set."""
    generator = np.random.default_rng(seed)
    records = tuple(
        r.with_(position=r.position + generator.normal(scale=job.noise, size=len(r)))
        for r in job.question.campaign.records
    )
    question = job.question.with_records(records)
    if job.without:
        model = question.model
        for name in job.without:
            model = model.without(name)
        found = diagnose(question.with_model(model), threads=1, advise=False, max_time=math.inf)
        if found.stopped is not None:
            raise KeyboardInterrupt
        fit = found.final
        if sorted(fit.model.names) != sorted(question.model.names):
            return (), seed
    else:
        fit = solve(question)
    if fit.outcome.ending is Ending.INTERRUPTED:
        raise KeyboardInterrupt
    missing = [n for n in fit.names if n not in job.truth]
    if missing and not job.without:
        raise InputError(
            f"coverage: no true value of {', '.join(missing)}; add it to truth, or fix it in the "
            "question."
        )
    kept = [k for k, n in enumerate(fit.names) if n in job.truth]
    names = tuple(fit.names[k] for k in kept)
    error = np.array([fit.values[n] - job.truth[n] for n in names])
    deviation = np.sqrt(np.diag(fit.covariance))[kept]
    half = np.array([0.5 * np.ptp(fit.interval(n, job.level)) for n in names])
    seen = np.isfinite(deviation)
    scaled = error[seen] / deviation[seen]
    correlation = fit.correlation[np.ix_(kept, kept)][np.ix_(seen, seen)]
    return names, Draw(
        seed,
        error / deviation,
        half / deviation,
        # An unknown at a bound has no stated deviation: its error is then not explained at all.
        float(scaled @ np.linalg.solve(correlation, scaled)) if seen.all() else float("inf"),
        fit.outcome.ending,
        fit.coloured,
        fit.wall_s,
    )
