"""How far a loop is from swinging up by itself: gain margin, phase margin, sensitivity peak."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import control
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from piezo_opt.control.linearise import linearise
from piezo_opt.control.pid import PID
from piezo_opt.effects import Model
from piezo_opt.errors import InputError
from piezo_opt.identification import Fit

ComplexArray = NDArray[np.complex128]
FloatArray = NDArray[np.float64]

FREQUENCIES = 1500
"""Points of a frequency axis, evenly spaced in its logarithm over five decades: neighbours are
0.8 % apart, and a peak of a loop with a damping of 0.01 is met to 0.2 dB."""


@final
@dataclass(frozen=True, eq=False)
class Margins:
    """Of a sampled loop with the open loop L.

    Attributes:
        gain: by how much L may grow before the loop is unstable; infinite where it never is.
        phase: by how much L may lag before it is [rad]; infinite where |L| never crosses 1.
        peak: largest |1 / (1 + L)|, the sensitivity to disturbances.
        stable: whether every closed-loop pole lies inside the unit circle.
    """

    gain: float
    phase: float
    peak: float
    stable: bool


def frequencies(period: float) -> FloatArray:
    """Angular frequencies [rad/s] up to half the sampling rate."""
    top = np.pi / period
    return np.asarray(np.geomspace(1e-5 * top, top, FREQUENCIES))


def sampled(
    system: control.StateSpace, period: float, delay: int = 0
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A plant between a held drive and the reading at the instants of sampling: A, B, C.

    The reading is taken before the drive changes, so that what passes straight through shows one
    sample later; a computing delay of whole periods comes before.

    Args:
        system: continuous, one input, one output.
        period: [s].
        delay: whole periods.
    """
    n = system.nstates
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[:n, n:] = system.A, system.B
    grown = expm(period * whole)
    # One more state is the drive of the sample before, for what passes straight through; delays
    # are shifted through further ones.
    late = 1 + delay
    a, b, c = np.zeros((n + late, n + late)), np.zeros((n + late, 1)), np.zeros((1, n + late))
    a[:n, :n], c[0, :n], c[0, n] = grown[:n, :n], np.asarray(system.C)[0], float(system.D[0, 0])
    if delay:
        a[:n, n + 1], a[n, n + 1], b[-1, 0] = grown[:n, n], 1.0, 1.0
        for k in range(n + 1, n + late - 1):
            a[k, k + 1] = 1.0
    else:
        b[:n, 0], b[n, 0] = grown[:n, n], 1.0
    return a, b, c


def response(
    matrices: tuple[FloatArray, FloatArray, FloatArray], z: ComplexArray
) -> ComplexArray:  # fmt: skip
    """C (z - A)^-1 B at points z."""
    a, b, c = matrices
    inner = z[:, np.newaxis, np.newaxis] * np.eye(a.shape[0]) - a
    return np.asarray((c @ np.linalg.solve(inner, np.broadcast_to(b, (z.size, *b.shape))))[:, 0, 0])


def margins(
    plant: control.StateSpace | Fit | Model,
    controller: PID | control.TransferFunction | control.StateSpace,
    *,
    period: float,
    delay: int = 0,
    values: Mapping[str, float] | None = None,
    at: float = 0.0,
) -> Margins:
    """Margins of the sampled loop of a plant and a controller, for small motions.

    Args:
        plant: a linear system, or a fit or model, which is linearised.
        controller: a PID, or a sampled system from the error to the drive.
        period: of the sampling [s].
        delay: whole periods that computing takes.
        values: SI values of a model.
        at: the drive around which it is linearised [V].

    Raises:
        InputError: a controller sampled at another period.

    Source: Astrom & Murray (2021), Feedback Systems, 2nd ed., ch. 10.
    """
    linear = plant if isinstance(plant, control.StateSpace) else linearise(plant, values, at=at)
    law = controller.transfer_function(period) if isinstance(controller, PID) else controller
    if law.dt != period:
        raise InputError(f"The controller is sampled every {law.dt} s, the loop every {period} s.")
    a, b, c = sampled(linear, period, delay)
    z = np.exp(1j * period * frequencies(period))
    loop = response((a, b, c), z) * np.array([law(point) for point in z])
    closed = control.feedback(control.series(control.ss(law), control.ss(a, b, c, 0.0, period)), 1)
    stable = bool(np.abs(control.poles(closed)).max(initial=0.0) < 1.0)
    return Margins(*_crossings(loop), float(np.max(1.0 / np.abs(1.0 + loop))), stable)


def _crossings(loop: ComplexArray) -> tuple[float, float]:
    """Gain and phase margin by linear interpolation between the points of a response."""
    size, angle = np.log(np.abs(loop)), np.unwrap(np.angle(loop))
    gain = phase = float("inf")
    # The phase crosses an odd multiple of pi where sin crosses zero and cos is negative.
    for k in np.flatnonzero(np.diff(np.floor((angle + np.pi) / (2.0 * np.pi))) != 0.0):
        goal = 2.0 * np.pi * np.round((angle[k] + np.pi) / (2.0 * np.pi)) - np.pi
        share = (goal - angle[k]) / (angle[k + 1] - angle[k])
        there = size[k] + share * (size[k + 1] - size[k])
        if there < 0.0:
            gain = min(gain, float(np.exp(-there)))
    for k in np.flatnonzero(np.diff(np.sign(size)) != 0.0):
        share = -size[k] / (size[k + 1] - size[k])
        there = angle[k] + share * (angle[k + 1] - angle[k])
        phase = min(phase, float(abs(np.pi - abs(there) % (2.0 * np.pi))))
    return gain, phase
