"""Drives of the bench: staircases, triangles with minor loops, multisines, chirps, and mixtures.

Every drive is made on the unit interval [0, 1] or [-1, 1] and then given its volts, so that a
class of drives is a shape and nothing else. Rates are limited as an amplifier's current limits
them: the faster a component, the smaller it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, TypeAlias, final

import numpy as np

from piezo_opt.benchmark.plants.physics import Array

Kind: TypeAlias = Literal["steps", "triangles", "multisine", "chirp", "combined"]


@final
@dataclass(frozen=True)
class Drive:
    """A sampled drive.

    Attributes:
        values: samples [V], those before the start of the record included.
        first: index of the sample at which the record starts.
        rate: samples per second.
        held: held between samples; otherwise linear in between.
        kind: its class.
        bits: resolution of the converter, or None; the values are the resolved ones.
    """

    values: Array
    first: int
    rate: float
    held: bool
    kind: Kind
    bits: int | None


def make_drive(
    random: np.random.Generator, kind: Kind, *, samples: int, before: int, rate: float,
    fastest: float, low: float, high: float, held: bool, bits: int | None,
) -> Drive:  # fmt: skip
    """A drive between ``low`` and ``high`` [V] that starts at rest unless it is cut.

    Args:
        samples, before: samples of the record, and those cut off before it.
        fastest: highest frequency worth exciting [Hz].
    """
    total = samples + before
    shape = _shape(random, kind, total, rate, fastest)
    if before == 0:
        # From rest at the middle (bipolar) or at the bottom (unipolar), in a short glide.
        glide = max(total // 50, 2)
        start = 0.0 if low >= 0.0 else (0.0 - low) / (high - low)
        ramp = np.sin(0.5 * np.pi * np.linspace(0.0, 1.0, glide)) ** 2
        shape[:glide] = start + ramp * (shape[:glide] - start)
    values = low + (high - low) * shape
    if bits is not None:
        grain = (high - low) / 2.0**bits
        values = np.round(values / grain) * grain
    return Drive(values, before, rate, held, kind, bits)


def _shape(
    random: np.random.Generator, kind: Kind, total: int, rate: float, fastest: float
) -> Array:
    """Samples within [0, 1]."""
    match kind:
        case "steps":
            return _steps(random, total, rate, fastest)
        case "triangles":
            return _triangles(random, total)
        case "multisine":
            return _multisine(random, total, rate, fastest)
        case "chirp":
            return _chirp(random, total, rate, fastest)
        case "combined":
            return _combined(random, total, rate, fastest)


def _steps(random: np.random.Generator, total: int, rate: float, fastest: float) -> Array:
    """Staircase of random levels and holding times; edges over one sample or a few."""
    shape = np.empty(total)
    at, level = 0, 0.5
    shortest = min(max(6.0 * rate / fastest, total / 120), total / 12)
    while at < total:
        length = int(shortest * np.exp(random.uniform(0.0, np.log(total / 6 / shortest))))
        other = random.uniform()
        while abs(other - level) < 0.15:
            other = random.uniform()
        level = other
        shape[at : at + length] = level
        at += length
    edge = int(random.integers(1, 4))
    ramp: Array = np.convolve(shape, np.ones(edge) / edge, mode="full")[:total]
    ramp[: edge - 1] = shape[: edge - 1]
    return ramp


def _triangles(random: np.random.Generator, total: int) -> Array:
    """Triangles with minor loops: random turning points, every third swing a full one."""
    swings = int(random.integers(9, 22))
    turns = [0.5]
    for i in range(swings):
        up = i % 2 == 0
        if i % 3 == 0:
            turns.append(random.uniform(0.85, 1.0) if up else random.uniform(0.0, 0.15))
        else:
            last = turns[-1]
            turns.append(random.uniform(min(last + 0.1, 0.95), 1.0) if up
                         else random.uniform(0.0, max(last - 0.1, 0.05)))  # fmt: skip
    points = np.array(turns)
    length = np.abs(np.diff(points)) ** random.uniform(0.4, 1.0) * random.uniform(0.6, 1.6, swings)
    clock = np.concatenate(([0.0], np.cumsum(length)))
    shape: Array = np.interp(np.linspace(0.0, clock[-1], total), clock, points)
    return shape


def _multisine(random: np.random.Generator, total: int, rate: float, fastest: float) -> Array:
    """Random phases on a comb, amplitude falling with frequency; whole periods are repeated."""
    periods = int(random.integers(1, 4))
    length = -(-total // periods)
    time = np.arange(total) / rate
    spacing = rate / length
    count = max(int(fastest / spacing), 4)
    lines = np.unique(np.geomspace(1, count, 60).astype(int))
    corner = fastest / random.uniform(8.0, 20.0)
    value = np.zeros(total)
    for line in lines.tolist():
        frequency = line * spacing
        amplitude = 1.0 / (1.0 + frequency / corner)
        value += amplitude * np.sin(
            2.0 * np.pi * frequency * time + random.uniform(0.0, 2.0 * np.pi)
        )
    unit: Array = 0.5 + 0.5 * value / float(np.max(np.abs(value)))
    return unit


def _chirp(random: np.random.Generator, total: int, rate: float, fastest: float) -> Array:
    """Logarithmic chirp, upwards or downwards, smaller where it is faster."""
    share = np.arange(total) / total
    lowest = 3.0 * rate / total
    ratio = fastest / lowest
    frequency = lowest * ratio**share
    phase = 2.0 * np.pi * lowest * (total / rate) * (ratio**share - 1.0) / np.log(ratio)
    amplitude = 1.0 / (1.0 + frequency / (fastest / random.uniform(4.0, 12.0)))
    value = amplitude / amplitude[0] * np.sin(phase)
    if random.uniform() < 0.5:
        value = value[::-1].copy()
    unit: Array = np.clip(0.5 + 0.5 * value, 0.0, 1.0)
    return unit


def _combined(random: np.random.Generator, total: int, rate: float, fastest: float) -> Array:
    """Triangles, a staircase and something fast, one after another in random order."""
    lengths = np.diff(np.concatenate(([0], np.sort(
        (total * (np.array([1.0, 2.0]) / 3.0 + random.uniform(-0.08, 0.08, 2))).astype(int)
    ), [total])))  # fmt: skip
    fast: Kind = "multisine" if random.uniform() < 0.5 else "chirp"
    order: list[Kind] = ["triangles", "steps", fast]
    random.shuffle(order)
    pieces = [
        _shape(random, kind, int(length), rate, fastest)
        for kind, length in zip(order, lengths, strict=True)
    ]
    for before, after in pairwise(pieces):
        glide = max(after.size // 30, 2)
        ramp = np.linspace(0.0, 1.0, glide)
        after[:glide] = before[-1] + ramp * (after[:glide] - before[-1])
    return np.concatenate(pieces)
