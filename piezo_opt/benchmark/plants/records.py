"""Records of plants with hidden effects, for a diagnosis that shares no code with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias, final
from zlib import crc32

import numpy as np

from piezo_opt.benchmark.plants.classes import ALL, BEYOND, CLASSES, INSIDE, Shows
from piezo_opt.benchmark.plants.drives import Drive, Kind, make_drive
from piezo_opt.benchmark.plants.hidden import Hidden, Scale, Scene, log_uniform
from piezo_opt.benchmark.plants.noise import Noise, read
from piezo_opt.benchmark.plants.physics import Array, Base, Grid
from piezo_opt.benchmark.plants.refit import Tangent, refit, tangent
from piezo_opt.benchmark.plants.simulate import Trace, simulate

Level: TypeAlias = Literal["standard", "hard"]

_SIZES: dict[Level, tuple[float, float]] = {"standard": (3.0, 30.0), "hard": (0.7, 3.0)}
_REFERENCE = 293.15
"""Temperature at which the base plant holds [K]."""
_ATTEMPTS = 40
_USUAL_NOISE = (4e-4, 5e-3)
"""Noise over stroke that is asked for; limits of the effect may take it to a quarter or twice."""
_FINE_NOISE = (1e-4, 1e-3)
"""The same for interferometers."""
_WORTH = 0.02
"""Unexplained rms over stroke beyond which no effect is asked to go."""
_CONVERGED = 0.1
"""Change over the noise, where sub-steps are halved, below which they are short enough."""
_HALVINGS = 4
"""Times that sub-steps are halved at most."""


@final
@dataclass(frozen=True)
class Facts:
    """What is true about a record beside its effects.

    Attributes:
        kind: class of its drive; ``bits`` of its converter, or None.
        rate: samples a second.
        static: quasi-static: sampled too slowly for the resonance.
        cut: starts in the middle of motion; ``remanent``: with hysteresis in it.
        colour, resolution: of the noise (see Noise).
        stroke: of the clean reading, peak to peak [m].
        unexplained: rms that the best refit of the base plant leaves of the clean reading [m].
        ratio: ``unexplained`` over the noise rms.
        sizes: per effect, its own ratio, all others absent.
        distinct: per effect, what of that ratio the others' directions cannot imitate (linearised).
        intensities: per effect, relative to the plant's scale.
        forms: per effect, in which form it was written, where there are several.
        base: the base plant and its start.
    """

    kind: Kind
    bits: int | None
    rate: float
    static: bool
    cut: bool
    remanent: bool
    colour: float
    resolution: float
    stroke: float
    unexplained: float
    ratio: float
    sizes: tuple[float, ...]
    distinct: tuple[float, ...]
    intensities: tuple[float, ...]
    forms: tuple[str, ...]
    base: Base


@final
@dataclass(frozen=True, eq=False)
class HiddenRecord:
    """A record and its truth.

    Attributes:
        time: from 0 [s], uniform, shape (samples,).
        drive: the command as recorded [V].
        position: the reading with noise [m].
        clean: the reading without.
        noise_rms: of ``position - clean`` [m].
        temperature: a recorded channel [K], or None.
        effects: names of what is hidden in it, in the order asked for.
        held: the drive is held between samples; otherwise it is linear.
        seed: it was made from.
        meta: what else is true about it; ``ratio`` and ``unexplained`` are the training
            record's in both of a pair.
    """

    time: Array
    drive: Array
    position: Array
    clean: Array
    noise_rms: float
    temperature: Array | None
    effects: tuple[str, ...]
    held: bool
    seed: int
    meta: Facts


def make(
    effect_classes: Sequence[str], seed: int, *, samples: int = 8000,
    size: tuple[float, float] | None = None, level: Level = "standard", test: bool = True,
) -> tuple[HiddenRecord, ...]:  # fmt: skip
    """A plant with these effects: its training record and, with ``test``, an independent one.

    The size of an effect is the rms that the best refit of the base plant (gain, loop, exponent,
    resonance, damping, offset, initial states) leaves of the clean training record, over the
    noise rms. It is drawn log-uniformly from ``size`` (3..30; 0.7..3 at the level "hard"): the
    effect's intensity is sought within what hardware shows, and the noise makes up the rest.
    Plants, drives and noise are drawn until all are plausible, on both records.

    Args:
        effect_classes: names out of CLASSES; ("none",) or () for the base plant alone.
        seed: everything follows from it, the classes, the level and the number of samples.
        samples: of each record, at least 500.

    Raises:
        ValueError: an unknown or repeated class, too few samples, an empty range of sizes, or
            classes that no drawn plant could show.
    """
    names = tuple(name for name in effect_classes if name != "none")
    for name in names:
        if name not in CLASSES:
            raise ValueError(f"There is no class '{name}': there are {', '.join(CLASSES)}.")
    if len(set(names)) < len(names):
        raise ValueError(f"The classes {', '.join(names)} repeat: name each effect once.")
    if samples < 500:
        raise ValueError(f"{samples} samples are too few for a record: ask for at least 500.")
    sizes = _SIZES[level] if size is None else size
    if not 0.0 < sizes[0] <= sizes[1]:
        raise ValueError(f"Sizes run from a positive number upwards, not {sizes}.")
    shows = [INSIDE[name] if name in INSIDE else BEYOND[name] for name in names]
    key = crc32(f"{','.join(names)}:{level}".encode())
    for attempt in range(_ATTEMPTS):
        random = np.random.default_rng([seed, key, attempt])
        plant = _plant(random, shows, samples)
        train = _take(random, plant, shows, samples, seed)
        sized = _size(random, plant, train, shows, sizes)
        if sized is None:
            continue
        other = _take(random, plant, shows, samples, seed + 1)
        noise = np.random.default_rng([seed, key, _ATTEMPTS])
        train, clean = _converged(train, sized, names)
        sized = _resized(train, clean, sized)
        first = _record(noise, plant, train, clean, sized, names, seed)
        second = _record(noise, plant, *_converged(other, sized, names), sized, names, seed)
        # A spring that softens may give way under the other drive.
        if np.isfinite(first.position).all() and np.isfinite(second.position).all():
            return (first, second) if test else (first,)
    raise ValueError(
        f"No plausible plant shows {' and '.join(names)} at sizes {sizes[0]:g} to "
        f"{sizes[1]:g} times its noise: ask for other sizes or classes."
    )


@final
@dataclass(frozen=True)
class _Plant:
    """A base plant, its scale, its effects at intensity 0, and how it is sampled."""

    base: Base
    scale: Scale
    effects: tuple[Hidden, ...]
    rate: float
    held: bool
    colour: float
    resolution: float


@final
@dataclass(frozen=True)
class _Take:
    """One record of a plant before its noise."""

    drive: Drive
    scene: Scene
    remanent: bool
    temperature: Array | None


@final
@dataclass(frozen=True)
class _Sized:
    """The effects at their intensities, and what follows."""

    effects: tuple[Hidden, ...]
    noise: float
    unexplained: float
    sizes: tuple[float, ...]
    distinct: tuple[float, ...]


def _plant(random: np.random.Generator, shows: Sequence[Shows], samples: int) -> _Plant:
    """Draw a plant that can show these effects."""
    likely = [show.still for show in shows] or [0.2]
    static = min(likely) > 0.0 and random.uniform() < max(likely)
    slow = any(show.slow for show in shows)
    fine = any(show.fine for show in shows)
    if static:
        rate = round(log_uniform(random, 20.0, 200.0), 1)
        natural = random.uniform(300.0, 900.0)
    else:
        rates = [1000.0, 1250.0, 2000.0, 2500.0] + ([] if slow else [4000.0, 5000.0, 8000.0, 1e4])
        rate = float(random.choice(rates))
        natural = log_uniform(random, 150.0, min(900.0, rate / 6.0))
    largest = random.uniform(5.0, 25.0) if fine else float(
        random.choice([20.0, 30.0, 50.0, 75.0, 100.0, 120.0, 150.0])
    )  # fmt: skip
    shape = random.uniform()
    low = 0.0
    if any(show.zero for show in shows) or shape < 0.4:
        low = -largest
    elif shape < 0.55:
        low = -0.2 * largest
    gain = log_uniform(random, 0.05e-6, 0.12e-6 if fine else 0.3e-6)
    span = largest - low
    width = random.uniform(1.5, 6.0) / span
    gamma = width * random.uniform(-0.35, 0.35)
    loop = 0.5 * random.uniform(0.03, 0.15) * gain * span
    bent = random.uniform() < 0.4
    base = Base(
        gain=gain, alpha=loop * width, beta=width - gamma, gamma=gamma,
        exponent=random.uniform(1.05, 1.5) if bent else 1.0, pivot=loop,
        omega=2.0 * np.pi * natural, zeta=log_uniform(random, 0.01, 0.2),
        offset=random.uniform(-0.2, 0.2) * gain * span, static=static,
    )  # fmt: skip
    scale = Scale(low, largest, gain, base.omega, base.zeta, samples / rate, loop, static)
    held = not static and not any(show.linear for show in shows) and bool(random.uniform() < 0.3)
    return _Plant(
        base, scale, tuple(show.build(random, scale, base) for show in shows), rate, held,
        colour=random.uniform(0.3, 0.9) if random.uniform() < 0.35 else 0.0,
        resolution=random.uniform(0.5, 2.0) if random.uniform() < 0.3 else 0.0,
    )  # fmt: skip


def _take(
    random: np.random.Generator, plant: _Plant, shows: Sequence[Shows], samples: int, seed: int
) -> _Take:
    """Draw a drive, a start and a temperature for one record."""
    kinds = [kind for kind in ALL if all(kind in show.kinds for show in shows)]
    kind = kinds[int(random.integers(len(kinds)))]
    cut = bool(random.uniform() < 0.25)
    before = int(random.uniform(0.1, 0.4) * samples) if cut else 0
    scale = plant.scale
    fastest = (
        plant.rate / log_uniform(random, 40.0, 200.0) if scale.static
        else min(1.2 * scale.omega / (2.0 * np.pi), plant.rate / 5.0)
    )  # fmt: skip
    bits = int(random.choice([12, 14, 16])) if random.uniform() < 0.4 else None
    drive = make_drive(
        random, kind, samples=samples, before=before, rate=plant.rate, fastest=fastest,
        low=scale.low, high=scale.high, held=plant.held, bits=bits,
    )  # fmt: skip
    natural = scale.omega / (2.0 * np.pi)
    substeps = 1 if scale.static else int(np.clip(np.ceil(40.0 * natural / plant.rate), 2, 7))
    grid = Grid(samples + before, before, plant.rate, substeps)
    remanent = bool(random.uniform() < 0.4)
    loop = random.uniform(-0.6, 0.6) * scale.loop if remanent else 0.0
    base = replace(plant.base, start_loop=loop)
    needed = any(show.warm for show in shows)
    warmth = _warmth(random, samples + before, before)
    shown = needed or (scale.static and bool(random.uniform() < 0.15))
    channel = _REFERENCE + warmth[before:] if shown else None
    warmer = np.interp(np.arange(grid.count + 1) / substeps, np.arange(warmth.size), warmth)
    ends = grid.ends(drive.values, drive.held)
    return _Take(drive, Scene(grid, base, ends, warmer, seed), remanent, channel)


def _warmth(random: np.random.Generator, samples: int, before: int) -> Array:
    """Temperature over the reference [K]: an exponential ambient, and a slow random walk."""
    share = (np.arange(samples) - before) / (samples - before)
    ambient = random.uniform(1.5, 4.0) * (1.0 if random.uniform() < 0.5 else -1.0)
    tau = log_uniform(random, 0.2, 2.0)
    walk = np.cumsum(random.standard_normal(samples)) / np.sqrt(samples)
    width = max(samples // 25, 3)
    smooth = np.convolve(np.pad(walk, width, mode="edge"), np.ones(width) / width, "same")
    value: Array = (
        random.uniform(-4.0, 4.0) + ambient * -np.expm1(-share / tau)
        + 0.3 * smooth[width:-width]
    )  # fmt: skip
    return value


def _start(trace: Trace, base: Base) -> Base:
    """The base plant as the record finds it."""
    return replace(
        base, start_loop=trace.loop, start_position=trace.position,
        start_velocity=trace.velocity,
    )  # fmt: skip


def _size(
    random: np.random.Generator, plant: _Plant, take: _Take, shows: Sequence[Shows],
    sizes: tuple[float, float],
) -> _Sized | None:  # fmt: skip
    """Intensities and noise at the drawn sizes, or None where they are not plausible."""
    fine = any(show.fine for show in shows)
    ratios = [log_uniform(random, *sizes) for _ in plant.effects]
    quiet, loud = _FINE_NOISE if fine else _USUAL_NOISE
    # Large against the noise is not large against the stroke: no effect is worth more than this.
    usual = log_uniform(random, quiet, max(min(loud, _WORTH / max(ratios, default=1.0)), quiet))
    plain = simulate(take.scene.base, (), take.scene)
    stroke = float(np.ptp(plain.reading))
    if not plant.effects:
        return _Sized((), usual * stroke, 0.0, (), ())
    base = _start(plain, take.scene.base)
    seen = tangent(base, base.vector(), take.drive)
    noise = usual * stroke
    found, rests = [], []
    for effect, ratio in zip(plant.effects, ratios, strict=True):
        low, high = type(effect).plausible
        most = log_uniform(random, max(low, 0.25 * high), high)
        one, rest = _intensity(effect, most, take, plain, seen, ratio * noise)
        found.append(one)
        rests.append(rest)
    effects = tuple(found)
    if min(rest.size for rest in rests) == 0:
        return None
    alone = [_unexplained(base, take, seen, (effect,)) for effect in effects]
    unexplained = alone[0]
    if len(effects) == 1:
        noise = unexplained / ratios[0]
    else:
        # Effects that share a sensor: every one of them must be within the sizes.
        least, most = max(alone) / sizes[1], min(alone) / sizes[0]
        if least > most:
            return None
        noise = float(np.clip(noise, least, most))
    if not 0.25 * quiet * stroke <= noise <= 2.0 * loud * stroke:
        return None
    if len(effects) > 1:
        unexplained = _unexplained(base, take, seen, effects)
    distinct = tuple(
        one * (1.0 - (_rms(_projected(rest, rests[:i] + rests[i + 1 :])) / _rms(rest)) ** 2) ** 0.5
        for i, (one, rest) in enumerate(zip(alone, rests, strict=True))
    )
    distinct = tuple(one / noise for one in distinct)
    return _Sized(effects, noise, unexplained, tuple(a / noise for a in alone), distinct)


def _unexplained(base: Base, take: _Take, seen: Tangent, effects: Sequence[Hidden]) -> float:
    """What the best refit of the base plant leaves of these effects [m rms]."""
    reading = simulate(take.scene.base, effects, take.scene).reading
    return _rms(refit(base, take.drive, reading, seen))


def _intensity(
    effect: Hidden, most: float, take: _Take, plain: Trace, seen: Tangent, wanted: float
) -> tuple[Hidden, Array]:
    """The effect at the intensity where the base plant leaves ``wanted`` [m rms] of it.

    A secant on logarithms, up to ``most``; the nearest trial where no intensity will do.
    """
    low, high = type(effect).plausible[0], most
    at, order = float(np.sqrt(low * high)), 1.0
    tried: list[tuple[float, float]] = []
    nearest, distance = (effect.at(at), np.zeros(0)), np.inf
    for _ in range(5):
        one = effect.at(at)
        reading = simulate(take.scene.base, (one,), take.scene).reading
        rest = seen.unexplained(reading - plain.reading)
        rms = _rms(rest)
        if not np.isfinite(rms) or rms == 0.0:
            break
        off = abs(float(np.log(rms / wanted)))
        if off < distance:
            nearest, distance = (one, rest), off
        if off < 0.15 or (tried and rms < tried[-1][1] < wanted and at > tried[-1][0]):
            break
        if tried:
            slope = np.log(rms / tried[-1][1]) / np.log(at / tried[-1][0])
            order = float(np.clip(slope, 0.5, 4.0)) if slope > 0.0 else 1.0
        tried.append((at, rms))
        after = float(np.clip(at * (wanted / rms) ** (1.0 / order), low, high))
        if after == at:
            break
        at = after
    return nearest


def _converged(take: _Take, sized: _Sized, names: tuple[str, ...]) -> tuple[_Take, Trace]:
    """A record at sub-steps that no longer matter beside its noise, and its clean reading.

    What is outside the catalogue happens at the plant's own nodes, and is left as it was sized.
    """
    trace = simulate(take.scene.base, sized.effects, take.scene)
    for _ in range(0 if set(names) & set(BEYOND) else _HALVINGS):
        scene = take.scene.finer(take.drive.values, held=take.drive.held)
        coarse, trace = trace, simulate(scene.base, sized.effects, scene)
        take = replace(take, scene=scene)
        if _rms(trace.reading - coarse.reading) < _CONVERGED * sized.noise:
            break
    return take, trace


def _resized(take: _Take, trace: Trace, sized: _Sized) -> _Sized:
    """The size of one effect on the record as it is taken: its noise is what keeps the ratio."""
    if len(sized.effects) != 1:
        return sized
    plain = simulate(take.scene.base, (), take.scene)
    base = _start(plain, take.scene.base)
    seen = tangent(base, base.vector(), take.drive)
    unexplained = _rms(refit(base, take.drive, trace.reading, seen))
    return replace(
        sized, unexplained=unexplained, noise=sized.noise * unexplained / sized.unexplained
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values * values)))


def _projected(values: Array, onto: Sequence[Array]) -> Array:
    """The part of ``values`` in the span of others."""
    if not onto:
        return np.zeros_like(values)
    basis = np.stack(onto, axis=1)
    factors = np.linalg.lstsq(basis, values, rcond=None)[0]
    part: Array = basis @ factors
    return part


def _record(
    random: np.random.Generator, plant: _Plant, take: _Take, trace: Trace, sized: _Sized,
    names: tuple[str, ...], seed: int,
) -> HiddenRecord:  # fmt: skip
    """Add noise to a clean record, and write down the truth."""
    noise = Noise(sized.noise, plant.colour, plant.resolution)
    position = read(random, trace.reading, noise)
    drive = take.drive
    temperature = take.temperature
    if temperature is not None:
        temperature = temperature + 2e-3 * random.standard_normal(temperature.size)
    actual = _rms(position - trace.reading)
    meta = Facts(
        kind=drive.kind, bits=drive.bits, rate=drive.rate, static=plant.scale.static,
        cut=drive.first > 0, remanent=take.remanent, colour=plant.colour,
        resolution=plant.resolution, stroke=float(np.ptp(trace.reading)),
        unexplained=sized.unexplained, ratio=sized.unexplained / sized.noise,
        sizes=sized.sizes, distinct=sized.distinct,
        intensities=tuple(effect.intensity for effect in sized.effects),
        forms=tuple(effect.form for effect in sized.effects),
        base=_start(trace, take.scene.base),
    )  # fmt: skip
    return HiddenRecord(
        time=np.arange(trace.reading.size) / drive.rate, drive=drive.values[drive.first :],
        position=position, clean=trace.reading, noise_rms=actual, temperature=temperature,
        effects=names, held=drive.held, seed=seed, meta=meta,
    )  # fmt: skip
