"""Pictures to a video file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from fractions import Fraction
from pathlib import Path

import numpy as np

from piezo_opt.measurement import FloatArray
from piezo_opt.video.frames import library


def film(
    path: Path,
    pictures: Iterable[FloatArray],
    times: Iterable[float],
    *,
    codec: str = "ffv1",
    options: Mapping[str, str] | None = None,
) -> None:
    """Write pictures (H, W) as a video, each with its own instant [s].

    ``ffv1`` keeps every level; other codecs lose some. The container follows the suffix: .mkv
    counts milliseconds, .mp4 ninety thousandths.
    """
    av = library("av")
    grey = {"ffv1": "gray", "mjpeg": "yuvj420p"}.get(codec, "yuv420p")
    with av.open(str(path), "w") as container:
        stream, base = None, Fraction(1, 1000 if path.suffix == ".mkv" else 90_000)
        for picture, time in zip(pictures, times, strict=True):
            if stream is None:
                stream = container.add_stream(codec, rate=25, options=dict(options or {}))
                stream.height, stream.width = picture.shape
                stream.pix_fmt = grey
                stream.time_base = stream.codec_context.time_base = base
            levels = np.clip(np.rint(picture), 0, 255).astype(np.uint8)
            frame = av.VideoFrame.from_ndarray(levels, format="gray").reformat(format=grey)
            frame.pts, frame.time_base = round(time / float(base)), base
            container.mux(stream.encode(frame))
        if stream is not None:
            container.mux(stream.encode())
