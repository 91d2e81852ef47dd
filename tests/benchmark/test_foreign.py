"""The second family of plants: independent, repeatable, converged, and of the size they say."""

from __future__ import annotations

import ast
from collections.abc import Callable
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from piezo_opt.benchmark import foreign
from piezo_opt.benchmark.foreign import CLASSES, INSIDE, draw_pairs, make
from piezo_opt.benchmark.foreign.charge import SourceResistance
from piezo_opt.benchmark.foreign.linear import superposed
from piezo_opt.benchmark.foreign.mechanics import Dahl, DragDamping, Duffing, Resonance
from piezo_opt.benchmark.foreign.operators import BoucWen, Preisach, play
from piezo_opt.benchmark.foreign.simulate import simulate

FOLDER = Path(foreign.__file__).parent
Array = NDArray[np.float64]


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values * values)))


def test_nothing_of_the_package_is_imported() -> None:
    for file in sorted(FOLDER.glob("*.py")):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.ImportFrom):
                modules = [str(node.module)]
            elif isinstance(node, ast.Import):
                modules = [alias.name for alias in node.names]
            else:
                continue
            for module in modules:
                own = module.startswith("piezo_opt.benchmark.foreign")
                assert own or not module.startswith("piezo_opt"), file.name


def test_a_play_is_its_recursion() -> None:
    u = np.cumsum(np.random.default_rng(0).standard_normal(700))
    last, expected = 0.3, []
    for value in u:
        last = max(value - 2.0, min(value + 2.0, last))
        expected.append(last)
    np.testing.assert_array_equal(play(u - 2.0, u + 2.0, 0.3), expected)


def test_preisach_is_its_relays() -> None:
    """Against 80,000 relays that switch one by one."""
    law = Preisach(0.0, 0.1, 0.6, 0.1, 0.2)
    drive = np.interp(np.arange(241) / 40.0, np.arange(7), [0.0, 1, -0.6, 0.7, -0.2, 0.5, -1])
    nodes = np.linspace(-1.5, 1.5, 401)
    centres = 0.5 * (nodes[1:] + nodes[:-1])
    up, down = np.meshgrid(centres, centres, indexing="ij")
    weights = np.exp(-(((0.5 * (up + down) - 0.1) / 0.6) ** 2)) * (
        np.exp(-(((0.5 * (up - down) - 0.1) / 0.2) ** 2))
        + np.exp(-(((0.5 * (up - down) + 0.1) / 0.2) ** 2))
    )
    weights *= np.where(up > down, 1.0, np.where(up == down, 0.5, 0.0))
    state = -np.ones_like(weights)
    expected = []
    for value in drive:
        state[up < value] = 1.0
        state[down > value] = -1.0
        expected.append(float(np.sum(state * weights)))
    raised = np.sum(weights[(up < 1.0) & (down > 0.0)])
    relays = np.array(expected) / (2.0 * raised)
    found = law(drive)
    assert np.ptp(found) > 1.0
    np.testing.assert_allclose(found - found[0], relays - relays[0], atol=0.02)


def test_bouc_wen_follows_its_equation() -> None:
    law = BoucWen(0.0, 2.0, -0.6, 1.4)
    drive = np.interp(np.arange(4001) / 1000.0, np.arange(5), [0.0, 1.0, -0.7, 0.6, 0.0])

    def slope(t: float, z: Array) -> Array:
        rate = [1.0, -1.7, 1.3, -0.6][min(int(t), 3)]
        return np.array(rate - 2.0 * abs(rate) * abs(z) ** 0.4 * z + 0.6 * rate * abs(z) ** 1.4)

    z, expected = np.zeros(1), [0.0]
    for k in range(4):
        part = solve_ivp(slope, (k, k + 0.999999), z, rtol=1e-9, atol=1e-12)
        z = part.y[:, -1]
        expected.append(float(z[0]))
    np.testing.assert_allclose(law(drive)[::1000], expected, atol=1e-4)


def test_superposition_of_an_exponential_is_its_low_pass() -> None:
    step, tau = 1e-3, 0.05
    time = step * np.arange(1500)
    signal = np.interp(time, [0.0, 0.4, 0.7, 1.5], [0.0, 1.0, -0.5, 0.2])
    answer = time + tau * np.expm1(-time / tau)  # of 1 - exp(-t / tau)
    found = superposed(signal, answer, step)
    expected = solve_ivp(
        lambda t, y: (np.interp(t, time, signal) - y) / tau, (0.0, time[-1]), [0.0],
        t_eval=time, rtol=1e-9, atol=1e-12, max_step=0.01,
    ).y[0]  # fmt: skip
    np.testing.assert_allclose(found, expected, atol=1e-7)


@pytest.mark.parametrize(
    ("force", "pull"),
    [
        (Duffing(0.1, 0.3), lambda x, _: 0.3 * x * (x / 0.1) ** 2),
        (DragDamping(0.1, 0.4), lambda _, v: 0.4 * abs(v) * v / 0.1),
    ],
)
def test_mechanics_with_a_force_follow_their_equation(
    force: Duffing | DragDamping, pull: Callable[[float, float], float]
) -> None:
    omega, zeta = 40.0, 0.1
    step = 0.1 / omega
    time = step * np.arange(600)
    free = 1e-2 + 0.06 * np.sin(0.7 * omega * time)
    found = Resonance(omega, zeta).moved(free, (force,), step)

    def motion(t: float, state: Array) -> list[float]:
        x, v = state
        s = 1e-2 + 0.06 * np.sin(0.7 * omega * t)
        return [v, omega**2 * (s - x - pull(x, v / omega)) - 2.0 * zeta * omega * v]

    begin = [float(found[0]), 0.0]
    expected = solve_ivp(
        motion, (0.0, time[-1]), begin, t_eval=time, rtol=1e-9, atol=1e-12
    ).y[0]  # fmt: skip
    np.testing.assert_allclose(found, expected, atol=3e-4)
    assert rms(found - Resonance(omega, zeta).moved(free, (), step)) > 0.003


def test_dry_friction_takes_its_share_of_a_slow_motion() -> None:
    way = np.concatenate([np.linspace(0.0, 1.0, 4000), np.linspace(1.0, 0.0, 4000)])
    found = Resonance(50.0, 0.7).moved(way, (Dahl(0.01, 1.0, 0.05),), 0.01)
    assert found[3500] - way[3500] == pytest.approx(-0.05, abs=2e-3)
    assert found[-500] - way[-500] == pytest.approx(0.05, abs=2e-3)


def test_a_loaded_drive_follows_its_equation() -> None:
    omega, zeta, rc, load = 40.0, 0.05, 0.003, 0.3
    step = 0.05 / omega
    time = step * np.arange(800)
    volts = np.sin(0.8 * omega * time) + 0.3 * np.sin(11.0 * time)
    source = SourceResistance(rc, 1.0, load)
    found = source.moved(lambda u: u + 0.2 * u**2, volts, Resonance(omega, zeta), step)

    def motion(t: float, state: Array) -> list[float]:
        u, x, v = state
        drive = np.sin(0.8 * omega * t) + 0.3 * np.sin(11.0 * t)
        pull = omega**2 * (u + 0.2 * u**2 - x) - 2.0 * zeta * omega * v
        return [(drive - load * v / omega - u) / rc, v, pull]

    expected = solve_ivp(
        motion, (0.0, time[-1]), [0.0, 0.0, 0.0], t_eval=time, rtol=1e-9, atol=1e-12
    ).y[1]  # fmt: skip
    np.testing.assert_allclose(found, expected, atol=3e-3)


@pytest.mark.parametrize("name", [n for n in CLASSES if n != "none"])
def test_every_class_makes_records_of_the_size_it_says(name: str) -> None:
    train, test = make((name,), 5, samples=2000)
    assert train.effects == (name,)
    assert 3.0 <= train.meta.ratio <= 30.0
    plain = simulate(train.meta.plant, (), train.meta.take)
    # What the effect changes is no less than what is left of the change.
    assert rms(train.clean - plain) >= 0.999 * train.meta.ratio * train.noise_rms / np.sqrt(1.6)
    for record in (train, test):
        assert 500 <= record.time.size <= 2000
        assert record.drive.shape == record.position.shape == record.time.shape
        assert rms(record.position - record.clean) == pytest.approx(record.noise_rms)
        assert np.isfinite(record.position).all()


@pytest.mark.parametrize("name", ["friction", "slew_limit", "second_mode", "delay"])
def test_halving_the_sub_steps_changes_less_than_a_tenth_of_the_noise(name: str) -> None:
    for record in make((name,), 7, samples=2000):
        meta = record.meta
        finer = simulate(meta.plant, meta.effects, meta.take.finer())
        change = rms(finer - record.clean)
        assert change < 0.1 * record.noise_rms


def test_it_repeats_and_seeds_differ() -> None:
    first, again, other = (make(("creep",), seed, samples=1000)[0] for seed in (3, 3, 4))
    np.testing.assert_array_equal(first.position, again.position)
    assert first.time.size != other.time.size or np.any(first.position != other.position)
    hard = make(("creep",), 3, samples=1000, level="hard")[0]
    assert 0.7 <= hard.meta.ratio <= 3.0


def test_plants_are_of_all_sorts() -> None:
    made = [make((), seed, samples=600)[0].meta for seed in range(60)]
    laws = [type(meta.plant.operator).__name__ for meta in made]
    assert laws.count("PrandtlIshlinskii") > 15
    assert laws.count("Preisach") > 15
    assert 1 <= laws.count("BoucWen") < 15
    assert 15 < sum(meta.static for meta in made) < 45
    assert len({meta.kind for meta in made}) == 6


def test_pairs_act_at_different_places_and_are_distinct() -> None:
    pairs = list(islice(draw_pairs(0), 30))
    assert len(set(pairs)) > 20
    assert all(INSIDE[a].place != INSIDE[b].place for a, b in pairs)
    record = make(("creep", "mains_pickup"), 1, samples=2000)[0]
    assert all(3.0 <= size <= 30.0 for size in record.meta.sizes)
    assert all(0.0 < d <= s for d, s in zip(record.meta.distinct, record.meta.sizes, strict=True))


def test_bad_questions_are_refused() -> None:
    with pytest.raises(ValueError, match="crepe"):
        make(("crepe",), 0)
    with pytest.raises(ValueError, match="at least 500"):
        make((), 0, samples=100)
