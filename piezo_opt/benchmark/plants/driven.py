"""A plant with creep and a second mode that is driven a period at a time, as a loop needs it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil
from typing import final

import numpy as np

from piezo_opt.benchmark.plants.classes import INSIDE
from piezo_opt.benchmark.plants.drives import make_drive
from piezo_opt.benchmark.plants.hidden import Hidden, Scale, Scene, log_uniform
from piezo_opt.benchmark.plants.material import Creep
from piezo_opt.benchmark.plants.noise import Noise, read
from piezo_opt.benchmark.plants.output_line import SecondMode
from piezo_opt.benchmark.plants.physics import Array, Base, Grid, path, pole_of
from piezo_opt.benchmark.plants.simulate import Loop, simulate

_CREEP = (0.01, 0.06)
"""Creep per decade of time: the upper part of what hardware shows."""
_MODE = (0.02, 0.2)
"""Static share of the second mode: the upper part of what hardware shows."""
_NOISE = (4e-4, 2e-3)
"""Noise over stroke."""


@final
@dataclass(frozen=True)
class Rig:
    """A plant that rests at 0 V and reads 0 there, and how it is sampled.

    Attributes:
        base, scale: of the plant.
        creep, mode: what a first model of it lacks.
        noise: rms of the sensor [m].
        rate: samples a second.
        seed: it was drawn from.
    """

    base: Base
    scale: Scale
    creep: Creep
    mode: SecondMode
    noise: float
    rate: float
    seed: int

    @property
    def effects(self) -> tuple[Hidden, ...]:
        """What is hidden."""
        return self.creep, self.mode

    @property
    def grid(self) -> Grid:
        """One period, cut as a record is."""
        return Grid(2, 0, self.rate, _substeps(self.base, self.rate))

    def record(self, samples: int) -> tuple[Array, Array, Array]:
        """Drive [V], held between samples, reading with noise, and clean reading [m]."""
        random = np.random.default_rng([self.seed, 1])
        fastest = min(1.2 * self.scale.omega / (2.0 * np.pi), self.rate / 5.0)
        drive = make_drive(
            random, "combined", samples=samples, before=0, rate=self.rate, fastest=fastest,
            low=self.scale.low, high=self.scale.high, held=True, bits=None,
        )  # fmt: skip
        clean = self.reading(drive.values)
        return drive.values, read(random, clean, Noise(self.noise, 0.0, 0.0)), clean

    def reading(self, drive: Array) -> Array:
        """The clean reading of a drive (N,) that is held between samples [m]."""
        grid = replace(self.grid, samples=drive.size)
        scene = Scene(grid, self.base, grid.ends(drive, True), np.zeros(grid.count + 1), self.seed)
        return simulate(self.base, self.effects, scene).reading


def rig(seed: int, samples: int) -> Rig:
    """Draw a plant with creep and a second mode.

    Args:
        seed: everything follows from it.
        samples: of a record, to whose duration the creep's beginning is scaled.
    """
    random = np.random.default_rng([seed, 0])
    rate = float(random.choice([2000.0, 2500.0]))
    natural = log_uniform(random, 150.0, rate / 6.0)
    high = float(random.choice([20.0, 30.0, 50.0, 75.0, 100.0, 120.0, 150.0]))
    low = 0.0 - high * float(random.choice([0.0, 0.2, 1.0]))
    gain, span = log_uniform(random, 0.05e-6, 0.3e-6), high - low
    width = random.uniform(1.5, 6.0) / span
    gamma = width * random.uniform(-0.35, 0.35)
    loop = 0.5 * random.uniform(0.03, 0.15) * gain * span
    base = Base(
        gain=gain, alpha=loop * width, beta=width - gamma, gamma=gamma, exponent=1.0, pivot=loop,
        omega=2.0 * np.pi * natural, zeta=log_uniform(random, 0.01, 0.2), offset=0.0, static=False,
    )  # fmt: skip
    scale = Scale(low, high, gain, base.omega, base.zeta, samples / rate, loop, False)
    creep, mode = (INSIDE[name].build(random, scale, base) for name in ("creep", "second_mode"))
    assert isinstance(creep, Creep)
    assert isinstance(mode, SecondMode)
    return Rig(
        base, scale, creep.at(log_uniform(random, *_CREEP)), mode.at(log_uniform(random, *_MODE)),
        log_uniform(random, *_NOISE) * scale.stroke, rate, seed,
    )  # fmt: skip


def _substeps(base: Base, rate: float) -> int:
    """As a record of the bench has them."""
    return int(np.clip(ceil(40.0 * base.omega / (2.0 * np.pi) / rate), 2, 7))


@final
class Driven:
    """A rig in a loop: :func:`~piezo_opt.benchmark.plants.simulate.simulate`, step by step.

    The drive jumps at the beginning of a period and is held; the loop knows no time, creep relaxes
    exactly, and the modes answer exactly to an input that is linear in every sub-step.
    """

    def __init__(self, rig: Rig) -> None:
        self._rig, self._period = rig, 1.0 / rig.rate
        grid, creep, mode = rig.grid, rig.creep, rig.mode
        self._parts = grid.substeps
        self._taus, weights = creep.spectrum(creep.longest(rig.scale.duration))
        self._weights = creep.intensity * weights
        self._kept = np.exp(-grid.step / self._taus)
        self._modes = [
            _Mode(rig.base.omega, rig.base.zeta, grid.step),
            _Mode(mode.omega, mode.zeta, grid.step),
        ]
        self._shares = mode.sign * mode.intensity * np.array(
            [np.cos(mode.phase), np.sin(mode.phase) / mode.omega]
        )  # fmt: skip
        self.begin(0.0)

    def begin(self, drive: float) -> float:
        """Come to rest at a drive [V], led there from 0 V; the reading [m]."""
        self._loop, self._drive = Loop(self._rig.base, ()), 0.0
        self._lead(drive)
        free = self._rig.base.gain * drive - self._loop.h
        self._lags = np.full(self._taus.size, free)
        crept = free + float(self._weights @ self._lags)
        for mode in self._modes:
            mode.rest(crept)
        return self._reading()

    def advance(self, drive: float, period: float) -> float:
        """Hold a drive [V] for a period [s], that of the rig; the reading at its end [m]."""
        if abs(period - self._period) > 1e-9 * self._period:
            raise ValueError(f"The rig is sampled every {self._period:g} s, not {period:g} s.")
        self._lead(drive)
        free = self._rig.base.gain * drive - self._loop.h
        left = free + float(self._weights @ self._lags)
        for _ in range(self._parts):
            self._lags = free + self._kept * (self._lags - free)
            right = free + float(self._weights @ self._lags)
            self._modes[0].step(left, right)
            self._modes[1].step(left, right)
            left = right
        return self._reading()

    def _lead(self, drive: float) -> None:
        """Move the loop to a drive, at once."""
        ends = np.array([[self._drive, drive], [self._drive, drive]])
        at = self._drive
        for move in path(ends, self._rig.base.width).moves.tolist():
            self._loop.move(at, move, 0.0)
            at += move
        self._drive = drive

    def _reading(self) -> float:
        x, _ = self._modes[0].state
        q, speed = self._modes[1].state
        return x + float(self._shares[0] * q + self._shares[1] * speed)


@final
class _Mode:
    """A second-order system by its exact response."""

    def __init__(self, omega: float, zeta: float, step: float) -> None:
        pole = pole_of(omega, zeta)
        self._pole, self._grown = pole, complex(np.exp(pole * step))
        total = (self._grown - 1.0) / pole
        late = (total - step) / (pole * step)
        self._early, self._late = omega**2 * (total - late), omega**2 * late
        self._c = 0j

    def rest(self, at: float) -> None:
        """At rest there."""
        self._c = -self._pole.conjugate() * at

    def step(self, left: float, right: float) -> None:
        """One sub-step under an input that is linear in it."""
        self._c = self._grown * self._c + self._early * left + self._late * right

    @property
    def state(self) -> tuple[float, float]:
        """Position and velocity."""
        x = self._c.imag / self._pole.imag
        return x, self._c.real + self._pole.real * x
