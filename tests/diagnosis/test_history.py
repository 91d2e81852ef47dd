"""How a record was reached: what a hysteresis of plays remembers of the drive before it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.diagnosis.book import Book
from piezo_opt.diagnosis.moves import details
from piezo_opt.effects import Offset, PiezoGain, PrandtlIshlinskii, Preisach
from piezo_opt.effects.strain.history import history

NOISE = 1e-9
MODEL = PiezoGain() + PrandtlIshlinskii(dead_zones=0) + Offset()
CORNERS = (20.0, 30.0, 15.0, 40.0, 25.0, 45.0, 10.0, 35.0)
BEFORE = (
    {"origin": 12.0, "swing": -1.2, "swing_before": 1.6},
    {"origin": 33.0, "swing": 0.8, "swing_before": -1.5},
    {"origin": 18.0, "swing": -0.7, "swing_before": 1.2},
)


def record(corners: tuple[float, ...], before: dict[str, float], seed: int) -> po.Measurement:
    """A drive between corners, 6 s, of an actuator that was reached in this way."""
    time = np.arange(600) / 100.0
    drive = np.interp(time, np.linspace(0.0, 6.0, len(corners)), corners)
    blank = po.Measurement(time, drive, 1e-7 * drive)
    own = {"rho": 6e-8, "decay": 1.0, "r": 25.0, **before}
    reading = po.simulate(MODEL, blank, {f"prandtl_ishlinskii.{k}": v for k, v in own.items()})
    white = np.random.default_rng(seed).normal(size=time.size)
    return blank.with_(position=reading.reading + NOISE * white)


@cache
def stuck(index: int) -> po.Fit:
    """A fit that begins as if there had been hardly any swing before."""
    measured = record(CORNERS, BEFORE[index], index)
    begun = {f"prandtl_ishlinskii.{k}": 0.1 for k in ("swing", "swing_before")}
    begun["prandtl_ishlinskii.origin"] = float(measured.drive[0])
    free = tuple(f"prandtl_ishlinskii.{k}" for k in history())
    return po.solve(po.Identification(MODEL, measured, free=free, values=begun))


@pytest.mark.parametrize("index", range(3))
def test_a_search_leaves_a_history_that_only_got_stuck(index: int) -> None:
    fit = stuck(index)
    assert fit.rms > 5.0 * NOISE
    book = Book(fit, 1, 1)
    book.race(details(fit, book))
    assert book[book.base].rms == pytest.approx(NOISE, rel=0.15)


@pytest.mark.parametrize("index", [1, 2])
def test_another_record_was_reached_in_a_way_of_its_own(index: int) -> None:
    """And is predicted to the noise; as if it had been reached as the first, it is not."""
    book = Book(stuck(0), 1, 1)
    book.race(details(stuck(0), book))
    fit = book[book.base]
    other = record(CORNERS[::-1], BEFORE[index], 9)
    left = other.position - fit.predict(other)
    assert np.sqrt(np.mean(left**2)) < 1.2 * NOISE
    own = {name: fit.values[name] for name in fit.question.free}
    held = replace(fit, question=replace(fit.question, free=(), fixed=own))
    left = other.position - held.predict(other)
    assert np.sqrt(np.mean(left**2)) > 5.0 * NOISE


def test_a_loop_of_free_weights_gives_no_energy() -> None:
    """It turns one way only: the reading lags behind the drive, whatever the weights."""
    time = np.arange(400) / 100.0
    drive = 30.0 - 30.0 * np.cos(np.pi * time)
    blank = po.Measurement(time, drive, 1e-7 * drive)
    law, random = Preisach(free=True), np.random.default_rng(4)
    for _ in range(5):
        weights = {
            f"preisach.{k}": max(p.bounds[0], -1e-7) + 1e-7 * random.uniform() ** 8
            for k, p in law.parameters.items() if k.startswith("w") and k[1:].isdigit()
        }  # fmt: skip
        assert len(weights) == 20
        reading = po.simulate(PiezoGain() + law + Offset(), blank, weights).reading
        turn = reading[200:] - reading[200]
        assert np.trapezoid(turn, drive[200:]) < 0.0
