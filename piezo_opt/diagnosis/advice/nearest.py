"""The nearest signal that an effect can make, of any size, shape and start."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
import scipy
from numpy.typing import NDArray

from piezo_opt.diagnosis.advice.gate import allowed
from piezo_opt.diagnosis.base_point import Direction
from piezo_opt.effects.base import Effect

FloatArray = NDArray[np.float64]


@final
@dataclass(frozen=True, eq=False)
class Able:
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


def complement(columns: Sequence[FloatArray]) -> Callable[[FloatArray], FloatArray]:
    """The projection of (M,) onto what these columns cannot do."""
    if not columns:
        return lambda column: column
    long = [c / np.linalg.norm(c) for c in columns if np.any(c)]
    u, strength, _ = np.linalg.svd(np.column_stack(long), full_matrices=False)
    basis = u[:, strength > 1e-6]
    return lambda column: np.asarray(column - basis @ (basis.T @ column))


def distance_to(
    target: FloatArray,
    effect: Effect,
    able: Sequence[Able],
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
            if allowed(effect, way):
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
    factors, _ = scipy.optimize.nnls(root, reached)
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
