"""Laws of the search: on linear members it is enumeration, and nothing depends on the way."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations
from math import comb, log
from typing import Any, ClassVar, final

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.benchmark import plants
from piezo_opt.benchmark.hidden import measurement
from piezo_opt.diagnosis import Diagnosis, diagnose
from piezo_opt.diagnosis.book import Book
from piezo_opt.diagnosis.frontier import Effort
from piezo_opt.diagnosis.members import Members
from piezo_opt.diagnosis.moves import adds, imitations
from piezo_opt.diagnosis.noise import is_noise, noise_floor
from piezo_opt.diagnosis.refit import refit
from piezo_opt.diagnosis.richer import finer_form, in_detail
from piezo_opt.diagnosis.scores import scored
from piezo_opt.diagnosis.search import _exchanged
from piezo_opt.effects import (
    AmplifierLag,
    ChargeBackCoupling,
    Creep,
    CubicStiffness,
    DeadZone,
    Duhem,
    Effect,
    Friction,
    HystereticForce,
    MaxwellSlip,
    Offset,
    PiezoGain,
    RateDependence,
    Saturation,
    SecondOrder,
    SensorLag,
    SlewLimit,
    Spring,
)  # fmt: skip
from piezo_opt.effects.base import Chain, Equations, Parameter, Place
from piezo_opt.effects.catalogue import CATALOGUE
from piezo_opt.effects.model import Model
from piezo_opt.measurement import FloatArray
from piezo_opt.symbolic import sin
from tests.diagnosis.plants import MOVING, STILL, but, clock, fitted, measured, opened, rich


@final
@dataclass(frozen=True)
class Pitched(Effect):
    """A tone of a frequency that has to be given."""

    frequency: float
    place = Place.OUTPUT
    a = Parameter("m", "amplitude", nominal=0.0, bounds=(-1e-6, 1e-6), null=0.0)

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """y = x + a sin(2 pi f t)."""
        return tone(self.frequency, chain, p)


LINE = PiezoGain() + Offset()
TIME = clock(1200)
NOISE = 5e-9


AMPLITUDE = Parameter("m", "amplitude", nominal=0.0, bounds=(-1e-6, 1e-6), null=0.0)


def tone(frequency: float, chain: Chain, p: Any) -> Equations:
    """y = x + a sin(2 pi f t), linear in its only parameter."""
    return Equations(gives=chain.incoming.value + p.a * sin(2.0 * np.pi * frequency * chain.time))


@final
@dataclass(frozen=True)
class ToneA(Effect):
    """A tone of 3.0 Hz."""

    frequency: ClassVar[float] = 3.0
    place = Place.OUTPUT
    a = AMPLITUDE

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The reading with the tone."""
        return tone(3.0, chain, p)


@final
@dataclass(frozen=True)
class ToneB(Effect):
    """A tone of 3.4 Hz."""

    frequency: ClassVar[float] = 3.4
    place = Place.OUTPUT
    a = AMPLITUDE

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The reading with the tone."""
        return tone(3.4, chain, p)


@final
@dataclass(frozen=True)
class ToneC(Effect):
    """A tone of 5.0 Hz."""

    frequency: ClassVar[float] = 5.0
    place = Place.OUTPUT
    a = AMPLITUDE

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The reading with the tone."""
        return tone(5.0, chain, p)


@final
@dataclass(frozen=True)
class ToneD(Effect):
    """A tone of 11.0 Hz."""

    frequency: ClassVar[float] = 11.0
    place = Place.OUTPUT
    a = AMPLITUDE

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The reading with the tone."""
        return tone(11.0, chain, p)


Tone = ToneA | ToneB | ToneC | ToneD
TONES: tuple[Tone, ...] = (ToneA(), ToneB(), ToneC(), ToneD())


def tones(**sizes: float) -> po.Measurement:
    """A straight actuator with tones of given amplitudes [m] in its reading."""
    waves = {t.name: np.sin(2.0 * np.pi * t.frequency * TIME) for t in TONES}
    reading = 1.2e-7 * rich(TIME) + sum(a * waves[name] for name, a in sizes.items())
    noise = NOISE * np.random.default_rng(7).normal(size=TIME.size)
    return po.Measurement(TIME, rich(TIME), reading + noise, allow_saturated=True)


def searched(record: po.Measurement, offered: tuple[Tone, ...] = TONES) -> Diagnosis:
    return diagnose(
        po.Identification(LINE, record), candidates=offered, withhold=tuple(CATALOGUE),
        advise=False, effort=po.Effort.THOROUGH, worth=0.05,
    )  # fmt: skip


def enumerated(record: po.Measurement) -> set[str]:
    """The set of least extended BIC, by least squares on all sixteen."""
    n, base = TIME.size, [rich(TIME), np.ones_like(TIME)]

    def criterion(chosen: tuple[Tone, ...]) -> float:
        columns: list[FloatArray] = [
            *base,
            *(np.sin(2.0 * np.pi * t.frequency * TIME) for t in chosen),
        ]
        matrix = np.column_stack(columns)
        size, *_ = np.linalg.lstsq(matrix / np.abs(matrix).max(axis=0), record.position)
        left = record.position - matrix / np.abs(matrix).max(axis=0) @ size
        price = len(columns) * log(n) + 2.0 * log(comb(len(TONES), len(chosen)))
        return n * log(float(left @ left) / n) + price

    sets = [s for k in range(len(TONES) + 1) for s in combinations(TONES, k)]
    return {tone.name for tone in min(sets, key=criterion)}


@pytest.mark.parametrize(
    "sizes",
    [
        {}, {"tone_a": 6e-9}, {"tone_b": 6e-9, "tone_d": 4e-9},
        # The two neighbours nearly cancel: neither explains much alone.
        {"tone_a": 2e-8, "tone_b": -2e-8}, {"tone_b": 9e-9, "tone_c": 5e-9, "tone_d": 4e-9},
    ],
)  # fmt: skip
def test_on_linear_members_the_search_is_enumeration(sizes: dict[str, float]) -> None:
    record = tones(**sizes)
    found = searched(record)
    assert {step.name for step in found.steps} == enumerated(record) == set(sizes)
    # What the user reads is the final model.
    assert set(found.final.model.names) == {*LINE.names, *sizes}


def test_the_order_of_candidates_changes_nothing() -> None:
    record = tones(tone_a=2e-8, tone_b=-2e-8, tone_d=4e-9)
    one, other = searched(record), searched(record, TONES[::-1])
    assert [s.name for s in one.steps] == [s.name for s in other.steps]
    assert one.final.rms == pytest.approx(other.final.rms, rel=1e-9)


def test_rescaled_lengths_change_nothing() -> None:
    record = tones(tone_b=6e-9, tone_d=4e-9)
    larger = record.with_(position=8.0 * record.position)
    one, other = searched(record), searched(larger)
    assert [s.name for s in one.steps] == [s.name for s in other.steps]
    assert other.final.rms == pytest.approx(8.0 * one.final.rms, rel=1e-6)


def test_a_set_is_the_same_whichever_way_it_was_reached() -> None:
    base = Members(STILL)
    one = base.with_(Creep()).with_(Saturation())
    other = base.with_(Saturation()).with_(DeadZone()).with_(Creep()).without("dead_zone")
    assert one == other
    assert hash(one) == hash(other)
    assert one.model.names == other.model.names


def test_an_effect_that_only_the_end_shows_is_found() -> None:
    """One peak near the end alone goes beyond the amplifier's range; nothing is held out."""
    time = clock(1500)
    drive = 30.0 + 20.0 * np.sin(2 * np.pi * 2.3 * time)
    late = (time > 1.3) & (time < 1.4)
    drive[late] += 20.0 * np.sin(np.pi * (time[late] - 1.3) / 0.1) ** 2
    hidden = Saturation(), {"s": 1.0, "v_s": 55.0, "softness": 0.005}
    record = measured(MOVING, time, drive, hidden)
    found = diagnose(record, advise=False, withhold=but("saturation", "creep", "asymmetry"))
    assert [step.name for step in found.steps] == ["saturation"]
    assert found.final.values["saturation.v_s"] == pytest.approx(55.0, abs=0.2)
    assert found.final.rms == pytest.approx(NOISE, rel=0.05)


def test_a_limited_rate_may_be_another_downwards() -> None:
    time = clock(1500)
    drive = 30.0 + 15.0 * np.sin(2 * np.pi * 2.3 * time)
    late = (time > 1.2) & (time < 1.4)
    drive[late] += 12.0 * np.sign(np.sin(2 * np.pi * 20.0 * (time[late] - 1.2)))
    own = {"share": 1.0, "rate": 1500.0, "fall": 2.5, "tau": 1e-3, "softness": 0.05}
    record = measured(STILL, time, drive, (SlewLimit(), own))
    found = diagnose(record, advise=False, withhold=but("slew_limit", "amplifier_lag", "creep"))
    assert [step.name for step in found.steps] == ["slew_limit"]
    rate, fall = (found.final.values[f"slew_limit.{k}"] for k in ("rate", "fall"))
    assert rate == pytest.approx(1500.0, rel=0.03)
    assert rate * fall == pytest.approx(3750.0, rel=0.03)


def test_what_shows_in_a_detail_alone_is_found() -> None:
    """A guide unstrained in the middle of the stroke: about zero its cube is another one."""
    time = clock(1500)
    own = {"k3": 3e15, "x0": 3.6e-6}
    record = measured(MOVING, time, rich(time), (CubicStiffness(), own))
    found = diagnose(record, advise=False)
    assert [step.name for step in found.steps] == ["cubic_stiffness"]
    assert found.final.values["cubic_stiffness.x0"] == pytest.approx(3.6e-6, rel=0.02)
    assert found.final.rms == pytest.approx(NOISE, rel=0.05)


def test_a_third_more_than_the_noise_is_no_noise() -> None:
    """What could bear a name is looked for, also where half of what is left is the noise."""
    time = clock(2000)
    white = NOISE * np.random.default_rng(3).normal(size=time.size)
    hum = 0.83 * np.sqrt(2.0) * NOISE * np.sin(2.0 * np.pi * 37.0 * time)
    record = measured(STILL, time, rich(time), noise=white + hum)
    fit = po.solve(po.Identification(STILL, record))
    assert fit.rms == pytest.approx(1.3 * noise_floor(fit).rms, rel=0.08)
    assert not is_noise(fit, 0.35)
    assert is_noise(fit, 1.0)


def test_two_effects_of_ones_own_each_keep_their_equations() -> None:
    values = {"piezo_gain.d": 0.0, "tone_a.a": 2e-7, "tone_b.a": -1e-7}
    reading = po.simulate(LINE + ToneA() + ToneB(), tones(), values).reading
    expected = 2e-7 * np.sin(6.0 * np.pi * TIME) - 1e-7 * np.sin(6.8 * np.pi * TIME)
    np.testing.assert_allclose(reading, expected, rtol=0, atol=1e-18)


ROUGH_LOOP = {
    "piezo_gain.d": 1.2e-7, "maxwell_slip.r": 40.0,
    **{f"maxwell_slip.h{i}": h for i, h in enumerate([2.4e-7, 0, 1.6e-7, 0, 0, 0.9e-7, 0, 0], 1)},
    **{f"maxwell_slip.q{i}": q for i, q in enumerate([0.9, 0.4, 0.9, 0.9, 0.4, 0.9, 0.9], 2)},
}  # fmt: skip
"""Three elements that slip at 40, 14 and 4.7 V: corners that no smooth law has."""


def beside_another_law(values: dict[str, float], law: Effect, hidden: Effect) -> po.Measurement:
    """A record of another law than the default one, with an effect."""
    time = clock(2000)
    drive = rich(time)
    blank = po.Measurement(time, drive, drive)
    reading = po.simulate(PiezoGain() + law + hidden + Offset(), blank, values).reading
    noise = NOISE * np.random.default_rng(5).normal(size=time.size)
    return blank.with_(position=reading + noise)


@pytest.mark.parametrize(
    ("law", "values", "hidden", "own"),
    [
        (MaxwellSlip(free=True), ROUGH_LOOP, Creep(1), {"creep.c": 0.05, "creep.tau": 0.2}),
        (
            MaxwellSlip(), {"maxwell_slip.h": 4e-7, "maxwell_slip.r": 40.0},
            RateDependence(lagging=True),
            {"rate_dependence.share": 0.5, "rate_dependence.tau": 0.03},
        ),
        (
            Duhem(), {"duhem.sigma": 6e-8, "duhem.beta": 0.05},
            Saturation(), {"saturation.s": 0.7, "saturation.v_s": 50.0},
        ),
    ],
    ids=["rough loop", "late plays", "duhem"],
)  # fmt: skip
def test_an_effect_is_named_beside_a_law_that_is_not_the_base_model_s(
    law: Effect, values: dict[str, float], hidden: Effect, own: dict[str, float]
) -> None:
    few = but("creep", "saturation", "rate_dependence", "asymmetry", "sensor_lag")
    record = beside_another_law({**values, **own}, law, hidden)
    found = diagnose(record, advise=False, withhold=few)
    assert [step.name for step in found.steps] == [hidden.name]
    assert found.final.rms == pytest.approx(NOISE, rel=0.06)
    assert found.final.model.hysteresis != "bouc_wen"


def test_the_rivals_of_an_answer_that_leaves_only_noise_are_fitted_apart() -> None:
    """A hysteretic force comes to 1.04 times the noise, the friction that is there to 1.00."""
    train, _ = plants.make(("friction",), 970, samples=8000, level="standard")
    record = measurement(train, "record")
    model, _ = po.default_model(record)
    kept = {"friction", "hysteretic_force", "bouc_wen", "generalised_bouc_wen", "duhem"}
    withheld = tuple(name for name in CATALOGUE if name not in kept)
    found = diagnose(po.Identification(model, record), advise=False, withhold=withheld)
    assert [step.name for step in found.steps] == ["friction"]
    assert found.final.rms == pytest.approx(train.noise_rms, rel=0.02)


def test_a_lag_enters_with_two_poles_as_well() -> None:
    book = opened()
    (suspect, *_), _ = scored(book.foot, (SensorLag(),), 1, book.colour)
    starts = adds(book.base, (replace(suspect, wrong_side=False),), 1, book)
    assert {start.members.effects for start in starts} == {(SensorLag(),), (SensorLag(poles=2),)}


def test_a_form_that_holds_another_effect_begins_where_that_was_found() -> None:
    """Also in the place of its own simpler form beside it: one name instead of two."""
    time = clock(600)
    fit = po.solve(po.Identification(MOVING, measured(MOVING, time, rich(time))))
    lagging = Members(MOVING).with_(AmplifierLag())
    for at in (lagging, lagging.with_(ChargeBackCoupling())):
        values = {**fit.values, "amplifier_lag.share": 0.9, "amplifier_lag.tau": 2e-3}
        values |= {"charge_back_coupling.kappa": 0.1, "charge_back_coupling.tau": 2e-3}
        there = refit(at.question(fit.question), values, 0)
        book = Book(fit, 1, 1)
        (start,) = imitations(at, there, ChargeBackCoupling.entries(), book)
        assert start.members.effects == (ChargeBackCoupling(whole=True),)
        values = start.values or {}
        assert values["charge_back_coupling.tau"] == 2e-3
        assert values["charge_back_coupling.back"] == 0.0


def test_an_effect_of_ones_own_may_need_an_option() -> None:
    """Nothing can be made of its class alone."""
    book = opened()
    (one,) = Pitched(3.0).forms
    assert one == Pitched(3.0)
    assert not imitations(book.base.with_(Creep(1)), book.foot, (Pitched(3.0),), book)


def test_another_form_of_an_effect_begins_with_what_the_effect_does() -> None:
    time = clock(600)
    at = Members(MOVING).with_(ChargeBackCoupling(poles=2))
    foot = fitted(MOVING, measured(MOVING, time, rich(time)))
    own = {"charge_back_coupling.kappa": 6.0, "charge_back_coupling.tau": 2e-3}
    fit = refit(at.question(foot.question), {**foot.values, **own}, 0)
    whole = ChargeBackCoupling(poles=2, whole=True)
    (start,) = (
        start for asked, start in in_detail(fit) if asked.model["charge_back_coupling"] == whole
    )
    assert start["charge_back_coupling.back"] == pytest.approx(3e3)


def test_a_spring_without_mass_comes_and_goes_with_the_forces_on_it() -> None:
    bare = Members(STILL)
    forced = bare.with_(Friction())
    assert forced.model == STILL + Spring() + Friction()
    asked = po.Identification(STILL, measured(STILL, clock(600), rich(clock(600))))
    # Scored forces stand on a spring that was put behind the whole chain.
    there = asked.with_model(STILL + Creep() + Spring() + Friction())
    assert Members.of(there, asked) == forced.with_(Creep())
    assert forced.with_(Creep()).without("friction") == bare.with_(Creep())
    # The user's own stays, and mechanics with a mass need none.
    own = asked.with_model(STILL + Spring())
    assert Members.of(own, own).with_(Creep()).without("creep").model == STILL + Spring()
    assert Members(MOVING).with_(Friction()).model == MOVING + Friction()


@pytest.mark.parametrize("base", [STILL, STILL + Spring()])
def test_a_force_is_named_where_a_record_is_too_slow_for_its_resonance(base: Model) -> None:
    time = clock()
    drive = rich(time) + 3.0 * np.sin(2.0 * np.pi * 5.0 * time)
    slipping = Friction(), {"F": 0.5, "z0": 3e-7}
    record = measured(STILL + Spring(), time, drive, slipping)
    found = diagnose(fitted(base, record), withhold=but("friction"), threads=1, advise=False)
    (step,) = found.steps
    assert found.verdict == "missing"
    assert step.name == "friction"
    assert found.final.model == STILL + Spring() + Friction()
    assert found.final.rms < 1.05 * NOISE < 0.3 * found.fit.rms
    # No detail is told for what another start of the plain set does as well.
    assert found.refined == ()
    assert found.ladder[-1].label == "+ friction"


def test_what_follows_the_velocity_and_is_no_force_needs_a_mass() -> None:
    """Of a spring without one the velocity is that of the drive, which would follow from itself."""
    time = clock(600)
    for model, found in ((STILL, 0), (MOVING, 1)):
        fit = fitted(model, measured(model, time, rich(time)))
        at = Members(model).with_(AmplifierLag()).with_(Friction())
        values = {**fit.values, "amplifier_lag.share": 0.9, "amplifier_lag.tau": 2e-3}
        there = refit(at.question(fit.question), values, 0)
        starts = imitations(at, there, (ChargeBackCoupling(whole=True),), Book(fit, 1, 1))
        assert len(starts) == found


def test_on_a_spring_without_mass_a_force_stays_as_it_is() -> None:
    """What more elements remember there, a hysteresis law remembers as well."""
    values = {"hysteretic_force.beta": 1e6}
    spring, mass = Spring(), SecondOrder()
    plain, distributed = HystereticForce(), HystereticForce(distributed=True)
    assert finer_form(STILL + spring + plain, plain.name, values) == (plain, {})
    assert finer_form(STILL + mass + plain, plain.name, values)[0] == distributed


def test_who_lags_is_asked_for_the_place_of_the_mechanics() -> None:
    """A damped resonance does much of what a lag does, and no step leads from it to the lag."""
    time = clock(600)
    record = measured(STILL, time, rich(time), (SensorLag(), {"share": 1.0, "tau": 4e-3}))
    book = Book(po.solve(po.Identification(MOVING, record)), 1, 1)
    starts = _exchanged(book, book.base, SensorLag.entries(), Effort.NORMAL, 1)
    assert Members(STILL).with_(SensorLag()) in {start.members for start in starts}
    book.race(starts)
    assert book.best.names == ("sensor_lag",)
    assert book[book.best].model.quasi_static


def test_what_the_fitted_parameters_imitate_is_not_fitted() -> None:
    """It adds nothing, and would be credited with a fit that only got stuck without it."""
    book = opened()
    (suspect,), _ = scored(book.foot, (Creep(1),), 1, book.colour)
    assert suspect.visibility > 0.01
    assert adds(book.base, (replace(suspect, wrong_side=False),), 1, book)
    assert not adds(book.base, (replace(suspect, wrong_side=False, visibility=1e-4),), 1, book)


def test_a_fresh_start_has_the_details_of_law_and_effect_free() -> None:
    """Where they begin away from their nominal values: what is missing has bent the law."""
    book = opened()
    (suspect,), _ = scored(book.foot, (Saturation(),), 1, book.colour)
    starts = adds(book.base, (replace(suspect, wrong_side=False, visibility=1.0),), 1, book)
    (fresh,) = (start for start in starts if start.values is None)
    assert fresh.members.free == ("bouc_wen.n", "saturation.c", "saturation.softness")
    begun = book.fresh(fresh.members)
    assert begun is not None
    parameters = fresh.members.model.parameters
    assert all(begun[name] != parameters[name].nominal for name in fresh.members.free)
