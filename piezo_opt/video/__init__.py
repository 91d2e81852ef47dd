"""Displacement from video: a feature followed to a hundredth of a pixel, with its sigma."""

from piezo_opt.video.box import Box
from piezo_opt.video.judging import Lost
from piezo_opt.video.result import Track
from piezo_opt.video.track import track

__all__ = ["Box", "Lost", "Track", "track"]
