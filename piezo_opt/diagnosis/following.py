"""Whether a residual follows something: an effect's direction, or any function of the drive."""

from __future__ import annotations

from typing import final

import numpy as np
import scipy
from numpy.typing import NDArray

from piezo_opt.diagnosis.base_point import GONE, BasePoint
from piezo_opt.diagnosis.colour import Colour
from piezo_opt.identification import Fit
from piezo_opt.identification.tall import triangle

FloatArray = NDArray[np.float64]

WIDTHS = (0.15, 0.3, 0.5, 0.7)
"""Of a loop, as shares of the drive's range: a factor of two apart or less. A law begins from each,
and a loop of another shape leaves what plays of such widths give."""


@final
class Whitened:
    """A residual r (M,) at a fit after its own filter of the first order, and what may explain it.

    Args:
        point: the fit; what its parameters explain after the filter is taken away of everything.
    """

    def __init__(self, point: BasePoint) -> None:
        self._colour = Colour.of(point.residual, point.colour.lengths, 1)
        white = self._colour.whitened(point.basis)
        self._basis = white @ np.linalg.inv(triangle(white))
        self.residual = self.beside(point.residual)

    def beside(self, columns: FloatArray) -> FloatArray:
        """Columns (M, ...) after the filter, less what the fitted parameters explain of them."""
        white = self._colour.whitened(columns)
        return np.asarray(white - self._basis @ (self._basis.T @ white))

    def chance(self, column: FloatArray) -> float:
        """Probability of as large a score s = c'r of a column c (M,) by noise alone.

            s^2 / max(sigma^2 c'c, sum_t c_t^2 e_t^2)

        is chi-squared with one degree, with e what the column leaves of r, so that a true effect
        does not hide behind itself, and sigma^2 its mean square. The second variance is that of
        noise which is larger where the column is.

        Source: White (1980), Econometrica 48(4), 817-838.
        """
        c = self.beside(column)
        power, score = float(c @ c), float(c @ self.residual)
        if power == 0.0:
            return 1.0
        squares = np.square(self.residual - c * (score / power))
        variance = max(float(squares.mean()) * power, float(np.square(c) @ squares))
        return float(scipy.special.chdtrc(1.0, score**2 / max(variance, np.finfo(float).tiny)))


def follows_drive(fit: Fit, point: BasePoint) -> tuple[float, str, FloatArray]:
    """Whether generic functions of the drive explain a residual r (M,) together.

    With the functions F beside the fitted parameters, both after the filter of the noise,

        W = s' (sum_t z_t z_t')^-1 s,    z_t = F_t r_t,    s = sum_t z_t

    is chi-squared with as many degrees as functions where r is noise, which may be larger here and
    smaller there.

    Returns:
        its p-value, the name of the function that correlates most, and what F leaves of r.

    Source: Wooldridge (1991), J. Econometrics 47, 5-46 (score test robust to uneven variance).
    """
    names, columns = _functions(fit)
    r = point.residual
    whole = np.linalg.norm(columns, axis=0)
    columns -= point.basis @ (point.basis.T @ columns)
    sizes = np.linalg.norm(columns, axis=0)
    seen = np.flatnonzero(sizes > GONE * whole)
    columns = columns[:, seen] / sizes[seen]
    rest = r - columns @ (_inverse(columns.T @ columns) @ (columns.T @ r))
    white = Whitened(point)
    columns = white.beside(columns)
    cosines = np.abs(white.residual @ columns) / np.linalg.norm(columns, axis=0)
    columns *= white.residual[:, None]
    sizes = np.linalg.norm(columns, axis=0)
    if not sizes.all() or not sizes.size:
        return 1.0, "", r
    columns /= sizes
    side, inverse = columns.sum(axis=0), _inverse(columns.T @ columns)
    degrees = np.linalg.matrix_rank(inverse, hermitian=True)
    p_value = float(scipy.special.chdtrc(degrees, side @ inverse @ side))
    return p_value, names[seen[np.argmax(cosines)]], rest


def _inverse(gram: FloatArray) -> FloatArray:
    """Of the products of columns of length one, without what others explain of them."""
    return np.asarray(np.linalg.pinv(gram, rcond=GONE, hermitian=True))


def _functions(fit: Fit) -> tuple[list[str], FloatArray]:
    """Names, and values (M, q), of the library over the records."""
    parts = [_library(fit, index) for index in range(len(fit.records))]
    columns = [np.concatenate([part[name] for part in parts]) for name in parts[0]]
    return list(parts[0]), np.column_stack(columns)


def _library(fit: Fit, index: int) -> dict[str, FloatArray]:
    """Generic functions of drive, its rate, the position and the time since a reversal."""
    record, reading = fit.records[index], fit.readings[index]
    t = record.time
    v = (record.drive - record.drive.mean()) / (float(np.ptp(record.drive)) or 1.0)
    rate = np.gradient(v, t)
    speed = rate / (float(np.sqrt(np.mean(rate**2))) or 1.0)
    x = (reading - reading.mean()) / (float(np.ptp(reading)) or 1.0)
    w = np.gradient(x, t)
    w = w / (float(np.sqrt(np.mean(w**2))) or 1.0)
    way = np.sign(speed)
    turned = np.concatenate([[True], way[1:] * way[:-1] < 0])
    since = t - np.maximum.accumulate(np.where(turned, t, t[0]))
    settle = np.log1p(since / record.step)
    plays = {
        f"the drive through a play of {share:.0%} of its range": play(v, 0.5 * share)
        for share in WIDTHS
    }
    functions = {
        **plays,
        "the drive's square": v**2,
        "the drive's cube": v**3,
        "the drive's rate": speed,
        "the size of the drive's rate": np.abs(speed),
        "the branch (loading or unloading)": way,
        "the branch times the drive": way * v,
        "the branch times the drive's square": way * v**2,
        "the position's square": x**2,
        "the position's cube": x**3,
        "the velocity": w,
        "the sign of the velocity": np.sign(w),
        "the time since the last reversal": settle,
        "the time since the last reversal, by branch": settle * way,
        "the time": t - t.mean(),
    }
    return {name: function[record.counted] for name, function in functions.items()}


def play(v: FloatArray, half: float) -> FloatArray:
    """What a play of this half width makes of a signal: the simplest memory of its turns."""
    step = np.diff(v)
    moving = np.flatnonzero(step)
    turned = moving[1:][step[moving[1:]] * step[moving[:-1]] < 0]
    rising = bool(step[moving[0]] > 0) if moving.size else True
    at, followed = float(v[0]), []
    # Within a monotone stretch only one side of the play is ever touched.
    for stretch in np.split(v, turned + 1):
        moved = np.maximum(at, stretch - half) if rising else np.minimum(at, stretch + half)
        followed.append(moved)
        at, rising = float(moved[-1]), not rising
    return np.concatenate(followed)
