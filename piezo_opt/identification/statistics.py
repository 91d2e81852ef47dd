"""How sure: covariance, and what the data cannot see."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from piezo_opt.simulation import INITIAL

FloatArray = NDArray[np.float64]


@final
@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Covariance of the unknowns and whether it allows for correlated residuals."""

    covariance: FloatArray
    coloured: bool


def uncertainty(
    residual: FloatArray, jacobian: FloatArray, free: NDArray[np.bool_], samples: int
) -> Uncertainty:
    """Covariance of least squares at its minimum.

        C = sigma^2 (J'J)^-1                        residuals white
        C = (J'J)^-1 (sum_k w_k J'_t r_t r_(t+k) J_(t+k)) (J'J)^-1    residuals correlated

    White noise is judged by the Ljung-Box test over 20 lags at 0.1 %; otherwise Newey and West's
    estimate with Bartlett weights w_k is taken. Rows of unknowns at a bound are NaN: they have no
    two-sided interval.

    Args:
        residual: (M,), the first ``samples`` in the order of time.
        jacobian: (M, k), columns scaled so that they are of similar size.
        free: (k,) unknowns not at a bound.
        samples: rows that are samples (the rest are priors).

    Sources: Seber & Wild (2003), Nonlinear Regression, ch. 2; Newey & West (1987),
    Econometrica 55(3), 703-708; Ljung & Box (1978), Biometrika 65(2), 297-303.
    """
    k = jacobian.shape[1]
    covariance = np.full((k, k), np.nan)
    index = np.flatnonzero(free)
    if index.size == 0:
        return Uncertainty(covariance, False)
    j = jacobian[:, index]
    _, size, vt = np.linalg.svd(j, full_matrices=False)
    safe = np.maximum(size, 1e-12 * size.max(initial=0.0) + 1e-300)
    inverse = (vt.T / safe**2) @ vt
    r = residual[:samples]
    dof = max(1, samples - index.size)
    coloured = _coloured(r)
    if coloured:
        score = j[:samples] * r[:, None]
        lags = int(np.ceil(4.0 * (samples / 100.0) ** (2.0 / 9.0))) + _memory(r)
        lags = min(lags, samples // 4)
        middle = score.T @ score
        for lag in range(1, lags + 1):
            cross = score[lag:].T @ score[:-lag]
            middle += (1.0 - lag / (lags + 1.0)) * (cross + cross.T)
        own = inverse @ middle @ inverse * (samples / dof)
        white = inverse * float(r @ r) / dof
        # Misfit that happens to cancel must not make the estimate look surer than white noise.
        if np.all(np.diag(own) > 0):
            lift = np.sqrt(np.maximum(1.0, np.diag(white) / np.diag(own)))
            own = own * np.outer(lift, lift)
        else:
            own = white
        covariance[np.ix_(index, index)] = own
    else:
        covariance[np.ix_(index, index)] = inverse * float(r @ r) / dof
    return Uncertainty(covariance, coloured)


def _autocorrelation(r: FloatArray, lags: int) -> FloatArray:
    centred = r - r.mean()
    power = float(centred @ centred) or 1.0
    return np.array([float(centred[k:] @ centred[:-k]) / power for k in range(1, lags + 1)])


def _coloured(r: FloatArray) -> bool:
    n = r.size
    lags = min(20, n // 4)
    if lags < 1:
        return False
    rho = _autocorrelation(r, lags)
    q = n * (n + 2) * float(np.sum(rho**2 / (n - np.arange(1, lags + 1))))
    return bool(q > stats.chi2.ppf(0.999, lags))


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
    residual: FloatArray,
    jacobian: FloatArray,
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
    relative = jacobian * size
    norms = np.linalg.norm(relative, axis=0)
    dof = max(1, residual.size - theta.size)
    sigma = float(np.sqrt(residual @ residual / dof)) or 1e-300
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
    seen = relative[:, usable]
    if others:
        basis, _ = np.linalg.qr(relative[:, others] / norms[others])
        seen = seen - basis @ (basis.T @ seen)
    _, strength, directions = np.linalg.svd(seen, full_matrices=False)
    for value, direction in zip(strength[::-1], directions[::-1], strict=True):
        spread = sigma / max(value, 1e-300)
        if spread < 0.5:
            break
        top = np.abs(direction).max()
        parts = [i for i in range(len(usable)) if abs(direction[i]) > 0.2 * top]
        members = [names[usable[i]] for i in parts]
        if len(members) == 1:
            sentences.append(
                f"{members[0]} is barely seen: its relative standard deviation is "
                f"{_percent(spread)}."
            )
        else:
            exact = value < 1e-6 * strength[0]
            moves = ", ".join(
                f"{names[usable[i]]} {100.0 * direction[i] / top * np.sign(direction[parts[0]]):+.0f} %"
                for i in parts
            )
            how = "at all" if exact else "beyond the residuals"
            sentences.append(
                f"{_listed(members)} are redundant: only combinations of them are seen. Moving "
                f"them together ({moves}) does not change the reading {how}."
            )
        told.update(members)
    correlation = _correlation(seen)
    for a in range(len(usable)):
        for b in range(a + 1, len(usable)):
            one, two = names[usable[a]], names[usable[b]]
            if abs(correlation[a, b]) > 0.98 and not {one, two} <= told:
                does = "cancel" if correlation[a, b] > 0 else "add up"
                sentences.append(
                    f"{one} and {two} nearly {does} (correlation {correlation[a, b]:+.4f}): the "
                    "record sees their combination far better than either; fix one of them if "
                    "you know it."
                )
    return tuple(sentences)


def _correlation(columns: FloatArray) -> FloatArray:
    inverse = np.linalg.pinv(columns.T @ columns, rcond=1e-15)
    size = np.sqrt(np.abs(np.diag(inverse)))
    return np.asarray(inverse / np.outer(size, size))


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %" if share < 10.0 else "over 1000 %"


def _listed(names: list[str]) -> str:
    return ", ".join(names[:-1]) + " and " + names[-1]
