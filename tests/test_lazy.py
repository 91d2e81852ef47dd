"""Made at first use, kept, and nobody waits for another instance."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from threading import Barrier, Thread
from time import sleep
from typing import final

from piezo_opt.assembly import System, assemble
from piezo_opt.effects import BoucWen, PiezoGain
from piezo_opt.lazy import lazy
from piezo_opt.symbolic import one_at_a_time

PATIENCE = 5.0


@final
class Squared:
    """Counts how often its square is made, each time together with somebody else's if asked to."""

    def __init__(self, number: int, together: Barrier | None = None) -> None:
        self.number = number
        self.made = 0
        self._together = together

    @lazy
    def square(self) -> list[int]:
        """Its square."""
        self.made += 1
        if self._together is not None:
            self._together.wait(PATIENCE)
        return [self.number**2]


def test_it_is_made_once() -> None:
    three, four = Squared(3), Squared(4)
    assert three.made == 0
    assert three.square == [9]
    assert four.square == [16]
    assert three.square is three.square
    assert (three.made, four.made) == (1, 1)
    assert Squared.square.__doc__ == "Its square."


def test_two_instances_are_made_at_the_same_time() -> None:
    """Each waits until the other one is being made, too."""
    together = Barrier(2)
    pair = [Squared(3, together), Squared(4, together)]
    with ThreadPoolExecutor(max_workers=2) as pool:
        assert list(pool.map(lambda one: one.square, pair)) == [[9], [16]]


def test_all_go_on_with_the_first() -> None:
    one = Squared(5, Barrier(2))
    with ThreadPoolExecutor(max_workers=2) as pool:
        first, second = pool.map(lambda _: one.square, range(2))
    assert first is second
    assert first is one.square
    assert one.made == 2


def test_who_builds_may_ask_for_a_recipe_while_another_one_waits_to_build() -> None:
    """With a lock of the property's own each would have what the other one needs."""
    systems = [assemble(PiezoGain() + BoucWen(), {"bouc_wen.n": n}) for n in (1.25, 1.75)]
    building = Barrier(2)
    told: list[str] = []

    @one_at_a_time
    def built(system: System) -> None:
        building.wait(PATIENCE)
        sleep(0.1)  # the other thread has asked by now, and gets no further
        told.append(system.recipe)

    def asked(system: System) -> None:
        building.wait(PATIENCE)
        told.append(system.recipe)

    # Threads that wait for each other must not keep the process from ending.
    work = zip((built, asked), systems, strict=True)
    threads = [Thread(target=what, args=(system,), daemon=True) for what, system in work]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE)
    assert len(set(told)) == 2
