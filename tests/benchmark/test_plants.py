"""The hidden-effect plants: independent, repeatable, and of the size they say."""

from __future__ import annotations

import ast
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from piezo_opt.benchmark import plants
from piezo_opt.benchmark.plants import CLASSES, OUTSIDE, HiddenRecord, make, records
from piezo_opt.benchmark.plants.drives import Drive
from piezo_opt.benchmark.plants.hidden import Hidden, Scale, Scene
from piezo_opt.benchmark.plants.input_line import ChargeBackCoupling, Delay
from piezo_opt.benchmark.plants.material import Creep
from piezo_opt.benchmark.plants.motion import CubicStiffness, Friction, HystereticForce
from piezo_opt.benchmark.plants.noise import Noise, read
from piezo_opt.benchmark.plants.output_line import Backlash
from piezo_opt.benchmark.plants.physics import Base, Grid, base_responses
from piezo_opt.benchmark.plants.refit import refit, tangent
from piezo_opt.benchmark.plants.simulate import simulate

FOLDER = Path(plants.__file__).parent
PACKAGE = "piezo_opt.benchmark.plants"
BASE = Base(
    gain=0.2e-6, alpha=3e-8, beta=0.03, gamma=-0.004, exponent=1.3, pivot=1e-6,
    omega=2.0 * np.pi * 200.0, zeta=0.05, offset=1e-6, static=False, start_loop=2e-7,
)  # fmt: skip
SCALE = Scale(0.0, 100.0, BASE.gain, BASE.omega, BASE.zeta, 0.5, 1e-6, False)


def scene(base: Base, drive: NDArray[np.float64], rate: float, substeps: int) -> Scene:
    """A record of a drive that is linear between its samples, at the reference temperature."""
    grid = Grid(drive.size, 0, rate, substeps)
    return Scene(grid, base, grid.ends(drive, held=False), np.zeros(grid.count + 1), 0)


def rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values * values)))


def test_nothing_of_the_package_is_imported() -> None:
    for file in sorted(FOLDER.glob("*.py")):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{file.name} imports relatively"
                modules = [str(node.module)]
            elif isinstance(node, ast.Import):
                modules = [alias.name for alias in node.names]
            else:
                continue
            for module in modules:
                assert module.startswith(PACKAGE) or not module.startswith("piezo_opt"), file.name
                assert module.split(".")[0] in {
                    "__future__", "collections", "dataclasses", "itertools", "math", "numpy",
                    "piezo_opt", "scipy", "types", "typing", "zlib",
                }, f"{file.name} imports {module}"  # fmt: skip


def test_base_plant_agrees_with_a_general_integrator() -> None:
    rate = 2000.0
    time = np.arange(400) / rate
    drive = 50.0 * (1.0 - np.cos(2.0 * np.pi * 12.0 * time)) + 10.0 * np.sin(2e2 * np.pi * time)
    b = replace(BASE, start_position=BASE.gain * drive[0] - BASE.start_loop)

    def rates(t: float, state: NDArray[np.float64]) -> list[float]:
        v = float(np.interp(t, time, drive))
        k = min(int(t * rate), time.size - 2)
        dv = float(drive[k + 1] - drive[k]) * rate
        h, x, w = state
        size = abs(h / b.pivot) ** (b.exponent - 1.0)
        dh = b.alpha * dv - size * (b.beta * abs(dv) * h + b.gamma * dv * abs(h))
        s = b.gain * v - h
        return [dh, w, b.omega**2 * (s - x) - 2.0 * b.zeta * b.omega * w]

    truth = solve_ivp(
        rates, (0.0, time[-1]), [b.start_loop, b.start_position, 0.0], t_eval=time,
        rtol=1e-9, atol=1e-15, max_step=0.25 / rate,
    ).y[1]  # fmt: skip
    # Twenty micrometres of stroke: 1e-5 of it is a tenth of the least noise.
    fine = simulate(b, (), scene(b, drive, rate, 4)).reading - b.offset
    assert np.max(np.abs(fine - truth)) < 2e-10
    quick = base_responses(b, b.vector()[None], drive, False, rate)[0] - b.offset
    assert np.max(np.abs(quick - truth)) < 4e-10


def test_the_charge_on_the_drive_is_stepped_to_second_order() -> None:
    """A loop that is led too far and back again would turn, and leave an error of first order."""
    rate = 2000.0
    time = np.arange(800) / rate
    drive = 50.0 * (1.0 - np.cos(2.0 * np.pi * 12.0 * time)) + 10.0 * np.sin(3e2 * np.pi * time)
    charge = ChargeBackCoupling(intensity=0.5, scale=SCALE, slow=1.0)

    def read_at(substeps: int) -> NDArray[np.float64]:
        return simulate(BASE, [charge], scene(BASE, drive, rate, substeps)).reading

    truth = read_at(48)
    coarse, fine = (rms(read_at(n) - truth) for n in (3, 6))
    assert fine < coarse / 3.0
    assert fine < 1e-3 * np.ptp(truth)


@pytest.mark.parametrize(
    "force",
    [
        HystereticForce(intensity=0.1, scale=SCALE, reach=0.05, exponent=1.3, skew=0.2),
        Friction(intensity=0.05, scale=SCALE, presliding=0.01, static=1.0),
    ],
)
def test_a_jump_is_many_steps_of_a_law_that_has_memory(force: Hidden) -> None:
    """Without inertia a jump of the drive is one sub-step, and far beyond a contact's reach."""
    rate, base = 50.0, replace(BASE, static=True)
    drive = np.repeat(np.array([0.0, 60.0, 10.0, 45.0, 5.0, 55.0, 20.0, 30.0]), 20)

    def read_at(substeps: int) -> NDArray[np.float64]:
        return simulate(base, [force], scene(base, drive, rate, substeps)).reading

    jump, way = read_at(1), read_at(64)
    assert rms(jump - way) < 5e-4 * np.ptp(way)
    assert rms(simulate(base, [], scene(base, drive, rate, 1)).reading - way) > 5e-3 * np.ptp(way)


def test_a_record_is_taken_at_sub_steps_that_no_longer_matter(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """An amplifier that answers within a sub-step: at four of them the error was the noise's."""
    taken = {}
    for halvings in (0, 4, 6):
        monkeypatch.setattr(records, "_HALVINGS", halvings)
        monkeypatch.setattr(records, "_CONVERGED", 0.1 if halvings < 6 else 0.0)
        taken[halvings], _ = make(("amplifier_lag",), 341)
    noise = taken[4].noise_rms
    assert rms(taken[0].clean - taken[6].clean) > 0.5 * noise
    assert rms(taken[4].clean - taken[6].clean) < 0.05 * noise


def test_creep_is_logarithmic() -> None:
    base = replace(BASE, alpha=1e-14, start_loop=0.0, offset=0.0, static=True)
    rate, begin, g = 1000.0, 0.1, 0.02
    time = np.arange(20_000) / rate
    drive = np.where(time > 0.0, 50.0, 0.0)
    effect = Creep(intensity=g, scale=SCALE, begin=begin, power=0.0)
    reading = simulate(base, (effect,), scene(base, drive, rate, 1)).reading
    since = time[1:] - 0.5 / rate
    expected = base.gain * 50.0 * (1.0 + g * np.log10(1.0 + since / begin))
    assert np.max(np.abs(reading[1:] / expected - 1.0)) < 2e-3 * g * 5.0


def test_a_delayed_plant_is_the_plant_read_later() -> None:
    rate = 2000.0
    time = np.arange(1000) / rate
    drive = 40.0 * np.sin(2.0 * np.pi * 15.0 * time) ** 2
    late = 3
    effect = Delay(intensity=late / rate * BASE.omega, scale=SCALE)
    base = replace(BASE, start_loop=0.0)
    plain = simulate(base, (), scene(base, drive, rate, 4)).reading
    delayed = simulate(base, (effect,), scene(base, drive, rate, 4)).reading
    assert np.max(np.abs(delayed[late:] - plain[:-late])) < 1e-12
    assert np.max(np.abs(delayed - plain)) > 1e-7


def test_a_force_at_rest_is_balanced_by_the_spring() -> None:
    drive = np.concatenate((np.linspace(0.0, 80.0, 200), np.full(2000, 80.0)))
    base = replace(BASE, start_loop=0.0, zeta=0.2)
    effect = CubicStiffness(intensity=0.1, scale=SCALE, bend=0.0, even=0.3, sign=1.0)
    ends = scene(base, drive, 2000.0, 4)
    free = simulate(base, (), ends).reading[-1] - base.offset
    x = simulate(base, (effect,), ends).reading[-1] - base.offset
    u = x / SCALE.stroke
    assert x + 0.1 * SCALE.stroke * (u**3 + 0.3 * u * abs(u)) == pytest.approx(free, rel=1e-6)
    still = replace(base, static=True)
    at_once = simulate(still, (effect,), scene(still, drive, 2000.0, 1)).reading[-1]
    assert at_once - base.offset == pytest.approx(x, rel=1e-5)


def test_backlash_loses_twice_its_half_width() -> None:
    base = replace(BASE, alpha=1e-14, start_loop=0.0, offset=0.0, static=True)
    drive = np.concatenate((np.linspace(0.0, 100.0, 100), np.linspace(100.0, 0.0, 100)))
    effect = Backlash(intensity=0.01, scale=SCALE)
    y = simulate(base, (effect,), scene(base, drive, 100.0, 1)).reading
    loop = np.interp(50.0, drive[100:][::-1], y[100:][::-1]) - np.interp(50.0, drive[:100], y[:100])
    assert loop == pytest.approx(2.0 * 0.01 * SCALE.stroke, rel=1e-6)


@pytest.mark.parametrize(("colour", "resolution"), [(0.0, 0.0), (0.8, 0.0), (0.0, 2.0)])
def test_noise_has_the_stated_rms_and_colour(colour: float, resolution: float) -> None:
    clean = 1e-6 * np.sin(np.arange(200_000) / 500.0)
    noise = read(np.random.default_rng(5), clean, Noise(3e-9, colour, resolution)) - clean
    assert rms(noise) == pytest.approx(3e-9, rel=0.02)
    assert np.corrcoef(noise[1:], noise[:-1])[0, 1] == pytest.approx(colour, abs=0.03)
    if resolution:
        steps = (noise + clean) / (resolution * 3e-9)
        assert np.max(np.abs(steps - np.round(steps))) < 1e-6


def same(a: HiddenRecord, b: HiddenRecord) -> bool:
    return all(
        np.array_equal(getattr(a, field.name), getattr(b, field.name))
        if isinstance(getattr(a, field.name), np.ndarray)
        else getattr(a, field.name) == getattr(b, field.name)
        for field in fields(a)
    )


def test_a_seed_makes_the_same_records_again() -> None:
    first = make(("creep", "friction"), 3, samples=1000)
    again = make(("creep", "friction"), 3, samples=1000)
    other = make(("creep", "friction"), 4, samples=1000)
    assert all(same(a, b) for a, b in zip(first, again, strict=True))
    assert not same(first[0], other[0])
    train, test = first
    (alone,) = make(("creep", "friction"), 3, samples=1000, test=False)
    assert same(alone, train)
    assert not np.array_equal(train.drive, test.drive)
    assert train.meta.intensities == test.meta.intensities
    assert train.meta.base.gain == test.meta.base.gain


def test_a_plant_that_gives_way_under_the_other_drive_is_not_taken() -> None:
    """Seed 351 draws a softening spring first that the second drive tears off."""
    for record in make(["cubic_stiffness"], 351):
        assert np.isfinite(record.position).all()


@pytest.mark.parametrize("name", CLASSES)
def test_every_class_is_of_the_size_it_says(name: str) -> None:
    train, test = make((name,), 1, samples=800)
    needs = {"temperature", "thermal_expansion"}
    for record in (train, test):
        assert record.effects == (() if name == "none" else (name,))
        assert record.time.shape == record.drive.shape == record.position.shape == (800,)
        assert np.all(np.isfinite(record.position))
        assert rms(record.position - record.clean) == pytest.approx(record.noise_rms)
        # A short record: a coloured noise has few independent ones.
        slack = 0.1 if record.meta.colour == 0.0 else 0.4
        assert record.noise_rms == pytest.approx(
            train.meta.unexplained / train.meta.ratio if name != "none" else train.noise_rms,
            rel=slack,
        )
        assert 5e-5 < record.noise_rms / record.meta.stroke < 2e-2
        if record.temperature is None:
            assert name not in needs
        else:
            assert record.temperature.shape == (800,)
            assert np.all(np.abs(record.temperature - 293.15) < 15.0)
            assert np.ptp(record.temperature) > 0.5
    if name == "none":
        assert train.meta.ratio == 0.0
    else:
        assert 3.0 <= train.meta.ratio <= 30.0
        assert measured_ratio(train) == pytest.approx(train.meta.ratio, rel=0.3)


def measured_ratio(record: HiddenRecord) -> float:
    """What a refit leaves of the reading *with* its noise, less the noise, over the noise."""
    drive = Drive(
        record.drive, 0, record.meta.rate, record.held, record.meta.kind, record.meta.bits
    )
    base = record.meta.base
    start = tangent(base, base.vector(), drive)
    left = rms(refit(base, drive, record.position, start))
    return float(np.sqrt(max(left**2 - record.noise_rms**2, 0.0)) / record.noise_rms)


def test_the_hard_level_is_small_and_nothing_hidden_is_noise() -> None:
    (hard,) = make(("nonlinear_gain",), 2, samples=3000, level="hard", test=False)
    assert 0.7 <= hard.meta.ratio <= 3.0
    (plain,) = make((), 2, samples=3000, test=False)
    drive = Drive(plain.drive, 0, plain.meta.rate, plain.held, plain.meta.kind, plain.meta.bits)
    start = tangent(plain.meta.base, plain.meta.base.vector(), drive)
    left = rms(refit(plain.meta.base, drive, plain.position, start))
    assert left == pytest.approx(plain.noise_rms, rel=0.02)


def test_two_effects_are_both_visible() -> None:
    train, _ = make(("creep", "backlash"), 1, samples=1500)
    assert train.effects == ("creep", "backlash")
    assert all(3.0 <= one <= 30.0 for one in train.meta.sizes)
    assert all(
        0.0 < own <= one for own, one in zip(train.meta.distinct, train.meta.sizes, strict=True)
    )


def test_records_vary_as_real_ones_do() -> None:
    facts = [make((), seed, samples=600, test=False)[0] for seed in range(60)]
    assert {fact.meta.kind for fact in facts} == {
        "steps", "triangles", "multisine", "chirp", "combined"
    }  # fmt: skip
    for property_ in (
        [f.held for f in facts], [f.meta.cut for f in facts], [f.meta.remanent for f in facts],
        [f.meta.static for f in facts], [f.meta.colour > 0.0 for f in facts],
        [f.meta.resolution > 0.0 for f in facts], [f.meta.bits is not None for f in facts],
        [f.meta.base.exponent > 1.0 for f in facts],
    ):  # fmt: skip
        assert 0.05 < np.mean(property_) < 0.75
    for fact in facts:
        natural = fact.meta.base.omega / (2.0 * np.pi)
        assert (fact.meta.rate < natural) if fact.meta.static else (fact.meta.rate >= 6.0 * natural)


def test_classes_are_effects_of_this_folder() -> None:
    def kinds(kind: type[Hidden]) -> set[str]:
        return {name for sub in kind.__subclasses__() for name in {sub.name, *kinds(sub)}}

    assert kinds(Hidden) == set(CLASSES) - {"none"}
    assert set(OUTSIDE) < set(CLASSES)


@pytest.mark.parametrize(
    ("classes", "options", "sentence"),
    [
        (("crep",), {}, "There is no class 'crep'"),
        (("creep", "creep"), {}, "name each effect once"),
        (("creep",), {"samples": 10}, "at least 500"),
        (("creep",), {"size": (3.0, 1.0)}, "positive number upwards"),
    ],
)
def test_what_cannot_be_made_is_said(
    classes: tuple[str, ...], options: dict[str, int], sentence: str
) -> None:
    with pytest.raises(ValueError, match=sentence):
        make(classes, 0, **options)  # type: ignore[arg-type]
