"""Two effects that neither of them shows alone, found together."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.diagnosis import base_point as module
from piezo_opt.diagnosis import choice, pairs, shortlist
from piezo_opt.diagnosis import ladder as climbing
from piezo_opt.diagnosis.base_point import BasePoint, base_point
from piezo_opt.diagnosis.held_out import HeldOut, error_on, hold_out, rms
from piezo_opt.diagnosis.ladder import _unaided, climb
from piezo_opt.diagnosis.pairs import pair
from piezo_opt.diagnosis.rung import Rung, Trial, race, solved
from piezo_opt.diagnosis.shortlist import entrants, scored
from piezo_opt.effects import (
    AmplifierLag,
    Asymmetry,
    ChargeBackCoupling,
    Creep,
    Drift,
    Effect,
    Friction,
    NonlinearGain,
    PiezoGain,
    SecondMode,
    SecondOrder,
    SensorLag,
    Spring,
)
from piezo_opt.errors import ModelError
from piezo_opt.measurement import FloatArray
from tests.diagnosis.plants import MOVING, NOISE, STILL, TRUTH, clock, fitted, measured, rich

CHARGE = ChargeBackCoupling(), {"kappa": 2e4, "tau": 4e-3}
BENT = NonlinearGain(), {"k2": -5e-11}
MODE = SecondMode(), {"g": 0.08, "omega": 2.0 * np.pi * 110.0, "zeta": 0.02}
OFFERED: list[Effect] = [
    Creep(elements=1), AmplifierLag(), SensorLag(), NonlinearGain(), SecondMode(),
    ChargeBackCoupling(),
]  # fmt: skip
FEW = {"charge_back_coupling", "nonlinear_gain", "creep", "sensor_lag"}


def chirp(time: FloatArray, first: float, last: float) -> FloatArray:
    """Between 10 and 70 V, of rising frequency [Hz]."""
    span = float(time[-1])
    phase = 2.0 * np.pi * (first * time + (last - first) * time**2 / (2.0 * span))
    return np.asarray(40.0 - 30.0 * np.cos(phase))


def _named(effect: tuple[Effect, Mapping[str, float]]) -> dict[str, float]:
    return {f"{effect[0].name}.{k}": v for k, v in effect[1].items()}


def below_resonance() -> tuple[po.Fit, HeldOut]:
    """A fit without mechanics of a record that ends below the resonance, and one beyond it."""
    time = clock(3000)
    train = measured(MOVING, time, chirp(time, 0.5, 20.0), CHARGE, BENT)
    test = measured(MOVING, time, chirp(time, 0.5, 90.0), CHARGE, BENT, seed=1, name="test")
    question = po.Identification(STILL, train)
    return po.solve(question), hold_out(question, test)


def test_forces_and_gain_are_found_together_with_the_mechanics_they_need(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    foot, held = below_resonance()
    assert foot.rms > 5.0 * NOISE
    # To first order these two explain most of all fifteen pairs: no others are fitted.
    monkeypatch.setattr(pairs, "_SAME", 2.0)
    monkeypatch.setattr(pairs, "_FITTED", 1)
    found = pair(foot, foot, held, OFFERED, threads=2)
    assert found is not None
    fit, steps = found
    assert {step.name for step in steps} == {"charge_back_coupling", "nonlinear_gain"}
    assert any(isinstance(effect, SecondOrder) for _, effect in fit.model)
    assert fit.rms == pytest.approx(NOISE, rel=0.03)
    assert fit.values["second_order.omega"] == pytest.approx(TRUTH["second_order.omega"], rel=0.02)
    assert fit.values["nonlinear_gain.k2"] == pytest.approx(BENT[1]["k2"], rel=0.05)
    # Each step is told from the foot to the fit with both.
    first, second = steps
    assert first.rms_before == foot.rms
    assert first.rms_after == second.rms_before
    assert foot.rms > first.rms_after > 2.0 * second.rms_after
    assert second.rms_after == fit.rms
    assert second.held_out_after == rms(error_on(fit, held.record))
    assert max(step.p_value for step in steps) < 1e-6
    assert first.group[0] == first.name


def test_few_pairs_are_followed_to_their_end(monkeypatch: pytest.MonkeyPatch) -> None:
    foot, held = below_resonance()
    asked: list[tuple[int, int]] = []

    def race(*given: Any, most: int, podium: int = 3, **also: Any) -> list[Rung]:
        asked.append((most, podium))
        return tried(*given, most=most, podium=podium, **also) if podium > 3 else []

    tried = pairs.race
    monkeypatch.setattr(pairs, "race", race)
    few = [e for e in OFFERED if e.name in FEW]
    assert pair(foot, foot, held, few, threads=2) is None
    # Everybody alone, of whom the likeliest are paired; and then the pairs.
    assert [podium for _, podium in asked] == [14, 3]
    assert asked[0][0] >= len(few)
    assert asked[1][0] == 12


@pytest.mark.parametrize(("left", "finished"), [(1.3, 3), (1.0, 1)])
def test_pairs_are_finished_until_one_leaves_nothing_to_win(
    left: float, finished: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The closest first; where nothing is left to be won, what comes after it wins nothing."""
    foot, held = below_resonance()
    done: list[Rung] = []

    def finish(_: po.Fit, __: po.Fit, rung: Rung, ___: int) -> Rung:
        done.append(rung)
        return rung

    monkeypatch.setattr(pairs, "_finished", finish)
    monkeypatch.setattr(pairs, "judged", lambda *_: [])
    monkeypatch.setattr(choice, "noise_floor", lambda fit: SimpleNamespace(rms=fit.rms / left))
    monkeypatch.setattr(pairs, "_SAME", 2.0)
    assert pair(foot, foot, held, OFFERED, threads=2) is None
    assert len(done) == finished
    assert [r.fit.rms for r in done] == sorted(r.fit.rms for r in done)


def test_who_cannot_be_simulated_again_is_not_paired(monkeypatch: pytest.MonkeyPatch) -> None:
    """At the edge of stability other sub-steps may be none at all."""
    foot, held = below_resonance()

    def point(fit: po.Fit) -> BasePoint | None:
        if "creep" in fit.model:
            monkeypatch.setattr(module, "BasePoint", _unstable)
        made = base_point(fit)
        monkeypatch.setattr(module, "BasePoint", BasePoint)
        return made

    monkeypatch.setattr(pairs, "_SAME", 2.0)
    monkeypatch.setattr(pairs, "base_point", point)
    alone = pairs._alone(foot, held.question, OFFERED, (), 2)
    asked = pairs._promising(held.question, alone, 2)
    assert len(asked) == 10
    assert not any("creep" in trial.question.model for trial in asked)


def test_who_has_been_fitted_alone_is_not_fitted_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those that a ladder began afresh at its foot are what a search for pairs would fit first."""
    foot, held = below_resonance()
    suspects, _ = scored(foot, OFFERED, 2)
    fresh, _ = entrants(foot, held.question, suspects, 2)
    known = race(foot, fresh, 2)
    begun: list[po.Model] = []
    anew = pairs.starting_values

    def watched(question: po.Identification, *given: Any) -> Any:
        begun.append(question.model)
        return anew(question, *given)

    alone = pairs._alone(foot, held.question, OFFERED, (), 2)
    monkeypatch.setattr(pairs, "starting_values", watched)
    again = pairs._alone(foot, held.question, OFFERED, known, 2)
    assert known
    assert not {rung.fit.model for rung in known} & set(begun)
    assert len(begun) == len(alone) - len(known)
    # The same models, with what acts alone and the mechanics that it needs, as close or closer.
    told = {one.fit.model: one for one in again}
    assert set(told) == {one.fit.model for one in alone}
    for one in alone:
        other = told[one.fit.model]
        assert (other.effect, other.ground) == (one.effect, one.ground)
        assert other.fit.rms <= 1.001 * one.fit.rms
        assert other.trial.start == pytest.approx(one.trial.start, rel=1e-9)


def _unstable(_: po.Fit) -> BasePoint:
    raise ModelError("The simulation is not finite at these values.")


def test_a_pair_that_leaves_more_than_noise_is_not_believed() -> None:
    foot, held = below_resonance()
    others = [e for e in OFFERED if e.name != "charge_back_coupling"]
    assert pair(foot, foot, held, others, threads=2) is None


def test_a_pair_that_the_other_record_contradicts_is_not_believed() -> None:
    foot, held = below_resonance()
    time = clock(3000)
    # What is held out is of another plant: without the charge.
    other = measured(MOVING, time, chirp(time, 0.5, 90.0), BENT, seed=1, name="other plant")
    assert pair(foot, foot, hold_out(held.question, other), OFFERED, threads=2) is None


def test_a_ladder_that_ends_astray_is_climbed_two_effects_at_a_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    foot, held = below_resonance()
    told: list[str] = []
    # One after the other finds these two where the charge is heard without mechanics in the model.
    monkeypatch.setattr(shortlist, "moved", lambda _: None)
    ladder = climb(foot, held, [e for e in OFFERED if e.name in FEW], told.append)
    assert {step.name for step in ladder.steps} == {"charge_back_coupling", "nonlinear_gain"}
    assert "second_order" in ladder.refined
    assert ladder.final.rms == pytest.approx(NOISE, rel=0.03)
    # What stands in the ladder is no longer said to be out of sight.
    assert "charge_back_coupling" not in {one.name for one in ladder.unscored}
    assert "fitting two effects at a time" in told, told


def test_what_leads_a_stuck_search_out_is_not_named() -> None:
    """A second mode found in the wrong place leaves more than noise, and any effect leads on."""
    time = clock(3000)
    truth = SecondMode(), {"g": 0.3, "omega": 2.0 * np.pi * 110.0, "zeta": 0.02}
    model = MOVING + SecondMode()
    train = measured(MOVING, time, chirp(time, 0.5, 150.0), truth)
    right = po.solve(po.Identification(model, train), start={**TRUTH, **_named(truth)})
    question = po.Identification(model + AmplifierLag(), train)
    led = po.solve(question, start={**right.values, "amplifier_lag.share": 0.05})
    lag: Any = SimpleNamespace(name="amplifier_lag")
    rung = Rung(Trial(question, led.values, lag), led, 100.0)
    alone = _unaided(rung)
    assert alone is not None
    assert "amplifier_lag" not in alone.model
    assert alone.rms == pytest.approx(NOISE, rel=0.03)


def test_what_carries_its_share_is_no_mere_help() -> None:
    time = clock(3000)
    lag = AmplifierLag(), {"share": 1.0, "tau": 2e-3}
    train = measured(MOVING, time, chirp(time, 0.5, 90.0), lag)
    question = po.Identification(MOVING + AmplifierLag(), train)
    fit = po.solve(question, start={**TRUTH, **_named(lag)})
    name: Any = SimpleNamespace(name="amplifier_lag")
    assert _unaided(Rung(Trial(question, fit.values, name), fit, 100.0)) is None


def test_what_a_pair_does_not_need_is_dropped_at_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside its details one of the two may have nothing left to do."""
    time = clock(2000)
    creep = Creep(elements=1), {"c": 0.02, "tau": 0.1}
    train = measured(STILL, time, rich(time), creep)
    test = measured(STILL, time, rich(time)[::-1], creep, seed=1)
    question = po.Identification(STILL, train)
    foot = fitted(STILL, train)
    both = solved(
        question.with_model(STILL + Creep(elements=1) + Drift()),
        {**foot.values, **_named(creep), "drift.rate": 1e-10},
    )
    steps = [pairs._step(foot, both, name) for name in ("creep", "drift")]
    monkeypatch.setattr(climbing, "refits", lambda *_, **__: ([], []))
    monkeypatch.setattr(climbing, "astray", lambda *_, **__: True)
    monkeypatch.setattr(climbing._Climb, "afresh", lambda *_: None)
    monkeypatch.setattr(climbing, "pair", lambda *_, **__: (both, steps))
    climbed = climb(foot, hold_out(question, test), [Creep(elements=1), Drift()])
    assert [step.name for step in climbed.steps] == ["creep"]
    assert climbed.dropped == ("drift",)


def test_mechanics_join_a_quasi_static_model_only() -> None:
    """What a resonator without a loop lacks no second mechanics can bring."""
    assert [type(g) for g in pairs._grounds(STILL, Friction(), ())] == [SecondOrder, Spring]
    assert pairs._grounds(PiezoGain() + SecondOrder(), Asymmetry(), ()) == []
