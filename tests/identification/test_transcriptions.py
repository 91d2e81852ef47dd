"""One question, every transcription: the same optimum, and what each cannot do."""

from __future__ import annotations

import _thread
import threading
from collections.abc import Mapping
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

from piezo_opt.effects import BoucWen, Creep, Delay, Offset, PiezoGain, SecondOrder
from piezo_opt.effects.model import Model
from piezo_opt.effects.strain.prandtl_ishlinskii import PrandtlIshlinskii
from piezo_opt.errors import InputError, ModelError
from piezo_opt.identification.collocation import Collocation
from piezo_opt.identification.horizon import Horizon
from piezo_opt.identification.layout import Layout
from piezo_opt.identification.monitor import Monitor
from piezo_opt.identification.multiple_shooting import MultipleShooting
from piezo_opt.identification.objective import Objective
from piezo_opt.identification.outcome import Ending
from piezo_opt.identification.problem import Identification, Loss, Prior, Shape, Start
from piezo_opt.identification.program import Program, functions
from piezo_opt.identification.solvers.base import Solution
from piezo_opt.identification.solvers.levenberg_marquardt import LevenbergMarquardt
from piezo_opt.identification.solvers.nonlinear_program import Fatrop, Ipopt, Sqp
from piezo_opt.identification.transcription import SingleShooting, Transcription
from piezo_opt.identification.unknowns import Unknowns, theta_of, unknowns
from piezo_opt.measurement import Between, Campaign, Measurement
from piezo_opt.simulation import Initial, simulate
from piezo_opt.symbolic import kinks, smoothed
from piezo_opt.values import Values

MODEL = PiezoGain() + BoucWen() + SecondOrder() + Offset()
QUASI_STATIC = PiezoGain() + BoucWen() + Offset()
TRUTH = {
    "piezo_gain.d": 1.2e-7, "bouc_wen.alpha": 5e-8, "bouc_wen.beta": 3e-2,
    "bouc_wen.gamma": -8e-3, "second_order.omega": 2 * np.pi * 200.0,
    "second_order.zeta": 0.05, "offset.y0": 2e-7,
}  # fmt: skip
NOISE = 2e-3
"""Standard deviation of the noise as a share of the stroke."""


def record(
    samples: int, model: Model = MODEL, *, truth: Mapping[str, float] = TRUTH, seed: int = 0,
    step: float = 2.5e-4, between: Between = Between.LINEAR, periods: int = 0,
    top: float = 300.0,
) -> Measurement:  # fmt: skip
    """A slow loop with a chirp over the resonance, or a repeated drive."""
    t = np.arange(samples) * step
    length = samples * step
    if periods:
        once = 2 * np.pi * periods * t / length
        drive = 50 + 35 * np.sin(once) + 10 * np.sin(9 * once)
    else:
        drive = 50 + 35 * np.sin(6 * np.pi * t / length) * np.cos(2 * np.pi * t / length)
        drive = drive + 10 * np.sin(2 * np.pi * (20 * t + (top - 20) / 2 / length * t**2))
    period = length / periods if periods else None
    blank = Measurement(
        t, drive, drive * 1e-7, between=between, period=period, allow_saturated=True
    )
    known = Values.nominal(model).with_({k: v for k, v in truth.items() if k in model.parameters})
    initial = Initial.PERIODIC if periods else Initial.REST
    clean = simulate(model, blank, known, initial=initial).reading
    noise = NOISE * np.ptp(clean) * np.random.default_rng(seed).standard_normal(samples)
    return blank.with_(position=clean + noise)


def begun(
    question: Identification, values: Mapping[str, float] | None = None
) -> tuple[Unknowns, np.ndarray]:
    """A start a fifth away from the truth, to alternating sides."""
    off = {k: v * (1.2 if i % 2 else 1 / 1.2) for i, (k, v) in enumerate(TRUTH.items())}
    model = question.model
    start = Values.nominal(model).with_({k: v for k, v in off.items() if k in model.parameters})
    start = start.with_({**(values or {})})
    listed = unknowns(question, start)
    return listed, theta_of(listed, start)


def run(
    question: Identification, transcription: Transcription, solver: object | None = None,
    values: Mapping[str, float] | None = None,
) -> tuple[Solution, Monitor, Unknowns]:  # fmt: skip
    listed, theta = begun(question, values)
    monitor = Monitor(listed.names)
    solution = transcription.identify(question, listed, theta, solver, monitor)
    return solution, monitor, listed


def agree(
    question: Identification, others: tuple[tuple[Transcription, object], ...], tolerance: float
) -> None:
    """All transcriptions end where single shooting ends, in sizes of the unknowns."""
    reference, _, listed = run(question, SingleShooting(), LevenbergMarquardt(tolerance=1e-13))
    assert reference.ending is Ending.CONVERGED
    for transcription, solver in others:
        solution, monitor, _ = run(question, transcription, solver)
        assert solution.ending is Ending.CONVERGED, solution.sentence
        difference = (solution.theta - reference.theta) / listed.scale
        assert_allclose(difference, 0.0, atol=tolerance, err_msg=transcription.name)
        assert_allclose(monitor.trace.values[-1], solution.theta, rtol=1e-6, atol=1e-12)


def test_three_transcriptions_recover_seven_parameters_alike() -> None:
    question = Identification(MODEL, record(1500), start=Start.REST)
    reference, _, listed = run(question, SingleShooting(), LevenbergMarquardt(tolerance=1e-13))
    truth = np.array([TRUTH[name] for name in listed.names])
    assert_allclose(reference.theta, truth, rtol=0.15, atol=1e-8)
    for transcription in (MultipleShooting(), Collocation()):
        solution, *_ = run(question, transcription)
        assert solution.ending is Ending.CONVERGED
        assert_allclose(solution.theta, reference.theta, rtol=1e-4, err_msg=transcription.name)


@pytest.mark.parametrize(
    ("transcription", "solver", "tolerance"),
    [
        (MultipleShooting(samples_per_node=7), Ipopt(), 1e-6),
        (MultipleShooting(), Ipopt(curvature="gauss_newton"), 1e-6),
        (MultipleShooting(), Fatrop(), 1e-5),
        (MultipleShooting(samples_per_node=40), Sqp(), 1e-6),
        (MultipleShooting(samples_per_node=100), Ipopt(), 1e-6),
        (Collocation(degree=2), Ipopt(), 1e-3),
        (Collocation(degree=3, scheme="radau"), Ipopt(), 1e-3),
        (MultipleShooting(smoothing=1e-4), Ipopt(), 1e-4),
        (Collocation(smoothing=1e-4), Ipopt(), 1e-3),
    ],
)
def test_every_choice_ends_at_the_same_optimum(
    transcription: Transcription, solver: object, tolerance: float
) -> None:
    agree(
        Identification(MODEL, record(250), start=Start.REST), ((transcription, solver),), tolerance
    )


def test_free_initial_states_and_several_records() -> None:
    first, second = record(200, seed=1), record(160, seed=2)
    cut = second.with_(
        name="second",
        time=second.time[30:],
        drive=second.drive[30:],
        position=second.position[30:] + 3e-7,
    )
    question = Identification(
        MODEL, Campaign((first, cut)), start=Start.FREE, weights=(1.0, 2.0),
        fixed={"second_order.zeta": 0.05},
    )  # fmt: skip
    listed, _ = begun(question)
    assert sum(name.startswith("initial.") for name in listed.names) == 6
    assert "offset.y0[1]" in listed.names
    agree(question, ((MultipleShooting(), Ipopt()), (MultipleShooting(5), Fatrop())), 2e-5)
    agree(question, ((Collocation(), Ipopt()),), 5e-3)


def test_a_periodic_record_closes_on_itself() -> None:
    question = Identification(MODEL, record(240, periods=2))
    assert question.start_of(question.campaign.records[0]) is Start.PERIODIC
    agree(question, ((MultipleShooting(), Ipopt()),), 1e-5)
    agree(question, ((Collocation(), Ipopt()),), 5e-3)
    with pytest.raises(ModelError, match=r"periodic.*Ipopt"):
        run(question, MultipleShooting(), Fatrop())


def test_robust_loss_and_prior_in_every_transcription() -> None:
    clean = record(250)
    position = np.array(clean.position)
    position[[40, 90, 170]] += 3e-6
    question = Identification(
        MODEL, clean.with_(position=position), start=Start.REST,
        loss=Loss(Shape.SOFT_L1, 5e-8), noise=3e-8,
        priors={"second_order.zeta": Prior(0.06, 1e-3)},
    )  # fmt: skip
    agree(question, ((MultipleShooting(), Ipopt()), (MultipleShooting(9), Fatrop())), 2e-5)
    agree(question, ((Collocation(), Ipopt()),), 2e-3)


def test_bounds_are_kept_and_the_one_touched_is_met_exactly() -> None:
    high = 0.04
    question = Identification(
        MODEL, record(250), start=Start.REST, bounds={"second_order.zeta": (1e-3, high)}
    )
    for transcription, solver in ((MultipleShooting(), Ipopt()), (MultipleShooting(5), Fatrop())):
        solution, monitor, listed = run(question, transcription, solver)
        place = listed.names.index("second_order.zeta")
        assert solution.theta[place] == high
        assert (monitor.trace.values <= listed.high).all()
        assert (monitor.trace.values >= listed.low).all()


def test_a_held_drive_a_start_up_and_a_chain_without_mechanics() -> None:
    held = record(200, QUASI_STATIC, between=Between.HELD)
    question = Identification(QUASI_STATIC, held.with_(startup=0.01), start=Start.REST)
    agree(question, ((MultipleShooting(), Ipopt()), (MultipleShooting(8), Fatrop())), 1e-5)
    agree(question, ((Collocation(), Ipopt()),), 1e-3)


def test_a_model_without_states_is_a_program_of_its_unknowns() -> None:
    model = PiezoGain() + Offset()
    question = Identification(model, record(60, model), start=Start.REST)
    agree(question, ((MultipleShooting(), Ipopt()), (Collocation(), Ipopt())), 1e-7)


def test_a_column_of_states_and_a_fixed_exponent_of_its_own() -> None:
    model = PiezoGain() + BoucWen() + Creep() + Offset()
    known = {**TRUTH, "creep.c": 0.05, "creep.tau": 0.5}
    slow = record(150, model, step=0.05, truth=known)
    question = Identification(
        model, slow, start=Start.REST,
        fixed={"bouc_wen.n": 1.3, "bouc_wen.gamma": 0.0, "creep.tau": 0.5},
    )  # fmt: skip
    agree(question, ((MultipleShooting(), Ipopt()),), 1e-4)


def test_a_wrong_resonance_traps_single_shooting_only() -> None:
    question = Identification(MODEL, record(800, top=400.0), start=Start.REST)
    omega_wrong = 0.5 * TRUTH["second_order.omega"]
    wrong = {**TRUTH, "second_order.omega": omega_wrong, "second_order.zeta": 0.02}
    trapped, _, listed = run(question, SingleShooting(), values=wrong)
    omega = listed.names.index("second_order.omega")
    assert trapped.theta[omega] < 0.7 * TRUTH["second_order.omega"]
    for transcription in (MultipleShooting(), Collocation(degree=2)):
        found, *_ = run(question, transcription, values=wrong)
        assert found.theta[omega] == pytest.approx(TRUTH["second_order.omega"], rel=1e-3)


def test_hessian_jacobian_and_gradient_are_those_of_the_program() -> None:
    question = Identification(
        MODEL, record(30), start=Start.REST, loss=Loss(Shape.CAUCHY, 1e-6), noise=3e-8,
        priors={"piezo_gain.d": Prior(1e-7, 1e-8)},
    )  # fmt: skip
    listed, theta = begun(question)
    horizon = Horizon.of(Objective(question, listed, theta, Monitor(listed.names)), theta)
    random = np.random.default_rng(0)
    for stagewise in (False, True):
        program: Program = MultipleShooting(4).transcribe(horizon, stagewise)
        made = functions(program, "exact")
        x = program.start + 1e-2 * random.standard_normal(program.start.size)
        lam = random.standard_normal(program.constraints)
        toward = random.standard_normal(x.size)

        def slope(at: np.ndarray) -> np.ndarray:
            _, gradient = made.gradient(at, [])  # noqa: B023
            _, jacobian = made.jacobian(at, [])  # noqa: B023
            return np.array(gradient).ravel() + np.array(jacobian.T @ lam).ravel()  # noqa: B023

        def value(at: np.ndarray) -> float:
            f, _, g, _ = made.both(at, [])  # noqa: B023
            return float(f) + float(np.array(g).ravel() @ lam)  # noqa: B023

        h = 1e-5
        first = (value(x + h * toward) - value(x - h * toward)) / (2 * h)
        assert slope(x) @ toward == pytest.approx(first, rel=1e-5)
        second = (slope(x + h * toward) - slope(x - h * toward)) / (2 * h)
        hessian = np.array(made.full_hessian(x, [], 1.0, lam))
        assert_allclose(hessian @ toward, second, rtol=2e-4, atol=2e-4 * np.abs(second).max())
        assert_allclose(np.triu(hessian), np.array(made.hessian(x, [], 1.0, lam)))


def test_the_layout_numbers_every_variable_and_row_once() -> None:
    for stagewise in (False, True):
        layout = Layout.of((3, 2), (False, False), 2, 4, 3, stagewise)
        used = [layout.states.ravel(), layout.controls[layout.controls >= 0].ravel()]
        used.append(layout.unknowns.ravel() if stagewise else layout.unknowns[0])
        assert sorted(np.concatenate(used)) == list(range(layout.variables))
        rows = [layout.leads.ravel(), layout.keeps.ravel(), layout.others[layout.others >= 0]]
        assert sorted(np.concatenate(rows)) == list(range(layout.rows))
    assert layout.stages is not None
    steps = sum(layout.stages.states[1:])
    assert steps + sum(layout.stages.others) == layout.rows


def test_corners_are_rounded_near_them_and_nowhere_else() -> None:
    x = ca.SX.sym("x", 2)
    parts = [ca.fabs(x[0]), ca.sign(x[1]), ca.fmin(x[0], x[1]), ca.fmax(x[0], x[1])]
    sharp = ca.Function("sharp", [x], [ca.vertcat(*parts, ca.exp(x[0]) / x[1])])
    assert_allclose(np.array(kinks(sharp)([2.0, -3.0])).ravel(), [2.0, -3.0, 5.0, 5.0])
    width = 1e-3
    soft = smoothed(sharp, (width,) * 4)
    for point in ([2.0, -3.0], [-1.0, 0.5]):
        assert_allclose(np.array(soft(point)), np.array(sharp(point)), atol=2 * width**2)
    # At the corner: |0| is the width, sign and the slope of |x| pass through 0.
    at_corner = np.array(soft([0.0, 0.0])).ravel()[:4]
    assert_allclose(at_corner, [width, 0.0, -width / 2, width / 2], atol=1e-15)
    slope = np.array(soft.jacobian()([0.0, 1.0], np.zeros(5)))
    assert slope[0, 0] == 0.0
    assert np.array(soft.jacobian()([1.0, 0.0], np.zeros(5)))[1, 1] == pytest.approx(1 / width)
    kept = smoothed(sharp, (0.0,) * 4)
    assert_allclose(np.array(kept([0.0, -0.0]))[:4].ravel(), 0.0)


def test_a_delay_is_followed_when_kept_and_refused_when_estimated() -> None:
    model = Delay() + PiezoGain() + BoucWen() + SecondOrder() + Offset()
    delayed = record(200, model, truth={**TRUTH, "delay.T": 6e-4})
    kept = Identification(model, delayed, start=Start.REST, fixed={"delay.T": 6e-4})
    agree(kept, ((MultipleShooting(), Ipopt()),), 1e-5)
    for transcription in (MultipleShooting(), Collocation()):
        with pytest.raises(ModelError, match=r"SingleShooting.*fixed"):
            run(Identification(model, delayed, start=Start.REST), transcription)


def test_a_law_that_jumps_is_shot_but_not_collocated() -> None:
    model = PrandtlIshlinskii() + Offset()
    question = Identification(model, record(60, model), start=Start.REST)
    with pytest.raises(ModelError, match=r"prandtl_ishlinskii.*jump.*SingleShooting"):
        run(question, Collocation())


def test_fatrop_is_for_shooting() -> None:
    question = Identification(MODEL, record(60), start=Start.REST)
    with pytest.raises(ModelError, match=r"multiple shooting only.*Ipopt"):
        run(question, Collocation(), Fatrop())


@pytest.mark.parametrize("solver", [Ipopt(iterations=2), Fatrop(iterations=2), Sqp(iterations=1)])
def test_a_limit_is_said_and_the_best_is_returned(solver: object) -> None:
    question = Identification(MODEL, record(120), start=Start.REST)
    solution, monitor, _ = run(question, MultipleShooting(), solver)
    assert solution.ending is Ending.LIMIT
    assert "raise iterations" in solution.sentence
    assert monitor.best is not None
    assert_allclose(solution.theta, monitor.best)


def test_an_interrupt_goes_through_and_the_best_is_kept() -> None:
    question = Identification(MODEL, record(400), start=Start.REST)
    listed, theta = begun(question)

    def stop(progress: object) -> None:
        if getattr(progress, "iteration", 0) == 4:
            raise KeyboardInterrupt

    monitor = Monitor(listed.names, stop)
    with pytest.raises(KeyboardInterrupt):
        MultipleShooting().identify(question, listed, theta, Ipopt(), monitor)
    assert monitor.best is not None
    assert monitor.trace.rms.size == 4


def test_a_signal_stops_the_solver() -> None:
    question = Identification(MODEL, record(1500), start=Start.REST)
    listed, theta = begun(question, {"second_order.omega": 600.0})
    # While compiled code runs, whatever the machine took to build it.
    timer = threading.Timer(0.05, _thread.interrupt_main)
    monitor = Monitor(listed.names, lambda now: timer.start() if now.iteration == 1 else None)
    try:
        with pytest.raises(KeyboardInterrupt):
            Collocation(degree=5).identify(question, listed, theta, Ipopt(), monitor)
    finally:
        timer.cancel()
    assert len(monitor.trace.rms) < 10


@pytest.mark.parametrize(
    "build",
    [
        lambda: MultipleShooting(samples_per_node=0),
        lambda: MultipleShooting(smoothing=-1.0),
        lambda: Collocation(degree=0),
        lambda: Collocation(scheme="lobatto"),  # type: ignore[arg-type]
        lambda: replace(Ipopt(), curvature="bfgs"),  # type: ignore[arg-type]
    ],
)
def test_choices_without_sense_are_refused(build: object) -> None:
    with pytest.raises(InputError):
        build()  # type: ignore[operator]
