"""What to measure next: the drive that splits effects alike, or shows those that were hidden.

Both ask how far a fitted model stays from what another model would read on a drive that nobody has
played, and both ask :mod:`piezo_opt.signals` (T-optimality, its sources there).
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, final

import numpy as np

from piezo_opt.diagnosis.base_point import BasePoint
from piezo_opt.diagnosis.colour import Colour
from piezo_opt.diagnosis.told import Step
from piezo_opt.effects.base import Effect
from piezo_opt.errors import InputError, PiezoOptError
from piezo_opt.identification import Fit, solve, with_statistics
from piezo_opt.identification.problem import plain
from piezo_opt.identification.unknowns import limits
from piezo_opt.measurement import Measurement
from piezo_opt.signals import Drive, best_between, usual
from piezo_opt.signals.answer import Answer
from piezo_opt.signals.between import SURE
from piezo_opt.signals.planning import resonance_of, room_of
from piezo_opt.simulation import TOLERANCE
from piezo_opt.simulation.accuracy import Accuracy
from piezo_opt.stopping import Pool
from piezo_opt.units import show
from piezo_opt.values import Values

MOST: Final = 8000
"""Samples of a drive for a group that its own length does not split: more would take longer than
the search that named the group."""


@final
@dataclass(frozen=True)
class Advice:
    """One experiment, and what it would tell.

    Attributes:
        group: names that it would tell apart, or show.
        drive: what to play.
        sigmas: expected separation of the two most alike, or of the hardest to see from noise.
        here: the same on the fitted records.
        detectable: for effects to be shown, the gate's size [SI] that shows with five sigmas.
        assumed: own parameters [SI] that are assumed of each member.
        sentence: the same in words.
    """

    group: tuple[str, ...]
    drive: Drive
    sigmas: float
    here: float
    detectable: Mapping[str, float]
    assumed: Mapping[str, Mapping[str, float]]
    sentence: str

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units."""
        return {
            "group": list(self.group),
            "drive": self.drive.description,
            "file": f"{self.drive.name}.csv",
            "rate": self.drive.rate,
            "sigmas": self.sigmas,
            "sigmas_here": self.here,
            "detectable": dict(self.detectable),
            "assumed": {name: dict(own) for name, own in self.assumed.items()},
        }


def experiments(
    steps: Sequence[Step],
    final: Fit,
    offered: Sequence[Effect],
    noise: float,
    *,
    hidden: bool,
    threads: int = 2,
) -> tuple[tuple[Advice, ...], tuple[str, ...]]:
    """What to play after a ladder: for every group it could not split, and for what it hid.

    Args:
        steps: accepted effects with their groups.
        final: the fit at the top.
        offered: every effect that was considered.
        noise: root mean square of the reading's noise [m].
        hidden: whether to look for drives that show what the records could not.
        threads: drives that are judged at a time.

    Returns:
        the experiments, and the names that no usual drive would show.
    """
    # Slow noise carries less news a sample; what is left unexplained counts as noise.
    news = Colour.of(final.residuals, [int(r.counted.sum()) for r in final.records], 1).news
    level = max(noise, final.rms) / float(np.sqrt(news))
    found: list[Advice] = []
    for step in steps:
        if len(step.group) > 1:
            # What cannot be simulated on any drive gets no experiment; the group is named anyway.
            with suppress(PiezoOptError):
                found.append(split(step.alternatives, level))
    never: tuple[str, ...] = ()
    if hidden:
        with suppress(PiezoOptError):
            shown, never = reveal(final, offered, level, threads=threads)
            found += shown
    return tuple(found), never


def split(alternatives: Mapping[str, Fit], noise: float) -> Advice:
    """Which of the usual drives tells the effects of a group apart.

    As long as the record, or :data:`MOST` samples where that would not be sure. For each effect a
    fit with it in place of the others; noise as for :func:`reveal`.

    Raises:
        InputError: fewer than two effects, a noise that is not positive, or no drive on which the
            models can be simulated.
    """
    names = tuple(alternatives)
    fits = {name: converged(fit) for name, fit in alternatives.items()}
    record = fits[names[0]].records[0]
    own, longest = record.duration + record.step, MOST * record.step
    told = best_between(fits, noise=noise, duration=min(own, longest), evaluations=0)
    if told.sigmas < SURE and own < longest:
        told = best_between(fits, noise=noise, duration=longest, evaluations=0)
    left = [float(np.sum(np.square(fits[name].residuals))) for name in told.closest]
    here = float(np.sqrt(abs(left[0] - left[1]))) / noise
    return Advice(
        group=names,
        drive=told.drive,
        sigmas=told.sigmas,
        here=here,
        detectable={},
        assumed={
            name: {
                own: fit.values.of_record(0)[f"{name}.{own}"] for own in fit.model[name].parameters
            }
            for name, fit in fits.items()
        },
        sentence=_split_sentence(names, told.drive, told.sigmas, here),
    )


def converged(fit: Fit) -> Fit:
    """A fit of a search, gone on with where it had not ended, and with its statistics."""
    return with_statistics(fit) if fit.outcome.success else solve(fit.question, start=fit)


def reveal(
    fit: Fit, effects: Sequence[Effect], noise: float, *, threads: int = 2
) -> tuple[tuple[Advice, ...], tuple[str, ...]]:
    """Which few drives would show the effects that the fitted records could not have shown.

    An effect counts as not shown when, at the middle of its typical range, what the fitted
    parameters leave of it stays below five sigmas of the noise. Drives are taken greedily, each
    the one that shows most of what is left.

    Args:
        fit: the final fit.
        effects: absent effects; those that the model cannot take are passed over.
        noise: root mean square of the reading's noise [m], as that of independent samples.
        threads: drives that are judged at a time.

    Returns:
        the experiments, and the names that no usual drive would show.

    Raises:
        InputError: the noise is not positive.
    """
    if not 0.0 < noise < np.inf:
        raise InputError(f"noise is {noise:g} m; give a positive length in metres.")
    own = {e: _typical(e, fit.records) for e in effects if e.gate and e.name not in fit.model}
    here = _shown(fit, own, noise)
    left = [effect for effect, far in here.items() if far < SURE]
    hidden = {effect: own[effect] for effect in left}
    if not hidden:
        return (), ()
    room = room_of(fit, duration=None, slew=np.inf, highest=0.0, low=None, high=None, rate=None)

    def judged(drive: Drive) -> dict[Effect, float]:
        try:
            seen = _shown(_played(fit, drive), hidden, noise)
        except (PiezoOptError, ArithmeticError):
            return {}
        return {effect: far for effect, far in seen.items() if far >= SURE}

    drives = usual(room, resonance_of(fit))
    with Pool(max_workers=threads) as pool:
        told = list(pool.map(judged, drives))
    advices: list[Advice] = []
    while True:
        told = [{e: far for e, far in seen.items() if e in left} for seen in told]
        # Among drives that show as many, the one whose faintest stands out most.
        drive, shown = max(
            zip(drives, told, strict=True),
            key=lambda one: (len(one[1]), min(one[1].values(), default=0.0)),
        )
        if not shown:
            return tuple(advices), tuple(e.name for e in left)
        left = [e for e in left if e not in shown]
        least = {e.name: SURE * _size(e, own[e]) / far for e, far in shown.items()}
        sizes = [
            f"{e.name} from {e.gate} = {show(least[e.name], e.parameters[e.gate or ''].unit)}"
            for e in shown
        ]
        advices.append(
            Advice(
                group=tuple(least),
                drive=drive,
                sigmas=min(shown.values()),
                here=max(here[e] for e in shown),
                detectable=least,
                assumed={e.name: own[e] for e in shown},
                sentence=(
                    f"This record could not show {_listed(tuple(least))} of a usual size. Play "
                    f"{drive.description}, which would ({'; '.join(sizes)})."
                ),
            )
        )


def write_drives(
    experiments: Sequence[Advice], directory: str | os.PathLike[str], *, overwrite: bool = False
) -> tuple[Path, ...]:
    """Write the drive of each experiment as a CSV that can be played; the files written.

    Args:
        experiments: ``diagnosis.experiments``.
        directory: an existing folder.
        overwrite: replace files that exist.

    Raises:
        InputError: there is no such folder, a file exists, or it cannot be written.
    """
    folder = Path(directory)
    if not folder.is_dir():
        raise InputError(f"{folder}: there is no such directory: make it first")
    chosen = {folder / f"{one.drive.name}.csv": one.drive for one in experiments}
    there = next((file for file in chosen if file.exists() and not overwrite), None)
    if there is not None:
        raise InputError(f"{there}: exists already: choose another directory or overwrite=True")
    for file, drive in chosen.items():
        drive.write(file, overwrite=overwrite)
    return tuple(chosen)


def _played(fit: Fit, drive: Drive) -> Fit:
    """The fit as if its model had read the drive without noise, beginning wherever it was."""
    answer = Answer(fit, drive.rate)
    substeps = answer.settle(drive.values, TOLERANCE)
    reading = answer.reading(drive.values)
    question = replace(answer.question, records=answer.record(drive.values, reading))
    return replace(
        fit, question=question, names=answer.names, readings=(reading,),
        at_bound=tuple(n for n in map(plain, fit.at_bound) if n in answer.parameters),
        values=Values({**dict.fromkeys(answer.names, 0.0), **answer.numbers}),
        accuracy=(Accuracy(substeps, 0.0, 1.0),),
    )  # fmt: skip


def _shown(
    fit: Fit, typical: Mapping[Effect, Mapping[str, float]], noise: float
) -> dict[Effect, float]:
    """By how many sigmas effects of typical own parameters would stand out on a fit's records.

    What the fitted parameters explain is left out, to first order in the size, since it is
    detectable sizes that are asked for. Of an effect in several forms the first that can be asked.
    """
    # As sharp as the fit: what it imitates exactly cancels exactly.
    point = BasePoint(fit, sharp=True)
    found: dict[Effect, float] = {}
    for effect, own in typical.items():
        known = any(effect.name == other.name for other in found)
        if known or fit.model.refusal(effect, tuple(fit.records[0].channels)) is not None:
            continue
        shapes = {name: value for name, value in own.items() if name != effect.gate}
        # A user's effect may raise whatever it likes; the scores have reported it.
        with suppress(Exception):
            for d in point.directions(effect, [shapes]):
                part = float(np.linalg.norm(d.projected))
                gone = part <= 1e-7 * np.linalg.norm(d.whole)
                found[effect] = 0.0 if gone else _size(effect, own) * part / noise
    return found


def _typical(effect: Effect, records: tuple[Measurement, ...]) -> dict[str, float]:
    """Own parameters of an absent effect: the middle of what is typical and records can show.

    Geometric where the range has one sign, else half its larger end.
    """
    own: dict[str, float] = {}
    for name, p in effect.parameters.items():
        if name == effect.gate or not p.fixed:
            within = p.bounds if name == effect.gate else limits(p, records)
            low, high = np.clip(p.typical or (p.nominal, p.nominal), *within).tolist()
            signed = np.sign(low) * np.sqrt(max(0.0, low * high))
            own[name] = float(signed or 0.5 * max(low, high, key=abs))
    gate = effect.parameters[effect.gate or ""]
    if own[effect.gate or ""] == (gate.null or 0.0):
        own[effect.gate or ""] += gate.scale
    return own


def _size(effect: Effect, own: Mapping[str, float]) -> float:
    """How far an effect's gate is from null."""
    gate = effect.gate or ""
    return abs(own[gate] - (effect.parameters[gate].null or 0.0))


def _split_sentence(names: Sequence[str], drive: Drive, sigmas: float, now: float) -> str:
    """What the best drive would tell apart, by how many sigmas, and by how many it is now."""
    if sigmas < SURE and sigmas <= now:
        return (
            f"No usual drive tells {_listed(names)} apart better than this record, by "
            f"{now:.1f} sigmas: record longer, or with less noise."
        )
    least = "" if len(names) == 2 else " (the two most alike)"
    faint = "" if sigmas >= SURE else " It takes a longer record, or less noise, to be sure."
    return (
        f"Play {drive.description}: it separates {_listed(names)} by {sigmas:.1f} "
        f"sigmas{least}; this record separates them by {now:.1f}.{faint}"
    )


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
