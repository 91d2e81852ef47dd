"""Records of the plants of another hand, and the truth about them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Literal, TypeAlias, final
from zlib import crc32

import numpy as np
from scipy.signal import lfilter

from piezo_opt.benchmark.foreign.classes import (
    BEYOND,
    CLASSES,
    INSIDE,
    Hides,
    Random,
    log_uniform,
)
from piezo_opt.benchmark.foreign.drives import KINDS, draw_drive
from piezo_opt.benchmark.foreign.linear import second_order
from piezo_opt.benchmark.foreign.mechanics import Resonance
from piezo_opt.benchmark.foreign.operators import (
    Array,
    BoucWen,
    Operator,
    PrandtlIshlinskii,
    Preisach,
)
from piezo_opt.benchmark.foreign.scene import Scene
from piezo_opt.benchmark.foreign.simulate import Effect, Plant, Take, simulate

Level: TypeAlias = Literal["standard", "hard"]

_SIZES: Final[dict[Level, tuple[float, float]]] = {"standard": (3.0, 30.0), "hard": (0.7, 3.0)}
_ATTEMPTS: Final = 60
_NOISE: Final = (2e-4, 4e-3)
"""Noise over the stroke that is asked for; the limits of an effect may take it half as far again
on a logarithmic scale."""
_RANGES: Final = ((0.0, 100.0), (0.0, 150.0), (-10.0, 10.0), (0.0, 1000.0), (-30.0, 150.0))
_FINE_STROKES: Final = (3e-6, 12e-6)
_STROKES: Final = (1e-6, 200e-6)
_CONVERGED: Final = 0.05
"""Change over the noise, where sub-steps are halved, below which they are short enough."""
_HALVINGS: Final = 6
_REFERENCE: Final = 295.0


@final
@dataclass(frozen=True)
class Facts:
    """What is true about a record beside its effects.

    Attributes:
        kind: shape of its drive.
        rate: samples a second.
        static: without mechanics.
        colour, resolution: correlation of the noise from sample to sample; step of the reading
            over the noise, or 0.
        stroke: of the clean reading, peak to peak [m].
        ratio: rms of what the effects change that no gain, offset, shift in time, frequency or
            damping imitates, over the noise.
        sizes: the same of each effect alone.
        distinct: of each, what the other effects cannot imitate either.
        strengths: of each effect, in its own unit.
        plant, effects: as simulated, with ``take``.
    """

    kind: str
    rate: float
    static: bool
    colour: float
    resolution: float
    stroke: float
    ratio: float
    sizes: tuple[float, ...]
    distinct: tuple[float, ...]
    plant: Plant
    effects: tuple[Effect, ...]
    take: Take


@final
@dataclass(frozen=True, eq=False)
class ForeignRecord:
    """A record and its truth.

    Attributes:
        time: from 0 [s], uniform, shape (samples,).
        drive: [V], linear between the samples.
        position: the reading with noise [m].
        clean: without.
        noise_rms: of ``position - clean`` [m].
        temperature: a recorded channel [K], or None.
        held: False: the drive is linear between its samples.
        effects: names of what is hidden.
        meta: what else is true about it.
    """

    time: Array
    drive: Array
    position: Array
    clean: Array
    noise_rms: float
    temperature: Array | None
    held: bool
    effects: tuple[str, ...]
    meta: Facts


def make(
    effect_classes: Sequence[str], seed: int, *, samples: int = 8000, level: Level = "standard"
) -> tuple[ForeignRecord, ForeignRecord]:
    """Two records of one plant with these effects: one to fit, and another to judge on.

    An effect is sized by the rms of (reading with it - without it) on the first record, after
    its projection on a constant, the drive, the reading without it, their rates, and on what a
    change of the resonance makes of the reading: log-uniform in 3..30 times the noise, 0.7..3 at
    the level "hard". Strength is sought within what is plausible; the noise makes up the rest.

    Args:
        effect_classes: names out of CLASSES; ("none",) or () for the plant alone.
        seed: everything follows from it, the classes, the level and ``samples``.
        samples: at most; from a quarter of it on.
        level: of the sizes.

    Raises:
        ValueError: an unknown or repeated class, too few samples, or classes that no drawn
            plant could show.
    """
    names = tuple(name for name in effect_classes if name != "none")
    unknown = [name for name in names if name not in CLASSES]
    if unknown or len(set(names)) < len(names):
        raise ValueError(f"Classes {', '.join(names)}: name some of {', '.join(CLASSES)}, once.")
    if samples < 500:
        raise ValueError(f"{samples} samples are too few for a record: ask for at least 500.")
    hides = [INSIDE[name] if name in INSIDE else BEYOND[name] for name in names]
    key = crc32(f"foreign:{','.join(names)}:{level}".encode())
    for attempt in range(_ATTEMPTS):
        random = np.random.default_rng([seed, key, attempt])
        try:
            return _drawn(random, names, hides, samples, _SIZES[level])
        except _Implausible:
            continue
    raise ValueError(f"No plausible plant shows {' and '.join(names)} at the level {level}.")


def draw_pairs(seed: int) -> Iterator[tuple[str, str]]:
    """Pairs of classes of the catalogue that act at different places."""
    random = np.random.default_rng([seed, crc32(b"foreign pairs")])
    names = tuple(INSIDE)
    while True:
        first, second = (names[int(k)] for k in random.choice(len(names), 2, replace=False))
        if INSIDE[first].place != INSIDE[second].place:
            yield first, second


class _Implausible(Exception):
    """This draw cannot show what is asked for."""


def _drawn(
    random: Random, names: tuple[str, ...], hides: Sequence[Hides], samples: int,
    sizes: tuple[float, float],
) -> tuple[ForeignRecord, ForeignRecord]:  # fmt: skip
    count = round(log_uniform(random, min(max(samples / 4, 500), samples), samples))
    scene = _scene(random, hides, count)
    plant = _plant(random, scene)
    warm = any("temperature" in name or "thermal" in name for name in names)
    takes = []
    kinds = []
    for _ in range(2):
        kind, drive, first = _drive(random, scene, count)
        kinds.append(kind)
        takes.append(Take(drive, first, _warmth(random, drive.size, first), _first_parts(scene)))
    plain = simulate(plant, (), takes[0])
    stroke = float(np.ptp(plain))
    known = _imitations(scene, takes[0].recorded, plain)
    usual = float(np.mean(np.abs(np.diff(takes[0].recorded)))) * scene.rate
    ratios = [log_uniform(random, *sizes) for _ in hides]
    noise = stroke * log_uniform(random, *_NOISE)
    effects: list[Effect] = []
    for hide, ratio in zip(hides, ratios, strict=True):
        unit = hide.draw(random, scene, usual)
        scale = scene.quick if hide.timed else 1.0
        limits = hide.low * scale, hide.high * scale
        effects.append(_sized(plant, takes[0], unit, limits, plain, known, ratio * noise))
    # The noise that follows from what the effects leave may be below the one asked for.
    left = [_rms(_rest(simulate(plant, (one,), takes[0]) - plain, known)) for one in effects]
    least = min([noise, *(one / ratio for one, ratio in zip(left, ratios, strict=True))])
    takes = [_converged(plant, effects, take, least) for take in takes]
    # What is true at these sub-steps.
    plain = simulate(plant, (), takes[0])
    known = _imitations(scene, takes[0].recorded, plain)
    rests = [_rest(simulate(plant, (one,), takes[0]) - plain, known) for one in effects]
    alone = [_rms(rest) for rest in rests]
    if len(effects) == 1:
        noise = alone[0] / ratios[0]
    elif effects:
        # Effects that share a sensor: each of them within the sizes.
        least, most = max(alone) / sizes[1], min(alone) / sizes[0]
        if least > most:
            raise _Implausible
        noise = float(np.clip(noise, least, most))
    if not 0.3 * _NOISE[0] * stroke <= noise <= 2.5 * _NOISE[1] * stroke:
        raise _Implausible
    colour = random.uniform(0.2, 0.9) if random.uniform() < 0.35 else 0.0
    resolution = random.uniform(0.5, 2.5) if random.uniform() < 0.25 else 0.0
    shown = warm or (scene.duration > 1.0 and random.uniform() < 0.1)
    together = simulate(plant, effects, takes[0]) - plain
    others = [rests[:k] + rests[k + 1 :] for k in range(len(rests))]
    records = []
    for kind, take in zip(kinds, takes, strict=True):
        clean = simulate(plant, effects, take)
        if not np.isfinite(clean).all() or np.ptp(clean) > 6.0 * scene.stroke:
            raise _Implausible
        position = clean + noise * _coloured(random, clean.size, colour)
        if resolution:
            position = noise * resolution * np.round(position / (noise * resolution))
        heat = _REFERENCE + take.warmth[take.first :]
        heat = heat + 2e-3 * random.standard_normal(heat.size)
        facts = Facts(
            kind, scene.rate, scene.resonance is None, colour, resolution, float(np.ptp(clean)),
            _rms(_rest(together, known)) / noise if effects else 0.0,
            tuple(size / noise for size in alone),
            tuple(
                _rms(_rest(rest, np.stack(o, axis=1)) if o else rest) / noise
                for rest, o in zip(rests, others, strict=True)
            ),
            plant, tuple(effects), take,
        )  # fmt: skip
        records.append(
            ForeignRecord(
                np.arange(clean.size) / scene.rate,
                take.recorded,
                position,
                clean,
                _rms(position - clean),
                heat if shown else None,
                False,
                names,
                facts,
            )
        )
    return records[0], records[1]


def _scene(random: Random, hides: Sequence[Hides], count: int) -> Scene:
    """Ranges and times, such that every effect can show."""
    low, high = _RANGES[int(random.integers(len(_RANGES)))]
    fine = any(hide.fine for hide in hides)
    stroke = log_uniform(random, *(_FINE_STROKES if fine else _STROKES))
    moving = any(hide.moving for hide in hides) or random.uniform() < 0.5
    if moving:
        natural = log_uniform(random, 60.0, 2000.0)
        rate = float(np.clip(natural * log_uniform(random, 6.0, 40.0), 400.0, 50e3))
        zeta = log_uniform(random, 0.01, 0.3)
        resonance = Resonance(2.0 * np.pi * natural, zeta)
    else:
        rate, resonance = log_uniform(random, 100.0, 5000.0), None
    duration = count / rate
    if any(hide.hum for hide in hides) and not (rate > 300.0 and duration > 0.08):
        raise _Implausible
    if any(hide.slow for hide in hides) and duration < 1.0:
        raise _Implausible
    return Scene(low, high, stroke, rate, duration, resonance)


def _plant(random: Random, scene: Scene) -> Plant:
    """Half Prandtl-Ishlinskii, half Preisach, a few Bouc-Wen."""
    volt = max(abs(scene.low), abs(scene.high))
    span = 2.0 * scene.half / volt
    operator: Operator
    law = random.uniform()
    if law < 0.45:
        count = int(random.integers(5, 16))
        thresholds = span * np.sort(random.uniform(0.01, 0.45, count))
        weights = random.exponential(1.0, count)
        weights *= log_uniform(random, 0.15, 0.7) / np.sum(weights)
        operator = PrandtlIshlinskii(1.0, tuple(weights.tolist()), tuple(thresholds.tolist()))
    elif law < 0.9:
        operator = Preisach(
            random.uniform(0.4, 0.85), (scene.low / volt + 1.0) / 2.0 + random.uniform(-0.2, 0.2),
            random.uniform(0.5, 1.2) * span, random.uniform(0.0, 0.15) * span,
            random.uniform(0.1, 0.3) * span, tuple(_history(random, scene) / volt),
        )  # fmt: skip
    else:
        beta = log_uniform(random, 1.0, 5.0) / span
        operator = BoucWen(
            random.uniform(0.6, 0.9), beta, beta * random.uniform(-0.5, 0.5),
            1.0 if random.uniform() < 0.5 else random.uniform(1.0, 2.0),
        )  # fmt: skip
    swing = np.interp(
        np.arange(401) / 100.0, np.arange(5), [0.0, scene.high, scene.low, scene.high, scene.low]
    )
    gain = scene.stroke / float(np.ptp(operator(swing / volt)[100:]))
    offset = scene.stroke * random.uniform(-0.3, 0.3) if random.uniform() < 0.7 else 0.0
    return Plant(operator, volt, gain, offset, scene)


def _history(random: Random, scene: Scene) -> Array:
    """Turning points of what was played before [V]."""
    high = scene.middle + scene.half * random.uniform(0.2, 1.0)
    low = scene.middle + (high - scene.middle) * random.uniform(-1.0, 0.5)
    return np.array([high, low])


def _drive(random: Random, scene: Scene, count: int) -> tuple[str, Array, int]:
    """A shape, its drive [V] with what came before, and where the record begins."""
    before = int(random.uniform(0.05, 0.4) * count) if random.uniform() < 0.5 else 0
    if scene.resonance is None:
        fastest = 1.0 / log_uniform(random, 20.0, 200.0)
    else:
        natural = scene.resonance.omega / (2.0 * np.pi * scene.rate)
        through = scene.resonance.zeta > 0.05 and random.uniform() < 0.5
        fastest = natural * (random.uniform(1.0, 1.4) if through else random.uniform(0.15, 0.5))
    kind = KINDS[int(random.integers(len(KINDS)))]
    total = count + before
    unit = draw_drive(random, kind, total, fastest * total, fastest)
    share = random.uniform(0.6, 1.0)
    centre = scene.middle + scene.half * (1.0 - share) * random.uniform(-1.0, 1.0)
    drive = centre + scene.half * share * unit
    if random.uniform() < 0.3:
        step = 2.0 * scene.half / 2.0 ** int(random.choice([12, 14, 16]))
        drive = step * np.round(drive / step)
    return kind, drive, before


def _warmth(random: Random, count: int, first: int) -> Array:
    """Degrees over the reference: settling and a slow wave."""
    share = (np.arange(count) - first) / (count - first)
    grown = -np.expm1(-share / log_uniform(random, 0.2, 2.0))
    wave = np.sin(2.0 * np.pi * (random.uniform(0.3, 2.5) * share + random.uniform()))
    warmth: Array = random.uniform(-5.0, 5.0) * grown + random.uniform(0.2, 1.5) * wave
    return warmth


def _first_parts(scene: Scene) -> int:
    """Sub-steps to begin with."""
    if scene.resonance is None:
        return 2
    return max(int(np.ceil(scene.resonance.omega / scene.rate / 0.3)), 2)


def _imitations(scene: Scene, drive: Array, reading: Array) -> Array:
    """What gain, offset, a shift in time and another resonance make of a reading."""
    columns = [np.ones_like(drive), drive, reading, np.gradient(drive), np.gradient(reading)]
    if scene.resonance is not None:
        # d/d(zeta) and d/d(omega) of the motion: its rates, passed through the resonance again.
        rate = np.gradient(reading)
        pace = scene.resonance.omega, scene.resonance.zeta, 1.0 / scene.rate
        columns += [second_order(rate, *pace), second_order(np.gradient(rate), *pace)]
    return np.stack(columns, axis=1)


def _rest(change: Array, known: Array) -> Array:
    """What no combination of known columns imitates."""
    scaled = known / np.linalg.norm(known, axis=0)
    factors = np.linalg.lstsq(scaled, change, rcond=None)[0]
    rest: Array = change - scaled @ factors
    return rest


def _sized(
    plant: Plant, take: Take, unit: Effect, limits: tuple[float, float], plain: Array,
    known: Array, wanted: float,
) -> Effect:  # fmt: skip
    """The effect at the strength that leaves ``wanted`` [m rms], as far as it is plausible.

    A secant on logarithms.
    """
    low, high = np.log(limits)
    at, order = 0.5 * (low + high), 1.0
    best, nearest = np.inf, unit
    last: tuple[float, float] | None = None
    for _ in range(8):
        one = _strong(unit, float(np.exp(at)))
        try:
            left = _rms(_rest(simulate(plant, (one,), take) - plain, known))
        except (ValueError, np.linalg.LinAlgError):
            left = np.nan  # gave way
        if not np.isfinite(left):
            high, last = at, None
            at = 0.5 * (low + high)
            continue
        off = float(np.log(max(left, 1e-6 * wanted) / wanted))
        if abs(off) < best:
            best, nearest = abs(off), one
        if abs(off) < 0.1:
            break
        if last is not None and at != last[0]:
            order = float(np.clip((off - last[1]) / (at - last[0]), 0.4, 4.0))
        last = at, off
        after = float(np.clip(at - off / order, low, high))
        if after == at:
            break
        at = after
    if not np.isfinite(best):
        raise _Implausible
    return nearest


def _strong(unit: Effect, strength: float) -> Effect:
    """The effect, so many times stronger."""
    one: Any = unit  # every effect is a dataclass with a strength
    stronger: Effect = replace(one, strength=strength * one.strength)
    return stronger


def _converged(plant: Plant, effects: Sequence[Effect], take: Take, noise: float) -> Take:
    """At sub-steps whose halves change nothing beside the noise."""
    coarse = simulate(plant, effects, take)
    for _ in range(_HALVINGS):
        finer = take.finer()
        fine = simulate(plant, effects, finer)
        if not np.isfinite(fine).all():
            raise _Implausible
        if _rms(fine - coarse) < _CONVERGED * noise:
            return take
        take, coarse = finer, fine
    raise _Implausible


def _coloured(random: Random, count: int, colour: float) -> Array:
    """Gaussian noise of unit size, correlated from sample to sample."""
    white = random.standard_normal(count + 200)
    found: Array = lfilter([np.sqrt(1.0 - colour**2)], [1.0, -colour], white)[200:]
    return found


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values * values)))
