"""The thesis' controllers, designed and run on its own models."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from piezo_opt.control import (
    PID,
    ClosedLoop,
    InverseCompensation,
    Limits,
    ModelPlant,
    StateFeedback,
    close_loop,
    lqr,
    pole_placement,
    zv,
)
from piezo_opt.measurement import FloatArray
from piezo_opt.studies.row import Row
from piezo_opt.studies.thesis.equations import MICRO, eq_3_8
from piezo_opt.studies.thesis.hysteresis import loop_fit

PERIOD: Final = 5e-3
"""Sampling of the hysteresis loops [s]: 1/150 of the period of Eq. 3.5."""
STROKE: Final = 14.664e-6
"""The reference's peak [m], as high as the measured loop."""
SPAN: Final = 10.0
"""Seconds after the step over which vibration is added up; Eq. 3.8 has decayed to 2 % then."""


def control_rows() -> tuple[Row, ...]:
    """Gains, shaper, and the errors of the loops."""
    import control

    system = control.ss([[-0.82, -34.80], [1.0, 0.0]], [[1.0], [0.0]], [[0.0, 0.85]], [[0.0]])
    best, placed = lqr(system, [443.0, 335.0]), pole_placement(system, overshoot=0.02, settling=0.5)
    falling = eq_3_8().den[0][0]
    omega = float(np.sqrt(falling[2]))
    shaper = zv(omega, float(falling[1]) / (2.0 * omega))
    return (
        Row("LQR: K, N", "[20.457 4.5197], 46.258", _gains(best), "", "Eqs. 3.16, 3.17, lqr"),
        Row(
            "Pole placement, 2 % and 0.5 s: K, N",
            "[15.18 70.474], 123.85",
            _gains(placed),
            "",
            "Eq. 3.40, pole_placement",
        ),
        Row(
            "ZV shaper: A1, A2, t2",
            "0.5545, 0.4456, 0.5338 s",
            f"{shaper.amplitudes[0]:.4f}, {shaper.amplitudes[1]:.4f}, {shaper.delay:.4f} s",
            "",
            "Eqs. 3.18-3.32, zv",
        ),
        *_hysteresis_loops(),
        *_vibration_loops(best, placed),
    )


def _gains(feedback: StateFeedback) -> str:
    k = np.ravel(feedback.gain)
    return f"[{k[0]:.3f} {k[1]:.4f}], {feedback.precompensator:.3f}"


def _hysteresis_loops() -> tuple[Row, ...]:
    fit = loop_fit()
    time = np.arange(0.0, 50.0 + PERIOD, PERIOD)
    reference = STROKE * (1.0 - np.abs(time / 25.0 - 1.0))
    # The thesis' gains are in volts a micrometre.
    pid = PID(50.137 / MICRO, 84.405 / MICRO, 3.9926 / MICRO, tau=4.0 * PERIOD)
    loops = [
        close_loop(ModelPlant(fit), controller, reference, period=PERIOD, limits=Limits(-30, 150))
        for controller in (pid, InverseCompensation.of(fit))
    ]
    return (
        Row(
            "PID on the loop's model: largest error",
            "about 0.15 µm",
            _largest(loops[0]),
            f"The thesis' optimal gains, a reading every {1e3 * PERIOD:.0f} ms; IAE "
            f"{1e6 * loops[0].iae:.2f} µm s.",
            "Table 3.11, Fig. 4.4, close_loop",
        ),
        Row(
            "Inverse compensation: largest error",
            "less than the PID's",
            _largest(loops[1]),
            f"The compensator cancels the hysteresis; the lag of the mechanics stays. IAE "
            f"{1e6 * loops[1].iae:.2f} µm s.",
            "Eq. 3.14, Fig. 4.4, close_loop",
        ),
    )


def _largest(loop: ClosedLoop) -> str:
    return f"{1e6 * loop.largest:.3f} µm"


def _vibration_loops(best: StateFeedback, placed: StateFeedback) -> tuple[Row, ...]:
    import control

    plant = eq_3_8() / float(np.real(eq_3_8()(0.0)))
    time = np.linspace(0.0, SPAN, 5001)
    falling = eq_3_8().den[0][0]
    omega = float(np.sqrt(falling[2]))
    shaper = zv(omega, float(falling[1]) / (2.0 * omega))
    command = shaper.shaped(time, np.where(time > 0.0, 1.0, 0.0))

    def answer(system: Any, command: FloatArray) -> FloatArray:
        return np.asarray(control.forced_response(system, time, command).outputs).ravel()

    step = np.ones_like(time)
    errors = {
        "none": answer(plant, step),
        "ZV": answer(plant, command),
        "LQR": answer(best.closed, step),
        "pole placement": answer(placed.closed, step),
    }
    iae = {name: float(np.trapezoid(np.abs(1.0 - y), time)) for name, y in errors.items()}
    return (
        Row(
            "Step of 1 µm, IAE",
            "lost",
            ", ".join(f"{name} {value:.3f}" for name, value in iae.items()) + " µm s",
            "Eq. 3.8 scaled to follow at rest; the PID's gains of Table 3.13 are lost.",
            "Appendix B",
        ),
    )
