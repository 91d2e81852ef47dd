"""The package's simulator against the independent code that made the synthetic record."""

from __future__ import annotations

import numpy as np
import pytest

import piezo_opt as po
from problems import bouc_wen_benchmark, synthetic_recovery


def test_simulation_agrees_with_the_closed_form_of_the_loop() -> None:
    record = synthetic_recovery.clean()
    model = synthetic_recovery.question().model
    reading = po.simulate(model, record, synthetic_recovery.known(), tolerance=1e-9).reading
    error = np.abs(reading - record.position).max() / np.ptp(record.position)
    assert error < 1e-8, f"{error:.2e} of the range"


@pytest.mark.parametrize("number", [0, 1])
def test_simulation_agrees_with_the_benchmark_s_plant(number: int) -> None:
    plant = bouc_wen_benchmark
    omega = np.sqrt(plant.STIFFNESS / plant.MASS)
    truth = {
        "piezo_gain.d": 1.0 / plant.STIFFNESS,
        "second_order.omega": omega,
        "second_order.zeta": plant.DAMPING / plant.MASS / (2.0 * omega),
        "hysteretic_force.alpha": plant.ALPHA / plant.MASS,
        "hysteretic_force.beta": plant.BETA,
        "hysteretic_force.gamma": plant.GAMMA,
        "hysteretic_force.delta": plant.DELTA,
    }
    record = plant.fresh()[number]
    initial = po.Initial.REST if record.period is None else po.Initial.PERIODIC
    model = plant.question().model
    reading = po.simulate(model, record, truth, initial=initial, tolerance=1e-6).reading
    error = np.linalg.norm(reading - record.position) / np.linalg.norm(record.position)
    # The drive between samples is only known as its band-limited interpolation.
    assert error < 2e-4, f"{record.name}: {error:.2e} of the rms"
