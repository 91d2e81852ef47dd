"""Where to look for the shape parameters of an effect: a small grid scaled by the record.

A gate at its null hides its shapes, so they cannot be found by following a gradient from there;
they are tried out. Which values make sense follows from the unit and the record: a time between
the sampling step and the duration, a voltage within the drive's range, a frequency where the
residual has a peak.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from itertools import product

import numpy as np
import scipy
from numpy.typing import NDArray

from piezo_opt.effects.base import Effect, Parameter, Place
from piezo_opt.identification.periodic import period
from piezo_opt.identification.problem import Identification
from piezo_opt.identification.unknowns import limits
from piezo_opt.measurement import Measurement
from piezo_opt.measurement.spectra import density, frequencies

FloatArray = NDArray[np.float64]

_MOST = 24
"""Grid points an effect may have."""
_STABLE = 2.0
"""Displacements of a contact that the motion may go within one sub-step."""


def shape_grid(
    effect: Effect,
    record: Measurement,
    residual: FloatArray,
    settled: Collection[str] = (),
) -> list[dict[str, float]]:
    """Trial values of an effect's shapes, by own parameter name; the nominal ones first.

    Args:
        effect: the effect; its gate and fixed parameters are left alone.
        record: what the grid is scaled by.
        residual: (N,) measured minus modelled [m]; its peaks are candidates for frequencies.
        settled: own parameters that the user has given.
    """
    axes: dict[str, list[float]] = {}
    for name, parameter in effect.parameters.items():
        if name == effect.gate or parameter.fixed or name in settled:
            continue
        values = _values(parameter, record, residual)
        low, high = limits(parameter, (record,))
        inside = [v for v in values if low <= v <= high]
        axes[name] = inside or [float(np.clip(parameter.nominal, low, high))]
    while np.prod([len(v) for v in axes.values()]) > _MOST:
        longest = max(axes, key=lambda n: (len(axes[n]), n))
        axes[longest] = axes[longest][::2]
    return [dict(zip(axes, point, strict=True)) for point in product(*axes.values())]


def _values(parameter: Parameter, record: Measurement, residual: FloatArray) -> list[float]:
    stroke = float(np.ptp(record.position)) or 1.0
    top = float(np.abs(record.drive).max()) or 1.0
    swing = float(np.ptp(record.drive)) or 1.0
    unit = parameter.unit
    if parameter.repeats:
        length = period(record.position - residual, residual)
        return [] if length is None else [2.0 * length]
    if unit == "s":
        return _numbers(np.geomspace(0.3 * record.step, 0.3 * record.duration, 7))
    if unit == "V":
        return [0.02 * top, 0.1 * top, 0.3 * top, 0.6 * top, 0.8 * top, 0.92 * top]
    if unit == "V/s":
        speed = np.abs(np.diff(record.drive) / np.diff(record.time))
        usual = np.quantile(speed[speed > 0], [0.5, 0.9])
        # A limit that acts on a few steps only lies far above the usual speed.
        rare = speed.max() * np.array([0.05, 0.15, 0.4, 0.8])
        return _numbers(np.unique(np.concatenate([usual, rare])))
    if unit == "m/s":
        pace = float(np.sqrt(np.mean(np.gradient(record.position, record.time) ** 2)))
        return _numbers(pace * np.geomspace(0.01, 1.0, 5))
    if unit == "m":
        return _numbers(stroke * np.geomspace(0.004, 0.3, 7))
    if unit == "1/m":
        return _numbers(np.geomspace(0.5, 100.0, 6) / stroke)
    if unit == "m/V":
        return _numbers(_gain(record) * np.array([0.1, 0.4, 2.0]))
    if unit == "V/m":
        return _numbers(np.array([0.1, 0.4]) / (_gain(record) or 1.0))
    if unit == "1/V":
        return _numbers(np.geomspace(0.3, 30.0, 4) / swing)
    if unit == "rad/s":
        return resonances(record, residual, broad=True)
    if unit == "rad":
        return [0.0, 0.25 * np.pi, 0.5 * np.pi, 0.75 * np.pi]
    return [parameter.nominal]


def resolving(effect: Effect, shapes: Mapping[str, float]) -> tuple[float, float]:
    """Longest sub-step [s], and longest way of the motion within one [m], for an effect's shapes.

    Both are infinite where nothing asks for them. One time constant a sub-step is accurate enough
    to look at an effect; of few lengths, so that shapes can share theirs. What gives way to the
    motion within a displacement moves as fast as the motion runs through that; an explicit scheme
    of order four is stable up to 2.7 times it.

    Args:
        effect: the effect.
        shapes: own shape values.
    """
    times, ways = [np.inf], [np.inf]
    for name, value in shapes.items():
        unit = effect.parameters[name].unit
        if value <= 0:
            continue
        if unit in ("s", "rad/s"):
            times.append(value if unit == "s" else 1.0 / value)
        elif unit in ("m", "1/m") and effect.place is Place.MOTION:
            ways.append(value if unit == "m" else 1.0 / value)
    shortest = min(times)
    longest = float(2.0 ** np.floor(np.log2(shortest))) if shortest < np.inf else np.inf
    return longest, _STABLE * min(ways)


def detail_start(parameter: Parameter, record: Measurement) -> float:
    """Where the fit of a detail begins: near its fixed value, on a scale set by the record.

    Zero is no start for a detail that has no derivative there, and a warm-up time of centuries
    none for one that a record could show.
    """
    stroke = float(np.ptp(record.position)) or 1.0
    swing = float(np.ptp(record.drive)) or 1.0
    low, high = limits(parameter, (record,))
    if parameter.per_record and parameter.unit == "V":
        value = float(record.drive[0])  # where a record begins
    elif parameter.unit == "s" and parameter.nominal > record.duration:
        value = 0.5 * record.duration
    elif parameter.unit == "m/s":
        value = float(np.sqrt(np.mean(np.gradient(record.position, record.time) ** 2)))
    elif parameter.nominal != 0.0 or parameter.unit == "1":
        least, most = parameter.typical or (0.0, 2.0 * parameter.nominal)
        away = 0.05 * (most - least) if parameter.unit == "1" else 0.0
        value = parameter.nominal + (away if parameter.nominal + away < high else -away)
    else:
        sizes = {
            "s": 0.01 * record.step, "V": 0.01 * swing, "m": 0.01 * stroke, "1/V": 0.05 / swing,
            "1/m": 0.05 / stroke, "1/K": 1e-3, "1/V^2": 0.05 / swing**2, "1/m^2": 0.05 / stroke**2,
            "m/V^2": 0.05 * stroke / swing**2, "m/V^3": 0.05 * stroke / swing**3,
        }  # fmt: skip
        value = sizes.get(parameter.unit, 0.0)
    return float(np.clip(value, low, high))


def elsewhere(question: Identification) -> list[dict[str, float]]:
    """Where a fit begins as well, because its error has several minima along details that are free.

    What each record has of its own, where it was reached from, begins anew with them.
    """
    found = []
    record = question.campaign.records[0]
    for name, effect in question.model:
        own = {
            f"{name}.{k}": detail_start(p, record)
            for k, p in effect.parameters.items() if p.detail and p.per_record
        }  # fmt: skip
        for details in effect.elsewhere:
            moved = {f"{name}.{k}": v for k, v in details.items()}
            if moved.keys() <= {*question.free}:
                found.append(own | moved)
    return found


def resonances(record: Measurement, residual: FloatArray, *, broad: bool = False) -> list[float]:
    """Candidates for a natural frequency [rad/s], likeliest first.

    Peaks of the response (cross spectrum over drive spectrum) and of what a model leaves over
    (ringing after steps), completed by a coarse logarithmic grid.

    Args:
        record: the record.
        residual: (N,) measured minus modelled [m].
        broad: whether also the residual's broadest rise over its surroundings is one. Noise is
            highest where nothing rings, and a loop's harmonics are as narrow as tones.
    """
    step = record.step if record.uniform else record.duration / (len(record) - 1)
    found: list[float] = []
    f, response = record.response
    if f.size:
        found += _peaks(f, response, 2)
        rate, v = 1.0 / step, record.evenly(residual)
        length = min(len(record) - 1, max(64, len(record) // 4))
        f2, left = frequencies(length, rate), density(np.diff(v), rate=rate, length=length)
        found += _peaks(f2, left, 2)
        if broad:
            # The median of a few lines passes over what is as narrow as a tone.
            rise = scipy.ndimage.median_filter(left, 5, mode="nearest")
            around = scipy.ndimage.median_filter(left, max(9, left.size // 16), mode="nearest")
            found += _peaks(f2, rise / np.maximum(around, 1e-12 * (left.max() or 1.0)), 1)
    top = 0.8 * np.pi / step
    bottom = 2.0 * np.pi * 3.0 / record.duration
    if bottom < top:
        found += np.geomspace(bottom, top, 5)[1:].tolist()
    kept: list[float] = []
    for omega in found:
        apart = all(abs(np.log(omega / other)) > 0.03 for other in kept)
        if bottom < omega < 0.9 * np.pi / step and apart:
            kept.append(float(omega))
    return kept


def _gain(record: Measurement) -> float:
    """Slope of the position over the drive [m/V]."""
    return float(np.polyfit(record.drive, record.position, 1)[0])


def _numbers(values: FloatArray) -> list[float]:
    return [float(v) for v in values]


def _peaks(f: FloatArray, height: FloatArray, count: int) -> list[float]:
    """The highest interior maxima, refined by a parabola, as rad/s."""
    inside = np.flatnonzero((height[1:-1] > height[:-2]) & (height[1:-1] >= height[2:])) + 1
    inside = inside[f[inside] > 0]
    order = inside[np.argsort(height[inside])[::-1][:count]]
    peaks = []
    for i in order:
        a, b, c = height[i - 1], height[i], height[i + 1]
        bend = a - 2 * b + c
        shift = 0.5 * (a - c) / bend if bend else 0.0
        peaks.append(2.0 * np.pi * float(f[i] + shift * (f[1] - f[0])))
    return peaks


def own(values: Mapping[str, float], effect: str) -> dict[str, float]:
    """The values of one effect by its own parameter names."""
    head = f"{effect}."
    return {k.removeprefix(head): v for k, v in values.items() if k.startswith(head)}
