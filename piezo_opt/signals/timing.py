"""Time given to the parts of a drive that tell most."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias, final

import numpy as np

from piezo_opt.signals.drive import Drive, FloatArray
from piezo_opt.signals.families import Room

STROKES: Final = (10, 30, 100, 300)
"""Strokes of wandering drives, three times as many from one to the next: few that leave time to
rest, and many for what a single one hardly shows."""
_AT_ENDS: Final = 0.4
"""Share of levels at either end of the range."""
_TURNS: Final = 2
"""Turns of sharing out time and of moving rests in a heat."""
_MOVES: Final = (0.02, 0.1, 0.4)
"""Standard deviations of a move, as shares of the range."""
_ROUNDS: Final = 30
_PATIENCE: Final = 6
"""Rounds without a better drive that end the search: a part may have to shrink first."""


def wandering(room: Room, seed: int) -> tuple[Drive, ...]:
    """Drives of straight strokes between random levels, many of them at the ends of the range.

    None with strokes of fewer than one sample, nor faster than the slew rate.
    """
    rng, made = np.random.default_rng(seed), []
    time, span = room.time, room.high - room.low
    for count in STROKES:
        levels = rng.uniform(size=count + 1)
        levels = np.where(rng.uniform(size=levels.size) < _AT_ENDS, np.rint(levels), levels)
        levels[0] = 0.0
        if count < time.size and span * count / room.duration <= room.slew:
            wave = np.interp(time, np.linspace(0.0, time[-1], levels.size), levels)
            made.append(
                Drive(
                    f"wandering_{count}", f"{count} strokes between levels of {room.low:g} to "
                    f"{room.high:g} {room.unit}", room.scaled(wave), room.rate, room.unit,
                )
            )  # fmt: skip
    return tuple(made)


Look: TypeAlias = Callable[[FloatArray], tuple[float, FloatArray] | None]
"""Merit of a drive (N,), larger is better, and the worth of each of its samples (N,), one on
average; None where it cannot be judged."""


def improved(
    ways: Sequence[FloatArray],
    room: Room,
    merit: Callable[[FloatArray], float | None],
    look: Look,
    tries: int,
    seed: int,
) -> Improved:
    """The best drive near some. Ctrl-C gives the best so far.

    In turns time goes where samples tell most (`timed`), and rests are moved, one to three at a
    time by a little or a lot, for as long as the merit rises. All begin, the better half goes on
    with as many tries together, until one is left.

    Args:
        ways: drives to begin with (N,) [unit].
        room, look: as of :func:`timed`.
        merit: of a drive alone.
        tries: moves of rests in each heat.
        seed: of the moves.
    """
    rng, best = np.random.default_rng(seed), _Best()
    try:
        for number, way in enumerate(ways):
            best.offer(number, *timed(way, room, look))
        left = list(range(len(ways)))
        while left:
            for number in left:
                each = tries // len(left)
                for value, values in _moved(*best.of[number], room, merit, look, each, rng):
                    best.offer(number, value, values)
            half = (len(left) + 1) // 2 if len(left) > 1 else 0
            left = sorted(left, key=lambda k: -best.of[k][0])[:half]
    except KeyboardInterrupt:
        return best.told(interrupted=True)
    return best.told(interrupted=False)


@final
@dataclass(frozen=True, eq=False)
class Improved:
    """What was found.

    Attributes:
        number: of the drive that it began with.
        merit: of it.
        values: (N,) [unit].
        interrupted: whether Ctrl-C or a limit of time ended the search.
    """

    number: int
    merit: float
    values: FloatArray
    interrupted: bool


@final
class _Best:
    """The best drive near each, so far."""

    def __init__(self) -> None:
        self.of: dict[int, tuple[float, FloatArray]] = {}

    def offer(self, number: int, value: float, values: FloatArray) -> None:
        """Keep it if it is better."""
        if number not in self.of or value > self.of[number][0]:
            self.of[number] = value, values

    def told(self, *, interrupted: bool) -> Improved:
        """The best of all."""
        if not self.of:
            return Improved(0, -np.inf, np.zeros(0), interrupted)
        number = max(self.of, key=lambda k: self.of[k][0])
        return Improved(number, *self.of[number], interrupted)


def _moved(
    value: float,
    values: FloatArray,
    room: Room,
    merit: Callable[[FloatArray], float | None],
    look: Look,
    tries: int,
    rng: np.random.Generator,
) -> Iterator[tuple[float, FloatArray]]:
    """Ever better drives with rests at other levels."""
    for _ in range(_TURNS):
        begins = np.flatnonzero(np.diff(values, prepend=np.nan) != 0.0)
        if len(begins) > values.size // 4:
            return  # it never rests
        for _ in range(tries // _TURNS):
            moved = values.copy()
            for k in rng.integers(0, len(begins), rng.integers(1, 4)).tolist():
                end = begins[k + 1] if k + 1 < len(begins) else moved.size
                step = rng.normal(0.0, rng.choice(_MOVES)) * (room.high - room.low)
                moved[begins[k] : end] = np.clip(moved[begins[k]] + step, room.low, room.high)
            fastest = float(np.abs(np.diff(moved)).max(initial=0.0)) * room.rate
            got = merit(moved) if fastest <= room.slew else None
            if got is not None and got > value:
                value, values = got, moved
                yield value, values
        again = timed(values, room, look)
        if again[0] > value:
            value, values = again
            yield value, values


def timed(values: FloatArray, room: Room, look: Look) -> tuple[float, FloatArray]:
    """The best drive along the same way, (merit, (N,)): slower where samples tell more.

    Each sample's share of the time is multiplied by the root of its worth, and the way is sampled
    anew, parts left out where they tell nothing, down to what the slew rate needs. For a reading
    that does not depend on speed this is the multiplicative algorithm for optimal weights; for
    others it is a try, and only what has a larger merit is kept.

    Args:
        values: the drive to begin with (N,) [unit].
        room: with the slew rate.
        look: at a drive.

    Source: Silvey, Titterington & Torsney (1978), Commun. Stat. A 7(14), 1379-1389.
    """
    best, since = (-np.inf, values), 0
    for _ in range(_ROUNDS):
        seen = look(values)
        if seen is None:
            break
        since += 1
        if seen[0] > best[0]:
            best, since = (seen[0], values), 0
        if since == _PATIENCE:
            break
        values = _sampled(values, np.sqrt(seen[1]), room)
    return best


def _sampled(values: FloatArray, share: FloatArray, room: Room) -> FloatArray:
    """A drive along the same way whose samples last as their shares say."""
    count = values.size
    moves = np.abs(np.diff(values, append=values[-1]))
    least = np.minimum(1.0, moves * room.rate / room.slew)
    lasting = least + max(0.0, count - float(least.sum())) * share / float(share.sum())
    ends = np.concatenate([[0.0], np.cumsum(lasting)])
    at = np.interp(np.arange(count) + 0.5, ends, np.arange(count + 1))
    if np.isfinite(room.slew):
        return np.asarray(np.interp(at, np.arange(count), values))
    # A jump is one sample long: from the last one before it to the first one after.
    return np.asarray(values[np.minimum(at.astype(int), count - 1)])
