"""What a codec does to a place, and no frame shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np

_HALF_PIXEL: Final = frozenset({"mpeg1video", "mpeg2video", "mpeg4", "h263", "flv1", "msmpeg4v3"})
"""Codecs whose motion vectors are whole halves of a pixel; those of others are quarters."""
_SKIPPING: Final = frozenset({"hevc", "av1", "vvc"})
"""Codecs whose blocks, up to 64 pixels wide, are mostly left as they are predicted."""


@final
@dataclass(frozen=True)
class Coding:
    """How a video is coded.

    A codec that predicts frames from others moves blocks by vectors on a grid of half or quarter
    pixels, which rounds a place by up to half a step: q / sqrt(12) in rms, where nothing corrects
    it. Neighbours share vectors, so that all blocks of a feature err alike and their disagreement
    does not tell. Two numbers stand for it, both measured (``piezo-opt bench video``): half of that
    rounding is left (all of it by codecs that skip large blocks), and of the variance of a block
    half is common to all blocks.

    Attributes:
        name: of the codec.
        predicted: whether frames are predicted from others, with losses.
    """

    name: str
    predicted: bool

    @staticmethod
    def of(stream: Any) -> Coding:
        """How a stream is coded, as the library that decodes it says."""
        codec = stream.codec_context.codec
        name = codec.canonical_name
        return Coding(name, codec.lossy and not codec.intra_only)

    @property
    def rounding(self) -> float:
        """Sigma of what is rounded alike in all blocks [px]."""
        if not self.predicted:
            return 0.0
        step = 0.5 if self.name in _HALF_PIXEL else 0.25
        left = 1.0 if self.name in _SKIPPING else 0.5
        return float(left * step / np.sqrt(12.0))

    @property
    def shared(self) -> float:
        """Share of a block's variance that is common to all."""
        return 0.5 if self.predicted else 0.0
