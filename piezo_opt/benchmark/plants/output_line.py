"""Hidden effects between the position and the reading."""

# Every effect has the same signatures, whether it reads the whole scene or not.
# ruff: noqa: ARG002

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from piezo_opt.benchmark.plants.hidden import Hidden, Scene
from piezo_opt.benchmark.plants.physics import Array, both, lagged, mechanics

HELIUM_NEON = 632.8e-9
"""Wavelength of the laser [m]."""


@final
@dataclass(frozen=True, kw_only=True)
class SecondMode(Hidden):
    """Modal residue: a second mode, slightly out of phase (non-proportional damping).

    Intensity: its static share of the reading. Source: Preumont (2011), Vibration Control of
    Active Structures, ch. 2.
    """

    name: ClassVar[str] = "second_mode"
    plausible: ClassVar[tuple[float, float]] = (1e-3, 0.2)
    omega: float
    zeta: float
    phase: float
    sign: float

    def read(self, scene: Scene, free: Array, position: Array) -> Array:
        """The reading with the mode's share."""
        q, speed = mechanics(free, self.omega, self.zeta, float(free[0, 0]), 0.0, scene.grid.step)
        share = self.sign * self.intensity
        mode: Array = q * np.cos(self.phase) + speed / self.omega * np.sin(self.phase)
        return position + share * mode


@final
@dataclass(frozen=True, kw_only=True)
class Backlash(Hidden):
    """Lost motion. Intensity: half of it over the stroke."""

    name: ClassVar[str] = "backlash"
    plausible: ClassVar[tuple[float, float]] = (3e-4, 0.05)

    def read(self, scene: Scene, free: Array, position: Array) -> Array:
        """The follower of a pin in a slot."""
        half = self.intensity * self.scale.stroke
        follower = float(position[0])
        out = []
        for pin in position.tolist():
            follower = min(max(follower, pin - half), pin + half)
            out.append(follower)
        return np.array(out)


@final
@dataclass(frozen=True, kw_only=True)
class SensorLag(Hidden):
    """Second-order, overdamped sensor electronics. Intensity: its slower tau times omega."""

    name: ClassVar[str] = "sensor_lag"
    plausible: ClassVar[tuple[float, float]] = (3e-3, 2.0)
    ratio: float

    def read(self, scene: Scene, free: Array, position: Array) -> Array:
        """The position through both poles."""
        tau = self.intensity / self.scale.omega
        start, step = float(position[0]), scene.grid.step
        return lagged(both(lagged(both(position), tau, start, step)), tau / self.ratio, start, step)


@final
@dataclass(frozen=True, kw_only=True)
class Fringes(Hidden):
    """Periodic error of a quadrature interferometer: offsets, unequal gains, wrong quadrature.

        f = 4 pi x / lambda
        error = lambda / (4 pi) arg[(cos f + p + i (r sin(f + e) + q)) exp(-i f)]

    Intensity: the offset (p, q) over the signal. Source: Heydemann (1981), Applied Optics 20(19),
    3382-3384.
    """

    name: ClassVar[str] = "sensor_nonlinearity"
    plausible: ClassVar[tuple[float, float]] = (2e-3, 0.5)
    angle: float
    unequal: float
    """Error of gain and of quadrature over the offset."""

    def read(self, scene: Scene, free: Array, position: Array) -> Array:
        """The phase that such electronics count."""
        f = 4.0 * np.pi * (position + scene.base.offset) / HELIUM_NEON
        p, q = self.intensity * np.cos(self.angle), self.intensity * np.sin(self.angle)
        other = self.unequal * self.intensity
        signal = np.cos(f) + p + 1j * ((1.0 + other) * np.sin(f + other) + q)
        wrong: Array = np.angle(signal * np.exp(-1j * f)) * HELIUM_NEON / (4.0 * np.pi)
        return position + wrong


@final
@dataclass(frozen=True, kw_only=True)
class InterferometerFringes(Hidden):
    """The same errors under another name, for a catalogue whose row is withheld."""

    name: ClassVar[str] = "interferometer_fringes"
    plausible: ClassVar[tuple[float, float]] = (2e-3, 0.5)
    fringes: Fringes

    def read(self, scene: Scene, free: Array, position: Array) -> Array:
        """As Fringes."""
        return self.fringes.at(self.intensity).read(scene, free, position)


@final
@dataclass(frozen=True, kw_only=True)
class SensorCurvature(Hidden):
    """Bent calibration: quadratic with a little cube. Intensity: error at full stroke over it."""

    name: ClassVar[str] = "sensor_curvature"
    plausible: ClassVar[tuple[float, float]] = (1e-3, 0.15)
    cube: float
    sign: float

    def read(self, scene: Scene, free: Array, position: Array) -> Array:
        """The bent reading."""
        u = position / self.scale.stroke
        return position + self.sign * self.intensity * self.scale.stroke * (
            u * u + self.cube * u**3
        )


@final
@dataclass(frozen=True, kw_only=True)
class Drift(Hidden):
    """Warm-up, or a line with a slow sine. Intensity: drift in a record over the stroke."""

    name: ClassVar[str] = "drift"
    plausible: ClassVar[tuple[float, float]] = (1e-3, 0.3)
    warm_up: float
    """Time constant over the duration of a record; 0 for the straight line."""
    sine: float
    phase: float
    sign: float

    @property
    def form(self) -> str:
        """Warm-up or line and sine."""
        return "warm-up" if self.warm_up > 0.0 else "line and sine"

    def read(self, scene: Scene, free: Array, position: Array) -> Array:
        """The reading with its wandering zero."""
        share = scene.grid.time / self.scale.duration
        if self.warm_up > 0.0:
            shape = -np.expm1(-share / self.warm_up) / -np.expm1(-1.0 / self.warm_up)
        else:
            shape = share + self.sine * np.sin(2.0 * np.pi * 0.7 * share + self.phase)
        wander: Array = self.sign * self.intensity * self.scale.stroke * shape
        return position + wander


@final
@dataclass(frozen=True, kw_only=True)
class MainsPickup(Hidden):
    """50 Hz as the grid really holds it, with a harmonic. Intensity: amplitude over the stroke."""

    name: ClassVar[str] = "mains_pickup"
    plausible: ClassVar[tuple[float, float]] = (2e-4, 0.05)
    frequency: float
    phase: float
    harmonic: float
    order: int

    def read(self, scene: Scene, free: Array, position: Array) -> Array:
        """The humming reading."""
        turn = 2.0 * np.pi * self.frequency * scene.grid.time
        hum = np.sin(turn + self.phase) + self.harmonic * np.sin(self.order * turn)
        return position + self.intensity * self.scale.stroke * hum
