"""Where variables and constraints of a program along time stand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.errors import ModelError
from piezo_opt.identification.program import Stages

IntArray = NDArray[np.intp]


@final
@dataclass(frozen=True, eq=False)
class Layout:
    """Numbers of variables and constraint rows, stage by stage.

    All chains stand one behind the other: a chain of J intervals is J + 1 stages. The start of a
    further chain takes the place that a step in time has elsewhere.

    Attributes:
        first, last: stages at which each chain begins and ends.
        states: (S, n) variables.
        controls: (S, m) further variables of the interval that begins at a stage, -1 at a
            chain's last stage.
        unknowns: (S, k) variables, the same in every row unless each stage has its own copy.
        leads: (S, n) rows that determine a stage's states.
        keeps: (S - 1, k) rows that hand the copies on, (S - 1, 0) where they are shared.
        others: (S, m) rows that determine the controls, -1 at a chain's last stage.
        closing: (chains, n) rows that close a chain, -1 where it is open.
        variables, rows: numbers of both.
        stages: what a solver that goes stage by stage must know.
    """

    first: IntArray
    last: IntArray
    states: IntArray
    controls: IntArray
    unknowns: IntArray
    leads: IntArray
    keeps: IntArray
    others: IntArray
    closing: IntArray
    variables: int
    rows: int
    stages: Stages | None

    @staticmethod
    def of(
        intervals: Sequence[int], closed: Sequence[bool], states: int, unknowns: int,
        controls: int, stagewise: bool,
    ) -> Layout:  # fmt: skip
        """Number everything.

        Args:
            intervals: number of intervals of each chain.
            closed: which chains end where they began.
            states, unknowns, controls: number of each in a stage.
            stagewise: whether every stage has its own copy of the unknowns.
        """
        if stagewise and any(closed):
            raise ModelError(
                "A periodic start ties the end of a record to its beginning, which a solver that "
                "goes stage by stage cannot do; take solver=Ipopt(), or start=Start.FREE."
            )
        sizes = np.array(intervals, dtype=np.intp) + 1
        last = np.cumsum(sizes) - 1
        count = int(sizes.sum())
        copies = unknowns if stagewise else 0
        moving = np.ones(count, dtype=np.intp)
        moving[last] = 0
        begin = (0 if stagewise else unknowns) + np.concatenate(
            [[0], np.cumsum(states + copies + controls * moving)]
        )
        here = begin[:-1, None]
        own = here + states + np.arange(unknowns)
        shared = np.tile(np.arange(unknowns), (count, 1))
        # Rows of stage s: those that lead to stage s + 1, then its own; the first stage also
        # holds the start of all.
        onward = np.where(np.arange(count) < count - 1, states + copies, 0)
        row = np.concatenate(
            [[0], np.cumsum(onward + controls * moving + states * (np.arange(count) == 0))]
        )
        leads = np.vstack(
            [row[0] + onward[0] + np.arange(states), row[: count - 1, None] + np.arange(states)]
        ).reshape(count, states)
        extra = np.where(np.arange(count) == 0, states, 0)
        others = (row[:-1] + onward + extra)[:, None] + np.arange(controls)
        closing = np.full((len(intervals), states), -1)
        rows = int(row[-1])
        for chain, ends in enumerate(closed):
            if ends:
                closing[chain] = rows + np.arange(states)
                rows += states
        return Layout(
            first=last - sizes + 1,
            last=last,
            states=here + np.arange(states),
            controls=np.where(
                moving[:, None] > 0, here + states + copies + np.arange(controls), -1
            ),
            unknowns=own if stagewise else shared,
            leads=leads,
            keeps=row[: count - 1, None] + states + np.arange(copies),
            others=np.where(moving[:, None] > 0, others, -1),
            closing=closing,
            variables=int(begin[-1]),
            rows=rows,
            stages=None
            if not stagewise
            else Stages(
                (states + copies,) * count,
                tuple((controls * moving).tolist()),
                tuple((controls * moving + extra).tolist()),
            ),
        )
