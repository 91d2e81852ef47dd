"""The search for the best drive among those made by rule and the members of several families."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np

from piezo_opt.signals.drive import Drive
from piezo_opt.signals.families import Family, FloatArray, Room

_FIRST: Final = 0.2
"""Standard deviation of the first generation, as a share of the unit cube."""
_WORST: Final = 1e12
"""Cost of a member that cannot be judged; a search steers clear of it."""
FORBIDDEN: Final = -1e6
"""Merit of a member just outside what is allowed; times one plus how far outside it is. Merits are
logarithms or sigmas, far above it."""

EARLY: Final = " The search was ended early: it is the best so far."
"""What is said then."""


@final
@dataclass(frozen=True, eq=False)
class Found:
    """A drive made by rule, or the best member of a family.

    Attributes:
        drive: what to play.
        merit: what is maximised.
    """

    drive: Drive
    merit: float


@final
@dataclass(frozen=True, eq=False)
class Searched:
    """What a search found.

    Attributes:
        best: drives made by rule and the best member of each family, best first.
        evaluations: drives that were judged.
        interrupted: whether Ctrl-C or a limit of time ended it.
    """

    best: tuple[Found, ...]
    evaluations: int
    interrupted: bool


def search(
    families: Sequence[Family],
    room: Room,
    merit: Callable[[FloatArray], float | None],
    *,
    offered: Sequence[Drive] = (),
    evaluations: int,
    seed: int,
    progress: Callable[[str], None] | None = None,
) -> Searched:
    """Drives made by rule and the best member of each family, best first.

    What cannot be judged is left out. All starts of a family are judged, and the better one is
    refined by CMA-ES. Ctrl-C gives the best so far.

    Args:
        families: where to look.
        room: what a drive may use.
        merit: of a drive (N,), larger is better; None where it cannot be judged.
        offered: drives made by rule.
        evaluations: members judged in each family; none where that is zero.
        seed: of the search.
        progress: told how many were judged.

    Raises:
        KeyboardInterrupt: it came before a drive was judged.

    Source: Hansen & Ostermeier (2001), Evol. Comput. 9(2), 159-195.
    """
    most = len(offered) + evaluations * len(families)
    found: list[Found] = []
    judged = 0

    def counted(values: FloatArray) -> float | None:
        nonlocal judged
        judged += 1
        if progress is not None:
            progress(f"drive {judged} of about {most} (Ctrl-C keeps the best so far)")
        return merit(values)

    interrupted = False
    try:
        for drive in offered:
            got = counted(drive.values)
            if got is not None and got > FORBIDDEN:
                found.append(Found(drive, got))
        for family in families if evaluations > 0 else ():
            one = _Refining(family, room, counted)
            try:
                one.run(evaluations, seed)
            finally:
                found += one.found
    except KeyboardInterrupt:
        if not found or not families or evaluations == 0:
            raise
        interrupted = True
    return Searched(tuple(sorted(found, key=lambda f: -f.merit)), judged, interrupted)


@final
class _Refining:
    """The best member of one family, so far."""

    def __init__(
        self, family: Family, room: Room, merit: Callable[[FloatArray], float | None]
    ) -> None:
        self._family, self._room, self._merit = family, room, merit
        self._best: tuple[float, FloatArray] | None = None
        self._count = 0

    @property
    def found(self) -> list[Found]:
        """The best member; none where none can be judged, or all are forbidden."""
        if self._best is None or self._best[0] <= FORBIDDEN:
            return []
        family, room, (value, at) = self._family, self._room, self._best
        drive = Drive(
            f"best_{family.name.replace(' ', '_')}", family.said(at, room),
            room.scaled(family.wave(at, room)), room.rate, room.unit,
        )  # fmt: skip
        return [Found(drive, value)]

    def run(self, evaluations: int, seed: int) -> None:
        """Judge the starts, and refine the better one."""
        import cma  # which brings a plotting library along: nobody else is to wait for that

        for start in self._family.starts:
            self._cost(np.asarray(start, dtype=np.float64))
        if self._best is None:
            return
        stream = np.random.default_rng(seed)

        def randn(*shape: int) -> Any:
            return stream.standard_normal(shape if shape else None)

        begin = np.clip(self._best[1], 0.01, 0.99)
        strategy = cma.CMAEvolutionStrategy(
            begin, _FIRST,
            {
                "bounds": [[0.0] * begin.size, [1.0] * begin.size], "randn": randn,
                "seed": float("nan"), "verbose": -9, "verb_disp": 0, "verb_log": 0,
                "maxfevals": evaluations, "tolfun": 1e-3, "tolx": 1e-4,
            },
        )  # fmt: skip
        while self._count < evaluations and not strategy.stop():
            asked = strategy.ask()
            costs = [self._cost(np.asarray(x, dtype=np.float64)) for x in asked]
            strategy.tell(asked, costs)

    def _cost(self, x: FloatArray) -> float:
        self._count += 1
        got = self._merit(self._room.scaled(self._family.wave(x, self._room)))
        if got is None or not np.isfinite(got):
            return _WORST
        if self._best is None or got > self._best[0]:
            self._best = got, x.copy()
        return -got
