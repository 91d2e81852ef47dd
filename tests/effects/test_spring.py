"""A balance without inertia holds at every instant, whatever forces act on it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.assembly import assemble
from piezo_opt.effects import (
    BoucWen,
    CubicStiffness,
    Effect,
    Friction,
    HystereticForce,
    Load,
    Offset,
    PiezoGain,
    SecondOrder,
    Spring,
)
from piezo_opt.errors import ModelError

OMEGA = 2e3
TRUTH = {"piezo_gain.d": 1e-7, "bouc_wen.alpha": 3e-8, "bouc_wen.beta": 0.04, "offset.y0": 2e-7}
TIME = np.linspace(0.0, 8.0, 1601)
DRIVE = 35.0 - 30.0 * np.cos(2.0 * np.pi * 0.5 * TIME) * np.linspace(0.4, 1.0, TIME.size)
JUMPS = 30.0 + 30.0 * np.sign(np.sin(2.0 * np.pi * 0.4 * TIME + 1e-3)) * np.linspace(1, 0.2, 1601)

FORCES: list[tuple[Effect, Mapping[str, float]]] = [
    (Friction(), {"F": 1.5, "z0": 3e-7}),
    (Friction(), {"F": 1.5, "z0": 3e-7, "stribeck": 1.5, "w_s": 5e-6}),
    (HystereticForce(), {"alpha": 1e6, "beta": 2e6, "gamma": 0.7, "delta": 0.1}),
    (HystereticForce(), {"alpha": 1e6, "beta": 2e6, "gamma": 0.7, "n": 1.6}),
    (CubicStiffness(), {"k3": 3e16}),
]


def answered(
    effect: Effect, own: Mapping[str, float], drive: np.ndarray, mechanics: Effect | None = None
) -> po.Response:
    model = PiezoGain() + BoucWen() + (mechanics or Spring()) + effect + Offset()
    values = {**TRUTH, **{f"{effect.name}.{k}": v for k, v in own.items()}}
    kind = "spring" if mechanics is None else "second_order"
    values |= {f"{kind}.omega": OMEGA}
    if mechanics is not None:
        values |= {"second_order.zeta": 1.0}
    record = po.Measurement(TIME, drive, 1e-7 * drive, allow_saturated=True)
    return po.simulate(model, record, values, tolerance=1e-7)


def pulled(effect: Effect, own: Mapping[str, float], response: po.Response) -> np.ndarray:
    """The force per mass on the position, by hand."""
    states = dict(zip(response.state_names, response.states.T, strict=True))
    if isinstance(effect, Friction):
        return np.asarray(own["F"] * states["friction.z"])
    if isinstance(effect, HystereticForce):
        return np.asarray(own["alpha"] * states["hysteretic_force.z"])
    return np.asarray(own["k3"] * states["spring.x"] ** 3)


@pytest.mark.parametrize("drive", [DRIVE, JUMPS], ids=["smooth", "jumps"])
@pytest.mark.parametrize(("effect", "own"), FORCES)
def test_the_balance_holds(effect: Effect, own: Mapping[str, float], drive: np.ndarray) -> None:
    response = answered(effect, own, drive)
    states = dict(zip(response.state_names, response.states.T, strict=True))
    free = TRUTH["piezo_gain.d"] * drive - states["bouc_wen.h"]
    force = pulled(effect, own, response) / OMEGA**2
    assert np.abs(force).max() > 1e-7
    position = states["spring.x"]
    # Static friction lets go at once, which two steps of Newton's method follow to a hundredth.
    bent = 0.02 if own.get("stribeck", 1.0) > 1.0 else 1e-4
    np.testing.assert_allclose(free - position, force, atol=bent * np.abs(force).max())
    np.testing.assert_allclose(response.reading, position + TRUTH["offset.y0"], atol=1e-18)


@pytest.mark.parametrize(("effect", "own"), FORCES)
def test_it_is_the_limit_of_fast_mechanics(effect: Effect, own: Mapping[str, float]) -> None:
    """Which lag by 2 zeta / omega, and so by that times the speed."""
    response = answered(effect, own, DRIVE)
    moving = answered(effect, own, DRIVE, SecondOrder())
    speed = np.abs(np.gradient(moving.reading, TIME)).max()
    late = TIME > 0.1
    gap = np.abs(response.reading - moving.reading)[late].max()
    plain = np.abs(response.reading - answered(Friction(), {}, DRIVE).reading).max()
    assert gap < 3.0 * 2.0 / OMEGA * speed < 0.5 * plain
    assert response.accuracy.per_sample < moving.accuracy.per_sample


def test_steps_cost_no_more_than_slopes() -> None:
    effect, own = FORCES[0]
    assert answered(effect, own, JUMPS).accuracy.per_sample < 20.0


def test_without_forces_there_is_nothing_to_it() -> None:
    response = answered(Load(), {}, DRIVE)
    free = (
        TRUTH["piezo_gain.d"] * DRIVE - response.states[:, response.state_names.index("bouc_wen.h")]
    )
    np.testing.assert_allclose(response.reading, free + TRUTH["offset.y0"], atol=1e-15)


def test_only_plays_are_put_back_on_their_balance() -> None:
    """A smooth law keeps its differential equation, which collocation needs."""
    assert assemble(PiezoGain() + BoucWen() + Spring() + Friction()).becomes is None
    model = PiezoGain() + BoucWen() + Spring() + Offset()
    record = po.Measurement(TIME[:60], DRIVE[:60], 1e-7 * DRIVE[:60], allow_saturated=True)
    question = po.Identification(model, record)
    collocated = po.solve(question, transcription=po.Collocation(), statistics=False)
    shot = po.solve(question, statistics=False)
    assert collocated.rms == pytest.approx(shot.rms, rel=0.05)


def test_a_model_has_one_mechanics() -> None:
    with pytest.raises(ModelError, match=r"2 positions \(second_order, spring\)"):
        _ = PiezoGain() + SecondOrder() + Spring()


def test_a_force_of_the_velocity_itself_is_refused() -> None:
    """It would be left out of the balance without a word."""
    model = PiezoGain() + Spring() + Friction()
    record = po.Measurement(TIME, DRIVE, 1e-7 * DRIVE, allow_saturated=True)
    with pytest.raises(ModelError, match=r"spring, friction: a force depends on the velocity"):
        po.simulate(model, record, {"friction.tau": 1e-3})
    po.simulate(model, record, {"friction.F": 1.0})
