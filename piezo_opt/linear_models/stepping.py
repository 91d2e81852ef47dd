"""Exact steps of a linear system from sample to sample, whatever the clock."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final, final

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from piezo_opt.measurement import Between, FloatArray, Measurement

_FEW: Final = 24
"""Different steps up to which each gets matrix exponentials of its own."""
_NODES: Final = 48
"""Chebyshev nodes for exp(A h) over one octave of h. The entire function exp(i w h) with |w h| up
to 10 pi at the octave's upper end turns by 2.5 pi to either side of its middle; the coefficients
J_k(2.5 pi) are below 1e-16 from k = 34 on."""
_EVEN: Final = 1e-6
"""Relative spread of the steps below which the clock counts as even: clocks are printed to about as
many digits."""
_TERMS: Final = 18
"""Terms of the exponential series."""
_FINER: Final = 8
"""Straight pieces a sample of a band-limited drive."""


@final
@dataclass(frozen=True, eq=False)
class Steps:
    """Instants and drive of a record as straight or held pieces.

    Args:
        step: (M - 1,) lengths h of the pieces [s].
        drive: (M,) drive at their ends.
        held: whether the drive is constant on a piece; else it is straight.
        every: the record's samples are each ``every``-th end.
    """

    step: FloatArray
    drive: FloatArray
    held: bool
    every: int = 1

    @staticmethod
    def of(record: Measurement, drive: FloatArray | None = None) -> Steps:
        """The pieces of a record; a band-limited drive is refined by Fourier interpolation."""
        values = record.drive if drive is None else drive
        clock = np.diff(record.time)
        if np.ptp(clock) <= _EVEN * record.step or record.uniform:
            clock = np.full(len(record) - 1, record.step)
        if record.between is not Between.BANDLIMITED:
            return Steps(clock, values, record.between is Between.HELD)
        from scipy import signal

        # A straight line taken out keeps the ends of an aperiodic drive from ringing.
        n = len(record)
        ramp = np.linspace(values[0], values[-1], n)
        if record.period is not None:
            ramp = np.zeros(n)
        fine = signal.resample(values - ramp, n * _FINER)[: (n - 1) * _FINER + 1]
        base = np.interp(np.arange(fine.size) / _FINER, np.arange(n), ramp)
        return Steps(np.repeat(clock / _FINER, _FINER), fine + base, False, _FINER)

    @cached_property
    def even(self) -> bool:
        """Whether all pieces are equally long."""
        return bool(np.ptp(self.step) <= _EVEN * float(np.median(self.step)))

    def along(
        self, a: FloatArray, b: FloatArray, da: FloatArray, start: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """States and their exact derivatives with respect to what A depends on.

            x' = A x + B u,    s_p' = A s_p + (dA/dp) x,    s_p(0) = 0 unless given in ``start``

        Args:
            a, b: (n, n) and (n,); b of zeros for a free response.
            da: (n, n, q) dA/dp.
            start: (n, 1 + q) x(0) and s(0).

        Returns:
            x (N, n) and s (N, n, q) at the record's samples.
        """
        n, q = a.shape[0], da.shape[2]
        transition, first, second = self._exponentials(a, b, da)
        before, after = self.drive[:-1], self.drive[1:]
        # x_(i+1) = F x_i + g u_i + k (u_(i+1) - u_i), and the same differentiated.
        now, change = before[:, None], (after - before)[:, None]
        forced = first[..., 0] * now + second[..., 0] * change
        x = self._march(transition[..., 0], forced[..., None], start[:, :1])[..., 0]
        if q == 0:
            return x[:: self.every], np.zeros((x[:: self.every].shape[0], n, 0))
        driven = np.einsum("...abq,...b->...aq", transition[..., 1:], x[:-1])
        driven = driven + first[..., 1:] * now[..., None] + second[..., 1:] * change[..., None]
        s = self._march(transition[..., 0], driven, start[:, 1:])
        return x[:: self.every], s[:: self.every]

    def _exponentials(
        self, a: FloatArray, b: FloatArray, da: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """F (.., n, n, 1 + q), g and k (.., n, 1 + q): one of each for even steps, else M - 1."""
        if self.even:
            return _of_lengths(np.array([float(np.median(self.step))]), a, b, da, self.held)
        lengths, which = np.unique(self.step, return_inverse=True)
        if lengths.size > _FEW:
            f, g, k = _interpolated(lengths, a, b, da, self.held)
        else:
            f, g, k = _of_lengths(lengths, a, b, da, self.held)
        return f[which], g[which], k[which]

    def _march(self, transition: FloatArray, forced: FloatArray, start: FloatArray) -> FloatArray:
        """x_(i+1) = F_i x_i + w_i for several columns at once: (M, n, columns)."""
        if transition.shape[0] == 1:
            return _filtered(transition[0], forced, start)
        return _scanned(transition, forced, start)


def exponential(matrices: FloatArray) -> FloatArray:
    """exp of a stack of small matrices (..., k, k), by scaling, Taylor series and squaring.

    Scaled to a norm of at most 1 the series ends at 1/19!, below rounding. All matrices of the
    stack are scaled alike. ``scipy.linalg.expm`` takes them one by one.

    Source: Moler & Van Loan (2003), SIAM Rev. 45, 3-49, method 3.
    """
    largest = float(np.abs(matrices).sum(axis=-2).max())
    halvings = max(0, int(np.ceil(np.log2(largest)))) if largest > 0.0 else 0
    scaled = matrices / 2.0**halvings
    unit = np.broadcast_to(np.eye(matrices.shape[-1]), matrices.shape)
    total = unit + scaled / _TERMS
    for term in range(_TERMS - 1, 0, -1):
        total = unit + scaled @ total / term
    for _ in range(halvings):
        total = total @ total
    return total


def _of_lengths(
    lengths: FloatArray, a: FloatArray, b: FloatArray, da: FloatArray, held: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """F, g, k and their derivatives for each length h, from exponentials of block matrices.

    exp([[A, B, 0], [0, 0, 1/h], [0, 0, 0]] h) holds F, g and k; exp([[X, dX], [0, X]] h) holds the
    derivative of exp(X h) in its corner.

    Source: Van Loan (1978), IEEE Trans. Autom. Control 23, 395-404; Najfeld & Havel (1995), Adv.
    Appl. Math. 16, 321-375.
    """
    n, q = a.shape[0], da.shape[2]
    size = n + 2
    whole = np.zeros((lengths.size, size, size))
    h = lengths[:, None]
    whole[:, :n, :n], whole[:, :n, n] = a * h[:, None], b * h
    whole[:, n, n + 1] = 0.0 if held else 1.0
    if q == 0:
        made = exponential(whole)[:, None]
    else:
        stacked = np.zeros((lengths.size, q, 2 * size, 2 * size))
        stacked[..., :size, :size] = stacked[..., size:, size:] = whole[:, None]
        stacked[..., :n, size : size + n] = np.moveaxis(da, 2, 0) * h[:, None, None]
        both = exponential(stacked)
        made = np.concatenate([both[:, :1, :size, :size], both[:, :, :size, size:]], axis=1)
    made = np.moveaxis(made, 1, -1)
    f, g, k = made[:, :n, :n], made[:, :n, n], made[:, :n, n + 1]
    return f, g, k


def _interpolated(
    lengths: FloatArray, a: FloatArray, b: FloatArray, da: FloatArray, held: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """As :func:`_of_lengths` for many lengths: by Chebyshev interpolation over each octave."""
    n, q = a.shape[0], da.shape[2]
    f = np.zeros((lengths.size, n, n, 1 + q))
    g, k = np.zeros((lengths.size, n, 1 + q)), np.zeros((lengths.size, n, 1 + q))
    octave = np.floor(np.log2(lengths / lengths[0]) + 1e-12)
    for one in np.unique(octave):
        own = octave == one
        mine = lengths[own]
        if mine.size <= _FEW:
            f[own], g[own], k[own] = _of_lengths(mine, a, b, da, held)
            continue
        middle, half = 0.5 * (mine[0] + mine[-1]), 0.5 * float(np.ptp(mine))
        nodes = chebyshev.chebpts1(_NODES)
        inner = chebyshev.chebvander(nodes, _NODES - 1)
        outer = chebyshev.chebvander((mine - middle) / half, _NODES - 1)
        weights = outer @ np.linalg.inv(inner)
        for target, sampled in zip(
            (f, g, k), _of_lengths(middle + half * nodes, a, b, da, held), strict=True
        ):
            target[own] = np.tensordot(weights, sampled, axes=1)
    return f, g, k


def _filtered(transition: FloatArray, forced: FloatArray, start: FloatArray) -> FloatArray:
    """Even steps: first-order recursions along a complex Schur form, from its last row up."""
    from scipy import linalg, signal

    n = transition.shape[0]
    triangle, basis = linalg.schur(transition, output="complex")
    inputs: NDArray[np.complex128] = basis.conj().T @ forced
    begin = basis.conj().T @ start
    state = np.zeros((forced.shape[0] + 1, n, forced.shape[2]), dtype=np.complex128)
    for row in range(n - 1, -1, -1):
        w = inputs[:, row] + triangle[row, row + 1 :] @ state[:-1, row + 1 :]
        state[0, row] = begin[row]
        own = triangle[row, row]
        state[1:, row], _ = signal.lfilter(
            [1.0], [1.0, -own], w, axis=0, zi=(own * begin[row])[None, :]
        )
    return np.asarray((basis @ state).real)


def _scanned(transition: FloatArray, forced: FloatArray, start: FloatArray) -> FloatArray:
    """Uneven steps: about sqrt(M) stretches side by side, then their starts one after another."""
    count, n, columns = forced.shape[0], transition.shape[1], forced.shape[2]
    length = max(1, int(np.sqrt(count)))
    stretches = -(-count // length)
    padding = stretches * length - count
    f = np.concatenate([transition, np.broadcast_to(np.eye(n), (padding, n, n))])
    w = np.concatenate([forced, np.zeros((padding, n, columns))])
    f, w = f.reshape(stretches, length, n, n), w.reshape(stretches, length, n, columns)
    whole = np.broadcast_to(np.eye(n), (stretches, n, n)).copy()
    own = np.zeros((stretches, n, columns))
    products, zero_state = np.empty_like(f), np.empty_like(w)
    for i in range(length):
        whole = f[:, i] @ whole
        own = f[:, i] @ own + w[:, i]
        products[:, i], zero_state[:, i] = whole, own
    begins = np.empty((stretches, n, columns))
    begins[0] = start
    for one in range(1, stretches):
        begins[one] = products[one - 1, -1] @ begins[one - 1] + zero_state[one - 1, -1]
    state = products @ begins[:, None] + zero_state
    return np.concatenate([start[None], state.reshape(-1, n, columns)[:count]])
