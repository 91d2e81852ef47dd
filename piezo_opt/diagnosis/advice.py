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
from piezo_opt.diagnosis.scores import effective_samples
from piezo_opt.diagnosis.told import Step
from piezo_opt.effects.base import Effect, Parameter
from piezo_opt.errors import InputError, PiezoOptError
from piezo_opt.identification import Fit, solve, with_statistics
from piezo_opt.identification.shapes import resolving
from piezo_opt.signals import Drive, best_between, usual
from piezo_opt.signals.between import SURE
from piezo_opt.signals.drive import FloatArray
from piezo_opt.signals.planning import resonance_of, room_of
from piezo_opt.signals.rivals import Rival
from piezo_opt.simulation import TOLERANCE, Initial, Simulator
from piezo_opt.stopping import Pool
from piezo_opt.units import show

_DRIVES: Final = 3
"""Experiments that are advised at most for effects that the record could not show."""
_LONGER: Final = 4.0
"""Times the record's length that a drive lasts where its length is not enough: twice the sigmas of
what keeps adding to them."""
_MOST: Final = 8000
"""Samples of a drive for a group: more would take longer than the search that named it."""
_TRUTHS: Final = 6
"""Models times values of each that are taken for true on a drive: three of each of two models."""


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
    news = effective_samples(final.residuals) / final.residuals.size
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

    As long as the record, or four times that where it would not be sure, of 8000 samples at most.

    Args:
        alternatives: the fit with each effect of the group in place of the others.
        noise: root mean square of the reading's noise [m], as that of independent samples.

    Raises:
        InputError: fewer than two effects, a noise that is not positive, or no drive on which the
            models can be simulated.
    """
    names = tuple(alternatives)
    fits = {name: converged(fit) for name, fit in alternatives.items()}
    possible = max(1, _TRUTHS // len(names))
    record, before = fits[names[0]].records[0], 0.0
    for times in (1.0, _LONGER):
        lasting = min(times * record.duration, _MOST * record.step) + record.step
        if lasting > before:
            told = best_between(
                fits, noise=noise, duration=lasting, possible=possible, evaluations=0
            )
        if told.sigmas >= SURE:
            break
        before = lasting
    left = [float(np.sum(np.square(fits[name].residuals))) for name in told.closest]
    here = float(np.sqrt(abs(left[0] - left[1]))) / noise
    return Advice(
        group=names,
        drive=told.drive,
        sigmas=told.sigmas,
        here=here,
        detectable={},
        assumed={n: _own(fit.values.of_record(0), n) for n, fit in fits.items()},
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
    here = BasePoint(fit, sharp=True)
    left: dict[str, tuple[_Typical, float]] = {}
    for one in _typical(here, effects):
        seen = _visible(here, one)
        if seen is not None and seen / noise < SURE:
            left[one.effect.name] = one, seen / noise
    if not left:
        return (), ()
    room = room_of(fit, duration=None, slew=np.inf, highest=0.0, low=None, high=None, rate=None)
    everyone = [one for one, _ in left.values()]

    def judged(drive: Drive) -> dict[str, float]:
        return _shown(fit, drive, everyone, noise)

    drives = usual(room, resonance_of(fit))
    with Pool(max_workers=threads) as pool:
        told = list(zip(drives, pool.map(judged, drives), strict=True))
    advices: list[Advice] = []
    while left and len(advices) < _DRIVES:
        # Among drives that show as many, the one whose faintest stands out most.
        ranked = [
            (sum(s >= SURE for s in seen), min((s for s in seen if s >= SURE), default=0.0))
            for seen in ([sigmas.get(name, 0.0) for name in left] for _, sigmas in told)
        ]
        best = max(range(len(told)), key=lambda k: ranked[k])
        count, faint = ranked[best]
        if count == 0:
            break
        drive, sigmas = told[best]
        shown = {n: one for n, one in left.items() if sigmas.get(n, 0.0) >= SURE}
        detectable = {n: SURE * abs(one.size) / sigmas[n] for n, (one, _) in shown.items()}
        advices.append(
            Advice(
                group=tuple(shown),
                drive=drive,
                sigmas=faint,
                here=max(now for _, now in shown.values()),
                detectable=detectable,
                assumed={n: one.assumed for n, (one, _) in shown.items()},
                sentence=_reveal_sentence(
                    drive, [one.effect for one, _ in shown.values()], detectable
                ),
            )
        )
        left = {n: one for n, one in left.items() if n not in shown}
    return tuple(advices), tuple(left)


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
    for file in chosen:
        if file.exists() and not overwrite:
            raise InputError(
                f"{file}: exists already: choose another directory or pass overwrite=True"
            )
    for file, drive in chosen.items():
        drive.write(file, overwrite=overwrite)
    return tuple(chosen)


@final
@dataclass(frozen=True, eq=False)
class _Typical:
    """An absent effect of a usual size.

    Attributes:
        effect: the effect.
        shapes: own shapes: the point of its grid nearest to the middle of their typical ranges.
        size: of its gate, from null.
    """

    effect: Effect
    shapes: Mapping[str, float]
    size: float

    @property
    def assumed(self) -> dict[str, float]:
        """Own parameters by name, the gate among them."""
        gate = self.effect.gate or ""
        return {**self.shapes, gate: (self.effect.parameters[gate].null or 0.0) + self.size}


def _typical(point: BasePoint, effects: Sequence[Effect]) -> list[_Typical]:
    """Effects that the model can take; variants of one name stand for each other."""
    channels = tuple(point.question.campaign.records[0].channels)
    found: dict[str, _Typical] = {}
    for effect in effects:
        taken = effect.name in point.question.model or effect.name in found
        if taken or point.question.model.refusal(effect, channels) is not None:
            continue
        try:
            grid = point.grid(effect)
        except Exception:
            # A user's effect may raise whatever it likes; the scores have reported it.
            continue

        def distance(shapes: Mapping[str, float], effect: Effect = effect) -> float:
            return sum(_steps(effect.parameters[name], value) for name, value in shapes.items())

        gate = effect.parameters[effect.gate or ""]
        size = _middle(gate) - (gate.null or 0.0)
        found[effect.name] = _Typical(effect, min(grid, key=distance), size or gate.scale)
    return list(found.values())


def _steps(parameter: Parameter, value: float) -> float:
    """How far a value is from the middle of the typical range, in factors of e or in scales."""
    middle = _middle(parameter)
    if min(value, middle) <= 0.0:
        return abs(middle - value) / parameter.scale
    return abs(float(np.log(value / middle)))


def _middle(parameter: Parameter) -> float:
    """The middle of the typical range: geometric where it has one sign, else half its end."""
    low, high = parameter.typical or (parameter.nominal, parameter.nominal)
    if low * high > 0.0:
        return float(np.sign(low) * np.sqrt(low * high))
    return 0.5 * max(low, high, key=abs)


def _visible(point: BasePoint, one: _Typical) -> float | None:
    """What is left of an effect after the base parameters have explained their share [m]."""
    try:
        found = list(point.directions(one.effect, [one.shapes]))
    except Exception:
        # A user's effect may raise whatever it likes; the scores have reported it.
        return None
    if not found or np.linalg.norm(found[0].projected) <= 1e-7 * np.linalg.norm(found[0].whole):
        return 0.0 if found else None
    return abs(one.size) * float(np.linalg.norm(found[0].projected))


def _shown(fit: Fit, drive: Drive, effects: Sequence[_Typical], noise: float) -> dict[str, float]:
    """By how many sigmas each effect would stand out on a drive, the fit refitted without it.

    To first order in its size, since it is detectable sizes that are asked for.
    """
    rival = Rival(fit, drive.rate, tied=False)
    answer = rival.answer
    try:
        substeps = answer.settle(drive.values, TOLERANCE)
        plain = answer.reading(drive.values)
    except (PiezoOptError, ArithmeticError):
        return {}
    readings: dict[str, FloatArray] = {}
    for one in effects:
        model = fit.model + one.effect
        name = model.names[-1]
        gate = f"{name}.{one.effect.gate}"
        # A user's effect may raise whatever it likes; the scores have reported it.
        with suppress(Exception):
            nominal = {f"{name}.{k}": p.nominal for k, p in one.effect.parameters.items()}
            own = {f"{name}.{k}": v for k, v in one.assumed.items()}
            numbers = {**nominal, **answer.numbers, **own, gate: own[gate] - one.size}
            longest, farthest = resolving(one.effect, one.shapes)
            simulator = Simulator(
                model, answer.record(drive.values), numbers, directions=(gate,),
                initial=Initial.REST, runtime=fit.question.free,
                # On the fit's own sub-steps what the fit imitates exactly cancels exactly.
                substeps=replace(
                    substeps, longest=min(substeps.longest, longest), farthest=farthest
                ),
            )  # fmt: skip
            _, slope = simulator.with_sensitivities(numbers)
            if np.isfinite(slope).all():
                readings[one.effect.name] = plain + one.size * slope[:, 0]
    if not readings:
        return {}
    far = rival.distances(drive.values, list(readings.values()), noise, steps=1) or ()
    return dict(zip(readings, far, strict=False))


def _own(values: Mapping[str, float], name: str) -> dict[str, float]:
    """Own parameters of an effect by name."""
    return {k.removeprefix(f"{name}."): v for k, v in values.items() if k.startswith(f"{name}.")}


def _split_sentence(names: Sequence[str], drive: Drive, sigmas: float, now: float) -> str:
    """What the best drive would tell apart, by how many sigmas, and by how many it is now."""
    if sigmas < SURE and sigmas <= now:
        return (
            f"No usual drive tells {_listed(names)} apart better than this record, by "
            f"{_number(now)} sigmas: record longer, or with less noise."
        )
    least = "" if len(names) == 2 else " (the two most alike)"
    faint = "" if sigmas >= SURE else " It takes a longer record, or less noise, to be sure."
    return (
        f"Play {drive.description}: it separates {_listed(names)} by {_number(sigmas)} "
        f"sigmas{least}; this record separates them by {_number(now)}.{faint}"
    )


def _reveal_sentence(
    drive: Drive, effects: Sequence[Effect], detectable: Mapping[str, float]
) -> str:
    """What a drive would show that the fitted records hid, and from which size [SI] on."""
    sizes = [
        f"{e.name} from {e.gate} = "
        f"{show(detectable[e.name], e.parameters[e.gate or ''].unit)}" for e in effects
    ]  # fmt: skip
    return (
        f"This record could not show {_listed([e.name for e in effects])} of a usual size. Play "
        f"{drive.description}, which would ({'; '.join(sizes)})."
    )


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _number(sigmas: float) -> str:
    return f"{sigmas:.1f}" if sigmas < 10.0 else f"{min(sigmas, 1e6):.0f}"
