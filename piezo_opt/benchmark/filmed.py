"""Films of a moving tip whose place is known: rendered where it really is, not moved by pixels."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from scipy.special import erf

from piezo_opt.measurement import FloatArray
from piezo_opt.video.writing import film

__all__ = ["Scene", "Speckles", "film", "lit"]

_DARKEST, _BRIGHTEST = 20.0, 60.0
"""Levels of a speckle's middle."""
_SMALLEST, _LARGEST = 1.2, 3.0
"""Sigma of a speckle [px]."""


@final
@dataclass(frozen=True, eq=False)
class Speckles:
    """Bright and dark spots: a_k exp(-((x - x_k)^2 + (y - y_k)^2) / (2 s_k^2)), (K,) each."""

    x: FloatArray
    y: FloatArray
    size: FloatArray
    height: FloatArray

    @staticmethod
    def scattered(
        count: int, low: tuple[float, float], high: tuple[float, float], rng: np.random.Generator
    ) -> Speckles:
        """So many, evenly over a rectangle from low to high (x and y)."""
        return Speckles(
            x=rng.uniform(low[0], high[0], count),
            y=rng.uniform(low[1], high[1], count),
            size=rng.uniform(_SMALLEST, _LARGEST, count),
            height=rng.choice([-1.0, 1.0], count) * rng.uniform(_DARKEST, _BRIGHTEST, count),
        )

    def seen(self, shape: tuple[int, int], at: tuple[float, float], blur: float) -> FloatArray:
        """(H, W) the light that each pixel gathers, exactly: spots, a Gaussian lens, square pixels.

        A spot seen through a lens of sigma b is a spot of s^2 + b^2; its integral over a pixel is a
        product of differences of error functions.
        """
        size = np.hypot(self.size, blur)
        height = self.height * (self.size / size) ** 2
        rows = _gathered(self.y + at[1], size, shape[0])
        columns = _gathered(self.x + at[0], size, shape[1])
        return np.asarray((rows * height) @ columns.T)


@final
@dataclass(frozen=True, eq=False)
class Scene:
    """A speckled tip, ``2 half`` pixels wide, before a speckled background.

    Attributes:
        shape: (H, W) of the pictures.
        half: of the tip's side [px].
        blur: sigma of the lens [px].
        seed: of the speckles.
    """

    shape: tuple[int, int] = (160, 200)
    half: float = 24.0
    blur: float = 0.8
    seed: int = 0

    def picture(self, x: float, y: float) -> FloatArray:
        """(H, W) levels with the middle of the tip at x, y [px]."""
        edge = max(1.0, self.blur)
        cover = np.outer(
            _covered(y, self.half, edge, self.shape[0]), _covered(x, self.half, edge, self.shape[1])
        )
        tip = 130.0 + self._tip.seen(self.shape, (x, y), self.blur)
        return np.asarray(self._behind * (1.0 - cover) + tip * cover)

    @cached_property
    def _tip(self) -> Speckles:
        rng = np.random.default_rng([self.seed, 1])
        corner = (self.half, self.half)
        return Speckles.scattered(round(self.half**2 / 5.5), (-corner[0], -corner[1]), corner, rng)

    @cached_property
    def _behind(self) -> FloatArray:
        rng = np.random.default_rng([self.seed, 2])
        height, width = self.shape
        spots = Speckles.scattered(height * width // 150, (0.0, 0.0), (width, height), rng)
        return np.asarray(110.0 + 0.7 * spots.seen(self.shape, (0.0, 0.0), self.blur))


def lit(picture: FloatArray, bright: float, slope: float) -> FloatArray:
    """A picture (H, W) in other light: times bright, plus up to slope levels to the right."""
    return np.asarray(bright * picture + slope * np.linspace(0.0, 1.0, picture.shape[1]))


def _gathered(middle: FloatArray, size: FloatArray, count: int) -> FloatArray:
    """(count, K) integrals over pixels of exp(-(x - m)^2 / (2 s^2))."""
    edges = np.arange(count + 1)[:, None] - 0.5
    below = 0.5 * erf((edges - middle) / (np.sqrt(2.0) * size))
    return np.asarray(np.sqrt(2.0 * np.pi) * size * np.diff(below, axis=0))


def _covered(middle: float, half: float, edge: float, count: int) -> FloatArray:
    """(count,) how much of a pixel a body from middle - half to middle + half covers."""
    at = np.arange(count) - middle
    scale = np.sqrt(2.0) * edge
    return np.asarray(0.5 * (erf((at + half) / scale) - erf((at - half) / scale)))
