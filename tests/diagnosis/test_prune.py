"""What the model's later details made unnecessary leaves the ladder, the last step included."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.diagnosis import prune as module
from piezo_opt.diagnosis.held_out import HeldOut, error_on, hold_out, rms
from piezo_opt.diagnosis.prune import prune
from piezo_opt.diagnosis.rung import STRONG, WORTH
from piezo_opt.diagnosis.steps import Step
from piezo_opt.effects import (
    ChargeBackCoupling,
    Delay,
    Effect,
    NonlinearGain,
    SecondMode,
    SensorLag,
    SensorNonlinearity,
)
from tests.diagnosis.plants import MOVING, NOISE, TRUTH, clock, measured, rich

LAGS = SensorLag(poles=2), {"share": 1.0, "tau": 1.2e-3, "ratio": 0.5}


def step(effect: Effect, before: po.Fit, after: po.Fit) -> Step:
    return Step(effect.name, effect, (effect.name,), before.rms, after.rms, None, None, 99.0, 1e-9,
                after)  # fmt: skip


def test_a_step_that_a_detail_of_a_later_one_replaces_is_dropped() -> None:
    """A delay and a lag of one pole are what a lag of two poles does alone."""
    time = clock(3000)
    record = measured(MOVING, time, rich(time), LAGS)
    held = hold_out(po.Identification(MOVING, record), None)
    train = held.question.campaign.records[0]
    foot = po.solve(po.Identification(MOVING, train), start=TRUTH)
    late = po.solve(po.Identification(MOVING + Delay(), train), start=foot.values)
    both = po.solve(po.Identification(MOVING + Delay() + SensorLag(), train), start=late.values)
    steps = [step(Delay(), foot, late), step(SensorLag(), late, both)]
    fit, kept, dropped = prune(both, steps, held, threads=2)
    assert dropped == ["delay"]
    assert [s.name for s in kept] == ["sensor_lag"]
    assert fit.model["sensor_lag"] == SensorLag(poles=2)
    assert fit.rms == pytest.approx(NOISE, rel=0.05)
    assert kept[0].fit is fit
    assert kept[0].held_out_after == rms(error_on(fit, held.record))


def test_without_a_name_the_model_keeps_the_details_it_was_given() -> None:
    """A second mode at the first one's frequency is a gain; without it the loop is still round."""
    time = clock(3000)
    drive = 40.0 - 30.0 * np.cos(2.0 * np.pi * (0.5 * time + 14.9 * time**2))
    charge = {"kappa": 4e4, "tau": 1.5e-3, "ratio": 0.3}
    train = measured(MOVING, time, drive)
    round_loop = {**TRUTH, "bouc_wen.n": 1.3, "bouc_wen.h_s": 1e-7}
    hidden = MOVING + ChargeBackCoupling(poles=2)
    truth = {**round_loop, **{f"charge_back_coupling.{k}": v for k, v in charge.items()}}
    noise = NOISE * np.random.default_rng(0).normal(size=time.size)
    train = train.with_(position=po.simulate(hidden, train, truth).reading + noise)
    held = hold_out(po.Identification(MOVING, train), None)
    (record,) = held.question.campaign.records
    foot = po.solve(po.Identification(MOVING, record), start=TRUTH)
    model = MOVING + SecondMode() + ChargeBackCoupling(poles=2)
    less = 1.0 / 3.7
    both = po.solve(
        po.Identification(model, record, free=("bouc_wen.n", "charge_back_coupling.ratio")),
        start={
            **truth, "piezo_gain.d": less * TRUTH["piezo_gain.d"],
            "bouc_wen.alpha": less * TRUTH["bouc_wen.alpha"],
            "charge_back_coupling.kappa": charge["kappa"] / less,
            "second_mode.g": 2.7, "second_mode.omega": TRUTH["second_order.omega"],
            "second_mode.zeta": TRUTH["second_order.zeta"],
        },
    )  # fmt: skip
    assert both.rms == pytest.approx(NOISE, rel=0.05)
    steps = [step(SecondMode(), foot, both), step(ChargeBackCoupling(poles=2), both, both)]
    fit, kept, dropped = prune(both, steps, held, threads=2)
    assert dropped == ["second_mode"]
    assert [s.name for s in kept] == ["charge_back_coupling"]
    assert fit.rms == pytest.approx(both.rms, rel=0.01)
    assert "bouc_wen.n" in fit.question.free


def bent(k2: float) -> tuple[po.Fit, list[Step], HeldOut]:
    """A bent gain, fitted, with a bent calibration beside it that explains nothing that is left."""
    time = clock(2000)
    record = measured(MOVING, time, rich(time), (NonlinearGain(), {"k2": k2}))
    held = hold_out(po.Identification(MOVING, record), None)
    train = held.question.campaign.records[0]
    foot = po.solve(po.Identification(MOVING, train), start=TRUTH)
    scale = SensorNonlinearity(quadratic=True)
    one = po.solve(po.Identification(MOVING + NonlinearGain(), train), start=foot.values)
    two = po.solve(po.Identification(MOVING + NonlinearGain() + scale, train), start=one.values)
    steps = [step(NonlinearGain(), foot, one), step(scale, one, two)]
    return two, steps, held


@pytest.mark.parametrize("last", [False, True])
def test_the_last_step_is_asked_where_the_model_has_changed_since(last: bool) -> None:
    two, steps, held = bent(3e-11)
    # The first is not spared by the second here; what is asked is whether the last one is.
    _, kept, _ = prune(two, steps[1:], held, threads=2, last=last)
    assert [s.name for s in kept] == ([] if last else ["sensor_nonlinearity"])


def test_of_two_that_can_do_without_each_other_whoever_explains_less_goes() -> None:
    """A little bent: without the gain's bend 1.025 of the noise is left, less than a name's worth.

    Which of the two was found first says nothing.
    """
    two, steps, held = bent(1e-11)
    for name in ("nonlinear_gain", "sensor_nonlinearity"):
        least = module._without(two, held, 2, name)
        assert least is not None
        assert module._spare(least, two, held)
    for found in (steps, steps[::-1]):
        fit, kept, dropped = prune(two, found, held, threads=2, last=True)
        assert dropped == ["sensor_nonlinearity"]
        assert [s.name for s in kept] == ["nonlinear_gain"]
        assert fit.rms == pytest.approx(NOISE, rel=0.03)


@pytest.mark.parametrize(
    ("gain", "poorer", "elsewhere", "spare"),
    [
        # Weak evidence is none; strong evidence for less than a name is worth decides where
        # the record that is judged on is not better for it either.
        (0.49 * STRONG, 2.0, 2.0, True),
        (0.51 * STRONG, 2.0, 2.0, False),
        (99.0, 1.0 / (1.0 - WORTH) + 1e-3, 1.0, False),
        (99.0, 1.0 / (1.0 - WORTH) - 1e-3, 1.0, True),
        (99.0, 1.01, 1.0 / (1.0 - WORTH) + 1e-3, False),
        (99.0, 1.01, 1.0 / (1.0 - WORTH) - 1e-3, True),
    ],
)
def test_what_a_name_must_be_worth(
    gain: float, poorer: float, elsewhere: float, spare: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    without, fit = SimpleNamespace(rms=poorer, held=elsewhere), SimpleNamespace(rms=1.0, held=1.0)
    monkeypatch.setattr(module, "bic_gain", lambda *_: gain)
    monkeypatch.setattr(module, "elsewhere", lambda of, _: np.full(4, of.held))
    held: Any = SimpleNamespace(record=None)
    assert module._spare(without, fit, held) is spare  # type: ignore[arg-type]
