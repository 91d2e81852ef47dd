"""The public Bouc-Wen benchmark: a mass on a spring with a hysteretic force, driven by a multisine.

Statement. From 8192 samples of force and displacement, one steady-state period without noise, find
the parameters of

    m y'' + c y' + k y + z = u
    z' = alpha y' - beta (gamma |y'| |z|^(nu-1) z + delta y' |z|^nu),   nu = 1

and predict what the system does under a fresh multisine and under a sine sweep. Displacement does
not reveal the mass, and beta, gamma and delta act through beta gamma and beta delta only: known are
the stroke per force 1/k, k/m, c/m, alpha/m, beta gamma and beta delta.

Data. Rebuilt from the paper with the parameters that it prints: random-phase multisines, 5..150 Hz,
50 N rms, read at 750 Hz, integrated at 15 kHz. The plant is integrated here, by a Runge-Kutta
scheme of order four on the exact multisine (the paper takes Newmark's), in code that shares nothing
with the package; at 120 kHz the readings change by 2e-5 of their rms. The sweep runs over the
paper's 20..50 Hz at 40 N, in 12 s instead of 3 minutes.

Source: J.P. Noel and M. Schoukens (2016), Hysteretic benchmark with a dynamic nonlinearity,
Workshop on Nonlinear System Identification Benchmarks, Brussels; data: 4TU 10.4121/12967592.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
from numpy.typing import NDArray

import piezo_opt as po
from piezo_opt.effects import HystereticForce, PiezoGain, SecondOrder

FloatArray = NDArray[np.float64]

MASS, DAMPING, STIFFNESS = 2.0, 10.0, 5e4  # kg, N s/m, N/m
ALPHA, BETA, GAMMA, DELTA = 5e4, 1e3, 0.8, -1.1  # N/m, 1/m (force z in newtons), 1, 1

RATE = 750.0
SAMPLES = 8192
FINER = 20
"""Integration steps a sample: 15 kHz, as in the paper."""

COMBINATIONS_WITHIN = 0.01
SIMULATION_WITHIN = 1e-3
SECONDS_WITHIN = 10.0


def integrate(force: FloatArray) -> FloatArray:
    """Displacement [m] at 750 Hz from rest; the force [N] is given at 30 kHz, every half step."""
    step = 1.0 / (RATE * FINER)
    half, sixth = step / 2.0, step / 6.0
    u = force.tolist()
    y = v = z = 0.0
    readings: list[float] = []

    def rates(v: float, y: float, z: float, u: float) -> tuple[float, float]:
        acceleration = (u - DAMPING * v - STIFFNESS * y - z) / MASS
        return acceleration, ALPHA * v - BETA * (GAMMA * abs(v) * z + DELTA * v * abs(z))

    for j in range((len(u) - 1) // 2):
        if j % FINER == 0:
            readings.append(y)
        before, middle, after = u[2 * j : 2 * j + 3]
        a1, s1 = rates(v, y, z, before)
        v2 = v + half * a1
        a2, s2 = rates(v2, y + half * v, z + half * s1, middle)
        v3 = v + half * a2
        a3, s3 = rates(v3, y + half * v2, z + half * s2, middle)
        v4 = v + step * a3
        a4, s4 = rates(v4, y + step * v3, z + step * s3, after)
        y += sixth * (v + 2.0 * (v2 + v3) + v4)
        v += sixth * (a1 + 2.0 * (a2 + a3) + a4)
        z += sixth * (s1 + 2.0 * (s2 + s3) + s4)
    return np.array(readings)


def record(force: FloatArray, displacement: FloatArray, **more: object) -> po.Measurement:
    """Readings of a force given every half integration step."""
    at_readings = force[:: 2 * FINER][: displacement.size]
    return po.Measurement(
        time=np.arange(displacement.size) / RATE,
        drive=at_readings,
        position=displacement,
        drive_unit="N",
        between=po.Between.BANDLIMITED,
        source="simulated; Noel and Schoukens (2016)",
        **more,  # type: ignore[arg-type]
    )


def multisine(seed: int, name: str) -> po.Measurement:
    """One steady-state period: random phases, 5..150 Hz, 50 N rms."""
    lines = np.arange(int(np.ceil(5.0 * SAMPLES / RATE)), int(150.0 * SAMPLES / RATE) + 1)
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, lines.size)
    fine = 2 * FINER * SAMPLES
    spectrum = np.zeros(fine // 2 + 1, dtype=complex)
    spectrum[lines] = np.exp(1j * phases)
    force = np.fft.irfft(spectrum, fine)
    force *= 50.0 / np.sqrt(np.mean(force**2))
    # The transient of a first period is gone after it: the second and third agree to 1e-15.
    twice = integrate(np.concatenate([force, force, force[:1]]))
    return record(force, twice[SAMPLES:], name=name, period=SAMPLES / RATE)


def sweep() -> po.Measurement:
    """From rest: 40 N, 20 to 50 Hz in 12 s, through the resonance."""
    duration, low, high = 12.0, 20.0, 50.0
    time = np.arange(round(duration * RATE) * 2 * FINER + 1) / (2.0 * FINER * RATE)
    force = 40.0 * np.sin(2.0 * np.pi * (low + (high - low) * time / (2.0 * duration)) * time)
    return record(force, integrate(force), name="sweep")


@cache
def data() -> po.Measurement:
    """The estimation record."""
    return multisine(1, "multisine")


@cache
def fresh() -> tuple[po.Measurement, po.Measurement]:
    """Records that are only predicted: another multisine, and the sweep."""
    return multisine(7, "fresh multisine"), sweep()


def question() -> po.Identification:
    """Piezo gain, resonance and hysteretic force, all automatic."""
    return po.Identification(PiezoGain() + SecondOrder() + HystereticForce(), data())


def known() -> Mapping[str, float]:
    """The combinations that displacement reveals, SI units."""
    return {
        "1/k": 1.0 / STIFFNESS,
        "k/m": STIFFNESS / MASS,
        "c/m": DAMPING / MASS,
        "alpha/m": ALPHA / MASS,
        "beta gamma": BETA * GAMMA,
        "beta delta": BETA * DELTA,
    }


def found(fit: po.Fit) -> Mapping[str, float]:
    """The same combinations of a fit."""
    v = fit.values
    omega, beta = v["second_order.omega"], v["hysteretic_force.beta"]
    return {
        "1/k": v["piezo_gain.d"],
        "k/m": omega**2,
        "c/m": 2.0 * v["second_order.zeta"] * omega,
        "alpha/m": v["hysteretic_force.alpha"],
        "beta gamma": beta * v["hysteretic_force.gamma"],
        "beta delta": beta * v["hysteretic_force.delta"],
    }


def simulation_errors(fit: po.Fit) -> Mapping[str, float]:
    """Error of the plain simulation of each fresh record, as a share of its rms.

    Nothing of a fresh record but its force is used: the multisine starts in its periodic steady
    state, the sweep at rest.
    """
    errors = {}
    for one in fresh():
        initial = po.Initial.REST if one.period is None else po.Initial.PERIODIC
        simulated = po.simulate(fit.model, one, fit.values, initial=initial, tolerance=1e-6)
        misfit = simulated.reading - one.position
        errors[one.name] = float(np.linalg.norm(misfit) / np.linalg.norm(one.position))
    return errors


def check(fit: po.Fit) -> None:
    """Combinations within 1 %, fresh records within 1e-3, redundancy said, in under 10 s."""
    have = found(fit)
    for name, value in known().items():
        error = abs(have[name] / value - 1.0)
        assert error <= COMBINATIONS_WITHIN, f"{name}: {have[name]:.6g}, known {value:.6g}"
    for name, error in simulation_errors(fit).items():
        assert error <= SIMULATION_WITHIN, f"{name}: error {error:.2e} of the rms"
    names = [f"hysteretic_force.{n}" for n in ("beta", "gamma", "delta")]
    assert any("redundant" in s and all(n in s for n in names) for s in fit.blind), (
        f"beta, gamma and delta are redundant, and it says only {fit.blind}"
    )
    assert fit.wall_s < SECONDS_WITHIN, f"{fit.wall_s:.1f} s from record to result"


def main() -> None:
    """Solve it, and print the answer beside the known one."""
    fit = po.solve(question())
    print(fit)
    have = found(fit)
    print(f"\n  {'combination':<12} {'found':>12} {'known':>12} {'error':>10}")
    for name, value in known().items():
        print(f"  {name:<12} {have[name]:>12.6g} {value:>12.6g} {have[name] / value - 1.0:>+10.1e}")
    for name, error in simulation_errors(fit).items():
        print(f"  {name}: simulation error {error:.1e} of the rms")
    check(fit)


if __name__ == "__main__":
    main()
