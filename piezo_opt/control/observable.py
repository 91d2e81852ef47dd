"""What no controller of a reading can do anything about, said before it is designed."""

from __future__ import annotations

from typing import Final

import control
import numpy as np
import scipy
from numpy.typing import NDArray

from piezo_opt.errors import InputError
from piezo_opt.units import show

FloatArray = NDArray[np.float64]

HIDDEN: Final = 1e-6
"""Smallest over largest singular value of [A - lambda; C] with rows and states of one size: below,
two poles are alike to a millionth, which no record tells apart."""
_TAKES_PART: Final = 0.1
"""Of the largest entry of the hidden direction: a state with less hardly belongs to it."""


def remarks(system: control.StateSpace) -> tuple[str, ...]:
    """A sentence where the reading hides a state of the model.

    A hidden state that dies out by itself does no harm to a loop of the reading.

    Raises:
        InputError: a model that runs away by itself at a constant drive.
    """
    poles = np.linalg.eigvals(np.asarray(system.A))
    fastest = poles[np.argmax(poles.real)] if poles.size else 0.0
    if poles.size and fastest.real > 1e-9 * abs(fastest):
        raise InputError(
            "The model runs away by itself at a constant drive, e-fold in "
            f"{show(1.0 / float(fastest.real), 's')}: bound the parameters that do it, or leave "
            "their effect out."
        )
    names = unseen(system)
    if not names:
        return ()
    if len(names) == 1:
        return (
            f"The reading does not show {names[0]}: what it does is neither estimated nor "
            "controlled, and the design stands without it.",
        )
    return (
        f"The reading does not show {', '.join(names[:-1])} and {names[-1]} one by one: the design "
        "stands on what it shows of them together, and a model without one of them does the same.",
    )


def unseen(system: control.StateSpace) -> tuple[str, ...]:
    """Names of states of which the reading shows nothing, or only a sum.

    A direction v is hidden where A v = lambda v and C v = 0 (Popov, Belevitch, Hautus). States are
    measured by how far the drive moves them, rows by their largest entry.

    Source: Kailath (1980), Linear Systems, sec. 6.2.
    """
    a, b, c = (np.asarray(one, dtype=float) for one in (system.A, system.B, system.C))
    if not a.size:
        return ()
    size = _moved(a, b)
    a, c = a * size / size[:, np.newaxis], c * size
    c = c / (np.abs(c).max() or 1.0)
    hidden: set[int] = set()
    for pole in np.linalg.eigvals(a):
        rows = a - pole * np.eye(a.shape[0])
        scale = np.maximum(np.abs(a).max(axis=1), abs(pole))
        whole = np.vstack([rows / np.where(scale > 0.0, scale, 1.0)[:, np.newaxis], c])
        _, sigma, right = np.linalg.svd(whole)
        if sigma[-1] <= HIDDEN * sigma[0]:
            part = np.abs(right[-1])
            hidden |= set(np.flatnonzero(part > _TAKES_PART * part.max()).tolist())
    return tuple(str(system.state_labels[k]) for k in sorted(hidden))


def _moved(a: FloatArray, b: FloatArray) -> FloatArray:
    """How far the drive moves each state; 1 where it does not, or the model does not forget."""
    poles = np.linalg.eigvals(a)
    if poles.real.max() > -1e-9 * np.abs(poles).max():
        return np.ones(a.shape[0])
    spread = np.diag(scipy.linalg.solve_continuous_lyapunov(a, -b @ b.T))
    size = np.sqrt(np.maximum(spread, 0.0))
    return np.asarray(np.where(size > 0.0, size, 1.0))
