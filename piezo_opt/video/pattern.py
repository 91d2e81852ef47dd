"""What a feature looks like, and where a picture shows it to a hundredth of a pixel."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final, final

import numpy as np
from scipy.interpolate import RectBivariateSpline

from piezo_opt.measurement import FloatArray
from piezo_opt.measurement.arrays import BoolArray, IndexArray
from piezo_opt.video.box import MARGIN

_FURTHEST: Final = 2.0
"""[px] A start is a whole pixel, so the place is a step or a diagonal away; beyond lies another."""
_STEPS: Final = 12
_ENOUGH: Final = 1e-3
"""[px] Change of the place that ends the steps: a tenth of the best sigma there is."""
_WHITE: Final = 255.0
"""The brightest level."""
_LEAST: Final = 0.25
"""Share of a window's pixels that must tell something."""
_BLOCK: Final = 10
"""Side of a block [px]: a codec's transform is 8 wide, and a pattern repeats itself less far."""
_FEWEST, _MOST = 3, 6
"""Blocks along a side: so many that their scatter is one, so few that it costs nothing."""


@final
@dataclass(frozen=True, eq=False)
class Registered:
    """Where a window shows the pattern.

    Attributes:
        shift: x and y [px] of the pattern within the window.
        gain: contrast, as a share of the pattern's.
        variance: of what is left, per pixel [level^2].
        unexplained: share of the window's variance (beyond an even slope of light) that is left.
        white: (2, 2) covariance of the shift [px^2] if what is left were independent noise.
        unevenness: variance of the shift, as the blocks of the window disagree, over the white one.
        blocks: how many.
    """

    shift: FloatArray
    gain: float
    variance: float
    unexplained: float
    white: FloatArray
    unevenness: float
    blocks: int


@final
@dataclass(frozen=True, eq=False)
class Pattern:
    """Grey levels (h + 2 m, w + 2 m) of a feature with a margin m around its box.

    A window w(x) of a picture is modelled, pixel by pixel, as

        w(x) = g T(x - d) + b + b_x x + b_y y + e(x)

    with the pattern T a quintic spline (Gauss-Newton needs its slopes), the shift d, the contrast g
    and three numbers of the light. With independent e this is the maximum-likelihood place, whose
    covariance is the Cramer-Rao bound

        s^2 (J' J)^-1,    J = [-g T_x, -g T_y, T, 1, x, y],   s^2 = |e|^2 / (n - 6).

    Where a level lies at an end of the scale and the model beyond it, the light was cut off there:
    the pixel agrees, and says no more.

    Noise of a camera is nearly independent, what a codec or a changed look leaves is not. So the
    window is cut into blocks B with scores g_B = J_B' e_B and information H_B = J_B' J_B. With A
    their sum, the sandwich A^-1 (sum g_B g_B') A^-1 tells how much the blocks disagree. Independent
    noise would give s^2 A^-1 (A - sum H_B A^-1 H_B) A^-1, since the fit has taken out what they
    agree on; the ratio of the two, averaged over x and y, is the unevenness.

    Sources: Lucas & Kanade (1981), IJCAI 674-679; Robinson & Milanfar (2004), IEEE Trans. Image
    Process. 13(9), 1185-1199 (the bound); Liang & Zeger (1986), Biometrika 73(1), 13-22 (scores of
    clusters).
    """

    values: FloatArray

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the box."""
        return self.values.shape[0] - 2 * MARGIN, self.values.shape[1] - 2 * MARGIN

    @property
    def box(self) -> FloatArray:
        """(h, w) without the margin."""
        return self.values[MARGIN:-MARGIN, MARGIN:-MARGIN]

    def register(self, window: FloatArray) -> Registered | None:
        """The place of the pattern in a window (h, w); None where it leads out of the window."""
        shift, seen = np.zeros(2), np.ones(window.size, dtype=bool)
        for _ in range(_STEPS):
            columns = self._columns(shift)
            kept = columns * seen[:, None]
            try:
                found = np.linalg.solve(kept.T @ kept, kept.T @ window.ravel())
            except np.linalg.LinAlgError:
                return None
            gain = float(found[2])
            if not gain > 0.0:
                return None
            step = found[:2] / gain
            shift = shift + step
            if not np.abs(shift).max() < _FURTHEST:
                return None
            before, seen = seen, _seen(window.ravel(), columns @ found)
            if np.count_nonzero(seen) < _LEAST * seen.size:
                return None
            if np.abs(step).max() < _ENOUGH and np.array_equal(before, seen):
                return self._judged(window, shift, seen)
        return None

    def _judged(self, window: FloatArray, shift: FloatArray, seen: BoolArray) -> Registered | None:
        columns = self._columns(shift) * seen[:, None]
        levels = window.ravel() * seen
        rest_of_light, _, _, _ = np.linalg.lstsq(columns[:, 3:], levels, rcond=None)
        flat = levels - columns[:, 3:] @ rest_of_light
        inverse = np.linalg.pinv(columns.T @ columns)
        found = inverse @ (columns.T @ levels)
        gain = float(found[2])
        left = levels - columns @ found
        squares = float(left @ left)
        freedom = int(np.count_nonzero(seen)) - columns.shape[1]
        information = self._by_block(
            (columns[:, :, None] * columns[:, None, :]).reshape(left.size, -1)
        ).reshape(-1, *inverse.shape)
        scores = self._by_block(columns * left[:, None])
        own = inverse @ information
        spread = inverse @ (scores.T @ scores) @ inverse
        even = inverse - np.sum(own @ own, axis=0) @ inverse
        white = squares / freedom * np.diag(even)[:2]
        if not gain > 0.0:
            return None
        return Registered(
            shift=shift,
            gain=gain,
            variance=squares / freedom,
            unexplained=squares / max(float(flat @ flat), 1e-300),
            white=squares / freedom * inverse[:2, :2] / gain**2,
            unevenness=float(np.mean(np.diag(spread)[:2] / np.maximum(white, 1e-300))),
            blocks=scores.shape[0],
        )

    def moved(self, shift: FloatArray) -> FloatArray:
        """(h, w) the pattern as a window shows it at a shift (2,) [px]."""
        return np.asarray(self._spline(self._rows - shift[1], self._columns_at - shift[0]))

    @cached_property
    def information(self) -> FloatArray:
        """(2, 2) of the shift, for a noise of one level [1/px^2]; the light taken out."""
        columns = self._columns(np.zeros(2))
        slopes, others = columns[:, :2], columns[:, 2:]
        own = slopes - others @ np.linalg.lstsq(others, slopes, rcond=None)[0]
        return np.asarray(own.T @ own)

    def _columns(self, shift: FloatArray) -> FloatArray:
        """(n, 6) slopes by the shift for a contrast of one, the pattern, and the light."""
        rows, across = self._rows - shift[1], self._columns_at - shift[0]
        return np.column_stack(
            [
                -self._spline(rows, across, dy=1).ravel(),
                -self._spline(rows, across, dx=1).ravel(),
                self._spline(rows, across).ravel(),
                self._light,
            ]
        )

    @cached_property
    def _spline(self) -> RectBivariateSpline:
        height, width = self.values.shape
        return RectBivariateSpline(
            np.arange(height) - MARGIN, np.arange(width) - MARGIN, self.values, kx=5, ky=5
        )

    @cached_property
    def _rows(self) -> FloatArray:
        return np.arange(self.shape[0], dtype=np.float64)

    @cached_property
    def _columns_at(self) -> FloatArray:
        return np.arange(self.shape[1], dtype=np.float64)

    @cached_property
    def _light(self) -> FloatArray:
        """(n, 3) even light and its slopes, from -1 to 1."""
        height, width = self.shape
        down, across = np.meshgrid(
            np.linspace(-1.0, 1.0, height), np.linspace(-1.0, 1.0, width), indexing="ij"
        )
        return np.column_stack([np.ones(down.size), across.ravel(), down.ravel()])

    def _by_block(self, each: FloatArray) -> FloatArray:
        """(blocks, k) sums over the blocks of what each pixel says (n, k)."""
        height, width = self.shape
        down, across = _edges(height), _edges(width)
        summed = np.add.reduceat(each.reshape(height, width, -1), down, axis=0)
        return np.asarray(np.add.reduceat(summed, across, axis=1).reshape(-1, each.shape[1]))


def cut_off(levels: FloatArray) -> BoolArray:
    """Levels at an end of the scale, 0 to 255: the light may have been beyond it."""
    return np.asarray((levels <= 0.0) | (levels >= _WHITE))


def _seen(window: FloatArray, model: FloatArray) -> BoolArray:
    """Pixels (n,) that tell more than that the light was cut off where the model says so."""
    return np.asarray(
        ~(((window >= _WHITE) & (model > _WHITE)) | ((window <= 0.0) & (model < 0.0)))
    )


def _edges(side: int) -> IndexArray:
    count = min(_MOST, max(_FEWEST, side // _BLOCK))
    return np.linspace(0, side, count + 1).astype(np.intp)[:-1]
