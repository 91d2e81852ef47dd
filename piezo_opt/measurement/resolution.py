"""The step in which a reading comes: the grid that its quantisation left."""

from __future__ import annotations

import numpy as np

from piezo_opt.measurement.arrays import FloatArray

_FINEST_GRID = 2000.0
"""Range over step beyond which noise hides the steps."""


def resolution(drive: FloatArray, reading: FloatArray) -> float | None:
    """Step of a reading (N,) in its unit; None when none is found, or when it was computed.

    The widest grid that holds at least 70 % of the samples, on five levels or more.
    """
    correlation = np.corrcoef(drive, reading)[0, 1] if np.ptp(reading) else 1.0
    if abs(correlation) > 1.0 - 1e-11:
        return None  # computed, not read: the levels are the drive's
    return _grid_step(reading)


def _grid_step(values: FloatArray) -> float | None:
    """The widest step q so that values = offset + integer q for at least 70 % of the samples."""
    spread = float(np.ptp(values))
    if spread == 0.0:
        return None
    ordered, weights = np.unique(values, return_counts=True)
    # Printing and unit conversion leave specks far below any real step.
    starts = np.flatnonzero(np.concatenate([[True], np.diff(ordered) > 1e-6 * spread]))
    levels: FloatArray = ordered[starts] - ordered[0]
    counts: FloatArray = np.add.reduceat(weights, starts).astype(np.float64)
    # A smooth reading has a level of its own for nearly every sample.
    smooth = values.size >= 200 and levels.size > 0.5 * values.size
    if levels.size < 5 or smooth:
        return None
    for candidate in _candidate_steps(levels):
        if spread / candidate > _FINEST_GRID:
            break
        step, offset = _tuned_grid(levels, counts, candidate)
        index = np.round((levels - offset) / step)
        on_grid = np.abs(levels - offset - index * step) <= 0.06 * step
        occupied = np.unique(index[on_grid]).size
        # Two levels in one cell are no grid: the step is too wide.
        crowded = np.count_nonzero(on_grid) > 1.2 * occupied
        if occupied >= 5 and not crowded and counts[on_grid].sum() >= 0.7 * values.size:
            return step
    return None


def _candidate_steps(levels: FloatArray) -> FloatArray:
    """The differences of neighbouring levels that occur most, to about 2 %, widest first."""
    differences = np.diff(levels)
    bins = np.round(np.log(differences) / 0.02)
    _, inverse, counts = np.unique(bins, return_inverse=True, return_counts=True)
    centres = np.bincount(inverse, weights=differences) / counts
    frequent = np.argsort(counts, kind="stable")[::-1][:16]
    return np.asarray(np.sort(centres[frequent])[::-1], dtype=np.float64)


def _tuned_grid(levels: FloatArray, counts: FloatArray, near: float) -> tuple[float, float]:
    """Step and offset of the grid within 3 % of ``near`` that most samples lie on.

    Each trial grid goes through one of the most frequent levels. A sample counts by how close to
    the grid it lies and not at all beyond 6 % of a cell, so that the samples that lie on no grid
    have no say. From one trial to the next the last level moves by a twentieth of a cell; least
    squares removes what is left.
    """
    some = np.unique(np.linspace(0, levels.size - 1, 400).astype(np.int64))
    trials = near * np.linspace(0.97, 1.03, 3 + int(1.2 * levels[-1] / near))
    best, step, offset = -1.0, near, 0.0
    for anchor in levels[np.argsort(-counts, kind="stable")[:5]]:
        cells = (levels[some] - anchor) / trials[:, np.newaxis]
        closeness = np.maximum(0.0, 1.0 - ((cells - np.round(cells)) / 0.06) ** 2)
        agreement = closeness @ counts[some]
        winner = int(np.argmax(agreement))
        if agreement[winner] > best:
            best, step, offset = float(agreement[winner]), float(trials[winner]), float(anchor)
    index = np.round((levels - offset) / step)
    used = np.abs(levels - offset - index * step) <= 0.06 * step
    if np.unique(index[used]).size >= 2:
        slope, intercept = np.polyfit(index[used], levels[used], 1, w=np.sqrt(counts[used]))
        return float(slope), float(intercept)
    return step, offset
