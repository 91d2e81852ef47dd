"""What the model has comes before another name; every contender gets its best chance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.diagnosis import contest as module
from piezo_opt.diagnosis import refinements as refining
from piezo_opt.diagnosis.base_point import BasePoint
from piezo_opt.diagnosis.contest import _Chance as Chance
from piezo_opt.diagnosis.contest import beside, contest, forgetful
from piezo_opt.diagnosis.held_out import HeldOut, hold_out
from piezo_opt.diagnosis.ladder import climb
from piezo_opt.diagnosis.refinements import (
    base_refinements,
    lean,
    plausible,
    refinements,
    shape_refinements,
    stiffened,
    stilled,
    with_base_details,
)
from piezo_opt.diagnosis.rung import STRONG, Rung, Trial, adding, bic_gain, race, solved
from piezo_opt.diagnosis.scores import effective_samples, score
from piezo_opt.diagnosis.shortlist import entrants, jointly, scored
from piezo_opt.effects import (
    AmplifierLag,
    Asymmetry,
    ChargeBackCoupling,
    Creep,
    CubicStiffness,
    DeadZone,
    Drift,
    Effect,
    Friction,
    HystereticForce,
    NonlinearGain,
    Saturation,
    SecondOrder,
    SlewLimit,
)
from piezo_opt.identification.default import shown
from piezo_opt.identification.shapes import own
from piezo_opt.identification.starting import joint_start, joint_starts
from tests.diagnosis.plants import (
    MOVING,
    NOISE,
    STILL,
    TRUTH,
    clock,
    fitted,
    measured,
    rich,
    triangle,
)

K3, OMEGA = 4e15, TRUTH["second_order.omega"]
CUBED = NonlinearGain(), {"k2": 1e-10, "ratio": 1.5e-2}


def held(record: po.Measurement) -> HeldOut:
    return hold_out(po.Identification(STILL, record), None)


def test_a_detail_is_freed_before_another_name_is_asked_for() -> None:
    """A cubic gain is one effect: its bend is not explained by a second one."""
    time = clock(3000)
    record = measured(STILL, time, rich(time), CUBED)
    split = held(record)
    base = fitted(STILL, split.question.campaign.records[0])
    offered: list[Effect] = [NonlinearGain(), DeadZone(backlash=True), Creep(elements=1), Drift()]
    ladder = climb(base, split, offered)
    assert [s.name for s in ladder.steps] == ["nonlinear_gain"]
    assert ladder.final.values["nonlinear_gain.ratio"] == pytest.approx(1.5e-2, rel=0.1)
    assert ladder.final.rms == pytest.approx(NOISE, rel=0.05)


def test_refinements_are_details_and_hidden_mechanics() -> None:
    time = clock(2000)
    record = measured(STILL, time, rich(time))
    fit = fitted(STILL, record)
    # An actuator that is stiffer than its record can show has no mechanics to be tried.
    assert [t.refines for t in base_refinements(fit)] == [("bouc_wen.n",)]
    swinging = measured(MOVING, time, rich(time))
    hidden = fitted(STILL, swinging)
    assert [t.refines for t in base_refinements(hidden)] == [("bouc_wen.n",), ("second_order",)]
    assert shape_refinements(fit) == []
    lagged = solved(
        fit.question.with_model(STILL + AmplifierLag()), {**fit.values, "amplifier_lag.share": 0.5}
    )
    (trial,) = shape_refinements(lagged)
    assert trial.refines == ("amplifier_lag.ratio",)
    assert trial.question.model["amplifier_lag"] == AmplifierLag(poles=2)
    # What is free already, or fixed by the user, is not offered again.
    fixed = po.solve(po.Identification(STILL, swinging, fixed={"bouc_wen.n": 1.2}), start=TRUTH_OF)
    assert [t.refines for t in refinements(fixed)] == [("second_order",)]
    moving = fitted(MOVING, swinging)
    assert [t.refines for t in base_refinements(moving)] == [("bouc_wen.n",)]


def test_a_chain_that_forgets_between_two_samples_is_not_made_denser() -> None:
    time = clock(2000)
    record = measured(STILL, time, rich(time))
    base = fitted(STILL, record)
    question = base.question.with_model(STILL + Creep(elements=3))

    def details(tau: float) -> Effect:
        at = {**base.values, "creep.c": 0.02, "creep.tau": tau}
        (trial, *_) = shape_refinements(solved(question, at, 0))
        return trial.question.model["creep"]

    # The densest chain begins half a decade below.
    assert details(5.0 * record.step) == Creep(elements=7, per_decade=2)
    assert details(2.0 * record.step) == Creep(elements=3)


def test_mechanics_that_an_effect_was_scored_on_are_looked_at_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A slow lag is no charge on a plate behind mechanics that never rise."""
    time = clock(2000)
    lag = AmplifierLag(), {"share": 1.0, "tau": 0.02}
    fit = fitted(STILL, measured(STILL, time, rich(time), lag))
    ground = fitted(MOVING, fit.records[0])
    (suspect,), _ = score(BasePoint(ground), [ChargeBackCoupling()])
    trial = adding(fit, suspect)
    assert trial.ground == ("second_order",)
    assert adding(ground, suspect).ground == ()
    start = {**trial.start, "second_order.omega": 100.0}
    monkeypatch.setattr(refining, "_resonates", lambda *_: False)
    for zeta, rises in ((1.0, False), (0.4, False), (0.2, True)):
        question = replace(trial.question, fixed={"second_order.zeta": zeta})
        rung = Rung(trial, solved(question, {**start, "second_order.zeta": zeta}, 1), 1.0)
        assert plausible(rung) is rises
        # Where they join of themselves a rise is not enough.
        assert not plausible(replace(rung, trial=replace(trial, refines=trial.ground)))


TRUTH_OF = {n: v for n, v in TRUTH.items() if n in STILL.parameters}


def test_mechanics_that_only_lag_and_exponents_at_a_bound_are_not_plausible() -> None:
    time = clock(2000)
    lag = AmplifierLag(), {"share": 1.0, "tau": 4e-3}
    fit = fitted(STILL, measured(STILL, time, rich(time), lag))
    mechanics = base_refinements(fit)[-1]
    assert mechanics.refines == ("second_order",)
    (rung,) = race(fit, [mechanics], 1)
    assert rung.fit.values["second_order.zeta"] > 0.7
    assert not plausible(rung)
    seen = fitted(STILL, measured(MOVING, time, rich(time)))
    (rung,) = race(seen, [base_refinements(seen)[-1]], 1)
    assert plausible(rung)
    omega = TRUTH["second_order.omega"]
    assert rung.fit.values["second_order.omega"] == pytest.approx(omega, rel=0.02)


def test_mechanics_may_show_in_the_rise_towards_a_peak_that_is_not_shaken() -> None:
    """At a third of the resonance the response is an eighth larger, which no lag's is."""
    time = clock(3000)
    tones = ((3.0, 12.0), (11.0, 9.0), (20.0, 6.0))
    drive = 30.0 + sum(a * np.sin(2.0 * np.pi * f * time + f) for f, a in tones)
    seen = fitted(STILL, measured(MOVING, time, drive))
    (rung,) = race(seen, [base_refinements(seen)[-1]], 1)
    omega, zeta = (rung.fit.values[f"second_order.{n}"] for n in ("omega", "zeta"))
    assert omega == pytest.approx(TRUTH["second_order.omega"], rel=0.05)
    assert not shown(seen.records[0], omega, zeta)
    assert plausible(rung)
    # With something else left over it may be but one more way to bend a loop.
    creep = Creep(elements=1), {"c": 0.03, "tau": 0.1}
    bent = fitted(STILL, measured(MOVING, time, drive, creep))
    (rung,) = race(bent, [base_refinements(bent)[-1]], 1)
    assert rung.fit.rms > 1.2 * NOISE
    assert not plausible(rung)
    # And what damps so much that nothing rises is a lag.
    heavy = SecondOrder(), {"omega": TRUTH["second_order.omega"], "zeta": 0.5}
    damped = fitted(STILL, measured(STILL, time, drive, heavy))
    (rung,) = race(damped, [base_refinements(damped)[-1]], 1)
    assert rung.fit.rms == pytest.approx(NOISE, rel=0.05)
    assert not plausible(rung)


def test_a_spring_without_mass_leaves_the_fit_alone() -> None:
    """Whatever the drive: steps within one sample are over before any mass could follow them."""
    time = clock(2000)
    fit = fitted(STILL, measured(STILL, time, rich(time)))
    stiff = moving(fit)
    assert stiff.rms == pytest.approx(fit.rms, rel=1e-3)
    assert stiff.names == fit.names
    # A force is scored with them, and refused without.
    (suspect,), unscored = score(BasePoint(fit), [Friction()], 1, BasePoint(stiff))
    assert unscored == ()
    assert suspect.base is stiff
    assert score(BasePoint(fit), [Friction()], 1)[0] == ()


def stiffening(frequency: float) -> tuple[po.Fit, Rung]:
    """A guide that stiffens, on triangles; the quasi-static fit, and the cube on a spring."""
    time = clock()
    hidden = CubicStiffness(), {"k3": K3}
    record = measured(MOVING, time, triangle(time, frequency), hidden)
    below = fitted(STILL, record)
    suspect = next(s for s in scored(below, [CubicStiffness()], 2)[0])
    (on_a_spring,) = race(below, [adding(below, suspect)], 2)
    assert "spring" in on_a_spring.fit.model
    return below, on_a_spring


def test_forces_on_a_spring_get_a_mass_and_stay_as_strong() -> None:
    _, without = stiffening(4.0)
    trial = refining.mechanics_trial(without.fit)
    assert trial is not None
    assert trial.refines == ("second_order",)
    assert "spring" not in trial.question.model
    # What a force does at rest is its strength over omega^2, whatever omega is.
    softness = without.fit.values["cubic_stiffness.k3"] / without.fit.values["spring.omega"] ** 2
    omega = trial.start["second_order.omega"]
    assert trial.start["cubic_stiffness.k3"] == pytest.approx(softness * omega**2, rel=1e-6)
    found = solved(trial.question, trial.start)
    assert found.values["second_order.omega"] == pytest.approx(OMEGA, rel=0.01)
    assert found.values["cubic_stiffness.k3"] == pytest.approx(K3, rel=0.05)
    assert without.fit.rms > 5.0 * found.rms
    assert found.rms == pytest.approx(NOISE, rel=0.05)
    assert refining.mechanics_trial(found) is None


def leading(trial: Trial, below: po.Fit) -> Rung:
    """A refit that leaves but noise, as if it were another effect's."""
    found = solved(trial.question, trial.start)
    (suspect,) = scored(below, [HystereticForce()], 2)[0]
    return Rung(replace(trial, suspect=suspect), found, bic_gain(below, found))


def cubed(rungs: Sequence[Rung]) -> Rung:
    """The best of a stiffening guide."""
    return next(r for r in rungs if r.suspect and r.suspect.name == "cubic_stiffness")


def test_contenders_on_a_spring_have_a_right_to_mechanics() -> None:
    """Who leaves but noise stands on mechanics that the others were not given."""
    below, without = stiffening(1.5)
    trial = refining.mechanics_trial(without.fit)
    assert trial is not None
    best = cubed(contest(below, [leading(trial, below), without], below.question))
    assert "second_order" in best.fit.model
    assert best.fit.rms == pytest.approx(NOISE, rel=0.05)
    assert without.fit.rms > 1.3 * best.fit.rms


def test_contenders_close_by_have_a_right_to_the_details_of_the_base() -> None:
    """Beside an exponent of the loop that only the leader was given another one is behind."""
    time = clock()
    truth = {**TRUTH, "bouc_wen.n": 1.1, "cubic_stiffness.k3": 1e15}
    drive = rich(time)
    blank = po.Measurement(time, drive, drive, allow_saturated=True)
    reading = po.simulate(MOVING + CubicStiffness(), blank, truth).reading
    white = np.random.default_rng(0).normal(size=time.size)
    record = po.Measurement(time, drive, reading + NOISE * white, allow_saturated=True)
    below = fitted(MOVING, record)
    suspect = next(s for s in scored(below, [CubicStiffness()], 2)[0])
    (behind,) = race(below, [adding(below, suspect)], 2)
    leader = leading(with_base_details(behind.trial), below)
    assert behind.fit.rms > 1.05 * leader.fit.rms
    best = cubed(contest(below, [leader, behind], below.question))
    assert "bouc_wen.n" in best.fit.question.free
    assert best.fit.rms < 1.001 * leader.fit.rms


def test_friction_is_named_where_the_mechanics_are_too_fast_to_be_seen() -> None:
    time = clock(3000, 300.0)
    omega = 2.0 * np.pi * 400.0
    hidden = (
        (SecondOrder(), {"omega": omega, "zeta": 0.3}),
        (Friction(), {"F": 0.02 * 7e-6 * omega**2, "z0": 3e-7}),
    )
    drive = triangle(time, 0.35) + 20.0 * np.sin(2.0 * np.pi * 0.9 * time)
    record = measured(STILL, time, drive, *hidden)
    split = held(record)
    base = fitted(STILL, split.question.campaign.records[0])
    assert base.rms > 3.0 * NOISE
    ladder = climb(base, split, [Friction(), Creep(elements=1), NonlinearGain(), Drift()])
    assert [s.name for s in ladder.steps] == ["friction"]
    # Only F / omega^2 is known there, as the displacement that the contact holds back.
    values = ladder.final.values
    (mechanics,) = {"spring", "second_order"} & set(ladder.final.model.names)
    back = values["friction.F"] / values[f"{mechanics}.omega"] ** 2
    assert back == pytest.approx(0.02 * 7e-6, rel=0.1)
    assert ladder.final.rms == pytest.approx(NOISE, rel=0.1)


def test_a_contest_is_held_only_where_something_is_left() -> None:
    time = clock(2000)
    creep = Creep(elements=1), {"c": 0.03, "tau": 0.1}
    fit = fitted(MOVING, measured(MOVING, time, rich(time), creep))
    suspects, _ = score(BasePoint(fit), [Creep(elements=1), NonlinearGain()])
    rungs = race(fit, [adding(fit, s) for s in suspects], 2)
    settled = contest(fit, rungs, fit.question)
    assert settled[0].fit is min((r.fit for r in rungs), key=lambda f: f.rms)
    assert {r.fit for r in settled} <= {r.fit for r in rungs}
    cubed = fitted(STILL, measured(STILL, time, rich(time), CUBED))
    suspects, _ = score(BasePoint(cubed), [NonlinearGain()])
    rungs = race(cubed, [adding(cubed, s) for s in suspects], 2)
    best, *_ = contest(cubed, rungs, cubed.question)
    assert "nonlinear_gain.ratio" in best.fit.names
    assert best.fit.rms < 0.9 * rungs[0].fit.rms


def test_a_fresh_start_forgets_the_base_and_keeps_what_was_added() -> None:
    time = clock(2000)
    creep = Creep(elements=1), {"c": 0.03, "tau": 0.1}
    fit = fitted(STILL, measured(STILL, time, rich(time), creep))
    (suspect,), _ = score(BasePoint(fit), [Creep(elements=1)])
    (rung,) = race(fit, [adding(fit, suspect)], 1)
    assert isinstance(rung, Rung)
    question = forgetful(rung.fit, po.Identification(STILL, rung.fit.records[0]))
    assert set(question.values) == {"creep.c", "creep.tau", "creep.power", "creep.spread"}
    assert question.values["creep.tau"] == rung.fit.values["creep.tau"]
    start = joint_start(po.Identification(STILL + Creep(elements=1), rung.fit.records[0]), "creep")
    again = solved(rung.fit.question, start)
    assert again.rms == pytest.approx(NOISE, rel=0.05)


def test_the_other_form_of_an_effect_is_tried_before_another_effect() -> None:
    """A single creep element beside a mode: no lag is put beside the chain of three."""
    time = clock(2000)
    creep = Creep(elements=1), {"c": 0.03, "tau": 0.1}
    fit = fitted(STILL, measured(STILL, time, rich(time), creep))
    three = solved(fit.question.with_model(STILL + Creep()), {**fit.values, "creep.c": 0.03})
    forms = [t.question.model["creep"] for t in shape_refinements(three)]
    assert forms == [Creep(elements=7, per_decade=2), Creep(elements=1)]
    # Forms differ in one option or in several; none is a mixture of two.
    sided = fit.question.with_model(STILL + Asymmetry(sided=True))
    others = [t.question.model["asymmetry"] for t in shape_refinements(solved(sided, fit.values))]
    assert others == [
        Asymmetry(), Asymmetry(growing=True), Asymmetry(bent=True), Asymmetry(uneven=True)
    ]  # fmt: skip
    rungs = race(three, shape_refinements(three), 1)
    best = next(r for r in rungs if r.fit.model["creep"] == Creep(elements=1))
    assert best.fit.rms == pytest.approx(NOISE, rel=0.05)
    assert best.fit.rms < 0.97 * three.rms


def test_a_form_that_is_exact_in_its_details_is_found_from_another_form() -> None:
    """Alone it is behind the form that a contender has: 4.4 times the noise, and that one 4.2."""
    time = clock(3000)
    bent = Asymmetry(), {"delta": 1.5e-10, "bend": 1e-3}
    base = fitted(STILL, measured(STILL, time, rich(time), bent))
    (suspect,), _ = score(BasePoint(base), [Asymmetry(sided=True)], 1)
    (rung,) = race(base, [adding(base, suspect)], 1)
    plain = solved(base.question.with_model(STILL + Asymmetry()), base.values)
    assert plain.rms > rung.fit.rms > 4.0 * NOISE
    found = module._shaped(base, rung, 1).fit
    assert found.model == STILL + Asymmetry()
    assert found.rms == pytest.approx(NOISE, rel=0.05)


def creeping_loop(exponent: float) -> tuple[po.Fit, Rung]:
    """A loop of this exponent that creeps: its fit without creep, and with it and all details."""
    time = clock(2000)
    blank = measured(STILL, time, rich(time))
    truth = {**TRUTH_OF, "bouc_wen.n": exponent, "creep.c": 0.03, "creep.tau": 0.1}
    noise = NOISE * np.random.default_rng(0).normal(size=time.size)
    reading = po.simulate(STILL + Creep(elements=1), blank, truth).reading
    fit = fitted(STILL, blank.with_(position=reading + noise))
    (suspect,), _ = score(BasePoint(fit), [Creep(elements=1)])
    (rung,) = race(fit, [with_base_details(adding(fit, suspect))], 1)
    assert rung.trial.refines == ("bouc_wen.n",)
    return fit, rung


def test_a_detail_that_the_record_pays_for_stays_beside_the_effect() -> None:
    fit, rung = creeping_loop(1.6)
    assert lean(fit, rung, 2) is rung
    assert rung.fit.values["bouc_wen.n"] == pytest.approx(1.6, rel=0.1)


def test_a_detail_that_was_freed_in_vain_is_fixed_again() -> None:
    fit, rung = creeping_loop(1.0)
    slim = lean(fit, rung, 2)
    assert slim.suspect is rung.suspect
    assert (slim.trial.refines, slim.fit.question.free) == ((), ())
    assert slim.fit.values["bouc_wen.n"] == 1.0
    assert slim.fit.rms == pytest.approx(NOISE, rel=0.05)
    # What was free before the effect came is none of its costs.
    assert lean(rung.fit, rung, 2) is rung
    # On as many samples as before, so that it can be compared with the rivals still.
    n = effective_samples(rung.fit.residuals)
    assert slim.delta_bic == pytest.approx(bic_gain(fit, slim.fit, n), rel=1e-9)
    assert slim.delta_bic > rung.delta_bic
    counted = lean(fit, replace(rung, delta_bic=500.0), 2)
    assert counted.delta_bic - 500.0 == pytest.approx(slim.delta_bic - rung.delta_bic)


def test_an_effect_keeps_the_details_that_it_pays_for() -> None:
    """Weights that grow are worth their number, elements closer together are worth nothing."""
    time = clock(4000)
    creep = Creep(elements=3), {"c": 0.06, "tau": 0.02, "power": 0.6}
    fit = fitted(STILL, measured(STILL, time, rich(time), creep))
    (suspect,), _ = score(BasePoint(fit), [Creep(elements=3)])
    plain = adding(fit, suspect)
    question = replace(plain.question, free=("creep.power", "creep.spread"))
    # From the grid's 1.2 s it would end in a neighbouring minimum, 0.3 % above.
    begin = {**plain.start, "creep.tau": 0.03, "creep.power": 0.1, "creep.spread": 1.05}
    freed = solved(question, begin)
    slim = lean(fit, Rung(replace(plain, question=question), freed, bic_gain(fit, freed)), 2)
    assert slim.fit.question.free == ("creep.power",)
    assert slim.fit.values["creep.spread"] == 1.0
    assert slim.fit.values["creep.power"] == pytest.approx(0.6, rel=0.2)
    assert slim.fit.rms == pytest.approx(NOISE, rel=0.05)
    # Details of an effect that was there before are not its own to drop.
    other = replace(plain, question=question, suspect=None)
    assert lean(fit, Rung(other, freed, 0.0), 2).fit is freed


def test_of_two_details_that_can_do_without_each_other_one_stays(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """They are asked side by side; beside what is left after the first the second one is needed."""

    def having(*free: str) -> Any:
        model = {"bouc_wen": SimpleNamespace(structural=True)}
        return SimpleNamespace(question=SimpleNamespace(free=free), model=model)

    def aside(_: Any, rung: Rung, name: str) -> Any:
        asked.append((rung.fit.question.free, name))
        return having(*(k for k in rung.fit.question.free if k != name))

    def gain(poorer: Any, richer: Any) -> float:
        left = len(poorer.question.free)
        return 100.0 if left == 0 or len(richer.question.free) == left else 1.0

    asked: list[tuple[tuple[str, ...], str]] = []
    monkeypatch.setattr(refining, "_aside", aside)
    monkeypatch.setattr(refining, "bic_gain", gain)
    first, second = "bouc_wen.n", "bouc_wen.h_s"
    for threads in (1, 2):
        asked.clear()
        trial: Any = Trial(None, {}, refines=(first, second))  # type: ignore[arg-type]
        slim = lean(having(), Rung(trial, having(first, second), 300.0), threads)
        assert slim.fit.question.free == (second,)
        assert slim.trial.refines == (second,)
        assert slim.delta_bic == 299.0
        assert asked[-1] == ((second,), second)


def test_everybody_enters_beside_a_base_that_has_forgotten() -> None:
    time = clock(2000)
    creep = Creep(elements=1), {"c": 0.03, "tau": 0.1}
    fit = fitted(STILL, measured(STILL, time, rich(time), creep))
    bent = solved(fit.question, {**fit.values, "bouc_wen.beta": 0.5}, 1)
    suspects, _ = score(
        BasePoint(bent), [Creep(), Creep(elements=1), Friction()], 1, BasePoint(moving(bent))
    )
    trials, begun = entrants(bent, po.Identification(STILL, fit.records[0]), suspects, 2)
    assert not begun
    assert [t.suspect for t in trials] == list(suspects)
    for trial in trials:
        assert trial.suspect is not None
        assert trial.start["bouc_wen.beta"] != bent.values["bouc_wen.beta"]
        joined = () if trial.suspect.name == "creep" else ("second_order",)
        assert trial.refines == joined
        assert not trial.question.fixed
    (single,) = (t for t in trials if t.suspect and t.suspect.effect == Creep(elements=1))
    assert solved(single.question, single.start).rms == pytest.approx(NOISE, rel=0.05)


def test_a_limit_that_is_met_at_the_peaks_alone_begins_as_one_where_widths_are_searched() -> None:
    """The best one-step size beside the loop as it begins is a tenth of a limit at a lower knee."""
    time = clock(2000)
    swept = np.cos(2.0 * np.pi * (time + 4.75 * time**2))
    drive = (30.0 - 30.0 * swept) * np.interp(time, [0.0, 1.0, 2.0], [0.8, 1.0, 0.85])
    limit = Saturation(), {"s": 1.0, "v_s": 57.0, "softness": 0.004}
    fit = fitted(MOVING, measured(MOVING, time, drive, limit))
    suspects, _ = scored(fit, [Saturation()], 1)
    foot = po.Identification(MOVING, fit.records[0])
    (entrant,), _ = entrants(fit, foot, suspects, 1)
    (joint,) = jointly(fit, foot, suspects, 1)
    assert joint.suspect is suspects[0]
    assert joint.question.model == entrant.question.model
    assert entrant.start["saturation.s"] < 0.3
    assert joint.start["saturation.s"] > 0.9
    assert joint.start["saturation.v_s"] == pytest.approx(57.0, rel=0.1)


def test_a_strong_effect_of_an_unusual_shape_begins_in_detail_there() -> None:
    """Without its bend there is no place near it to go on from."""
    time = clock(2000)
    drive, reach = rich(time), 60.0
    strength = 0.8 * TRUTH["bouc_wen.alpha"] / reach
    bent = Asymmetry(), {"delta": strength, "bend": 0.2 / reach**2}
    fit = fitted(STILL, measured(STILL, time, drive, bent))
    suspects, _ = scored(fit, [Asymmetry()], 1)
    foot = po.Identification(STILL, fit.records[0])
    (entrant,), _ = entrants(fit, foot, suspects, 1)
    (joint,) = jointly(fit, foot, suspects, 1)
    assert joint.refines == ("bouc_wen.n", "asymmetry.bend")
    assert solved(entrant.question, entrant.start).rms > 1.15 * NOISE
    found = solved(joint.question, joint.start)
    assert found.rms == pytest.approx(NOISE, rel=0.03)
    assert found.values["asymmetry.delta"] == pytest.approx(strength, rel=0.15)


def test_who_began_at_the_foot_is_not_begun_again_beside_a_detail_of_it() -> None:
    """The base that all begin beside has forgotten the detail as well: it would be the same fit."""
    time = clock(2000)
    creep = Creep(elements=1), {"c": 0.03, "tau": 0.1}
    fit = fitted(STILL, measured(STILL, time, rich(time), creep))
    foot = po.Identification(STILL, fit.records[0])
    offered: list[Effect] = [Creep(elements=1), Drift()]
    suspects, _ = score(BasePoint(fit), offered, 1)
    first, _ = entrants(fit, foot, suspects, 1)
    known = race(fit, first[:1], 1)
    (detail, *_) = base_refinements(fit)
    finer = solved(detail.question, detail.start)
    assert "bouc_wen.n" in finer.names
    anew, _ = score(BasePoint(finer), offered, 1)
    trials, begun = entrants(finer, foot, anew, 1, known)
    (again,) = begun
    assert again.fit is known[0].fit
    assert again.suspect is not None
    assert any(again.suspect is suspect for suspect in anew)
    assert again.trial.start == first[0].start
    assert [t.question.model for t in trials] == [first[1].question.model]
    assert dict(trials[0].start) == pytest.approx(dict(first[1].start))
    # What is told of it is told over the fit that there is now.
    (told,) = race(finer, [], 1, begun=begun)
    assert told.delta_bic == pytest.approx(bic_gain(finer, told.fit))


def moving(fit: po.Fit) -> po.Fit:
    stiff = stiffened(fit)
    assert stiff is not None
    return stiff


def test_a_force_is_tried_with_mechanics_of_its_own_and_with_unseen_ones() -> None:
    time = clock(1000)
    fit = fitted(STILL, measured(STILL, time, triangle(time, 1.0)))
    stiff = moving(fit)
    (suspect,), _ = score(BasePoint(fit), [Friction()], 1, BasePoint(stiff))
    free, unseen = beside(fit, fit.question, suspect)
    assert free.refines == ("second_order",)
    assert not free.question.fixed
    assert unseen.refines == ()
    assert unseen.question.fixed == stiff.question.fixed
    (plain,) = beside(stiff, fit.question, suspect)
    assert plain.refines == ()


def test_what_the_motion_drives_is_heard_at_a_fit_that_left_the_mechanics_out() -> None:
    """The charge that damps a resonance away: what is left looks like a lag."""
    time = clock(3000)
    drive = 40.0 - 30.0 * np.cos(2.0 * np.pi * (0.5 * time + 14.9 * time**2))
    charge = ChargeBackCoupling(), {"kappa": 1e4, "tau": 2e-3}
    fit = fitted(STILL, measured(STILL + SecondOrder(), time, drive, charge))
    silent, unheard = score(BasePoint(fit), [ChargeBackCoupling()], 1)
    assert not silent
    assert "quasi-static" in unheard[0].why
    (suspect,), unscored = scored(fit, [ChargeBackCoupling()], 1)
    assert not unscored
    assert "second_order" in suspect.base.model
    assert suspect.p_value < 1e-6
    (trial,) = beside(fit, fit.question, suspect)
    assert trial.refines == ("second_order",)
    assert trial.question.model.names == (*STILL.names, "second_order", "charge_back_coupling")
    (rung,) = race(fit, [adding(fit, suspect)], 1)
    assert rung.fit.rms == pytest.approx(NOISE, rel=0.05)


def test_static_friction_and_micro_damping_are_details_of_friction() -> None:
    """LuGre's terms: no second effect is named beside it, nor a mount in its place."""
    time = clock(4000)
    contact = {"F": 0.05, "z0": 4e-7, "stribeck": 1.4, "w_s": 1e-4, "tau": 1e-3}
    drive = rich(time)
    hidden = Friction(), contact
    fit = fitted(MOVING, measured(MOVING, time, drive, hidden))
    (suspect,), _ = score(BasePoint(fit), [Friction()], 1)
    (rung,) = race(fit, [adding(fit, suspect)], 1)
    assert rung.fit.rms > 3.0 * NOISE
    (details,) = (t for t in shape_refinements(rung.fit) if "friction.tau" in t.refines)
    freed = ("friction.n", "friction.stribeck", "friction.w_s", "friction.tau")
    assert details.refines == freed
    found = solved(details.question, details.start)
    assert found.rms == pytest.approx(NOISE, rel=0.03)
    assert found.values["friction.stribeck"] == pytest.approx(1.4, rel=0.1)


def test_friction_on_a_spring_without_mass_gives_way_as_it_will() -> None:
    """Its exponent needs no mass; micro-damping, a force of the velocity itself, would."""
    time = clock(3000, 300.0)
    omega = 2.0 * np.pi * 400.0
    contact = {"F": 0.02 * 7e-6 * omega**2, "z0": 6e-7, "n": 2.0}
    hidden = (SecondOrder(), {"omega": omega, "zeta": 0.3}), (Friction(), contact)
    drive = triangle(time, 0.35) + 20.0 * np.sin(2.0 * np.pi * 0.9 * time)
    fit = fitted(STILL, measured(STILL, time, drive, *hidden))
    suspects, _ = scored(fit, [Friction()], 1)
    (rung,) = race(fit, [adding(fit, suspects[0])], 1)
    assert "spring" in rung.fit.model
    assert rung.fit.rms > 1.1 * NOISE
    (details,) = (t for t in shape_refinements(rung.fit) if "friction.n" in t.refines)
    assert details.refines == ("friction.n", "friction.stribeck", "friction.w_s")
    found = solved(details.question, details.start)
    assert found.rms == pytest.approx(NOISE, rel=0.03)


def test_friction_begins_at_what_a_mount_does() -> None:
    own = {"alpha": 6e9, "beta": 3e6, "gamma": 1.0, "delta": 0.0, "n": 1.0, "z_s": 1e-6}
    # Only the products with beta act.
    for share in (1.0, 0.5):
        scaled = {**own, "beta": own["beta"] / share, "gamma": share}
        like = Friction().like("hysteretic_force", scaled)
        assert like == {
            "F": pytest.approx(2000.0), "z0": pytest.approx(1 / 3e6), "n": pytest.approx(1.0)
        }  # fmt: skip
    assert Friction().like("hysteretic_force", {**own, "gamma": -1.0}) is None
    assert Friction().like("hysteretic_force", {**own, "delta": -1.0}) is None
    assert Friction().like("hysteretic_force", {**own, "gamma": -0.5, "delta": 1.0}) is None
    assert HystereticForce().like("friction", {k: float(v) for k, v in like.items()}) == (
        pytest.approx({k: own[k] for k in ("alpha", "beta", "gamma", "delta")})
    )
    assert Friction().like("creep", own) is None


@pytest.mark.parametrize(("delta", "exponent"), [(-0.7, 1.0), (0.3, 1.0), (-0.7, 2.0)])
def test_friction_opens_and_closes_as_a_mount_does(delta: float, exponent: float) -> None:
    """Force over way, by the published laws, at a reversal, at zero, and where it slides."""
    own = {"alpha": 6e9, "beta": 3e6, "gamma": 1.0, "delta": delta, "n": exponent, "z_s": 1e-6}
    like = Friction().like("hysteretic_force", own)
    assert like is not None

    def mount(z: float) -> float:
        shape = own["beta"] * abs(z / own["z_s"]) ** (exponent - 1.0)
        return own["alpha"] * (1.0 - shape * (own["gamma"] * z + delta * abs(z)))

    def contact(z: float) -> float:
        r = 1.0 - z
        return like["F"] / like["z0"] * abs(r) ** like["n"]

    largest = like["F"] / own["alpha"]
    assert mount(largest) == pytest.approx(0.0, abs=1e-6 * own["alpha"])
    for share in (-1.0, 0.0, 1.0):
        assert contact(share) == pytest.approx(mount(share * largest), abs=1e-6 * own["alpha"])
    if exponent == 1.0:
        back = HystereticForce().like("friction", like)
        assert back is not None
        assert back["alpha"] == pytest.approx(own["alpha"])
        for name in ("gamma", "delta"):
            acts = own["beta"] * own[name]
            assert back["beta"] * back[name] == pytest.approx(acts, abs=1.0)


@pytest.mark.parametrize("noise_is_left", [False, True])
def test_however_far_behind_friction_begins_at_what_a_mount_does(
    monkeypatch: pytest.MonkeyPatch, noise_is_left: bool
) -> None:
    """Its own way ended elsewhere; what a law with more freedom has found is a start for it."""
    time = clock(2000)
    law = {"F": 20.0, "z0": 2e-6}
    fit = fitted(MOVING, measured(MOVING, time, rich(time), (Friction(), law)))
    suspects, _ = score(BasePoint(fit), [Friction(), HystereticForce()])
    friction, mount = (adding(fit, s) for s in sorted(suspects, key=lambda s: s.name))
    like = HystereticForce().like("friction", {**law, "n": 1.0})
    assert like is not None
    there = {**TRUTH, **{f"hysteretic_force.{k}": v for k, v in like.items()}}
    found = solved(mount.question, {**mount.start, **there})
    stuck = solved(friction.question, {**friction.start, "friction.z0": 1.0}, 1)
    assert stuck.rms > 1.02 * found.rms
    monkeypatch.setattr(module, "_NEAR", 1.02)
    monkeypatch.setattr(module, "_explained", lambda _: noise_is_left)
    monkeypatch.setattr(module, "settled", lambda _: False)
    monkeypatch.setattr(module, "_chance", lambda _, rung, *__: Chance(rung, rung.suspect, ()))
    monkeypatch.setattr(module, "_further", lambda _, chance, *__, **___: chance.rung)
    rungs = [Rung(friction, stuck, 0.0), Rung(mount, found, 0.0)]
    best = contest(fit, rungs, fit.question, 1)[0]
    assert best.suspect is not None
    assert best.suspect.name == "friction"
    assert best.fit.rms == pytest.approx(found.rms, rel=0.005)
    # Of the mount's beta, gamma and delta two products act: one number more than friction has.
    assert len(found.names) == len(best.fit.names) + 2
    n = 1000.0
    fall = 2.0 * n * np.log(best.fit.rms / found.rms) - np.log(n)
    assert bic_gain(best.fit, found, n) == pytest.approx(fall)


@pytest.fixture(scope="module")
def rubbed() -> tuple[po.Fit, Rung, Rung, list[Rung]]:
    """A fit that lacks friction, a smooth friction that is stuck, a mount that does what friction
    does, and friction that does better and worse."""
    time = clock(2000)
    law = {"F": 20.0, "z0": 2e-6, "n": 2.0}
    fit = fitted(MOVING, measured(MOVING, time, rich(time), (Friction(), law)))
    suspects, _ = score(BasePoint(fit), [Friction(smooth=True), HystereticForce()])
    smooth, mount = (adding(fit, s) for s in sorted(suspects, key=lambda s: s.name))
    like = HystereticForce().like("friction", law)
    assert like is not None
    there = {**TRUTH, **{f"hysteretic_force.{k}": v for k, v in like.items()}}
    found = solved(mount.question, {**mount.start, **there}, 1)
    stuck = solved(smooth.question, {**smooth.start, "friction.w_c": 1.0}, 1)
    question = replace(fit.question.with_model(MOVING + Friction()), free=("friction.n",))
    right = {**TRUTH, **{f"friction.{k}": v for k, v in law.items()}}
    better, worse = solved(question, right), solved(question, {**right, "friction.F": 20.3}, 0)
    assert better.rms < found.rms < worse.rms
    led = [Rung(replace(smooth, question=question), one, 0.0) for one in (better, worse)]
    return fit, Rung(smooth, stuck, 0.0), Rung(mount, found, 0.0), led


def test_an_imitation_is_tried_in_the_form_that_can_and_with_the_detail_that_it_moves(
    rubbed: tuple[po.Fit, Rung, Rung, list[Rung]], monkeypatch: pytest.MonkeyPatch
) -> None:
    fit, smooth, mount, _ = rubbed
    assert smooth.fit.model["friction"] == Friction(smooth=True)
    tried: list[Trial] = []

    def best(_: po.Fit, rung: Rung, trials: Sequence[Trial], *__: object) -> Rung:
        tried.extend(trials)
        return rung

    monkeypatch.setattr(module, "_best", best)
    assert module._after(fit, smooth, mount, 1) is None
    usual, finer = tried
    assert usual.question.model["friction"] == finer.question.model["friction"] == Friction()
    assert "friction.n" not in usual.question.free
    assert usual.start["friction.n"] == 1.0
    assert "friction.n" in finer.question.free
    like = Friction().like("hysteretic_force", own(mount.fit.values, "hysteretic_force"))
    assert like is not None
    assert {k: finer.start[f"friction.{k}"] for k in like} == like
    assert like["n"] > 1.1
    assert finer.refines == ("friction.n",)
    monkeypatch.undo()
    after = module._after(fit, smooth, mount, 1)
    assert after is not None
    assert after.fit.rms == pytest.approx(NOISE, rel=0.05)


@pytest.mark.parametrize(
    ("worse", "noise_is_left", "kept"),
    [(True, False, False), (True, True, True), (False, False, True)],
)
def test_who_does_no_better_than_whom_it_imitates_counts_where_noise_is_left(
    rubbed: tuple[po.Fit, Rung, Rung, list[Rung]], monkeypatch: pytest.MonkeyPatch,
    worse: bool, noise_is_left: bool, kept: bool,
) -> None:  # fmt: skip
    """Fewer parameters had beaten a mount beside which the next effect is seen better."""
    fit, smooth, mount, both = rubbed
    led = both[worse]
    monkeypatch.setattr(module, "_NEAR", 1.02)
    monkeypatch.setattr(module, "settled", lambda _: False)
    monkeypatch.setattr(module, "_explained", lambda _: False)
    monkeypatch.setattr(module, "explained", lambda _: noise_is_left)
    monkeypatch.setattr(module, "_chance", lambda _, rung, *__: Chance(rung, rung.suspect, ()))
    monkeypatch.setattr(module, "_further", lambda _, chance, *__, **___: chance.rung)
    monkeypatch.setattr(module, "_after", lambda *_: led)
    found = contest(fit, [smooth, mount], fit.question, 1)
    assert any(rung.fit is led.fit for rung in found) is kept


def test_another_form_is_asked_for_mechanics_too(
    rubbed: tuple[po.Fit, Rung, Rung, list[Rung]], monkeypatch: pytest.MonkeyPatch
) -> None:
    fit, smooth, _, (led, _) = rubbed
    asked: list[tuple[Rung, Rung]] = []
    monkeypatch.setattr(module, "explained", lambda _: False)
    monkeypatch.setattr(module, "_best", lambda *_: led)
    monkeypatch.setattr(
        module, "_moving", lambda _, before, best, *__: asked.append((before, best)) or best
    )
    assert smooth.suspect is not None
    assert module._formed(fit, smooth, smooth.suspect, 1) is led
    assert asked == [(smooth, led)]


def in_the_contest(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of those who are brought to their best from now on, which is left undone."""
    names: list[str] = []

    def watched(_: po.Fit, rung: Rung, *__: object) -> Chance:
        assert rung.suspect is not None
        names.append(rung.suspect.name)
        return Chance(rung, rung.suspect, ())

    monkeypatch.setattr(module, "_chance", watched)
    monkeypatch.setattr(module, "_further", lambda _, chance, *__, **___: chance.rung)
    return names


@pytest.mark.parametrize(("error", "fought"), [(1.55, True), (1.65, False)])
def test_who_is_far_behind_an_effect_that_leaves_more_is_not_in_the_contest(
    error: float, fought: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A lag left 3 noises of 19, and whoever left 7 was brought to its best as well."""
    time = clock(500)
    fit = fitted(STILL, measured(STILL, time, rich(time), (Creep(elements=1), {})))
    (suspect,) = score(BasePoint(fit), [Drift()])[0][:1]
    rungs = [
        Rung(replace(adding(fit, suspect), suspect=replace(suspect, name=one.name)),
             replace(fit, readings=tuple(r.position + times * NOISE for r in fit.records)), 0.0)
        for one, times in ((Drift(), error), (AmplifierLag(), 1.0))
    ]  # fmt: skip
    asked = in_the_contest(monkeypatch)
    monkeypatch.setattr(module, "_explained", lambda _: False)
    monkeypatch.setattr(module, "settled", lambda _: False)
    monkeypatch.setattr(module, "_after", lambda *_: None)
    contest(fit, rungs, fit.question, 1)
    assert asked == (["amplifier_lag", "drift"] if fought else ["amplifier_lag"])


def test_where_the_best_leaves_no_structure_only_close_ones_are_in_the_contest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    time = clock(2000)
    creep = Creep(elements=1), {"c": 0.03, "tau": 0.1}
    fit = fitted(STILL, measured(STILL, time, rich(time), creep))
    suspects, _ = score(BasePoint(fit), [Creep(elements=1), Drift(), AmplifierLag()])
    rungs = race(fit, [adding(fit, s) for s in suspects], 1)
    best = min(r.fit.rms for r in rungs)
    far = {r.suspect.name for r in rungs if r.suspect and r.fit.rms > 1.25 * best}
    assert far
    fought = in_the_contest(monkeypatch)
    monkeypatch.setattr(module, "_explained", lambda _: False)
    monkeypatch.setattr(module, "_NEAR", 100.0)
    for quiet in (True, False):
        fought.clear()
        monkeypatch.setattr(module, "settled", lambda _, quiet=quiet: quiet)
        contest(fit, rungs, fit.question, 1)
        assert bool(far & set(fought)) is not quiet
        assert "creep" in fought


@pytest.mark.parametrize("afresh", [True, False])
def test_who_leaves_but_noise_begins_afresh_only_where_it_is_doubted(
    afresh: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    time = clock(2000)
    creep = Creep(elements=1), {"c": 0.03, "tau": 0.1}
    fit = fitted(MOVING, measured(MOVING, time, rich(time), creep))
    suspects, _ = score(BasePoint(fit), [Creep(elements=1), Drift()])
    rungs = race(fit, [adding(fit, s) for s in suspects], 1)
    fought: list[Rung] = []

    def watched(_: po.Fit, rung: Rung, *__: object) -> Chance:
        assert rung.suspect is not None
        fought.append(rung)
        return Chance(rung, rung.suspect, ())

    monkeypatch.setattr(module, "_chance", watched)
    monkeypatch.setattr(module, "_further", lambda _, chance, *__, **___: chance.rung)
    contest(fit, rungs, fit.question, 1, afresh=afresh)
    assert bool(fought) is afresh


def test_a_contender_has_a_second_start_where_its_shapes_may_be_elsewhere(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of two presliding distances the wrong one may be ahead beside a loop that is not round."""
    time = clock(2000)
    law = {"F": 0.05, "z0": 1e-7}
    fit = fitted(MOVING, measured(MOVING, time, rich(time), (Friction(), law)))
    (suspect,), _ = score(BasePoint(fit), [Friction()])
    trial = adding(fit, suspect)
    starts = joint_starts(fit.question.with_model(MOVING + Friction()), "friction")
    assert len(starts) == 2
    first, second = (start["friction.z0"] for start in starts)
    assert not 1.0 / 3.0 < first / second < 3.0
    assert joint_start(fit.question.with_model(MOVING + Friction()), "friction") == starts[0]
    assert joint_starts(fit.question.with_model(MOVING + Friction()), "friction", 2) == starts
    stuck = Rung(trial, solved(trial.question, {**trial.start, "friction.z0": 1.0}, 1), 0.0)
    wrong = {**trial.start, "friction.F": 1e-3, "friction.z0": 1.0}
    right = {**trial.start, **{f"friction.{k}": v for k, v in law.items()}}
    monkeypatch.setattr(module, "joint_starts", lambda *_: (wrong, right))
    monkeypatch.setattr(module, "_founded", lambda _, rung, __: rung)
    chance = module._chance(fit, stuck, fit.question, 1)
    assert chance.rung.fit.rms > 2.0 * NOISE
    best = module._further(fit, chance, 1, over=False)
    assert best.fit.values["friction.z0"] == pytest.approx(1e-7, rel=0.05)
    assert best.fit.rms == pytest.approx(NOISE, rel=0.05)
    # Where another contender has left but noise nobody begins once more.
    assert module._further(fit, chance, 1, over=True).fit.rms > 2.0 * NOISE


def test_mechanics_that_nothing_shook_may_be_spared() -> None:
    """Beside what they had been mistaken for; where they ring, or are needed, they stay."""
    time = clock(2000)
    slow = triangle(time, 0.7)
    quiet = fitted(MOVING, measured(STILL, time, slow, CUBED))
    assert "second_order" in quiet.model
    still = stilled(quiet)
    assert still is not None
    assert still.model.names == ("piezo_gain", "bouc_wen", "offset")
    assert bic_gain(still, quiet) < STRONG
    assert stilled(still) is None
    shaken = fitted(MOVING, measured(MOVING, time, rich(time)))
    assert stilled(shaken) is None
    rubbing = quiet.question.with_model(MOVING + Friction())
    assert stilled(solved(rubbing, {**quiet.values, "friction.F": 1e-3}, 1)) is None


def test_mechanics_that_a_shape_hides_join_once_it_is_in_detail() -> None:
    """While a sharp saturation is taken for a soft one, nothing is seen to ring."""
    time = clock(4000)
    law = {"s": 1.0, "v_s": 50.0, "softness": 1e-3}
    moving = {**TRUTH, "second_order.omega": 600.0, "second_order.zeta": 0.03}
    drive = triangle(time, 0.7)
    blank = po.Measurement(time, drive, drive, allow_saturated=True)
    values = {**moving, **{f"saturation.{k}": v for k, v in law.items()}}
    reading = po.simulate(MOVING + Saturation(), blank, values).reading
    white = np.random.default_rng(0).normal(size=time.size)
    fit = fitted(STILL, blank.with_(position=reading + NOISE * white))
    (suspect, *_), _ = score(BasePoint(fit), [Saturation()])
    (rung,) = race(fit, [adding(fit, suspect)], 1)
    assert module._founded(fit, rung, 1) is rung
    best = module._detailed(fit, rung, suspect, 1)
    assert best.fit.values["second_order.omega"] == pytest.approx(600.0, rel=0.01)
    assert best.fit.rms == pytest.approx(NOISE, rel=0.03)
    # Where no shape is better nothing else is asked for.
    assert module._moving(fit, rung, rung, suspect, 1) is rung


@pytest.mark.parametrize(
    ("form", "noise", "taken"),
    [
        (SlewLimit(behind=True), False, False),
        (SlewLimit(behind=True), True, True),
        (SlewLimit(), False, True),
    ],
)
def test_what_holds_a_simpler_effect_is_one_where_it_leaves_but_noise(
    form: Effect, noise: bool, taken: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An amplifier that lags below its limit is ahead of every lag where more is hidden."""
    richer: Any = SimpleNamespace(model={"slew_limit": form})
    monkeypatch.setattr(module, "solved", lambda *_: richer)
    monkeypatch.setattr(module, "bic_gain", lambda *_: 1.0)
    monkeypatch.setattr(module, "plausible", lambda _: True)
    monkeypatch.setattr(module, "explained", lambda _: noise)
    suspect: Any = SimpleNamespace(name="slew_limit")
    trial = Trial(richer, {}, suspect)
    assert (module._fitted(richer, trial, suspect) is not None) == taken


@pytest.mark.parametrize(("caught", "asked"), [(1.02, ["mount"]), (1.2, [])])
def test_whom_another_one_has_caught_up_with_is_compared_in_its_own_details(
    caught: float, asked: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Alone near the noise it needs none, until one that began where it is has got its own."""

    def rung(name: str, error: float) -> Any:
        model = SimpleNamespace(quasi_static=False)
        one = SimpleNamespace(rms=error, model=model, question=None)
        return SimpleNamespace(fit=one, suspect=SimpleNamespace(name=name), delta_bic=1.0)

    seen: list[str] = []

    def shaped(_: Any, found: Any, __: int) -> Any:
        seen.append(found.suspect.name)
        return found

    monkeypatch.setattr(module, "_explained", lambda _: True)
    monkeypatch.setattr(module, "massless", lambda _: False)
    monkeypatch.setattr(module, "_simpler", lambda one, other: one is not other)
    monkeypatch.setattr(module, "_after", lambda *_: rung("friction", caught))
    monkeypatch.setattr(module, "_founded", lambda _, found, __: found)
    monkeypatch.setattr(module, "_shaped", shaped)
    monkeypatch.setattr(module, "judged", lambda _, rungs: list(rungs))
    below: Any = SimpleNamespace(rms=4.5)
    found = contest(below, [rung("mount", 1.0), rung("friction", 1.3)], below)
    assert seen == asked
    assert len(found) == 3 + len(asked)
