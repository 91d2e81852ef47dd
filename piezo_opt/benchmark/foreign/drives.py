"""Drives as they are played in laboratories."""

from __future__ import annotations

from collections.abc import Callable
from types import MappingProxyType
from typing import Final

import numpy as np
from scipy.signal import butter, chirp, sosfiltfilt

from piezo_opt.benchmark.foreign.operators import Array


def draw_drive(
    random: np.random.Generator, kind: str, samples: int, cycles: float, fastest: float
) -> Array:
    """A drive between -1 and 1, with an event in it half of the time.

    Args:
        random: source of everything drawn.
        kind: name out of KINDS.
        samples: length.
        cycles: of the fastest content, in all samples.
        fastest: cycles a sample of the fastest content.
    """
    drive = _SHAPES[kind](random, samples, cycles)
    if random.uniform() < 0.5:
        drive = _event(random, drive, fastest)
    return np.clip(drive, -1.0, 1.0)


def _falling(random: np.random.Generator, samples: int, cycles: float) -> Array:
    """Triangles whose amplitude falls."""
    turns = int(np.clip(cycles / random.uniform(6.0, 20.0), 4, 40))
    heights = np.linspace(1.0, random.uniform(0.1, 0.4), turns + 1)
    heights *= np.where(np.arange(turns + 1) % 2, 1.0, -1.0)
    return np.interp(np.linspace(0.0, turns, samples), np.arange(turns + 1), heights)


def _stairs(random: np.random.Generator, samples: int, cycles: float) -> Array:  # noqa: ARG001
    """A staircase up and down, or steps of random height."""
    count = int(random.integers(8, 40))
    levels = (
        random.uniform(-1.0, 1.0, count) if random.uniform() < 0.5
        else np.abs(np.linspace(-2.0, 2.0, count)) - 1.0
    )  # fmt: skip
    return np.asarray(levels[np.minimum(np.arange(samples) * count // samples, count - 1)])


def _multisine(random: np.random.Generator, samples: int, cycles: float) -> Array:
    """Sines of random phase, whose amplitude falls with the frequency in some draws."""
    lines = np.unique(np.geomspace(1.0, max(cycles, 4.0), 24).astype(int))
    weights = lines ** -random.uniform(0.0, 1.0)
    phases = random.uniform(0.0, 2.0 * np.pi, lines.size)
    angle = 2.0 * np.pi * np.outer(np.arange(samples) / samples, lines)
    return _scaled(np.sin(angle + phases) @ weights)


def _chirp(random: np.random.Generator, samples: int, cycles: float) -> Array:
    """A chirp of constant amplitude, or of one that falls with the frequency."""
    time = np.arange(samples) / samples
    begin = random.uniform(0.5, 3.0)
    found = chirp(time, begin, 1.0, max(cycles, 2.0 * begin), method="logarithmic", phi=-90.0)
    return np.asarray(found * np.linspace(1.0, random.uniform(0.2, 1.0), samples))


def _random(random: np.random.Generator, samples: int, cycles: float) -> Array:
    """Band-limited noise over a slow swing."""
    edge = float(np.clip(2.0 * cycles / samples, 1e-3, 0.8))
    noise = sosfiltfilt(butter(4, edge, output="sos"), random.standard_normal(samples))
    swing = np.sin(2.0 * np.pi * random.uniform(0.5, 3.0) * np.arange(samples) / samples)
    return _scaled(_scaled(noise) + random.uniform(0.0, 1.5) * swing)


def _mix(random: np.random.Generator, samples: int, cycles: float) -> Array:
    """Pieces of the others with rests between them."""
    cuts = np.linspace(0, samples, int(random.integers(4, 8)) + 1).astype(int)
    pieces, shapes = [], (_falling, _multisine, _chirp, _random)
    last = 0.0
    for k, length in enumerate(np.diff(cuts)):
        if k % 2 and random.uniform() < 0.7:
            pieces.append(np.full(length, last))
            continue
        shape = shapes[int(random.integers(len(shapes)))]
        piece = random.uniform(0.4, 1.0) * shape(random, length, cycles * length / samples)
        pieces.append(piece)
        last = float(piece[-1])
    return np.concatenate(pieces)


def _event(random: np.random.Generator, drive: Array, fastest: float) -> Array:
    """A step or a burst at a random time, in a third of the draws in the last tenth."""
    count = drive.size
    at = int(count * (random.uniform(0.9, 0.97) if random.uniform() < 0.33 else random.uniform()))
    after = np.arange(count) - at
    height = random.uniform(0.2, 0.7) * (1.0 if random.uniform() < 0.5 else -1.0)
    length = random.uniform(0.02, 0.1) * count
    inside = (after >= 0) & (after < length)
    if random.uniform() < 0.5:
        return np.asarray(np.where(after >= 0, 0.6 * drive + 0.6 * height, drive))
    return np.asarray(drive + np.where(inside, height * np.sin(2.0 * np.pi * fastest * after), 0.0))


def _scaled(signal: Array) -> Array:
    return np.asarray(signal / np.max(np.abs(signal)))


_SHAPES: Final = MappingProxyType[str, Callable[[np.random.Generator, int, float], Array]](
    {
        "falling_triangles": _falling,
        "staircase": _stairs,
        "multisine": _multisine,
        "chirp": _chirp,
        "random": _random,
        "mix": _mix,
    }
)
KINDS: Final = tuple(_SHAPES)
"""Shapes of the drive."""
