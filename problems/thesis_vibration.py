"""The thesis' vibration record: a resonance that its sampling cannot show.

Statement. A 1 Hz square wave between 0.063 and 63.05 V was read at 4 Hz, and Eq. 3.8 of the thesis,

    G(s) = 0.8498 / (s^2 + 0.8194 s + 34.8)   [um/V],

puts a resonance at 0.94 Hz. Say whether the record holds a resonance at all.

Known answer. No. Two readings fall on each level of the square wave, and they are equal: the
reading follows the drive within a sample. At 4 Hz all harmonics of 1 Hz fold onto 1 Hz, so the
record holds a mean, and gain and phase at 1 Hz; the phase is 0, and a straight line explains all of
it to one step of the reading. A resonance can always be laid through gain and phase at the one
frequency that is there, close to which it then must lie. Read at the very steps of a held drive,
readings a, a, b, b lead its first harmonic by 45 degrees, which a resonance only does with the
opposite sign and a lag of 135 degrees. Eq. 3.8 lags by 132 degrees at 1 Hz: it is that artefact, of
readings that are high when the voltage is low, as in the right half of Table 3.5.

What must be said: the default model leaves the mechanics out, and says that a resonance is not
identifiable; a fit that insists on a resonance is told the same, and that its gain and its damping
cannot be told apart.

Source: Modelling and Control of Hysteresis and Vibration in Piezoelectric Actuator, Universiti
Teknologi Malaysia (2015), Appendix E, Table 3.5 and Eq. 3.8.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping

import numpy as np

import piezo_opt as po
from piezo_opt.effects import Offset, PiezoGain, SecondOrder

EQUATION_3_8 = (0.8498e-6, 0.8194, 34.8)
"""Numerator [m/(V s^2)], damping [1/s] and stiffness [1/s^2] of Eq. 3.8."""


def data() -> po.Measurement:
    """Appendix E: 150 of 400 readings with their gaps."""
    return po.load("thesis/vibration")


def stretch() -> po.Measurement:
    """The first six seconds, without a gap."""
    return data().slice(0.0, 6.1).rename("first stretch")


def question() -> po.Identification:
    """What the record can answer: the default model, without mechanics."""
    model, _ = po.default_model(data())
    return po.Identification(model, data())


def insisting() -> po.Identification:
    """A resonance asked for all the same, on a stretch without gaps."""
    return po.Identification(PiezoGain() + SecondOrder() + Offset(), stretch())


def known() -> Mapping[str, float]:
    """Facts of the record and of Eq. 3.8, each computed by hand (SI units)."""
    return {
        # The swing of the readings over the swing of the drive: 6.56 um / 62.987 V.
        "gain": 1.042e-7,
        "phase at 1 Hz": 0.0,
        # |2 pi j 0.8194 + 34.8 - (2 pi)^2|: -4.678 + 5.148 j.
        "phase of Eq. 3.8 at 1 Hz": -132.3,
        "steps of the reading": 0.1234e-6,
    }


def lines(record: po.Measurement) -> tuple[complex, float]:
    """Response at 1 Hz [m/V], and the rms of what mean and 1 Hz leave over [m]."""
    angle = 2.0 * np.pi * 1.0 * record.time
    basis = np.column_stack([np.ones(angle.size), np.cos(angle), -np.sin(angle)])
    parts = np.linalg.lstsq(basis, np.column_stack([record.drive, record.position]), rcond=None)[0]
    left = record.position - basis @ parts[:, 1]
    response = complex(*parts[1:, 1]) / complex(*parts[1:, 0])
    return response, float(np.sqrt(np.mean(left**2)))


def equation_3_8(sign: float) -> po.Fit:
    """Eq. 3.8 on the stretch, its own gain or the opposite; offset and start are free."""
    numerator, damping, stiffness = EQUATION_3_8
    omega = math.sqrt(stiffness)
    fixed = {
        "piezo_gain.d": sign * numerator / stiffness,
        "second_order.omega": omega,
        "second_order.zeta": damping / (2.0 * omega),
    }
    return po.solve(po.Identification(insisting().model, stretch(), fixed=fixed))


def found() -> Mapping[str, float]:
    """The numbers of `known`, from the record."""
    response, _ = lines(data())
    numerator, damping, stiffness = EQUATION_3_8
    at = 2.0j * math.pi
    theirs = numerator / (at**2 + damping * at + stiffness)
    return {
        "gain": abs(response),
        "phase at 1 Hz": math.degrees(cmath.phase(response)),
        "phase of Eq. 3.8 at 1 Hz": math.degrees(cmath.phase(theirs)),
        "steps of the reading": data().resolution or math.nan,
    }


def check(fit: po.Fit) -> None:
    """The record holds one frequency; the default model and a stubborn fit are both told so."""
    have, tolerance = found(), {"gain": 1e-10, "steps of the reading": 1e-10}
    for name, value in known().items():
        assert abs(have[name] - value) <= tolerance.get(name, 0.1), (
            f"{name}: {have[name]:.6g}, known {value:.6g}"
        )
    _, left = lines(data())
    assert left < have["steps of the reading"], f"{left:.3g} m beside mean and 1 Hz"
    model, left_out = po.default_model(data())
    assert model.quasi_static, f"the default model has mechanics: {model.names}"
    assert any("the record shows no resonance" in s for s in left_out), left_out
    assert fit.model.quasi_static
    assert fit.rms < have["steps of the reading"], f"rms {fit.rms:.3g} m"
    stubborn = po.solve(insisting())
    assert any("artefact of its sampling" in s for s in stubborn.remarks), stubborn.remarks
    assert any("piezo_gain.d and second_order.zeta are redundant" in s for s in stubborn.blind), (
        stubborn.blind
    )
    hertz = stubborn.values["second_order.omega"] / (2.0 * math.pi)
    assert abs(hertz - 1.0) < 0.02, f"the artefact lies at {hertz:.3f} Hz, not at the drive's 1 Hz"
    straight = po.solve(po.Identification(PiezoGain() + Offset(), stretch()))
    assert abs(stubborn.rms / straight.rms - 1.0) < 0.05, (
        f"rms {stubborn.rms:.3g} m with the resonance, {straight.rms:.3g} m with a straight line"
    )
    own, opposite = equation_3_8(1.0).fit_percent, equation_3_8(-1.0).fit_percent
    assert own < 0.0, f"Eq. 3.8 fits by {own:.0f} %"
    assert opposite > 85.0, f"Eq. 3.8 with the opposite sign fits by {opposite:.0f} %"


def main() -> None:
    """Say what the record holds, what the default model does with it, and what Eq. 3.8 is."""
    response, left = lines(data())
    print(
        f"The record holds a mean, {1e6 * abs(response):.4f} um/V at "
        f"{math.degrees(cmath.phase(response)):.1f} degrees at 1 Hz, and {1e9 * left:.0f} nm rms "
        f"of anything else (its steps: {1e9 * (data().resolution or 0.0):.0f} nm).\n"
    )
    _, left_out = po.default_model(data())
    print("The default model\n", *left_out)
    fit = po.solve(question())
    print(fit)
    print("\nInsisting on a resonance, on the first six seconds")
    print(po.solve(insisting()))
    own, opposite = equation_3_8(1.0), equation_3_8(-1.0)
    print(
        f"\nEq. 3.8 there, offset and start free: fit {own.fit_percent:.0f} %; with the opposite "
        f"sign {opposite.fit_percent:.0f} %."
    )
    check(fit)


if __name__ == "__main__":
    main()
