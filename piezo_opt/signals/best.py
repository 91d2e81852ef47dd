"""The drive from which parameters are learnt best."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, final

import numpy as np

from piezo_opt.choosing import whole, words
from piezo_opt.errors import InputError
from piezo_opt.identification import Fit
from piezo_opt.signals.answer import Answer, draws
from piezo_opt.signals.drive import Drive, FloatArray
from piezo_opt.signals.families import FAMILIES, Family
from piezo_opt.signals.information import Criterion, deviations, merit, worth
from piezo_opt.signals.planning import (
    excess,
    noise_of,
    resonance_of,
    room_of,
    slow_triangle,
    stroke_of,
)
from piezo_opt.signals.search import EARLY, FORBIDDEN, search
from piezo_opt.signals.timing import improved, wandering
from piezo_opt.signals.usual import usual
from piezo_opt.units import show

_WAYS: Final = 5
"""Drives whose time is shared out anew, the best ones found before."""
_TRIES: Final = 1
"""Moves of rests in each heat, for each drive that is judged in a family."""


@final
@dataclass(frozen=True, eq=False)
class BestDrive:
    """A drive, and how well parameters will be known from a record of it alone.

    Attributes:
        drive: what to play.
        parameters: those it was made for.
        expected: their standard deviations after a fit of such a record [SI].
        of_triangle: the same of a triangle with the same range, duration and rate.
        over_draws: smallest and largest of each over the values that the fit thinks possible.
        joint_gain: (det C of the triangle over det C of this drive)^(1 / 2p), C the covariance of
            the p parameters: how much smaller the region is in which they lie, by direction.
        units: SI unit of each.
        noise: of the reading that was assumed [m].
        evaluations: drives that were judged.
        interrupted: whether Ctrl-C or a limit of time ended the search.
    """

    drive: Drive
    parameters: tuple[str, ...]
    expected: Mapping[str, float]
    of_triangle: Mapping[str, float]
    over_draws: Mapping[str, tuple[float, float]]
    joint_gain: float
    units: Mapping[str, str]
    noise: float
    evaluations: int
    interrupted: bool = False

    @property
    def gain(self) -> float:
        """Deviations of the triangle over those of this drive, geometric mean of finite ones."""
        ratios = [
            self.of_triangle[n] / self.expected[n]
            for n in self.parameters
            if np.isfinite([self.of_triangle[n], self.expected[n]]).all()
        ]
        return float(np.exp(np.mean(np.log(ratios)))) if ratios else float("nan")

    @property
    def sentence(self) -> str:
        """The same in words."""
        return (
            f"Play {self.drive.description}: {', '.join(self.parameters)} will be known "
            f"{self.gain:.1f} times better than from a triangle of the same range and length "
            f"({self.joint_gain:.1f} times in the directions in which they vary together)."
            f"{EARLY if self.interrupted else ''}"
        )

    def __str__(self) -> str:
        lines = [
            self.sentence,
            "",
            f"  {'parameter':<26} {'expected':>13} {'triangle':>13}  over what is possible",
        ]
        for name in self.parameters:
            unit, (low, high) = self.units[name], self.over_draws[name]
            lines.append(
                f"  {name:<26} {show(self.expected[name], unit):>13} "
                f"{show(self.of_triangle[name], unit):>13}  {show(low, unit)} to {show(high, unit)}"
            )
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units."""
        return {
            "schema": "piezo_opt/best-drive/1",
            "drive": self.drive.description,
            "rate": self.drive.rate,
            "duration": self.drive.duration,
            "noise": self.noise,
            "gain": self.gain,
            "joint_gain": self.joint_gain,
            "expected": dict(self.expected),
            "of_triangle": dict(self.of_triangle),
            "over_draws": {n: list(both) for n, both in self.over_draws.items()},
            "evaluations": self.evaluations,
            "interrupted": self.interrupted,
        }


def best_for(
    fit: Fit,
    parameters: Sequence[str] | None = None,
    *,
    noise: float | None = None,
    low: float | None = None,
    high: float | None = None,
    duration: float | None = None,
    rate: float | None = None,
    slew: float = np.inf,
    highest: float = 0.0,
    stroke: tuple[float, float] | None = None,
    families: Sequence[Family] = FAMILIES,
    criterion: Criterion = Criterion.DEVIATIONS,
    possible: int = 3,
    evaluations: int = 250,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> BestDrive:
    """The drive from which parameters of a fitted model are learnt best.

    With the information M = J_1' (1 - P_2) J_1, P_2 onto the columns of everything else that a fit
    of the new record would estimate, it maximises what is averaged over values that the fit thinks
    possible:

        mean over draws of -sum_i log (M^-1)_ii, or of log det M

    J holds exact derivatives of the reading. The usual drives are judged, and drives whose levels,
    times and holds, or frequencies, amplitudes and phases are free, within range and slew rate. The
    best ones are improved: time goes where samples tell most, and rests move to better levels.

    Args:
        fit: the model and how well it is known now.
        parameters: full names; all that records share unless given.
        noise: of the reading [m]; the fit's residual unless given.
        low, high: range of the drive [unit]; that of the first record unless given.
        duration, rate: [s], [Hz]; those of the first record unless given.
        slew: fastest change [unit/s].
        highest: fastest sine [Hz]; a fifth of the rate unless given.
        stroke: positions that the fit may predict [m]; unless given what a step over the whole
            range reaches without damping: once the slow stroke beyond either end.
        families: where to look.
        criterion: what is made small: the deviations of the parameters, or the determinant of
            their covariance (D-optimality), which counts what they are known to together.
        possible: values that are averaged over, the fit's own among them.
        evaluations: drives judged in each family, and moves of each of the best; only the usual
            ones where that is zero.
        seed: of the search.
        progress: told how many drives were judged.

    Ctrl-C gives the best so far.

    Raises:
        InputError: a parameter is not estimated, a number makes no sense, or the model cannot be
            simulated on any drive.

    Sources: Pronzato & Walter (1985), Math. Biosciences 75(1), 103-120 (robust design: the mean
    over a distribution); Atkinson, Donev & Tobias (2007), Optimum Experimental Designs, with SAS,
    ch. 10 (D_s) and 18 (Bayesian D-optimality).
    """
    words(parameters, "parameters")
    whole(evaluations, "evaluations", 0)
    whole(possible, "possible", 1)
    whole(seed, "seed", 0)
    room = room_of(
        fit, duration=duration, slew=slew, highest=highest, low=low, high=high, rate=rate
    )
    sigma = noise_of(fit, noise)
    answer = Answer(fit, room.rate)
    wanted = answer.asked(parameters)
    cases = draws(answer, max(1, possible), seed)
    reference = slow_triangle(room)
    answer.settle(reference.values)
    allowed = stroke_of(answer, reference.values, stroke)

    def seen(values: FloatArray) -> list[FloatArray] | float | None:
        """Derivatives for each draw; a merit where the stroke is left; None without an answer."""
        slopes = []
        for number, numbers in enumerate(cases):
            found = answer.derivatives(values, numbers)
            if found is not None:
                beyond = excess(found[0], allowed)
                if beyond > 0.0:
                    return FORBIDDEN * (1.0 + beyond)
                slopes.append(found[1])
            elif number == 0:
                return None
        return slopes

    def judged(values: FloatArray) -> float | None:
        slopes = seen(values)
        if not isinstance(slopes, list):
            return slopes
        return float(np.mean([merit(answer, one, wanted, criterion) for one in slopes]))

    def look(values: FloatArray) -> tuple[float, FloatArray] | None:
        slopes = seen(values)
        if not isinstance(slopes, list):
            return None
        merits = [merit(answer, one, wanted, criterion) for one in slopes]
        worths = [worth(answer, one, wanted, criterion) for one in slopes]
        return float(np.mean(merits)), np.asarray(np.mean(worths, axis=0))

    offered = usual(room, resonance_of(fit))
    if evaluations > 0:
        offered = (*offered, *wandering(room, seed))
    found = search(
        families, room, judged, offered=offered, evaluations=evaluations, seed=seed,
        progress=progress,
    )  # fmt: skip
    if not found.best:
        raise InputError("the fitted model cannot be simulated on any drive of this range")
    drive, interrupted = found.best[0].drive, found.interrupted
    if evaluations > 0 and not interrupted:
        ways = [one.drive for one in found.best[:_WAYS]]
        told = progress or (lambda _: None)
        told("improving the best drives (Ctrl-C keeps the best so far)")
        best = improved(
            [one.values for one in ways], room, judged, look, _TRIES * evaluations, seed
        )
        interrupted = best.interrupted
        if best.merit > found.best[0].merit:
            said = f"{ways[best.number].description}, improved"
            drive = replace(ways[best.number], description=said, values=best.values)
    answer.settle(drive.values)
    after = [deviations(answer, drive.values, wanted, sigma, numbers) for numbers in cases]
    known = [one for one in after if one is not None]
    plain = deviations(answer, reference.values, wanted, sigma)
    if after[0] is None or plain is None:
        raise InputError("the fitted model cannot be simulated on any drive of this range")
    both = [answer.derivatives(one.values) for one in (drive, reference)]
    ours, theirs = (
        merit(answer, one[1], wanted, Criterion.DETERMINANT) for one in both if one is not None
    )
    return BestDrive(
        drive=drive,
        parameters=wanted,
        expected=after[0],
        of_triangle=plain,
        over_draws={n: (min(o[n] for o in known), max(o[n] for o in known)) for n in wanted},
        joint_gain=float(np.exp((ours - theirs) / (2 * len(wanted)))),
        units={n: fit.unit(n) for n in wanted},
        noise=sigma,
        evaluations=found.evaluations,
        interrupted=interrupted,
    )  # fmt: skip
