"""Predictive control: the program against another solver, the filter against its textbook, laws."""

from __future__ import annotations

import daqp
import numpy as np
import pytest

from piezo_opt.control import MPC, Limits, ModelPlant, Observer, close_loop
from piezo_opt.control.horizon import Horizon
from piezo_opt.control.qp import FAR, HorizonProgram, solve_program
from piezo_opt.control.whole import WholeMPC
from piezo_opt.effects import BoucWen, Creep, Delay, PiezoGain, SecondOrder
from piezo_opt.errors import InputError

STAGE = PiezoGain() + BoucWen() + Creep(elements=1) + SecondOrder()
VALUES = {
    "piezo_gain.d": 1.5e-7, "bouc_wen.alpha": 5e-8, "bouc_wen.beta": 0.03,
    "bouc_wen.gamma": -0.005, "creep.c": 0.05, "creep.tau": 1.0,
    "second_order.omega": 2.0 * np.pi * 200.0, "second_order.zeta": 0.03,
}  # fmt: skip
PERIOD = 1e-3
SPAN = 6e-6


def triangles(samples: int, frequency: float = 10.0) -> np.ndarray:
    phase = (np.arange(samples) * PERIOD * frequency) % 1.0
    return np.asarray(SPAN * (1.0 - np.abs(2.0 * phase - 1.0)))


def programs(number: int) -> list[HorizonProgram]:
    """Random, stable and not, with tight and loose limits, half of them with soft ones."""
    generator, made = np.random.default_rng(5), []
    for _ in range(number):
        n, nz = int(generator.integers(3, 25)), int(generator.integers(2, 6))
        a, b = np.zeros((n, nz, nz)), 0.3 * generator.normal(size=(n, nz))
        root = generator.normal(size=(nz - 1, nz - 1))
        root *= generator.uniform(0.3, 1.02) / np.abs(np.linalg.eigvals(root)).max()
        a[:, :-1, :-1] = root + 0.02 * generator.normal(size=(n, nz - 1, nz - 1))
        a[:, :-1, -1] = 0.3 * generator.normal(size=(n, nz - 1))
        a[:, -1, -1] = b[:, -1] = 1.0
        move, most = 10.0 ** generator.uniform(-1.5, 0.5), 10.0 ** generator.uniform(-1.0, 1.0)
        limits = np.tile([-move, move, -most, most, -FAR, FAR], (n, 1))
        if generator.random() < 0.5:
            limits[:, 4:] = most * generator.uniform(0.2, 2.0) * np.array([-1.0, 1.0])
        made.append(
            HorizonProgram(
                a, b, generator.normal(size=(n, nz)),
                np.cumsum(generator.normal(size=n)) * generator.random(),
                np.full(n, generator.uniform(0.1, 10.0)), 0.1 * generator.normal(size=n),
                10.0 ** generator.uniform(-3.0, 0.0), limits, 10.0 ** generator.uniform(0.0, 3.0),
            )
        )  # fmt: skip
    return made


def dense(p: HorizonProgram) -> tuple[np.ndarray, np.ndarray]:
    """(N, N) outputs and drives of unit moves."""
    n, nz = p.b.shape
    now, states = np.zeros((nz, n)), []
    for k in range(n):
        now = p.a[k] @ now + np.outer(p.b[k], np.eye(n)[k])
        states.append(now)
    whole = np.array(states)
    return np.einsum("ki,kij->kj", p.c, whole), whole[:, -1]


def test_two_thousand_programs_have_the_answer_of_another_solver() -> None:
    for p in programs(2000):
        n = p.e.size
        found = solve_program(p)
        by, drive = dense(p)
        soft = p.limits[0, 5] < FAR
        extra = n if soft else 0
        h = np.zeros((n + extra, n + extra))
        h[:n, :n] = by.T @ (p.q[:, None] * by) + p.r * np.eye(n)
        h[n:, n:] = 1e-9 * np.eye(extra)
        g = np.concatenate([p.g - by.T @ (p.q * p.e), np.full(extra, p.price)])
        none, wide = np.zeros((n, extra)), np.full(n, FAR)
        rows = [np.hstack([np.eye(n), none]), np.hstack([drive, none])]
        low, high = [p.limits[:, 0], p.limits[:, 2]], [p.limits[:, 1], p.limits[:, 3]]
        if soft:
            one = np.eye(n)
            rows += [np.hstack([by, -one]), np.hstack([by, one]), np.hstack([none, one])]
            low += [-wide, p.limits[:, 4], np.zeros(n)]
            high += [p.limits[:, 5], wide, wide]
        x, *_ = daqp.solve(h, g, np.vstack(rows), np.concatenate(high), np.concatenate(low))

        def cost(w: np.ndarray, p: HorizonProgram = p, by: np.ndarray = by) -> float:
            y = by @ w
            passed = np.clip(y - p.limits[:, 5], 0.0, None) + np.clip(p.limits[:, 4] - y, 0.0, None)
            own = 0.5 * p.q @ (y - p.e) ** 2 + 0.5 * p.r * w @ w + p.g @ w
            return float(own + p.price * passed.sum())

        theirs = cost(x[:n])
        assert cost(found.w) <= theirs + 1e-6 * (1e-6 + 0.5 * p.q @ p.e**2)
        assert np.abs(found.w).max() <= p.limits[0, 1] * (1.0 + 1e-6)
        assert np.abs(drive @ found.w).max() <= p.limits[0, 3] * (1.0 + 1e-6)


def test_bad_programs_are_refused() -> None:
    (p,) = programs(1)
    with pytest.raises(InputError, match="finite numbers"):
        solve_program(HorizonProgram(p.a, p.b, p.c, p.e * np.nan, p.q, p.g, p.r, p.limits))
    with pytest.raises(InputError, match="not below"):
        solve_program(HorizonProgram(p.a, p.b, p.c, p.e, p.q, p.g, p.r, -p.limits))


def test_the_linearisation_is_that_of_the_plant() -> None:
    horizon = Horizon(STAGE, VALUES, PERIOD)
    moves = 5.0 * np.random.default_rng(2).normal(size=6)
    x = horizon.rest(20.0)
    there = horizon.along(0.0, x, 20.0, moves)
    plant = ModelPlant(STAGE, VALUES)
    plant.begin(20.0)
    read = [plant.advance(u, PERIOD) for u in 20.0 + np.cumsum(moves)]
    assert there.reading == pytest.approx(np.array(read), rel=1e-12)
    for k in range(6):
        step = np.zeros(6)
        step[k] = 1e-3
        up, down = (horizon.along(0.0, x, 20.0, moves + s * step).reading for s in (1.0, -1.0))
        now, slopes = np.zeros(x.size + 1), []
        for i in range(6):
            now = there.a[i] @ now + there.b[i] * (i == k)
            slopes.append(there.c[i] @ now)
        assert slopes == pytest.approx((up - down) / 2e-3, abs=1e-6 * np.abs(slopes).max())


def test_on_a_linear_model_the_filter_is_kalman_s() -> None:
    model = PiezoGain() + Creep(elements=1) + SecondOrder()
    values = {k: v for k, v in VALUES.items() if not k.startswith("bouc")}
    observer = Observer(model, values, period=PERIOD, noise=1e-8, drive_noise=0.5, drift=2e-9)
    generator = np.random.default_rng(1)
    drives = np.cumsum(generator.normal(size=60))
    readings = 1.5e-7 * drives + 1e-8 * generator.normal(size=60)
    readings[[7, 8, 30]] = [np.nan, np.inf, np.nan]
    estimate = observer.begin(0.0)
    x, p = estimate.states, estimate.covariance
    before = 0.0
    for drive, reading in zip(drives.tolist(), readings.tolist(), strict=True):
        estimate = observer.after(estimate, drive, reading)
        # The same, as textbooks write it, with matrices by differences of the linear plant.
        n = x.size - 1
        h = observer.horizon

        def moved(state: np.ndarray, u: float, v: float, h: Horizon = h) -> np.ndarray:
            return h.along(0.0, state, u, np.array([v - u])).end

        zero = np.zeros(n)
        f = np.eye(n + 1)
        f[:n, :n] = np.column_stack([moved(e, 0.0, 0.0) for e in np.eye(n)])
        noise = np.zeros((n + 1, n + 1))
        for column in (moved(zero, 1.0, 0.0), moved(zero, 0.0, 1.0)):
            noise[:n, :n] += 0.5**2 * np.outer(column, column)
        noise[n, n] = 2e-9**2
        c = np.append([h.reading(0.0, e, 0.0) for e in np.eye(n)], 1.0)
        x = np.append(moved(x[:n], before, drive), x[n])
        p = f @ p @ f.T + noise
        if np.isfinite(reading):
            gain = p @ c / (c @ p @ c + 1e-8**2)
            x = x + gain * (reading - h.reading(0.0, x[:n], drive) - x[n])
            p = p - np.outer(gain, c @ p)
        before = drive
        assert estimate.used == np.isfinite(reading)
        assert estimate.states == pytest.approx(x, rel=1e-8, abs=1e-17)
    assert np.sqrt(np.diag(estimate.covariance)) == pytest.approx(np.sqrt(np.diag(p)), rel=1e-6)


def test_the_filter_finds_the_hysteretic_state() -> None:
    """Begun with a wrong loop state it ends near the plant's, from readings alone."""
    plant, observer = ModelPlant(STAGE, VALUES), Observer(
        STAGE, VALUES, period=PERIOD, noise=2e-9, drive_noise=0.05, drift=0.0
    )  # fmt: skip
    plant.begin(0.0)
    drives = 40.0 * (1.0 - np.cos(2.0 * np.pi * 20.0 * PERIOD * np.arange(300)))
    estimate = observer.begin(0.0, uncertainty=1e-9)
    wrong = estimate.states.copy()
    index = observer.horizon.system.state_names.index("bouc_wen.h")
    wrong[index] = 3e-7
    spread = estimate.covariance.copy()
    spread[index, index] = 3e-7**2
    estimate = type(estimate)(0.0, wrong, spread, 0.0, 0.0)
    generator = np.random.default_rng(4)
    for drive in drives.tolist():
        reading = plant.advance(drive, PERIOD) + 2e-9 * generator.normal()
        estimate = observer.after(estimate, drive, reading)
    truth = plant._x[index]
    assert estimate.states[index] == pytest.approx(truth, abs=2e-8)
    assert np.linalg.eigvalsh(estimate.covariance).min() > -1e-24


def asked(**more: object) -> MPC:
    given: dict[str, object] = {
        "period": PERIOD, "span": SPAN, "horizon": 30, "weight": 1e-5, "noise": 5e-9, **more,
    }  # fmt: skip
    return MPC(STAGE, VALUES, **given)  # type: ignore[arg-type]


def test_it_tracks_within_its_limits() -> None:
    limits = Limits(-5.0, 42.0, 8.5e3)
    reference = triangles(400)
    loop = close_loop(
        ModelPlant(STAGE, VALUES), asked(limits=limits, reference=reference), reference,
        period=PERIOD, limits=limits, noise=5e-9,
    )  # fmt: skip
    assert loop.rms < 15e-9
    assert loop.drive.max() <= 42.0
    assert loop.drive.max() > 41.99
    assert loop.drive.min() >= -5.0
    assert np.abs(np.diff(loop.drive)).max() <= 8.5 * (1.0 + 1e-12)


def test_one_iteration_costs_what_the_converged_solution_costs() -> None:
    limits, reference = Limits(-5.0, 150.0, 6e3), triangles(600)
    volts = SPAN / 1.05e-7

    def cost(rounds: int) -> float:
        loop = close_loop(
            ModelPlant(STAGE, VALUES),
            asked(limits=limits, reference=reference, rounds=rounds, horizon=50),
            reference, period=PERIOD, limits=limits,
        )  # fmt: skip
        return float(
            np.sum((loop.error[1:] / SPAN) ** 2) + 1e-5 * np.sum((np.diff(loop.drive) / volts) ** 2)
        )

    assert cost(1) <= 1.01 * cost(15)


def test_where_the_drive_ends_too_low_one_iteration_costs_the_same() -> None:
    """Behind corners of the law a whole step may cost twice what is planned: 4 % of the loop's."""
    limits, reference = Limits(-5.0, 38.0, 8.5e3), triangles(400)

    def cost(rounds: int) -> float:
        own = asked(limits=limits, reference=reference, rounds=rounds, horizon=50)
        return sum(
            close_loop(
                ModelPlant(STAGE, VALUES), own, reference, period=PERIOD, limits=limits,
                noise=5e-9, seed=seed,
            ).rms ** 2
            for seed in range(3)
        )  # fmt: skip

    assert cost(1) <= 1.01 * cost(8)


def test_no_offset_stays_where_model_and_plant_differ() -> None:
    other = {**VALUES, "piezo_gain.d": 1.7e-7, "creep.c": 0.08}
    reference = np.full(600, 3e-6)
    loop = close_loop(
        ModelPlant(STAGE, other), asked(limits=Limits(-30.0, 150.0)), reference, period=PERIOD,
        disturbance=2e-7,
    )  # fmt: skip
    assert np.abs(loop.error[-100:]).max() < 1e-9


def test_a_delay_is_predicted_over() -> None:
    reference = triangles(400)
    loops = [
        close_loop(
            ModelPlant(STAGE, VALUES),
            asked(delay=known, reference=reference, limits=Limits(-30.0, 150.0)),
            reference, period=PERIOD, delay=2, limits=Limits(-30.0, 150.0),
        )
        for known in (2, 0)
    ]  # fmt: skip
    assert loops[0].rms < 20e-9
    assert loops[1].rms > 5.0 * loops[0].rms
    with pytest.raises(InputError, match="longer horizon"):
        asked(delay=30)
    late = MPC(Delay() + STAGE, {**VALUES, "delay.T": 1.5e-3}, period=PERIOD, span=SPAN)
    assert late.delay == 2


def test_the_stroke_is_kept_where_the_reference_asks_for_more() -> None:
    loop = close_loop(
        ModelPlant(STAGE, VALUES), asked(stroke=(-1e-7, 5e-6), reference=triangles(300)),
        triangles(300), period=PERIOD,
    )  # fmt: skip
    assert loop.position.max() < 5.01e-6
    assert loop.position.max() > 4.95e-6


def test_it_reads_nothing_of_the_plant_but_the_measurement() -> None:
    class Replay:
        def __init__(self, readings: np.ndarray) -> None:
            self._left = list(readings)

        def begin(self, drive: float) -> float:
            return float(self._left.pop(0))

        def advance(self, drive: float, period: float) -> float:
            return float(self._left.pop(0)) if self._left else 0.0

    given = {"period": PERIOD, "limits": Limits(0.0, 60.0, 1e4), "noise": 5e-9, "seed": 3}
    reference = triangles(100)
    one = asked(limits=given["limits"], reference=reference)
    first = close_loop(ModelPlant(STAGE, VALUES), one, reference, **given)  # type: ignore[arg-type]
    again = close_loop(Replay(first.position), one, reference, **given)  # type: ignore[arg-type]
    assert (again.drive == first.drive).all()


@pytest.mark.parametrize("solver", ["ipopt", "fatrop"])
def test_on_a_linear_model_general_solvers_give_the_same_drive(solver: str) -> None:
    model = PiezoGain() + Creep(elements=1) + SecondOrder()
    values = {k: v for k, v in VALUES.items() if not k.startswith("bouc")}
    limits, reference = Limits(-5.0, 25.0, 6e3), triangles(60)
    mine = MPC(
        model, values, period=PERIOD, span=SPAN, horizon=20, limits=limits, weight=1e-3,
        reference=reference, noise=5e-9,
    )  # fmt: skip
    loops = [
        close_loop(ModelPlant(model, values), c, reference, period=PERIOD, limits=limits)
        for c in (mine, WholeMPC(mine, solver))
    ]
    # Their tolerance is one of a cost of 1e-6.
    assert loops[0].drive == pytest.approx(loops[1].drive, abs=1e-2)
    assert loops[0].drive.max() == pytest.approx(25.0, abs=1e-2)


def test_lost_samples_and_limits_that_cannot_be_met() -> None:
    """The drive stays a number within what is allowed, whatever is read."""
    controller = asked(limits=Limits(10.0, 20.0, 1e3))
    state, before, generator = controller.begin(), 90.0, np.random.default_rng(0)
    for k in range(300):
        reading = [np.nan, np.inf, 1e300, -1e300, 1e-6][int(generator.integers(5))]
        reference = np.nan if k % 50 == 7 else 3e-6 * generator.normal()
        low, high = max(10.0, before - 1.0), min(20.0, before + 1.0)
        if low > high:
            low = high = before - 1.0
        drive, state = controller.act(state, reference, reading, PERIOD, low, high)
        assert low <= drive <= high
        before = drive
    with pytest.raises(InputError, match="all are positive"):
        asked(weight=0.0)
    with pytest.raises(InputError, match="noise and the gate are positive"):
        asked(noise=0.0)
