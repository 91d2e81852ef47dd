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


@final
@dataclass(frozen=True, eq=False)
class Found:
    """A drive made by rule, or the best member of a family.

    Attributes:
        drive: what to play.
        merit: what is maximised.
        evaluations: drives that were judged for it.
    """

    drive: Drive
    merit: float
    evaluations: int


def search(
    families: Sequence[Family],
    room: Room,
    merit: Callable[[FloatArray], float | None],
    *,
    offered: Sequence[Drive] = (),
    evaluations: int,
    seed: int,
) -> tuple[Found, ...]:
    """Drives made by rule and the best member of each family, best first.

    What cannot be judged is left out. All starts of a family are judged, and the better one is
    refined by CMA-ES.

    Args:
        families: where to look.
        room: what a drive may use.
        merit: of a drive (N,), larger is better; None where it cannot be judged.
        offered: drives made by rule.
        evaluations: members judged in each family; none where that is zero.
        seed: of the search.

    Source: Hansen & Ostermeier (2001), Evol. Comput. 9(2), 159-195.
    """
    by_rule = [(drive, merit(drive.values)) for drive in offered]
    found = [Found(drive, got, 1) for drive, got in by_rule if got is not None and got > FORBIDDEN]
    if evaluations > 0:
        refined = (_refined(one, room, merit, evaluations, seed) for one in families)
        found += [one for one in refined if one is not None]
    return tuple(sorted(found, key=lambda f: -f.merit))


def _refined(
    family: Family,
    room: Room,
    merit: Callable[[FloatArray], float | None],
    evaluations: int,
    seed: int,
) -> Found | None:
    import cma  # which brings a plotting library along: nobody else is to wait for that

    best: tuple[float, FloatArray] | None = None
    count = 0

    def cost(x: FloatArray) -> float:
        nonlocal best, count
        count += 1
        got = merit(room.scaled(family.wave(x, room)))
        if got is None or not np.isfinite(got):
            return _WORST
        if best is None or got > best[0]:
            best = got, x.copy()
        return -got

    for start in family.starts:
        cost(np.asarray(start, dtype=np.float64))
    if best is None:
        return None
    stream = np.random.default_rng(seed)

    def randn(*shape: int) -> Any:
        return stream.standard_normal(shape if shape else None)

    begin = np.clip(best[1], 0.01, 0.99)
    strategy = cma.CMAEvolutionStrategy(
        begin, _FIRST,
        {
            "bounds": [[0.0] * begin.size, [1.0] * begin.size], "randn": randn,
            "seed": float("nan"), "verbose": -9, "verb_disp": 0, "verb_log": 0,
            "maxfevals": evaluations, "tolfun": 1e-3, "tolx": 1e-4,
        },
    )  # fmt: skip
    while count < evaluations and not strategy.stop():
        asked = strategy.ask()
        strategy.tell(asked, [cost(np.asarray(x, dtype=np.float64)) for x in asked])
    value, at = best
    if value <= FORBIDDEN:
        return None
    drive = Drive(
        f"best_{family.name.replace(' ', '_')}", family.said(at, room),
        room.scaled(family.wave(at, room)), room.rate, room.unit,
    )  # fmt: skip
    return Found(drive, value, count)
