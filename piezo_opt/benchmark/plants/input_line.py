"""Hidden effects between the command and the drive."""

# Every effect has the same signatures, whether it reads the whole scene or not.
# ruff: noqa: ARG002

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from piezo_opt.benchmark.plants.hidden import Back, Hidden, Scene
from piezo_opt.benchmark.plants.physics import Array, both, lagged


@final
@dataclass(frozen=True, kw_only=True)
class AmplifierLag(Hidden):
    """Second-order, overdamped amplifier: two poles, the slower one tau, the other tau / ratio.

    Intensity: tau times the plant's omega. Source: Fleming & Leang (2014), Design, Modeling and
    Control of Nanopositioning Systems, ch. 14.
    """

    name: ClassVar[str] = "amplifier_lag"
    plausible: ClassVar[tuple[float, float]] = (3e-3, 2.0)
    ratio: float

    def drive(self, scene: Scene, ends: Array) -> Array:
        """The command through both poles."""
        tau = self.intensity / self.scale.omega
        step = scene.grid.step
        once = both(lagged(ends, tau, float(ends[0, 0]), step))
        return both(lagged(once, tau / self.ratio, float(ends[0, 0]), step))


@final
@dataclass(frozen=True, kw_only=True)
class Delay(Hidden):
    """Pure delay, by reading the finely sampled drive earlier. Intensity: delay times omega."""

    name: ClassVar[str] = "delay"
    plausible: ClassVar[tuple[float, float]] = (3e-3, 2.0)

    def drive(self, scene: Scene, ends: Array) -> Array:
        """The command of a moment ago; before the first sample it was at rest."""
        nodes = np.concatenate((ends[0, :1], ends[1]))
        late = self.intensity / self.scale.omega / scene.grid.step
        index = np.arange(nodes.size, dtype=float)
        return both(np.interp(index - late, index, nodes))


@final
@dataclass(frozen=True, kw_only=True)
class SlewLimit(Hidden):
    """Hard limit of the drive's rate. Intensity a: the rate is fastest / (1 + a)."""

    name: ClassVar[str] = "slew_limit"
    plausible: ClassVar[tuple[float, float]] = (0.02, 400.0)
    fastest: float

    def drive(self, scene: Scene, ends: Array) -> Array:
        """The command, followed no faster than the limit allows."""
        most = self.fastest / (1.0 + self.intensity) * scene.grid.step
        value = float(ends[0, 0])
        nodes = [value]
        for wanted in ends[1].tolist():
            value += min(max(wanted - value, -most), most)
            nodes.append(value)
        return both(np.array(nodes))


@final
@dataclass(frozen=True, kw_only=True)
class Saturation(Hidden):
    """End of the amplifier's range: a hard clip, or v / (1 + |v / limit|^p)^(1/p).

    Intensity a: the limit lies at (1 - a) of the largest drive.
    """

    name: ClassVar[str] = "saturation"
    plausible: ClassVar[tuple[float, float]] = (3e-3, 0.45)
    sharpness: float
    """The exponent p; infinite for the hard clip."""

    @property
    def form(self) -> str:
        """Hard or soft."""
        return "hard" if np.isinf(self.sharpness) else "soft"

    def drive(self, scene: Scene, ends: Array) -> Array:
        """The limited command."""
        limit = (1.0 - self.intensity) * self.scale.reach
        if np.isinf(self.sharpness):
            return np.clip(ends, -limit, limit)
        p = self.sharpness
        return ends / (1.0 + np.abs(ends / limit) ** p) ** (1.0 / p)


@final
@dataclass(frozen=True, kw_only=True)
class DeadZone(Hidden):
    """Sharp dead zone around zero. Intensity: its half width over the largest drive."""

    name: ClassVar[str] = "dead_zone"
    plausible: ClassVar[tuple[float, float]] = (1e-3, 0.2)

    def drive(self, scene: Scene, ends: Array) -> Array:
        """The command less what the zone swallows."""
        half = self.intensity * self.scale.reach
        return ends - np.clip(ends, -half, half)


@final
@dataclass(frozen=True, kw_only=True)
class ChargeBackCoupling(Hidden):
    """Voltage lost to the motion's charge over a filter of two poles.

    Intensity: kappa gain omega, the loop gain of the coupling at the resonance over its quality.
    Source: Goldfarb & Celanovic (1997), IEEE Control Systems 17(3), 69-79.
    """

    name: ClassVar[str] = "charge_back_coupling"
    plausible: ClassVar[tuple[float, float]] = (5e-3, 2.0)
    slow: float
    """The slower time constant times omega."""

    def back(self) -> Back:
        """The coupling in SI units."""
        omega = self.scale.omega
        tau = self.slow / omega
        return Back(self.intensity / (self.scale.gain * omega), tau, tau / 6.0)
