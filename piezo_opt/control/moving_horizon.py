"""A moving-horizon estimate of the states: the last readings together, on the hysteretic model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.control.observe import Estimate, Observer
from piezo_opt.effects import Model
from piezo_opt.errors import InputError
from piezo_opt.identification import Fit

FloatArray = NDArray[np.float64]

_ENOUGH: Final = 1e-10
"""Fall of the cost, as a share, that ends the iterations."""
_HALVINGS: Final = 6
"""Of a step that does not lower the cost: the loop's law has corners."""


@final
@dataclass(frozen=True, eq=False)
class Window:
    """What is known at an instant, and what it follows from.

    Attributes:
        estimate: of the states and the disturbance, now.
        arrival: of those at the window's beginning, by the filter.
        drives, readings: of the periods since, [V] and [m], oldest first.
        iterations: of the last program.
    """

    estimate: Estimate
    arrival: Estimate
    drives: tuple[float, ...] = ()
    readings: tuple[float, ...] = ()
    iterations: int = 0


@final
class MovingHorizon:
    """States of hysteresis, creep and mechanics, and a disturbance, from a window of readings.

        min  |e|^2 + sum_i |w_i / q|^2 + (v_i / s)^2 + ((y_i - g(x_i) - d_i) / r)^2
        x_0 = x^ + P^(1/2) e,   x_i = f(x_(i-1), u_(i-1) + w_i1, u_i + w_i2),   d_i = d_(i-1) + v_i

    by Gauss-Newton over e, w and v: the model is linearised, exactly, along the whole window again
    and again, where a filter does so once a sample. x^ and P at the beginning of the window are the
    filter's. A reading that is no number has no weight. Noises may be zero: what has no noise does
    not move. On a linear model this is the Kalman filter; on a Bouc-Wen loop its estimates were
    those of the extended one to 2 %, whose one linearisation a sample was enough there.

    Args:
        plant: a fit, or a model with ``values``.
        values: SI values by full name.
        period: of the sampling [s].
        noise: r, standard deviation of the reading [m].
        drive_noise: q, of the drive [V].
        drift: s, of the disturbance's step in a period [m]; a tenth of the noise unless given.
        window: readings.
        iterations: linearisations at most.

    Raises:
        InputError: no window, no iterations, or noises that are not positive.

    Sources: Rao, Rawlings & Mayne (2003), IEEE Trans. Autom. Control 48(2), 246-258; Bell (1994),
    SIAM J. Optim. 4(3), 626-636.
    """

    def __init__(
        self, plant: Fit | Model, values: Mapping[str, float] | None = None, *, period: float,
        noise: float, drive_noise: float = 0.1, drift: float | None = None, window: int = 20,
        iterations: int = 10,
    ) -> None:  # fmt: skip
        if min(window, iterations) < 1:
            raise InputError(
                f"window = {window}, iterations = {iterations}: give one reading and one "
                "linearisation or more"
            )
        self.observer = Observer(
            plant, values, period=period, noise=noise, drive_noise=drive_noise, drift=drift
        )
        walk = 0.1 * noise if drift is None else drift
        self._noise, self._sizes = noise, np.array([drive_noise, drive_noise, walk])
        self.window, self.iterations = window, iterations

    def begin(self, drive: float = 0.0, uncertainty: float | None = None) -> Window:
        """At rest at a drive [V]; the disturbance may be anywhere within ``uncertainty`` [m]."""
        return self.at(self.observer.begin(drive, uncertainty))

    def at(self, estimate: Estimate) -> Window:
        """From what is known of the states."""
        return Window(estimate, estimate)

    def after(self, known: Window, drive: float, reading: float) -> Window:
        """One period later: the drive [V] that was held in it, and the reading [m] at its end."""
        drives, readings = (*known.drives, drive), (*known.readings, reading)
        arrival = known.arrival
        if len(drives) > self.window:
            arrival = self.observer.after(arrival, drives[0], readings[0])
            drives, readings = drives[1:], readings[1:]
        spread, count = self._solved(arrival, drives, readings)
        return Window(spread, arrival, drives, readings, count)

    def _solved(
        self, arrival: Estimate, drives: tuple[float, ...], readings: tuple[float, ...]
    ) -> tuple[Estimate, int]:
        """The estimate at the end of the window, and how many linearisations it took."""
        root = _root(arrival.covariance)
        size = arrival.states.size
        unknown = np.zeros(size + 3 * len(drives))
        run = self._along(arrival, root, unknown, drives, readings)
        cost, count = run.cost(unknown), 0
        while count < self.iterations:
            count += 1
            rows = np.vstack([np.eye(unknown.size), run.slopes])
            step = np.linalg.lstsq(rows, np.append(-unknown, run.off), rcond=None)[0]
            share = 1.0
            for _ in range(_HALVINGS):
                trial = unknown + share * step
                there = self._along(arrival, root, trial, drives, readings)
                if there.cost(trial) < cost:
                    break
                share *= 0.5
            gained = cost - there.cost(trial)
            if gained <= 0.0:
                break
            unknown, run, cost = trial, there, cost - gained
            if gained <= _ENOUGH * cost:
                break
        # (1 + J'J)^-1 is the covariance of the unknowns.
        inner = np.linalg.inv(np.eye(unknown.size) + run.slopes.T @ run.slopes)
        spread = run.end_by @ inner @ run.end_by.T
        time = arrival.time + self.observer.horizon.period * len(drives)
        before = drives[-2] if len(drives) > 1 else arrival.drive
        used = bool(np.isfinite(readings[-1]))
        return Estimate(time, run.end, spread, before, drives[-1], used), count

    def _along(
        self, arrival: Estimate, root: FloatArray, unknown: FloatArray,
        drives: tuple[float, ...], readings: tuple[float, ...],
    ) -> _Run:  # fmt: skip
        """The window with these unknowns, and its slopes by them."""
        h, size = self.observer.horizon, arrival.states.size
        n = size - 1
        state = arrival.states + root @ unknown[:size]
        by = np.zeros((size, unknown.size))
        by[:, :size] = root
        off, slopes = [], []
        before, time = arrival.drive, arrival.time
        for i, (drive, reading) in enumerate(zip(drives, readings, strict=True)):
            at = size + 3 * i
            first, second, walk = self._sizes * unknown[at : at + 3]
            made = h.along(
                time, state[:n], before + first, np.array([drive + second - before - first])
            )
            # Drives before and after the step, each on its own.
            after = made.b[0, :n]
            by[:n] = made.a[0, :n, :n] @ by[:n]
            by[:n, at] = self._sizes[0] * (made.a[0, :n, n] - after)
            by[:n, at + 1] = self._sizes[1] * after
            by[n, at + 2] = self._sizes[2]
            state = np.append(made.end, state[n] + walk)
            time += h.period
            before = drive
            # The reading is that of the drive as it was asked.
            read = h.reading(time, state[:n], drive)
            if np.isfinite(reading):
                off.append((reading - read - state[n]) / self._noise)
                slopes.append((made.c[0, :n] @ by[:n] + by[n]) / self._noise)
        return _Run(
            np.array(off), np.array(slopes).reshape(len(off), unknown.size), state, by
        )  # fmt: skip


@final
@dataclass(frozen=True, eq=False)
class _Run:
    """Residuals (m,) over their noise, slopes (m, k), states at the end (n,) and theirs (n, k)."""

    off: FloatArray
    slopes: FloatArray
    end: FloatArray
    end_by: FloatArray

    def cost(self, unknown: FloatArray) -> float:
        return float(unknown @ unknown + self.off @ self.off)


def _root(covariance: FloatArray) -> FloatArray:
    """R with R R' = P, of a P that may be singular."""
    size = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    unit = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(unit, unit))
    return np.asarray(unit[:, np.newaxis] * vectors * np.sqrt(np.maximum(values, 0.0)))
