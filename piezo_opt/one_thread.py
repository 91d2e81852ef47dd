"""Linear algebra that keeps to one thread, where work is shared by threads of ours."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from threadpoolctl import threadpool_limits


@contextmanager
def one_thread() -> Iterator[None]:
    """A context, or a decorator, in which products and factors are computed in one thread each.

    OpenBLAS shares an inner product of more than 10,000 samples out to all cores, which takes
    longer to begin than the product takes, and a thousand times longer where they are busy.
    """
    with threadpool_limits(limits=1, user_api="blas"):
        yield
