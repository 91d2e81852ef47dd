"""Laws that every effect of the catalogue obeys: an effect is covered by being listed.

A user's own effect, written in this file as in a user's own, obeys the same laws.
"""

from __future__ import annotations

import importlib
import inspect
import json
import pkgutil
import re
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

import piezo_opt
from piezo_opt.assembly import System, assemble
from piezo_opt.effects import (
    CATALOGUE,
    Asymmetry,
    BoucWen,
    Chain,
    Creep,
    CubicStiffness,
    Effect,
    Equations,
    HystereticForce,
    Load,
    LoadMass,
    Model,
    NonlinearGain,
    Parameter,
    PiezoGain,
    Place,
    RateDependence,
    SecondOrder,
    model_from_dict,
)
from piezo_opt.errors import InputError, ModelError
from piezo_opt.measurement import Measurement
from piezo_opt.simulation import Simulator, Substeps
from piezo_opt.simulation.compiler import find_compiler
from piezo_opt.values import Values

FloatArray = NDArray[np.float64]


@final
@dataclass(frozen=True)
class AirDrag(Effect):
    """Drag that grows with the square of the velocity, per unit mass.

        x'' += -c x' |x'|

    References: any textbook of fluid mechanics; a user's own effect, 2026.
    """

    place = Place.MOTION
    requires = ("motion",)
    c = Parameter(
        "1/m", "drag", nominal=0.0, bounds=(0.0, 1e9), typical=(1e2, 1e4), null=0.0
    )  # fmt: skip

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Own share of the acceleration."""
        w = chain.position.rate
        return Equations(gives=-p.c * w * abs(w))


@final
@dataclass(frozen=True)
class Form:
    """An effect in one of the other forms under which a search tries it: made as its class is."""

    kind: type[Effect]
    options: Mapping[str, Any]

    def __call__(self) -> Effect:
        return self.kind(**self.options)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.kind, name)


KINDS: list[type[Effect]] = [*CATALOGUE.values(), AirDrag]
FORMS: list[Any] = [
    Form(kind, options) for kind in KINDS for options in kind.variants if kind(**options) != kind()
]
OPTIONAL = [*(kind for kind in KINDS if not kind.structural), *FORMS]
MECHANICS = PiezoGain() + BoucWen() + SecondOrder()

TIME = np.arange(200) / 20e3
DRIVE = 20.0 + 35.0 * np.sin(2 * np.pi * 150 * TIME) + 15.0 * np.sin(2 * np.pi * 370 * TIME + 1)
SUBSTEPS = Substeps(longest=1e-5, largest_move=1e9)


def record(metre: float = 1.0, volt: float = 1.0, second: float = 1.0, kelvin: float = 1.0) -> Any:
    """200 samples of a drive that turns often, crosses zero, and starts away from it."""
    return Measurement(
        time=TIME * second,
        drive=DRIVE * volt,
        position=1e-7 * DRIVE * metre,
        channels={"temperature": (293.15 + 700.0 * TIME) * kelvin},
    )


def label(kind: type[Effect]) -> str:
    options = kind.options if isinstance(kind, Form) else {}
    return "-".join([kind().name, *(f"{k}={v}" for k, v in options.items())])


each = pytest.mark.parametrize("kind", KINDS, ids=label)
each_optional = pytest.mark.parametrize("kind", OPTIONAL, ids=label)


def around(kind: type[Effect], base: Model = MECHANICS) -> tuple[Model, str]:
    """The base model with one effect of this kind, and its name there."""
    effect = kind()
    if effect.name in base:
        return base, effect.name
    if effect.structural and effect.place is Place.STRAIN:
        law = base.loop
        assert law is not None
        # A law without a rate carries no loop effects.
        carried = any(s.loop for s in effect.declared_states.values())
        kept = [e for _, e in base if carried or e.place is not Place.LOOP]
        return Model.of(*kept).replaced(law, effect), effect.name
    if any(s.position for s in effect.declared_states.values()):
        return base.replaced("second_order", effect), effect.name
    return base + effect, effect.name


def generator(kind: type[Effect]) -> np.random.Generator:
    return np.random.default_rng(zlib.crc32(label(kind).encode()))


def draw(rng: np.random.Generator, interval: tuple[float, float]) -> float:
    """From an interval: evenly in the logarithm where it is positive and wide."""
    low, high = interval
    if low > 0.0 and high / low > 10.0:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))
    return float(rng.uniform(low, high))


def drawn(model: Model, name: str, rng: np.random.Generator) -> Values:
    """Nominal values, those of one effect drawn from the typical ranges."""
    own = {
        f"{name}.{k}": draw(rng, p.typical) if p.typical is not None else p.nominal
        for k, p in model[name].parameters.items()
    }
    return Values.nominal(model).with_(own)


def simulator(
    model: Model, values: Mapping[str, float], directions: tuple[str, ...] = (), **scale: float
) -> Simulator:
    second = scale.get("second", 1.0)
    return Simulator(
        model,
        record(**scale),
        values,
        directions=directions,
        runtime=tuple(model.parameters),
        prefer_compiled=False,
        substeps=Substeps(SUBSTEPS.longest * second, SUBSTEPS.largest_move),
    )


def instant(system: System, rng: np.random.Generator, still: bool = False) -> list[Any]:
    """Time, states, drive, channels and their rates of some moment, of sizes that occur."""
    size = {"m": 1e-5, "m/s": 1e-2, "V": 30.0, "V^2": 900.0, "s": 1e-3, "1": 1.0}
    scale = np.array([size[unit] for unit in system.state_units])
    x = scale * rng.standard_normal(scale.size)
    channels = len(system.channel_names)
    if still:
        return [0.0, 0 * x, 0.0, 0.0, np.zeros(channels), np.zeros(channels)]
    warmth = 293.15 + 10 * rng.standard_normal(channels)
    u, du = 30.0 * rng.standard_normal(), 1e4 * rng.standard_normal()
    return [rng.uniform(0, 10), x, u, du, warmth, rng.standard_normal(channels)]


def everything(model: Model) -> System:
    """Assembled with every parameter, also the fixed ones, as an argument."""
    return assemble(model, constants={})


# --- declarations ---------------------------------------------------------------------------


@each
def test_the_docstring_has_an_equation_a_source_and_every_parameter(kind: type[Effect]) -> None:
    effect = kind()
    text = kind.__doc__ or ""
    assert "=" in effect.equation
    sources = text.split("References:")
    assert len(sources) == 2
    assert re.search(r"\b(19|20)\d\d\b", sources[1])
    assert effect.summary.endswith(".")
    for parameter in effect.parameters:
        assert re.search(rf"(?<![A-Za-z]){re.escape(parameter)}(?![A-Za-z])", text), parameter


@each
def test_each_form_prints_the_equation_of_its_own_parameters(kind: type[Effect]) -> None:
    forms = [kind(**options) for options in kind.variants or ({},)]
    everything = {name for form in forms for name in form.parameters}
    for form in forms:
        words = set(re.findall(r"[A-Za-z]\w*", form.equation))
        assert everything & words == set(form.parameters), form


@each
def test_optional_effects_have_one_gate_that_starts_closed(kind: type[Effect]) -> None:
    effect = kind()
    gates = [k for k, p in effect.parameters.items() if p.null is not None]
    if effect.structural:
        assert gates == []
        return
    assert gates == [effect.gate]
    gate = effect.parameters[gates[0]]
    assert gate.nominal == gate.null
    assert not gate.fixed
    assert gate.typical is not None
    assert gate.typical != (gate.null, gate.null)


@each
def test_typical_ranges_lie_within_the_bounds_and_bounds_are_finite(kind: type[Effect]) -> None:
    for name, parameter in kind().parameters.items():
        low, high = parameter.bounds
        assert np.isfinite([low, high]).all(), name
        unit_exponents(parameter.unit)
        if parameter.typical is None:
            assert parameter.fixed, f"{name} has no range to start from"
        else:
            assert low <= parameter.typical[0] < parameter.typical[1] <= high, name
    for state in kind().declared_states.values():
        unit_exponents(state.unit)


@pytest.mark.parametrize("kind", CATALOGUE.values(), ids=label)
def test_a_model_survives_json(kind: type[Effect]) -> None:
    for effect in (kind(), *(kind(**{n: 2 * o or True}) for n, o in kind().options.items())):
        model = Model.of(effect) + NonlinearGain() + NonlinearGain()
        again = model_from_dict(json.loads(json.dumps(model.to_dict())))
        assert again == model
        assert again[effect.name].options == effect.options


def test_an_own_effect_is_not_in_the_catalogue_and_the_error_says_so() -> None:
    data = (MECHANICS + AirDrag()).to_dict()
    with pytest.raises(InputError, match="no effect 'air_drag'"):
        model_from_dict(data)


def test_no_effect_escapes_the_catalogue() -> None:
    for module in pkgutil.walk_packages(piezo_opt.__path__, "piezo_opt."):
        if module.name.startswith("piezo_opt.effects."):
            importlib.import_module(module.name)

    def below(kind: type[Any]) -> set[type[Any]]:
        return {kind}.union(*(below(sub) for sub in kind.__subclasses__()))

    found = [k for k in below(Effect) if k.__module__.startswith("piezo_opt")]
    ours = {k for k in found if not inspect.isabstract(k)}
    assert ours == set(CATALOGUE.values())
    for name, listed in CATALOGUE.items():
        assert listed().name == name
        assert listed.__module__.endswith(f".{name}")
        assert getattr(listed, "__final__", False), f"{name} can be subclassed"
    places = [list(Place).index(listed().place) for listed in CATALOGUE.values()]
    assert places == sorted(places)


# --- vanishing at null ----------------------------------------------------------------------


@each_optional
def test_equations_vanish_at_null_whatever_the_shape_and_the_states(kind: type[Effect]) -> None:
    model, name = around(kind)
    gate = model[name].gate
    assert gate is not None
    rng = generator(kind)
    whole, less = everything(model), everything(MECHANICS)
    shared = [whole.state_names.index(n) for n in less.state_names]
    for _ in range(20):
        values = Values.nominal(model).with_(
            {f"{name}.{k}": draw(rng, p.bounds) for k, p in model[name].parameters.items()}
        )
        null = model[name].parameters[gate].null
        assert null is not None
        values = values.with_({f"{name}.{gate}": null})
        t, x, u, du, c, dc = instant(whole, rng)
        p, q = values.vector(whole.parameter_names), values.vector(less.parameter_names)
        none = np.zeros(0)
        rate = np.array(whole.rate(t, x, u, du, c, dc, p)).ravel()[shared]
        expected = np.array(less.rate(t, x[shared], u, du, none, none, q)).ravel()
        np.testing.assert_allclose(rate, expected, rtol=1e-12, atol=0)
        reading = float(whole.reading(t, x, u, du, c, dc, p))
        alone = float(less.reading(t, x[shared], u, du, none, none, q))
        np.testing.assert_allclose(reading, alone, rtol=1e-12, atol=0)


@each_optional
def test_the_simulated_reading_at_null_is_that_without_the_effect(kind: type[Effect]) -> None:
    model, name = around(kind)
    gate = model[name].gate
    values = drawn(model, name, generator(kind))
    null = model[name].parameters[str(gate)].null
    assert null is not None
    with_it = simulator(model, values.with_({f"{name}.{gate}": null})).reading
    closed = with_it(values.with_({f"{name}.{gate}": null}))
    without = simulator(MECHANICS, Values.nominal(MECHANICS)).reading(Values.nominal(MECHANICS))
    np.testing.assert_allclose(closed, without, rtol=0, atol=1e-13 * np.ptp(without))
    opened = with_it(values)
    assert np.abs(opened - without).max() > 1e-6 * np.ptp(without)


# --- order, units, regularity, derivatives --------------------------------------------------


@each
def test_the_order_of_a_balance_is_irrelevant(kind: type[Effect]) -> None:
    others: tuple[Effect, ...] = (
        RateDependence(), Asymmetry(), Creep(), NonlinearGain(), CubicStiffness(),
        HystereticForce(), Load(), LoadMass(),
    )  # fmt: skip
    partners = [e for e in others if not isinstance(e, kind)]
    model, name = around(kind, MECHANICS + Model.of(*partners))
    rng = generator(kind)
    values = Values.nominal(model)
    for other in model.names:
        if model[other].gate is not None:
            values = values.with_(
                {k: v for k, v in drawn(model, other, rng).items() if k.startswith(f"{other}.")}
            )
    values = values.with_(
        {k: v for k, v in drawn(model, name, rng).items() if k.startswith(f"{name}.")}
    )
    there = simulator(model, values).reading(values)
    backwards = Model.of(*(e for _, e in reversed(model.named)))
    assert backwards.names == model.names[::-1]
    back = simulator(backwards, values).reading(values)
    np.testing.assert_allclose(back, there, rtol=0, atol=1e-9 * np.ptp(there))


def unit_exponents(unit: str) -> dict[str, int]:
    """Exponents of metre, volt, second and kelvin: ``"V*s/m"`` is V 1, s 1, m -1."""
    exponents = dict.fromkeys(("m", "V", "s", "K"), 0)
    above, *below = unit.split("/")
    for factors, sign in ((above, 1), *((b, -1) for b in below)):
        for factor in factors.split("*"):
            match = re.fullmatch(r"(1|rad|m|V|s|K)(?:\^(\d))?", factor)
            assert match, f"unit {unit!r}: cannot read {factor!r}"
            if match[1] not in ("1", "rad"):
                exponents[match[1]] += sign * int(match[2] or 1)
    return exponents


def test_the_parser_of_units_reads_compound_units() -> None:
    assert unit_exponents("V*s/m") == {"m": -1, "V": 1, "s": 1, "K": 0}
    assert unit_exponents("1/m^2/s^2") == {"m": -2, "V": 0, "s": -2, "K": 0}
    assert unit_exponents("m/V/K") == {"m": 1, "V": -1, "s": 0, "K": -1}


@each
def test_the_answer_rescales_with_the_units(kind: type[Effect]) -> None:
    """Other metres, volts, seconds and kelvins: only declared units may carry the change."""
    scales = {"m": 2.0**20, "V": 2.0**-5, "s": 2.0**7, "K": 2.0}

    def factor(unit: str) -> float:
        return float(np.prod([scales[u] ** n for u, n in unit_exponents(unit).items()]))

    model, name = around(kind)
    values = drawn(model, name, generator(kind))
    converted = Values({k: v * factor(model.parameters[k].unit) for k, v in values.items()})
    plain = simulator(model, values).response(values)
    other = simulator(
        model, converted, metre=scales["m"], volt=scales["V"], second=scales["s"],
        kelvin=scales["K"],
    ).response(converted)  # fmt: skip
    reading = other.reading / scales["m"]
    np.testing.assert_allclose(reading, plain.reading, rtol=0, atol=1e-9 * np.ptp(plain.reading))
    units = everything(model).state_units
    for column, unit in enumerate(units):
        state = other.states[:, column] / factor(unit)
        size = np.abs(plain.states[:, column]).max()
        np.testing.assert_allclose(state, plain.states[:, column], rtol=0, atol=1e-9 * size)


@each
def test_equations_and_derivatives_are_finite_over_the_bounds(kind: type[Effect]) -> None:
    model, name = around(kind)
    rng = generator(kind)
    system = everything(model)
    functions: list[Any] = [system.rate, system.reading]
    functions += [function.jacobian() for function in functions]
    parameters = model[name].parameters
    corners = [{f"{name}.{k}": p.bounds[i] for k, p in parameters.items()} for i in (0, 1)]
    inside = [
        {f"{name}.{k}": draw(rng, p.bounds) for k, p in parameters.items()} for _ in range(40)
    ]
    for number, own in enumerate([*corners, *inside]):
        values = Values.nominal(model).with_(own)
        point = [
            *instant(system, rng, still=number % 3 == 0),
            values.vector(system.parameter_names),
        ]
        for function in functions:
            blanks = [np.zeros(function.size_in(i)) for i in range(len(point), function.n_in())]
            for out in ca.veccat(*function.call([ca.DM(a) for a in [*point, *blanks]])).nonzeros():
                assert np.isfinite(out), own


@each
def test_simulations_are_finite_over_the_typical_ranges(kind: type[Effect]) -> None:
    model, name = around(kind)
    rng = generator(kind)
    run = simulator(model, Values.nominal(model))
    for _ in range(5):
        values = drawn(model, name, rng)
        response = run.response(values)
        assert np.isfinite(response.reading).all(), dict(values)
        assert np.isfinite(response.states).all(), dict(values)


@pytest.mark.skipif(find_compiler() is None, reason="there is no C compiler to compare with")
@each
def test_the_generated_c_replays_the_virtual_machine(kind: type[Effect]) -> None:
    """The first half of the law that exported C replays Python: the core that all exports use."""
    model, name = around(kind)
    values = drawn(model, name, generator(kind))
    directions = tuple(f"{name}.{k}" for k in model[name].parameters)
    interpreted = simulator(model, values, directions)
    compiled = Simulator(
        model,
        record(),
        values,
        directions=directions,
        runtime=tuple(model.parameters),
        substeps=SUBSTEPS,
    )
    assert compiled.compiled
    assert not interpreted.compiled
    y, slopes = compiled.with_sensitivities(values)
    reading, expected = interpreted.with_sensitivities(values)
    assert np.abs(y - reading).max() <= 1e-12 * np.ptp(reading)
    extent = np.abs(expected).max(axis=0)
    # Where terms cancel, as those of a spring that nothing acts on, the rounding of one is left.
    sizes = np.array([model.parameters[d].scale for d in directions])
    left = 1e-12 * np.ptp(reading) / sizes
    assert (np.abs(slopes - expected).max(axis=0) <= 1e-6 * extent + left).all()


@pytest.mark.parametrize(
    ("kind", "closed"),
    [
        *(pytest.param(kind, False, id=label(kind)) for kind in KINDS),
        *(pytest.param(kind, True, id=f"{label(kind)} at null") for kind in OPTIONAL),
    ],
)
def test_sensitivities_equal_finite_differences(kind: type[Effect], closed: bool) -> None:
    model, name = around(kind)
    gate = model[name].gate
    values = drawn(model, name, generator(kind))
    parameters = model[name].parameters
    directions = tuple(f"{name}.{k}" for k in parameters)
    if closed:
        null = parameters[str(gate)].null
        assert null is not None
        values = values.with_({f"{name}.{gate}": null})
        directions = (f"{name}.{gate}",)
    run = simulator(model, values, directions)
    reading, slopes = run.with_sensitivities(values)
    for column, direction in enumerate(directions):
        parameter = model.parameters[direction]
        low, high = parameter.bounds
        size = parameter.scale if closed else (abs(values[direction]) or parameter.scale)
        step = 1e-6 * size
        at = values[direction]
        ahead = run.reading(values.with_({direction: at + step}))
        if at - step < low:
            further = run.reading(values.with_({direction: at + 2.0 * step}))
            difference = (4.0 * ahead - further - 3.0 * reading) / (2.0 * step)
        elif at + step > high:
            pytest.fail(f"{direction}: drawn at its upper bound")
        else:
            difference = (ahead - run.reading(values.with_({direction: at - step}))) / (2.0 * step)
        error = np.sqrt(np.mean((slopes[:, column] - difference) ** 2)) * size
        extent = np.sqrt(np.mean(slopes[:, column] ** 2)) * size
        assert error <= 2e-5 * extent + 1e-9 * np.ptp(reading), direction
    if closed:
        assert np.abs(slopes).max() * parameters[str(gate)].scale > 1e-7 * np.ptp(reading)


@each
def test_as_many_numbers_act_as_the_effect_says(kind: type[Effect]) -> None:
    """Of free parameters that are redundant by definition the sensitivities are combinations."""
    model, name = around(kind)
    parameters = model[name].parameters
    free = [k for k, p in parameters.items() if not p.fixed]
    values = drawn(model, name, generator(kind))
    directions = tuple(f"{name}.{k}" for k in free)
    _, slopes = simulator(model, values, directions).with_sensitivities(values)
    sizes = np.linalg.norm(slopes, axis=0)
    seen = np.linalg.svd(slopes[:, sizes > 0] / sizes[sizes > 0], compute_uv=False)
    assert int((seen > 1e-10).sum()) == int((sizes > 0).sum()) - kind.redundant


def test_a_model_refuses_what_an_effect_needs_and_it_lacks() -> None:
    for kind in KINDS:
        for need in kind().requires:
            lone = Model.of(kind())
            if need.startswith("channel:"):
                with pytest.raises(InputError, match="record it"):
                    Simulator(
                        PiezoGain() + kind(), record_without_channels(), {}, prefer_compiled=False
                    )
            else:
                with pytest.raises(ModelError, match=r"add \w+\(\) first"):
                    assemble(lone)


def record_without_channels() -> Measurement:
    return Measurement(time=TIME, drive=DRIVE, position=1e-7 * DRIVE)
