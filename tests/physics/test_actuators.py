"""Stacks and bimorphs against what can be worked out otherwise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate

import piezo_opt as po
from piezo_opt.effects import BoucWen, PiezoGain, SecondOrder
from piezo_opt.errors import InputError, ModelError
from piezo_opt.physics import PZT_5A, PZT_5H, Bimorph, Expected, Stack, Wiring, actuator

STACK = Stack(PZT_5H, layers=100, thickness=1e-4, area=25e-6)
BENDER = Bimorph(PZT_5A, length=30e-3, width=5e-3, thickness=0.25e-3)


def test_stroke_is_the_strain_of_all_layers() -> None:
    strain = actuator(PZT_5H, np.array([0.0, 0.0, 150.0 / STACK.thickness]))[2]
    assert STACK.stroke(150.0) == pytest.approx(strain * STACK.length)
    assert STACK.stroke(150.0) == pytest.approx(100 * 593e-12 * 150.0)
    # A load as stiff as the stack halves the stroke; the blocked force is that of an endless one.
    assert STACK.stroke(150.0, STACK.stiffness) == pytest.approx(0.5 * STACK.stroke(150.0))
    hard = 1e6 * STACK.stiffness
    assert hard * STACK.stroke(150.0, hard) == pytest.approx(STACK.blocked_force(150.0), rel=2e-6)


def test_energy_that_a_blocked_stack_keeps_is_what_a_free_one_gives() -> None:
    """C V^2 / 2 free - C V^2 / 2 blocked = F x / 2: the coupling, counted in two ways."""
    electric = 0.5 * (STACK.capacitance - STACK.blocked_capacitance) * 150.0**2
    mechanical = 0.5 * STACK.blocked_force(150.0) * STACK.stroke(150.0)
    assert electric == pytest.approx(mechanical, rel=1e-12)


def test_resonance_of_a_rod_and_of_a_mass_on_it() -> None:
    speed = 1.0 / np.sqrt(7500.0 * 20.7e-12)
    assert STACK.resonance == pytest.approx(speed / (4.0 * STACK.length), rel=1e-12)
    heavy = replace(STACK, end_mass=50.0 * STACK.mass)
    # Rayleigh: a third of the spring's own mass goes along.
    moved = heavy.end_mass + STACK.mass / 3.0
    rayleigh = np.sqrt(STACK.stiffness / moved) / (2.0 * np.pi)
    assert heavy.resonance == pytest.approx(rayleigh, rel=1e-5)
    assert heavy.resonance < replace(STACK, end_mass=1e-9 * STACK.mass).resonance
    assert replace(STACK, end_mass=1e-9 * STACK.mass).resonance == pytest.approx(STACK.resonance)


def test_bimorph_without_a_middle_layer_is_the_textbook() -> None:
    h, volts = 2.0 * BENDER.thickness, 60.0
    series = 3.0 * 171e-12 * volts * BENDER.length**2 / (2.0 * h**2)
    assert BENDER.deflection(volts) == pytest.approx(series, rel=1e-12)
    assert BENDER.deflection(volts, 0.5 * BENDER.length) == pytest.approx(0.25 * series)
    both = replace(BENDER, wiring=Wiring.PARALLEL)
    assert both.deflection(volts) == pytest.approx(2.0 * series, rel=1e-12)
    assert both.capacitance == pytest.approx(4.0 * BENDER.capacitance, rel=1e-12)


def test_curvature_is_that_of_least_energy() -> None:
    """Strain energy over the section, integrated, is least at the curvature of the formula."""
    shim = replace(BENDER, middle=0.1e-3, middle_modulus=2e11, middle_density=7800.0)
    for one in (BENDER, shim):
        free = abs(PZT_5A.d31) * one.field(60.0)
        y, half = one.modulus, 0.5 * one.middle

        def energy(kappa: float, y: float = y, half: float = half, free: float = free,
                   one: Bimorph = one) -> float:  # fmt: skip
            def density(z: float) -> float:
                if z < half:
                    return 0.5 * one.middle_modulus * (kappa * z) ** 2
                return 0.5 * y * (kappa * z - free) ** 2

            return float(
                integrate.quad(density, 0.0, half)[0]
                + integrate.quad(density, half, half + one.thickness)[0]
            )

        best, step = one.curvature(60.0), 1e-3 * one.curvature(60.0)
        slope = (energy(best + step) - energy(best - step)) / (2.0 * step)
        bend = (energy(best + step) - 2.0 * energy(best) + energy(best - step)) / step**2
        assert abs(slope / bend) < 1e-6 * best


def test_energy_of_a_bimorph_counted_twice() -> None:
    """The capacitance by which a free bender exceeds a held one is the work that it can do."""
    for one in (BENDER, replace(BENDER, wiring=Wiring.PARALLEL)):
        layers = 0.5 if one.wiring is Wiring.SERIES else 2.0
        plate = layers * PZT_5A.permittivity[2, 2] * one.width * one.length / one.thickness
        flat = plate * (1.0 - PZT_5A.k31**2)
        volts = 60.0
        bending = 0.5 * one.bending_stiffness * one.curvature(volts) ** 2 * one.length
        assert 0.5 * (one.capacitance - flat) * volts**2 == pytest.approx(bending, rel=1e-9)


def test_resonance_of_a_cantilever() -> None:
    first = (1.8751 / BENDER.length) ** 2 / (2.0 * np.pi)
    plain = first * np.sqrt((1.0 / 16.4e-12) * (2 * BENDER.thickness) ** 2 / (12.0 * 7750.0))
    assert BENDER.resonance == pytest.approx(plain, rel=1e-4)


def test_dimensions_that_make_no_sense_are_refused() -> None:
    with pytest.raises(InputError, match="give at least one"):
        Stack(PZT_5H, layers=0, thickness=1e-4, area=25e-6)
    with pytest.raises(InputError, match="thickness of a layer"):
        Stack(PZT_5H, layers=1, thickness=0.0, area=25e-6)
    with pytest.raises(InputError, match="middle layer needs"):
        replace(BENDER, middle=1e-4)
    with pytest.raises(InputError, match="tolerance"):
        STACK.expected(0.0)
    with pytest.raises(ModelError, match="at least one layer"):
        PiezoGain.from_stack(PZT_5H, 0)


def test_a_stated_tolerance_is_a_rectangle() -> None:
    known = Expected.within(2e-7, 0.15)
    drawn = np.random.default_rng(0).uniform(0.85 * 2e-7, 1.15 * 2e-7, 200_000)
    assert known.std == pytest.approx(drawn.std(), rel=5e-3)


def test_a_fit_uses_what_the_stack_says() -> None:
    """A loop hides d behind alpha; the stack's n d33 tells them apart."""
    gain = PiezoGain.from_stack(PZT_5H, 300)
    model = gain + BoucWen()
    assert model.parameters["piezo_gain.d"].nominal == pytest.approx(300 * 593e-12)
    time = np.linspace(0.0, 2.0, 801)
    drive = 50.0 - 50.0 * np.cos(2.0 * np.pi * time)
    truth = {"piezo_gain.d": 1.85e-7, "bouc_wen.alpha": 3e-8, "bouc_wen.beta": 5e-3,
             "bouc_wen.gamma": -4.8e-3}  # fmt: skip
    record = po.Measurement(time, drive, drive * 1e-7)
    reading = po.simulate(model, record, truth).reading
    noise = 200e-9
    rng = np.random.default_rng(3)
    record = record.with_(position=reading + noise * rng.normal(size=reading.size))
    plain = po.solve(po.Identification(model, record, start=po.Start.REST))
    stack = replace(STACK, layers=300)
    priors = po.priors_from(stack.expected(0.1, mechanics=0.1), model)
    assert set(priors) == {"piezo_gain.d"}  # the model has no mechanics
    known = po.solve(
        po.Identification(model, record, start=po.Start.REST, priors=priors, noise=noise)
    )

    def std(fit: po.Fit) -> float:
        k = fit.names.index("piezo_gain.d")
        return float(np.sqrt(fit.covariance[k, k]))

    prior = priors["piezo_gain.d"]
    assert std(known) < min(std(plain), prior.std)
    assert abs(known.values["piezo_gain.d"] - truth["piezo_gain.d"]) < 3.0 * std(known)
    both = po.priors_from(stack.expected(0.1, mechanics=0.1), model + SecondOrder())
    assert both["second_order.omega"].mean == pytest.approx(2.0 * np.pi * stack.resonance)
