"""How sure: covariance, and what the data cannot see."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, final

import numpy as np
import scipy
from numpy.typing import NDArray

from piezo_opt.identification.objective import Linearised
from piezo_opt.identification.tall import across, inner
from piezo_opt.simulation import INITIAL

FloatArray = NDArray[np.float64]


_AT_ONCE = 65536
"""Rows whose sums are in memory at a time."""
_FEW_LAGS = 32
"""Lags up to which a product each is less work than a spectrum."""


@final
@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Covariance of the unknowns and whether it allows for correlated residuals."""

    covariance: FloatArray
    coloured: bool


def uncertainty(
    point: Linearised,
    free: NDArray[np.bool_],
    samples: int,
    scale: FloatArray | float = 1.0,
) -> Uncertainty:
    """Covariance of least squares at its minimum.

        C = sigma^2 (J'J)^-1                        residuals white
        C = (J'J)^-1 (sum_k w_k J'_t r_t r_(t+k) J_(t+k)) (J'J)^-1    residuals correlated

    White noise is judged by the Ljung-Box test over 20 lags at 0.1 %; otherwise Newey and West's
    estimate with Bartlett weights w_k is taken. Rows of unknowns at a bound are NaN: they have no
    two-sided interval.

    Args:
        point: at the minimum; its first ``samples`` residuals are in the order of time.
        scale: (k,) what columns of its Jacobian are multiplied by, so that they are of similar
            size; the covariance is that of the unknowns over their scale.
        free: (k,) unknowns not at a bound.
        samples: rows that are samples (the rest are priors).

    Sources: Seber & Wild (2003), Nonlinear Regression, ch. 2; Newey & West (1987),
    Econometrica 55(3), 703-708; Ljung & Box (1978), Biometrika 65(2), 297-303.
    """
    k = free.size
    covariance = np.full((k, k), np.nan)
    index = np.flatnonzero(free)
    if index.size == 0:
        return Uncertainty(covariance, False)
    scales = np.broadcast_to(scale, k)[index]
    # The triangle of J has its singular values and costs a fraction.
    _, size, vt = np.linalg.svd(point.root[:, index] * scales, full_matrices=False)
    null = size <= 1e-10 * size.max(initial=0.0)
    # Rounding must not lend an unknown a share of a direction that it has no part in.
    vt[np.ix_(null, range(vt.shape[1]))] *= np.abs(vt[null]) > 1e-5
    safe = np.maximum(size, 1e-12 * size.max(initial=0.0) + 1e-300)
    inverse = (vt.T / safe**2) @ vt
    r = point.residual[:samples]
    dof = max(1, samples - index.size)
    coloured = _coloured(r)
    if coloured:
        lags = int(np.ceil(4.0 * (samples / 100.0) ** (2.0 / 9.0))) + _memory(r)
        lags = min(lags, samples // 4)
        own = (
            inverse
            @ (_long_run(point.jacobian, r, lags, index) * np.outer(scales, scales))
            @ inverse
            * (samples / dof)
        )
        white = inverse * inner(r, r) / dof
        # Misfit that happens to cancel must not make the estimate look surer than white noise.
        if np.all(np.diag(own) > 0):
            lift = np.sqrt(np.maximum(1.0, np.diag(white) / np.diag(own)))
            own = own * np.outer(lift, lift)
        else:
            own = white
        covariance[np.ix_(index, index)] = own
    else:
        covariance[np.ix_(index, index)] = inverse * inner(r, r) / dof
    return Uncertainty(covariance, coloured)


def _long_run(j: FloatArray, r: FloatArray, lags: int, columns: NDArray[np.intp]) -> FloatArray:
    """``sum_k w_k S_t' S_(t+k)`` over |k| <= lags with Bartlett weights w_k = 1 - |k| / (lags + 1).

    S_t = r_t J_t over some columns of J (M, k) and the first N rows, as many as r has.

    The same as the mean over all windows of ``lags + 1`` rows, those that begin before the first
    row included, of the outer square of the window's sum: one pass whatever the lags.
    """
    width, size = lags + 1, r.size
    total = np.zeros((columns.size, columns.size))
    for start in range(0, size + lags, _AT_ONCE):
        stop = min(start + _AT_ONCE, size + lags)
        # Row t of the sums is the window that ends at start + t; it begins up to lags earlier.
        first, last = max(0, start - width), min(stop, size)
        sums = np.zeros((stop - start + width, columns.size))
        own = sums[first - (start - width) : last - (start - width)]
        if last > first:
            np.cumsum(j[first:last, columns] * r[first:last, None], axis=0, out=own)
            sums[last - (start - width) :] = own[-1]
        windows = sums[width:] - sums[:-width]
        total += across(windows, windows)
    return total / width


def _autocorrelation(r: FloatArray, lags: int) -> FloatArray:
    """Correlation of a series with itself 1 to ``lags`` samples later."""
    centred = r - r.mean()
    power = inner(centred, centred) or 1.0
    if lags <= _FEW_LAGS:
        return np.array([inner(centred[k:], centred[:-k]) for k in range(1, lags + 1)]) / power
    # Up to the next eighth of a power of two, which is as fast to transform and nearer.
    eighth = 1 << max(0, (r.size + lags - 1).bit_length() - 3)
    size = -(-(r.size + lags) // eighth) * eighth
    spectrum = np.fft.rfft(centred, size)
    both = np.fft.irfft(spectrum.real**2 + spectrum.imag**2, size)
    return np.asarray(both[1 : lags + 1] / power)


def _coloured(r: FloatArray) -> bool:
    n = r.size
    lags = min(20, n // 4)
    if lags < 1:
        return False
    rho = _autocorrelation(r, lags)
    q = n * (n + 2) * float(np.sum(rho**2 / (n - np.arange(1, lags + 1))))
    return bool(q > scipy.special.chdtri(lags, 0.001))


def _memory(r: FloatArray) -> int:
    """Lags until the residuals' correlation has first fallen into its band."""
    most = min(r.size // 4, 400)
    if most < 1:
        return 0
    rho = _autocorrelation(r, most)
    inside = np.flatnonzero(np.abs(rho) < 2.0 / np.sqrt(r.size))
    return int(inside[0]) + 1 if inside.size else most


def blind_spots(
    names: tuple[str, ...],
    theta: FloatArray,
    scale: FloatArray,
    point: Linearised,
    free: NDArray[np.bool_],
) -> tuple[str, ...]:
    """Sentences on what the data cannot tell.

    Directions in which relative changes of the unknowns hide below the residuals are the right
    singular vectors of the relative Jacobian with a standard deviation above one half; pairs
    that nearly cancel are those with a correlation above 0.98. Initial states and offsets are
    nuisances and only named together with others.

    Source: Brun, Reichert & Kuensch (2001), Water Resources Research 37(4), 1015-1030.
    """
    sentences: list[str] = []
    size = np.where(np.abs(theta) > 1e-3 * scale, np.abs(theta), scale)
    norms = np.sqrt(np.diag(point.normal[1])) * size
    dof = max(1, point.residual.size - theta.size)
    sigma = float(np.sqrt(inner(point.residual, point.residual) / dof)) or 1e-300
    told: set[str] = set()

    def nuisance(name: str) -> bool:
        return name.startswith((INITIAL, "offset."))

    usable = [k for k in range(theta.size) if free[k] and not nuisance(names[k])]
    for k in list(usable):
        if norms[k] < 2.0 * sigma:
            sentences.append(
                f"{names[k]} is not seen: changing it by its whole size moves the reading by less "
                "than the residuals show."
            )
            told.add(names[k])
            usable.remove(k)
    if not usable:
        return tuple(sentences)
    # What the nuisances can explain is taken out first.
    others = [k for k in range(theta.size) if free[k] and nuisance(names[k]) and norms[k] > 0]
    # The triangle's lower right corner is what the last columns have to themselves.
    both = np.asarray(np.linalg.qr(point.root[:, [*others, *usable]], mode="r"))
    seen = (both * size[[*others, *usable]])[len(others) :, len(others) :]
    for component in _hidden(seen, sigma):
        told.update(names[usable[i]] for i in component.members)
        sentences.append(component.sentence([names[usable[i]] for i in component.members]))
    correlation = _correlation(seen)
    # A column that the nuisances explain wholly leaves rounding, whose angles say nothing.
    own = [a for a, k in enumerate(usable) if np.linalg.norm(seen[:, a]) > 1e-7 * norms[k]]
    for place, a in enumerate(own):
        for b in own[place + 1 :]:
            one, two = names[usable[a]], names[usable[b]]
            if abs(correlation[a, b]) > 0.98 and not {one, two} <= told:
                does = "cancel" if correlation[a, b] > 0 else "add up"
                sentences.append(
                    f"{one} and {two} nearly {does} (correlation {correlation[a, b]:+.4f}): the "
                    "record sees their combination far better than either; fix one of them if "
                    "you know it."
                )
    return tuple(sentences)


_UNKNOWN: Final = 10.0
"""Relative standard deviation beyond which its figure says no more than that nothing is known."""


@final
@dataclass(frozen=True, eq=False)
class _Component:
    """Unknowns tied together by directions that hide below the residuals."""

    members: tuple[int, ...]
    directions: FloatArray
    """(directions, members), the largest entry of each 1."""
    spread: float
    """Relative standard deviation of a lone member."""
    exact: bool

    def sentence(self, names: list[str]) -> str:
        if len(names) == 1 and self.spread > _UNKNOWN:
            return f"{names[0]} is not seen: its standard deviation is many times its value."
        if len(names) == 1:
            return (
                f"{names[0]} is barely seen: its relative standard deviation is "
                f"{_percent(self.spread)}."
            )
        if len(self.directions) >= len(names):
            return (
                f"{_listed(names)} are not seen: no combination of them is, once offset, start "
                "and the other parameters are allowed to follow."
            )
        ways = "; or ".join(
            ", ".join(
                f"{name} {100.0 * part:+.0f} %"
                for name, part in zip(names, way, strict=True)
                if abs(part) > 0.05
            )
            for way in self.directions
        )
        how = "at all" if self.exact else "beyond the residuals"
        return (
            f"{_listed(names)} are redundant: only combinations of them are seen. Moving them "
            f"together ({ways}) does not change the reading {how}."
        )


def _hidden(seen: FloatArray, sigma: float) -> list[_Component]:
    """Directions with a relative standard deviation above one half, grouped by their members."""
    _, strength, rows = np.linalg.svd(seen, full_matrices=False)
    blind = [k for k in range(strength.size) if sigma > 0.5 * max(strength[k], 1e-300)]
    if not blind:
        return []
    space = _simplified(rows[blind])
    touched = np.abs(space) > 0.2
    groups: list[tuple[set[int], list[int]]] = []
    for k, row in enumerate(touched):
        members, lines = set(np.flatnonzero(row).tolist()), [k]
        apart = []
        for other, more in groups:
            if other & members:
                members |= other
                lines = more + lines
            else:
                apart.append((other, more))
        groups = [*apart, (members, lines)]
    # Relative standard deviation of each unknown: sigma |row of the pseudo-inverse|. A strength
    # below the rounding of the largest is none; 1e-150 is the smallest whose square is a number.
    least = np.finfo(np.float64).eps * strength[0] + 1e-150
    spread = sigma * np.sqrt(np.sum((rows / np.maximum(strength, least)[:, None]) ** 2, axis=0))
    exact = bool(strength[blind[0]] < 1e-6 * strength[0])
    return [
        _Component(tuple(sorted(m)), space[np.ix_(lines, sorted(m))], float(spread[min(m)]), exact)
        for m, lines in groups
    ]


def _simplified(rows: FloatArray) -> FloatArray:
    """The same space by rows with as many zeros as Gauss-Jordan elimination makes."""
    space = np.array(rows)
    done: list[int] = []
    for k in range(space.shape[0]):
        free = np.array([c not in done for c in range(space.shape[1])])
        column = int(np.argmax(np.where(free, np.abs(space[k]), -1.0)))
        space[k] /= space[k, column]
        for other in range(space.shape[0]):
            if other != k:
                space[other] -= space[other, column] * space[k]
        done.append(column)
    largest = np.abs(space).max(axis=1, keepdims=True)
    return np.asarray(space / np.where(largest > 0, largest, 1.0))


def _correlation(columns: FloatArray) -> FloatArray:
    inverse = np.linalg.pinv(columns.T @ columns, rcond=1e-15)
    size = np.sqrt(np.abs(np.diag(inverse)))
    # A column that vanishes leaves a zero in the pseudo-inverse: it correlates with nothing.
    size = np.where(size > 0.0, size, np.inf)
    return np.asarray(inverse / np.outer(size, size))


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %" if share < 10.0 else "over 1000 %"


def _listed(names: list[str]) -> str:
    return ", ".join(names[:-1]) + " and " + names[-1]
