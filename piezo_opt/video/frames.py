"""The frames of a video file: grey pictures, and the instants that the file gives them."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, final

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.files import checked
from piezo_opt.measurement import FloatArray
from piezo_opt.readers.extras import needed
from piezo_opt.units import quantity
from piezo_opt.video.coding import Coding

_LOOKED_AT = 32
"""Frames whose motion vectors are looked at: a few that move share one grid."""
_SIXTEEN_BITS = 257.0
"""65535 / 255: pictures of 16 bits are brought to the levels of 8."""


@final
@dataclass(frozen=True, eq=False)
class Frame:
    """One picture: its number from 0, its instant [s], its grey levels (H, W), 0 to 255, and how
    it is coded: "I" by itself, "P" and "B" from others."""

    number: int
    time: float
    image: FloatArray
    kind: str = "I"


@final
@dataclass(frozen=True)
class Video:
    """A video file.

    Args:
        path: a file of any format that FFmpeg decodes.
        rate: [Hz] or ``"1 kHz"``, of the camera, where the file's own instants are missing or are
            those of a slowed-down copy; None takes the file's.

    Raises:
        InputError: there is no such file, or the rate is none.
    """

    path: Path
    rate: float | None = None

    @staticmethod
    def of(path: str | os.PathLike[str], rate: float | str | None = None) -> Video:
        """The file, and the rate as a person writes it."""
        file = checked(path, largest=None)
        hertz = None if rate is None else quantity(rate, "Hz")
        if hertz is not None and hertz <= 0.0:
            raise InputError(f"rate is {hertz:g} Hz: give a positive one, '1 kHz'")
        return Video(file, hertz)

    def frames(self) -> Iterator[Frame]:
        """All frames in the order in which they are shown.

        Raises:
            InputError: the file is no video, breaks off, has no frames, no instants, instants out
                of order, or pixels that are not square.
        """
        count, last = 0, -np.inf
        with self._opened() as (container, stream):
            for decoded in self._decoded(container, stream):
                time = self._instant(decoded, count)
                if time <= last:
                    raise InputError(
                        f"{self.path}: frame {count} is at {time:.6g} s, not after the frame "
                        f"before it ({last:.6g} s): give the rate of the camera, rate='25 Hz'"
                    )
                kind = library("av.video.frame").PictureType(decoded.pict_type).name
                yield Frame(count, time, _grey(decoded), kind)
                count, last = count + 1, time
        if count == 0:
            raise InputError(f"{self.path}: has no frames: record or export it again")

    @property
    def coding(self) -> Coding | None:
        """How it is coded, by its first frames; None without losses or prediction.

        Raises:
            InputError: the file is no video, or breaks off.
        """
        with self._opened() as (container, stream):
            stream.codec_context.flags2 |= library("av.codec.context").Flags2.export_mvs
            return Coding.of(stream, islice(self._decoded(container, stream), _LOOKED_AT))

    @property
    def length(self) -> int:
        """Frames that the file claims to have; 0 where it claims nothing."""
        with self._opened() as (_, stream):
            return int(stream.frames)

    def _instant(self, decoded: Any, number: int) -> float:
        if self.rate is not None:
            return number / self.rate
        if decoded.pts is None or decoded.time_base is None:
            raise InputError(
                f"{self.path}: says no instant for frame {number}: give the rate of the camera, "
                "rate='25 Hz'"
            )
        return float(decoded.pts * decoded.time_base)

    def _decoded(self, container: Any, stream: Any) -> Iterator[Any]:
        av, number = library("av"), 0
        try:
            for decoded in container.decode(stream):
                yield decoded
                number += 1
        except (av.FFmpegError, ValueError) as error:
            raise InputError(
                f"{self.path}: cannot be decoded after frame {number} ({_reason(error)}): copy or "
                "export it again, or cut it there"
            ) from error

    @contextmanager
    def _opened(self) -> Iterator[tuple[Any, Any]]:
        av = library("av")
        try:
            container = av.open(str(self.path))
        except (av.FFmpegError, OSError, ValueError) as error:
            raise InputError(
                f"{self.path}: is not a video that can be read ({_reason(error)}): export it "
                "again, as .mp4 or .avi"
            ) from error
        with container:
            if not container.streams.video:
                raise InputError(f"{self.path}: holds no pictures, only {_other(container)}")
            stream = container.streams.video[0]
            ratio = stream.sample_aspect_ratio
            if ratio and ratio != 1:
                raise InputError(
                    f"{self.path}: its pixels are {ratio} times as wide as high, so that one scale "
                    "does not hold for both axes: export it with square pixels"
                )
            stream.thread_type = "AUTO"
            yield container, stream


def library(name: str) -> Any:
    """A library of the extra; `InputError` says what to install when it is missing."""
    return needed(name, extra="video", what="videos")


def _grey(decoded: Any) -> FloatArray:
    """Grey levels as the picture is shown: turned as the file says, 0 to 255."""
    deep = max(one.bits for one in decoded.format.components) > 8
    levels = decoded.to_ndarray(format="gray16le" if deep else "gray").astype(np.float64)
    if deep:
        levels /= _SIXTEEN_BITS
    return np.rot90(levels, round(decoded.rotation / 90.0) % 4)


def _reason(error: Exception) -> str:
    text = getattr(error, "strerror", None) or str(error)
    return text.splitlines()[0][:100] if text else type(error).__name__


def _other(container: Any) -> str:
    return ", ".join(sorted({stream.type for stream in container.streams})) or "nothing"
