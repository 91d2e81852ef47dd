"""Trial shapes lie where the record can show them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.effects import (
    AmplifierLag,
    BoucWen,
    Creep,
    DeadZone,
    Friction,
    HystereticForce,
    PiezoGain,
    Saturation,
    SecondMode,
    SensorNonlinearity,
)
from piezo_opt.effects.base import Parameter
from piezo_opt.effects.catalogue import CATALOGUE
from piezo_opt.identification.shapes import (
    detail_start,
    own,
    resolving,
    resonances,
    shape_grid,
)
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


@pytest.mark.parametrize(
    ("effect", "shapes", "longest", "farthest"),
    [
        (DeadZone(), {"width": 3.0}, np.inf, np.inf),
        (AmplifierLag(), {"tau": 0.3}, 0.25, np.inf),
        (SecondMode(), {"omega": 100.0, "zeta": 0.1}, 2.0**-7, np.inf),
        (Friction(), {"z0": 3e-8}, np.inf, 6e-8),
        (HystereticForce(), {"beta": 1e7}, np.inf, 2e-7),
    ],
)
def test_sub_steps_follow_what_is_fast(
    effect: po.Effect, shapes: dict[str, float], longest: float, farthest: float
) -> None:
    """A time constant a sub-step, of few lengths; two displacements of a contact."""
    assert resolving(effect, shapes) == pytest.approx((longest, farthest))


def test_velocities_lie_below_the_usual_one() -> None:
    pace = np.sqrt(np.mean(np.gradient(RECORD.position, RECORD.time) ** 2))
    tried = [p["w_c"] / pace for p in shape_grid(Friction(smooth=True), RECORD, REST)]
    assert (len(tried), min(tried), max(tried)) == (5, pytest.approx(0.01), pytest.approx(1.0))


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


def test_a_ringing_is_found_below_noise_that_is_higher() -> None:
    # Differences raise white noise towards Nyquist; a ringing at a tenth of it is no highest peak.
    time = np.arange(8000) / 1000.0
    drive = np.where(time % 1.0 < 0.5, 0.0, 50.0)
    since = time % 0.5
    ring = 5e-9 * np.exp(-15.0 * since) * np.sin(2 * np.pi * 55.0 * since)
    noise = 5e-9 * np.random.default_rng(2).normal(size=time.size)
    noisy = po.Measurement(time, drive, 1e-7 * drive + noise)
    candidates = [shapes["omega"] for shapes in shape_grid(SecondMode(), noisy, ring + noise)]
    assert min(abs(c / (2 * np.pi * 55.0) - 1.0) for c in candidates) < 0.02


def test_own_names() -> None:
    assert own({"creep.c": 1.0, "creep_2.c": 2.0, "piezo_gain.d": 3.0}, "creep") == {"c": 1.0}
    slope = np.polyfit(DRIVE, RECORD.position, 1)[0]
    assert shape_grid(PiezoGain(), RECORD, REST)[0] == {"d": pytest.approx(0.1 * slope)}


@pytest.mark.parametrize("name", sorted(CATALOGUE))
def test_every_detail_starts_where_it_can_be_felt_and_within_its_limits(name: str) -> None:
    """Not at 0, where a detail may have no derivative, nor at a bound."""
    kind = CATALOGUE[name]
    forms = [kind(**options) for options in kind.variants or ({},)]
    for detail, parameter in {(d, form.parameters[d]) for form in forms for d in form.details}:
        low, high = limits(parameter, (RECORD,))
        start = detail_start(parameter, RECORD)
        assert low < start < high, detail
        if parameter.per_record and parameter.unit == "V":
            # A level of the drive that each record has its own of: where the record begins.
            assert start == RECORD.drive[0], detail
        else:
            assert start != 0.0, detail


@pytest.mark.parametrize(
    ("unit", "start"),
    [
        ("V", 0.7),
        ("m", 7e-8),
        ("1/V", 0.05 / 70.0),
        ("1/V^2", 0.05 / 70.0**2),
        ("1/m", 0.05 / 7e-6),
        ("1/m^2", 0.05 / 7e-6**2),
        ("m/V^2", 0.05 * 7e-6 / 70.0**2),
        ("m/V^3", 0.05 * 7e-6 / 70.0**3),
        ("s", 1e-4),
    ],
)
def test_a_detail_that_is_0_starts_on_the_scale_of_the_record(unit: str, start: float) -> None:
    """70 V and 7 um from end to end, in steps of 10 ms; one that is not 0 starts where it is."""
    time = np.arange(401) / 100.0
    drive = np.interp(time, [0.0, 1.0, 2.0, 4.0], [0.0, 60.0, -10.0, 0.0])
    swing = po.Measurement(time, drive, 1e-7 * drive)
    none = Parameter(unit, "a detail", 0.0, fixed=True, detail=True)
    assert detail_start(none, swing) == pytest.approx(start, rel=1e-12)
    some = Parameter(unit, "a detail", 0.6, fixed=True, detail=True)
    assert detail_start(some, swing) == 0.6


def test_a_time_of_centuries_starts_at_one_that_the_record_can_show() -> None:
    warm_up = Parameter("s", "warm-up", 1e9, (1e-3, 1e10), fixed=True, detail=True)
    assert detail_start(warm_up, RECORD) == pytest.approx(0.5 * RECORD.duration)
    assert detail_start(dataclasses.replace(warm_up, nominal=3.0), RECORD) == 3.0


@pytest.mark.parametrize(
    ("nominal", "typical", "bounds", "start"),
    [
        (1.0, (1.0, 2.0), (1.0, 4.0), 1.05),
        (0.0, (-0.1, 0.1), (-1.0, 1.0), 0.01),
        (0.2, (0.05, 0.45), (0.03, 1.0), 0.22),
        (2.0, None, (0.0, 10.0), 2.2),
        (1.0, (0.0, 1.0), (0.0, 1.0), 0.95),
    ],
)
def test_a_pure_number_starts_a_twentieth_of_its_usual_range_away(
    nominal: float, typical: tuple[float, float] | None, bounds: tuple[float, float], start: float
) -> None:
    """Upwards, unless it is kept at its largest."""
    detail = Parameter("1", "a detail", nominal, bounds, typical, fixed=True, detail=True)
    assert detail_start(detail, RECORD) == pytest.approx(start, rel=1e-12)


def test_a_speed_starts_at_the_usual_one() -> None:
    """That of a sine: its amplitude times its frequency, over the root of two."""
    time = np.arange(2000) / 1000.0
    swing = 30.0 * np.sin(2.0 * np.pi * 2.0 * time)
    sine = po.Measurement(time, swing, 1e-7 * swing)
    detail = Parameter("m/s", "a speed", 1e-3, fixed=True, detail=True)
    usual = 3e-6 * 2.0 * np.pi * 2.0 / np.sqrt(2.0)
    assert detail_start(detail, sine) == pytest.approx(usual, rel=1e-3)


def test_a_length_that_repeats_is_sought_along_the_reading() -> None:
    """Fringes come twice a wavelength; where nothing repeats the nominal one is left."""
    time = np.arange(4000) * 1e-3
    position = 5e-6 * np.sin(3.0 * time)
    wave = 2e-8 * np.sin(4.0 * np.pi * position / 9e-7)
    fringed = po.Measurement(time, position / 1e-7, position + wave)
    unknown = SensorNonlinearity(unknown=True)
    found = {point["wavelength"] for point in shape_grid(unknown, fringed, wave)}
    assert list(found) == [pytest.approx(9e-7, rel=5e-3)]
    rest = {point["wavelength"] for point in shape_grid(unknown, fringed, 0.0 * wave)}
    assert rest == {unknown.parameters["wavelength"].nominal}
