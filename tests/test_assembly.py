"""The assembler: rates by the chain rule, order found, loops and slips refused by name."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np
import pytest

from piezo_opt import assembly as module
from piezo_opt.assembly import System, assemble, folded
from piezo_opt.effects import (
    AmplifierLag,
    BoucWen,
    Chain,
    Creep,
    Delay,
    Effect,
    Equations,
    Model,
    NonlinearGain,
    Offset,
    Parameter,
    PiezoGain,
    Place,
    PrandtlIshlinskii,
    RateDependence,
    SecondOrder,
    State,
    Temperature,
)
from piezo_opt.errors import ModelError
from piezo_opt.values import Values

BASE = PiezoGain() + BoucWen() + SecondOrder() + Offset()


def signals(system: System, x: Any, u: float, du: float, p: Any) -> dict[str, float]:
    names = ("v", "dv", "h", "s", "ds", "x", "dx")
    out = np.array(system.signals(0.0, x, u, du, [], [], p)).ravel()
    return dict(zip(names, out, strict=True))


def gate(null: float = 0.0) -> Parameter:
    return Parameter("1", "gate", nominal=null, bounds=(-1e9, 1e9), null=null)


# --- effects with one slip each -------------------------------------------------------------


@final
@dataclass(frozen=True)
class FreeFeedsDrive(Effect):
    """The drive depends on the free displacement, which depends on the drive.

    v += g s
    """

    place = Place.INPUT
    g = gate()

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """An algebraic loop."""
        return Equations(gives=chain.incoming.value + p.g * chain.free.value)


@final
@dataclass(frozen=True)
class RateFeedsItself(Effect):
    """The acceleration depends on itself.

    x'' += g x''
    """

    place = Place.MOTION
    g = gate()

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """An algebraic loop among rates."""
        return Equations(gives=p.g * chain.acceleration)


@final
@dataclass(frozen=True)
class MovesStranger(Effect):
    """Moves a state that it does not have.

    q' = g
    """

    place = Place.STRAIN
    z = State("m", "own")
    g = gate()

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The state is called z."""
        return Equations(gives=p.g * x.z, moves={"z": p.g, "q": p.g})


@final
@dataclass(frozen=True)
class ForgetsItsRate(Effect):
    """Declares a state and never moves it.

    s += g z
    """

    place = Place.STRAIN
    z = State("m", "own")
    g = gate()

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """No rate."""
        return Equations(gives=p.g * x.z)


@final
@dataclass(frozen=True)
class WrongSize(Effect):
    """Returns two rates for three elements.

    z_i' = g
    """

    place = Place.STRAIN
    z = State("m", "own", size=3)
    g = gate()

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Two of three."""
        return Equations(gives=p.g * x.z[0], moves={"z": x.z[:2]})


@final
@dataclass(frozen=True)
class Misspelt(Effect):
    """Reads a parameter that is not declared.

    s += gain v
    """

    place = Place.STRAIN
    g = gate()

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The parameter is called g."""
        return Equations(gives=p.gain * chain.drive.value)


@pytest.mark.parametrize(
    ("model", "said"),
    [
        (BASE + FreeFeedsDrive(), r"algebraic loop: drive -> free -> drive.*lag"),
        (BASE + RateFeedsItself(), r"algebraic loop: .*acceleration.*lag"),
        (BASE + MovesStranger(), r"moves_stranger: .*'q'.*declare q = State"),
        (BASE + ForgetsItsRate(), r"forgets_its_rate: state 'z' neither moves nor becomes"),
        (BASE + WrongSize(), r"wrong_size\.z: .*2 elements, the state has 3"),
        (BASE + Misspelt(), r"'gain' is not declared"),
        (PiezoGain() + RateDependence(), r"rate_dependence: .*add BoucWen\(\) first"),
        (PiezoGain() + PrandtlIshlinskii() + RateDependence(), r"rate_dependence"),
    ],
)
def test_a_slip_is_refused_by_name(model: Model, said: str) -> None:
    with pytest.raises(ModelError, match=said):
        assemble(model)


def test_effects_refuse_to_be_declared_without_a_place_or_with_two_gates() -> None:
    with pytest.raises(ModelError, match="Placeless declares no place"):
        type("Placeless", (Effect,), {})
    with pytest.raises(ModelError, match=r"Gated has 2 gates \(a, b\)"):
        type("Gated", (Effect,), {"place": Place.STRAIN, "a": gate(), "b": gate()})
    with pytest.raises(ModelError, match="Open has 0 gates"):
        type("Open", (Effect,), {"place": Place.STRAIN})


# --- rates ----------------------------------------------------------------------------------


@final
@dataclass(frozen=True)
class Square(Effect):
    """A memoryless curve on the input line.

    out = in + g in^2
    """

    place = Place.INPUT
    g = gate()

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """No word about rates."""
        return Equations(gives=chain.incoming.value * (1.0 + p.g * chain.incoming.value))


def test_rates_go_down_the_line_by_the_chain_rule() -> None:
    model = AmplifierLag() + Square() + Square() + PiezoGain() + NonlinearGain() + BoucWen()
    system = assemble(model)
    values = Values.nominal(model).with_(
        {"amplifier_lag.share": 0.6, "amplifier_lag.tau": 1e-3, "square.g": 0.02,
         "square_2.g": -0.01, "nonlinear_gain.k2": 1e-9}
    )  # fmt: skip
    p = values.vector(system.parameter_names)
    lagged = system.state_names.index("amplifier_lag.z")
    x = np.zeros(2)
    x[lagged] = 2.0
    x[1 - lagged] = 1e-7
    u, du = 5.0, 300.0
    rate = np.array(system.rate(0.0, x, u, du, [], [], p)).ravel()
    here = signals(system, x, u, du, p)
    # The same instant a moment earlier and later, by the state's own rates.
    h = 1e-7
    earlier, later = (signals(system, x + s * h * rate, u + s * h * du, du, p) for s in (-1.0, 1.0))
    for value, slope in (("v", "dv"), ("s", "ds")):
        assert here[slope] == pytest.approx((later[value] - earlier[value]) / (2 * h), rel=1e-7)
    # By hand, for the line alone.
    a = 5.0 + 0.6 * (2.0 - 5.0)
    da = 300.0 + 0.6 * (3.0 / 1e-3 - 300.0)
    b, db = a + 0.02 * a * a, da * (1 + 0.04 * a)
    assert here["v"] == pytest.approx(b - 0.01 * b * b, rel=1e-14)
    assert here["dv"] == pytest.approx(db * (1 - 0.02 * b), rel=1e-14)
    # And Bouc-Wen runs on that rate.
    expected = (
        values["bouc_wen.alpha"] * here["dv"] - values["bouc_wen.beta"] * abs(here["dv"]) * 1e-7
    )
    assert rate[1 - lagged] == pytest.approx(expected, rel=1e-12)


def test_without_mechanics_the_position_is_the_free_displacement() -> None:
    system = assemble(PiezoGain() + BoucWen() + Offset())
    values = Values.nominal(system.model).with_({"offset.y0": 1e-6})
    p = values.vector(system.parameter_names)
    here = signals(system, [2e-7], 10.0, 50.0, p)
    assert (here["x"], here["dx"]) == (here["s"], here["ds"])
    assert here["s"] == pytest.approx(1e-6 - 2e-7)
    reading = float(system.reading(0.0, [2e-7], 10.0, 50.0, [], [], p))
    assert reading == pytest.approx(here["x"] + 1e-6)


def test_loop_effects_add_to_the_rate_of_the_loop_whatever_their_order() -> None:
    ahead, behind = (
        PiezoGain() + RateDependence() + BoucWen(), PiezoGain() + BoucWen() + RateDependence(),
    )  # fmt: skip
    for model in (ahead, behind):
        system = assemble(model)
        values = Values.nominal(model).with_({"rate_dependence.r": 50.0})
        p = values.vector(system.parameter_names)
        rate = float(system.rate(0.0, [3e-7], 0.0, 0.0, [], [], p))
        assert rate == pytest.approx(-50.0 * 3e-7)


def test_a_start_at_rest_is_carried_downstream() -> None:
    model = AmplifierLag() + PiezoGain() + BoucWen() + Creep(elements=2) + SecondOrder()
    system = assemble(model)
    values = Values.nominal(model).with_({"creep.c": 0.1})
    p = values.vector(system.parameter_names)
    still = np.array(system.start(0.0, 40.0, [], p, np.zeros(len(system.state_names)))).ravel()
    first = dict(zip(system.state_names, still, strict=True))
    assert first["amplifier_lag.z"] == 40.0
    assert first["second_order.x"] == pytest.approx(
        40e-7 - first["bouc_wen.h"] + 0.05 * (first["creep.z[0]"] + first["creep.z[1]"])
    )
    deviation = np.zeros(len(system.state_names))
    deviation[system.state_names.index("bouc_wen.h")] = 5e-7
    moved = np.array(system.start(0.0, 40.0, [], p, deviation)).ravel()
    change = dict(zip(system.state_names, moved - still, strict=True))
    assert change["bouc_wen.h"] == pytest.approx(5e-7)
    assert change["second_order.x"] == pytest.approx(-5e-7, rel=0.2)
    # At rest nothing moves but what creeps.
    rate = np.array(system.rate(0.0, still, 40.0, 0.0, [], [], p)).ravel()
    moving = dict(zip(system.state_names, rate, strict=True))
    for name in ("amplifier_lag.z", "bouc_wen.h", "second_order.x", "second_order.w"):
        assert abs(moving[name]) < 1e-9


# --- what a system says about itself --------------------------------------------------------


def test_names_units_and_constants_of_a_system() -> None:
    system = assemble(BASE + Creep(elements=2) + Delay())
    assert system.state_names == (
        "bouc_wen.h", "second_order.x", "second_order.w", "creep.z[0]", "creep.z[1]",
    )  # fmt: skip
    assert system.state_units == ("m", "m", "m/s", "m", "m")
    assert system.constants["bouc_wen.n"] == 1.0
    assert "bouc_wen.n" not in system.parameter_names
    assert set(system.parameter_names) | set(system.constants) == set(system.model.parameters)
    assert system.delay is not None
    p = np.arange(len(system.parameter_names), dtype=float)
    assert float(system.delay(p)) == p[system.parameter_names.index("delay.T")]
    assert assemble(BASE).delay is None
    assert assemble(BASE).becomes is None
    assert assemble(PiezoGain() + PrandtlIshlinskii()).becomes is not None


def test_two_delays_add_up() -> None:
    system = assemble(BASE + Delay() + Delay())
    p = np.zeros(len(system.parameter_names))
    p[system.parameter_names.index("delay.T")] = 1.0
    p[system.parameter_names.index("delay_2.T")] = 0.25
    assert system.delay is not None
    assert float(system.delay(p)) == 1.25


def test_folding_keeps_what_is_asked_for_at_run_time() -> None:
    assert "bouc_wen.n" in folded(BASE)
    assert "bouc_wen.n" not in folded(BASE, ["bouc_wen.n"])
    constants = {n: p.nominal for n, p in BASE.parameters.items()}
    whole = assemble(BASE, constants)
    assert whole.parameter_names == ()
    free = assemble(BASE, {})
    p = Values.nominal(BASE).vector(free.parameter_names)
    x = [1e-7, 2e-7, 3e-4]
    one = np.array(whole.rate(0.0, x, 5.0, 100.0, [], [], [])).ravel()
    two = np.array(free.rate(0.0, x, 5.0, 100.0, [], [], p)).ravel()
    np.testing.assert_allclose(one, two, rtol=1e-14)


def test_the_same_model_is_assembled_once() -> None:
    assert assemble(PiezoGain() + BoucWen()) is assemble(PiezoGain() + BoucWen())
    assert assemble(PiezoGain() + BoucWen()) is not assemble(PiezoGain() + BoucWen(), {})


# --- systems that another process has assembled -----------------------------------------------


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty cache directory of the test's own, and a process that knows no system."""
    monkeypatch.setenv("PIEZO_OPT_CACHE", str(tmp_path))
    module._assemble.cache_clear()
    yield tmp_path
    module._assemble.cache_clear()


def again(model: Model, constants: dict[str, float] | None = None) -> System:
    """A system as another process would have it."""
    module._assemble.cache_clear()
    return assemble(model, constants)


def systems(cache: Path) -> int:
    return len(list((cache / "systems").glob("*")))


def same(one: System, other: System) -> bool:
    """Whether two systems are the same to the letter."""
    said = [
        (s.recipe, s.signals.serialize(), s.state_units, dict(s.constants), s.model)
        for s in (one, other)
    ]
    return said[0] == said[1]


def test_a_system_that_was_kept_is_the_one_that_was_assembled(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    models = [
        BASE,
        PiezoGain() + PrandtlIshlinskii() + Offset(),
        PiezoGain() + BoucWen() + Offset(),
        BASE + Delay() + Creep(elements=2),
        BASE + Temperature(),
    ]
    made = [assemble(model) for model in models]
    assert systems(cache) == len(models)

    def nobody(*_: object) -> None:
        raise AssertionError("assembled once more")

    monkeypatch.setattr(module, "_Assembler", nobody)
    for model, system in zip(models, made, strict=True):
        kept = again(model)
        assert kept is not system
        assert same(kept, system)
    assert made[1].becomes is not None
    assert made[3].delay is not None


def test_whatever_makes_another_system_is_another_one(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = [
        again(BASE + Creep(elements=1)), again(BASE + Creep(elements=2)),
        again(BASE, {"bouc_wen.n": 1.0}), again(BASE, {"bouc_wen.n": 2.0}),
        again(BASE, {}), again(Model.of(*(e for _, e in reversed(BASE.named)))),
    ]  # fmt: skip
    assert systems(cache) == len(known)
    assert len({system.recipe for system in known}) == len(known)
    # An effect whose equations have been replaced is not the package's any more.
    before = again(BASE).reading.serialize()
    monkeypatch.setattr(Offset, "equations", lambda *given: Equations(gives=given[3].y0 ** 2))
    assert again(BASE).reading.serialize() != before


def test_effects_of_ones_own_are_assembled_every_time(cache: Path) -> None:
    """What they say is in no file that is looked at."""

    @final
    @dataclass(frozen=True)
    class Slanted(Effect):
        """A drive that grows.

        v += g t
        """

        place = Place.INPUT
        g = gate()

        def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
            return Equations(gives=chain.incoming.value + p.g * chain.time)

    # The chain beside which it is looked at is kept.
    again(PiezoGain() + BoucWen() + SecondOrder(), {})
    before = systems(cache)
    assert "slanted.g" in again(BASE + Slanted()).parameter_names
    assert systems(cache) == before
    again(BASE)
    assert systems(cache) == before + 1


def test_what_is_refused_is_kept_nowhere(cache: Path) -> None:
    for _ in range(2):
        with pytest.raises(ModelError, match="rate_dependence adds to the rate"):
            again(PiezoGain() + PrandtlIshlinskii() + RateDependence())
    assert systems(cache) == 0
