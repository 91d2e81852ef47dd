"""What a codec does to a place and no frame shows: measured on the film, made again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Final, final

import numpy as np
from scipy.ndimage import map_coordinates

from piezo_opt.measurement import FloatArray
from piezo_opt.video.coding import Coding
from piezo_opt.video.frames import Video, library
from piezo_opt.video.judging import Judged, judged
from piezo_opt.video.pattern import Pattern
from piezo_opt.video.sighting import sighted
from piezo_opt.video.writing import film

_FRAMES: Final = 120
"""Frames that are made again: an rms over their errors is known to 5 to 10 %."""
_BLOCK: Final = 64
"""[px] Side of the largest block of a codec."""
_FADE: Final = 16
"""[px] Beyond the box, over which the added motion dies out; a codec's block is 16 to 64 wide."""
_FARTHEST: Final = 2.0
"""[px] Of the added motion: some grids of motion vectors, and stretched by an eighth of `_FADE`."""
_SHARE: Final = 0.618
"""Of the film's own motion that is added: the golden ratio is on no grid with it."""
_FEWEST: Final = 12
"""Frames of a type that have an error of their own."""


@final
@dataclass(frozen=True)
class _Encoder:
    """An encoder, its dial of quality from fine to coarse, and what else it is told."""

    name: str
    dials: tuple[str, ...]
    qualities: tuple[int, ...]
    others: tuple[tuple[str, str], ...] = ()

    def options(self, quality: int) -> dict[str, str]:
        """Of a quality."""
        return {**dict(self.others), **dict.fromkeys(self.dials, str(quality))}


_BY_CODEC: Final[Mapping[str, _Encoder]] = MappingProxyType(
    {
        "h264": _Encoder("libx264", ("crf",), (14, 19, 24, 29, 36)),
        "hevc": _Encoder(
            "libx265", ("crf",), (14, 19, 24, 29, 36), (("x265-params", "log-level=none"),)
        ),
        "vp8": _Encoder("libvpx", ("crf",), (8, 16, 26, 36, 50), (("b", "10M"),)),
        "vp9": _Encoder("libvpx-vp9", ("crf",), (14, 22, 31, 40, 52), (("b", "0"),)),
        "av1": _Encoder("libsvtav1", ("crf",), (14, 24, 34, 44, 56)),
        **{
            name: _Encoder(name, ("qmin", "qmax"), (2, 4, 7, 12, 20))
            for name in ("mpeg4", "mpeg2video", "mpeg1video", "msmpeg4v3", "wmv2", "h263")
        },
    }
)


@final
@dataclass(frozen=True, eq=False)
class Common:
    """Variances (2,) along x and y [px^2] of what all blocks of a frame err alike.

    Attributes:
        by_type: of each type of frame ("I", "P", "B") that was seen often enough.
        all: of all frames together.
        measured: or only the largest that there is.
    """

    by_type: Mapping[str, FloatArray]
    all: FloatArray
    measured: bool = True

    def sentence(self, codec: str) -> str:
        """What is to be known of it."""
        if not self.measured:
            return (
                f"The video is compressed ({codec}) by moving blocks, and how far that shifts a "
                "feature could not be measured: the sigma is that of half pixels. Record without "
                "losses, or with a codec that can be written here, H.264."
            )
        sizes = {kind: float(np.sqrt(v.mean())) for kind, v in self.by_type.items()}
        each = ", ".join(f"{size:.2g} in {kind} frames" for kind, size in sizes.items())
        return (
            f"The video is compressed ({codec}) by moving blocks, which shifts a whole feature by "
            f"{np.sqrt(self.all.mean()):.2g} pixels{f' ({each})' if len(sizes) > 1 else ''}, as "
            "the same film shows that was made again: a recording without losses is known better."
        )

    def of(self, kind: str) -> FloatArray:
        """Of a type of frame."""
        return self.by_type.get(kind, self.all)


_UNKNOWN: Final = Common(MappingProxyType({}), np.full(2, 0.25 / 12.0), measured=False)
"""Rounding to half a pixel: the coarsest grid of motion vectors that other codecs use."""


def common_error(
    video: Video, coding: Coding, kinds: Sequence[str], pattern: Pattern, found: Judged
) -> Common:
    """What all blocks of a feature err alike, from the film made again with a motion that is known.

    A codec that predicts frames from others moves blocks along, on a grid, and leaves small errors
    as they are. All blocks of a feature then err alike, and no frame shows it. But a film shows how
    such errors come about: its own frames, the feature moved by known fractions of a pixel beyond
    what it moves already, are compressed once more and tracked. What is off beyond the blocks'
    disagreement is common to all. The quality is that at which the second compression makes the
    blocks disagree as much more as the first one did, beyond noise: so the error in common is told
    by the one that is seen, for this feature, motion and codec.

    The added motion is the film's own, backward in time and smaller: on no grid with it.

    Args:
        video: of the track.
        coding: of it.
        kinds: type of each frame.
        pattern: that was tracked.
        found: places of all frames, nothing in common assumed.

    Returns:
        Without an encoder for the codec, or where the feature is not found again, the whole
        rounding of `_UNKNOWN`.

    Source: Efron & Tibshirani (1993), An Introduction to the Bootstrap, ch. 6 (an error measured
    where the truth is made).
    """
    encoder = _BY_CODEC.get(coding.codec)
    if encoder is None or not _there(encoder.name):
        return _UNKNOWN
    film_again, before = _Again.of(video, pattern, found), None
    alike = _structure(coding, kinds)
    for quality in encoder.qualities:
        made = film_again.made(encoder.name, {**encoder.options(quality), **alike})
        if made is None:
            continue
        if made.coded >= found.coded:
            return made.towards(before, found.coded)
        before = made
    return _UNKNOWN if before is None else before.common


def _structure(coding: Coding, kinds: Sequence[str]) -> dict[str, str]:
    """Options that give frames of the same types, and motion vectors on the same grid."""
    keys = np.flatnonzero(np.array(kinds) == "I")
    told = {"g": str(int(np.median(np.diff(keys))))} if len(keys) > 2 else {}
    if "B" not in kinds:
        told["bf"] = "0"
    if coding.codec == "h264" and coding.grid is not None and coding.grid >= 1.0:
        told["preset"] = "ultrafast"
    return told


@final
@dataclass(frozen=True, eq=False)
class _Made:
    """Variances [px^2] of a film made again: what blocks show of its coding, and in common."""

    coded: float
    common: Common

    def towards(self, other: _Made | None, coded: float) -> Common:
        """On a straight line to a better one, or to no loss, where blocks disagree by so much."""
        low = 0.0 if other is None else other.coded
        share = (coded - low) / (self.coded - low) if self.coded > low else 1.0

        def at(kind: str) -> FloatArray:
            less = np.zeros(2) if other is None else other.common.of(kind)
            return np.asarray(share * self.common.of(kind) + (1.0 - share) * less)

        return Common({kind: at(kind) for kind in self.common.by_type}, at(""))


@final
@dataclass(frozen=True, eq=False)
class _Again:
    """A stretch of a film that is made again.

    Attributes:
        video: where it is.
        pattern: of the feature.
        found: the track of the whole film.
        frames: numbers of the first frame and of that after the last.
        place: (n, 2) where the feature is [px].
        shift: (n, 2) what is added [px].
        window: rows and columns that are kept, on the codec's grid of blocks.
    """

    video: Video
    pattern: Pattern
    found: Judged
    frames: tuple[int, int]
    place: FloatArray
    shift: FloatArray
    window: tuple[slice, slice]

    @staticmethod
    def of(video: Video, pattern: Pattern, found: Judged) -> _Again:
        """The stretch in which the feature moves most; lost frames are passed on a straight line.

        The added motion is the film's own, backward in time, smaller, and within a few pixels.
        """
        number = np.arange(len(found.place))
        seen = np.isfinite(found.place[:, 0])
        place = np.column_stack(
            [np.interp(number, number[seen], along[seen]) for along in found.place.T]
        )
        starts = range(0, max(1, len(place) - _FRAMES + 1), _FRAMES // 2)
        begin = max(starts, key=lambda k: float(place[k : k + _FRAMES].std(axis=0).sum()))
        place = place[begin : begin + _FRAMES]
        own = (place - np.median(place, axis=0))[::-1]
        farthest = float(np.abs(own).max())
        shift = own * (min(_SHARE, _FARTHEST / farthest) if farthest > 0.0 else 0.0)
        height, width = pattern.shape
        around = 0.5 * np.array([width, height]) + _FADE + _BLOCK
        low = np.maximum(np.floor((place.min(axis=0) - around) / _BLOCK), 0.0).astype(int) * _BLOCK
        high = np.ceil(place.max(axis=0) + around).astype(int)
        return _Again(
            video, pattern, found, (begin, begin + len(place)), place, shift,
            (slice(low[1], high[1]), slice(low[0], high[0])),
        )  # fmt: skip

    def made(self, encoder: str, options: Mapping[str, str]) -> _Made | None:
        """Compressed at a quality and tracked; None where frames or the feature are lost."""
        corner = np.array([self.window[1].start, self.window[0].start], dtype=np.float64)
        with TemporaryDirectory() as folder:
            path = Path(folder) / "again.mkv"
            times = np.arange(len(self.place)) / 25.0
            film(path, self._pictures(), times, codec=encoder, options=options)
            again = list(Video(path).frames())
        if len(again) != len(self.place):
            return None
        truth = self.place + self.shift
        seen = [
            sighted(one.image, self.pattern, at - corner)
            for one, at in zip(again, truth, strict=True)
        ]
        told = judged([() if one is None else (one,) for one in seen], self.pattern)
        error = told.place + corner - truth
        error = error - np.nanmedian(error, axis=0)
        good = np.isfinite(error[:, 0]) & np.isfinite(self.found.place[slice(*self.frames), 0])
        if np.count_nonzero(good) < _FEWEST:
            return None
        own = max(0.0, told.variance - self.found.variance)
        kinds = np.array([one.kind for one in again])
        each = {str(kind): good & (kinds == kind) for kind in np.unique(kinds)}
        often = {k: one for k, one in each.items() if np.count_nonzero(one) >= _FEWEST}
        squares = np.mean(error[good] ** 2, axis=0)
        size = np.tile(squares, (len(error), 1))
        for one in often.values():
            size[one] = np.mean(error[one] ** 2, axis=0)
        ratios = error[good] ** 2 / np.maximum(size[good], 1e-300)
        # Two sigma hold 95 %: errors on a grid have no tails, those of a few bad frames long ones.
        shape = float(np.quantile(ratios, 0.95)) / 4.0

        def common(mean: FloatArray) -> FloatArray:
            return np.maximum(0.0, shape * mean - own)

        return _Made(
            max(0.0, told.coded - self.found.coded),
            Common({k: common(size[one][0]) for k, one in often.items()}, common(squares)),
        )

    def _pictures(self) -> Iterator[FloatArray]:
        frames = islice(self.video.frames(), *self.frames)
        for frame, at, by in zip(frames, self.place, self.shift, strict=False):
            picture = moved(frame.image, at, by, self.pattern.shape)[self.window]
            # Codecs that halve the resolution of colour want even sides.
            yield picture[: picture.shape[0] // 2 * 2, : picture.shape[1] // 2 * 2]


def moved(image: FloatArray, at: FloatArray, by: FloatArray, shape: tuple[int, int]) -> FloatArray:
    """A picture (H, W) whose box around ``at`` is moved by ``by`` [px], what lies around it less.

    Args:
        image: levels.
        at: x and y of the box's centre.
        by: x and y.
        shape: rows and columns of the box.
    """
    reach = 0.5 * np.array(shape) + _FADE + 2.0
    low = np.maximum(np.floor(at[::-1] - reach), 0.0).astype(int)
    high = np.minimum(np.ceil(at[::-1] + reach) + 1.0, image.shape).astype(int)
    rows, columns = np.mgrid[low[0] : high[0], low[1] : high[1]].astype(np.float64)
    share = np.ones(rows.shape)
    for along, middle, side in ((rows, at[1], shape[0]), (columns, at[0], shape[1])):
        beyond = np.clip((np.abs(along - middle) - 0.5 * side - 2.0) / _FADE, 0.0, 1.0)
        share *= np.cos(0.5 * np.pi * beyond) ** 2
    made = image.copy()
    made[low[0] : high[0], low[1] : high[1]] = map_coordinates(
        image, [rows - by[1] * share, columns - by[0] * share], order=5, mode="nearest"
    )
    return made


def _there(encoder: str) -> bool:
    try:
        library("av.codec").Codec(encoder, "w")
    except ValueError:
        return False
    return True
