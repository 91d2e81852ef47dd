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


def gram(j: FloatArray) -> FloatArray:
    """``J' J`` of a tall matrix (M, k).

    >>> gram(np.array([[1.0, 2.0], [3.0, 4.0]]))
    array([[10., 14.],
           [14., 20.]])
    """
    blocks, rest = _blocks(j)
    total = rest.T @ rest
    if blocks.size:
        total = total + np.matmul(blocks.transpose(0, 2, 1), blocks).sum(axis=0)
    return np.asarray(total)


def triangle(j: FloatArray) -> FloatArray:
    """The triangular factor R of ``J = Q R``, up to signs of its rows (tall-skinny QR).

    Source: Demmel, Grigori, Hoemmen & Langou (2012), SIAM J. Sci. Comput. 34(1), A206-A239.
    """
    blocks, rest = _blocks(j)
    if not blocks.size or j.shape[1] > _ROWS:
        return np.asarray(np.linalg.qr(j, mode="r"))
    tops = np.asarray(np.linalg.qr(blocks, mode="r")).reshape(-1, j.shape[1])
    return np.asarray(np.linalg.qr(np.vstack([tops, rest]), mode="r"))


def _blocks(j: FloatArray) -> tuple[FloatArray, FloatArray]:
    count = j.shape[0] // _ROWS
    whole = count * _ROWS
    return np.ascontiguousarray(j[:whole]).reshape(count, _ROWS, j.shape[1]), j[whole:]
