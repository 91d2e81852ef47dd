"""What to measure next: the drive that splits effects alike, or shows those that were hidden.

On each candidate drive the fitted model gives the derivatives by its own parameters and by the
gates of absent effects; what the parameters explain is projected out, on the new drive, with its
unknown start. Two effects i, j are then

    sigmas = min over shapes and sizes of j of |phi_i S_perp_i - phi_j S_perp_j| / noise

apart (and the other way round, the smaller of the two; j's memory may start anywhere within its
bounds, and what i's start could do is projected out): how surely the new record will tell them
apart. phi_i is the size at which the effect explains what it explains on the fitted records. One
effect alone shows with ``|phi S_perp| / noise`` sigmas.

Source: Box & Hill (1967), Technometrics 9(1), 57-71 (experiments that discriminate among models);
Atkinson & Fedorov (1975), Biometrika 62(1), 57-70 (T-optimality: the distance to the rival's best
fit).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, final

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from piezo_opt.diagnosis.base_point import BasePoint, Direction
from piezo_opt.diagnosis.drives import Excitation, candidate_drives
from piezo_opt.diagnosis.ladder import Step
from piezo_opt.diagnosis.scores import effective_samples
from piezo_opt.effects.base import Effect, Parameter
from piezo_opt.errors import InputError, PiezoOptError
from piezo_opt.identification import Fit, Start
from piezo_opt.identification.problem import plain
from piezo_opt.identification.unknowns import limits, unknowns
from piezo_opt.measurement import Between, Measurement
from piezo_opt.simulation import INITIAL, Initial, Simulator, Substeps
from piezo_opt.units import show
from piezo_opt.values import Values

FloatArray = NDArray[np.float64]

SEEN: Final = 5.0
"""Sigmas from which an effect counts as shown, or two as told apart."""
_LONGEST: Final = 20_000
"""Samples of a candidate drive beyond which the advice would take long; drives are cut there."""
_DRIVES: Final = 3
"""Experiments that are advised at most for effects that the record could not show."""


@final
@dataclass(frozen=True)
class Trial:
    """What one drive would tell.

    Attributes:
        drive: the drive.
        sigmas: by how much it separates the two members most alike, or shows the hardest to see.
        hardest: the two (or the one) that are meant.
    """

    drive: Excitation
    sigmas: float
    hardest: tuple[str, ...]


@final
@dataclass(frozen=True)
class Advice:
    """One experiment, and what it would tell.

    Attributes:
        group: names that it would tell apart, or show.
        drive: what to play.
        rate: samples a second [Hz] at which it was judged.
        sigmas: expected separation of the two most alike, or of the hardest to see from noise.
        here: the same on the fitted records.
        detectable: for effects to be shown, the gate's size [SI] that shows with five sigmas.
        assumed: own parameters [SI] that are assumed of each member.
        trials: all drives judged, best first.
        sentence: the same in words.
    """

    group: tuple[str, ...]
    drive: Excitation
    rate: float
    sigmas: float
    here: float
    detectable: Mapping[str, float]
    assumed: Mapping[str, Mapping[str, float]]
    trials: tuple[Trial, ...]
    sentence: str

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units."""
        return {
            "group": list(self.group),
            "drive": self.drive.description,
            "file": f"{self.drive.name}.csv",
            "rate": self.rate,
            "sigmas": self.sigmas,
            "sigmas_here": self.here,
            "detectable": dict(self.detectable),
            "assumed": {name: dict(own) for name, own in self.assumed.items()},
        }


@final
@dataclass(frozen=True, eq=False)
class _Member:
    """An absent effect with the shapes and the size that are assumed of it.

    ``size`` counts from the gate's null; ``grid`` are the shapes that it may take instead.
    """

    effect: Effect
    shapes: Mapping[str, float]
    size: float
    grid: tuple[Mapping[str, float], ...]

    def assumed(self) -> dict[str, float]:
        """Own parameters by name, the gate among them."""
        gate = _gate(self.effect)
        return {**self.shapes, self.effect.gate or "": _null(gate) + self.size}


def advise(
    fit: Fit,
    group: Sequence[Effect],
    noise: float,
    *,
    drives: Sequence[Excitation] | None = None,
    duration: float | None = None,
    threads: int = 2,
) -> Advice:
    """Which drive tells the effects of a group apart.

    Args:
        fit: the fit *without* the effects; sizes and shapes are those of their scores at it.
        group: two or more absent effects; variants of one name stand for each other.
        noise: root mean square of the reading's noise [m], as that of independent samples.
        drives: candidates; :func:`candidate_drives` of the first record unless given.
        duration: of each candidate [s]; that of the first record unless given.
        threads: drives that are judged at a time.

    Raises:
        InputError: fewer than two effects, a noise that is not positive, or no drive on which the
            model can be simulated.
        ModelError: the model cannot take an effect.
    """
    names = tuple(dict.fromkeys(e.name for e in group))
    if len(names) < 2:
        raise InputError(f"Nothing to tell apart in ({', '.join(names)}): name two effects.")
    _check_noise(noise)
    here = BasePoint(fit, sharp=True)
    members = _sized(here, group)
    offered = _offered(fit, drives, duration)
    rate = fit.records[0].rate

    def judge(drive: Excitation) -> Trial | None:
        point = _at(fit, drive, rate)
        if point is None:
            return None
        apart = _separation(point, members)
        return None if apart is None else Trial(drive, apart[0] / noise, apart[1])

    with ThreadPoolExecutor(max_workers=threads) as pool:
        judged = [t for t in pool.map(judge, offered) if t is not None]
    if not judged:
        raise InputError("No candidate drive can be simulated with the fitted model.")
    trials = tuple(sorted(judged, key=lambda t: -t.sigmas))
    best = trials[0]
    own = _separation(here, members)
    now = 0.0 if own is None else own[0] / noise
    return Advice(
        group=names,
        drive=best.drive,
        rate=rate,
        sigmas=best.sigmas,
        here=now,
        detectable={},
        assumed={m.effect.name: m.assumed() for m in reversed(members)},
        trials=trials,
        sentence=_split_sentence(names, best, now),
    )


def reveal(
    fit: Fit,
    effects: Sequence[Effect],
    noise: float,
    *,
    drives: Sequence[Excitation] | None = None,
    duration: float | None = None,
    threads: int = 2,
) -> tuple[tuple[Advice, ...], tuple[str, ...]]:
    """Which few drives would show the effects that the fitted records could not have shown.

    An effect counts as not shown when, at the middle of its typical range, what the fitted
    parameters leave of it stays below five sigmas of the noise. Drives are taken greedily, each
    the one that shows most of what is left.

    Args:
        fit: the final fit.
        effects: absent effects; those that the model cannot take are passed over.
        noise: root mean square of the reading's noise [m], as that of independent samples.
        drives, duration, threads: as for :func:`advise`.

    Returns:
        the experiments, and the names that no candidate drive would show.

    Raises:
        InputError: the noise is not positive.
    """
    _check_noise(noise)
    here = BasePoint(fit, sharp=True)
    hidden: list[tuple[_Member, float]] = []
    for member in _typical(here, effects):
        seen = _visible(here, member)
        if seen is not None and seen / noise < SEEN:
            hidden.append((member, seen / noise))
    if not hidden:
        return (), ()
    offered = _offered(fit, drives, duration)
    rate = fit.records[0].rate

    def judge(drive: Excitation) -> dict[str, float] | None:
        point = _at(fit, drive, rate)
        if point is None:
            return None
        seen = {m.effect.name: _visible(point, m) for m, _ in hidden}
        return {name: (s or 0.0) / noise for name, s in seen.items()}

    with ThreadPoolExecutor(max_workers=threads) as pool:
        judged = [(d, s) for d, s in zip(offered, pool.map(judge, offered), strict=True) if s]
    left = {m.effect.name: (m, now) for m, now in hidden}
    advices: list[Advice] = []
    while left and judged and len(advices) < _DRIVES:
        trials = []
        for drive, sigmas in judged:
            shown = [n for n in left if sigmas[n] >= SEEN]
            # Among drives that show as many, the one whose faintest stands out most.
            faintest = min(shown, key=lambda n: sigmas[n], default="")
            trials.append((len(shown), sigmas.get(faintest, 0.0), drive, shown, faintest, sigmas))
        trials.sort(key=lambda t: (-t[0], -t[1]))
        count, faint, drive, shown, faintest, sigmas = trials[0]
        if count == 0:
            break
        detectable = {n: SEEN * abs(left[n][0].size) / sigmas[n] for n in shown}
        advices.append(
            Advice(
                group=tuple(shown),
                drive=drive,
                rate=rate,
                sigmas=faint,
                here=max(left[n][1] for n in shown),
                detectable=detectable,
                assumed={n: left[n][0].assumed() for n in shown},
                trials=tuple(Trial(t[2], t[1], (t[4],) if t[4] else ()) for t in trials),
                sentence=_reveal_sentence(drive, [left[n][0].effect for n in shown], detectable),
            )
        )
        for name in shown:
            del left[name]
    return tuple(advices), tuple(left)


def experiments(
    fit: Fit,
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
        fit: the baseline.
        steps: accepted effects with their groups.
        final: the fit at the top.
        offered: every effect that was considered.
        noise: root mean square of the reading's noise [m].
        hidden: whether to look for drives that show what the records could not.
        threads: drives that are judged at a time.

    Returns:
        the experiments, and the names that no candidate drive would show (or split).
    """
    # Slow noise carries less news a sample; what is left unexplained counts as noise.
    news = effective_samples(final.residuals) / final.residuals.size
    level = max(noise, final.rms) / float(np.sqrt(news))
    found: list[Advice] = []
    before = fit
    for step in steps:
        group = [e for n in step.group for e in offered if e.name == n]
        if len(step.group) > 1:
            # Without a size or a drive there is no experiment; the group is named anyway.
            with suppress(PiezoOptError):
                found.append(advise(before, group, level, threads=threads))
        before = step.fit
    if not hidden:
        return tuple(found), ()
    shown, never = reveal(final, offered, level, threads=threads)
    return (*found, *shown), never


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
    chosen = {f"{one.drive.name}.csv": one for one in experiments}
    for name in chosen:
        if (folder / name).exists() and not overwrite:
            raise InputError(
                f"{folder / name}: exists already: choose another directory or pass overwrite=True"
            )
    for name, one in chosen.items():
        one.drive.write(folder / name, one.rate, overwrite=overwrite)
    return tuple(folder / name for name in chosen)


def _check_noise(noise: float) -> None:
    if not 0.0 < noise < np.inf:
        raise InputError(f"noise is {noise:g} m; give a positive length in metres.")


def _offered(
    fit: Fit, drives: Sequence[Excitation] | None, duration: float | None
) -> Sequence[Excitation]:
    if drives is not None:
        return drives
    record = fit.records[0]
    longest = _LONGEST * record.step
    lasting = record.duration + record.step if duration is None else duration
    return candidate_drives(record, min(lasting, longest), _resonance(fit))


def _resonance(fit: Fit) -> float | None:
    """Lowest natural frequency of the base model [Hz]."""
    found = [
        fit.values[f"{name}.{own}"] / (2.0 * np.pi)
        for name, effect in fit.model
        for own, p in effect.parameters.items()
        if effect.structural and p.unit == "rad/s" and f"{name}.{own}" in fit.values
    ]
    return min(found, default=None)


def _at(fit: Fit, drive: Excitation, rate: float) -> BasePoint | None:
    """The fitted model on a drive not yet played; None where it cannot be simulated.

    The start of the new record is as unknown as that of the fitted ones, unless they begin at
    rest; further channels stand at their mean.
    """
    first = fit.records[0]
    time, voltage = drive.samples(rate)
    between = Between.LINEAR if first.between is Between.BANDLIMITED else first.between
    numbers = {k: v for k, v in fit.values.of_record(0).items() if not k.startswith(INITIAL)}
    record = Measurement(
        time=time,
        drive=voltage,
        # The position of a record is not read by a simulation.
        position=voltage,
        channels={k: np.full(time.size, float(c.mean())) for k, c in first.channels.items()},
        channel_units=first.channel_units,
        name=drive.name,
        drive_unit=first.drive_unit,
        position_unit=first.position_unit,
        between=between,
        allow_saturated=True,
    )
    start = Start.REST if fit.question.start is Start.REST else None
    try:
        simulator = Simulator(
            fit.model, record, numbers, initial=Initial.REST, runtime=fit.question.free
        )
        reading = simulator.reading(numbers)
        if not np.isfinite(reading).all() or np.ptp(reading) == 0.0:
            return None
        asked = fit.question
        question = replace(
            asked,
            records=record.with_(position=reading),
            fixed={**asked.fixed, **_alone(asked.fixed)},
            values={},
            bounds={},
            priors={},
            per_record=(),
            weights=(),
            start=start,
        )
        unknown = unknowns(question, Values(numbers))
        played = replace(
            fit,
            question=question,
            values=Values(numbers),
            names=unknown.names,
            covariance=np.full((len(unknown.names),) * 2, np.nan),
            at_bound=tuple({plain(n) for n in fit.at_bound} & set(unknown.names)),
            readings=(reading,),
            accuracy=(simulator.accuracy,),
            starts=(),
        )
        return BasePoint(played, sharp=True)
    except (PiezoOptError, ArithmeticError, np.linalg.LinAlgError):
        return None


def _alone(fixed: Mapping[str, float | str]) -> dict[str, float | str]:
    """What is fixed on the first record of several, under its plain name."""
    return {
        plain(k): v for k, v in fixed.items() if k.endswith("[0]") and not k.startswith(INITIAL)
    }


def _sized(point: BasePoint, group: Sequence[Effect]) -> list[_Member]:
    """Members of a group at their best shapes, each as large as the best of them explains."""
    drafts: list[tuple[_Member, float, float]] = []
    for member in _typical(point, group, variants=True):
        best, best_gain, best_length = member, -1.0, 0.0
        for d in point.directions(member.effect, member.grid):
            length = float(np.linalg.norm(d.projected))
            if length <= 1e-9 * float(np.linalg.norm(d.whole)):
                continue
            along = float(d.projected @ point.residual)
            gain = abs(along) / length if _allowed(member.effect, along) else 0.0
            if gain > best_gain:
                way = float(np.sign(along)) if gain > 0.0 else float(np.sign(member.size))
                best_gain, best_length = gain, length
                best = replace(member, shapes=d.shapes, size=way)
        drafts.append((best, best_gain, best_length))
    explained = max(gain for _, gain, _ in drafts)
    if explained <= 0.0:
        explained = float(np.linalg.norm(point.residual))
    members = []
    for member, _, length in drafts:
        if length == 0.0:
            members.append(member)
            continue
        gate = _gate(member.effect)
        size = float(np.clip(_null(gate) + member.size * explained / length, *gate.bounds))
        members.append(replace(member, size=size - _null(gate)))
    return members


def _typical(
    point: BasePoint, effects: Sequence[Effect], *, variants: bool = False
) -> list[_Member]:
    """Effects that the model can take, in the middle of their typical ranges."""
    channels = tuple(point.question.campaign.records[0].channels)
    members: dict[tuple[object, ...], _Member] = {}
    for effect in effects:
        key = (effect.name, *effect.options.items()) if variants else (effect.name,)
        taken = effect.name in point.question.model or key in members
        if taken or point.question.model.refusal(effect, channels) is not None:
            continue
        gate = _gate(effect)
        try:
            grid = tuple(point.grid(effect))
        except Exception:
            # A user's effect may raise whatever it likes; the scores have reported it.
            continue

        def distance(shapes: Mapping[str, float], effect: Effect = effect) -> float:
            return sum(
                abs(_middle(effect.parameters[name]) - value) / effect.parameters[name].scale
                if min(value, _middle(effect.parameters[name])) <= 0.0
                else abs(float(np.log(value / _middle(effect.parameters[name]))))
                for name, value in shapes.items()
            )

        size = _middle(gate) - _null(gate)
        if size == 0.0:
            size = gate.scale
        wide = (*grid, *_slower(effect, grid, point.question.campaign.records))
        members[key] = _Member(effect, min(grid, key=distance), size, wide)
    return list(members.values())


def _slower(
    effect: Effect, grid: Sequence[Mapping[str, float]], records: tuple[Measurement, ...]
) -> list[dict[str, float]]:
    """Points beyond a grid of shapes: a refit may stretch a time constant past the record."""
    found: list[dict[str, float]] = []
    for name in grid[0]:
        if effect.parameters[name].unit != "s":
            continue
        longest = max(shapes[name] for shapes in grid)
        last = next(shapes for shapes in grid if shapes[name] == longest)
        _, high = limits(effect.parameters[name], records)
        found += [{**last, name: longest * k} for k in (3.0, 10.0) if longest * k <= 1.001 * high]
    return found


def _middle(parameter: Parameter) -> float:
    """The middle of the typical range: geometric where it has one sign, else half its end."""
    low, high = parameter.typical or (parameter.nominal, parameter.nominal)
    if low * high > 0.0:
        return float(np.sign(low) * np.sqrt(low * high))
    return 0.5 * max(low, high, key=abs)


def _gate(effect: Effect) -> Parameter:
    return effect.parameters[effect.gate or ""]


def _null(gate: Parameter) -> float:
    return gate.null if gate.null is not None else 0.0


def _allowed(effect: Effect, way: float) -> bool:
    """Whether a one-sided gate may move this way from its null."""
    gate = _gate(effect)
    null = _null(gate)
    return (way > 0.0 and gate.bounds[1] > null) or (way < 0.0 and gate.bounds[0] < null)


def _visible(point: BasePoint, member: _Member) -> float | None:
    """What is left of a member after the base parameters have explained their share [m]."""
    try:
        found = point.directions(member.effect, [member.shapes])
    except Exception:
        # As above: what a user's effect raises is reported by the scores.
        return None
    if not found or np.linalg.norm(found[0].projected) <= 1e-7 * np.linalg.norm(found[0].whole):
        return 0.0 if found else None
    return abs(member.size) * float(np.linalg.norm(found[0].projected))


def _separation(
    point: BasePoint, members: Sequence[_Member]
) -> tuple[float, tuple[str, str]] | None:
    """Smallest distance [m] between what one member does and the best another can do."""
    able: list[list[_Able]] = []
    for member in members:
        found = point.directions(member.effect, [member.shapes, *member.grid])
        if not found or found[0].shapes != dict(member.shapes):
            return None
        able.append([_Able(d, _starts(point, member, d.shapes)) for d in found])
    least: tuple[float, tuple[str, str]] | None = None
    for i, one in enumerate(members):
        does = one.size * able[i][0].direction.projected
        free = _complement(able[i][0].starts)
        for j, other in enumerate(members):
            if one.effect.name == other.effect.name:
                continue
            apart = _distance(free(does), other.effect, able[j], free)
            if least is None or apart < least[0]:
                least = apart, (one.effect.name, other.effect.name)
    return least


@final
@dataclass(frozen=True, eq=False)
class _Able:
    """What an effect can do with one set of shapes, for a gate of one.

    Attributes:
        direction: by its gate, from rest.
        starts: what its memory adds when it starts at its farthest, each element by itself.
    """

    direction: Direction
    starts: tuple[FloatArray, ...]

    def corners(self) -> list[FloatArray]:
        """The gate's column for every start at its farthest: all it can do lies between them."""
        columns = [self.direction.projected]
        for start in self.starts:
            columns = [c + way * start for c in columns for way in (1.0, -1.0)]
        return columns


def _starts(
    point: BasePoint, member: _Member, shapes: Mapping[str, float]
) -> tuple[FloatArray, ...]:
    """What a member's memory adds from its farthest start, for a gate of one, projected."""
    effect, question = member.effect, point.question
    if not any(state.remanent for state in effect.declared_states.values()):
        return ()
    model = question.model + effect
    name = model.names[-1]
    gate = f"{name}.{effect.gate}"
    found: list[FloatArray] = []
    before = 0
    for index, record in enumerate(question.campaign.records):
        after = before + int(record.counted.sum())
        numbers = {
            **{f"{name}.{k}": p.nominal for k, p in effect.parameters.items()},
            **point.fit.values.of_record(index),
            **{f"{name}.{k}": v for k, v in {**member.assumed(), **shapes}.items()},
        }
        alone = replace(question.with_model(model), records=record, weights=())
        reach = {
            u.local: u.high
            for u in unknowns(alone, Values(numbers)).members
            if u.local.startswith(f"{INITIAL}{name}.")
        }
        if reach:
            substeps = point.fit.accuracy[index].substeps
            quickest = min(
                (v for k, v in shapes.items() if effect.parameters[k].unit == "s"), default=np.inf
            )
            simulator = Simulator(
                model,
                record,
                numbers,
                directions=tuple(reach),
                runtime=question.free,
                substeps=Substeps(min(substeps.longest, quickest), substeps.largest_move),
            )
            slopes = simulator.with_sensitivities(numbers)[1][record.counted]
            open_by = numbers[gate] - _null(_gate(effect))
            for column, far in zip(slopes.T, reach.values(), strict=True):
                whole = np.zeros(point.samples)
                whole[before:after] = column * far / open_by
                if np.isfinite(whole).all():
                    found.append(point.project(whole))
        before = after
    return tuple(found)


def _complement(columns: Sequence[FloatArray]) -> Callable[[FloatArray], FloatArray]:
    """The projection of (M,) onto what these columns cannot do."""
    if not columns:
        return lambda column: column
    long = [c / np.linalg.norm(c) for c in columns if np.any(c)]
    u, strength, _ = np.linalg.svd(np.column_stack(long), full_matrices=False)
    basis = u[:, strength > 1e-6]
    return lambda column: np.asarray(column - basis @ (basis.T @ column))


def _distance(
    target: FloatArray,
    effect: Effect,
    able: Sequence[_Able],
    free: Callable[[FloatArray], FloatArray],
) -> float:
    """From a signal to the nearest that an effect can make of it, any size, shape, start [m].

    Shapes between two neighbours of the grid act like a sum of both with one sign.

    Args:
        target: (M,) the signal.
        effect: the effect.
        able: what it can do, shape by shape.
        free: a projection under which all is compared; ``target`` has been through it.
    """
    parts = [[free(c) for c in one.corners()] for one in able]
    matrix = np.column_stack([c for part in parts for c in part])
    ends = np.cumsum([0, *map(len, parts)])
    gram, along = matrix.T @ matrix, matrix.T @ target

    def explained(*shapes: int, either: bool = False) -> float:
        members = np.concatenate([np.arange(ends[a], ends[a + 1]) for a in shapes])
        own, reached = gram[np.ix_(members, members)], along[members]
        found = 0.0
        if either:
            return _plane(own, reached)
        for way in (1.0, -1.0):
            if _allowed(effect, way):
                found = max(found, _cone(own, way * reached))
        return found

    best = 0.0
    for a, one in enumerate(able):
        best = max(best, explained(a))
        for b, other in enumerate(able[:a]):
            shapes = one.direction.shapes, other.direction.shapes
            if _neighbours(effect, *shapes):
                best = max(best, explained(a, b, either=_angular(effect, *shapes)))
    return float(np.sqrt(max(0.0, float(target @ target) - best)))


def _cone(gram: FloatArray, along: FloatArray) -> float:
    """Most of a signal's power that a sum of columns with no negative factor explains [m^2]."""
    root, reached = _root(gram, along)
    factors, _ = optimize.nnls(root, reached)
    return float(2.0 * factors @ along - factors @ gram @ factors)


def _plane(gram: FloatArray, along: FloatArray) -> float:
    """The same with factors of any sign."""
    _, reached = _root(gram, along)
    return float(reached @ reached)


def _root(gram: FloatArray, along: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A small matrix and vector with the same least squares problem as (M, k) columns."""
    strength, vectors = np.linalg.eigh(gram)
    kept = strength > 1e-12 * max(float(strength[-1]), 1e-300)
    root = np.sqrt(strength[kept])
    return root[:, None] * vectors[:, kept].T, (vectors[:, kept].T @ along) / root


def _differing(one: Mapping[str, float], other: Mapping[str, float]) -> list[str]:
    return [k for k in one if one[k] != other[k]]


def _neighbours(effect: Effect, one: Mapping[str, float], other: Mapping[str, float]) -> bool:
    """Whether two points of a grid differ in one shape by less than a decade, or in an angle."""
    names = _differing(one, other)
    if len(names) != 1:
        return False
    a, b = one[names[0]], other[names[0]]
    if effect.parameters[names[0]].unit == "rad":
        return True
    return a * b > 0.0 and abs(float(np.log10(a / b))) < 1.0


def _angular(effect: Effect, one: Mapping[str, float], other: Mapping[str, float]) -> bool:
    return all(effect.parameters[n].unit == "rad" for n in _differing(one, other))


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _sigmas(number: float) -> str:
    return f"{number:.1f}" if number < 10.0 else f"{min(number, 1e6):.0f}"


def _split_sentence(names: Sequence[str], best: Trial, now: float) -> str:
    drive = best.drive.description
    if best.sigmas < SEEN and best.sigmas <= now:
        return (
            f"No candidate drive tells {_listed(names)} apart better than this record, by "
            f"{_sigmas(now)} sigmas: record longer, or with less noise."
        )
    least = "" if len(names) == 2 else " (the two most alike)"
    faint = "" if best.sigmas >= SEEN else " It takes a longer record, or less noise, to be sure."
    return (
        f"Play a {drive}: it separates {_listed(names)} by {_sigmas(best.sigmas)} sigmas{least}; "
        f"this record separates them by {_sigmas(now)}.{faint}"
    )


def _reveal_sentence(
    drive: Excitation, effects: Sequence[Effect], detectable: Mapping[str, float]
) -> str:
    sizes = [f"{e.name} from {e.gate} = {show(detectable[e.name], _gate(e).unit)}" for e in effects]
    return (
        f"This record could not show {_listed([e.name for e in effects])} of a usual size: a "
        f"{drive.description} would ({'; '.join(sizes)})."
    )
