"""The verbs: fit one order, or search for the order that predicts best."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np

from piezo_opt.choosing import expected, whole, words
from piezo_opt.comparison import Metrics
from piezo_opt.comparison.metrics import measure
from piezo_opt.errors import InputError
from piezo_opt.identification import Start
from piezo_opt.linear_models.question import Detrend, LinearQuestion
from piezo_opt.linear_models.refining import Poles
from piezo_opt.linear_models.responses import Prepared, Scale
from piezo_opt.linear_models.starting import best_from, chains, lengthened
from piezo_opt.linear_models.transfer import TransferFit, predicted, result
from piezo_opt.measurement import Between, Campaign, Measurement

Records = Measurement | Iterable[Measurement] | Campaign

SEARCH_SCHEMA: Final = "piezo_opt.linear_orders/1"


def fit_transfer(
    records: Records,
    poles: int,
    zeros: int | None = None,
    *,
    stable: bool = True,
    start: Start = Start.FREE,
    detrend: Detrend = Detrend.OFFSET,
) -> TransferFit:
    """Fit a continuous-time transfer function by output error.

        minimise over a, b, x(0), offset:  sum (y(t_i) - G(s) u - free response - offset)^2

    The steps from sample to sample are exact for the record's own clock and for what it says the
    drive does between samples (``between``: held, straight, band-limited). At given poles all the
    rest is linear and is solved for; the poles move by a trust region with exact derivatives.

    Args:
        records: a record or several of one actuator.
        poles: n.
        zeros: m; by default n - 1.
        stable: whether every pole stays in the left half plane.
        start: whether the initial state is estimated (FREE) or in equilibrium (REST).
        detrend: what of the reading is not the system's.

    Raises:
        InputError: see :class:`LinearQuestion`.

    Source: Golub & Pereyra (2003), Inverse Problems 19, R1-R26; Ljung (1999), ch. 4 and 7.
    """
    question = LinearQuestion(records, poles, zeros, stable=stable, start=start, detrend=detrend)
    return _Fitter(question, [(question.poles, question.zeros)]).fit(question.poles, question.zeros)


@final
class _Fitter:
    """One question's records, prepared once, and what was found for each order."""

    def __init__(self, question: LinearQuestion, orders: Iterable[tuple[int, int]]) -> None:
        self._question = question
        self._scale = Scale.of(question)
        self._records = tuple(
            Prepared.of(one, question, self._scale) for one in question.records.records
        )
        needed = {k for n, m in orders for k in range(min(m + 1, n), n + 1)}
        self._growing = chains(question, self._records, needed)
        self._chains: dict[int, list[Poles]] = {}
        self._found: dict[tuple[int, int], Poles] = {}

    def fit(self, poles: int, zeros: int) -> TransferFit:
        """The best fit of this order."""
        question = self._question.with_order(poles, zeros)
        return result(question, self._best(poles, zeros), self._scale)

    def _best(self, poles: int, zeros: int) -> Poles:
        known = self._found.get((poles, zeros))
        if known is None:
            question = self._question.with_order(poles, zeros)
            while poles not in self._chains:
                order, found = next(self._growing)
                self._chains[order] = found
            begins = list(self._chains[poles])
            # Chains are found with n - 1 zeros; with fewer, one pole less is a start, too.
            if poles > zeros + 1:
                begins.append(lengthened(question, self._best(poles - 1, zeros)))
            known = best_from(question, self._records, begins)
            self._found[poles, zeros] = known
        return known


@final
@dataclass(frozen=True, eq=False)
class OrderRow:
    """One order that was tried: its fit, and its error on the test records if there are any."""

    fit: TransferFit
    test: Metrics | None

    @property
    def judged(self) -> float:
        """What the order is judged by: the test's mean squared error, else Akaike's FPE."""
        if self.test is not None:
            return self.test.mse
        return float("inf") if self.fit.metrics.fpe is None else self.fit.metrics.fpe


@final
@dataclass(frozen=True, eq=False)
class OrderSearch:
    """All orders that were tried, and the one to take.

    Attributes:
        rows: one an order.
        interrupted: whether Ctrl-C or a limit of time left orders untried.
    """

    rows: tuple[OrderRow, ...]
    interrupted: bool = False

    @property
    def best(self) -> TransferFit:
        """The smallest order that predicts as well as the best one.

        As well: its mean squared test error is within one standard error of the smallest,
        MSE sqrt(2 / N) for N samples. Without test records by FPE, alike.

        Source: Breiman et al. (1984), Classification and Regression Trees, sec. 3.4 (one standard
        error).
        """
        return self.chosen.fit

    @property
    def chosen(self) -> OrderRow:
        """The row of :attr:`best`."""
        least = min(self.rows, key=lambda row: row.judged)
        counted = least.fit.metrics if least.test is None else least.test
        enough = least.judged * (1.0 + float(np.sqrt(2.0 / counted.samples)))
        near = [row for row in self.rows if row.judged <= enough]
        return min(near, key=lambda row: (_size(row), row.judged))

    def __str__(self) -> str:
        from piezo_opt.linear_models.telling import order_table

        return order_table(self)

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units."""
        return {
            "schema": SEARCH_SCHEMA,
            "orders": [
                {
                    "poles": row.fit.question.poles,
                    "zeros": row.fit.question.zeros,
                    "metrics": row.fit.metrics.to_dict(),
                    "test": None if row.test is None else row.test.to_dict(),
                }
                for row in self.rows
            ],
            "interrupted": self.interrupted,
            "best": self.best.to_dict(),
        }


def _size(row: OrderRow) -> int:
    return row.fit.question.poles + row.fit.question.zeros


def search_orders(
    records: Records,
    *,
    test: Records | None = None,
    poles: Iterable[int] = (1, 2, 3, 4),
    zeros: Iterable[int] | None = None,
    stable: bool = True,
    start: Start = Start.FREE,
    detrend: Detrend = Detrend.OFFSET,
    progress: Callable[[str], None] | None = None,
) -> OrderSearch:
    """Fit every order asked for and judge each on records that it has not seen.

    Ctrl-C gives the orders that were finished.

    Args:
        records: to fit to.
        test: to judge on; only start and offset are estimated there. Without them Akaike's final
            prediction error judges.
        poles, zeros: numbers to try; by default all zeros below the number of poles, and as many as
            poles under a held drive, which a reading may follow within the sample.
        stable, start, detrend: as in :func:`fit_transfer`.
        progress: told which order is next.

    Raises:
        InputError: no order is left, or see :class:`LinearQuestion`.
    """
    for what, numbers in (("poles", poles), ("zeros", zeros or ())):
        words(numbers, what)
        expected(Iterable, numbers, what, "a tuple of numbers, (1, 2)")
    several = sorted(set(poles))
    for number in several:
        whole(number, "A number of poles", 0)
    if several and several[0] < 1:
        raise InputError(f"a transfer function needs at least one pole, not {several[0]}")
    held = any(one.between is Between.HELD for one in Campaign.of(records).records)
    allowed = None if zeros is None else sorted(set(zeros))
    asked = [
        (n, m)
        for n in several
        for m in (range(n + held) if allowed is None else allowed)
        if 0 <= m <= n
    ]
    if not asked:
        raise InputError("no order is left to try: give numbers of zeros up to those of poles")
    most = max(n for n, _ in asked)
    question = LinearQuestion(records, most, most - 1, stable=stable, start=start, detrend=detrend)
    fitter = _Fitter(question, asked)
    rows: list[OrderRow] = []
    try:
        for number, (n, m) in enumerate(asked, start=1):
            if progress is not None:
                progress(f"order {number} of {len(asked)}: {n} poles and {m} zeros")
            fit = fitter.fit(n, m)
            judged = None
            if test is not None:
                judged = measure(predicted(fit, test), 0, held_out=True)
            rows.append(OrderRow(fit, judged))
    except KeyboardInterrupt:
        if not rows:
            raise
    return OrderSearch(tuple(rows), len(rows) < len(asked))
