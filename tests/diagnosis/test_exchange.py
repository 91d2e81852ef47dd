"""What was found first gives way to who does better beside what was found later."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.diagnosis import exchange as module
from piezo_opt.diagnosis.exchange import exchange, regrouped
from piezo_opt.diagnosis.held_out import HeldOut, error_on, hold_out, rms
from piezo_opt.diagnosis.rung import STRONG, Rung, Trial, bic_gain, solved
from piezo_opt.diagnosis.steps import Step
from piezo_opt.effects import (
    AmplifierLag,
    Asymmetry,
    Creep,
    Effect,
    Friction,
    HystereticForce,
    NonlinearGain,
    RateDependence,
    SecondMode,
    SensorLag,
    SensorNonlinearity,
)
from tests.diagnosis.plants import MOVING, TRUTH, clock, measured, rich, triangle

FORGETS = RateDependence(), {"r": 4.0}
SCALE = SensorNonlinearity(quadratic=True)
BENT = SCALE, {"curvature": -6e3}
OFFERED: list[Effect] = [
    RateDependence(), Creep(elements=1), AmplifierLag(), NonlinearGain(), SCALE,
]  # fmt: skip


@pytest.fixture(scope="module")
def records() -> tuple[po.Measurement, po.Measurement]:
    time = clock(3000)
    train = measured(MOVING, time, rich(time), FORGETS, BENT, noise=1e-8)
    test = measured(MOVING, time, triangle(time, 0.9), FORGETS, BENT, noise=1e-8, seed=1)
    return train, test


def climbed(
    record: po.Measurement, test: po.Measurement, *effects: Effect
) -> tuple[po.Fit, po.Fit, list[Step], HeldOut]:
    """Fits without and with these effects, and the steps from one to the other."""
    model, steps = MOVING, []
    foot = fit = po.solve(po.Identification(model, record), start=TRUTH)
    for effect in effects:
        model = model + effect
        richer = po.solve(po.Identification(model, record), start={**fit.values})
        after = rms(error_on(richer, test))
        steps.append(
            Step(effect.name, effect, (effect.name, "other"), fit.rms, richer.rms,
                 rms(error_on(fit, test)), after, 100.0, 1e-9, richer)
        )  # fmt: skip
        fit = richer
    return foot, fit, steps, hold_out(po.Identification(MOVING, record), test)


def test_an_earlier_step_gives_way_beside_a_later_one(
    records: tuple[po.Measurement, po.Measurement],
) -> None:
    foot, fit, steps, held = climbed(*records, Creep(elements=1), SCALE)
    better, now, gone = exchange(foot, fit, steps, held, OFFERED, threads=2)
    assert gone == [("creep", "rate_dependence")]
    assert [step.name for step in now] == ["rate_dependence", "sensor_nonlinearity"]
    assert better.model.names[-2:] == ("sensor_nonlinearity", "rate_dependence")
    assert bic_gain(fit, better) > STRONG
    assert better.rms == pytest.approx(1e-8, rel=0.03)
    assert now[0].group[0] == "rate_dependence"
    assert "other" not in now[0].group
    # What the ladder says at its top is the new fit.
    assert now[-1].fit is better
    assert now[-1].rms_after == better.rms
    assert now[-1].held_out_after == rms(error_on(better, records[1]))
    # And every rung below it is told with the effect that it has now.
    assert now[0].rms_before == foot.rms
    assert now[1].rms_before == now[0].rms_after == now[0].fit.rms
    assert now[0].fit.model.names[-1] == "rate_dependence"
    assert "sensor_nonlinearity" not in now[0].fit.model
    assert now[0].rms_after < 0.9 * foot.rms
    assert now[1].delta_bic == bic_gain(now[0].fit, better)


def test_whoever_explains_far_more_alone_comes_first(
    records: tuple[po.Measurement, po.Measurement],
) -> None:
    """A step that took another one's place may be the smaller of two."""
    foot, fit, steps, held = climbed(*records, SCALE, RateDependence())
    left = [
        solved(fit.question.with_model(MOVING + step.effect), fit.values).rms for step in steps
    ]  # fmt: skip
    assert left[1] < module._AHEAD * left[0]
    now = module._in_order(foot, fit, steps, held, 2)
    assert [step.name for step in now] == ["rate_dependence", "sensor_nonlinearity"]
    assert now[0].rms_before == foot.rms
    assert now[0].rms_after == pytest.approx(left[1], rel=1e-3)
    assert now[1].rms_before == now[0].rms_after
    assert now[1].fit is fit
    assert [step.group for step in now] == [step.group for step in reversed(steps)]
    # In that order they stay as they are.
    assert module._in_order(foot, fit, now, held, 2) == now


def test_an_effect_may_give_way_to_itself_in_another_form() -> None:
    """And is preferred to a look-alike that does as well: a slow share of the reading."""
    time = clock(4000)
    one = Creep(elements=1), {"c": 0.02, "tau": 0.1}
    mode = SecondMode(), {"g": 0.03, "omega": 2.0 * np.pi * 150.0, "zeta": 0.02}
    shaken = triangle(time, 0.7) + 5.0 * np.sin(2.0 * np.pi * 40.0 * time) ** 2
    train = measured(MOVING, time, rich(time), one, mode)
    test = measured(MOVING, time, shaken, one, mode, seed=1)
    foot, fit, steps, held = climbed(train, test, Creep(elements=3), SecondMode())
    offered: list[Effect] = [SensorLag(), Creep(elements=1), SecondMode()]
    better, now, gone = exchange(foot, fit, steps, held, offered, threads=2)
    assert gone == [("creep", "creep")]
    assert now[0].effect == Creep(elements=1)
    assert now[0].group == ("creep", "sensor_lag")
    assert bic_gain(fit, better) > STRONG
    assert better.values["creep.tau"] == pytest.approx(0.1, rel=0.15)


def test_a_group_is_told_beside_what_was_found_later() -> None:
    """Before, all of them missed by as much; a slow share of the reading is creep until the end."""
    time = clock(4000)
    one = Creep(elements=1), {"c": 0.02, "tau": 0.1}
    mode = SecondMode(), {"g": 0.03, "omega": 2.0 * np.pi * 150.0, "zeta": 0.02}
    train = measured(MOVING, time, rich(time), one, mode)
    foot, fit, steps, _ = climbed(train, train, Creep(elements=1), SecondMode())
    wide = ("creep", "second_mode", "sensor_lag", "rate_dependence")
    first = replace(steps[0], group=wide)
    offered: list[Effect] = [*OFFERED, SensorLag(), SecondMode()]
    now = regrouped(foot, fit, [first, steps[1]], offered, threads=2)
    assert [s.group for s in now] == [("creep", "sensor_lag"), steps[1].group]
    assert now[0].fit is first.fit
    # A group of one was never in doubt, and the last step was judged beside all the others.
    alone = [replace(first, group=("creep",)), replace(steps[1], group=wide)]
    assert regrouped(foot, fit, alone, offered, threads=2) == alone


def test_what_is_right_stays(records: tuple[po.Measurement, po.Measurement]) -> None:
    foot, fit, steps, held = climbed(*records, RateDependence(), SCALE)
    same, now, gone = exchange(foot, fit, steps, held, OFFERED, threads=2, last=True)
    assert (gone, now) == ([], steps)
    assert same is fit


@pytest.mark.parametrize(
    ("last", "gives_way", "to", "expected"),
    [
        (False, "", "", ["first", "second"]),
        (True, "", "", ["first", "second", "third"]),
        (False, "second", "other", ["first", "second", "third"]),
        (False, "second", "second", ["first", "second"]),
    ],
)
def test_the_last_step_is_asked_only_where_it_was_judged_beside_something_else(
    last: bool, gives_way: str, to: str, expected: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another effect is something else; the same one in another form is not."""
    asked: list[str] = []

    def rival(_: object, step: Any, *__: object) -> Any:
        asked.append(step.name)
        if step.name != gives_way:
            return None
        other = SimpleNamespace(name=to, effect=None, p_value=0.0)
        return SimpleNamespace(fit=nothing, suspect=other)

    def in_order(_: object, __: object, steps: Any, *___: object) -> Any:
        ordered.append(steps)
        return steps

    ordered: list[Any] = []
    seen = SimpleNamespace(poorer=None, ranked=(), suspects=(), shaped=True)
    monkeypatch.setattr(module, "_seen", lambda *_: seen)
    monkeypatch.setattr(module, "_rival", rival)
    monkeypatch.setattr(module, "_against_details", lambda _, __, ___, found, *____: found)
    monkeypatch.setattr(module, "group_of", lambda *_: ())
    monkeypatch.setattr(module, "elsewhere", lambda *_: None)
    monkeypatch.setattr(module, "_retold", lambda _, __, steps, *___: steps)
    monkeypatch.setattr(module, "_in_order", in_order)
    monkeypatch.setattr(module, "replace", lambda step, **_: step)
    steps: Any = [SimpleNamespace(name=name) for name in ("first", "second", "third")]
    nothing: Any = SimpleNamespace(record=None, names=("first.a", "second.a", "third.a"))
    _, _, gone = exchange(nothing, nothing, steps, nothing, (), threads=1, last=last)
    assert (asked, gone) == (expected, [(gives_way, to)] if gives_way else [])
    assert len(ordered) == (to == "other")


def test_only_those_with_more_parameters_than_asked_for_give_way(
    records: tuple[po.Measurement, po.Measurement], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Creep of one element has two parameters."""
    foot, fit, steps, held = climbed(*records, Creep(elements=1), SCALE)
    monkeypatch.setattr(module, "_seen", lambda *_: pytest.fail("asked"))
    exchange(foot, fit, steps, held, OFFERED, threads=2, beyond=2)
    with pytest.raises(pytest.fail.Exception):
        exchange(foot, fit, steps, held, OFFERED, threads=2, beyond=1)


def test_a_rival_begins_beside_the_others_as_they_were(
    records: tuple[po.Measurement, po.Measurement], monkeypatch: pytest.MonkeyPatch
) -> None:
    foot, fit, steps, held = climbed(*records, Creep(elements=1), SCALE)
    tried: list[Trial] = []

    def race(_: po.Fit, trials: list[Trial], __: int, standing: po.Fit) -> list[Trial]:
        assert standing is fit
        tried.extend(trials)
        return []

    monkeypatch.setattr(module, "race", race)
    monkeypatch.setattr(module, "judged", lambda *_: [])
    exchange(foot, fit, steps, held, OFFERED, threads=2)
    assert tried
    others = [k for k in fit.names if not k.startswith(("creep", "initial"))]
    assert "sensor_nonlinearity.curvature" in others
    for trial in tried:
        assert trial.suspect is not None
        assert {k: trial.start[k] for k in others} == {k: fit.values[k] for k in others}
        # Beside them as they are without the step it was scored, and has its size from there.
        scored = trial.suspect.base.values
        assert any(scored[k] != fit.values[k] for k in others)
        effect = trial.suspect.effect
        size = float(np.clip(trial.suspect.size, *effect.parameters[effect.gate or ""].bounds))
        assert trial.start[f"{trial.question.model.names[-1]}.{effect.gate}"] == size


@pytest.mark.parametrize("also", [(), ("nonlinear_gain",)])
def test_who_still_explains_a_part_at_the_end_is_fitted_in_each_place(
    records: tuple[po.Measurement, po.Measurement],
    also: tuple[str, ...],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Whatever its scores there: beside what a step only imitated it may explain nothing."""
    foot, fit, steps, _ = climbed(*records, Creep(elements=1), SCALE)
    tried: list[str] = []

    def race(_: po.Fit, trials: list[Trial], __: int, **___: po.Fit) -> list[Rung]:
        tried.extend(t.suspect.name for t in trials if t.suspect)
        return []

    monkeypatch.setattr(module, "race", race)
    monkeypatch.setattr(module, "judged", lambda *_: [])
    monkeypatch.setattr(module, "shortlist", lambda *_: [])
    module._seen(foot, fit, steps[0], OFFERED, 2, also)
    assert set(tried) == {"creep", *also}


@pytest.mark.parametrize(("gain", "gives_way"), [(0.99 * STRONG, False), (1.01 * STRONG, True)])
def test_only_strong_evidence_takes_a_place(
    records: tuple[po.Measurement, po.Measurement],
    gain: float,
    gives_way: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    foot, fit, steps, held = climbed(*records, Creep(elements=1), SCALE)
    monkeypatch.setattr(module, "bic_gain", lambda *_: gain)
    _, _, gone = exchange(foot, fit, steps, held, OFFERED, threads=2)
    assert bool(gone) == gives_way


@pytest.mark.parametrize(("error", "gives_way"), [(1.01, False), (0.99, True), (np.inf, False)])
def test_the_held_out_record_has_a_veto(
    records: tuple[po.Measurement, po.Measurement],
    error: float,
    gives_way: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A rival that predicts worse does not take a place, however well it fits."""
    foot, fit, steps, held = climbed(*records, Creep(elements=1), SCALE)
    monkeypatch.setattr(
        module, "elsewhere", lambda of, _: np.full(9, 1.0 if "creep" in of.model else error)
    )
    _, _, gone = exchange(foot, fit, steps, held, OFFERED, threads=2)
    assert bool(gone) == gives_way
    monkeypatch.setattr(module, "elsewhere", lambda *_: None)
    _, _, gone = exchange(foot, fit, steps, replace(held, record=None), OFFERED, threads=2)
    assert gone


@pytest.mark.parametrize(("error", "gives_way"), [(1.01, False), (0.99, True)])
def test_a_rival_that_predicts_worse_is_asked_again_in_detail(
    error: float, gives_way: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What another step still lacks in detail had kept the right one from its place."""
    standing, rival, finer = (SimpleNamespace(rms=1.0, held=h) for h in (1.0, 2.0, error))
    suspect: Any = SimpleNamespace(name="creep")
    rung = Rung(Trial(None, {}, suspect), rival, 50.0)  # type: ignore[arg-type]
    seen: Any = SimpleNamespace(ranked=[rung], poorer=None)
    monkeypatch.setattr(module, "bic_gain", lambda *_: 2.0 * STRONG)
    monkeypatch.setattr(module, "elsewhere", lambda of, _: np.full(4, of.held))
    monkeypatch.setattr(module, "in_detail", lambda of, _: finer if of is rival else of)
    which: Any = SimpleNamespace(name="drift")
    found = module._rival(standing, which, seen, None, 1)  # type: ignore[arg-type]
    assert (found is not None) is gives_way
    if found is not None:
        assert (found.fit, found.suspect, found.delta_bic) == (finer, suspect, 2.0 * STRONG)


@pytest.mark.parametrize(
    ("name", "error", "number", "evidence", "there", "stays"),
    [
        ("mount", 0.99, 5, 1.01 * STRONG, 1.0, True),
        ("friction", 0.99, 5, 1.01 * STRONG, 1.0, False),  # it is the step itself
        ("mount", 0.94, 5, 1.01 * STRONG, 1.0, False),  # it does far better
        ("mount", 0.99, 4, 1.01 * STRONG, 1.0, False),  # with as few parameters
        ("mount", 0.99, 5, 0.99 * STRONG, 1.0, False),  # details do hardly better
        ("mount", 0.99, 5, 1.01 * STRONG, 1.01, False),  # and miss the other record
    ],
)
def test_a_law_with_more_parameters_is_compared_with_a_step_in_its_details(
    name: str, error: float, number: int, evidence: float, there: float, stays: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """A friction with a Stribeck term was a mount, which does what that does nearly as well."""
    standing = SimpleNamespace(rms=1.0, held=1.0, numbers=4)
    finer, poorer = SimpleNamespace(rms=0.98, held=there), SimpleNamespace()
    richer = SimpleNamespace(rms=error, held=0.9, numbers=number)
    suspects: Any = [SimpleNamespace(name="friction"), SimpleNamespace(name=name)]
    own, rival = (
        Rung(Trial(None, {}, suspect), fit, 50.0)  # type: ignore[arg-type]
        for suspect, fit in zip(suspects, (standing, richer), strict=True)
    )

    def gain(before: Any, after: Any) -> float:
        assert after is finer
        return evidence if before is richer else 70.0

    monkeypatch.setattr(module, "_standing", lambda *_: own)
    monkeypatch.setattr(module, "numbers", lambda of: of.numbers)
    monkeypatch.setattr(module, "bic_gain", gain)
    monkeypatch.setattr(module, "elsewhere", lambda of, _: np.full(4, of.held))
    monkeypatch.setattr(module, "in_detail", lambda of, _: finer if of is standing else None)
    step, seen = SimpleNamespace(name="friction"), SimpleNamespace(poorer=poorer)
    given: Any = (standing, step, seen, rival, None, 1)
    found = module._against_details(*given)
    expected = (finer, suspects[0], 70.0) if stays else (richer, suspects[1], 50.0)
    assert (found.fit, found.suspect, found.delta_bic) == expected


@pytest.mark.parametrize(("leaves_noise", "asked"), [(False, True), (True, False)])
def test_details_are_asked_for_where_who_explains_is_refused(
    records: tuple[po.Measurement, po.Measurement],
    leaves_noise: bool,
    asked: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A rival leaves but noise and the other record is against it: a detail may be missing."""
    foot, fit, steps, held = climbed(*records, Creep(elements=1), SCALE)
    seen: list[int] = []
    in_shape = module._in_shape
    monkeypatch.setattr(
        module, "explained", lambda of: leaves_noise if of is fit else "creep" not in of.model
    )
    monkeypatch.setattr(
        module, "elsewhere", lambda of, _: np.full(9, 1.0 if "creep" in of.model else 1.01)
    )
    monkeypatch.setattr(
        module, "_in_shape", lambda was, threads: seen.append(1) or in_shape(was, threads)
    )
    exchange(foot, fit, steps, held, OFFERED, threads=2)
    assert bool(seen) is asked


def test_rivals_are_compared_in_the_details_of_their_shapes() -> None:
    """A mount has more freedom than friction without its Stribeck level, and less than with it."""
    time = clock(4000)
    contact = {"F": 0.05, "z0": 4e-7, "stribeck": 1.4, "w_s": 1e-4, "tau": 1e-3}
    train = measured(MOVING, time, rich(time), (Friction(), contact))
    test = measured(MOVING, time, triangle(time, 0.9), (Friction(), contact), seed=1)
    foot, fit, steps, held = climbed(train, test, HystereticForce())
    offered: list[Effect] = [HystereticForce(), Friction()]
    better, now, gone = exchange(foot, fit, steps, held, offered, threads=2, last=True)
    assert gone == [("hysteretic_force", "friction")]
    assert [step.name for step in now] == ["friction"]
    assert better.rms == pytest.approx(5e-9, rel=0.03)
    assert "friction.stribeck" in better.names


def test_rivals_of_a_step_with_details_are_compared_in_theirs() -> None:
    """A loop whose width bends is noise but for its last few percent; the gain has a cube."""
    time = clock(4000)
    gain = NonlinearGain(), {"k2": 3e-10, "ratio": -4e-3}
    mode = SecondMode(), {"g": 0.03, "omega": 2.0 * np.pi * 150.0, "zeta": 0.02}
    train = measured(MOVING, time, rich(time), gain, mode, noise=1.5e-8)
    test = measured(MOVING, time, triangle(time, 0.9), gain, mode, noise=1.5e-8, seed=1)
    question = po.Identification(MOVING + Asymmetry() + SecondMode(), train)
    plain = po.solve(question, start=TRUTH)
    fit = po.solve(replace(question, free=("asymmetry.bend",)), start=plain)
    assert fit.rms == pytest.approx(1.03 * 1.5e-8, rel=0.01)
    foot, _, steps, held = climbed(train, test, Asymmetry(), SecondMode())
    offered: list[Effect] = [Asymmetry(), NonlinearGain(), SecondMode()]
    better, now, gone = exchange(foot, fit, steps, held, offered, threads=2)
    assert gone == [("asymmetry", "nonlinear_gain")]
    assert [step.name for step in now] == ["nonlinear_gain", "second_mode"]
    assert better.rms == pytest.approx(1.5e-8, rel=0.01)
    assert "nonlinear_gain.ratio" in better.question.free


@pytest.mark.parametrize(("best", "expected"), [(0, 3.0), (1, 2.0), (None, None)])
def test_the_fit_without_a_step_begins_where_that_led_and_before_it(
    best: int | None, expected: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An effect that brought mechanics has bent the loop: without it the search may stay behind."""
    began: list[dict[str, float]] = []

    def solved(_: object, start: dict[str, float]) -> Any:
        began.append(start)
        if best is None:
            raise ArithmeticError
        return SimpleNamespace(rms=[3.0, 4.0][best] if len(began) == 1 else [9.0, 2.0][best])

    monkeypatch.setattr(module, "solved", solved)
    question = SimpleNamespace(with_model=lambda _: None)
    foot: Any = SimpleNamespace(values={"bouc_wen.beta": 1.0})
    values = {"bouc_wen.beta": 5.0, "second_order.omega": 7.0}
    fit: Any = SimpleNamespace(values=values, model=MOVING + Friction(), question=question)
    step: Any = SimpleNamespace(name="friction")
    found = module._without(foot, fit, step, 1)
    assert began == [values, {**values, "bouc_wen.beta": 1.0}]
    assert (None if found is None else found.rms) == expected
