"""The score is what a refit would give, its p-value is what it says, and it knows its limits."""

from __future__ import annotations

import inspect
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np
import pytest
from scipy import signal

import piezo_opt as po
from piezo_opt.diagnosis.base_point import BasePoint
from piezo_opt.diagnosis.colour import Colour
from piezo_opt.diagnosis.following import Whitened
from piezo_opt.diagnosis.scores import Suspect, by_name, score
from piezo_opt.effects import (
    AmplifierLag,
    Asymmetry,
    Creep,
    Delay,
    Drift,
    Effect,
    Friction,
    Load,
    NonlinearGain,
    Offset,
    PiezoGain,
    SecondMode,
    SensorLag,
    Temperature,
)
from piezo_opt.effects.base import Chain, Equations, Parameter, Place
from piezo_opt.effects.catalogue import CATALOGUE
from piezo_opt.measurement import FloatArray
from tests.diagnosis.plants import MOVING, NOISE, STILL, clock, fitted, measured, rich, sine

OPTIONAL = [
    kind(**options)
    for kind in CATALOGUE.values()
    if not kind.structural
    for options in kind.variants
]


def suspect_of(found: tuple[Suspect, ...], name: str) -> Suspect:
    return next(s for s in found if s.name == name)


def autoregressive(seed: int, samples: int, phi: float = 0.9) -> FloatArray:
    white = np.random.default_rng(seed).normal(size=samples + 500)
    return np.asarray(NOISE * np.sqrt(1 - phi**2) * signal.lfilter([1.0], [1.0, -phi], white)[500:])


@pytest.fixture(scope="module")
def still() -> BasePoint:
    """The quasi-static base at its own record."""
    time = clock()
    return BasePoint(fitted(STILL, measured(STILL, time, rich(time))))


@pytest.fixture(scope="module")
def moving() -> BasePoint:
    """The base with mechanics at its own record."""
    time = clock()
    return BasePoint(fitted(MOVING, measured(MOVING, time, rich(time))))


def test_where_all_is_linear_the_score_is_the_refit() -> None:
    time = clock()
    base = PiezoGain() + Offset()
    record = measured(base, time, rich(time), (Drift(), {"rate": 2e-9}))
    fit = fitted(base, record)
    (suspect,), _ = score(BasePoint(fit), [Drift()])
    refit = po.solve(po.Identification(base + Drift(), record), start=fit)
    assert suspect.predicted_rms == pytest.approx(refit.rms, rel=1e-9)
    assert suspect.size == pytest.approx(refit.values["drift.rate"], rel=1e-6)
    share = 1.0 - (refit.rms / fit.rms) ** 2
    assert suspect.score == pytest.approx(share, rel=1e-6)


def test_beside_a_loop_the_score_is_the_refit_within_a_percent() -> None:
    time = clock()
    record = measured(STILL, time, rich(time), (Drift(), {"rate": 2e-8}))
    fit = fitted(STILL, record)
    (suspect,), _ = score(BasePoint(fit), [Drift()])
    refit = po.solve(po.Identification(STILL + Drift(), record), start=fit)
    assert fit.rms > 1.3 * refit.rms
    assert suspect.predicted_rms == pytest.approx(refit.rms, rel=0.01)


def replayed(point: BasePoint) -> list[tuple[Effect, Any]]:
    """Directions of the whole catalogue at a point, computed once."""
    channels: tuple[str, ...] = ()
    able = [e for e in OPTIONAL if point.question.model.refusal(e, channels) is None]
    return [(e, list(point.directions(e))) for e in able]


@pytest.mark.parametrize("kind", ["white", "autoregressive"])
def test_noise_alone_gets_no_name(still: BasePoint, kind: str, monkeypatch: Any) -> None:
    """The smallest of all corrected p-values falls below 1e-3 in at most 2 % of the records."""
    kept = {id(e): d for e, d in replayed(still)}
    effects = [e for e in OPTIONAL if id(e) in kept]
    assert len({e.name for e in effects}) > 12
    monkeypatch.setattr(still, "directions", lambda effect: kept[id(effect)])
    alarms, seeds = 0, 150
    for seed in range(seeds):
        if kind == "white":
            noise = NOISE * np.random.default_rng(seed).normal(size=still.samples)
        else:
            noise = autoregressive(seed, still.samples)
        monkeypatch.setattr(still, "residual", still.project(noise))
        suspects, _ = score(still, effects, threads=1)
        alarms += min(s.p_value for s in suspects) < 1e-3
    assert alarms <= 0.02 * seeds


@pytest.mark.parametrize("phi", [0.0, 0.6, 0.9])
def test_noise_explains_by_chance_as_often_as_stated(
    still: BasePoint, phi: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Taken as white, noise of 0.9 would give a column as slow as itself 19 times its score."""
    slow = still.project(np.sin(2.0 * np.pi * clock()))
    p = []
    for seed in range(400):
        noise = autoregressive(seed, still.samples, phi)
        monkeypatch.setattr(still, "residual", still.project(noise))
        p.append(Whitened(still).chance(slow))
    assert np.mean(np.array(p) < 0.05) == pytest.approx(0.05, abs=0.03)
    assert np.mean(np.array(p) < 0.5) == pytest.approx(0.5, abs=0.08)


def test_noise_that_is_loud_where_a_column_is_makes_it_no_surer(
    still: BasePoint, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a clock's jitter is where the drive is quick: taken as even, a third would be below."""
    loud = np.where(clock() % 0.5 < 0.1, 4.0, 1.0)
    column = still.project(np.where(loud > 1.0, np.sin(40.0 * clock()), 0.0))
    p = []
    for seed in range(300):
        noise = loud * autoregressive(seed, still.samples, 0.0)
        monkeypatch.setattr(still, "residual", still.project(noise))
        p.append(Whitened(still).chance(column))
    assert np.mean(np.array(p) < 0.05) == pytest.approx(0.05, abs=0.035)


def test_news_of_autoregressive_noise() -> None:
    runs = [autoregressive(seed, 4000, 0.8) for seed in range(20)]
    assert np.mean([Colour.of(r, [4000], 1).news for r in runs]) == pytest.approx(1 / 9.0, rel=0.1)
    assert Colour.of(autoregressive(0, 4000, 0.0), [4000], 1).news > 0.92


@pytest.mark.parametrize(("sign", "wrong"), [(1.0, False), (-1.0, True)])
def test_a_one_sided_gate_is_not_taken_to_its_forbidden_side(
    moving: BasePoint, sign: float, wrong: bool, monkeypatch: Any
) -> None:
    one = {"tau": 0.02}
    (direction,) = moving.directions(AmplifierLag(), [one])
    monkeypatch.setattr(moving, "directions", lambda _: [direction])
    monkeypatch.setattr(moving, "residual", moving.residual + sign * 0.05 * direction.projected)
    (suspect,), _ = score(moving, [AmplifierLag()])
    assert suspect.wrong_side is wrong
    assert suspect.size == pytest.approx(sign * 0.05, rel=0.05)
    if wrong:
        assert (suspect.score, suspect.p_value) == (0.0, 1.0)
    else:
        assert suspect.score > 0.9
        assert suspect.p_value < 1e-20


def test_a_contact_that_gives_way_at_once_is_scored_on_steps_as_short() -> None:
    """In a five-hundredth of the stroke, through which the motion runs within one sample."""
    time = clock()
    shaken = 30.0 - 30.0 * np.cos(2.0 * np.pi * 55.0 * time) * np.sin(np.pi * time)
    blank = measured(MOVING, time, shaken, noise=0.0)
    law = Friction(), {"F": 0.05, "z0": 0.002 * float(np.ptp(blank.position))}
    fit = fitted(MOVING, measured(MOVING, time, shaken, law, noise=1e-9))
    (direction,) = BasePoint(fit).directions(Friction(), [{"z0": law[1]["z0"]}])
    assert np.isfinite(direction.whole).all()
    # As long as it slides, friction is its law's force in the direction of the motion.
    slid = fitted(MOVING, blank)
    values = {**slid.values, "friction.F": 1e-4, "friction.z0": law[1]["z0"]}
    with_it = po.simulate(MOVING + Friction(), blank, values).reading
    without = po.simulate(MOVING, blank, slid.values).reading
    (there,) = BasePoint(slid).directions(Friction(), [{"z0": law[1]["z0"]}])
    by_hand = (with_it - without) / 1e-4
    # A picture to score by, on steps of one time constant of the contact.
    assert float(np.linalg.norm(there.whole - by_hand)) < 0.2 * float(np.linalg.norm(by_hand))
    (suspect,), _ = score(BasePoint(fit), [Friction()])
    assert suspect.score > 0.2
    assert not suspect.wrong_side


def test_a_two_sided_gate_may_be_negative() -> None:
    time = clock()
    hidden = Creep(elements=1), {"c": -0.02, "tau": 0.3}
    found, _ = score(BasePoint(fitted(STILL, measured(STILL, time, rich(time), hidden))), [Creep()])
    assert not found[0].wrong_side
    assert found[0].size < 0.0
    assert found[0].p_value < 1e-4


def test_a_constant_load_hides_behind_frequency_and_gain(moving: BasePoint) -> None:
    found, _ = score(moving, [Load(), SecondMode()])
    # The rest is the rough scheme of the scores; sharp, nothing is left.
    assert suspect_of(found, "load").visibility < 1e-3
    (sharp,) = BasePoint(moving.fit, sharp=True).directions(Load())
    assert np.linalg.norm(sharp.projected) < 1e-6 * np.linalg.norm(sharp.whole)
    assert suspect_of(found, "load").p_value > 1e-3
    assert suspect_of(found, "second_mode").visibility > 0.05


def test_lags_overlap_and_a_drift_does_not() -> None:
    time = clock()
    hidden = Delay(), {"T": 1e-3}
    fit = fitted(MOVING, measured(MOVING, time, sine(time), hidden))
    found, _ = score(BasePoint(fit), [AmplifierLag(), Delay(), SensorLag(), Drift()])
    delay, lag = suspect_of(found, "delay"), suspect_of(found, "amplifier_lag")
    assert dict(delay.overlaps)["amplifier_lag"] > 0.99
    assert dict(delay.overlaps)["amplifier_lag"] == dict(lag.overlaps)["delay"]
    assert dict(delay.overlaps)["amplifier_lag"] == pytest.approx(
        abs(float(delay.direction @ lag.direction)), abs=1e-4
    )
    assert "drift" not in dict(delay.overlaps)
    assert suspect_of(found, "drift").overlaps == ()


def test_of_several_forms_the_most_alike_is_told_once() -> None:
    time = clock()
    hidden = Creep(elements=1), {"c": 0.05, "tau": 0.05}
    point = BasePoint(fitted(STILL, measured(STILL, time, rich(time), hidden)))
    for forms in ([Creep(elements=1), Creep(elements=3)], [Creep(elements=3), Creep(elements=1)]):
        found, _ = score(point, [SensorLag(), *forms])
        lag = suspect_of(found, "sensor_lag")
        cosines = [abs(float(lag.direction @ s.direction)) for s in found if s.name == "creep"]
        assert abs(cosines[0] - cosines[1]) > 1e-3
        assert max(cosines) > 0.5
        assert lag.overlaps == (("creep", round(max(cosines), 4)),)


@pytest.mark.parametrize(
    ("effect", "own"),
    [
        (Creep(), {"c": 0.02, "tau": 0.05}),
        (Asymmetry(), {"delta": 1.5e-10}),
        (NonlinearGain(), {"k2": 3e-11}),
        (SensorLag(), {"share": 1.0, "tau": 5e-3}),
    ],
)
def test_the_hidden_effect_comes_first(effect: Effect, own: dict[str, float]) -> None:
    time = clock()
    fit = fitted(STILL, measured(STILL, time, rich(time), (effect, own)))
    suspects, _ = score(BasePoint(fit), OPTIONAL)
    first = suspects[0]
    alike = {first.name, *(n for n, cosine in first.overlaps if cosine > 0.95)}
    assert effect.name in alike
    assert first.p_value < 1e-6


def test_variants_are_one_suspect_by_name(still: BasePoint) -> None:
    suspects, _ = score(still, [Creep(elements=3), Creep(elements=1), Drift()])
    assert len(suspects) == 3
    merged = by_name(suspects)
    assert sorted(s.name for s in merged) == ["creep", "drift"]
    best = max((s for s in suspects if s.name == "creep"), key=lambda s: s.score)
    assert suspect_of(merged, "creep") is best


def test_scores_are_told_of_usual_forms_where_an_effect_has_one(still: BasePoint) -> None:
    forms = [Asymmetry(**options) for options in Asymmetry.variants]
    found, _ = score(still, [*forms, Drift()])
    suspects = tuple(replace(s, score=0.9) if s.effect.rare else s for s in found)
    told = by_name(suspects)
    assert suspect_of(told, "asymmetry").effect == Asymmetry()
    assert [s.score for s in told] == sorted((s.score for s in told), reverse=True)
    (alone,) = by_name(tuple(s for s in suspects if s.effect == Asymmetry(bent=True)))
    assert alone.effect == Asymmetry(bent=True)


@final
@dataclass(frozen=True)
class Divides(Effect):
    """A user's effect with a slip of the pen."""

    place = Place.STRAIN
    size = Parameter("m", "size", nominal=0.0, bounds=(-1.0, 1.0), null=0.0)

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Raises."""
        return Equations(gives=p.size * (1 / 0))


@final
@dataclass(frozen=True)
class Asks(Effect):
    """A user's effect that asks a symbol for its truth: the error comes from CasADi's file."""

    place = Place.STRAIN
    size = Parameter("m", "size", nominal=0.0, bounds=(-1.0, 1.0), null=0.0)

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Raises."""
        return Equations(gives=p.size if chain.drive.value > 0 else 0.0)


@pytest.mark.parametrize(
    ("effect", "line"), [(Divides(), "(1 / 0)"), (Asks(), "chain.drive.value > 0")]
)
def test_a_candidate_that_raises_is_reported_with_its_own_line(
    still: BasePoint, effect: Effect, line: str
) -> None:
    suspects, unscored = score(still, [effect, Drift()])
    assert [s.name for s in suspects] == ["drift"]
    (failed,) = unscored
    assert failed.name == effect.name
    source, first = inspect.getsourcelines(type(effect))
    number = first + next(i for i, text in enumerate(source) if line in text)
    assert f"{__file__}, line {number}: " in failed.why


def test_what_the_record_lacks_is_said(still: BasePoint) -> None:
    suspects, unscored = score(still, [Temperature(), Load(), Drift()])
    assert [s.name for s in suspects] == ["drift"]
    assert {u.name: u.why for u in unscored}["temperature"].startswith("temperature needs")
    assert "quasi-static" in {u.name: u.why for u in unscored}["load"]


def test_who_is_scored_in_one_form_is_not_said_to_be_left_out_in_another(still: BasePoint) -> None:
    """And who is not in any is said so once."""
    offered = [SecondMode(), SecondMode(attached=True), Friction(), Friction(smooth=True)]
    suspects, unscored = score(still, offered)
    assert [s.effect for s in suspects] == [SecondMode()]
    assert [one.name for one in unscored] == ["friction"]


@final
@dataclass(frozen=True)
class Explodes(Effect):
    """y = x + 1e200 a t, an effect whose derivative is no number any more."""

    place = Place.OUTPUT
    a = Parameter("m", "amplitude", nominal=0.0, null=0.0)

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The reading with a part that grows without bound."""
        return Equations(gives=chain.incoming.value + 1e200 * p.a * chain.time)


def test_an_effect_whose_derivative_explodes_is_left_out_with_a_sentence(still: BasePoint) -> None:
    suspects, unscored = score(still, (Explodes(), Drift()))
    assert {s.name for s in suspects} == {"drift"}
    assert [(u.name, u.why) for u in unscored] == [
        ("explodes", "its sensitivities are not finite on this record.")
    ]
