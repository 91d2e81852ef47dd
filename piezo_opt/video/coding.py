"""What a codec does to a place, and no frame shows."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np

_STEP: Final = 0.25
"""[px] Grid of motion vectors where the decoder does not tell them: that of HEVC, VP9 and AV1."""
_LEFT: Final = 0.125
"""Share of the rounding that is left where codecs correct what they moved."""
_SKIPPING: Final = frozenset({"hevc", "av1", "vvc"})
"""Codecs whose blocks, up to 64 pixels wide, are mostly left as they are predicted."""


@final
@dataclass(frozen=True)
class Coding:
    """How a video is coded.

    A codec that predicts frames from others moves blocks by vectors on a grid of whole, half or
    quarter pixels q, which rounds a place by up to half a step: q / sqrt(12) in rms, where nothing
    corrects it. Neighbours share vectors, so that all blocks of a feature err alike and their
    disagreement does not tell. The grid is read from the vectors where the decoder gives them. Two
    numbers stand for the rest, both measured (``piezo-opt bench video``): an eighth of that
    rounding is left (all of it by codecs that skip large blocks), and of the variance of a block
    half is common to all blocks.

    Attributes:
        name: of the codec.
        predicted: whether frames are predicted from others, with losses.
        step: grid of the motion vectors [px].
    """

    name: str
    predicted: bool
    step: float = _STEP

    @staticmethod
    def of(stream: Any, frames: Iterable[Any]) -> Coding:
        """How a stream is coded, as the library that decodes it says.

        Args:
            stream: of the video.
            frames: some of its decoded frames, with their motion vectors.
        """
        codec = stream.codec_context.codec
        if not codec.lossy or codec.intra_only:
            return Coding(codec.canonical_name, predicted=False)
        steps = [step for frame in frames if (step := _step(frame)) is not None]
        return Coding(codec.canonical_name, predicted=True, step=min(steps, default=_STEP))

    @property
    def rounding(self) -> float:
        """Sigma of what is rounded alike in all blocks [px]."""
        if not self.predicted:
            return 0.0
        left = 1.0 if self.name in _SKIPPING else _LEFT
        return float(left * self.step / np.sqrt(12.0))

    @property
    def shared(self) -> float:
        """Share of a block's variance that is common to all."""
        return 0.5 if self.predicted else 0.0


def _step(frame: Any) -> float | None:
    """The grid of a frame's motion vectors [px]; None where it has none, or none that moves."""
    told = frame.side_data.get("MOTION_VECTORS")
    vectors = None if told is None else told.to_ndarray()
    if vectors is None or not vectors.size:
        return None
    counts = np.concatenate([vectors["motion_x"], vectors["motion_y"]]).astype(np.int64)
    grid = int(np.gcd.reduce(np.abs(counts)))
    return grid / float(vectors["motion_scale"][0]) if grid else None
