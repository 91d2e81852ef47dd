"""The thesis' vibration controllers on its Eq. 3.8: LQR, pole placement, a ZV shaper, a PID.

Statement. Take the resonance of Eq. 3.8, x'' + 0.8194 x' + 34.8 x = 34.8 u scaled to follow at
rest, and bring it to 1 um without swinging: by an LQR with Q = diag(443, 335) and R = 1, by pole
placement for 2 % and 0.5 s, by a ZV shaper, and by a PID within the drive that the pole placement
begins with.

Known answer. K = [20.457 4.5197] and N = 46.258; K = [15.18 70.474] and N = 123.85; amplitudes
0.5545 and 0.4456 with 0.5338 s between them. The thesis' errors of the step (Appendix B) and the
gains of its PID are lost.

Source: Modelling and Control of Hysteresis and Vibration in Piezoelectric Actuator, Universiti
Teknologi Malaysia (2015), Eqs. 3.8, 3.16-3.32, 3.40, Appendix B.
"""

from __future__ import annotations

from collections.abc import Mapping

import control
import numpy as np

import piezo_opt as po
from piezo_opt.control import lqr, pole_placement, zv
from piezo_opt.studies.thesis.control import vibration_answers
from problems import thesis_vibration


def question() -> po.Identification:
    """Eq. 3.8 on the stretch of the record that it comes from; its sign is the record's own."""
    return thesis_vibration.equation_3_8(-1.0).question


def known() -> Mapping[str, float]:
    """What the thesis prints."""
    return {
        "LQR, K1": 20.457, "LQR, K2": 4.5197, "LQR, N": 46.258, "placed, K1": 15.18,
        "placed, K2": 70.474, "placed, N": 123.85, "ZV, A1": 0.5545, "ZV, A2": 0.4456,
        "ZV, t2": 0.5338,
    }  # fmt: skip


def found(fit: po.Fit) -> Mapping[str, float]:
    """The same, from the values of a fit."""
    omega, zeta = (fit.values[f"second_order.{k}"] for k in ("omega", "zeta"))
    a = [[-2.0 * zeta * omega, -(omega**2)], [1.0, 0.0]]
    # The thesis rounds the numerator, 0.8498 um/(V s^2), to two digits.
    gain = round(1e6 * abs(fit.values["piezo_gain.d"]) * omega**2, 2)
    system = control.ss(a, [[1.0], [0.0]], [[0.0, gain]], [[0.0]])
    best, placed = lqr(system, [443.0, 335.0]), pole_placement(system, overshoot=0.02, settling=0.5)
    shaper = zv(omega, zeta)
    numbers = [
        *np.ravel(best.gain), best.precompensator, *np.ravel(placed.gain), placed.precompensator,
        *shaper.amplitudes, shaper.delay,
    ]  # fmt: skip
    return dict(zip(known(), map(float, numbers), strict=True))


def errors() -> Mapping[str, float]:
    """Integral of the absolute error of a step [s], by controller."""
    time, answers = vibration_answers()
    return {name: float(np.trapezoid(np.abs(1.0 - y), time)) for name, y in answers.items()}


def check(fit: po.Fit) -> None:
    """Every printed digit, to two of the last, and less error than without a controller."""
    for name, value in found(fit).items():
        assert abs(value / known()[name] - 1.0) < 3e-4, f"{name}: {value:.6g}, {known()[name]}"
    left = errors()
    for name, value in left.items():
        assert name == "none" or value < 0.5 * left["none"], f"{name}: {value:.3f} s"


def main() -> None:
    """Fit what is free beside Eq. 3.8, design, and check."""
    fit = po.solve(question())
    print(fit)
    print()
    for name, value in found(fit).items():
        print(f"  {name:<12} {value:>9.4f}, the thesis {known()[name]}")
    print("  step, IAE [um s]:", ", ".join(f"{k} {v:.3f}" for k, v in errors().items()))
    check(fit)


if __name__ == "__main__":
    main()
