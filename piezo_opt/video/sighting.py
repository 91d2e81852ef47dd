"""Places of a picture that look like the pattern."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, final

import numpy as np

from piezo_opt.measurement import FloatArray
from piezo_opt.video.box import Box
from piezo_opt.video.frames import library
from piezo_opt.video.pattern import Pattern, Registered

_CANDIDATES: Final = 4
"""Peaks of the correlation that are looked at: the best, and those that may be taken for it."""
_LEAST, _RIVAL = 0.1, 0.5
"""Correlation of a peak, and its share of the best one's, below which it is no rival: a rival must
leave about as little unexplained, so correlate nearly as well, whole pixels apart or not."""
_CENTRED: Final = 0.75
"""[px] A place farther off the middle of its window is seen again in a better one."""
_SAME: Final = 1.0
"""[px] Places nearer to one another are one."""


@final
@dataclass(frozen=True, eq=False)
class Sighting:
    """A place (2,) of the box's centre in a picture [px], and how it was registered."""

    place: FloatArray
    registered: Registered


@final
@dataclass(frozen=True)
class Area:
    """Where a feature may be: the whole picture, or so far [px] from its box."""

    box: Box
    reach: float | None = None

    def rows(self, height: int) -> tuple[int, int]:
        """First and last but one row that the box may reach."""
        return self._ends(self.box.y, self.box.height, height)

    def columns(self, width: int) -> tuple[int, int]:
        """The same of columns."""
        return self._ends(self.box.x, self.box.width, width)

    def _ends(self, at: int, size: int, limit: int) -> tuple[int, int]:
        if self.reach is None:
            return 0, limit
        far = int(np.ceil(self.reach)) + 1
        return max(0, at - far), min(limit, at + size + far)


def sightings(image: FloatArray, pattern: Pattern, area: Area) -> tuple[Sighting, ...]:
    """Places that look most like the pattern, the most alike first; none where nothing does.

    Peaks of the normalised cross-correlation, each refined to a fraction of a pixel.

    Source: Lewis (1995), Vision Interface 120-123.
    """
    feature = library("skimage.feature")
    top, bottom = area.rows(image.shape[0])
    left, right = area.columns(image.shape[1])
    looked = image[top:bottom, left:right]
    likeness = feature.match_template(looked, pattern.box)
    peaks = feature.peak_local_max(
        likeness, min_distance=2, threshold_abs=_LEAST, threshold_rel=_RIVAL,
        num_peaks=_CANDIDATES, exclude_border=False,
    )  # fmt: skip
    found: list[Sighting] = []
    for row, column in peaks.tolist():
        seen = _refined(image, pattern, row + top, column + left)
        if seen is not None and all(
            np.linalg.norm(seen.place - other.place) > _SAME for other in found
        ):
            found.append(seen)
    return tuple(sorted(found, key=lambda one: one.registered.unexplained))


def sighted(image: FloatArray, pattern: Pattern, near: FloatArray) -> Sighting | None:
    """The pattern within a pixel or two of a place (2,) [px]; None where it is not there."""
    height, width = pattern.shape
    column, row = np.rint(near - 0.5 * (np.array([width, height]) - 1.0)).astype(int).tolist()
    return _refined(image, pattern, row, column)


def _refined(image: FloatArray, pattern: Pattern, row: int, column: int) -> Sighting | None:
    height, width = pattern.shape
    for _ in range(3):
        if not (0 <= row <= image.shape[0] - height and 0 <= column <= image.shape[1] - width):
            return None
        found = pattern.register(image[row : row + height, column : column + width])
        if found is None:
            return None
        if np.abs(found.shift).max() <= _CENTRED:
            middle = np.array([column + 0.5 * (width - 1), row + 0.5 * (height - 1)])
            return Sighting(middle + found.shift, found)
        column, row = column + round(float(found.shift[0])), row + round(float(found.shift[1]))
    return None
