"""How a video is coded."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, final

import numpy as np


@final
@dataclass(frozen=True)
class Coding:
    """How a video is coded that predicts frames from others, with losses.

    Attributes:
        codec: its name.
        grid: of its motion vectors [px]; None where the decoder does not tell them.
    """

    codec: str
    grid: float | None

    @staticmethod
    def of(stream: Any, frames: Iterable[Any]) -> Coding | None:
        """How a stream is coded, as the library that decodes it says.

        Args:
            stream: of the video.
            frames: some of its decoded frames, with their motion vectors.

        Returns:
            None where every frame is coded by itself, or without losses.
        """
        codec = stream.codec_context.codec
        if codec.intra_only or not codec.lossy:
            return None
        steps = [step for frame in frames if (step := _step(frame)) is not None]
        return Coding(str(codec.canonical_name), min(steps, default=None))


def _step(frame: Any) -> float | None:
    """The grid of a frame's motion vectors [px]; None where it has none, or none that moves."""
    told = frame.side_data.get("MOTION_VECTORS")
    vectors = None if told is None else told.to_ndarray()
    if vectors is None or not vectors.size:
        return None
    counts = np.concatenate([vectors["motion_x"], vectors["motion_y"]]).astype(np.int64)
    grid = int(np.gcd.reduce(np.abs(counts)))
    return grid / float(vectors["motion_scale"][0]) if grid else None
