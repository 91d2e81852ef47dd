"""Composed models: the numbers of the whole expressions, for every form of every effect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np
import pytest
from numpy.typing import NDArray

from piezo_opt.assembly import System, folded, named
from piezo_opt.effects import (
    AmplifierLag,
    BoucWen,
    Chain,
    Creep,
    CubicStiffness,
    Dahl,
    Delay,
    Drift,
    Effect,
    Equations,
    Friction,
    HystereticForce,
    LoadMass,
    MaxwellSlip,
    Model,
    NonlinearDamping,
    Offset,
    Parameter,
    PiezoGain,
    Place,
    PrandtlIshlinskii,
    Preisach,
    SecondMode,
    SecondOrder,
    SensorLag,
    Spring,
    State,
)
from piezo_opt.effects.catalogue import CATALOGUE
from piezo_opt.errors import ModelError
from piezo_opt.measurement import Measurement
from piezo_opt.simulation import INITIAL, Simulator, Substeps, library
from piezo_opt.simulation.compiler import find_compiler
from piezo_opt.simulation.composed import ComposedEngine, program
from piezo_opt.simulation.dynamics import Whole
from piezo_opt.simulation.engine import VirtualMachine, engine
from piezo_opt.simulation.exponential import linear_part
from piezo_opt.simulation.library import MACHINE
from piezo_opt.simulation.runs import Run
from piezo_opt.simulation.schedule import Segment, corners, segments
from piezo_opt.simulation.scheme import scheme
from piezo_opt.symbolic import dragged, play, where_
from piezo_opt.values import Values

pytestmark = pytest.mark.skipif(find_compiler() is None, reason="compiles C: no compiler")

FloatArray = NDArray[np.float64]

TIME = np.arange(60) * 1e-4
DRIVE = 40.0 + 45.0 * np.sin(2 * np.pi * 300 * TIME) * np.sin(2 * np.pi * 90 * TIME + 0.3)
RECORD = Measurement(
    TIME, DRIVE, 1e-7 * DRIVE, name="x", channels={"temperature": 300.0 + 2e3 * TIME}
)
GAIN = Model.of(PiezoGain())
BASES = (
    GAIN + BoucWen(),
    GAIN + BoucWen() + SecondOrder(),
    GAIN + PrandtlIshlinskii() + SecondOrder() + SensorLag(),
    GAIN + Dahl() + AmplifierLag() + Creep() + SecondOrder() + LoadMass() + Delay(),
)
READING, STATES, SLOPES = 1e-12, 1e-11, 1e-9
"""Shares of the range that the numbers may differ by: along a swinging chain rounding grows with
the phase, and in its derivatives the more."""


def forms() -> list[Effect]:
    """Every form of every effect, and the finer ones that a search goes on to."""
    found: list[Effect] = []
    for kind in CATALOGUE.values():
        plain: Any = kind
        tried = [plain(), *(plain(**options) for options in kind.variants)]
        nominal = {name: p.nominal for name, p in tried[0].parameters.items()}
        found += [*tried, tried[0].finer(nominal)[0]]
    return list(dict.fromkeys(found))


def drawn(model: Model, rng: np.random.Generator) -> dict[str, float]:
    """Values within what is typical, a resonance slow enough for the sub-steps."""
    values = {}
    for name, p in model.parameters.items():
        values[name] = p.nominal
        if name.endswith("omega"):
            values[name] = rng.uniform(2e3, 6e3)
        elif p.typical is not None and not p.fixed:
            low, high = p.typical
            values[name] = low + (high - low) * rng.uniform(0.2, 0.8)
    return values


def with_base(effect: Effect) -> list[Model]:
    """The effect in every base that it can be added to."""
    found = []
    for base in BASES:
        flagged = {
            role
            for _, one in [*base, ("", effect)]
            for state in one.declared_states.values()
            for role in ("loop", "position")
            if getattr(state, role)
        }
        twice = [
            role for role in flagged
            if sum(any(getattr(s, role) for s in e.declared_states.values())
                   for e in (*(e for _, e in base), effect)) > 1
        ]  # fmt: skip
        if twice or (effect.structural and effect.name in base):
            continue
        model = base + effect
        if all(model.refusal(one, ("temperature",)) is None for _, one in model):
            found.append(model)
    return found


def time_axis(system: System, p: FloatArray) -> Segment:
    made = program(system, exact=True)
    assert made is not None
    drive = corners(RECORD, system.channel_names)
    if made.delay is None:
        return drive.sampled.even
    return segments(drive, RECORD.time - RECORD.time[0], made.delay(p)).even


def compared(
    model: Model, values: Mapping[str, float], *, exact: bool, runtime: Sequence[str] = ()
) -> None:
    """Compare the composed model, as machine code and function by function, and the whole
    expressions, with all directions."""
    system = named(model, folded(model, runtime))
    directions = (*system.parameter_names, *(INITIAL + n for n in system.state_names))
    p = np.array([values[name] for name in system.parameter_names])
    axis = time_axis(system, p)
    made = program(system, exact)
    assert made is not None
    assert isinstance(engine(system, directions, exact=exact), ComposedEngine)
    whole = VirtualMachine(scheme(system, directions, exact))
    unmoved = np.zeros(len(system.state_names))
    x_whole, s_whole = whole.start(axis, p, unmoved)
    cut = Substeps(2.5e-5, 1e3, exact=exact).of(axis)
    other = whole.run(axis, cut, p, x_whole, s_whole, states=True)
    for machine in (True, False):
        composed = ComposedEngine(made, directions, machine)
        x, s = composed.start(axis, p, unmoved)
        np.testing.assert_allclose(x, x_whole, rtol=1e-12, atol=1e-20)
        # Where terms cancel the rounding of one of them is left.
        left = 1e-14 * np.abs(s_whole).max(axis=1, keepdims=True) + 1e-20
        assert (np.abs(s - s_whole) <= 1e-9 * np.abs(s_whole) + left).all()
        assert (composed.code(s) is not None) == (machine and MACHINE)
        one = composed.run(axis, cut, p, x_whole, s_whole, states=True)
        same(model, directions, one, other)
        # Without states several sub-steps are done at once, where there is machine code.
        quick = composed.run(axis, cut, p, x_whole, s_whole)
        same(model, directions, replace(quick, states=one.states), other)
        assert one.states is not None
        size = np.abs(one.states).max(axis=0, initial=0.0)
        close(quick.last[None], one.last[None], STATES, np.where(size > 0.0, size, 1.0))
        # Without derivatives the list of instructions is another one.
        plain = ComposedEngine(made, (), machine)
        none = np.zeros((len(system.state_names), 0))
        alone = plain.run(axis, cut, p, x_whole, none)
        np.testing.assert_allclose(
            alone.reading, other.reading, rtol=0, atol=READING * np.ptp(other.reading)
        )


def close(found: FloatArray, expected: FloatArray, share: float, sizes: FloatArray) -> None:
    """Column by column, each by what matters in it or its own largest entry."""
    assert found.shape == expected.shape
    assert np.isfinite(expected).all()
    largest = np.maximum(np.abs(expected).max(axis=0, initial=0.0), sizes)
    np.testing.assert_allclose(found / largest, expected / largest, rtol=0, atol=share)


def same(model: Model, directions: Sequence[str], one: Run, other: Run) -> None:
    """Whether two runs are the same."""
    stroke = float(np.ptp(other.reading))
    assert one.states is not None
    assert other.states is not None
    close(one.reading[:, None], other.reading[:, None], READING, np.full(1, stroke))
    moved = np.abs(other.states).max(axis=0, initial=0.0)
    moved = np.where(moved > 0.0, moved, 1.0)
    close(one.states, other.states, STATES, moved)
    # A derivative counts by what a change of the parameter by its own size does to the reading.
    size = {name: p.scale for name, p in model.parameters.items()}
    size |= dict(zip((d for d in directions if d.startswith(INITIAL)), moved, strict=True))
    by = np.array([stroke / size[name] for name in directions])
    starts = np.array([name.startswith(INITIAL) for name in directions])
    # Where a start is soon forgotten, rounding is a larger share of what is left of it.
    for those, share in ((~starts, SLOPES), (starts, 1e4 * SLOPES)):
        close(one.sensitivities[:, those], other.sensitivities[:, those], share, by[those])


@pytest.mark.parametrize("effect", forms(), ids=repr)
def test_every_form_gives_the_numbers_of_the_whole_expressions(effect: Effect) -> None:
    rng = np.random.default_rng(4)
    found = with_base(effect)
    assert found or effect.name in ("spring", "piezo_gain")
    for i, model in enumerate(found[-3:]):
        added = model.names[-1]
        fixed = [f"{added}.{k}" for k, p in effect.parameters.items() if p.fixed]
        compared(model, drawn(model, rng), exact=True, runtime=fixed if i else ())


@pytest.mark.parametrize("model", BASES, ids=lambda m: " + ".join(m.names))
def test_without_exponentials_the_numbers_are_the_same(model: Model) -> None:
    compared(model, drawn(model, np.random.default_rng(5)), exact=False)


@pytest.mark.parametrize("effect", forms(), ids=repr)
def test_the_linear_blocks_are_those_of_the_whole_expressions(effect: Effect) -> None:
    rng = np.random.default_rng(6)
    for model in with_base(effect)[-1:]:
        system = named(model, folded(model))
        made = program(system, exact=True)
        assert made is not None
        part, whole = linear_part(system, exact=True), Whole(system, exact=True)
        assert tuple(block.states for block in made.composition.blocks) == part.blocks
        assert tuple(block.heard for block in made.composition.blocks) == part.heard
        values = drawn(model, rng)
        p = np.array([values[name] for name in system.parameter_names])
        assert made.longest(p) == pytest.approx(whole.longest(p), rel=1e-9)
        x = rng.uniform(-1e-6, 1e-6, len(system.state_names))
        channels = np.full(len(system.channel_names), 301.0)
        instants = np.array([
            [0.1, 20.0, slope, *channels, *(0.1 * channels), *(scale * x)]
            for slope, scale in ((-3e4, 1.0), (0.0, 1.0), (2e3, -0.5))
        ])  # fmt: skip
        expected = whole.slopes(instants, p)
        rows = np.abs(expected).max(initial=1.0)
        np.testing.assert_allclose(made.slopes(instants, p), expected, rtol=0, atol=1e-9 * rows)
        np.testing.assert_allclose(
            made.at_rest(0.1, 20.0, channels, p), whole.at_rest(0.1, 20.0, channels, p),
            rtol=1e-12, atol=1e-18,
        )  # fmt: skip


@pytest.mark.parametrize("exact", [False, True])
@pytest.mark.parametrize(
    "forces",
    [
        Spring() + Friction(),
        Spring() + HystereticForce() + CubicStiffness() + Friction(),
    ],
    ids=["friction", "three"],
)
def test_a_spring_without_mass_is_composed(forces: Model, exact: bool) -> None:
    """Its velocity follows from the derivative of the whole balance, on either side of zero."""
    model = GAIN + BoucWen() + forces + SensorLag() + Delay()
    values = drawn(model, np.random.default_rng(9))
    compared(model, values, exact=exact)
    static = {**values, "friction.stribeck": 1.5}  # which bends the line in the velocity
    compared(model, static, exact=exact, runtime=("friction.stribeck", "friction.w_s"))


def test_a_spring_holds_no_force_that_follows_the_velocity() -> None:
    model = GAIN + BoucWen() + Spring() + NonlinearDamping()
    with pytest.raises(ModelError, match="a force depends on the velocity itself"):
        Simulator(model, RECORD, Values.nominal(model))


def test_many_directions_go_in_several_rows() -> None:
    model = GAIN + MaxwellSlip(elements=9) + SecondOrder() + SecondMode() + Creep() + Offset()
    values = drawn(model, np.random.default_rng(7))
    system = named(model, folded(model))
    assert len(system.parameter_names) + len(system.state_names) > 24
    compared(model, values, exact=True)


@final
@dataclass(frozen=True)
class Sluggish(Effect):
    """A lag whose time constant grows with the drive, which delays the chain a little, too.

    tau (1 + g v^2) z' = v - z
    """

    place = Place.INPUT
    structural = True
    z = State("V", "lagged drive")
    tau = Parameter("s", "time constant", nominal=2e-4, bounds=(1e-6, 1.0))
    g = Parameter("1/V^2", "growth", nominal=1e-4, bounds=(0.0, 1.0))

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        u = chain.incoming.value
        rate = (u - x.z) / (p.tau * (1.0 + p.g * u * u))
        return Equations(gives=x.z, moves={"z": rate}, starts={"z": u}, delays=3e-5)


def test_an_effect_of_ones_own_is_composed_as_well() -> None:
    model = Sluggish() + PiezoGain() + BoucWen() + SecondOrder()
    compared(model, drawn(model, np.random.default_rng(8)), exact=True)


@final
@dataclass(frozen=True)
class Relay(Effect):
    """A strain that is gained above a threshold and kept within a stretch.

    s += q z,   z becomes 1 where v > t and 0 where not
    """

    place = Place.STRAIN
    z = State("1", "whether it is on")
    q = Parameter("m", "what is gained", nominal=1e-6, bounds=(0.0, 1.0), null=0.0)
    t = Parameter("V", "threshold", nominal=40.0, bounds=(0.0, 100.0))

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        on = where_(chain.drive.value > p.t, 1.0, 0.0)
        return Equations(gives=p.q * x.z, becomes={"z": on}, starts={"z": on})


PLAYS: Sequence[Effect] = (
    PrandtlIshlinskii(), Preisach(), Preisach(free=True), MaxwellSlip(), MaxwellSlip(free=True),
)  # fmt: skip


@pytest.mark.parametrize("law", PLAYS, ids=repr)
def test_what_the_drive_alone_moves_is_asked_twice_a_sub_step(law: Effect) -> None:
    """In its middle and at its end, and for a reading not again: a strain of plays is the same
    before and after they are moved on. Where they follow a lag it is asked at every stage."""
    model = GAIN + law + Creep() + SecondOrder()
    driven = program(named(model, folded(model)), exact=True)
    lagging = AmplifierLag() + model
    moved = program(named(lagging, folded(lagging)), exact=True)
    assert driven is not None
    assert moved is not None
    asked = {k: len(v) for k, v in driven.composition.lists.items()}
    again = {k: len(v) for k, v in moved.composition.lists.items()}
    assert asked["driven"] >= again["driven"] + 2  # the law, and the sum of the strains
    assert asked["driven"] + asked["stage"] <= again["driven"] + again["stage"]
    for model in (driven, moved):
        lists = model.composition.lists
        assert not {*lists["driven"]} & {*lists["stage"], *lists["reading"], *lists["jump"]}


def test_a_strain_that_jumps_with_its_state_is_asked_after_the_jump() -> None:
    model = GAIN + Relay() + Creep() + SecondOrder()
    form = library.functions_of(Relay(), frozenset())
    assert form is not None
    assert not form.form.settled
    compared(model, drawn(model, np.random.default_rng(3)), exact=True)


@final
@dataclass(frozen=True)
class Latch(Effect):
    """A strain that is there for good once the drive has been above a threshold.

    s += q z,   z becomes 1 where v > t and stays where not
    """

    place = Place.STRAIN
    z = State("1", "whether it is on")
    q = Parameter(
        "m", "what is gained", nominal=0.0, bounds=(0.0, 1.0), typical=(1e-7, 1e-6), null=0.0
    )
    t = Parameter("V", "threshold", nominal=60.0, bounds=(0.0, 1000.0))

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        on = where_(chain.drive.value > p.t, 1.0, x.z)
        return Equations(gives=p.q * x.z, becomes={"z": on})


def test_a_rare_jump_of_what_is_nominally_nothing_is_no_secret() -> None:
    model = GAIN + Latch() + Creep() + SecondOrder()
    compared(model, drawn(model, np.random.default_rng(3)), exact=True)


def test_a_heading_is_believed_only_where_it_holds() -> None:
    @final
    @dataclass(frozen=True)
    class Pushed(Effect):
        """A play that asks for a heading and is dragged on further than it was seen to be."""

        place = Place.STRAIN
        z = State("V", "play")
        q = Parameter(
            "m/V", "gain", nominal=0.0, bounds=(0.0, 1e-6), typical=(1e-8, 1e-7), null=0.0
        )

        def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
            v = chain.drive.value
            seen = dragged(x.z, v, chain.drive.heading, 5.0)
            return Equations(gives=p.q * seen, becomes={"z": play(x.z, v, 4.0)})

    for effect, settled in ((Pushed(), False), (PrandtlIshlinskii(), True), (Relay(), False)):
        found = library.functions_of(effect, frozenset())
        assert found is not None
        assert found.form.settled is settled
    model = GAIN + Pushed() + Creep() + SecondOrder()
    compared(model, drawn(model, np.random.default_rng(3)), exact=True)


def test_saturated_to_the_last_digit_and_beyond() -> None:
    """tanh of numbers from 0 to a thousand, four at a time, on both sides."""
    for centre, breadth in ((40.0, 1e-3), (40.0, 1.0), (-1e4, 10.0), (40.0, 1e5)):
        model = GAIN + Preisach(free=True) + Creep()
        values = {**Values.nominal(model), "preisach.c": centre, "preisach.b": breadth}
        compared(model, values, exact=True)


def test_a_constant_delay_is_not_dropped() -> None:
    """The reading is that of an earlier drive: 3e-5 s times its slope."""
    model = Sluggish() + PiezoGain()
    values = {**Values.nominal(model), "sluggish.tau": 1e-6, "sluggish.g": 0.0}
    run = Simulator(model, RECORD, values, substeps=Substeps(1e-6, 1e9))
    earlier = np.interp(TIME - 3.1e-5, TIME, DRIVE)
    ptp = np.ptp(earlier) * values["piezo_gain.d"]
    found, expected = run.reading(values)[2:], values["piezo_gain.d"] * earlier[2:]
    np.testing.assert_allclose(found, expected, atol=2e-3 * ptp)


@final
@dataclass(frozen=True)
class Late(Effect):
    """A transport time that is known.

    v(t) = u(t - 0.13 ms)
    """

    place = Place.INPUT
    structural = True

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        return Equations(gives=chain.incoming.value, delays=1.3e-4)


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("more", [1.7e-4, None], ids=["beside a delay", "alone"])
def test_a_constant_delay_is_as_good_as_a_given_one(compiled: bool, more: float | None) -> None:
    """Beside what remembers, resonates, lags and goes by the clock of the reading."""
    chain = PiezoGain() + BoucWen() + Creep() + SecondOrder() + SensorLag() + Drift()
    given = Delay() + AmplifierLag() + chain
    late = Late() + (AmplifierLag() + chain if more is None else given)
    values = {**Values.nominal(given), "second_order.omega": 3e3, "drift.rate": 1e-4}
    directions = ("bouc_wen.beta", "creep.c", "second_order.omega")

    def run(model: Model, delay: float) -> tuple[FloatArray, FloatArray]:
        at = {**values, "delay.T": delay}
        return Simulator(
            model, RECORD, at, directions=directions, substeps=Substeps(1e-5, 1e9),
            prefer_compiled=compiled,
        ).with_sensitivities(at)  # fmt: skip

    found, expected = run(late, more or 0.0), run(given, 1.3e-4 + (more or 0.0))
    for ours, theirs in zip(found, expected, strict=True):
        size = np.ptp(theirs, axis=0)
        np.testing.assert_allclose(ours / size, theirs / size, rtol=0, atol=1e-11)
    dropped = run(given, more or 0.0)[0]
    assert np.abs(found[0] - dropped).max() > 0.03 * np.ptp(dropped)


def test_equations_that_were_replaced_are_not_those_of_the_library(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    known = library.functions_of(Offset(), frozenset())
    monkeypatch.setattr(Offset, "equations", lambda *given: Equations(gives=given[3].y0 * 2.0))
    replaced = library.functions_of(Offset(), frozenset())
    assert known is not None
    assert replaced is not None
    assert replaced.form.gives != known.form.gives or replaced.addresses != known.addresses
