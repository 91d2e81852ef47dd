"""The thesis' controllers, designed and run on its own models."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from piezo_opt.control import (
    PID,
    ClosedLoop,
    Controller,
    InverseCompensation,
    Limits,
    ModelPlant,
    StateFeedback,
    close_loop,
    lqr,
    pole_placement,
    tune_pid,
    zv,
)
from piezo_opt.effects import PiezoGain, SecondOrder
from piezo_opt.identification import Fit
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
LIMITS: Final = Limits(-30.0, 150.0)
"""Of the drive: what is left of a loop takes a negative one on the way back."""
STEP: Final = 0.01
"""Sampling of the PID on Eq. 3.8 [s]: a hundredth of its period."""
_START: Final = PID(52.628 / MICRO, 70.648 / MICRO, 3.9813 / MICRO, tau=4.0 * PERIOD)
_FOUND: Final = PID(50.137 / MICRO, 84.405 / MICRO, 3.9926 / MICRO, tau=4.0 * PERIOD)
"""The thesis' gains before and after its search, in volts a micrometre; it has no filter."""


def control_rows() -> tuple[Row, ...]:
    """Gains, shaper, and the errors of the loops."""
    best, placed = _feedbacks()
    shaper = zv(*_swing())
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
        *_hysteresis_rows(),
        *_vibration_rows(),
    )


def _gains(feedback: StateFeedback) -> str:
    k = np.ravel(feedback.gain)
    return f"[{k[0]:.3f} {k[1]:.4f}], {feedback.precompensator:.3f}"


def _feedbacks() -> tuple[StateFeedback, StateFeedback]:
    """LQR and pole placement on Eq. 3.8 as the thesis rounds it."""
    import control

    system = control.ss([[-0.82, -34.80], [1.0, 0.0]], [[1.0], [0.0]], [[0.0, 0.85]], [[0.0]])
    return lqr(system, [443.0, 335.0]), pole_placement(system, overshoot=0.02, settling=0.5)


def _swing() -> tuple[float, float]:
    """Natural frequency [rad/s] and damping of Eq. 3.8."""
    falling = eq_3_8().den[0][0]
    omega = float(np.sqrt(falling[2]))
    return omega, float(falling[1]) / (2.0 * omega)


@lru_cache(maxsize=1)
def hysteresis_loops(fit: Fit) -> Mapping[str, ClosedLoop]:
    """The triangle of 50 s on an identified loop, by controller."""
    time = np.arange(0.0, 50.0 + PERIOD, PERIOD)
    reference = STROKE * (1.0 - np.abs(time / 25.0 - 1.0))
    tuned = tune_pid(fit, reference, period=PERIOD, limits=LIMITS, start=_START)
    controllers: Mapping[str, Controller] = {
        "PID": _FOUND, "inverse": InverseCompensation.of(fit), "PID tuned here": tuned.controller,
    }  # fmt: skip
    return MappingProxyType(
        {
            name: close_loop(ModelPlant(fit), one, reference, period=PERIOD, limits=LIMITS)
            for name, one in controllers.items()
        }
    )


def _hysteresis_rows() -> tuple[Row, ...]:
    loops = hysteresis_loops(loop_fit())
    pid, inverse, tuned = (loops[k] for k in ("PID", "inverse", "PID tuned here"))
    return (
        Row(
            "PID on the loop's model: largest error",
            "about 0.15 µm",
            _largest(pid),
            f"The thesis' optimal gains, a reading every {1e3 * PERIOD:.0f} ms; IAE "
            f"{1e6 * pid.iae:.2f} µm s.",
            "Table 3.11, Fig. 4.4, close_loop",
        ),
        Row(
            "PID from the thesis' start, tuned here: largest error",
            "about 0.15 µm",
            _largest(tuned),
            f"For the integral of the absolute error, within a sensitivity peak of 2; IAE "
            f"{1e6 * tuned.iae:.2f} µm s.",
            "Table 3.11, tune_pid",
        ),
        Row(
            "Inverse compensation: largest error",
            "less than the PID's",
            _largest(inverse),
            f"The compensator cancels the hysteresis; the lag of the mechanics stays. IAE "
            f"{1e6 * inverse.iae:.2f} µm s.",
            "Eq. 3.14, Fig. 4.4, close_loop",
        ),
    )


def _largest(loop: ClosedLoop) -> str:
    return f"{1e6 * loop.largest:.3f} µm"


@lru_cache(maxsize=1)
def vibration_answers() -> tuple[FloatArray, Mapping[str, FloatArray]]:
    """Times [s] and answers of Eq. 3.8 to a step of 1 [1], by controller.

    It is scaled to follow at rest. The thesis' gains of its PID are lost: ours are tuned for the
    integral of the absolute error, within the drive that the pole placement begins with.
    """
    import control

    plant = eq_3_8() / float(np.real(eq_3_8()(0.0)))
    best, placed = _feedbacks()
    time = np.linspace(0.0, SPAN, 5001)
    step = np.ones_like(time)
    command = zv(*_swing()).shaped(time, np.where(time > 0.0, 1.0, 0.0))

    def answer(system: Any, command: FloatArray) -> FloatArray:
        return np.asarray(control.forced_response(system, time, command).outputs).ravel()

    omega, zeta = _swing()
    values = {"piezo_gain.d": 1e-6, "second_order.omega": omega, "second_order.zeta": zeta}
    model, wanted = PiezoGain() + SecondOrder(), np.full(int(SPAN / STEP) + 1, 1e-6)
    wanted[0] = 0.0
    most = placed.precompensator * float(np.real(eq_3_8()(0.0))) / MICRO
    limits = Limits(-most, most)
    tuned = tune_pid(model, wanted, values=values, period=STEP, limits=limits)
    loop = close_loop(
        ModelPlant(model, values), tuned.controller, wanted, period=STEP, limits=limits
    )
    return time, MappingProxyType(
        {
            "none": answer(plant, step),
            "ZV": answer(plant, command),
            "LQR": answer(best.closed, step),
            "pole placement": answer(placed.closed, step),
            "PID tuned here": np.interp(time, loop.time, 1e6 * loop.position),
        }
    )


def _vibration_rows() -> tuple[Row, ...]:
    time, answers = vibration_answers()
    iae = {name: float(np.trapezoid(np.abs(1.0 - y), time)) for name, y in answers.items()}
    return (
        Row(
            "Step of 1 µm, IAE",
            "lost",
            ", ".join(f"{name} {value:.3f}" for name, value in iae.items()) + " µm s",
            "Eq. 3.8 scaled to follow at rest; the PID's gains of Table 3.13 are lost.",
            "Appendix B",
        ),
    )
