"""From a video to a displacement."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.measurement import FEWEST_SAMPLES
from piezo_opt.stopping import TimeLimit
from piezo_opt.units import quantity
from piezo_opt.video.again import common_error
from piezo_opt.video.box import Box, point
from piezo_opt.video.choosing import chosen
from piezo_opt.video.frames import Frame, Video
from piezo_opt.video.judging import Judged, judged
from piezo_opt.video.learning import LEARNT, UNSURE, learnt
from piezo_opt.video.result import Track
from piezo_opt.video.sighting import Area, Sighting, sightings

_SPREAD: Final = 12
"""Frames, spread over the video, that a feature is chosen by."""
_PARTS_AGREE: Final = 25.0
"""Unevenness from which the parts of a box are said to move apart: five times in sigma. What codecs
do to blocks stays below twelve."""


def track(
    path: str | os.PathLike[str],
    *,
    scale: float | str,
    reference: str | tuple[float, float],
    box: str | Box | None = None,
    search: float | None = None,
    rate: float | str | None = None,
    whole_pixels: bool = False,
    sure: float = UNSURE,
    max_time: float | None = None,
    progress: Callable[[str], None] | None = None,
) -> Track:
    """The distance of a feature from a point of the picture, frame by frame, from a video.

    The feature is looked for in each frame anew (normalised cross-correlation over the whole
    picture), its place is refined to a fraction of a pixel by maximum likelihood with a pattern
    learnt from the first frames, and frames that could be wrong by half a pixel are lost.

        d_i = scale |x_i - reference|,    sigma_i^2 = scale^2 u_i' C_i u_i

    Args:
        path: a video that FFmpeg decodes.
        scale: length of a pixel, ``"0.1725 um/px"`` or [m].
        reference: ``"x,y"`` [px] of a point that stands still, from the centre of the top left
            pixel.
        box: ``"x,y,width,height"`` [px] of the feature in the first frame; chosen unless given.
        search: how far from its box the feature may be [px]; the whole picture unless given.
        rate: of the camera, ``"1 kHz"`` or [Hz], where the file's instants are missing or wrong.
        whole_pixels: round places to pixels, as a tracker without sub-pixel registration does; to
            see what that costs.
        sure: sigma of a place [px] beyond which a frame is lost, a quarter at most: of a compressed
            film, the frames in which most is left as it was predicted.
        max_time: [s], after which what was done is returned, as by Ctrl-C.
        progress: told where it is.

    Raises:
        InputError: the file is no video or empty, the feature is flat, an edge, at the border,
            occurs twice or is lost in nearly all frames, or an option makes no sense.
    """
    video = Video.of(path, rate)
    metres, near, wanted = _length(scale), point(reference), None if box is None else Box.of(box)
    if search is not None and not 0.0 < search < np.inf:
        raise InputError(f"search is {search:g} pixels: give a positive distance")
    if not 0.0 < sure <= UNSURE:
        raise InputError(f"sure is {sure:g} pixels: give a sigma above 0, up to {UNSURE:g}")
    tell = progress or (lambda _: None)
    limit = TimeLimit(max_time)
    coding = video.coding
    notes: list[str] = []
    if wanted is None:
        tell("choosing a feature")
        wanted, said = chosen(_spread(video), search)
        notes.append(said)
    area = Area(wanted, search)
    opening = _first(video)
    first = opening[0]
    _check_reference(near, first)
    pattern = learnt(opening, wanted, area)
    start = judged([sightings(one.image, pattern, area) for one in opening], pattern)
    why = start.lost[0]
    if why is not None:
        raise InputError(
            f"{path}: box {wanted}: {why.value} in the first frame already: choose another box"
            + ("" if search is not None else ", or say how far the feature moves, search=30")
        )
    times: list[float] = []
    kinds: list[str] = []
    seen: list[tuple[Sighting, ...]] = []
    count = video.length
    try:
        with limit:
            for frame in video.frames():
                places = sightings(frame.image, pattern, area)
                times.append(frame.time)
                kinds.append(frame.kind)
                seen.append(places)
                tell(f"frame {len(times)}" + (f" of {count}" if count else ""))
    except KeyboardInterrupt:
        times, kinds = times[: len(seen)], kinds[: len(seen)]
        if len(seen) < FEWEST_SAMPLES:
            raise
        notes.append(f"Ended early, after {len(seen)} frames.")
    found = judged(seen, pattern, sure=sure)
    if coding is not None and sum(one is None for one in found.lost) >= FEWEST_SAMPLES:
        tell("what the compression did")
        common = common_error(video, coding, kinds, pattern, found)
        found = judged(seen, pattern, [common.of(kind) for kind in kinds], sure=sure)
        notes.append(common.sentence(coding.codec))
    notes += _remarks(found, seen)
    if sum(one is None for one in found.lost) < FEWEST_SAMPLES:
        raise InputError(
            f"{path}: the feature in box {wanted} is lost in all but "
            f"{sum(one is None for one in found.lost)} of {len(seen)} frames: choose another box"
        )
    told = Track(
        time=np.array(times), place=found.place, covariance=found.covariance, lost=found.lost,
        reference=near, scale=metres, box=wanted, first=first.image, name=video.path.stem,
        source=video.path.name, notes=tuple(notes),
    )  # fmt: skip
    return _rounded(told) if whole_pixels else told


def _rounded(told: Track) -> Track:
    """Places as whole pixels from that of the first frame; each errs evenly by half a pixel."""
    middle = np.array(told.box.centre)
    place = middle + np.rint(told.place - middle)
    covariance = np.where(np.isfinite(told.covariance), np.eye(2) / 12.0, np.nan)
    return replace(told, place=place, covariance=covariance, whole_pixels=True)


def _remarks(found: Judged, seen: list[tuple[Sighting, ...]]) -> list[str]:
    said = []
    if found.unevenness > _PARTS_AGREE:
        said.append(
            "The parts of the box do not move alike: draw it tighter, so that nothing that stands "
            "still or turns is in it."
        )
    repeats = sum(
        bool(a and b and a[0].registered.variance == b[0].registered.variance)
        for a, b in itertools.pairwise(seen)
    )
    if repeats:
        said.append(
            f"{repeats} frames show the feature exactly as the frame before: they are copies, or "
            "the compression left nothing else."
        )
    return said


def _length(scale: float | str) -> float:
    if isinstance(scale, str):
        # The units library takes px for a length of its own, that of a printed page.
        head, slash, tail = scale.partition("/")
        if slash and tail.strip() not in ("px", "pixel"):
            raise InputError(f"scale {scale!r} is no length of a pixel: write '0.1725 um/px'")
        scale = head
    value = quantity(scale, "m")
    if not value > 0.0:
        raise InputError(f"scale is {value:g} m a pixel: give a positive length, '0.1725 um/px'")
    return value


def _check_reference(near: tuple[float, float], first: Frame) -> None:
    height, width = first.image.shape
    # A point beside the picture is as good as one in it, but one far away is a mistake of units.
    if not all(abs(one) <= 100.0 * max(height, width) for one in near):
        raise InputError(
            f"reference {near[0]:g},{near[1]:g} is far from the picture of {width} x {height} "
            "pixels: give pixels from its top left"
        )


def _first(video: Video) -> list[Frame]:
    kept = []
    for frame in video.frames():
        kept.append(frame)
        if len(kept) == LEARNT:
            break
    if len(kept) < FEWEST_SAMPLES:
        raise InputError(
            f"{video.path}: has {len(kept)} frames: a record needs {FEWEST_SAMPLES} or more"
        )
    return kept


def _spread(video: Video) -> list[Frame]:
    """Frames evenly over a video of unknown length, the first among them."""
    kept: list[Frame] = []
    stride = 1
    for frame in video.frames():
        if frame.number % stride == 0:
            kept.append(frame)
            if len(kept) > 2 * _SPREAD:
                kept, stride = kept[::2], 2 * stride
    return kept[:: max(1, len(kept) // _SPREAD)]
