"""How far each unknown can be moved before the data object, all others following."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, final

import numpy as np
import scipy
from numpy.typing import NDArray

from piezo_opt.choosing import words
from piezo_opt.errors import InputError, ModelError
from piezo_opt.identification.log import Entry, Log, fingerprint
from piezo_opt.identification.profile_walk import Walk, walk
from piezo_opt.identification.result import Fit
from piezo_opt.identification.unknowns import theta_of, unknowns
from piezo_opt.spread import Lost, spread

FloatArray = NDArray[np.float64]
Counted = Callable[[int, int], None]
"""Progress: done, in all."""

SCHEMA: Final = "piezo_opt/profile/1"
_DIFFER: Final = "the fit's model, records, bounds, loss, values, or the level"


@final
@dataclass(frozen=True, eq=False)
class Profile:
    """The likelihood of one unknown, all others at their best.

    Attributes:
        name: of the unknown.
        unit: its SI unit.
        value: the estimate.
        level: of the interval.
        values: (P,) in ascending order.
        tau: (P,) signed root of the likelihood ratio; a straight line where the model is linear.
        interval: where ``|tau|`` reaches Student's t; an end that is open is the bound, or the
            farthest value that was tried.
        open: for the lower and the upper end, whether the data set no limit there.
        remark: what else happened on the way; empty if nothing.
    """

    name: str
    unit: str
    value: float
    level: float
    values: FloatArray
    tau: FloatArray
    interval: tuple[float, float]
    open: tuple[bool, bool]
    remark: str

    @property
    def sentence(self) -> str:
        """What the data say about it, where it is not an interval."""
        told = {
            (True, True): "the data set no limit in either direction",
            (True, False): "the data set no lower limit",
            (False, True): "the data set no upper limit",
        }.get(self.open, "")
        return "; ".join(part for part in (told, self.remark) if part)


@final
@dataclass(frozen=True, eq=False)
class Profiles:
    """Profiles of several unknowns.

    Attributes:
        fit: whose unknowns they are.
        profiles: in the order asked for.
        level: of the intervals.
        interrupted: whether there are fewer than were asked for.
    """

    fit: Fit
    profiles: tuple[Profile, ...]
    level: float
    interrupted: bool

    def __getitem__(self, name: str) -> Profile:
        for one in self.profiles:
            if one.name == name:
                return one
        raise InputError(f"no profile of '{name}': there are {', '.join(self.names)}")

    @property
    def names(self) -> tuple[str, ...]:
        """Their unknowns."""
        return tuple(p.name for p in self.profiles)

    def interval(self, name: str) -> tuple[float, float]:
        """Profile likelihood interval of an unknown at the level that was asked for."""
        return self[name].interval

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units, with a ``schema`` key."""
        return {
            "schema": SCHEMA,
            "method": "profile",
            "level": self.level,
            "interrupted": self.interrupted,
            "parameters": {
                p.name: {
                    "value": p.value,
                    "low": p.interval[0],
                    "high": p.interval[1],
                    "open": list(p.open),
                    "unit": p.unit,
                    "values": p.values.tolist(),
                    "tau": p.tau.tolist(),
                    "remark": p.sentence,
                }
                for p in self.profiles
            },
        }

    def __str__(self) -> str:
        percent = f"{100.0 * self.level:g} % from"
        lines = [
            f"Profile likelihood of {len(self.profiles)} unknowns"
            f"{', interrupted' if self.interrupted else ''}.",
            "",
            f"  {'parameter':<28} {'value':>12} {percent:>12} {'to':>12}  unit",
        ]
        for p in self.profiles:
            ends = [
                "open" if is_open else f"{end:.6g}"
                for end, is_open in zip(p.interval, p.open, strict=True)
            ]
            lines.append(f"  {p.name:<28} {p.value:>12.6g} {ends[0]:>12} {ends[1]:>12}  {p.unit}")
        told = [f"  {p.name}: {p.sentence}." for p in self.profiles if p.sentence]
        return "\n".join([*lines, *([""] if told else []), *told])


def profile_likelihood(
    fit: Fit,
    names: Sequence[str] | None = None,
    *,
    level: float = 0.95,
    executor: Executor | None = None,
    log: str | Path | None = None,
    progress: Counted | None = None,
) -> Profiles:
    """Move one unknown after the other away from its estimate, and fit all others there.

        tau(v) = sign(v - v0) sqrt((S(v) - S0) / s^2),   s^2 = S0 / (N - k)

    with S the least sum of squares that the others reach while the unknown is held at v, and S0
    that of the fit. The interval is where |tau| stays below Student's t. It follows the curvature
    of the model, ends at bounds, and is open where the data set no limit, which no covariance
    says. Where residuals are correlated in time, tau is divided by how much larger the fit's
    deviation is for it.

    Args:
        fit: a converged fit.
        names: unknowns to look at; all but starts of states unless given.
        level: of the intervals.
        executor: both sides of every unknown are walks of their own, and may run in parallel.
        log: HDF5 file that keeps every finished walk; a second call goes on from it.
        progress: called with (walks done, walks in all).

    Raises:
        InputError: the level is none, nothing was estimated, or the log is of another fit.
        ModelError: a name is no unknown of the fit.

    Sources: Bates & Watts (1988), Nonlinear Regression Analysis and Its Applications, sec. 6.1;
    Raue et al. (2009), Bioinformatics 25(15), 1923-1929 (open ends); Pace, Salvan & Sartori
    (2011), Statistica Sinica 21(1), 129-148 (correlated residuals).
    """
    if not 0.0 < level < 1.0:
        raise InputError(f"profile_likelihood(level={level}): give a level between 0 and 1.")
    words(names, "names")
    chosen = [n for n in fit.names if not n.startswith("initial.")] if names is None else [*names]
    for name in chosen:
        if name not in fit.names:
            raise ModelError(
                f"profile_likelihood: '{name}' was not estimated; the unknowns are "
                f"{', '.join(fit.names)}."
            )
    if not chosen:
        raise InputError("profile_likelihood: the fit has no unknowns; free some parameters.")
    task = _task(fit, level)
    jobs = [(fit.names.index(name), sign) for name in chosen for sign in (-1, 1)]
    kept: Log | None = None
    if log is not None:
        beside = (level, [a.substeps for a in fit.accuracy])
        asked = fingerprint(fit.question, task.unknown, task.centre, *beside)
        kept = Log(log, "piezo_opt/walks/1", asked, _DIFFER)
    found = {e.index: e for e in (kept.entries() if kept else ())}
    todo = [job for job in jobs if _number(job) not in found]
    interrupted = False
    try:
        for at, answer in spread(walk, task, todo, executor):
            number = _number(todo[at])
            lost = isinstance(answer, Lost)
            found[number] = _nothing(number, answer) if isinstance(answer, Lost) else answer
            if kept and not lost:
                kept.append(found[number])
            if progress is not None:
                progress(sum(_number(job) in found for job in jobs), len(jobs))
    except KeyboardInterrupt:
        interrupted = True
    whole = [n for n in chosen if all(_number((fit.names.index(n), s)) in found for s in (-1, 1))]
    if not whole:
        raise KeyboardInterrupt
    profiles = tuple(_profile(fit, task, name, found, level) for name in whole)
    return Profiles(fit, profiles, level, interrupted)


def _number(job: tuple[int, int]) -> int:
    return 2 * job[0] + (job[1] > 0)


def _nothing(number: int, lost: Lost) -> Entry:
    empty = np.zeros(0)
    return Entry(number, {"values": empty, "tau": empty}, {"end": np.nan, "remark": lost.sentence})


def _task(fit: Fit, level: float) -> Walk:
    """What all walks share."""
    unknown = unknowns(fit.question, fit.values)
    freedom = max(1, fit.residuals.size - len(fit.names))
    light = replace(fit, starts=(), trace=replace(fit.trace, values=np.zeros((0, 0))))
    limit = float(scipy.stats.t.ppf(0.5 + 0.5 * level, freedom))
    return Walk(light, unknown, theta_of(unknown, fit.values), limit)


def _profile(fit: Fit, task: Walk, name: str, found: dict[int, Entry], level: float) -> Profile:
    """Both walks of one unknown together."""
    index = fit.names.index(name)
    down, up = (found[_number((index, sign))] for sign in (-1, 1))
    values = np.concatenate(
        [down.arrays["values"][::-1], [task.centre[index]], up.arrays["values"]]
    )
    tau = np.concatenate([down.arrays["tau"][::-1], [0.0], up.arrays["tau"]])
    ends = [float(e.told["end"]) for e in (down, up)]
    is_open = tuple(not np.isfinite(end) for end in ends)
    interval = tuple(
        float(extreme) if opened else end
        for end, opened, extreme in zip(ends, is_open, (values[0], values[-1]), strict=True)
    )
    remark = "; ".join(dict.fromkeys(str(e.told["remark"]) for e in (down, up) if e.told["remark"]))
    return Profile(
        name, fit.unit(name), float(task.centre[index]), level, values, tau,
        (interval[0], interval[1]), (is_open[0], is_open[1]), remark,
    )  # fmt: skip
