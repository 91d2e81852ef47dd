"""The feature to follow, where nobody names one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.measurement import FloatArray
from piezo_opt.video.box import MARGIN, SMALLEST, Box
from piezo_opt.video.frames import Frame, library
from piezo_opt.video.judging import Judged, judged
from piezo_opt.video.learning import cut
from piezo_opt.video.sighting import Area, sightings

_SIDES: Final = (24, 48)
"""Smallest and largest side of a box [px]; a sixth of the picture lies between."""
_BOXES: Final = 8
"""Boxes that are tried."""
_FOLLOWED: Final = 0.8
"""Share of the frames in which a box must be found."""
_AS_FAR: Final = 0.8
"""Share of the farthest motion that a box must show to be on what moves, and not half on it."""


def chosen(frames: Sequence[Frame], reach: float | None) -> tuple[Box, str]:
    """The box that is followed best among those that move farthest, and a sentence about it.

    Boxes are tried where the picture changes with time, and where its corners are strong (the
    smaller eigenvalue of the structure tensor, on which the weaker direction's sigma depends). Of
    those found in nearly all frames, the one with the least left unexplained is taken among those
    that move nearly as far as any: a box half on what stands still changes its look.

    Args:
        frames: a few, spread over the video; the box is in the first.
        reach: how far from its box the feature may be [px].

    Raises:
        InputError: no box of the first frame is found again.

    Source: Shi & Tomasi (1994), CVPR 593-600.
    """
    first = frames[0].image
    side = int(np.clip(min(first.shape) // 6, *_SIDES))
    tried: list[tuple[Box, Judged, float]] = []
    for box in _worth_trying(frames, side):
        try:
            pattern = cut(first, box)
        except InputError:
            continue
        seen = [sightings(one.image, pattern, Area(box, reach)) for one in frames]
        found = judged(seen, pattern)
        valid = [why is None for why in found.lost]
        if np.mean(valid) >= _FOLLOWED:
            left = [s[0].registered.unexplained for s, ok in zip(seen, valid, strict=True) if ok]
            tried.append((box, found, float(np.mean(left))))
    if not tried:
        raise InputError(
            "no feature was found that can be followed: name one with box='x,y,width,height', on a "
            "pattern or a corner that moves and that occurs once"
        )
    ranges = [_range(found) for _, found, _ in tried]
    sigmas = [float(np.sqrt(np.nanmedian(found.covariance[:, 0, 0]))) for _, found, _ in tried]
    farthest = max(ranges)
    at = min(
        (k for k in range(len(tried)) if ranges[k] >= _AS_FAR * farthest),
        key=lambda k: tried[k][2],
    )
    box = tried[at][0]
    said = f"The feature was chosen: box {box}, which moves by {ranges[at]:.3g} pixels."
    if ranges[at] < 5.0 * sigmas[at]:
        said = f"Nothing moves in the picture; the feature was chosen for its look: box {box}."
    return box, said


def _range(found: Judged) -> float:
    places = found.place[np.isfinite(found.place[:, 0])]
    return float(np.linalg.norm(np.ptp(places, axis=0)))


def _worth_trying(frames: Sequence[Frame], side: int) -> list[Box]:
    """Boxes with strong corners that change with time, then such anywhere."""
    feature = library("skimage.feature")
    first = frames[0].image
    if min(first.shape) < side + 2 * MARGIN + 2 or side < SMALLEST:
        raise InputError(
            f"frames of {first.shape[1]} x {first.shape[0]} pixels are too small to choose a "
            "feature in: name one with box='x,y,width,height'"
        )
    tensor = feature.structure_tensor(first, sigma=1.0, order="rc")
    rows, columns = (_summed(part, side) for part in (tensor[0], tensor[2]))
    mixed = _summed(tensor[1], side)
    weaker = 0.5 * (rows + columns) - np.hypot(0.5 * (rows - columns), mixed)
    stack = np.stack([one.image - one.image.mean() for one in frames])
    changing = np.sqrt(_summed(stack.var(axis=0), side))
    boxes: list[Box] = []
    for score, count in ((weaker * changing, _BOXES - 3), (weaker, 3)):
        inside = score[MARGIN : score.shape[0] - MARGIN, MARGIN : score.shape[1] - MARGIN]
        peaks = feature.peak_local_max(
            inside, min_distance=max(3, side // 3), num_peaks=count, exclude_border=False
        )
        boxes += [Box(int(c) + MARGIN, int(r) + MARGIN, side, side) for r, c in peaks.tolist()]
    return list(dict.fromkeys(boxes))


def _summed(values: FloatArray, side: int) -> FloatArray:
    """Sums over every square of that side; the entry is its top left corner."""
    total = np.pad(values, ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1)
    return np.asarray(
        total[side:, side:] - total[:-side, side:] - total[side:, :-side] + total[:-side, :-side]
    )
