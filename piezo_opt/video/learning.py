"""The pattern, learnt from the first frames."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.interpolate import RectBivariateSpline
from scipy.ndimage import binary_dilation

from piezo_opt.errors import InputError
from piezo_opt.measurement import FloatArray
from piezo_opt.measurement.arrays import BoolArray
from piezo_opt.video.box import MARGIN, Box
from piezo_opt.video.frames import Frame
from piezo_opt.video.pattern import Pattern, cut_off
from piezo_opt.video.sighting import Area, Sighting, sightings

LEARNT: Final = 32
"""Frames that a pattern is learnt from: its own noise is then a sixth of a frame's."""
UNSURE: Final = 0.25
"""[px] Sigma beyond which a place is not reported: two of them are half a pixel."""
_AROUND: Final = 3
"""[px] Beyond the margin, for the spline that moves a frame."""


def cut(image: FloatArray, box: Box) -> Pattern:
    """The pattern as one picture shows it.

    Raises:
        InputError: the box is not within the picture, is flat, or shows a straight edge only.
    """
    box.check(*image.shape)
    rows = slice(box.y - MARGIN, box.y + box.height + MARGIN)
    pattern = Pattern(image[rows, box.x - MARGIN : box.x + box.width + MARGIN])
    strength = np.linalg.eigvalsh(pattern.information)
    levels = _noise(pattern.values)
    sigma = levels / np.sqrt(np.maximum(strength, 1e-300))
    if sigma[1] > UNSURE or np.ptp(pattern.box) < 1.0:
        raise InputError(
            f"box {box}: is flat, its place could be told to {_pixels(sigma[1])} at best: choose "
            "a box with a pattern, or leave it out to have one chosen"
        )
    if sigma[0] > UNSURE or strength[0] < 1e-3 * strength[1]:
        raise InputError(
            f"box {box}: shows a straight edge, along which its place could be told to "
            f"{_pixels(sigma[0])} at best: choose a box with a corner or a pattern"
        )
    return pattern


def learnt(frames: Sequence[Frame], box: Box, area: Area) -> Pattern:
    """The mean of what frames show of the feature, each moved onto the first.

    Args:
        frames: the first of a video; the box is in the first of these.
        box: of the feature.
        area: where it may be.

    Raises:
        InputError: the feature is not fit to be followed, or occurs twice.
    """
    first = cut(frames[0].image, box)
    seen = [(frame, sightings(frame.image, first, area)) for frame in frames]
    best = [(frame, places[0]) for frame, places in seen if places]
    if not best:
        return first
    usual = float(np.median([place.registered.unexplained for _, place in best]))
    moved = [
        _onto(frame.image, place, first)
        for frame, place in best
        if place.registered.unexplained <= 2.0 * usual + half_a_pixel(first)
    ]
    kept = [one for one in moved if one is not None]
    if not kept:
        return first
    looks = np.stack([first.values, *(values for values, _ in kept)])
    clean = np.stack([~cut_off(first.values), *(clean for _, clean in kept)])
    # A pixel whose light was cut off in every look is known no better than that.
    clean |= ~clean.any(axis=0)
    return Pattern(np.asarray(np.average(looks, axis=0, weights=clean)))


def half_a_pixel(pattern: Pattern) -> float:
    """Share of the pattern's variance that a shift by half a pixel leaves, the least of both ways.

    A window that differs from the pattern by more than noise and this is not taken for the
    feature: the pattern itself, half a pixel away, would look more like it.
    """
    energy = float(np.sum((pattern.box - pattern.box.mean()) ** 2))
    return 0.25 * float(np.trace(pattern.information)) / 2.0 / max(energy, 1e-300)


def _onto(image: FloatArray, seen: Sighting, first: Pattern) -> tuple[FloatArray, BoolArray] | None:
    """A frame's own look at the pattern and its margin, in the pattern's contrast.

    And where no light was cut off. None where the look is not within the picture.
    """
    height, width = first.shape
    corner = seen.place - 0.5 * (np.array([width, height]) - 1.0)
    around = MARGIN + _AROUND
    whole = np.floor(corner).astype(int)
    left, top = whole - around
    right, bottom = whole + [width, height] + around + 1
    if left < 0 or top < 0 or right > image.shape[1] or bottom > image.shape[0]:
        return None
    patch = image[top:bottom, left:right]
    across = np.arange(top, bottom), np.arange(left, right)
    spline = RectBivariateSpline(*across, patch, kx=5, ky=5)
    rows = corner[1] + np.arange(-MARGIN, height + MARGIN)
    columns = corner[0] + np.arange(-MARGIN, width + MARGIN)
    shown = np.asarray(spline(rows, columns)) / seen.registered.gain
    # The four pixels around each of these, and what the spline takes from theirs.
    near = RectBivariateSpline(*across, binary_dilation(cut_off(patch)).astype(float), kx=1, ky=1)
    clean = np.asarray(near(rows, columns)) == 0.0
    even = clean if clean.mean() > 0.5 else np.ones_like(clean)
    return shown - shown[even].mean() + first.values[even].mean(), clean


def _noise(values: FloatArray) -> float:
    """Noise of a picture [levels] from second differences both ways, which see no pattern.

    The mask [1 -2 1]' [1 -2 1] sums to nothing over any even slope and multiplies the variance of
    independent noise by 36. A tenth of a level stands for the rounding of a picture without noise.

    Source: Immerkaer (1996), Comput. Vis. Image Underst. 64(2), 300-302.
    """
    second = np.diff(np.diff(values, 2, axis=0), 2, axis=1)
    return max(0.1, float(np.median(np.abs(second))) / 0.6745 / 6.0)


def _pixels(value: float) -> str:
    return "no pixel" if not value < 1e3 else f"{value:.2g} pixels"
