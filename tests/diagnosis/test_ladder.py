"""The ladder takes what is true, and only with the consent of data that were not fitted."""

from __future__ import annotations

import threading
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.diagnosis import choice
from piezo_opt.diagnosis import ladder as module
from piezo_opt.diagnosis import prune as pruning
from piezo_opt.diagnosis.confirm import confirmed
from piezo_opt.diagnosis.held_out import HeldOut, agrees, error_on, hold_out, rms
from piezo_opt.diagnosis.ladder import Ladder, _of_base, climb
from piezo_opt.diagnosis.prune import prune
from piezo_opt.diagnosis.rung import Rung, Trial, bic_gain, solved
from piezo_opt.diagnosis.steps import Step
from piezo_opt.effects import (
    AmplifierLag,
    Asymmetry,
    Creep,
    Delay,
    Drift,
    Effect,
    Friction,
    MainsPickup,
    NonlinearGain,
    PiezoGain,
    RateDependence,
    SecondMode,
    SecondOrder,
    SensorLag,
    SensorNonlinearity,
)
from piezo_opt.errors import InputError
from piezo_opt.identification import LevenbergMarquardt
from tests.diagnosis.plants import (
    MOVING,
    NOISE,
    STILL,
    TRUTH,
    clock,
    fitted,
    measured,
    rich,
    sine,
    triangle,
)

CREEP = Creep(elements=1), {"c": 0.02, "tau": 0.1}
MODE = SecondMode(), {"g": 0.03, "omega": 2.0 * np.pi * 150.0, "zeta": 0.02}
FEW: list[Effect] = [Creep(elements=1), SecondMode(), Drift(), NonlinearGain(), Asymmetry()]


def climbed(
    base: po.Model, record: po.Measurement, candidates: list[Effect], test: po.Measurement | None
) -> tuple[Ladder, HeldOut]:
    held = hold_out(po.Identification(base, record), test)
    return climb(fitted(base, held.question.campaign.records[0]), held, candidates), held


@pytest.fixture(scope="module")
def two() -> tuple[Ladder, HeldOut]:
    """Creep and a second mode, both hidden; the last 30 % judge."""
    time = clock(3000)
    return climbed(MOVING, measured(MOVING, time, rich(time), CREEP, MODE), FEW, None)


def test_two_hidden_effects_are_found_and_kept(two: tuple[Ladder, HeldOut]) -> None:
    ladder, _ = two
    assert sorted(s.name for s in ladder.steps) == ["creep", "second_mode"]
    # While the mode was missing the record did not tell creep from it.
    assert [s.group for s in ladder.steps] == [(s.name,) for s in ladder.steps]
    assert ladder.dropped == ()
    assert ladder.refined == ()
    assert set(ladder.final.model.names) == {*MOVING.names, "creep", "second_mode"}
    values = ladder.final.values
    assert values["second_mode.omega"] == pytest.approx(MODE[1]["omega"], rel=0.01)
    assert values["second_mode.g"] == pytest.approx(MODE[1]["g"], rel=0.1)
    assert values["creep.c"] == pytest.approx(CREEP[1]["c"], rel=0.15)


def test_each_rung_is_the_next_ones_start(two: tuple[Ladder, HeldOut]) -> None:
    ladder, held = two
    first, second = ladder.steps
    assert first.rms_before == ladder.baseline.rms
    assert second.rms_before == first.rms_after == first.fit.rms
    assert second.held_out_before == first.held_out_after
    assert second.held_out_after == rms(error_on(ladder.final, held.record))
    assert second.rms_after == pytest.approx(NOISE, rel=0.03)
    assert second.held_out_after == pytest.approx(NOISE, rel=0.1)
    assert first.delta_bic > 10.0
    assert second.delta_bic > 10.0
    for step in (first, second):
        assert 0.0 < step.fit.std[f"{step.name}.{step.effect.gate}"] < 0.1


def test_bic_by_hand(two: tuple[Ladder, HeldOut]) -> None:
    """With white residuals: N ln(SSR0 / SSR1) - k ln N, k the unknowns that were added."""
    ladder, _ = two
    second = ladder.steps[1]
    before, after = ladder.steps[0].fit, second.fit
    n = after.residuals.size
    added = len(after.names) - len(before.names)
    fall = 2.0 * n * np.log(second.rms_before / second.rms_after) - added * np.log(n)
    assert bic_gain(before, after, float(n)) == pytest.approx(fall, rel=1e-9)
    assert bic_gain(before, after) == pytest.approx(fall, rel=0.1)
    assert bic_gain(after, before) < 0.0


def test_held_out_data_that_disagree_block_a_step() -> None:
    """Another actuator, without the effect, judges: what was fitted does not hold there."""
    time = clock(2000)
    train = measured(STILL, time, rich(time), CREEP, name="train")
    calm = measured(STILL, time, triangle(time, 2.0), seed=1, name="calm")
    alike = measured(STILL, time, triangle(time, 2.0), CREEP, seed=1, name="alike")
    candidates: list[Effect] = [Creep(elements=1)]
    refused, _ = climbed(STILL, train, candidates, calm)
    assert refused.suspects[0].p_value < 1e-3
    assert refused.steps == ()
    assert refused.final is refused.baseline
    accepted, _ = climbed(STILL, train, candidates, alike)
    assert [s.name for s in accepted.steps] == ["creep"]


def test_a_lag_on_a_sine_is_answered_by_its_group() -> None:
    time = clock(2000)
    hidden = AmplifierLag(), {"share": 1.0, "tau": 2e-3}
    lags: list[Effect] = [AmplifierLag(), Delay(), SensorLag(), Drift()]
    ladder, _ = climbed(MOVING, measured(MOVING, time, sine(time), hidden), lags, None)
    assert len(ladder.steps) == 1
    assert ladder.steps[0].group[0] == ladder.steps[0].name
    assert "amplifier_lag" in ladder.steps[0].group
    assert "drift" not in ladder.steps[0].group


def test_nothing_hidden_is_nothing_found() -> None:
    time = clock(2000)
    for seed in range(5):
        ladder, _ = climbed(STILL, measured(STILL, time, rich(time), seed=seed), FEW, None)
        assert ladder.steps == ()
        assert ladder.final is ladder.baseline


def test_another_roundness_of_the_loop_is_no_missing_effect() -> None:
    time = clock(2000)
    blank = po.Measurement(time, rich(time), rich(time), allow_saturated=True)
    values = {**fitted(STILL, measured(STILL, time, rich(time))).values, "bouc_wen.n": 1.6}
    reading = po.simulate(STILL, blank, {k: v for k, v in values.items() if "initial" not in k})
    noise = NOISE * np.random.default_rng(0).normal(size=time.size)
    record = blank.with_(position=reading.reading + noise)
    candidates: list[Effect] = [Asymmetry(), NonlinearGain(), RateDependence()]
    ladder, _ = climbed(STILL, record, candidates, None)
    assert ladder.refined == ("bouc_wen.n",)
    assert ladder.steps == ()
    assert ladder.final.values["bouc_wen.n"] == pytest.approx(1.6, rel=0.1)
    assert ladder.final.rms == pytest.approx(NOISE, rel=0.05)


def test_what_is_held_out() -> None:
    time = clock(2000)
    record = measured(STILL, time, rich(time))
    question = po.Identification(STILL, record)
    held = hold_out(question, None)
    assert held.record is not None
    assert int(held.record.counted.sum()) == 600
    assert len(held.question.campaign.records[0]) == 1400
    # Simulated through: the judging record begins where the whole record does.
    assert held.record.time[0] == 0.0
    other = measured(STILL, time, triangle(time, 1.0), name="other")
    assert hold_out(question, other).record is other
    assert hold_out(question, other).question is question
    both = hold_out(po.Identification(STILL, (record, other)), None)
    assert both.record is other
    assert both.question.campaign.names == ("record",)
    periodic = measured(STILL, time, triangle(time, 1.0)).with_(period=1.0)
    assert hold_out(po.Identification(STILL, periodic), None).record is None
    short = measured(STILL, clock(200), rich(clock(200)))
    assert hold_out(po.Identification(STILL, short), None).record is None


def test_errors_of_equal_size_seldom_agree() -> None:
    rng = np.random.default_rng(0)
    draws = [agrees(*rng.normal(size=(2, 600))) for _ in range(600)]
    assert np.mean(draws) == pytest.approx(0.025, abs=0.02)
    before = rng.normal(size=600)
    assert agrees(before, 0.9 * before)
    assert not agrees(0.9 * before, before)
    assert not agrees(before, np.full(600, np.nan))
    assert agrees(None, None)


def test_an_empty_catalogue_is_no_error() -> None:
    time = clock(1000)
    ladder, _ = climbed(STILL, measured(STILL, time, rich(time), CREEP), [], None)
    assert ladder.steps == ()
    with pytest.raises(InputError):
        hold_out(po.Identification(STILL, ()), None)


def test_an_interrupt_ends_the_ladder_and_not_only_its_refit(
    two: tuple[Ladder, HeldOut], monkeypatch: pytest.MonkeyPatch
) -> None:
    ladder, held = two

    def stopped(*_: object) -> object:
        raise KeyboardInterrupt

    monkeypatch.setattr(LevenbergMarquardt, "minimise", stopped)
    ended = climb(ladder.baseline, held, [Creep()], threads=1)
    assert ended.interrupted
    assert ended.steps == ()
    assert ended.final is ladder.baseline


TRUTH_STILL = {n: v for n, v in TRUTH.items() if n in STILL.parameters}


def crowded(*hidden: tuple[Effect, dict[str, float]]) -> po.Fit:
    """A fit with creep, a drift and a bent gain, to a record in which these are."""
    time = clock(1500)
    base = fitted(STILL, measured(STILL, time, rich(time), *hidden))
    model = STILL + Drift() + Creep(elements=1) + NonlinearGain()
    start = {"drift.rate": 1e-9, "creep.c": 0.02, "creep.tau": 0.1, "nonlinear_gain.k2": 1e-12}
    return solved(base.question.with_model(model), {**base.values, **start})


def step(fit: po.Fit, name: str, *group: str) -> Step:
    """A step of a ladder that ended at this fit."""
    effect = fit.model[name]
    return Step(name, effect, (name, *group), fit.rms, fit.rms, None, None, 20.0, 0.0, fit)


def alone(fit: po.Fit) -> HeldOut:
    """Nothing is held out: information criteria decide."""
    return HeldOut(po.Identification(STILL, fit.records), None, "")


def test_what_a_later_step_made_unnecessary_is_dropped() -> None:
    fit = crowded(CREEP)
    steps = [
        replace(step(fit, "drift"), rms_before=3.0, rms_after=2.0),
        replace(step(fit, "creep"), rms_before=2.0),
    ]
    pruned, kept, dropped = prune(fit, steps, alone(fit), 1)
    assert dropped == ["drift"]
    # What the first one won is now won by the second.
    assert [(s.name, s.rms_before, s.rms_after, s.delta_bic) for s in kept] == [
        ("creep", 3.0, pruned.rms, 40.0)
    ]
    assert pruned.model.names == (*STILL.names, "creep", "nonlinear_gain")
    assert pruned.rms == pytest.approx(NOISE, rel=0.05)
    drifting = crowded(CREEP, (Drift(), {"rate": 2e-8}))
    steps = [step(drifting, "drift"), step(drifting, "creep")]
    assert prune(drifting, steps, alone(drifting), 1) == (drifting, steps, [])
    # The last step was judged with all the others present: it is not asked again.
    steps = [step(fit, "creep"), step(fit, "drift")]
    assert prune(fit, steps, alone(fit), 1) == (fit, steps, [])


def test_two_steps_in_a_row_are_dropped() -> None:
    """The second one has become another object when the first one was dropped."""
    fit = crowded(CREEP)
    steps = [step(fit, name) for name in ("drift", "nonlinear_gain", "creep")]
    steps[0] = replace(steps[0], rms_before=3.0)
    pruned, kept, dropped = prune(fit, steps, alone(fit), 1)
    assert sorted(dropped) == ["drift", "nonlinear_gain"]
    assert [(s.name, s.rms_before, s.rms_after, s.delta_bic) for s in kept] == [
        ("creep", 3.0, pruned.rms, 60.0)
    ]
    assert pruned.model.names == (*STILL.names, "creep")


def test_mechanics_that_joined_may_leave_no_step_at_all() -> None:
    """A drift that was accepted together with mechanics is not needed beside them."""
    time = clock(1500)
    record = measured(MOVING, time, rich(time))
    fit = fitted(MOVING + Drift(), record)
    steps = [step(fit, "drift")]
    foot = HeldOut(po.Identification(STILL, record), None, "")
    pruned, kept, dropped = prune(fit, steps, foot, 1)
    assert (kept, dropped) == ([], ["drift"])
    assert pruned.rms == pytest.approx(NOISE, rel=0.05)


def test_what_was_taken_for_a_shape_may_be_the_effect_itself() -> None:
    """Creep was counted as the shape of a drift that explains nothing: the step is creep's."""
    fit = crowded(CREEP)
    steps = [step(fit, "drift", "sensor_lag", "creep")]
    pruned, kept, dropped = prune(fit, steps, alone(fit), 1)
    assert dropped == ["drift"]
    assert [(s.name, s.effect, s.group) for s in kept] == [
        ("creep", Creep(elements=1), ("creep", "drift", "sensor_lag"))
    ]
    assert kept[0].fit is pruned
    assert "drift" not in pruned.model
    # Where both are needed the shape stays one.
    both = crowded(CREEP, (Drift(), {"rate": 2e-8}))
    steps = [step(both, "drift", "creep")]
    assert prune(both, steps, alone(both), 1) == (both, steps, [])
    # A rival that the model does not have shapes nothing, nor does one with a step of its own.
    for rival in ("sensor_lag", "creep"):
        steps = [step(fit, "drift", rival), step(fit, "creep")]
        assert prune(fit, steps, alone(fit), 1)[2] == ["drift"]


def test_dropping_is_tried_from_fresh_starts_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """The base model begins anew, what was found keeps its values; no fit, nothing dropped."""
    fit = crowded(CREEP)
    seen: list[Trial] = []

    def nobody_arrives(_: po.Fit, trials: list[Trial], __: int, *, hope: float) -> list[Rung]:
        seen.extend(trials)
        # Beyond this nothing makes up for the effect.
        assert hope == 4.0 * fit.rms
        return []

    monkeypatch.setattr(pruning, "race", nobody_arrives)
    steps = [step(fit, "drift"), step(fit, "creep")]
    assert prune(fit, steps, alone(fit), 1) == (fit, steps, [])
    on, anew, *jointly = seen
    assert on.question.model == anew.question.model == fit.model.without("drift")
    assert on.start == fit.values
    for name, kept in (("creep.tau", True), ("bouc_wen.beta", False), ("bouc_wen.gamma", False)):
        assert (anew.start[name] == fit.values[name]) is kept
    # Once with each effect that is left: its shapes are searched together with the loop.
    assert len(jointly) == 2
    assert all(trial.question == anew.question for trial in jointly)


def test_a_held_out_record_of_something_else_does_not_veto() -> None:
    """It rings where the fitted one stood still: its error says nothing of a small effect."""
    random = np.random.default_rng(0)
    before = 50.0 * random.normal(size=4000)
    after = before + 7.0 * random.normal(size=4000)
    assert not agrees(before, after)
    assert not agrees(before, after, fitted=50.0)
    assert agrees(before, after, fitted=10.0)
    assert not agrees(before, 1.05 * after, fitted=10.0)


def test_what_is_lost_is_tried_afresh(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each candidate beside a base that begins where a first fit would, and only where lost."""
    fit = crowded(CREEP)
    begun: list[bool] = []
    tried = choice.entrants

    def counted(*given: Any) -> Any:
        begun.append(True)
        return tried(*given)

    monkeypatch.setattr(choice, "entrants", counted)
    question = po.Identification(STILL, fit.records)
    base = solved(question, TRUTH_STILL)
    climb(base, HeldOut(question, None, ""), [Creep(elements=1), Drift()], threads=1)
    assert not begun
    monkeypatch.setattr(choice, "_LOST", 0.0)
    monkeypatch.setattr(choice, "settled", lambda _: False)
    climb(base, HeldOut(question, None, ""), [Creep(elements=1), Drift()], threads=1)
    assert begun


@pytest.mark.parametrize("short", [True, False])
def test_who_was_left_behind_is_asked_afresh_where_a_ladder_ends_short_of_the_noise(
    short: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Once, from the foot, with every effect; what was named before is told as dropped."""
    fit = crowded(CREEP)
    question = po.Identification(STILL, fit.records)
    base = solved(question, TRUTH_STILL)
    drifting = solved(question.with_model(STILL + Drift()), base.values)
    wrong: Any = module._Stand(drifting, None, (), (step(drifting, "drift"),))
    told: list[str] = []
    found: Any = SimpleNamespace(suspect=True)
    choices = iter([(found, None, ())])
    monkeypatch.setattr(module._Climb, "choice", lambda _, at: (at, next(choices, None)))
    named = module._Climb.named

    def first_wrong(self: Any, at: Any, rung: Any, *rest: Any) -> Any:
        return wrong if isinstance(rung, SimpleNamespace) else named(self, at, rung, *rest)

    monkeypatch.setattr(module._Climb, "named", first_wrong)
    monkeypatch.setattr(module._Climb, "revised", lambda _, __, richer: richer)
    monkeypatch.setattr(module._Climb, "reconsidered", lambda _, at: at)
    monkeypatch.setattr(module._Climb, "lost", lambda *_, **__: False)
    if not short:
        monkeypatch.setattr(module, "short_of_noise", lambda *_, **__: False)
    else:
        assert choice.short_of_noise(drifting, HeldOut(question, None, ""), lone=True)
    ladder = climb(
        base, HeldOut(question, None, ""), [Creep(elements=1), Drift()], told.append, threads=2
    )
    assert [one.name for one in ladder.steps] == (["creep"] if short else ["drift"])
    assert told.count("refitting with every effect from a fresh start") == short
    assert ladder.dropped == (("drift",) if short else ())
    if short:
        assert ladder.final.rms == pytest.approx(NOISE, rel=0.05)
        assert ladder.steps[0].rms_before == base.rms
    if not short:
        return
    # Where nobody does better what stands stays; nor does it go for who misses the other record.
    held = hold_out(question, fit.records[0])
    way = module._Climb(base, ladder.suspects, held, [], told.append, 2)
    right = module._Stand(ladder.final, None, (), ladder.steps)
    assert way.afresh(right) is None
    poor = replace(right, fit=drifting, error=1e9 * np.ones(3))
    assert way.afresh(poor) is not None
    assert way.afresh(replace(poor, error=np.zeros(3))) is None


@pytest.mark.parametrize("named", [True, False])
def test_every_effect_is_asked_afresh_but_once(
    named: bool, two: tuple[Ladder, HeldOut], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A lone name is told from several, and from none."""
    ladder, held = two
    told: list[bool] = []
    asked: list[Any] = []

    def short(_: po.Fit, __: HeldOut, *, lone: bool) -> bool:
        told.append(lone)
        return True

    def afresh(_: Any, at: Any) -> Any:
        asked.append(at)
        return at

    one = module._Stand(ladder.final, None, (), ladder.steps[:1])
    choices = iter([(SimpleNamespace(suspect=True), None, ())] if named else [])
    monkeypatch.setattr(module, "scored", lambda *_: ((), ()))
    monkeypatch.setattr(module, "nothing_to_win", lambda _: False)
    monkeypatch.setattr(module, "short_of_noise", short)
    monkeypatch.setattr(module._Climb, "lost", lambda *_, **__: False)
    monkeypatch.setattr(module._Climb, "choice", lambda _, at: (at, next(choices, None)))
    monkeypatch.setattr(module._Climb, "named", lambda *_: one)
    monkeypatch.setattr(module._Climb, "revised", lambda _, __, richer: richer)
    monkeypatch.setattr(module._Climb, "reconsidered", lambda _, at: at)
    monkeypatch.setattr(module._Climb, "afresh", afresh)
    climb(ladder.baseline, held, [])
    assert told == [named, named]
    assert len(asked) == 1


@pytest.mark.parametrize(("many", "asked"), [(True, True), (False, False)])
def test_a_lone_law_with_much_freedom_is_always_asked_against_all_others(
    many: bool, asked: bool, two: tuple[Ladder, HeldOut], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It does what a simpler one does, and leaves but noise: a play had been a mount."""
    ladder, held = two
    begun: list[Any] = []
    first = ladder.steps[0]
    names = [f"{first.name}.{k}" for k in ("a", "b", "c", "d")[: 4 if many else 3]]
    fit: Any = SimpleNamespace(names=(*names, "other.e"))
    assert module._liberal(module._Stand(fit, None, (), (first,))) is many
    one = module._Stand(ladder.final, None, (), (first,))
    choices = iter([(SimpleNamespace(suspect=True), None, ())])
    monkeypatch.setattr(module, "scored", lambda *_: ((), ()))
    monkeypatch.setattr(module, "nothing_to_win", lambda _: True)
    monkeypatch.setattr(module, "short_of_noise", lambda *_, **__: False)
    monkeypatch.setattr(module, "_liberal", lambda _: many)
    monkeypatch.setattr(module._Climb, "lost", lambda *_, **__: False)
    monkeypatch.setattr(module._Climb, "choice", lambda _, at: (at, next(choices, None)))
    monkeypatch.setattr(module._Climb, "named", lambda *_: one)
    monkeypatch.setattr(module._Climb, "revised", lambda _, __, richer: richer)
    monkeypatch.setattr(module._Climb, "reconsidered", lambda _, at: at)
    monkeypatch.setattr(module._Climb, "grouped", lambda _, at: at)
    monkeypatch.setattr(module._Climb, "afresh", lambda _, at: begun.append(at))
    climb(ladder.baseline, held, [])
    assert bool(begun) is asked


def test_mechanics_that_a_name_makes_spare_are_told_as_dropped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fit = crowded(CREEP)
    question = po.Identification(STILL, fit.records)
    base = solved(question, TRUTH_STILL)
    moving = replace(base, question=question.with_model(STILL + SecondOrder()))
    creeping = solved(question.with_model(STILL + Creep(elements=1)), {**base.values})
    (suspect, *_), _ = module.scored(base, [Creep(elements=1)], 1)
    rung = Rung(Trial(creeping.question, {}, suspect), creeping, 100.0)
    monkeypatch.setattr(module, "lean", lambda _, rung, __: rung)
    told: list[str] = []
    way = module._Climb(moving, (suspect,), HeldOut(question, None, ""), [], told.append, 1)
    stand = way.named(module._Stand(moving, None, (suspect,)), rung, None, ("creep",))
    assert stand.dropped == ("second_order",)
    assert told == ["dropped second_order", "accepted creep"]


def test_two_steps_are_brought_to_their_detail_before_pairs_are_asked_for() -> None:
    """Mains that are not quite at 50 Hz beside creep are no case for other names."""
    time = clock(2000)
    mains = MainsPickup(), {"a": 4e-8, "phi": 0.3, "f": 50.2}
    fit = fitted(STILL, measured(STILL, time, rich(time), CREEP, mains))
    model = STILL + Creep(elements=1) + MainsPickup()
    start = {**fit.values, "creep.c": 0.02, "creep.tau": 0.1, "mains_pickup.a": 2e-8}
    both = solved(fit.question.with_model(model), start)
    assert both.rms > 2.0 * NOISE
    told: list[str] = []
    way = module._Climb(fit, (), alone(fit), [], told.append, 1)
    steps = (step(both, "creep"), step(both, "mains_pickup"))
    finer = way.detailed(module._Stand(both, None, (), steps))
    assert finer.fit.rms == pytest.approx(NOISE, rel=0.05)
    assert "mains_pickup.f" in finer.refined
    assert finer.steps[0] == steps[0]
    assert finer.steps[1].rms_after == finer.fit.rms
    assert told == [f"refined {', '.join(finer.refined)}"]
    assert way.detailed(finer) is finer
    # A model may bring mains of its own, and no step be there yet.
    unnamed = way.detailed(module._Stand(both, None, ()))
    assert unnamed.steps == ()
    assert unnamed.fit.rms == finer.fit.rms


def test_later_rounds_and_pairs_are_told_who_began_afresh_at_the_foot(
    two: tuple[Ladder, HeldOut], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside what was found nobody begins beside the model of the foot."""
    ladder, held = two
    known: list[Any] = []
    rounds = iter([([], ["alone"]), ([], []), ([], ["beside another"])])

    def refits(*_: Any, **given: Any) -> Any:
        known.append(given["known"])
        return next(rounds)

    monkeypatch.setattr(module, "refits", refits)
    monkeypatch.setattr(module, "pair", lambda *_, **given: known.append(given["known"]))
    way = module._Climb(ladder.baseline, (), held, [], lambda _: None, 1)
    at, _ = way.choice(module._Stand(ladder.baseline, None, ()))
    at, _ = way.choice(at)
    at, _ = way.choice(replace(at, steps=ladder.steps))
    assert way.together(at) is None
    assert known == [(), ("alone",), ("alone",), ("alone",)]


def test_details_come_before_pairs_and_pairs_are_asked_for_once(
    two: tuple[Ladder, HeldOut], monkeypatch: pytest.MonkeyPatch
) -> None:
    ladder, held = two
    order: list[str] = []
    found: Any = (SimpleNamespace(suspect=True), None, ())
    choices = iter([found, None])
    both = module._Stand(ladder.final, None, (), ladder.steps)

    def noted(name: str, answer: Any) -> Any:
        def asked(_: Any, at: Any, *__: Any) -> Any:
            order.append(name)
            return at if answer is ... else answer

        return asked

    monkeypatch.setattr(module, "scored", lambda *_: ((), ()))
    monkeypatch.setattr(module, "astray", lambda *_, **__: True)
    monkeypatch.setattr(module, "nothing_to_win", lambda _: False)
    monkeypatch.setattr(module, "shows_more", lambda _: True)
    monkeypatch.setattr(module._Climb, "choice", lambda _, at: (at, next(choices)))
    monkeypatch.setattr(module._Climb, "named", noted("named", both))
    monkeypatch.setattr(module._Climb, "revised", lambda _, __, richer: richer)
    monkeypatch.setattr(module._Climb, "detailed", noted("detailed", ...))
    monkeypatch.setattr(module._Climb, "together", noted("together", None))
    top = climb(ladder.baseline, held, [])
    assert order == ["named", "detailed", "together"]
    assert [step.name for step in top.steps] == [step.name for step in ladder.steps]


@pytest.mark.parametrize(
    ("helped", "asked"), [(True, ["choice", "afresh"]), (False, ["choice", "afresh", "together"])]
)
def test_where_nothing_was_found_one_effect_is_asked_afresh_before_pairs(
    two: tuple[Ladder, HeldOut], monkeypatch: pytest.MonkeyPatch, helped: bool, asked: list[str]
) -> None:
    """Pairs take several times as long, and each way is asked once."""
    ladder, held = two
    order: list[str] = []
    top = module._Stand(ladder.final, None, (), ladder.steps)

    def choice(_: Any, at: Any) -> Any:
        order.append("choice")
        return at, None

    def afresh(*_: Any) -> Any:
        order.append("afresh")
        return top if helped else None

    def together(*_: Any) -> None:
        order.append("together")

    monkeypatch.setattr(module, "scored", lambda *_: ((), ()))
    monkeypatch.setattr(module, "astray", lambda fit, *_, **__: fit is ladder.baseline)
    monkeypatch.setattr(module, "nothing_to_win", lambda fit: fit is ladder.final)
    monkeypatch.setattr(module, "short_of_noise", lambda fit, *_, **__: fit is ladder.baseline)
    monkeypatch.setattr(module, "shows_more", lambda _: True)
    for name, way in (("choice", choice), ("afresh", afresh), ("together", together)):
        monkeypatch.setattr(module._Climb, name, way)
    for name in ("reconsidered", "grouped", "detailed"):
        monkeypatch.setattr(module._Climb, name, lambda _, at: at)
    reached = climb(ladder.baseline, held, [])
    assert order == asked
    assert reached.final is (ladder.final if helped else ladder.baseline)


def named_at_once(monkeypatch: pytest.MonkeyPatch, ladder: Ladder) -> None:
    """A climb whose first choice leads to the top of a ladder, where only noise seems left."""
    choices = iter([(SimpleNamespace(suspect=True), None, ())])
    top = module._Stand(ladder.final, None, (), ladder.steps)
    monkeypatch.setattr(module, "scored", lambda *_: ((), ()))
    monkeypatch.setattr(module, "nothing_to_win", lambda _: True)
    monkeypatch.setattr(module._Climb, "choice", lambda _, at: (at, next(choices)))
    monkeypatch.setattr(module._Climb, "named", lambda *_: top)
    monkeypatch.setattr(module._Climb, "revised", lambda _, __, richer: richer)
    monkeypatch.setattr(module._Climb, "grouped", lambda _, at: at)


@pytest.mark.parametrize("periodic", [True, False])
def test_harmonics_of_what_repeats_are_asked_for_where_only_noise_seems_left(
    two: tuple[Ladder, HeldOut], monkeypatch: pytest.MonkeyPatch, periodic: bool
) -> None:
    """Crossed faster than it is sampled, a second harmonic is as good as white."""
    ladder, held = two
    asked: list[po.Fit] = []

    def detailed(_: Any, at: Any) -> Any:
        asked.append(at.fit)
        return at

    named_at_once(monkeypatch, ladder)
    monkeypatch.setattr(module, "astray", lambda *_, **__: False)
    monkeypatch.setattr(module, "_muted", lambda _: periodic)
    monkeypatch.setattr(module._Climb, "detailed", detailed)
    monkeypatch.setattr(module._Climb, "reconsidered", lambda _, at: at)
    climb(ladder.baseline, held, [])
    assert asked == ([ladder.final] if periodic else [])


def test_harmonics_are_missed_of_what_repeats_and_until_they_are_there() -> None:
    def fit(effect: SensorNonlinearity, *free: str) -> Any:
        free = tuple(f"sensor_nonlinearity.{name}" for name in free)
        return SimpleNamespace(model=PiezoGain() + effect, question=SimpleNamespace(free=free))

    assert module._muted(fit(SensorNonlinearity()))
    assert module._muted(fit(SensorNonlinearity(unknown=True), "s2"))
    assert not module._muted(fit(SensorNonlinearity(unknown=True), "s2", "c2"))
    assert not module._muted(fit(SensorNonlinearity(quadratic=True)))


@pytest.mark.parametrize(
    ("missed", "helped", "shown", "asked"),
    [
        (False, False, True, ["reconsidered"]),
        (True, False, True, ["reconsidered", "together"]),
        (True, False, False, ["reconsidered"]),
        (True, True, True, ["reconsidered"]),
    ],
)
def test_pairs_are_asked_for_where_two_leave_but_noise_and_miss_the_other_record(
    two: tuple[Ladder, HeldOut], monkeypatch: pytest.MonkeyPatch,
    missed: bool, helped: bool, shown: bool, asked: list[str],
) -> None:  # fmt: skip
    """Unless one of the two gives way to another one and both reach it then; each asked once.

    Nothing else is asked: there is nothing to be won where it is fitted; nor are pairs where that
    record shows no structure either, for which alone a pair is believed.
    """
    ladder, held = two
    order: list[str] = []

    def together(*_: Any) -> None:
        order.append("together")

    def reconsidered(_: Any, at: Any) -> Any:
        order.append("reconsidered")
        return replace(at, fit=ladder.baseline) if helped else at

    def astray(fit: po.Fit, *_: Any, several: bool) -> bool:
        return missed and several and fit is ladder.final

    named_at_once(monkeypatch, ladder)
    monkeypatch.setattr(module, "astray", astray)
    monkeypatch.setattr(module, "shows_more", lambda _: shown)
    monkeypatch.setattr(module._Climb, "together", together)
    monkeypatch.setattr(module._Climb, "reconsidered", reconsidered)
    climb(ladder.baseline, held, [])
    assert order == asked


@pytest.fixture
def exchanges(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """How steps were asked for their place; all of them keep it."""
    asked: list[dict[str, Any]] = []

    def exchange(*given: Any, **options: Any) -> Any:
        asked.append(options)
        return given[1], given[2], []

    monkeypatch.setattr(module, "exchange", exchange)
    return asked


@pytest.mark.parametrize(("quiet", "beyond"), [(True, 3), (False, 0)])
def test_where_only_noise_is_left_laws_with_much_freedom_are_asked_for_their_place(
    two: tuple[Ladder, HeldOut], exchanges: list[dict[str, Any]],
    monkeypatch: pytest.MonkeyPatch, quiet: bool, beyond: int,
) -> None:  # fmt: skip
    ladder, held = two
    monkeypatch.setattr(module, "nothing_to_win", lambda _: quiet)
    way = module._Climb(ladder.baseline, (), held, [], lambda _: None, 1)
    stand = module._Stand(ladder.final, None, (), ladder.steps)
    way.revised(stand, stand)
    assert [options["beyond"] for options in exchanges] == [beyond]


@pytest.mark.parametrize("spare", [False, True])
def test_places_are_asked_for_beside_the_pruning_and_again_where_that_drops_a_step(
    two: tuple[Ladder, HeldOut], monkeypatch: pytest.MonkeyPatch, spare: bool
) -> None:
    """Two threads ask at once; what comes of a place is what one after the other would."""
    ladder, held = two
    begun = threading.Event()
    asked: list[tuple[int, bool]] = []

    def exchange(*given: Any, last: bool, **_: Any) -> Any:
        asked.append((len(given[2]), last))
        begun.set()
        return given[1], given[2], [("here", f"of {len(given[2])}")]

    def prune(fit: po.Fit, steps: Any, *_: Any, **__: Any) -> Any:
        assert begun.wait(10.0)
        return (fit, list(steps[1:]), [steps[0].name]) if spare else (fit, list(steps), [])

    told: list[str] = []
    monkeypatch.setattr(module, "exchange", exchange)
    monkeypatch.setattr(module, "prune", prune)
    monkeypatch.setattr(module, "nothing_to_win", lambda _: False)
    way = module._Climb(ladder.baseline, (), held, [], told.append, 1)
    stand = module._Stand(ladder.final, None, (), ladder.steps)
    found = way.revised(replace(stand, steps=()), stand)
    assert asked == ([(2, False), (1, True)] if spare else [(2, False)])
    assert told[-1] == ("exchanged here for of 1" if spare else "exchanged here for of 2")
    assert len(found.steps) == (1 if spare else 2)


@pytest.mark.parametrize("gone", [False, True])
def test_scores_are_taken_beside_the_pruning_and_once_at_a_fit(
    two: tuple[Ladder, HeldOut], monkeypatch: pytest.MonkeyPatch, gone: bool
) -> None:
    ladder, held = two
    at: list[po.Fit] = []

    def noted(fit: po.Fit, *_: Any) -> Any:
        at.append(fit)
        return (SimpleNamespace(name="drift", p_value=1.0),), ()

    monkeypatch.setattr(module, "scored", noted)
    monkeypatch.setattr(module, "prune", lambda fit, steps, *_, **__: (fit, list(steps), []))
    monkeypatch.setattr(
        module, "exchange",
        lambda _, fit, steps, *__, **___: (
            ladder.baseline if gone else fit, steps, [("here", "there")] if gone else []
        ),
    )  # fmt: skip
    way = module._Climb(ladder.baseline, (), held, [], lambda _: None, 1)
    stand = module._Stand(ladder.final, None, (), ladder.steps)
    found = way.scored(way.revised(replace(stand, steps=()), stand))
    # Of another fit, in which a step gave way, they are taken anew.
    assert at == ([ladder.final, ladder.baseline] if gone else [ladder.final])
    assert [suspect.name for suspect in found.now] == ["drift"]
    assert way.scored(found) is found


@pytest.mark.parametrize(
    ("p_value", "score", "asked"), [(1e-9, 0.009, [0]), (1e-2, 0.009, []), (1e-9, 0.007, [])]
)
def test_steps_are_asked_again_where_an_effect_still_explains_what_is_left(
    two: tuple[Ladder, HeldOut], exchanges: list[dict[str, Any]],
    monkeypatch: pytest.MonkeyPatch, p_value: float, score: float, asked: list[int],
) -> None:  # fmt: skip
    """It may be too little for a name of its own, and what a step only imitates."""
    ladder, held = two
    scores = (SimpleNamespace(name="drift", p_value=p_value, score=score),)
    monkeypatch.setattr(module, "scored", lambda *_: (scores, ()))
    way = module._Climb(ladder.baseline, (), held, [], lambda _: None, 1)
    way.reconsidered(module._Stand(ladder.final, None, (), ladder.steps))
    assert [options.get("beyond", 0) for options in exchanges] == asked


@pytest.mark.parametrize(
    ("base", "steps", "last"), [(MOVING, 1, True), (MOVING, 2, False), (STILL, 2, True)]
)
def test_the_last_step_is_asked_again_where_it_is_alone_or_has_other_mechanics(
    two: tuple[Ladder, HeldOut], exchanges: list[dict[str, Any]],
    monkeypatch: pytest.MonkeyPatch, base: po.Model, steps: int, last: bool,
) -> None:  # fmt: skip
    """A lone one may stand for an effect that explained nothing at the foot: it is asked too."""
    ladder, held = two
    scores = (
        SimpleNamespace(name="drift", p_value=0.0, score=0.1),
        SimpleNamespace(name="delay", p_value=0.1, score=0.1),
    )  # fmt: skip
    monkeypatch.setattr(module, "scored", lambda *_: (scores, ()))
    foot: Any = SimpleNamespace(model=base)
    way = module._Climb(foot, (), held, [], lambda _: None, 1)
    way.reconsidered(module._Stand(ladder.final, None, (), ladder.steps[:steps]))
    assert [(options["last"], options["also"]) for options in exchanges] == [(last, {"drift"})]


@pytest.mark.parametrize(("steps", "asked"), [(2, [(True, set())]), (1, [])])
def test_each_of_several_is_asked_for_its_place_where_they_miss_the_other_record(
    two: tuple[Ladder, HeldOut], exchanges: list[dict[str, Any]],
    monkeypatch: pytest.MonkeyPatch, steps: int, asked: list[Any],
) -> None:  # fmt: skip
    """Also where nothing explains what is left: it may be but noise, the last one included."""
    ladder, held = two
    monkeypatch.setattr(module, "scored", lambda *_: ((), ()))
    monkeypatch.setattr(module, "astray", lambda *_, several: several)
    way = module._Climb(ladder.baseline, (), held, [], lambda _: None, 1)
    way.reconsidered(module._Stand(ladder.final, None, (), ladder.steps[:steps]))
    assert [(options["last"], options["also"]) for options in exchanges] == asked


@pytest.mark.parametrize(
    ("missed", "steps", "asked"), [(True, 2, [(False, {"kin"})]), (False, 2, []), (True, 1, [])]
)
def test_who_was_in_a_group_is_asked_where_several_predict_worse_than_they_fit(
    two: tuple[Ladder, HeldOut], exchanges: list[dict[str, Any]],
    monkeypatch: pytest.MonkeyPatch, missed: bool, steps: int, asked: list[Any],
) -> None:  # fmt: skip
    """Friction beside a lag left 1.003 noises here and 1.9 there, a mount 0.999 and 1.1."""
    ladder, held = two
    monkeypatch.setattr(module, "scored", lambda *_: ((), ()))
    monkeypatch.setattr(module, "astray", lambda *_, **__: False)
    monkeypatch.setattr(module, "misjudged", lambda _, by: missed and by is held)
    way = module._Climb(ladder.baseline, (), held, [], lambda _: None, 1)
    first, *later = ladder.steps[:steps]
    grouped = (replace(first, group=(first.name, "kin")), *later)
    way.reconsidered(module._Stand(ladder.final, None, (), grouped))
    assert [(options["last"], options["also"]) for options in exchanges] == asked


@pytest.mark.parametrize("quiet", [True, False])
def test_steps_are_asked_again_at_the_end(
    two: tuple[Ladder, HeldOut], monkeypatch: pytest.MonkeyPatch, quiet: bool
) -> None:
    """Whether or not anything is left to win."""
    ladder, held = two
    seen: list[Any] = []
    taken: Any = (SimpleNamespace(suspect=True), None, ())
    choices = iter([taken, None])
    both = module._Stand(ladder.final, None, (), ladder.steps)

    def reconsidered(_: Any, at: Any) -> Any:
        seen.append(at)
        return at

    monkeypatch.setattr(module, "scored", lambda *_: ((), ()))
    monkeypatch.setattr(module, "astray", lambda *_, **__: False)
    monkeypatch.setattr(module, "nothing_to_win", lambda _: quiet)
    monkeypatch.setattr(module._Climb, "choice", lambda _, at: (at, next(choices)))
    monkeypatch.setattr(module._Climb, "named", lambda *_: both)
    monkeypatch.setattr(module._Climb, "revised", lambda _, __, richer: richer)
    monkeypatch.setattr(module._Climb, "grouped", lambda _, at: at)
    monkeypatch.setattr(module._Climb, "reconsidered", reconsidered)
    climb(ladder.baseline, held, [])
    assert len(seen) == 1


def test_what_joined_beside_an_effect_is_told() -> None:
    """Mechanics that came along with a lag, and the loop's exponent, are no effects."""
    fit = crowded(CREEP)
    model = fit.model + SecondOrder()
    question = replace(fit.question.with_model(model), free=("bouc_wen.n", "creep.power"))
    richer = solved(question, {**fit.values, "second_order.omega": 3e2}, 1)
    assert _of_base(fit, richer) == ["second_order", "bouc_wen.n"]
    assert _of_base(richer, richer) == []


def test_a_look_alike_that_halves_the_error_is_an_effect_of_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A creep beside a lag is no shape of the lag, however alike they look at the foot."""
    time = clock(2000)
    hidden = (AmplifierLag(), {"share": 1.0, "tau": 4e-3}), CREEP
    record = measured(STILL, time, rich(time), *hidden)
    test = measured(STILL, time, triangle(time, 1.3), *hidden, seed=3)
    monkeypatch.setattr(module, "_sibling", lambda _, steps, __: 0 if steps else None)
    candidates: list[Effect] = [AmplifierLag(), Creep(elements=1)]
    apart, _ = climbed(STILL, record, candidates, test)
    assert [s.name for s in apart.steps] == ["amplifier_lag", "creep"]
    assert apart.steps[1].rms_after < 0.6 * apart.steps[1].rms_before
    monkeypatch.setattr(module, "_SHAPING", 0.0)
    merged, _ = climbed(STILL, record, candidates, test)
    assert [s.name for s in merged.steps] == ["amplifier_lag"]
    assert "creep" in merged.steps[0].group
    assert "creep" in merged.final.model
    assert merged.final.rms == pytest.approx(apart.final.rms, rel=1e-3)


def test_another_record_confirms_beside_a_base_that_may_follow_it() -> None:
    """Triangles hardly shake the resonance: their fit misses a chirp by it, with and without."""
    time = clock(3000)
    bent = NonlinearGain(), {"k2": 1.5e-10}
    train = measured(MOVING, time, triangle(time, 1.0), bent)
    chirp = 30.0 + 25.0 * np.sin(2.0 * np.pi * (2.0 * time + 15.0 * time**2))
    foot = fitted(MOVING, train)
    richer = solved(
        po.Identification(MOVING + NonlinearGain(), train),
        {**foot.values, "nonlinear_gain.k2": 1e-10},
    )
    # As if the resonance were known a little worse than it is.
    off = replace(richer, values=po.Values({**richer.values, "second_order.omega": 370.0}))
    assert rms(error_on(off, measured(MOVING, time, chirp, bent))) > 10.0 * NOISE
    judge = measured(MOVING, time, chirp, bent, seed=1)
    alike = hold_out(po.Identification(MOVING, train), judge)
    # The effect's own values are those that were found, and what leaves more than noise waits.
    tripled = {**off.values, "nonlinear_gain.k2": 3.0 * off.values["nonlinear_gain.k2"]}
    assert not confirmed(foot, replace(off, values=po.Values(tripled)), alike)
    slow = 3e-8 * np.sin(2.0 * np.pi * 3.0 * time)
    assert not confirmed(foot, replace(off, readings=(off.readings[0] + slow,)), alike)
    for hidden, expected in ((bent,), True), ((), False):
        other = measured(MOVING, time, chirp, *hidden, seed=1)
        held = hold_out(po.Identification(MOVING, train), other)
        assert confirmed(foot, off, held) == expected
    # Nor is confirmed what leaves more than noise, or what the record cannot show.
    assert not confirmed(foot, foot, held)
    blind = measured(MOVING, time, 0.05 * chirp, bent, seed=1)
    assert not confirmed(foot, off, hold_out(po.Identification(MOVING, train), blind))
    assert not confirmed(foot, off, replace(held, record=None))


def test_a_warm_up_that_runs_out_within_the_record_is_a_drift() -> None:
    """A cubic leaves half as much again as the noise: lags were named beside it."""
    time = clock(3000)
    warm = Drift(settling=True), {"rate": -8e-7, "tau": 0.4}
    record = measured(STILL, time, rich(time), warm)
    base = fitted(STILL, record)
    forms: list[Effect] = [Drift(**options) for options in Drift.variants]
    offered = [*forms, Creep(), Creep(elements=1), SensorLag(), AmplifierLag(), RateDependence()]
    ladder = climb(base, hold_out(base.question, None), offered)
    assert [step.effect for step in ladder.steps] == [Drift(settling=True)]
    assert ladder.final.values["drift.tau"] == pytest.approx(0.4, rel=0.1)
    assert ladder.final.rms == pytest.approx(NOISE, rel=0.05)


def test_what_was_scored_in_one_form_is_not_called_unscored() -> None:
    """Without a velocity smooth friction has no place; friction with presliding has."""
    time = clock()
    base = fitted(STILL, measured(STILL, time, rich(time)))
    offered: list[Effect] = [Friction(**options) for options in Friction.variants]
    assert offered == [Friction(), Friction(smooth=True)]
    both = climb(base, hold_out(base.question, None), offered)
    assert {suspect.name for suspect in both.suspects} == {"friction"}
    assert both.unscored == ()
    alone = climb(base, hold_out(base.question, None), offered[1:])
    (unscored,) = alone.unscored
    assert "depends on the velocity itself" in unscored.why


def test_a_step_ends_in_the_form_that_the_ladder_ended_with(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What a user adds by `best()` is what was fitted, not what had been scored."""
    monkeypatch.setattr(module, "with_statistics", lambda fit: fit)
    top: Any = SimpleNamespace(model=STILL + Drift(wandering=True))
    for name, form in (("drift", Drift(wandering=True)), ("creep", Drift())):
        step = Step(name, Drift(), (name,), 1.0, 0.5, None, None, 1.0, 0.0, top)
        assert module._as_it_ended(step, top).effect == form
