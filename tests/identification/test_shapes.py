"""Trial shapes lie where the record can show them."""

from __future__ import annotations

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.effects import AmplifierLag, BoucWen, Creep, DeadZone, PiezoGain, Saturation
from piezo_opt.effects.catalogue import CATALOGUE
from piezo_opt.identification.shapes import own, resonances, shape_grid
from piezo_opt.identification.unknowns import limits
from tests.identification.truth import MOVING, TRUTH, loops, record

TIME, DRIVE = loops(400)
RECORD = po.Measurement(TIME, DRIVE, 1e-7 * DRIVE)
REST = RECORD.position - RECORD.position.mean()


@pytest.mark.parametrize("name", sorted(CATALOGUE))
def test_every_grid_is_small_complete_and_within_the_limits(name: str) -> None:
    kind = CATALOGUE[name]
    for options in kind.variants or ({},):
        effect = kind(**options)
        grid = shape_grid(effect, RECORD, REST)
        assert 1 <= len(grid) <= 24
        shapes = {n for n, p in effect.parameters.items() if n != effect.gate and not p.fixed}
        for point in grid:
            assert set(point) == shapes
            for n, value in point.items():
                low, high = limits(effect.parameters[n], (RECORD,))
                assert low <= value <= high
        assert len({tuple(sorted(p.items())) for p in grid}) == len(grid)


def test_what_the_user_has_given_is_not_tried() -> None:
    assert shape_grid(Creep(), RECORD, REST, ("tau",)) == [{}]
    assert all("tau" in point for point in shape_grid(Creep(), RECORD, REST))


def test_times_span_the_record() -> None:
    times = [p["tau"] for p in shape_grid(AmplifierLag(), RECORD, REST)]
    assert min(times) == pytest.approx(0.3 * RECORD.step)
    slow = [p["tau"] for p in shape_grid(Creep(), RECORD, REST)]
    assert 0.05 * RECORD.duration < max(slow) < RECORD.duration


@pytest.mark.parametrize("effect", [Saturation(), DeadZone()])
def test_voltages_lie_within_the_drive(effect: po.Effect) -> None:
    volts = [
        v for p in shape_grid(effect, RECORD, REST) for n, v in p.items()
        if effect.parameters[n].unit == "V"
    ]  # fmt: skip
    assert volts
    assert 0 < min(volts) < max(volts) < 60.0


def test_a_trial_width_scales_with_the_drive() -> None:
    half = po.Measurement(TIME, 0.5 * DRIVE, 1e-7 * DRIVE)
    wide = {p["beta"] for p in shape_grid(BoucWen(), half, REST)}
    narrow = {p["beta"] for p in shape_grid(BoucWen(), RECORD, REST)}
    assert sorted(wide) == pytest.approx([2.0 * b for b in sorted(narrow)])


@pytest.mark.parametrize("hertz", [45.0, 130.0, 400.0])
def test_the_first_candidate_is_the_peak_of_the_response(hertz: float) -> None:
    time = np.arange(2000) / 2000.0
    drive = 30.0 + 10.0 * np.random.default_rng(0).normal(size=time.size).clip(-2, 2)
    truth = {**TRUTH, "second_order.omega": 2 * np.pi * hertz, "second_order.zeta": 0.02}
    measured = record(MOVING, truth, time, drive)
    candidates = resonances(measured, measured.position - measured.position.mean())
    nearest = min(abs(c / (2 * np.pi * hertz) - 1.0) for c in candidates[:3])
    assert nearest < 0.05


def test_candidates_are_apart_and_within_what_the_record_holds() -> None:
    candidates = np.sort(resonances(RECORD, REST))
    assert candidates.size >= 2
    assert np.all(np.diff(np.log(candidates)) > 0.03)
    assert candidates[0] > 2 * np.pi * 3.0 / RECORD.duration
    assert candidates[-1] < 0.9 * np.pi / RECORD.step


def test_uneven_sampling_still_shows_a_ringing() -> None:
    generator = np.random.default_rng(1)
    time = np.cumsum(generator.uniform(0.5, 1.5, 3000)) / 2000.0
    drive = np.where(time < 0.2, 0.0, 50.0)
    ring = np.where(time < 0.2, 0.0, np.exp(-5 * (time - 0.2)) * np.sin(500.0 * (time - 0.2)))
    uneven = po.Measurement(time, drive, 1e-7 * drive + 1e-6 * ring)
    assert not uneven.uniform
    candidates = resonances(uneven, 1e-6 * ring)
    assert min(abs(c / 500.0 - 1.0) for c in candidates[:4]) < 0.05


def test_own_names() -> None:
    assert own({"creep.c": 1.0, "creep_2.c": 2.0, "piezo_gain.d": 3.0}, "creep") == {"c": 1.0}
    assert shape_grid(PiezoGain(), RECORD, REST)[0] == {"d": PiezoGain().parameters["d"].nominal}
