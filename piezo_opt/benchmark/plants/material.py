"""Hidden effects in the loop and in the strain."""

# Every effect has the same signatures, whether it reads the whole scene or not.
# ruff: noqa: ARG001, ARG002

from __future__ import annotations

from dataclasses import dataclass
from math import log10, sinh, tanh
from typing import ClassVar, Literal, final

import numpy as np

from piezo_opt.benchmark.plants.hidden import Hidden, Pull, Scene
from piezo_opt.benchmark.plants.physics import Array, both, lagged


@final
@dataclass(frozen=True, kw_only=True)
class Asymmetry(Hidden):
    """Other slopes on the two branches: alpha (1 + a p(v)) loading, alpha (1 - a p(v)) unloading.

    p is v over the largest drive, bent as tanh or with a cube. Intensity: a. Source: Zhu & Wang
    (2012), Sensors and Actuators A 181, 51-60 (the effect, in another form).
    """

    name: ClassVar[str] = "asymmetry"
    plausible: ClassVar[tuple[float, float]] = (0.01, 0.9)
    alpha: float
    bend: float
    sign: float

    @property
    def form(self) -> str:
        """Tanh or cube."""
        return "tanh" if self.bend > 0.0 else "cube"

    def pull(self) -> Pull:
        """What a branch adds."""
        strength, reach, bend = self.sign * self.intensity * self.alpha, self.scale.reach, self.bend

        def term(drive: float, move: float, seconds: float, loop: float) -> tuple[float, float]:
            u = drive / reach
            shape = tanh(bend * u) / bend if bend > 0.0 else u - bend * u * u * u
            return strength * shape * abs(move), 0.0

        return term


@final
@dataclass(frozen=True, kw_only=True)
class RateDependence(Hidden):
    """A loop whose width depends on the frequency.

    "relaxation": thermally activated, -r h_max sinh(c h / h_max) / c, so it forgets faster where
    it is strained more. "width": the loop narrows with the logarithm of the rate,
    beta (1 + r lg(1 + |v'| / q)). Intensity: r times the duration of a record / 40, or r.
    """

    name: ClassVar[str] = "rate_dependence"
    plausible: ClassVar[tuple[float, float]] = (2e-3, 3.0)
    law: Literal["relaxation", "width"]
    beta: float
    bend: float
    slow: float
    """The rate q from which on the width falls [V/s]."""

    @property
    def form(self) -> str:
        """Relaxation or width."""
        return self.law

    def pull(self) -> Pull:
        """The drag of time, or of the rate."""
        most, bend = self.scale.loop, self.bend
        rate = 40.0 * self.intensity / self.scale.duration
        wider, slow = self.intensity * self.beta, self.slow

        def relaxed(drive: float, move: float, seconds: float, loop: float) -> tuple[float, float]:
            c = bend * min(abs(loop) / most, 3.0)
            return 0.0, rate * seconds * (sinh(c) / c if c > 1e-6 else 1.0)

        def widened(drive: float, move: float, seconds: float, loop: float) -> tuple[float, float]:
            # A jump has no duration: it is the fastest move that the plant's drive makes.
            quick = abs(move) / seconds / slow if seconds > 0.0 else 1e3
            return 0.0, wider * log10(1.0 + quick) * abs(move)

        return relaxed if self.law == "relaxation" else widened


@final
@dataclass(frozen=True, kw_only=True)
class NonlinearGain(Hidden):
    """Gain that grows with the drive: lg cosh (even, nearly quadratic) and a saturating odd part.

    Intensity: the even part at the largest drive over the linear displacement there.
    """

    name: ClassVar[str] = "nonlinear_gain"
    plausible: ClassVar[tuple[float, float]] = (1e-3, 0.2)
    odd: float
    sign: float

    def strain(self, scene: Scene, ends: Array, free: Array) -> Array:
        """Even and odd part."""
        reach = self.scale.reach
        u = ends / reach
        even = np.log(np.cosh(0.8 * u)) / np.log(np.cosh(0.8))
        added: Array = (
            self.sign * self.intensity * self.scale.gain * reach
            * (even + self.odd * (np.tanh(u) - u))
        )  # fmt: skip
        return added


@final
@dataclass(frozen=True, kw_only=True)
class Creep(Hidden):
    """Creep as a dense spectrum of Kelvin-Voigt elements, three a decade.

    "logarithmic": s (1 + g lg(1 + t / t0)), whose spectrum is g exp(-t0 / tau) per decade of tau
    (exactly); "fractional": s (1 + c (t / t0)^p), whose spectrum grows as tau^p. Intensity: the
    creep per decade of time. Source: Adriaens, de Koning & Banning (2000), IEEE/ASME Trans.
    Mechatronics 5(4); Ferry (1980), Viscoelastic Properties of Polymers (spectra).
    """

    name: ClassVar[str] = "creep"
    plausible: ClassVar[tuple[float, float]] = (1e-3, 0.06)
    begin: float
    """The time t0 [s]."""
    power: float
    """The exponent p; 0 for logarithmic creep."""

    @property
    def form(self) -> str:
        """Logarithmic or fractional."""
        return "fractional" if self.power > 0.0 else "logarithmic"

    def longest(self, duration: float) -> float:
        """Where the spectrum may end: far beyond what a record of that duration shows [s]."""
        return 100.0 * duration

    def spectrum(self, longest: float) -> tuple[Array, Array]:
        """Time constants [s] of the elements up to there, and their weights."""
        decades = np.log10(longest / (0.2 * self.begin))
        taus = 0.2 * self.begin * 10.0 ** np.arange(0.0, decades, 1.0 / 3.0)
        weights = np.exp(-self.begin / taus) * (taus / self.begin) ** self.power / 3.0
        return taus, weights

    def strain(self, scene: Scene, ends: Array, free: Array) -> Array:
        """The sum of the spectrum's elements, all at rest at the start."""
        taus, weights = self.spectrum(self.longest(scene.grid.count * scene.grid.step))
        nodes = np.zeros(scene.grid.count + 1)
        for tau, weight in zip(taus.tolist(), weights.tolist(), strict=True):
            nodes += weight * lagged(free, tau, 0.0, scene.grid.step)
        return both(self.intensity * nodes)


@final
@dataclass(frozen=True, kw_only=True)
class Temperature(Hidden):
    """Gain that follows the temperature, exp(a dT). Intensity: a times the span of dT."""

    name: ClassVar[str] = "temperature"
    plausible: ClassVar[tuple[float, float]] = (1e-3, 0.15)
    span: float
    """How far the temperature goes in a record [K]."""
    sign: float

    def strain(self, scene: Scene, ends: Array, free: Array) -> Array:
        """The gain's change."""
        grown = np.expm1(self.sign * self.intensity / self.span * both(scene.warmer))
        added: Array = self.scale.gain * ends * grown
        return added


@final
@dataclass(frozen=True, kw_only=True)
class ThermalExpansion(Hidden):
    """Expansion of a body that follows its thermometer with a small lag.

    Intensity: expansion over the span of temperatures, over the stroke.
    """

    name: ClassVar[str] = "thermal_expansion"
    plausible: ClassVar[tuple[float, float]] = (1e-3, 0.3)
    span: float
    lag: float
    """Thermal time constant over the duration of a record."""
    sign: float

    def strain(self, scene: Scene, ends: Array, free: Array) -> Array:
        """The expansion."""
        warm = lagged(
            both(scene.warmer), self.lag * self.scale.duration, float(scene.warmer[0]),
            scene.grid.step,
        )  # fmt: skip
        return both(self.sign * self.intensity / self.span * self.scale.stroke * warm)
