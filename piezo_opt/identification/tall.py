"""Products and factors of tall matrices, block by block.

A Jacobian has thousands of rows and ten columns. Multithreaded BLAS takes longer to wake its
threads for such a product than the product takes, many times longer on a busy machine; blocks
below its threshold stay in one thread.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_ROWS = 256
_AT_ONCE = 256 * _ROWS
"""Rows that are copied at a time: the whole of a million rows would be in memory twice."""
_ALONE = 8192
"""Samples of which OpenBLAS takes an inner product in one thread (from 10,000 on in all)."""


def inner(a: FloatArray, b: FloatArray) -> float:
    """``a' b`` of two vectors (M,).

    >>> inner(np.array([1.0, 2.0]), np.array([3.0, 4.0]))
    11.0
    """
    parts = range(0, a.size, _ALONE)
    return sum(float(a[start : start + _ALONE] @ b[start : start + _ALONE]) for start in parts)


def across(j: FloatArray, k: FloatArray) -> FloatArray:
    """``J' K`` of two tall matrices (M, p) and (M, q).

    >>> across(np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([[1.0], [1.0]]))
    array([[4.],
           [6.]])
    """
    total = np.zeros((j.shape[1], k.shape[1]))
    for start in range(0, j.shape[0], _AT_ONCE):
        blocks, rest = _blocks(j[start : start + _AT_ONCE])
        others, last = _blocks(k[start : start + _AT_ONCE])
        total += rest.T @ last
        if blocks.size:
            total += np.matmul(blocks.transpose(0, 2, 1), others).sum(axis=0)
    return total


def normal_equations(j: FloatArray, r: FloatArray) -> tuple[FloatArray, FloatArray]:
    """``J'r`` (k,) and ``J'J`` (k, k); not finite where the squares are not."""
    with np.errstate(over="ignore", invalid="ignore"):
        return across(j, r[:, None])[:, 0], across(j, j)


def triangle(j: FloatArray) -> FloatArray:
    """The triangular factor R of ``J = Q R`` (M, k), up to signs of its rows (tall-skinny QR).

    Source: Demmel, Grigori, Hoemmen & Langou (2012), SIAM J. Sci. Comput. 34(1), A206-A239.
    """
    width = j.shape[1]
    if j.shape[0] < _ROWS or width > _ROWS:
        return np.asarray(np.linalg.qr(j, mode="r"))
    tops: list[FloatArray] = []
    for start in range(0, j.shape[0], _AT_ONCE):
        blocks, rest = _blocks(j[start : start + _AT_ONCE])
        if blocks.size:
            tops.append(np.asarray(np.linalg.qr(blocks, mode="r")).reshape(-1, width))
        tops.append(rest)
    return np.asarray(np.linalg.qr(np.vstack(tops), mode="r"))


def _blocks(j: FloatArray) -> tuple[FloatArray, FloatArray]:
    count = j.shape[0] // _ROWS
    whole = count * _ROWS
    return np.ascontiguousarray(j[:whole]).reshape(count, _ROWS, j.shape[1]), j[whole:]
