"""Where to begin: sections are added one at a time where they explain most of what is left."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.linear_models.cascade import Cascade
from piezo_opt.linear_models.question import LinearQuestion
from piezo_opt.linear_models.refining import Poles, limits, refined, rescaled
from piezo_opt.linear_models.responses import Prepared, columns
from piezo_opt.measurement import FloatArray

Rows = NDArray[np.intp]

_A_DECADE: Final = 12
"""Trial frequencies a decade: 21 % apart, within the half width of the second damping below."""
_DAMPINGS: Final = (0.03, 0.2, 0.7, 3.0)
"""Damping ratios of the trial sections; the last one is a pair of real poles 34 times apart."""
_ROWS: Final = 3000
"""Samples on which trials are ranked; more rank them no better."""
_WIDTH: Final = 3
"""Chains that are kept at each order."""
_TRIES: Final = 2
"""Sections that are tried on each chain."""
_HASTE: Final = 25
"""Evaluations of a refinement that only ranks."""
_APART: Final = 0.25
"""Relative difference of frequency from which two trials are two."""


@final
@dataclass(frozen=True, eq=False)
class _Trial:
    """A section that may be added, and its columns orthonormal on the ranked rows."""

    order: int
    rate: float
    damping: float
    columns: FloatArray


def chains(
    question: LinearQuestion, records: tuple[Prepared, ...], orders: Iterable[int]
) -> Iterator[tuple[int, list[Poles]]]:
    """Orders up to these, ascending, and the best chains found, best first, with n - 1 zeros.

    Each is sought when it is asked for. Even orders grow by sections of second order; an odd one is
    the even one below it and a first order section.
    """
    rows = _rows(records)
    most = max(orders)
    needed = {*orders, *range(2, most + 1, 2)}
    pairs = _trials(question, records, rows, 2) if most > 1 else []
    lone = _trials(question, records, rows, 1) if any(n % 2 for n in needed) else []
    found: dict[int, list[Poles]] = {}
    empty = Cascade((), np.zeros(0), question.stable)
    for n in sorted(needed):
        order = 2 if n % 2 == 0 else 1
        below: list[Poles | None] = [*found[n - order]] if n > order else [None]
        asked = question.with_order(n, n - 1)
        grown: list[Poles] = []
        for chain in below:
            before = empty if chain is None else chain.cascade
            p = np.zeros(0) if chain is None else chain.p
            for trial in _best(question, records, rows, chain, pairs if order == 2 else lone):
                longer = before.followed_by(order, trial.rate)
                damping = 2.0 * trial.damping
                q = np.array([1.0, damping][:order])
                begin = np.concatenate([p, np.log(q) if question.stable else q])
                grown.append(
                    rescaled(
                        refined(asked, records, longer, begin, patience=_HASTE, tolerance=1e-6)
                    )
                )
        grown.sort(key=lambda one: one.cost)
        found[n] = _different(grown)[:_WIDTH]
        yield n, found[n]


def _rows(records: tuple[Prepared, ...]) -> list[Rows]:
    """Indices of the ranked samples of each record, irregular so that none is aliased."""
    chance = np.random.default_rng(0)
    counted: list[Rows] = [np.flatnonzero(one.counted) for one in records]
    share = min(1.0, _ROWS / sum(one.size for one in counted))
    if share == 1.0:
        return counted
    return [
        np.sort(chance.choice(one, max(4, round(share * one.size)), replace=False))
        for one in counted
    ]


def _trials(
    question: LinearQuestion, records: tuple[Prepared, ...], rows: list[Rows], order: int
) -> list[_Trial]:
    several = question.records.records
    slow = np.pi / max(one.duration for one in several)
    fast = 0.95 * np.pi / min(one.step for one in several)
    count = max(2, round(_A_DECADE * np.log10(fast / slow)))
    single = question.with_order(order, order - 1)
    trials = []
    for rate in np.geomspace(slow, fast, count):
        for damping in _DAMPINGS if order == 2 else (1.0,):
            cascade = Cascade((order,), np.array([rate]), True)
            p = np.log(np.array([1.0, 2.0 * damping][:order]))
            made = [columns(one, cascade, p, single, slopes=False) for one in records]
            shared = np.vstack([one.shared[k] for one, k in zip(made, rows, strict=True)])
            own = _diagonal([one.own[k] for one, k in zip(made, rows, strict=True)])
            block = np.hstack([shared, own])
            size = np.linalg.norm(block, axis=0)
            size[size == 0.0] = 1.0
            trials.append(_Trial(order, float(rate), damping, block / size))
    return trials


def _diagonal(blocks: list[FloatArray]) -> FloatArray:
    """Blocks one below and beside the other."""
    if len(blocks) == 1:
        return blocks[0]
    made = np.zeros((sum(len(b) for b in blocks), sum(b.shape[1] for b in blocks)))
    row = column = 0
    for block in blocks:
        made[row : row + len(block), column : column + block.shape[1]] = block
        row, column = row + len(block), column + block.shape[1]
    return made


def _best(
    question: LinearQuestion,
    records: tuple[Prepared, ...],
    rows: list[Rows],
    chain: Poles | None,
    trials: list[_Trial],
) -> list[_Trial]:
    """The trials that explain most of what a chain leaves over, no two at one frequency."""
    reading = np.concatenate([one.reading[k] for one, k in zip(records, rows, strict=True)])
    known = [_diagonal([one.trend[k] for one, k in zip(records, rows, strict=True)])]
    if chain is not None:
        asked = question.with_order(chain.cascade.order, chain.cascade.order - 1)
        made = [columns(one, chain.cascade, chain.p, asked, slopes=False) for one in records]
        known.append(np.vstack([one.shared[k] for one, k in zip(made, rows, strict=True)]))
        known.append(_diagonal([one.own[k] for one, k in zip(made, rows, strict=True)]))
    basis = _orthonormal(np.hstack(known))
    left = reading - basis @ (basis.T @ reading)
    explained = []
    for trial in trials:
        extra = _orthonormal(trial.columns - basis @ (basis.T @ trial.columns))
        explained.append(float(np.sum((extra.T @ left) ** 2)))
    chosen: list[_Trial] = []
    for k in np.argsort(explained)[::-1]:
        one = trials[k]
        if all(abs(np.log(one.rate / other.rate)) > _APART for other in chosen):
            chosen.append(one)
        if len(chosen) == (_TRIES if chain is not None else _WIDTH):
            break
    return chosen


def _orthonormal(matrix: FloatArray) -> FloatArray:
    """An orthonormal basis of the columns, without those that rounding gives."""
    if matrix.shape[1] == 0:
        return matrix
    u, sigma, _ = np.linalg.svd(matrix, full_matrices=False)
    return np.asarray(u[:, sigma > 1e-9 * max(float(sigma[0]), 1.0)])


def _different(chains: list[Poles]) -> list[Poles]:
    """Without chains that ended at the same sum of squares as a better one."""
    kept: list[Poles] = []
    for one in chains:
        if all(abs(one.cost - other.cost) > 1e-3 * other.cost for other in kept):
            kept.append(one)
    return kept


def best_from(
    question: LinearQuestion, records: tuple[Prepared, ...], begins: list[Poles]
) -> Poles:
    """The best fit of the question's own numbers of zeros, from each of these chains."""
    best: Poles | None = None
    for begin in begins:
        one = refined(question, records, begin.cascade, begin.p)
        total = one.evaluations + (0 if best is None else best.evaluations)
        if best is None or one.cost < best.cost:
            best = one
        best = Poles(best.cascade, best.p, best.point, total, best.converged)
    assert best is not None
    return best


def lengthened(question: LinearQuestion, chain: Poles) -> Poles:
    """A chain with one more pole, so fast that it changes next to nothing."""
    _, fast = limits(question)
    longer = chain.cascade.followed_by(1, 0.5 * fast)
    one = 0.0 if question.stable else 1.0
    return replace(chain, cascade=longer, p=np.append(chain.p, one))
