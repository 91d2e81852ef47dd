"""The whole way: verdict, words and data, the user's own candidates, the user's own say."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace
from importlib import import_module
from types import SimpleNamespace
from typing import Any, final

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.diagnosis import Diagnosis, diagnose
from piezo_opt.diagnosis.noise import Structure
from piezo_opt.diagnosis.told import Rival
from piezo_opt.effects import (
    BoucWen,
    Creep,
    CubicStiffness,
    Effect,
    MainsPickup,
    NonlinearDamping,
    Offset,
    PiezoGain,
    PrandtlIshlinskii,
    SecondOrder,
    SensorNonlinearity,
)
from piezo_opt.effects.base import Chain, Equations, Parameter, Place
from piezo_opt.errors import InputError, ModelError
from piezo_opt.identification import Ending
from tests.diagnosis.plants import (
    MOVING,
    NOISE,
    STILL,
    TRUTH,
    but,
    clock,
    fitted,
    measured,
    minor_loops,
    rich,
    triangle,
)

# The function has the module's name in the package.
module = import_module("piezo_opt.diagnosis.diagnose")
TIME = clock()
CREEP = Creep(elements=1), {"c": 0.02, "tau": 0.5}
FRINGES = SensorNonlinearity(), {"a": 5e-8}
KEYS = {
    "schema", "verdict", "noise_rms", "rms_baseline", "rms_final", "steps", "suspects",
    "unexplained", "advice",
}  # fmt: skip
STEP_KEYS = {
    "effect", "group", "rms_before", "rms_after", "held_out_before", "held_out_after",
    "delta_bic", "p_value", "parameters",
}  # fmt: skip
SUSPECT_KEYS = {"effect", "score", "predicted_rms", "visibility", "overlaps", "p_value"}


FEW = but("creep", "drift", "asymmetry", "friction", "delay")


@pytest.fixture(scope="module")
def creeping() -> po.Fit:
    """Fitted without the creep that is there."""
    return fitted(STILL, measured(STILL, TIME, rich(TIME), CREEP))


@pytest.fixture(scope="module")
def missing(creeping: po.Fit) -> Diagnosis:
    return diagnose(creeping)


@pytest.fixture(scope="module")
def complete() -> Diagnosis:
    return diagnose(fitted(STILL, measured(STILL, TIME, rich(TIME))))


@pytest.fixture(scope="module")
def unexplained() -> Diagnosis:
    """An interferometer's fringes, which the catalogue may not use."""
    fit = fitted(STILL, measured(STILL, TIME, rich(TIME), FRINGES))
    return diagnose(fit, withhold=FEW, effort=po.Effort.QUICK)


def test_missing(missing: Diagnosis) -> None:
    assert missing.verdict == "missing"
    assert [s.name for s in missing.steps] == ["creep"]
    assert missing.best().name == "creep"
    assert missing.final.rms == pytest.approx(NOISE, rel=0.05)
    assert missing.noise.rms == pytest.approx(NOISE, rel=0.1)
    # Nothing is held out of a fit.
    assert missing.final.residuals.size == TIME.size
    assert missing.steps[0].fit.residuals.size == TIME.size


def test_a_reading_that_stands_alone_is_the_first_thing_to_see_to(complete: Diagnosis) -> None:
    """It takes a share of the error that no effect explains, and the ladder a long time."""
    record = complete.fit.records[0]
    reading = np.array(record.position)
    reading[900] += 0.3 * np.ptp(reading)
    question = complete.fit.question.with_records(record.with_(position=reading))
    doubted = replace(complete, fit=replace(complete.fit, question=question))
    assert "1 reading stands alone" in doubted.advice[0]
    assert doubted.advice[1:] == complete.advice
    assert doubted.advice[0] in str(doubted)


def test_complete(complete: Diagnosis) -> None:
    assert complete.verdict == "complete"
    assert complete.steps == ()
    assert complete.final is complete.fit
    with pytest.raises(ModelError, match="nothing to add"):
        complete.best()


def test_unexplained(unexplained: Diagnosis) -> None:
    assert unexplained.verdict == "unexplained"
    assert "sensor_nonlinearity" not in [s.name for s in unexplained.suspects]
    assert unexplained.structure.clues
    assert unexplained.to_dict()["unexplained"] is not None
    none = replace(unexplained, slight=())
    assert "that no effect of the catalogue explains." in str(none)
    some = replace(unexplained, slight=(("creep", 0.2),))
    assert "no effect of the catalogue explains but creep, too slight to be named." in str(some)


def test_what_is_withheld_is_found_when_it_is_not(unexplained: Diagnosis) -> None:
    found = diagnose(unexplained.fit, advise=False)
    assert found.steps[0].name == "sensor_nonlinearity"
    assert found.final.rms == pytest.approx(NOISE, rel=0.05)
    assert found.verdict == "missing"


@pytest.mark.parametrize("which", ["missing", "complete", "unexplained"])
def test_json_has_what_is_promised(which: str, request: pytest.FixtureRequest) -> None:
    diagnosis: Diagnosis = request.getfixturevalue(which)
    data = json.loads(json.dumps(diagnosis.to_dict(), allow_nan=False))
    assert set(data) >= KEYS
    assert data["schema"] == "piezo_opt/diagnosis/1"
    assert data["verdict"] == which
    assert (data["unexplained"] is None) == (which != "unexplained")
    assert len(data["steps"]) == len(diagnosis.steps)
    for step in data["steps"]:
        assert set(step) >= STEP_KEYS
        assert step["effect"] in step["group"]
        assert step["parameters"]
    assert len(data["suspects"]) > (12 if which != "unexplained" else 3)
    assert len({s["effect"] for s in data["suspects"]}) == len(data["suspects"])
    for suspect in data["suspects"]:
        assert set(suspect) == SUSPECT_KEYS
        assert 0.0 <= suspect["score"] <= 1.0
        assert 0.0 <= suspect["p_value"] <= 1.0
        assert 0.0 <= suspect["visibility"] <= 1.0 + 1e-9
        assert suspect["predicted_rms"] <= diagnosis.fit.rms * (1 + 1e-9)
    assert all(isinstance(s, str) and s.endswith(".") for s in data["advice"])
    assert data["rms_baseline"] == diagnosis.fit.rms
    assert 1e-9 < data["rms_final"] < 1e-6


def test_a_deviation_that_is_not_known_is_null(missing: Diagnosis) -> None:
    """A parameter at its bound has no standard deviation; JSON has no NaN."""
    (step,) = missing.steps
    unsure = replace(step.fit, covariance=np.full_like(step.fit.covariance, np.nan))
    data = replace(missing, steps=(replace(step, fit=unsure),)).to_dict()
    assert data["steps"][0]["parameters"]["creep.c"]["std"] is None
    json.dumps(data, allow_nan=False)


def test_an_error_without_end_is_null_and_called_so(missing: Diagnosis) -> None:
    """A record that a model cannot be simulated on is missed by more than any number."""
    (step,) = missing.steps
    lost = replace(step, held_out_before=np.inf, held_out_after=np.inf)
    law = Rival("dahl", 1e-8, np.inf, -4.0, better=False)
    assert missing.foot is not None
    foot = replace(missing.foot, held_out=np.inf)
    diagnosis = replace(missing, steps=(lost,), rivals=(law,), foot=foot)
    data = json.loads(json.dumps(diagnosis.to_dict(), allow_nan=False))
    assert (data["steps"][0]["held_out_before"], data["steps"][0]["held_out_after"]) == (None, None)
    assert data["rivals"][0]["held_out"] is None
    assert str(diagnosis).count("not finite") == 2
    assert not re.search(r"\binf\b", str(diagnosis))


def test_words(missing: Diagnosis, complete: Diagnosis, unexplained: Diagnosis) -> None:
    first = missing.headline
    assert first.startswith("Missing: creep")
    assert "The error falls from " in first
    # What it may be instead stands beside it, and nothing else.
    (step,) = missing.steps
    instead = first.partition("(or ")[2].partition(")")[0].replace(" or ", ", ")
    assert [name for name in instead.split(", ") if name] == list(step.group[1:])
    assert "+ creep" in str(missing)
    assert str(complete).startswith("Complete: the residual of ")
    assert "noise as far as this record can tell" in str(complete)
    assert str(unexplained).startswith("Unexplained: ")
    assert "repeat the drive at least twice" in str(missing)


def test_where_only_noise_is_left_hardly_anything_is_refitted(complete: Diagnosis) -> None:
    """An effect is tried where noise alone would hardly give its score; else it is 27 refits."""
    assert complete.verdict == "complete"
    assert complete.refits <= 9


def test_a_freed_exponent_is_told_with_the_error_that_is_left() -> None:
    blank = measured(STILL, TIME, rich(TIME))
    values = {**fitted(STILL, blank).values, "bouc_wen.n": 1.6}
    reading = po.simulate(STILL, blank, values).reading
    noise = NOISE * np.random.default_rng(1).normal(size=TIME.size)
    found = diagnose(fitted(STILL, blank.with_(position=reading + noise)), advise=False)
    assert found.refined == ("bouc_wen.n",)
    assert found.verdict == "complete"
    assert found.final.rms == pytest.approx(NOISE, rel=0.05)
    first = str(found).splitlines()[0]
    assert "bouc_wen.n" in first
    assert po.quantity(first.split("residual of ")[1].split(",")[0], "m") == pytest.approx(
        found.final.rms, rel=1e-3
    )


def test_scores_alone(creeping: po.Fit) -> None:
    suspects = diagnose(creeping, ladder=False)
    assert suspects.verdict == "open"
    assert suspects.steps == ()
    assert suspects.final is creeping
    assert suspects.best().name == "creep"
    assert str(suspects).startswith("Scores at the fit")
    richer = po.solve(
        po.Identification(creeping.model + suspects.best(), creeping.records[0]), start=creeping
    )
    assert richer.rms == pytest.approx(NOISE, rel=0.05)


def _without_clock(found: Diagnosis) -> dict[str, Any]:
    """What is written of a diagnosis, but for how long it took."""
    told = found.to_dict()
    model = {k: v for k, v in told["final_model"].items() if k != "wall_s"}
    return {**told, "final_model": model, "elapsed_s": None}


def test_a_record_is_fitted_first(creeping: po.Fit) -> None:
    """By the default model, which says what it leaves out; the same as the two calls."""
    record = creeping.records[0]
    model, remarks = po.default_model(record)
    asked = po.Identification(model, record)
    whole = diagnose(record, withhold=FEW, advise=False)
    assert whole.fit.model.names == model.names
    assert remarks
    assert whole.fit.remarks[: len(remarks)] == remarks
    assert [s.name for s in whole.steps] == ["creep"]
    by_hand = diagnose(po.solve(asked), withhold=FEW, advise=False)
    assert _without_clock(whole) == _without_clock(by_hand)
    question = diagnose(asked, ladder=False)
    assert question.fit.values == by_hand.fit.values
    several = diagnose([record, record.with_(name="twice")], ladder=False)
    assert [r.name for r in several.fit.records] == [record.name, "twice"]


@pytest.mark.parametrize("wrong", ["loop.csv", 3, [None]])
def test_what_is_no_record_is_refused(wrong: Any) -> None:
    with pytest.raises(InputError, match=r"is no record: give what piezo_opt\.read returns"):
        diagnose(wrong)


def test_a_misspelt_name_is_not_withheld_in_silence(creeping: po.Fit) -> None:
    with pytest.raises(InputError, match="crep"):
        diagnose(creeping, ladder=False, withhold=["crep"])


def test_an_interrupted_first_fit_is_not_diagnosed(
    creeping: po.Fit, monkeypatch: pytest.MonkeyPatch
) -> None:
    stopped = replace(creeping, outcome=replace(creeping.outcome, ending=Ending.INTERRUPTED))
    monkeypatch.setattr(module, "solve", lambda _, max_time: stopped)  # noqa: ARG005
    with pytest.raises(KeyboardInterrupt):
        diagnose(creeping.question)


def test_another_record_judges(creeping: po.Fit) -> None:
    test = measured(STILL, TIME, triangle(TIME, 1.0), CREEP, seed=5, name="other day")
    found = diagnose(creeping, test=test, advise=False)
    assert "'other day'" in found.held_out
    assert [s.name for s in found.steps] == ["creep"]
    assert found.steps[0].held_out_after == pytest.approx(NOISE, rel=0.1)
    assert found.steps[0].fit.residuals.size == TIME.size


@final
@dataclass(frozen=True)
class Fringes(Effect):
    """The user's own form of an interferometer's error.

    y = x + a sin(2 pi x / pitch)
    """

    place = Place.OUTPUT
    a = Parameter("m", "amplitude", nominal=0.0, bounds=(-1e-6, 1e-6), null=0.0)
    pitch = Parameter("m", "pitch", nominal=316.4e-9, bounds=(1e-8, 1e-5), fixed=True)

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The reading and its periodic error."""
        from piezo_opt.symbolic import sin

        seen = chain.incoming.value
        return Equations(gives=seen + p.a * sin(2.0 * np.pi * seen / p.pitch))


@final
@dataclass(frozen=True)
class Broken(Effect):
    """A user's effect that raises."""

    place = Place.OUTPUT
    a = Parameter("m", "amplitude", nominal=0.0, bounds=(-1e-6, 1e-6), null=0.0)

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Raises."""
        raise RuntimeError("the dog ate it")


def test_the_hum_of_another_country_and_another_laser_are_named() -> None:
    """Sixty hertz were a second mode without damping, and fibre optics nothing at all."""
    train = measured(STILL, TIME, rich(TIME), (MainsPickup(mains=60.0), {"a": 4e-8, "phi": 0.3}))
    found = po.diagnose(fitted(STILL, train), advise=False)
    assert [step.effect for step in found.steps] == [MainsPickup(mains=60.0)]
    assert found.final.rms == pytest.approx(NOISE, rel=0.05)
    assert found.advice[0] == (
        "This record could not have shown load: what it does is hidden behind the fitted "
        "parameters."
    )
    train = measured(STILL, TIME, rich(TIME), (SensorNonlinearity(laser=1.55e-6), {"a": 4e-8}))
    found = po.diagnose(fitted(STILL, train), advise=False)
    assert [step.effect for step in found.steps] == [SensorNonlinearity(laser=1.55e-6)]


def test_the_users_own_effects_compete(unexplained: Diagnosis) -> None:
    found = diagnose(
        unexplained.fit,
        candidates=[Broken, Fringes()],
        withhold=("sensor_nonlinearity", "mains_pickup"),
    )
    assert found.steps[0].name == "fringes"
    assert found.verdict == "missing"
    assert found.final.values["fringes.a"] == pytest.approx(5e-8, rel=0.05)
    (failed,) = (u for u in found.unscored if u.name == "broken")
    assert f"{__file__}, line " in failed.why
    assert "RuntimeError: the dog ate it" in failed.why
    assert "the dog ate it" in str(found)


def test_progress_is_told(creeping: po.Fit) -> None:
    said: list[str] = []
    diagnose(creeping, advise=False, progress=said.append)
    assert said[0].startswith("the base model leaves 13.55 nm")
    assert any("creep" in s or "sensor_lag" in s for s in said if s.startswith("with "))
    assert not any("drives" in s for s in said)


def test_answers_repeat(creeping: po.Fit, missing: Diagnosis) -> None:
    again = diagnose(creeping, threads=1)
    assert _without_clock(again) == _without_clock(missing)


def test_an_explanation_that_does_not_carry_over_is_none() -> None:
    """Creep is in both records, a resonance only in what the second one excites."""
    slow = measured(STILL, TIME, rich(TIME), CREEP)
    shaken = 30.0 + 25.0 * np.sin(2.0 * np.pi * 60.0 * TIME)
    test = measured(MOVING, TIME, shaken, CREEP, name="shaken")
    quiet = measured(STILL, TIME, triangle(TIME, 1.0), CREEP, name="quiet")
    fit = fitted(STILL, slow)
    found = diagnose(fit, test=test, advise=False)
    assert [s.name for s in found.steps] == ["creep"]
    assert found.verdict == "unexplained"
    assert any("does not carry over" in clue for clue in found.structure.clues)
    # Nothing is left here; the first line must not say that the catalogue lacks something.
    assert "the record that is judged on is not predicted as well" in found.headline
    kept = diagnose(fit, test=quiet, advise=False)
    assert [s.name for s in kept.steps] == ["creep"]
    assert kept.verdict == "missing"


@pytest.mark.parametrize(
    ("here", "there", "carries"),
    [
        # An effect that is just worth its name (0.35) beside the noise makes 1.06 of it.
        (1.05, 2.9 * 1.05, True), (1.05, 3.1 * 1.05, False),
        # What is above the floor may be slow noise, but that is as large on the other record.
        (1.07, 1.4 * 1.07, True), (1.07, 1.6 * 1.07, False), (1.05, np.inf, False),
    ],
)  # fmt: skip
def test_slow_noise_is_as_large_on_the_other_record(
    here: float, there: float, carries: bool
) -> None:
    judge: Any = SimpleNamespace(record=SimpleNamespace(name="test"), error=lambda _: there)
    floor: Any = SimpleNamespace(rms=1.0, high=1.0)
    for steps in (("drift",), ()):
        answer: Any = SimpleNamespace(steps=steps, final=SimpleNamespace(rms=here))
        left = module._elsewhere(Structure(False, ()), answer, judge, floor, 0.35)
        # With nothing found there is nothing that could carry over: a base model may miss more.
        assert left.left == (np.isinf(there) or (bool(steps) and not carries))
        assert any("is not finite" in clue for clue in left.clues) == np.isinf(there)


def test_a_resonator_without_a_loop_gets_the_damping_that_it_lacks() -> None:
    """Quadratic, of a drive of many lines; what needs a loop is no reason to stop."""
    time = clock(1200)
    phases = np.random.default_rng(5).uniform(0.0, 2.0 * np.pi, 80)
    lines = 1.0 + np.arange(80)
    drive = 4.0 * np.cos(2.0 * np.pi * np.outer(time, lines) + phases).sum(axis=1)
    base = PiezoGain() + SecondOrder() + Offset()
    record = measured(base, time, drive, (NonlinearDamping(), {"b": 3e4}))
    kept = but("nonlinear_damping", "friction", "asymmetry", "slew_limit")
    found = diagnose(po.Identification(base, record), advise=False, withhold=kept)
    assert (found.verdict, [step.name for step in found.steps]) == (
        "missing",
        ["nonlinear_damping"],
    )
    assert found.final.values["nonlinear_damping.b"] == pytest.approx(3e4, rel=0.02)
    assert found.final.rms == pytest.approx(NOISE, rel=0.05)


def test_a_record_that_the_base_model_is_not_finite_on_judges_nothing() -> None:
    """A softening spring has a largest stroke."""
    time = clock(600)
    drive = 12.0 * np.sin(2 * np.pi * 10.0 * time)
    small = measured(MOVING, time, drive, (CubicStiffness(), {"k3": -4e15}))
    model, start = MOVING + CubicStiffness(), {**TRUTH, "cubic_stiffness.k3": -4e15}
    fit = po.solve(po.Identification(model, small), start=start)
    far = small.with_(drive=8.0 * drive).rename("far")
    found = diagnose(fit, test=far, advise=False, withhold=but("creep"))
    assert (found.verdict, found.steps) == ("unexplained", ())
    assert any("'far', the model is not finite" in clue for clue in found.structure.clues)
    assert "the record that is judged on is not predicted as well" in found.headline


def _played(noise: float) -> po.Fit:
    """Bouc-Wen fitted to a loop of play operators."""
    record = minor_loops(PrandtlIshlinskii(), {"r": 24.0, "rho": 3e-8}, noise)
    return po.solve(po.Identification(STILL, record))


def test_another_law_takes_the_place_of_one_that_leaves_more_than_noise() -> None:
    """Plays: of Prandtl and Ishlinskii, or of Preisach, who has them as well."""
    fit = _played(2e-9)
    assert fit.rms > 5.0 * 2e-9
    found = diagnose(fit, advise=False, withhold=FEW)
    assert (found.verdict, found.steps, found.refined) == ("complete", (), ())
    best = found.rivals[0]
    assert best.name in {"prandtl_ishlinskii", "preisach"}
    assert found.final.model.names == ("piezo_gain", best.name, "offset")
    assert found.final.rms == pytest.approx(2e-9, rel=0.02)
    assert best.better
    assert best.rms == pytest.approx(2e-9, rel=0.02)
    assert found.to_dict()["rivals"][0]["better"] is True
    assert found.headline.startswith(f"Complete, with {best.name} in the place of bouc_wen: ")
    assert "fits better than the model's own law" in str(found)
    assert [point.label for point in found.ladder] == ["baseline", f"with {best.name}"]


def test_the_true_law_is_not_left() -> None:
    record = minor_loops(BoucWen(), {"beta": 0.05}, NOISE)
    found = diagnose(po.Identification(STILL, record), advise=False)
    assert (found.verdict, found.final.model.names) == ("complete", STILL.names)
    assert not any(r.better for r in found.rivals)


def test_a_model_without_a_loop_has_no_law_to_replace() -> None:
    line = PiezoGain() + Offset()
    blank = po.Measurement(TIME, rich(TIME), rich(TIME), allow_saturated=True)
    reading = po.simulate(line, blank, {"piezo_gain.d": 1.2e-7}).reading
    noise = NOISE * np.random.default_rng(3).normal(size=TIME.size)
    fit = po.solve(po.Identification(line, blank.with_(position=reading + noise)))
    assert diagnose(fit, advise=False).rivals == ()
