"""What each effect does, against closed forms, published laws and independent code."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import optimize
from scipy.integrate import solve_ivp

import piezo_opt as po
from piezo_opt.assembly import assemble
from piezo_opt.effects import (
    AmplifierLag,
    Asymmetry,
    BoucWen,
    ChargeBackCoupling,
    Creep,
    CubicStiffness,
    Dahl,
    DeadZone,
    Delay,
    Drift,
    Duhem,
    Effect,
    Friction,
    GeneralisedBoucWen,
    HystereticForce,
    Load,
    LoadMass,
    MainsPickup,
    MaxwellSlip,
    Model,
    NonlinearDamping,
    NonlinearGain,
    Offset,
    PiezoGain,
    PrandtlIshlinskii,
    Preisach,
    RateDependence,
    Saturation,
    SecondMode,
    SecondOrder,
    SensorLag,
    SensorNonlinearity,
    SlewLimit,
    Temperature,
)
from piezo_opt.effects.base import Parameter, Place
from piezo_opt.errors import ModelError
from piezo_opt.measurement import Measurement
from piezo_opt.simulation import Simulator, Substeps
from piezo_opt.values import Values

FloatArray = NDArray[np.float64]
GAIN = 1e-7


def respond(
    model: Model | Effect,
    time: NDArray[Any],
    drive: NDArray[Any],
    values: Mapping[str, float] | None = None,
    longest: float = 1e-4,
    temperature: NDArray[Any] | None = None,
) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Reading and states by name, at nominal values but for the given ones."""
    whole = Model.of(model) if isinstance(model, Effect) else model
    numbers = Values.nominal(whole).with_(values or {})
    record = Measurement(
        time, drive, np.linspace(0, 1e-5, time.size) + 1e-7 * np.sin(np.arange(time.size)),
        channels={} if temperature is None else {"temperature": temperature},
    )  # fmt: skip
    run = Simulator(
        whole, record, numbers, runtime=tuple(values or {}), prefer_compiled=False,
        substeps=Substeps(longest, 1e9),
    ).response(numbers)  # fmt: skip
    return run.reading, dict(zip(run.state_names, run.states.T, strict=True))


def static(effect: Effect, drive: NDArray[Any], values: Mapping[str, float]) -> FloatArray:
    """Reading of an effect without memory on top of a gain of 1 m/V."""
    model = PiezoGain() + effect
    return respond(model, np.arange(drive.size) * 1.0, drive, {"piezo_gain.d": 1e-3, **values})[0]


def poles_at_rest(model: Model, values: Mapping[str, float]) -> NDArray[Any]:
    """Eigenvalues [1/s] of the model linearised about rest without drive."""
    system = assemble(model, constants={})
    p = Values.nominal(model).with_(values).vector(system.parameter_names)
    n, blank = len(system.state_names), np.zeros(0)
    jacobian = system.rate.jacobian()(0, np.zeros(n), 0, 0, blank, blank, p, np.zeros(n))[1]
    return np.linalg.eigvals(np.array(jacobian))


def test_saturation_holds_the_drive_at_its_knees() -> None:
    drive = np.array([-200.0, -50.0, 0.0, 40.0, 50.0, 60.0, 100.0, 200.0])
    full = {"saturation.s": 1.0, "saturation.v_s": 50.0, "saturation.softness": 1e-3}
    np.testing.assert_allclose(
        static(Saturation(), drive, full) / 1e-3, np.clip(drive, -50, 50), atol=0.05
    )
    part = {**full, "saturation.s": 0.4, "saturation.c": 10.0}
    centred = 10 + np.clip(drive - 10, -50, 50)
    np.testing.assert_allclose(
        static(Saturation(), drive, part) / 1e-3, 0.6 * drive + 0.4 * centred, atol=0.05
    )


def test_the_dead_zone_swallows_its_width() -> None:
    drive = np.array([-10.0, -3.0, -1.0, 0.0, 0.5, 1.0, 3.0, 10.0])
    values = {"dead_zone.share": 1.0, "dead_zone.width": 2.0, "dead_zone.softness": 1e-3}
    expected = np.sign(drive) * np.maximum(np.abs(drive) - 2.0, 0.0)
    np.testing.assert_allclose(static(DeadZone(), drive, values) / 1e-3, expected, atol=2e-3)
    biased = static(DeadZone(biased=True), drive + 30.0, {**values, "dead_zone.c": 30.0})
    np.testing.assert_allclose(biased / 1e-3, 30.0 + expected, atol=2e-3)


def test_the_slew_limit_follows_slow_drives_and_holds_fast_ones_to_its_rate() -> None:
    time = np.arange(400) * 1e-3
    values = {"slew_limit.share": 1.0, "slew_limit.rate": 100.0, "slew_limit.tau": 2e-3}
    slow = 5.0 * np.sin(2 * np.pi * 0.5 * time)
    _, states = respond(PiezoGain() + SlewLimit(), time, slow, values)
    # A pure lag of tau would be 31 mV behind; what is left is the rounding of the corners.
    assert np.abs(states["slew_limit.z"] - slow).max() < 2e-3
    step = np.where(time < 0.05, 0.0, 20.0)
    _, states = respond(PiezoGain() + SlewLimit(), time, step, values)
    z = states["slew_limit.z"]
    rising = (z > 2.0) & (z < 17.0)
    np.testing.assert_allclose(np.gradient(z, time)[rising], 100.0, rtol=2e-3)
    assert z[-1] == pytest.approx(20.0, abs=1e-6)
    assert z.max() < 20.0 + 1e-6


@pytest.mark.parametrize("softness", [1e-3, 0.2, 1.0])
def test_near_its_limit_the_slew_lags_by_what_its_corner_takes(softness: float) -> None:
    """On a ramp of 0.95 of the rate z' settles there: the corner then asks for w > u'."""
    rate, tau = 100.0, 2e-3
    time = np.arange(400) * 1e-3
    ramp = 0.95 * rate * time
    own = {"share": 1.0, "rate": rate, "tau": tau, "softness": softness}
    values = {f"slew_limit.{k}": v for k, v in own.items()}
    _, states = respond(PiezoGain() + SlewLimit(), time, ramp, values)

    def held(w: float) -> float:
        corner = softness * rate
        ends = np.logaddexp(0.0, [(w + rate) / corner, (w - rate) / corner])
        return float(corner * (ends[0] - ends[1]) - rate - 0.95 * rate)

    wanted = optimize.brentq(held, 0.0, 10.0 * rate)
    lag = ramp[-1] - states["slew_limit.z"][-1]
    assert lag == pytest.approx(tau * (wanted - 0.95 * rate), rel=1e-3, abs=1e-6)


def test_an_amplifier_that_is_not_fed_forward_lags_a_ramp_by_its_time_constant() -> None:
    time = np.arange(400) * 1e-3
    own = {"share": 1.0, "rate": 1e4, "tau": 2e-3, "softness": 0.02}
    values = {f"slew_limit.{k}": v for k, v in own.items()}
    _, states = respond(PiezoGain() + SlewLimit(behind=True), time, 10.0 * time, values)
    late = 10.0 * time[200:] - states["slew_limit.z"][200:]
    np.testing.assert_allclose(late, 2e-3 * 10.0, rtol=1e-4)
    # As an amplifier that lags below its limit it would enter for every lag.
    assert SlewLimit.entries() == (SlewLimit(),)


def test_an_attached_mass_splits_the_resonance_as_two_masses_in_a_row_do() -> None:
    model = PiezoGain() + SecondOrder() + SecondMode(attached=True)
    omega, own, mass = 6e3, 9e3, 0.2
    values = {"second_order.omega": omega, "second_order.zeta": 1e-9}
    values |= {"second_mode.mass": mass, "second_mode.omega": own, "second_mode.zeta": 1e-4}
    stiff = np.array([[omega**2 + mass * own**2, -mass * own**2], [-(own**2), own**2]])
    expected = np.sqrt(np.sort(np.linalg.eigvals(stiff)))
    found = np.sort(poles_at_rest(model, values).imag)[-2:]
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_the_whole_port_is_the_lag_and_the_charge_that_comes_back() -> None:
    """Of the lagged command and the lagged velocity: kappa is the time constant times back."""
    tau, back = 4e-4, 2e6
    time = np.arange(600) * 1e-4
    drive = 20.0 * np.sin(2 * np.pi * 40.0 * time) + 5.0 * np.sign(np.sin(2 * np.pi * 90.0 * time))
    moving, mechanics = PiezoGain() + SecondOrder(), {"second_order.omega": 1500.0}
    own = {"share": 1.0, "tau": tau, "back": back}
    port, _ = respond(
        moving + ChargeBackCoupling(whole=True), time, drive,
        {**mechanics, **{f"charge_back_coupling.{k}": v for k, v in own.items()}}, 1e-5,
    )  # fmt: skip
    apart = {
        "amplifier_lag.share": 1.0, "amplifier_lag.tau": tau,
        "charge_back_coupling.kappa": tau * back, "charge_back_coupling.tau": tau,
    }  # fmt: skip
    # It holds every lag, and begins where one has been found.
    assert ChargeBackCoupling.entries() == (ChargeBackCoupling(),)
    lag = {"share": 0.9, "tau": 1e-4}
    begun = ChargeBackCoupling(whole=True).like("amplifier_lag", lag)
    assert begun == {**lag, "back": 0.0}
    assert ChargeBackCoupling().like("amplifier_lag", lag) is None
    lost = {"kappa": tau * back, "tau": tau}
    begun = ChargeBackCoupling(whole=True).like("charge_back_coupling", lost)
    assert begun == pytest.approx({"share": 1.0, "tau": tau, "back": back})
    both = moving + AmplifierLag() + ChargeBackCoupling()
    reading, _ = respond(both, time, drive, {**mechanics, **apart}, 1e-5)
    np.testing.assert_allclose(port, reading, rtol=0, atol=1e-9 * np.ptp(reading))


def test_the_normalised_loop_is_the_classical_one_in_other_parameters() -> None:
    time = np.arange(800) * 1e-3
    drive = 30.0 * time * np.sin(2.0 * np.pi * 4.0 * time) + 20.0
    own = {"kappa": 7e-7, "rho": 0.04, "sigma": 0.8, "n": 1.3}
    normalised = {f"generalised_bouc_wen.{k}": v for k, v in own.items()}
    loop, _ = respond(PiezoGain() + GeneralisedBoucWen(), time, drive, normalised, 1e-5)
    does = BoucWen().like("generalised_bouc_wen", own) or {}
    classical = {f"bouc_wen.{k}": v for k, v in does.items()}
    reading, _ = respond(PiezoGain() + BoucWen(), time, drive, classical, 1e-5)
    np.testing.assert_allclose(reading, loop, rtol=0, atol=1e-6 * np.ptp(loop))
    plain = BoucWen().like("generalised_bouc_wen", {**own, "n": 1.0})
    assert plain == pytest.approx({"alpha": 2.8e-8, "beta": 0.032, "gamma": 0.008, "n": 1.0})
    assert BoucWen().like("dahl", own) is None


def test_before_linear_mechanics_a_lag_is_what_it_is_behind_them() -> None:
    """What is linear may change places; so each begins at what the other has been found to do."""
    time = np.arange(400) * 1e-4
    drive = 30.0 * np.sin(2.0 * np.pi * 60.0 * time) ** 2
    own = {"share": 0.8, "tau": 2e-3}
    mechanics = {"second_order.omega": 2.0 * np.pi * 80.0, "second_order.zeta": 0.1}
    moving = PiezoGain() + SecondOrder()
    readings = [
        respond(moving + lag, time, drive,
                {**mechanics, **{f"{lag.name}.{k}": v for k, v in own.items()}}, 1e-5)[0]
        for lag in (AmplifierLag(), SensorLag())
    ]  # fmt: skip
    np.testing.assert_allclose(*readings, rtol=0, atol=1e-6 * np.ptp(readings[0]))
    for one, other in ((AmplifierLag(), "sensor_lag"), (SensorLag(), "amplifier_lag")):
        assert one.like(other, {**own, "ratio": 0.2}) == own
        assert one.like("delay", {"T": 1e-4}) == {"share": 1.0, "tau": 1e-4}
        assert one.like("creep", {"c": 0.1, "tau": 1.0}) is None


def test_mechanics_that_do_not_ring_are_a_sensor_of_two_poles() -> None:
    """Behind what is quasi-static; of a slow signal they are the delay 2 zeta / omega."""
    time = np.arange(400) * 1e-4
    drive = 30.0 * np.sin(2.0 * np.pi * 25.0 * time) ** 2
    own = {"omega": 2.0 * np.pi * 300.0, "zeta": 0.9}
    mechanics = {f"second_order.{k}": v for k, v in own.items()}
    moving, _ = respond(PiezoGain() + SecondOrder(), time, drive, mechanics, 1e-5)
    lag = SensorLag(poles=2)
    does = lag.like("second_order", own) or {}
    lagging = {f"sensor_lag.{k}": v for k, v in does.items()}
    still, _ = respond(PiezoGain() + lag, time, drive, lagging, 1e-5)
    np.testing.assert_allclose(still, moving, rtol=0, atol=1e-6 * np.ptp(moving))
    late = 2.0 * 0.9 / own["omega"]
    assert SensorLag().like("second_order", own) == {"share": 1.0, "tau": late}
    assert Delay().like("second_order", own) == {"T": late}
    assert Delay().like("sensor_lag", {"share": 0.5, "tau": 1e-3}) == {"T": 5e-4}
    assert Delay().like("creep", {"c": 0.1, "tau": 1.0}) is None
    ringing = lag.like("second_order", {**own, "zeta": 0.01}) or {}
    assert ringing["zeta"] == lag.parameters["zeta"].bounds[0]


def test_charge_back_coupling_damps_by_kappa_d_omega_over_two() -> None:
    model = PiezoGain() + SecondOrder() + ChargeBackCoupling()
    poles = poles_at_rest(
        model, {"charge_back_coupling.kappa": 100.0, "charge_back_coupling.tau": 1e-6}
    )
    slow = poles[np.abs(poles) < 1e5]
    omega = 6e3
    assert slow.size == 2
    expected = (0.05 + 100.0 * GAIN * omega / 2.0) * omega
    np.testing.assert_allclose(-slow.real, expected, rtol=0.02)


def test_the_loop_relaxes_at_the_rate_r() -> None:
    time = np.arange(200) * 1e-2
    drive = np.where(time < 0.5, 100.0 * time, 50.0)
    model = PiezoGain() + BoucWen() + RateDependence()
    _, states = respond(model, time, drive, {"rate_dependence.r": 3.0}, 1e-3)
    h = states["bouc_wen.h"]
    late = time > 0.6
    np.testing.assert_allclose(
        h[late], h[late][0] * np.exp(-3.0 * (time[late] - time[late][0])), rtol=1e-6
    )


def test_rate_dependence_of_exponent_two_is_a_beta_that_grows_with_the_rate() -> None:
    time = np.arange(300) * 1e-3
    drive = 200.0 * np.abs(((time / 0.1) % 1.0) - 0.5)  # the same |v'| everywhere: 2 kV/s
    r, q, speed = 5.0, 1e4, 2e3
    values = {"rate_dependence.r": r, "rate_dependence.m": 2.0, "rate_dependence.q": q}
    grown, _ = respond(PiezoGain() + BoucWen() + RateDependence(), time, drive, values)
    beta = 2e-2 + r * speed / q**2
    same, _ = respond(PiezoGain() + BoucWen(), time, drive, {"bouc_wen.beta": beta})
    np.testing.assert_allclose(grown, same, rtol=0, atol=1e-9 * np.ptp(same))


@pytest.mark.parametrize("narrowing", [False, True])
def test_a_wide_loop_narrows_with_the_rate_or_widens_where_it_forgets_at_rest(
    narrowing: bool,
) -> None:
    """A triangle of +-A at c volts a second, once the loop is closed.

    Per volt h forgets the share b = beta + r / c, with narrowing b = beta + r c / q^2; so
    h(A) = alpha / b tanh(b A) at the turn, and alpha / b (1 - 1 / cosh(b A)) half way.
    """
    model = PiezoGain() + BoucWen() + RateDependence(narrowing=narrowing)
    alpha, beta, r, q, top = 3e-8, 2e-2, 10.0, 1e3, 100.0
    values = {"bouc_wen.alpha": alpha, "bouc_wen.beta": beta,
              "rate_dependence.r": r, "rate_dependence.q": q}  # fmt: skip
    way = np.arange(0.0, 901.0, 10.0)
    drive = np.interp(way, [0, 100, 300, 500, 700, 900], [0, top, -top, top, -top, top])
    widths = []
    for c in (500.0, 2000.0):
        _, states = respond(model, way / c, drive, values, 1.0 / c)
        turn, half_way = states["bouc_wen.h"][[90, 80]]
        b = beta + (r * c / q**2 if narrowing else r / c)
        assert turn == pytest.approx(alpha / b * np.tanh(b * top), rel=1e-6)
        assert half_way == pytest.approx(alpha / b * (1.0 - 1.0 / np.cosh(b * top)), rel=1e-6)
        widths.append(half_way)
    assert (widths[1] < widths[0]) == narrowing


@pytest.mark.parametrize("form", ["strengthening", "scaling"])
def test_at_one_rate_a_loop_has_another_strength_or_another_law(form: str) -> None:
    """All of a triangle is run through at c: alpha, or alpha, beta and gamma, are others."""
    _, way = wander()
    law = {"bouc_wen.alpha": 4e-8, "bouc_wen.beta": 0.05, "bouc_wen.gamma": 0.01}
    q = RateDependence().parameters["q"].nominal
    model = PiezoGain() + BoucWen()
    rich = model + RateDependence(**{form: True})
    gate, size = ("strength", 2e-8) if form == "strengthening" else ("share", 0.5)
    for c, j in ((200.0, 0.5), (5000.0, 0.3)):
        time = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(way)))]) / c
        own = {f"rate_dependence.{gate}": size, "rate_dependence.j": j}
        _, found = respond(rich, time, way, {**law, **own}, 0.05 / c)
        grown = size * (c / q) ** j
        if form == "strengthening":
            same = {**law, "bouc_wen.alpha": 4e-8 + grown}
        else:
            same = {name: (1.0 + grown) * value for name, value in law.items()}
        _, expected = respond(model, time, way, same, 0.05 / c)
        h = expected["bouc_wen.h"]
        np.testing.assert_allclose(found["bouc_wen.h"], h, rtol=0, atol=1e-8 * np.ptp(h))


def test_asymmetry_adds_what_its_integral_says() -> None:
    time = np.linspace(0.0, 2.0, 201)
    drive = 40.0 * np.minimum(time, 2.0 - time)
    model = PiezoGain() + BoucWen() + Asymmetry()
    values = {"bouc_wen.alpha": 0.0, "bouc_wen.beta": 0.0, "asymmetry.delta": 1e-10}
    _, states = respond(model, time, drive, values, 1e-2)
    # Up and down both add: the loop does not close.
    up = 0.5e-10 * drive**2
    expected = np.where(time <= 1.0, up, 2 * 0.5e-10 * 40.0**2 - up)
    np.testing.assert_allclose(states["bouc_wen.h"], expected, rtol=1e-9, atol=1e-20)


def loop_of(
    asymmetry: Asymmetry | None, drive: NDArray[Any], own: Mapping[str, float]
) -> FloatArray:
    """h of Bouc-Wen with and without an asymmetry."""
    law = {"bouc_wen.alpha": 4e-8, "bouc_wen.beta": 0.05, "bouc_wen.gamma": 0.01}
    model = PiezoGain() + BoucWen()
    values = {**law, **{f"asymmetry.{k}": v for k, v in own.items()}}
    whole = model if asymmetry is None else model + asymmetry
    _, states = respond(whole, np.arange(drive.size) * 1.0, drive, values, 0.05)
    return states["bouc_wen.h"]


def test_a_growing_loop_is_the_symmetrical_one_times_its_height() -> None:
    _, drive = wander()
    grown = loop_of(Asymmetry(growing=True), drive, {"growth": -6e-3, "eta": 4e-8})
    expected = (1.0 - 6e-3 * drive) * loop_of(None, drive, {})
    np.testing.assert_allclose(grown, expected, rtol=0, atol=1e-5 * np.ptp(expected))
    # With a large strength at 0 V and little growth the strength alone grows: delta v v'.
    own = {"growth": 1e-8, "eta": 1e-3}
    rise = np.linspace(0.0, 60.0, 61)
    strength = loop_of(Asymmetry(growing=True), rise, own) - loop_of(None, rise, {})
    b = 0.06  # beta + gamma, while h rises
    exact = 1e-11 * (rise / b - (1.0 - np.exp(-b * rise)) / b**2)
    np.testing.assert_allclose(strength, exact, rtol=1e-4, atol=1e-15)


def test_a_loop_does_not_grow_to_the_other_side() -> None:
    """Where it would have shrunk to nothing its height is held, and nothing is divided by zero."""
    _, drive = wander()
    assert np.isfinite(loop_of(Asymmetry(growing=True), drive, {"growth": -0.05})).all()


def test_a_bent_loop_is_the_one_of_a_bent_drive() -> None:
    _, coarse = wander()
    drive = np.interp(np.arange(0.0, coarse.size - 1.0, 0.05), np.arange(coarse.size), coarse)
    bent = loop_of(Asymmetry(bent=True), drive, {"growth": 8e-3})
    expected = loop_of(None, drive + 0.5 * 8e-3 * drive**2, {})
    np.testing.assert_allclose(bent, expected, rtol=0, atol=1e-5 * np.ptp(expected))


@pytest.mark.parametrize(("theta", "falling"), [(0.0, 1.0), (np.pi / 2, -1.0)])
def test_a_sided_loop_gives_way_sooner_on_one_side(theta: float, falling: float) -> None:
    """Of the loop (h > 0, whichever way the drive goes) or of the drive (while it rises)."""
    chi, top = 0.02, 60.0
    drive = np.concatenate([np.linspace(0.0, top, 121), np.linspace(top, 51.0, 61)[1:]])
    h = loop_of(Asymmetry(sided=True), drive, {"chi": chi, "theta": theta})
    up, turn = 0.06 + chi, h[120]
    np.testing.assert_allclose(h[:121], 4e-8 / up * (1.0 - np.exp(-up * drive[:121])), rtol=1e-5)
    assert (h[120:] > 0.0).all()  # until here: beta - gamma on the way back, and the side's share
    way, down = top - drive[120:], 0.04 + falling * chi
    expected = (turn + 4e-8 / down) * np.exp(-down * way) - 4e-8 / down
    np.testing.assert_allclose(h[120:], expected, rtol=1e-4)


def test_an_uneven_loop_is_driven_harder_while_the_drive_rises() -> None:
    top, excess, tilt = 60.0, 6e-9, 4e-3
    drive = np.concatenate([np.linspace(0.0, top, 121), np.linspace(top, 51.0, 61)[1:]])
    h = loop_of(Asymmetry(uneven=True), drive, {"excess": excess})
    up = 0.06  # beta + gamma while h rises, beta - gamma on the way back
    risen = (4e-8 + excess) / up * (1.0 - np.exp(-up * drive[:121]))
    np.testing.assert_allclose(h[:121], risen, rtol=1e-5)
    down, less = 0.04, 4e-8 - excess
    expected = (h[120] + less / down) * np.exp(-down * (top - drive[120:])) - less / down
    np.testing.assert_allclose(h[120:], expected, rtol=1e-4)
    # Tilted, it holds what the usual form has beside it.
    both = loop_of(Asymmetry(uneven=True), drive, {"excess": excess, "tilt": tilt}) - h
    b = up
    more = excess * tilt * (drive[:121] / b - (1.0 - np.exp(-b * drive[:121])) / b**2)
    np.testing.assert_allclose(both[:121], more, rtol=1e-4, atol=1e-15)


def test_rate_dependence_has_one_form() -> None:
    assert [RateDependence(**form).gate for form in RateDependence.variants] == [
        "r", "r", "strength", "share", "share", "share", "weight",
    ]  # fmt: skip


def test_an_asymmetry_has_one_form() -> None:
    assert [Asymmetry(**form).gate for form in Asymmetry.variants] == [
        "delta", "growth", "growth", "chi", "excess", "growth", "delta", "weight",
    ]  # fmt: skip
    with pytest.raises(ModelError, match=r"has 2 gates \(growth, chi\)"):
        Asymmetry(bent=True, sided=True)


def dragged_along(lower: FloatArray, upper: FloatArray, start: float = 0.0) -> FloatArray:
    """A play between two envelopes, sample by sample."""
    found = []
    for low, high in zip(lower, upper, strict=True):
        start = min(max(start, low), high)
        found.append(start)
    return np.array(found)


def _turning() -> tuple[FloatArray, FloatArray]:
    time = np.arange(800) / 1000.0
    corners = [5.0, 60, 10, 50, 20, 40, 0, 60]
    return time, np.interp(time, np.linspace(0.0, time[-1], len(corners)), corners)


@pytest.mark.parametrize("lower", [1.0, 0.0])
def test_an_unequal_loop_is_what_unequal_plays_do_beyond_equal_ones(lower: float) -> None:
    time, v = _turning()
    values = {
        "asymmetry.weight": 2e-8, "asymmetry.r": 12.0, "asymmetry.spread": 0.02,
        "asymmetry.lower": lower, "piezo_gain.d": 1e-7,
    }  # fmt: skip
    model = PiezoGain() + BoucWen() + Asymmetry(unequal=True)
    values |= {"bouc_wen.alpha": 0.0}
    reading, _ = respond(model, time, v, values, 1.0)
    more = np.zeros_like(v)
    for r in (4.0, 8.0, 12.0):
        below, above = r * (1.0 + lower * 0.02 * v), r * (1.0 + 0.02 * v)
        more += dragged_along(v - below, v + above) - dragged_along(v - r, v + r)
    assert np.ptp(more) > 10.0
    np.testing.assert_allclose(reading, 1e-7 * v + 2e-8 * more, atol=1e-12)


def test_a_widening_loop_is_what_plays_do_beyond_those_at_rest() -> None:
    time, v = _turning()
    values = {
        "rate_dependence.weight": 2e-8, "rate_dependence.threshold": 9.0,
        "rate_dependence.q": 400.0, "rate_dependence.j": 0.5,
        "piezo_gain.d": 1e-7, "bouc_wen.alpha": 0.0,
    }  # fmt: skip
    reading, _ = respond(
        PiezoGain() + BoucWen() + RateDependence(widening=True), time, v, values, 1.0
    )
    # Over a stretch between samples the rate is that of the stretch.
    pace = np.abs(np.diff(v, prepend=v[0])) / 1e-3 / 400.0
    more = np.zeros_like(v)
    for r in (3.0, 6.0, 9.0):
        wide = r * (1.0 + np.sqrt(pace))
        more += dragged_along(v - wide, v + wide) - dragged_along(v - r, v + r)
    assert np.ptp(more) > 10.0
    # At the instant of a turn the rate is told of the stretch that follows.
    same = np.isclose(pace, np.append(pace[1:], pace[-1]))
    left = (reading - 1e-7 * v - 2e-8 * more)[same]
    assert same.sum() > 700
    assert np.abs(left).max() < 1e-12


PLAYS = {"prandtl_ishlinskii.rho": 4e-8, "prandtl_ishlinskii.decay": 0.7,
         "prandtl_ishlinskii.r": 30.0}  # fmt: skip


def stopped(drive: NDArray[Any]) -> FloatArray:
    """h of seven plays with the numbers of PLAYS, by the textbook's recursion."""
    weights = 4e-8 / 7 * np.exp(-0.7 * np.arange(7) / 7)
    z = plays(drive, 30.0 * np.arange(1, 8) / 7)
    return np.asarray((drive[:, None] - z) @ weights)


def test_a_scaled_loop_is_the_law_times_its_height() -> None:
    time, drive = wander()
    values = {**PLAYS, "asymmetry.growth": 8e-3}
    scaled = PiezoGain() + PrandtlIshlinskii(7) + Asymmetry(scaled=True)
    reading, _ = respond(scaled, time, drive, values, 1.0)
    expected = GAIN * drive - (1.0 + 8e-3 * drive) * stopped(drive)
    np.testing.assert_allclose(reading, expected, rtol=0, atol=1e-13)


def test_a_loop_beside_another_is_what_a_linear_law_adds() -> None:
    time, drive = wander()
    law = {"bouc_wen.beta": 0.03, "asymmetry.delta": 2e-10}
    one, _ = respond(PiezoGain() + BoucWen() + Asymmetry(), time, drive, law, 1e-2)
    beside = PiezoGain() + BoucWen() + Asymmetry(beside=True)
    two, _ = respond(beside, time, drive, {**law, "asymmetry.forgets": 0.03}, 1e-2)
    np.testing.assert_allclose(two, one, rtol=0, atol=1e-9 * np.ptp(one))


def test_a_share_of_a_lagging_loop_comes_late() -> None:
    time = np.linspace(0.0, 2.0, 401)
    drive = 60.0 * np.minimum(time, 1.0)
    values = {**PLAYS, "rate_dependence.share": 0.3, "rate_dependence.tau": 0.2}
    lagging = PiezoGain() + PrandtlIshlinskii(7) + RateDependence(lagging=True)
    reading, states = respond(lagging, time, drive, values, 1e-3)
    h, z = stopped(drive), states["rate_dependence.z"]
    np.testing.assert_allclose(
        reading, GAIN * drive - h - 0.3 * (z - h), rtol=0, atol=1e-13 * np.ptp(drive)
    )
    held = time >= 1.0
    late = (h - z)[held]
    np.testing.assert_allclose(
        late, late[0] * np.exp(-(time[held] - 1.0) / 0.2), rtol=1e-6, atol=1e-18
    )
    assert late[0] > 0.01 * h[-1]


def test_a_paced_loop_is_higher_after_it_was_run_through_fast() -> None:
    time = np.linspace(0.0, 2.0, 401)
    drive = 60.0 * np.minimum(time, 1.0)
    values = {**PLAYS, "rate_dependence.share": 2.0, "rate_dependence.tau": 0.2}
    paced = PiezoGain() + PrandtlIshlinskii(7) + RateDependence(paced=True)
    reading, states = respond(paced, time, drive, values, 1e-3)
    full = 60.0 / 1e4 * (1.0 - np.exp(-np.minimum(time, 1.0) / 0.2))
    w = full * np.exp(-np.maximum(time - 1.0, 0.0) / 0.2)
    np.testing.assert_allclose(states["rate_dependence.w"], w, rtol=1e-6, atol=1e-12)
    expected = GAIN * drive - (1.0 + 2.0 * np.sqrt(w)) * stopped(drive)
    np.testing.assert_allclose(reading, expected, rtol=0, atol=1e-6 * np.ptp(drive) * GAIN)


def test_what_asks_no_rate_acts_beside_plays_and_the_rest_says_why_not() -> None:
    model = PiezoGain() + MaxwellSlip()
    for effect in (*Asymmetry().entries(), *RateDependence().entries()):
        refusal = model.refusal(effect)
        assert (refusal is None) is (effect.place is Place.STRAIN)
    assert "acts on the hysteresis" in (Model.of(PiezoGain()).refusal(Asymmetry(scaled=True)) or "")


def test_duhem_with_a_straight_curve_is_bouc_wen_with_an_asymmetry() -> None:
    time, drive = wander()
    law = {"duhem.beta": 0.03, "duhem.sigma": 1e-8}
    one, _ = respond(PiezoGain() + Duhem(), time, drive, law, 1e-2)
    plain = {"bouc_wen.beta": 0.03, "asymmetry.delta": 0.03 * 1e-8}
    two, _ = respond(PiezoGain() + BoucWen() + Asymmetry(), time, drive, plain, 1e-2)
    np.testing.assert_allclose(one, two, rtol=0, atol=1e-8 * np.ptp(two))


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_duhem_follows_its_curve_on_either_branch(way: float) -> None:
    """Once its start is forgotten, h is ahead of the curve g by a / b, less what g itself does."""
    time = np.linspace(0.0, 1.0, 101)
    alpha, beta, sigma, second, third = 2e-8, 0.2, 1e-8, 3e-11, -4e-13
    law = {"alpha": alpha, "beta": beta, "sigma": sigma, "second": second, "third": third}
    given = {f"duhem.{name}": value for name, value in law.items()}
    _, states = respond(PiezoGain() + Duhem(), time, way * 200.0 * time, given, 1e-4)
    v = way * 200.0
    curve = sigma * v + second * v**2 + third * v**3
    first = sigma + 2.0 * second * v + 3.0 * third * v**2
    behind = way * first / beta - (2.0 * second + 6.0 * third * v) / beta**2
    behind += way * 6.0 * third / beta**3
    expected = curve + way * alpha / beta - behind
    assert states["duhem.h"][-1] == pytest.approx(expected, rel=1e-5)


def wander(size: int = 300) -> tuple[NDArray[Any], NDArray[Any]]:
    """A drive with many turning points of unequal height, each of them on a sample."""
    corners = np.array([0, 60, 10, 40, 25, 70, 30, 55, 20, 50, 0, 65.0])
    time = np.linspace(0.0, corners.size - 1.0, 20 * (corners.size - 1) + 1)[:size]
    return time, np.interp(time, np.arange(corners.size), corners)


def test_generalised_bouc_wen_of_exponent_one_is_bouc_wen() -> None:
    time, drive = wander()
    kappa, rho, sigma = 1.5e-6, 3e-2, 0.8
    own = {f"generalised_bouc_wen.{k}": v for k, v in
           {"kappa": kappa, "rho": rho, "sigma": sigma, "n": 1.0}.items()}  # fmt: skip
    classic = {"bouc_wen.alpha": rho * kappa, "bouc_wen.beta": rho * sigma,
               "bouc_wen.gamma": rho * (1.0 - sigma)}  # fmt: skip
    one, _ = respond(PiezoGain() + GeneralisedBoucWen(), time, drive, own, 1e-2)
    two, _ = respond(PiezoGain() + BoucWen(), time, drive, classic, 1e-2)
    np.testing.assert_allclose(one, two, rtol=0, atol=1e-10 * np.ptp(two))


def test_generalised_bouc_wen_saturates_at_kappa() -> None:
    time = np.linspace(0, 1, 101)
    for n in (1.0, 1.5, 3.0):
        values = {"generalised_bouc_wen.n": n, "generalised_bouc_wen.rho": 0.2}
        _, states = respond(PiezoGain() + GeneralisedBoucWen(), time, 300 * time, values, 1e-3)
        assert states["generalised_bouc_wen.h"][-1] == pytest.approx(1e-6, rel=1e-3)


def test_dahl_of_exponent_one_is_bouc_wen_without_gamma_and_two_has_its_closed_form() -> None:
    time, drive = wander()
    kappa, rho = 1.5e-6, 3e-2
    own = {"dahl.kappa": kappa, "dahl.rho": rho, "dahl.i": 1.0}
    one, _ = respond(PiezoGain() + Dahl(), time, drive, own, 1e-2)
    classic = {"bouc_wen.alpha": rho * kappa, "bouc_wen.beta": rho}
    two, _ = respond(PiezoGain() + BoucWen(), time, drive, classic, 1e-2)
    np.testing.assert_allclose(one, two, rtol=0, atol=1e-10 * np.ptp(two))
    rising = drive[:21]
    _, states = respond(PiezoGain() + Dahl(), time[:21], rising, {**own, "dahl.i": 2.0}, 1e-3)
    # e' = -rho v' e^2 from e = 1
    np.testing.assert_allclose(
        states["dahl.h"], kappa * (1.0 - 1.0 / (1.0 + rho * rising)), rtol=1e-8, atol=1e-18
    )


def plays(drive: NDArray[Any], radii: NDArray[Any]) -> FloatArray:
    """Play operators by the textbook's recursion, samples x operators."""
    z = np.clip(0.0, drive[0] - radii, drive[0] + radii)
    out = [z]
    for v in drive[1:]:
        z = np.minimum(np.maximum(z, v - radii), v + radii)
        out.append(z)
    return np.array(out)


def test_prandtl_ishlinskii_is_the_sum_of_its_stops() -> None:
    time, drive = wander()
    values = {"prandtl_ishlinskii.rho": 4e-8, "prandtl_ishlinskii.decay": 0.7,
              "prandtl_ishlinskii.r": 30.0}  # fmt: skip
    k = 7
    reading, states = respond(PiezoGain() + PrandtlIshlinskii(k), time, drive, values, 1.0)
    radii = 30.0 * np.arange(1, k + 1) / k
    z = plays(drive, radii)
    weights = 4e-8 / k * np.exp(-0.7 * np.arange(k) / k)
    expected = GAIN * drive - (drive[:, None] - z) @ weights
    np.testing.assert_allclose(reading, expected, rtol=0, atol=1e-13)
    np.testing.assert_allclose(states["prandtl_ishlinskii.z[3]"], z[:, 3], atol=1e-12)


BENT = {"rho": 4e-8, "decay": 0.7, "r": 17.3, "above": -3e-8, "below": 1.4e-8, "t": 14.3}
"""A law of plays whose dead zones are all reached by a drive between -30 V and 40 V.

No corner of it falls on a sample, where a derivative has two sides.
"""


def of_plays(own: Mapping[str, float]) -> dict[str, float]:
    """Values by full name."""
    return {f"prandtl_ishlinskii.{k}": v for k, v in own.items()}


def test_dead_zones_behind_the_plays_are_the_modified_law_of_kuhnen() -> None:
    """The textbook's two superpositions, thresholds and weights as vectors, in metres."""
    time, drive = wander()
    drive = drive - 30.0
    k, zones = 7, 3
    reading, _ = respond(
        PiezoGain() + PrandtlIshlinskii(k, zones), time, drive, of_plays(BENT), 1.0
    )
    weights = 4e-8 / k * np.exp(-0.7 * np.arange(k) / k)
    whole = weights.sum()
    played = plays(drive, BENT["r"] * np.arange(1, k + 1) / k) @ weights
    steps = np.arange(1, zones + 1) / zones
    thresholds = whole * BENT["t"] * np.concatenate([-steps[::-1], [0.0], steps])
    gains = np.repeat([1.4e-8 / zones / whole, 1.0, -3e-8 / zones / whole], [zones, 1, zones])
    bent = np.zeros_like(drive)
    reached = []
    for threshold, gain in zip(thresholds, gains, strict=True):
        if threshold > 0.0:
            part = np.maximum(played - threshold, 0.0)
        elif threshold < 0.0:
            part = np.minimum(played - threshold, 0.0)
        else:
            part = played
        reached.append(np.abs(part).max() > 0.0)
        bent += gain * part
    assert all(reached)  # Else the drive would not test them.
    np.testing.assert_allclose(reading, (GAIN - whole) * drive + bent, rtol=0, atol=1e-13)


def test_dead_zones_make_the_branches_of_a_loop_differ() -> None:
    """A closed loop of plays is its own mirror image; dead zones of one side add to one half."""
    time = np.linspace(0.0, 5.0, 501)
    drive = np.interp(time, np.arange(6.0), [0, 40, -40, 40, -40, 40])
    down, up = slice(100, 201), slice(200, 301)

    def skew(own: Mapping[str, float]) -> FloatArray:
        reading, _ = respond(PiezoGain() + PrandtlIshlinskii(), time, drive, of_plays(own), 1.0)
        return np.array(reading[down] + reading[up])

    even = {**BENT, "r": 20.0, "above": 0.0, "below": 0.0}
    np.testing.assert_allclose(skew(even), 0.0, atol=1e-18)
    both = {**even, "above": -3e-8, "below": -3e-8, "t": 10.0}
    np.testing.assert_allclose(skew(both), 0.0, atol=1e-18)
    # At the corner every play of radius up to 20 V follows: e = 40 V less the mean radius.
    shares = np.exp(-0.7 * np.arange(20) / 20)
    e = 40.0 - shares @ np.arange(1.0, 21.0) / shares.sum()
    bent = skew({**both, "below": 0.0})
    assert bent[0] == pytest.approx(-3e-8 * ((e - 5.0) + (e - 10.0)) / 2.0, rel=1e-9)
    assert np.ptp(bent[:40]) > 1e-7


def test_without_dead_zones_there_are_three_parameters_and_the_symmetric_law() -> None:
    plain = PrandtlIshlinskii(dead_zones=0)
    assert [k for k, one in plain.parameters.items() if not one.detail] == ["rho", "decay", "r"]
    assert {"above", "below", "t"} < set(PrandtlIshlinskii().parameters)
    time, drive = wander()
    own = {"rho": 4e-8, "decay": 0.7, "r": 30.0}
    one, _ = respond(PiezoGain() + plain, time, drive, of_plays(own), 1.0)
    two, _ = respond(PiezoGain() + PrandtlIshlinskii(), time, drive, of_plays(own), 1.0)
    np.testing.assert_array_equal(one, two)


@pytest.mark.parametrize("count", [-1, 2.5, True, 101, "3"])
def test_a_senseless_number_of_dead_zones_is_refused(count: object) -> None:
    with pytest.raises(ModelError, match=r"prandtl_ishlinskii: dead_zones is .* whole number"):
        PrandtlIshlinskii(dead_zones=count)  # type: ignore[arg-type]


def test_sensitivities_of_reached_dead_zones_equal_finite_differences() -> None:
    time, drive = wander()
    model = PiezoGain() + PrandtlIshlinskii(5, 3)
    values = Values.nominal(model).with_(of_plays(BENT))
    names = tuple(of_plays(BENT))
    record = Measurement(time, drive - 30.0, 1e-7 * drive)
    run = Simulator(
        model, record, values, directions=names, runtime=names, prefer_compiled=False,
        substeps=Substeps(1.0, 1e9),
    )  # fmt: skip
    reading, slopes = run.with_sensitivities(values)
    for column, name in enumerate(names):
        step = 1e-6 * abs(values[name])
        ahead = run.reading(values.with_({name: values[name] + step}))
        behind = run.reading(values.with_({name: values[name] - step}))
        slope = slopes[:, column]
        assert np.abs(slope).max() * abs(values[name]) > 1e-2 * np.ptp(reading), name
        error = np.abs(slope - (ahead - behind) / (2.0 * step)).max()
        assert error <= 1e-6 * np.abs(slope).max(), name


@pytest.mark.parametrize("share", [0.15, 0.4])
def test_a_fit_finds_dead_zones_from_a_symmetric_start(share: float) -> None:
    """From thresholds at a share of the drive's range, where a diagnosis begins as well."""
    t = np.arange(600) / 100.0
    corners = [0.0, 60, 10, 50, 20, 45, 0, 30, 5, 55, 15, 60, 0]
    drive = np.interp(t, np.linspace(0.0, 6.0, len(corners)), corners)
    model = PiezoGain() + PrandtlIshlinskii() + Offset()
    truth = {k: v for k, v in BENT.items() if k != "below"}
    blank = Measurement(t, drive, 1e-7 * drive)
    reading = po.simulate(model, blank, of_plays(truth)).reading
    noise = 1e-9 * np.random.default_rng(7).normal(size=t.size)
    question = po.Identification(model, blank.with_(position=reading + noise))
    fit = po.solve(question, start=of_plays({"r": share * 60.0, "t": share * 60.0}))
    assert fit.rms < 1.05e-9
    for name, value in of_plays(truth).items():
        assert abs(fit.values[name] - value) < 4.0 * fit.std[name], name
    assert fit.values["prandtl_ishlinskii.above"] == pytest.approx(-3e-8, rel=0.02)
    assert fit.values["prandtl_ishlinskii.t"] == pytest.approx(BENT["t"], rel=0.02)


@pytest.mark.parametrize(
    "law", [PrandtlIshlinskii(), MaxwellSlip(), MaxwellSlip(free=True), Preisach()]
)
def test_play_laws_do_not_depend_on_the_sampling_and_forget_inner_loops(law: Effect) -> None:
    time, drive = wander()
    coarse, _ = respond(PiezoGain() + law, time, drive, longest=1.0)
    fine, _ = respond(PiezoGain() + law, time, drive, longest=1e-2)
    np.testing.assert_allclose(coarse, fine, rtol=0, atol=1e-12 * np.ptp(fine))
    # Return-point memory: an inner loop between turning points leaves no trace once closed.
    t = np.linspace(0, 6, 601)
    looped = np.interp(t, np.arange(7), [0, 60, 20, 45, 20, 60, 60.0])
    straight = np.interp(t, np.arange(7), [0, 60, 20, 20, 20, 60, 60.0])
    with_loop, _ = respond(PiezoGain() + law, t, looped)
    without, _ = respond(PiezoGain() + law, t, straight)
    np.testing.assert_allclose(with_loop[400:], without[400:], rtol=0, atol=1e-18)
    assert np.abs(with_loop[200:400] - without[200:400]).max() > 1e-7


def test_maxwell_slip_has_its_stiffness_at_a_turn_and_slips_at_h() -> None:
    time = np.linspace(0, 1, 201)
    drive = 200.0 * time
    values = {"maxwell_slip.h": 2e-6, "maxwell_slip.r": 100.0, "maxwell_slip.spacing": 0.5}
    reading, _ = respond(PiezoGain() + MaxwellSlip(3), time, drive, values)
    lost = GAIN * drive - reading
    assert lost[-1] == pytest.approx(2e-6, rel=1e-12)
    first = 2e-6 / 3 * (1 / 100 + 1 / 50 + 1 / 25)
    np.testing.assert_allclose(lost[:20], first * drive[:20], rtol=1e-9, atol=1e-20)


def test_free_elements_begin_at_the_same_loop_and_slip_each_on_its_own() -> None:
    time, drive = wander()
    own = {"h": 2e-6, "r": 45.0, "spacing": 0.55}
    assert MaxwellSlip(9).finer(own) == (MaxwellSlip(9), {})
    free, start = MaxwellSlip().finer(own)
    coarse = {f"maxwell_slip.{k}": v for k, v in own.items()}
    begun = {"maxwell_slip.r": 45.0, **{f"maxwell_slip.{k}": v for k, v in start.items()}}
    one, _ = respond(PiezoGain() + MaxwellSlip(), time, drive, coarse, 1.0)
    two, _ = respond(PiezoGain() + free, time, drive, begun, 1.0)
    np.testing.assert_allclose(two, one, rtol=0, atol=1e-12 * np.ptp(one))
    radii = 45.0 * np.cumprod([1.0, 0.9, 0.3, 0.8, 0.5, 0.7, 0.6, 0.4])
    carried = 1e-7 * np.array([3.0, 1.0, 4.0, 1.0, 5.0, 9.0, 2.0, 6.0])
    apart = {f"maxwell_slip.h{i + 1}": v for i, v in enumerate(carried)}
    ratios = radii[1:] / radii[:-1]
    apart |= {f"maxwell_slip.q{i + 2}": v for i, v in enumerate(ratios)}
    reading, _ = respond(
        PiezoGain() + free, time, drive, {"maxwell_slip.r": 45.0, **apart}, 1.0
    )  # fmt: skip
    expected = GAIN * drive - ((drive[:, None] - plays(drive, radii)) / radii) @ carried
    np.testing.assert_allclose(reading, expected, rtol=0, atol=1e-13)


def test_preisach_with_a_broad_density_is_prandtl_ishlinskii() -> None:
    time, drive = wander()
    shape = {"rho": 4e-8, "decay": 0.7, "r": 30.0}
    broad = {**{f"preisach.{k}": v for k, v in shape.items()}, "preisach.b": 1e6}
    plain = {f"prandtl_ishlinskii.{k}": v for k, v in shape.items()}
    one, _ = respond(PiezoGain() + Preisach(), time, drive, broad)
    two, _ = respond(PiezoGain() + PrandtlIshlinskii(10), time, drive, plain)
    weights = 4e-8 / 10 * np.exp(-0.7 * np.arange(10) / 10)
    np.testing.assert_allclose(one, two + weights.sum() * drive, rtol=0, atol=1e-8 * np.ptp(two))


def test_a_loop_of_hundreds_of_plays_is_met_by_a_few() -> None:
    """Between thresholds a share 1/k apart a smooth loop is a chord: the error falls as 1/k^2."""
    time = np.arange(1500) * 1e-2
    growing = 50.0 * np.sin(0.4 * np.pi * time) * -np.expm1(-time / 4.0)
    drive = growing + 30.0 * np.sin(0.94 * np.pi * time)
    shares = np.arange(1, 301) / 300.0
    weights = 4e-8 / 300.0 * np.exp(-1.5 * shares)
    loop = (drive[:, None] - plays(drive, 45.0 * shares)) @ weights
    record = Measurement(time, drive, 1.5e-7 * drive - loop, name="smooth")

    def left(law: Effect) -> float:
        fit = po.solve(po.Identification(PiezoGain() + law + Offset(), record))
        return fit.rms / float(np.ptp(record.position))

    ten, usual = left(PrandtlIshlinskii(10, 0)), left(PrandtlIshlinskii(dead_zones=0))
    assert usual < 2e-5
    assert ten / usual == pytest.approx(4.0, rel=0.25)
    assert left(Preisach(free=True)) < 2e-5


def test_creep_goes_to_its_share() -> None:
    time = np.linspace(0.0, 5.0, 501)
    step = np.where(time < 0.0999, 0.0, 100.0)  # a ramp from 0.09 s to 0.1 s
    values = {"creep.c": 0.05, "creep.tau": 0.2}
    reading, _ = respond(PiezoGain() + Creep(1), time, step, values, 1e-2)
    # tau z' = s - z, s = d v + c z: z goes to d v / (1 - c) at the rate (1 - c) / tau.
    end = GAIN * 100.0
    after = time > 0.2
    speed = 0.95 / 0.2
    expected = end / 0.95 - (end / 0.95 - end) * np.exp(-speed * (time[after] - 0.095))
    np.testing.assert_allclose(reading[after], expected, rtol=0, atol=3e-4 * 0.05 * end)


@pytest.mark.parametrize(("spread", "taus"), [(1.0, [0.05, 0.5, 5.0]), (0.5, [0.05, 0.1581, 0.5])])
def test_creep_has_one_element_a_decade(spread: float, taus: list[float]) -> None:
    """Or in a share of one."""
    time = np.linspace(0.0, 5.0, 501)
    drive = 100.0 * np.minimum(1.0, time / 0.01)
    own = {"creep.c": 1e-6, "creep.tau": 0.05, "creep.spread": spread}
    reading, _ = respond(PiezoGain() + Creep(3), time, drive, own, 1e-2)
    late = time > 0.1
    # So little creep does not feed back; the ramp acts as a step in its middle.
    since = time[late, None] - 0.005
    grown = (1.0 - np.exp(-since / np.array(taus))).mean(axis=1)
    crept = (reading - GAIN * drive)[late] / (1e-6 * GAIN * 100.0)
    np.testing.assert_allclose(crept, grown, rtol=0, atol=1e-3)


def test_nonlinear_gain_is_its_polynomial() -> None:
    drive = np.linspace(-5, 10, 31)
    reading = static(
        NonlinearGain(), drive, {"nonlinear_gain.k2": 2e-5, "nonlinear_gain.ratio": 0.1}
    )
    np.testing.assert_allclose(
        reading, 1e-3 * drive + 2e-5 * drive**2 + 2e-6 * drive**3, rtol=0, atol=1e-15
    )
    own = {"nonlinear_gain.k2": 2e-5, "nonlinear_gain.bend": 0.03}
    quartic = static(NonlinearGain(), drive, own) - 1e-3 * drive
    np.testing.assert_allclose(quartic, 2e-5 * drive**2 + 6e-7 * drive**4, rtol=0, atol=1e-15)


def test_temperature_changes_the_gain_and_expansion_the_zero() -> None:
    time = np.linspace(0, 1, 21)
    drive, warmth = 30 + 50 * np.sin(7 * time), 290 + 10 * time
    values = {"temperature.a": 3e-10, "temperature_2.b": 2e-7, "temperature_2.T0": 290.0}
    model = PiezoGain() + Temperature() + Temperature(expanding=True)
    reading, _ = respond(model, time, drive, values, temperature=warmth)
    expected = (1e-7 + 3e-10 * (warmth - 293.15)) * drive + 2e-7 * (warmth - 290.0)
    np.testing.assert_allclose(reading, expected, rtol=0, atol=1e-15)
    bent, _ = respond(model, time, drive, {**values, "temperature.bend": 0.02}, temperature=warmth)
    more = 3e-10 * 0.02 * (warmth - 293.15) ** 2 * drive
    np.testing.assert_allclose(bent - reading, more, rtol=0, atol=1e-15)


def test_one_effect_of_temperature_holds_the_other_in_detail() -> None:
    time = np.linspace(0, 1, 21)
    drive, warmth = 30 + 50 * np.sin(7 * time), 290 + 10 * time
    warmer = warmth - 293.15
    expected = 1e-7 * drive + warmer * (3e-10 * drive + 2e-7)
    shifted = {"temperature.a": 3e-10, "temperature.shift": 2e-7 / 3e-10}
    sloped = {"temperature.b": 2e-7, "temperature.slope": 3e-10 / 2e-7}
    for expanding, values in ((False, shifted), (True, sloped)):
        model = PiezoGain() + Temperature(expanding=expanding)
        reading, _ = respond(model, time, drive, values, temperature=warmth)
        np.testing.assert_allclose(reading, expected, rtol=0, atol=1e-15)


def settled(model: Model, values: Mapping[str, float], volts: float = 50.0) -> float:
    """Where the position comes to rest after the drive has risen to so many volts."""
    time = np.linspace(0.0, 0.06, 241)
    drive = volts * np.minimum(1.0, time / 0.01)
    return float(respond(model, time, drive, {"second_order.zeta": 0.3, **values}, 2e-5)[0][-1])


def test_springs_come_to_rest_where_their_forces_balance() -> None:
    omega2 = 6e3**2
    base = PiezoGain() + SecondOrder()
    s = GAIN * 50.0
    assert settled(base + Load(), {"load.k": 0.5 * omega2}) == pytest.approx(s / 1.5, rel=1e-6)
    k3, x0 = 3e17, 2e-6
    x = settled(base + CubicStiffness(), {"cubic_stiffness.k3": k3, "cubic_stiffness.x0": x0})
    assert omega2 * (s - x) == pytest.approx(k3 * ((x - x0) ** 3 + x0**3), rel=1e-4)
    assert x < 0.96 * s


@pytest.mark.parametrize("deflection", [False, True])
def test_nonlinear_damping_takes_what_the_same_ratio_would_at_resonance(deflection: bool) -> None:
    """Of A = s / (2 zeta): zeta = 4 b A / (3 pi), or c A^2 / (8 omega)."""
    omega, share = 6e3, 0.03
    swing = GAIN * 1.0 / (2.0 * share)
    own = (
        {"c": 8.0 * omega * share / swing**2}
        if deflection
        else {"b": 3.0 * np.pi * share / (4.0 * swing)}
    )
    values = {f"nonlinear_damping.{k}": v for k, v in own.items()}
    model = PiezoGain() + SecondOrder() + NonlinearDamping(deflection=deflection)
    time = np.arange(4000) * 2.5e-5
    values |= {"second_order.omega": omega, "second_order.zeta": 1e-9}
    reading, _ = respond(model, time, np.sin(omega * time), values, 1e-5)
    late = time > 0.06
    expected = -swing * np.cos(omega * time[late])
    # Beside the fundamental there is a third harmonic of c A^2 / (32 omega) = zeta / 4 at most.
    np.testing.assert_allclose(reading[late], expected, atol=0.02 * swing)


def test_a_loaded_actuator_has_its_closed_form() -> None:
    """omega_L^2 = (k + k_L) / (m + M) with k = omega^2 m, the gain scaled alike."""
    m, spring, damper, k_load, mass = 0.02, 7.2e5, 12.0, 2.5e5, 0.03
    model = PiezoGain() + SecondOrder() + Load() + LoadMass()
    omega = float(np.sqrt(spring / m))
    values = {
        "second_order.omega": omega, "second_order.zeta": damper / (2.0 * m * omega),
        "load.k": k_load / m, "load_mass.ratio": mass / m,
    }  # fmt: skip
    poles = poles_at_rest(model, values)
    assert poles.size == 2
    loaded = (spring + k_load) / (m + mass)
    np.testing.assert_allclose(np.abs(poles) ** 2, loaded, rtol=1e-12)
    np.testing.assert_allclose(-2.0 * poles.real, damper / (m + mass), rtol=1e-12)
    rest = settled(model, {**values, "second_order.zeta": 0.6})
    assert rest == pytest.approx(GAIN * 50.0 * spring / (spring + k_load), rel=1e-6)
    # Driven at the loaded resonance it swings to the static stroke over 2 zeta_L.
    time = np.arange(0.0, 0.06, 2e-5)
    at = float(np.sqrt(loaded))
    swing, _ = respond(model, time, np.sin(at * time), values, 1e-5)
    share = damper / (m + mass) / (2.0 * at)
    largest = GAIN * spring / (spring + k_load) / (2.0 * share)
    late = time > 0.04
    assert np.exp(-share * at * 0.04) < 1e-2  # The transient has died away.
    np.testing.assert_allclose(swing[late], -largest * np.cos(at * time[late]), atol=0.01 * largest)


def test_a_carried_mass_is_moved_by_every_force() -> None:
    time = np.linspace(0.0, 0.02, 401)
    drive = 60.0 * np.sin(2.0 * np.pi * 150.0 * time)
    rest = PiezoGain() + SecondOrder() + CubicStiffness() + Friction() + Load()
    own = {"second_order.omega": 6e3, "second_order.zeta": 0.1, "cubic_stiffness.k3": 3e17,
           "friction.F": 20.0, "friction.z0": 2e-7, "load.k": 1e7}  # fmt: skip
    both = {"load_mass.ratio": 0.9, "load_mass_2.ratio": 0.6}
    carried, _ = respond(rest + LoadMass() + LoadMass(), time, drive, {**own, **both}, 1e-5)
    by = 2.5
    root = float(np.sqrt(by))
    lighter = {
        **own, "second_order.omega": 6e3 / root, "second_order.zeta": 0.1 / root,
        "cubic_stiffness.k3": 3e17 / by, "friction.F": 20.0 / by, "load.k": 1e7 / by,
    }  # fmt: skip
    same, _ = respond(rest, time, drive, lighter, 1e-5)
    np.testing.assert_allclose(carried, same, rtol=0, atol=1e-9 * np.ptp(same))
    bare, _ = respond(rest, time, drive, own, 1e-5)
    assert np.abs(carried - bare).max() > 0.05 * np.ptp(same)


def test_records_with_and_without_a_load_show_its_spring_and_its_mass() -> None:
    time = np.arange(1200) / 20e3
    drive = 20.0 * np.sin(2.0 * np.pi * (20.0 * time + 0.5 * (1200.0 - 20.0) / 0.06 * time**2))
    model = PiezoGain() + SecondOrder() + Load() + LoadMass() + Offset()
    shared = {"second_order.omega": 4e3, "second_order.zeta": 0.08}
    records = []
    for number, own in enumerate(({}, {"load.k": 6e6, "load_mass.ratio": 0.7})):
        blank = Measurement(time, drive, 1e-7 * drive, name=f"load {number}")
        reading = po.simulate(model, blank, {**shared, **own}).reading
        noise = 2e-9 * np.random.default_rng(number).normal(size=time.size)
        records.append(blank.with_(position=reading + noise))
    unloaded = {"load.k[0]": 0.0, "load_mass.ratio[0]": 0.0}
    fit = po.solve(po.Identification(model, records, fixed=unloaded, start=po.Start.REST))
    for name, value in {**shared, "load.k[1]": 6e6, "load_mass.ratio[1]": 0.7}.items():
        assert fit.values[name] == pytest.approx(value, rel=1e-3), name


def test_a_search_tries_a_carried_mass_only_where_it_is_offered() -> None:
    time = np.arange(400) / 20e3
    drive = 20.0 * np.sin(2.0 * np.pi * 300.0 * time)
    model = PiezoGain() + SecondOrder()
    blank = Measurement(time, drive, 1e-7 * drive)
    noise = 1e-9 * np.random.default_rng(3).normal(size=time.size)
    record = blank.with_(position=po.simulate(model, blank, {}).reading + noise)
    fit = po.solve(po.Identification(model, record, start=po.Start.REST))
    others = [name for name in po.effects.CATALOGUE if name != "load_mass"]
    alone = po.diagnose(fit, withhold=others, ladder=False)
    assert alone.suspects == ()
    offered = po.diagnose(fit, withhold=others, candidates=[LoadMass()], ladder=False)
    assert [s.name for s in offered.suspects] == ["load_mass"]
    assert offered.suspects[0].visibility < 1e-2


def test_a_sticking_contact_is_a_spring_and_its_micro_damping_a_damper() -> None:
    """LuGre before it slides: F / z0 beside the spring, F tau / z0 beside the damper."""
    model = PiezoGain() + SecondOrder() + Friction()
    values = {"friction.F": 10.0, "friction.z0": 1e-6, "friction.tau": 2e-5}
    poles = poles_at_rest(model, values)
    moving = poles[np.abs(poles) > 1.0]
    np.testing.assert_allclose(np.abs(moving) ** 2, 6e3**2 + 10.0 / 1e-6, rtol=1e-9)
    damping = 2.0 * 0.05 * 6e3 + 10.0 * 2e-5 / 1e-6
    np.testing.assert_allclose(-2.0 * moving.real, damping, rtol=1e-9)


def test_sliding_friction_carries_its_coulomb_force_against_the_motion() -> None:
    time = np.linspace(0, 0.4, 401)
    drive = np.interp(time, [0, 0.1, 0.3, 0.4], [0, 60, -60, 0])
    model = PiezoGain() + SecondOrder() + Friction()
    values = {"friction.F": 20.0, "friction.z0": 2e-7, "second_order.zeta": 0.5}
    reading, states = respond(model, time, drive, values, 1e-5)
    lag = 20.0 / 6e3**2
    for moment, sign in ((0.09, 1.0), (0.29, -1.0), (0.39, 1.0)):
        i = int(np.argmin(np.abs(time - moment)))
        speed = float(np.gradient(drive, time)[i]) * GAIN
        behind = GAIN * drive[i] - reading[i] - 2 * 0.5 / 6e3 * speed
        assert behind == pytest.approx(sign * lag, rel=1e-3)
    assert np.abs(states["friction.z"]).max() <= 1.0 + 1e-9


@pytest.mark.parametrize("exponent", [0.8, 0.95, 1.0])
def test_a_contact_that_slides_for_long_keeps_its_derivatives(exponent: float) -> None:
    """Below an exponent of 1 it slides after a finite way, where its law has no derivative."""
    time = np.linspace(0, 0.4, 401)
    drive = np.interp(time, [0, 0.1, 0.3, 0.4], [0, 60, -60, 0])
    model = PiezoGain() + SecondOrder() + Friction()
    values = po.Values.nominal(model).with_(
        {"friction.F": 20.0, "friction.z0": 2e-7, "friction.n": exponent, "second_order.zeta": 0.5}
    )
    moved = ("friction.F", "friction.z0", "friction.n")
    run = Simulator(
        model, Measurement(time, drive, 1e-7 * drive, allow_saturated=True), values,
        directions=moved, substeps=Substeps(2e-5, 1.0),
    )  # fmt: skip
    _, slopes = run.with_sensitivities(values)
    for moment, sign in ((0.09, -1.0), (0.29, 1.0), (0.39, -1.0)):
        force, way, _ = slopes[int(np.argmin(np.abs(time - moment)))]
        assert force == pytest.approx(sign / values["second_order.omega"] ** 2, rel=0.03)
        # How soon it gave way is forgotten.
        assert abs(way) * values["friction.z0"] < 0.05 * 20.0 / values["second_order.omega"] ** 2
    assert np.abs(slopes * [20.0, 2e-7, 1.0]).max() < 1e-6


def test_stribeck_friction_is_larger_at_low_speed() -> None:
    time = np.linspace(0, 0.2, 201)
    drive = 100.0 * time
    model = PiezoGain() + SecondOrder() + Friction()
    values = {"friction.F": 20.0, "friction.z0": 1e-8, "friction.stribeck": 1.5,
              "friction.w_s": 1.0, "second_order.zeta": 0.5}  # fmt: skip
    _, states = respond(model, time, drive, values, 1e-5)
    assert states["friction.z"][-1] == pytest.approx(1.5, rel=1e-3)


def test_a_contact_of_exponent_two_gives_way_as_one_over_the_distance() -> None:
    """z0 dz/dx = (1 - z)^2 from z = 0: 1 - z = 1 / (1 + x / z0)."""
    time = np.linspace(0, 0.2, 201)
    model = PiezoGain() + SecondOrder() + Friction()
    values = {"friction.F": 1.0, "friction.z0": 5e-7, "friction.n": 2.0, "second_order.zeta": 0.5}
    reading, states = respond(model, time, 100.0 * time, values, 1e-5)
    np.testing.assert_allclose(
        1.0 - states["friction.z"], 1.0 / (1.0 + reading / 5e-7), rtol=0, atol=1e-6
    )


def test_smooth_friction_is_viscous_below_and_coulombs_above_its_velocity() -> None:
    time = np.linspace(0, 0.4, 401)
    model = PiezoGain() + SecondOrder() + Friction(smooth=True)
    for slower, share in ((0.1, 1.0), (1.0, float(np.tanh(1.0)))):
        w_c = slower * GAIN * 100.0
        values = {"friction.F": 0.1, "friction.w_c": w_c, "second_order.zeta": 0.5}
        reading, states = respond(model, time, 100.0 * time, values, 1e-5)
        behind = GAIN * 40.0 - reading[-1] - 2 * 0.5 / 6e3 * GAIN * 100.0
        assert behind == pytest.approx(share * 0.1 / 6e3**2, rel=1e-3)
    assert set(states) == {"second_order.x", "second_order.w"}
    assert set(Friction(smooth=True).parameters) == {"F", "w_c"}
    assert Friction(smooth=True).like("hysteretic_force", {"beta": 1.0, "gamma": 1.0}) is None
    assert HystereticForce().like("friction", {"F": 1.0, "w_c": 1e-4}) is None


def test_the_elements_of_a_distributed_force_yield_one_after_another() -> None:
    """Slid far, each carries 1 / beta_i, and on the way there x turns into (1 - exp(-beta_i x)) /
    beta_i; all alike they are the one element."""
    moving, time = PiezoGain() + SecondOrder(), np.arange(400) * 1e-4
    drive = np.interp(time, [0.0, 0.02, 0.03, 0.04], [0.0, 50.0, 50.0, 0.0])
    own = {"alpha": 2e4, "beta": 2e6, "gamma": 1.0, "spread": 16.0}
    values = {"second_order.omega": 2e3, "second_order.zeta": 0.3}
    values |= {f"hysteretic_force.{k}": v for k, v in own.items()}
    model = moving + HystereticForce(distributed=True)
    position, states = respond(model, time, drive, values, 2e-6)
    rising = np.arange(0, 200, 20)  # overdamped enough to move one way only
    assert np.all(np.diff(position[:200]) > -1e-12)
    for i, beta in enumerate(2e6 * 16.0 ** (np.arange(5) / 4.0)):
        bent = -np.expm1(-beta * position[rising]) / beta
        np.testing.assert_allclose(
            states[f"hysteretic_force.z[{i}]"][rising], bent, rtol=0, atol=2e-3 / beta
        )
    alike = {**values, "hysteretic_force.spread": 1.0}
    one, _ = respond(model, time, drive, alike, 1e-5)
    plain = {k: v for k, v in values.items() if not k.endswith("spread")}
    other, _ = respond(moving + HystereticForce(), time, drive, plain, 1e-5)
    np.testing.assert_allclose(one, other, rtol=0, atol=1e-9 * np.ptp(one))
    finer, begun = HystereticForce().finer({"beta": 2e6})
    assert finer == HystereticForce(distributed=True)
    assert begun["beta"] * 10.0**0.5 == pytest.approx(2e6)
    assert finer.finer({"beta": 2e6}) == (finer, {})


def test_hysteretic_force_is_the_law_of_the_public_benchmark() -> None:
    """m y'' + c y' + k y + z = u with the published parameters, integrated independently."""
    m, c, k = 2.0, 10.0, 5e4
    alpha, beta, gamma, delta = 5e4, 1e3, 0.8, -1.1
    time = np.linspace(0.0, 0.4, 301)
    force = 60.0 * np.sin(2 * np.pi * 15 * time) + 30.0 * np.sin(2 * np.pi * 37 * time)

    def law(t: float, state: FloatArray) -> list[float]:
        y, w, z = state
        u = float(np.interp(t, time, force))
        growth = alpha * w - beta * (gamma * abs(w) * z + delta * w * abs(z))
        return [w, (u - c * w - k * y - z) / m, growth]

    exact = solve_ivp(law, (0, 0.4), np.zeros(3), t_eval=time, rtol=1e-9, atol=1e-12,
                      max_step=1e-3)  # fmt: skip
    model = PiezoGain() + SecondOrder() + HystereticForce()
    omega = float(np.sqrt(k / m))
    values = {
        "piezo_gain.d": 1.0 / k, "second_order.omega": omega,
        "second_order.zeta": c / (2 * m * omega), "hysteretic_force.alpha": alpha / m,
        "hysteretic_force.beta": beta, "hysteretic_force.gamma": gamma,
        "hysteretic_force.delta": delta,
    }  # fmt: skip
    reading, states = respond(model, time, force, values, 2e-5)
    np.testing.assert_allclose(reading, exact.y[0], rtol=0, atol=1e-5 * np.ptp(exact.y[0]))
    np.testing.assert_allclose(
        alpha * states["hysteretic_force.z"], exact.y[2], rtol=0, atol=1e-4 * np.ptp(exact.y[2])
    )
    # The loop is wide open: a spring in the place of the law would be far off.
    assert np.abs(exact.y[2] - alpha * exact.y[0]).max() > 0.2 * np.ptp(exact.y[2])


def test_a_second_mode_adds_its_share_at_rest_and_its_resonance() -> None:
    model = PiezoGain() + SecondMode()
    time = np.linspace(0, 0.05, 501)
    values = {"second_mode.g": 0.1, "second_mode.omega": 2e3, "second_mode.zeta": 0.05}
    slow = 40 * np.minimum(1.0, time / 0.02)
    bias, _ = respond(model, time, 30.0 + 0.0 * time + slow * (time > 0.04), values, 2e-5)
    np.testing.assert_allclose(bias[:400], 1.1 * GAIN * 30.0, rtol=1e-9)
    assert respond(model, time, slow, values, 2e-5)[0][-1] == pytest.approx(1.1 * 4e-6, rel=1e-2)
    shaken = 40 * np.sin(2e3 * time)
    reading, _ = respond(model, time, shaken, values, 2e-5)
    extra = reading - GAIN * shaken
    late = time > 0.035
    # At resonance the mode is 1 / (2 zeta) times its static size and a quarter turn late.
    grown = 1.0 - np.exp(-0.05 * 2e3 * time[late])
    np.testing.assert_allclose(
        extra[late], -0.1 * 4e-6 * 10.0 * grown * np.cos(2e3 * time[late]), atol=2e-7
    )


def test_a_pure_sensor_lag_answers_a_ramp_tau_later() -> None:
    time = np.linspace(0, 1, 101)
    values = {"sensor_lag.share": 1.0, "sensor_lag.tau": 0.02}
    reading, _ = respond(PiezoGain() + SensorLag(), time, 10 * time, values, 1e-3)
    np.testing.assert_allclose(reading[50:], 1e-6 * (time[50:] - 0.02), rtol=0, atol=1e-14)


@pytest.mark.parametrize("lag", [AmplifierLag(), SlewLimit(), SensorLag()])
def test_a_lag_starts_at_rest_under_the_first_drive(lag: Effect) -> None:
    time = np.linspace(0, 1, 21)
    drive = np.where(time < 0.6, 30.0, 40.0)
    values = {f"{lag.name}.share": 1.0, f"{lag.name}.tau": 0.02}
    reading, _ = respond(PiezoGain() + lag, time, drive, values, 1e-2)
    np.testing.assert_allclose(reading[time < 0.5], GAIN * 30.0, rtol=1e-12)


def test_the_periodic_error_repeats_every_half_wavelength() -> None:
    drive = np.linspace(0, 20, 81)
    values = {"sensor_nonlinearity.a": 5e-9, "sensor_nonlinearity.phi": 0.3,
              "sensor_nonlinearity.wavelength": 1e-6, "piezo_gain.d": 1e-7}  # fmt: skip
    error = static(SensorNonlinearity(), drive, values) - 1e-7 * drive
    np.testing.assert_allclose(error[:-20], error[20:], rtol=0, atol=1e-15)
    assert error[0] == pytest.approx(5e-9 * np.sin(0.3))
    assert np.abs(error).max() == pytest.approx(5e-9, rel=0.02)


def test_a_bent_scale_is_quadratic() -> None:
    drive = np.linspace(-3, 5, 17)
    own = {"sensor_nonlinearity.curvature": 20.0}
    reading = static(SensorNonlinearity(quadratic=True), drive, own)
    np.testing.assert_allclose(reading, 1e-3 * drive + 20.0 * (1e-3 * drive) ** 2, atol=1e-15)


def test_gain_and_calibration_may_be_cubic() -> None:
    drive = np.linspace(-3, 5, 17)
    own = {"nonlinear_gain.k2": 2e-5, "nonlinear_gain.even": 0.01, "nonlinear_gain.q": 50.0}
    reading = static(NonlinearGain(cubic=True), drive, own)
    added = 2e-5 * (drive**3 / 50.0 + 0.01 * drive**2)
    np.testing.assert_allclose(reading, 1e-3 * drive + added, atol=1e-15)
    own = {"curvature": 20.0, "q": 2e-3, "even": -0.3}
    values = {f"sensor_nonlinearity.{k}": v for k, v in own.items()}
    reading = static(SensorNonlinearity(cubic=True), drive, values)
    x = 1e-3 * drive
    np.testing.assert_allclose(reading, x + 20.0 * (x**3 / 2e-3 - 0.3 * x**2), atol=1e-15)
    assert {"even", "q"} == {*NonlinearGain(cubic=True).parameters} - {*NonlinearGain().parameters}


def test_drift_is_a_straight_line_unless_it_warms_up() -> None:
    time = np.linspace(0.0, 100.0, 51) + 7.0
    drive = np.sin(time)
    elapsed = time - 7.0
    model = PiezoGain() + Drift()
    straight, _ = respond(model, time, drive, {"drift.rate": 2e-8}, 10.0)
    np.testing.assert_allclose(straight - GAIN * drive, 2e-8 * elapsed, rtol=1e-6, atol=1e-18)
    warming, _ = respond(model, time, drive, {"drift.rate": 2e-8, "drift.tau": 30.0}, 10.0)
    np.testing.assert_allclose(
        warming - GAIN * drive, 6e-7 * (1 - np.exp(-elapsed / 30.0)), rtol=1e-9, atol=1e-18
    )
    # The same law in both forms; what differs is whether a search looks for its time constant.
    settling = PiezoGain() + Drift(settling=True)
    same, _ = respond(settling, time, drive, {"drift.rate": 2e-8, "drift.tau": 30.0}, 10.0)
    np.testing.assert_allclose(same, warming, rtol=1e-12)
    assert [Drift(settling=s).parameters["tau"].fixed for s in (False, True)] == [True, False]


def test_two_elements_a_decade_creep_logarithmically() -> None:
    """After a step the strain grows by the same amount in every decade, to two parts in a hundred.

    One element a decade leaves ripples five times as large.
    """
    time = np.arange(0.0, 400.0, 0.02)
    drive = np.where(time > 0.0, 10.0, 0.0)

    def growth(effect: Creep) -> np.ndarray:
        values = {"creep.c": 0.05, "creep.tau": 1e-1 if effect.per_decade == 1 else 3e-2}
        reading, _ = respond(PiezoGain() + effect, time, drive, values, 0.02)
        at = np.geomspace(2.0, 200.0, 41)
        slope = np.diff(np.interp(at, time, reading)) / np.diff(np.log10(at))
        return np.asarray(slope / slope.mean())

    dense, plain = growth(Creep(14, per_decade=2)), growth(Creep(7))
    assert np.ptp(dense) < 0.04
    assert np.ptp(plain) > 0.2


def test_a_wandering_drift_is_a_cubic() -> None:
    time = np.linspace(0.0, 100.0, 51) + 7.0
    t = time - 7.0
    own = {"drift.rate": 2e-8, "drift.bend": -0.03, "drift.twist": 2.1e-4}
    reading, _ = respond(PiezoGain() + Drift(wandering=True), time, np.sin(time), own, 10.0)
    wander = 2e-8 * (t - 0.03 * t**2 + 2.1e-4 * t**3)
    np.testing.assert_allclose(reading - GAIN * np.sin(time), wander, rtol=1e-6, atol=1e-18)
    assert wander.min() < 0.0 < wander[-1]
    assert set(Drift(wandering=True).parameters) == {"rate", "bend", "twist"}
    assert set(Drift().parameters) == {"rate", "tau"}


def test_mains_pickup_is_a_sine_of_the_record_s_time() -> None:
    time = np.linspace(0, 0.1, 401)
    values = {"mains_pickup.a": 3e-9, "mains_pickup.phi": 0.5, "mains_pickup.f": 60.0}
    reading, _ = respond(PiezoGain() + MainsPickup(), time, np.cos(9 * time), values)
    np.testing.assert_allclose(
        reading - GAIN * np.cos(9 * time), 3e-9 * np.sin(2 * np.pi * 60 * time + 0.5), atol=1e-18
    )


def test_the_mains_of_a_country_and_the_laser_of_a_sensor_are_options() -> None:
    time = np.linspace(0, 0.1, 401)
    swing = np.cos(9 * time)
    hum = {"mains_pickup.a": 3e-9, "mains_pickup.phi": 0.5}
    american, _ = respond(PiezoGain() + MainsPickup(mains=60.0), time, swing, hum)
    named, _ = respond(PiezoGain() + MainsPickup(), time, swing, {**hum, "mains_pickup.f": 60.0})
    np.testing.assert_array_equal(american, named)
    error = {"sensor_nonlinearity.a": 3e-9, "sensor_nonlinearity.phi": 0.5}
    fibre, _ = respond(PiezoGain() + SensorNonlinearity(laser=1.55e-6), time, swing, error)
    angle = 4.0 * np.pi * GAIN * swing / 1.55e-6 + 0.5
    np.testing.assert_allclose(fibre - GAIN * swing, 3e-9 * np.sin(angle), atol=1e-18)
    # One program serves all lasers.
    recipes = {
        assemble(PiezoGain() + SensorNonlinearity(**one)).recipe
        for one in SensorNonlinearity.variants
        if "laser" in one
    }
    assert len(recipes) == 1
    assert len([one for one in SensorNonlinearity.variants if "laser" in one]) == 3


@pytest.mark.parametrize("mains", [0.5, 2e4, True, "60", None, float("nan")])
def test_a_senseless_option_is_refused(mains: object) -> None:
    with pytest.raises(
        po.ModelError,
        match=r"mains_pickup: the option 'mains' is .*; give the mains frequency as a number "
        r"from 1 to 10000 1/s\.",
    ):
        MainsPickup(mains)  # type: ignore[arg-type]


def test_backlash_loses_its_width_at_every_turn() -> None:
    time, drive = wander()
    model = PiezoGain() + DeadZone(backlash=True)
    reading, _ = respond(model, time, drive, {"dead_zone.w": 4e-7}, 1.0)
    x = GAIN * drive
    expected = [x[0]]
    for at in x[1:]:
        expected.append(float(np.clip(expected[-1], at - 4e-7, at + 4e-7)))
    np.testing.assert_allclose(reading, expected, rtol=0, atol=1e-18)


def test_free_weights_over_a_broad_density_are_a_sum_of_plays() -> None:
    time, drive = wander()
    model = PiezoGain() + Preisach(free=True)
    weights = 1e-9 * np.random.default_rng(3).uniform(0.0, 2.0, 20)
    values = {f"preisach.w{i + 1}": w for i, w in enumerate(weights)}
    largest = float(np.ptp(drive)) / 2.0
    values |= {"preisach.r": largest, "preisach.b": 1e6, "preisach.c": 0.0, "preisach.origin": 7.0}
    reading, _ = respond(model, time, drive, values, 1.0)
    shares = np.arange(1, 21) / 20.0
    played = np.clip(7.0, drive[0] - largest * shares, drive[0] + largest * shares)
    expected = []
    for at in drive:
        played = np.clip(played, at - largest * shares, at + largest * shares)
        expected.append(GAIN * at + float(weights @ played))
    np.testing.assert_allclose(reading, expected, rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    "law", [PrandtlIshlinskii(), MaxwellSlip(), Preisach(), Preisach(free=True)]
)
def test_a_record_that_begins_later_remembers_what_was_before(law: Effect) -> None:
    """Of a drive that went 8, 47, 21, 35 and on, the part that begins after the 21."""
    corners, largest = np.array([8.0, 47.0, 21.0, 35.0, 12.0, 60.0]), 25.0
    time = np.arange(len(corners) * 20 - 19) / 20.0
    drive = np.interp(time, np.arange(corners.size), corners)
    model = PiezoGain() + law
    own = {f"{law.name}.r": largest, f"{law.name}.origin": 8.0}
    whole, _ = respond(model, time, drive, own, 1.0)
    begins = 41
    own |= {
        f"{law.name}.origin": 21.0,
        f"{law.name}.swing": (21.0 - 47.0) / largest,
        f"{law.name}.swing_before": (47.0 - 8.0) / largest,
    }
    part, _ = respond(model, time[begins:], drive[begins:], own, 1.0)
    np.testing.assert_allclose(part, whole[begins:], rtol=0, atol=1e-15)


def test_a_density_may_be_broader_for_wider_relays() -> None:
    """The output is the integral of the density between the relays that are up and those down."""
    time, drive = wander()
    own = {"rho": 4e-8, "decay": 0.7, "r": 30.0, "b": 20.0, "c": 5.0, "widening": 1.2}
    model = PiezoGain() + Preisach(operators=40)
    reading, _ = respond(
        model, time, drive, {f"preisach.{k}": v for k, v in own.items()}, 1.0
    )  # fmt: skip
    shares = np.arange(1, 41) / 40.0
    breadth = 20.0 * np.exp(1.2 * shares)
    weights = 4e-8 / 40.0 * np.exp(-0.7 * (np.arange(40) / 40.0))
    centres = np.linspace(-200.0, 200.0, 40001)
    played = plays(drive, 30.0 * shares)
    expected = GAIN * drive
    for k, w in enumerate(weights):
        density = w / np.cosh((centres - 5.0) / breadth[k]) ** 2
        whole = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))]) * 0.01
        expected += np.interp(played[:, k], centres, whole) - np.interp(0.0, centres, whole)
    np.testing.assert_allclose(reading, expected, rtol=0, atol=1e-12)


def test_plays_of_several_widths_take_up_a_motion_one_by_one() -> None:
    w, spread = 4e-7, 0.5
    drive = np.concatenate([np.linspace(0.0, 20.0, 41), np.linspace(20.0, 0.0, 401)[1:]])
    model = PiezoGain() + DeadZone(backlash=True, plays=4)
    values = {"dead_zone.w": w, "dead_zone.spread": spread}
    reading, _ = respond(model, np.arange(drive.size) * 1.0, drive, values, 1.0)
    widths = w * (1.0 + spread * np.array([-0.75, -0.25, 0.25, 0.75]))
    way = GAIN * (20.0 - drive[40:])
    taken = np.maximum(0.0, way[:, None] - 2.0 * widths).mean(axis=1)
    np.testing.assert_allclose(reading[40:], GAIN * 20.0 - w - taken, rtol=0, atol=1e-15)
    assert DeadZone(backlash=True).finer({})[0] == model["dead_zone"]
    assert DeadZone().finer({})[0] == DeadZone()


def test_a_loop_behind_a_backlash_of_the_drive_moves_as_on_the_played_drive() -> None:
    time, drive = wander()
    # The play learns the length of a stretch in the first one, in which there is little to miss.
    drive[0] = drive[1] - 1e-6
    slack = 0.7  # less than a step of the drive: contact is made within a sample
    played = [drive[0]]
    for at in drive[1:]:
        played.append(float(np.clip(played[-1], at - slack, at + slack)))
    model = PiezoGain() + BoucWen()
    reading, _ = respond(model + DeadZone(drive_backlash=True), time, drive,
                         {"dead_zone.slack": slack}, 1.0)  # fmt: skip
    expected, _ = respond(model, time, np.array(played), None, 1.0)
    np.testing.assert_allclose(reading, expected, rtol=0, atol=1e-12)


def test_backlash_is_behind_the_position_and_a_dead_zone_before_the_gain() -> None:
    model = PiezoGain() + DeadZone() + DeadZone(backlash=True)
    assert [n for n, _ in model.at(Place.INPUT)] == ["dead_zone"]
    assert [n for n, _ in model.at(Place.OUTPUT)] == ["dead_zone_2"]
    assert [e.states for _, e in model if e.states] == [{"z": 1}]


@pytest.mark.parametrize("size", [0, -1, 2.5, True, 10**9, "3"])
def test_a_senseless_number_of_elements_is_refused(size: object) -> None:
    with pytest.raises(
        ModelError, match=r"creep: the number of elements of 'z' is .* whole number"
    ):
        Creep(size)  # type: ignore[arg-type]


@pytest.mark.parametrize("lag", [AmplifierLag(poles=2), SensorLag(poles=2)])
def test_a_lag_of_two_poles_answers_a_ramp_both_time_constants_later(lag: Effect) -> None:
    """Time constants of 20 ms and 10 ms: tau^2 is their product, 2 zeta tau their sum."""
    time, tau = np.linspace(0, 1, 101), np.sqrt(0.02 * 0.01)
    values = {f"{lag.name}.share": 1.0, f"{lag.name}.tau": tau, f"{lag.name}.zeta": 0.015 / tau}
    reading, _ = respond(PiezoGain() + lag, time, 10 * time, values, 1e-3)
    np.testing.assert_allclose(reading[60:], 1e-6 * (time[60:] - 0.03), rtol=0, atol=1e-11)
    # It sets off flat: the second pole waits for the first.
    alone, _ = respond(
        PiezoGain() + type(lag)(), time, 10 * time, {**values, f"{lag.name}.tau": 0.02}, 1e-3
    )
    assert 0.0 < reading[1] < 0.5 * alone[1]


@pytest.mark.parametrize("lag", [AmplifierLag(poles=2), SensorLag(poles=2)])
def test_a_filter_of_butterworth_overshoots_a_step_by_four_per_cent(lag: Effect) -> None:
    time = np.linspace(0.0, 0.2, 2001)
    values = {f"{lag.name}.share": 1.0, f"{lag.name}.tau": 0.01, f"{lag.name}.zeta": np.sqrt(0.5)}
    drive = np.where(time < 0.02, 0.0, 10.0)
    reading, _ = respond(PiezoGain() + lag, time, drive, values, 1e-5)
    assert reading.max() / reading[-1] - 1.0 == pytest.approx(np.exp(-np.pi), rel=1e-3)


@pytest.mark.parametrize("kind", [AmplifierLag, SensorLag, ChargeBackCoupling])
def test_a_lag_of_three_poles_is_refused(kind: Callable[..., Effect]) -> None:
    base = PiezoGain() + SecondOrder()
    with pytest.raises(ModelError, match=r"(lag|coupling): poles is 3; give 1 or 2"):
        assemble(base + kind(poles=3), constants={})


def test_details_of_a_shape_are_what_they_say() -> None:
    drive = np.linspace(-3, 5, 17)
    x = 1e-3 * drive
    own = {"sensor_nonlinearity.curvature": 20.0, "sensor_nonlinearity.ratio": 30.0}
    bent = static(SensorNonlinearity(quadratic=True), drive, own)
    np.testing.assert_allclose(bent, x + 20.0 * x**2 + 600.0 * x**3, rtol=0, atol=1e-15)
    own = {"a": 5e-9, "phi": 0.3, "wavelength": 1e-6, "s2": 0.2, "c2": -0.1}
    values = {f"sensor_nonlinearity.{k}": v for k, v in own.items()}
    error = static(SensorNonlinearity(), drive, {**values, "piezo_gain.d": 1e-7}) - 1e-7 * drive
    turn = 4.0 * np.pi * 1e-7 * drive / 1e-6 + 0.3
    expected = 5e-9 * (np.sin(turn) + 0.2 * np.sin(2 * turn) - 0.1 * np.cos(2 * turn))
    np.testing.assert_allclose(error, expected, rtol=0, atol=1e-15)
    time = np.linspace(0, 0.1, 401)
    own = {"a": 3e-9, "phi": 0.5, "s2": 0.1, "c2": 0.2, "s3": 0.3, "c3": 0.4}
    values = {f"mains_pickup.{k}": v for k, v in own.items()}
    swing = np.cos(9 * time)
    hum = respond(PiezoGain() + MainsPickup(), time, swing, values)[0] - GAIN * swing
    p = 2.0 * np.pi * 50.0 * time + 0.5
    expected = np.sin(p) + 0.1 * np.sin(2 * p) + 0.2 * np.cos(2 * p)
    expected += 0.3 * np.sin(3 * p) + 0.4 * np.cos(3 * p)
    np.testing.assert_allclose(hum, 3e-9 * expected, rtol=0, atol=1e-18)


def test_asymmetry_bends_with_the_cube_of_the_drive() -> None:
    time = np.linspace(0.0, 1.0, 101)
    drive = 40.0 * time
    values = {"bouc_wen.alpha": 0.0, "bouc_wen.beta": 0.0, "asymmetry.delta": 1e-10,
              "asymmetry.bend": 1e-3}  # fmt: skip
    _, states = respond(PiezoGain() + BoucWen() + Asymmetry(), time, drive, values, 1e-3)
    expected = 1e-10 * (drive**2 / 2.0 + 1e-3 * drive**4 / 4.0)
    np.testing.assert_allclose(states["bouc_wen.h"], expected, rtol=1e-6, atol=1e-18)


def test_a_guide_stiffens_further_with_the_fifth_power() -> None:
    base, k3, fifth = PiezoGain() + SecondOrder(), 3e17, 2e10
    own = {"cubic_stiffness.k3": k3, "cubic_stiffness.fifth": fifth}
    x = settled(base + CubicStiffness(), own)
    assert 6e3**2 * (GAIN * 50.0 - x) == pytest.approx(k3 * (x**3 + fifth * x**5), rel=1e-4)
    assert x < settled(base + CubicStiffness(), {"cubic_stiffness.k3": k3})


def test_fractional_creep_weighs_slow_elements_more() -> None:
    time = np.linspace(0.0, 5.0, 501)
    drive = 100.0 * np.minimum(1.0, time / 0.01)
    values = {"creep.c": 1e-6, "creep.tau": 0.05, "creep.power": 0.3}
    reading, _ = respond(PiezoGain() + Creep(3), time, drive, values, 1e-2)
    late = time > 0.1
    since = time[late, None] - 0.005
    weights = 10.0 ** (0.3 * np.arange(3))
    grown = (1.0 - np.exp(-since / np.array([0.05, 0.5, 5.0]))) @ (weights / weights.sum())
    crept = (reading - GAIN * drive)[late] / (1e-6 * GAIN * 100.0)
    np.testing.assert_allclose(crept, grown, rtol=0, atol=1e-3)


def test_a_mode_out_of_phase_adds_its_velocity() -> None:
    time = np.linspace(0, 0.05, 501)
    drive = 40 * np.sin(1e3 * time)
    own = {"second_mode.g": 0.1, "second_mode.omega": 2e3, "second_mode.zeta": 0.05}
    model = PiezoGain() + SecondMode()
    plain, states = respond(model, time, drive, own, 2e-5)
    turned, _ = respond(model, time, drive, {**own, "second_mode.phase": 0.3}, 2e-5)
    np.testing.assert_allclose(
        turned - plain, 0.1 * 0.3 * states["second_mode.r"] / 2e3, rtol=0, atol=1e-15
    )


def test_the_same_physics_in_another_effect_and_in_more_detail() -> None:
    time = np.linspace(0, 0.4, 401)
    drive = 20.0 * np.sin(30.0 * time)
    base = PiezoGain() + SecondOrder()
    dahl = {"F": 3.0, "z0": 2e-7, "n": 1.0}
    like = HystereticForce().like("friction", dahl)
    assert like is not None
    mechanics = {"second_order.omega": 6e3, "second_order.zeta": 0.3}
    rubbing, _ = respond(
        base + Friction(), time, drive,
        {**mechanics, **{f"friction.{k}": v for k, v in dahl.items()}}, 2e-5,
    )  # fmt: skip
    remembering, _ = respond(
        base + HystereticForce(), time, drive,
        {**mechanics, **{f"hysteretic_force.{k}": v for k, v in like.items()}}, 2e-5,
    )  # fmt: skip
    np.testing.assert_allclose(remembering, rubbing, rtol=0, atol=1e-12)
    assert np.abs(rubbing - respond(base, time, drive, mechanics, 2e-5)[0]).max() > 1e-8
    assert HystereticForce().like("creep", {"c": 0.1, "tau": 1.0}) is None
    finer, start = Creep(3).finer({"c": 0.1, "tau": 1.0})
    assert finer == Creep(7, per_decade=2)
    assert start == {"tau": pytest.approx(0.316, rel=1e-3)}
    assert finer.finer({"c": 0.1, "tau": 1.0}) == (finer, {})
    assert Drift().finer({}) == (Drift(), {})


def test_a_detail_that_is_not_fixed_is_refused() -> None:
    with pytest.raises(ModelError, match="declare fixed=True"):
        Parameter("1", "roundness", nominal=0.0, detail=True)
