"""Effects that stand in no catalogue, planted where a correction shall find them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Final, final

import numpy as np

import piezo_opt as po
from piezo_opt.diagnosis.entering import Entering
from piezo_opt.diagnosis.noise import NoiseFloor
from piezo_opt.effects import Effect
from piezo_opt.effects.base import Chain, Equations, Parameter, Place
from piezo_opt.measurement import FloatArray
from piezo_opt.symbolic import abs_, sin
from tests.diagnosis.plants import MOVING, NOISE, clock, fitted, measured

FLOOR: Final = NoiseFloor(NOISE, 0.97 * NOISE, 1.03 * NOISE, True, "known")


def swept(time: FloatArray) -> FloatArray:
    """0..60 V with minor loops, and a sweep through the resonance at 60 Hz."""
    t = time / time[-1]
    slow = (20.0 + 8.0 * np.cos(4.0 * np.pi * t)) * (1.0 - np.cos(16.0 * np.pi * t))
    return np.asarray(slow + 3.0 * np.sin(2.0 * np.pi * (20.0 + 80.0 * t) * t))


@final
@dataclass(frozen=True)
class Drag(Effect):
    """Drag of a liquid.

    x'' += -k |x'| x'
    """

    place = Place.MOTION
    k = Parameter("1/m", "drag", 0.0, null=0.0)

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        rate = chain.position.rate
        return Equations(gives=-p.k * abs_(rate) * rate)


@final
@dataclass(frozen=True)
class DriveWave(Effect):
    """A ripple of the strain over the drive.

    s += a sin(v / 5 V)
    """

    place = Place.STRAIN
    a = Parameter("m", "ripple", 0.0, null=0.0)

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        return Equations(gives=p.a * sin(chain.drive.value / 5.0))


@final
@dataclass(frozen=True)
class Hump(Effect):
    """A damping with a hump in the travel, a law that no library of terms has.

    x'' += -c x' / (1 + ((x - 3 um) / 0.8 um)^2)^2
    """

    place = Place.MOTION
    c = Parameter("1/s", "damping", 0.0, null=0.0)

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        field = 1.0 / (1.0 + ((chain.position.value - 3e-6) / 0.8e-6) ** 2)
        return Equations(gives=-p.c * field**2 * chain.position.rate)


@final
@dataclass(frozen=True)
class LoopWave(Effect):
    """A loop whose strength waves along the drive.

    h' += a sin(v / 7 V) v'
    """

    place = Place.LOOP
    a = Parameter("m/V", "wave", 0.0, null=0.0)

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        return Equations(gives=p.a * sin(chain.drive.value / 7.0) * chain.drive.rate)


@final
@dataclass(frozen=True)
class InputWave(Effect):
    """A ripple of the amplifier.

    v = u + a sin(u / 4 V)
    """

    place = Place.INPUT
    a = Parameter("V", "ripple", 0.0, null=0.0)

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        before = chain.incoming.value
        return Equations(gives=before + p.a * sin(before / 4.0))


HIDDEN: Final[Mapping[str, tuple[Effect, Mapping[str, float]]]] = {
    "drag": (Drag(), {"k": 2e4}),
    "drive wave": (DriveWave(), {"a": 2e-8}),
    "input wave": (InputWave(), {"a": 0.25}),
    "hump": (Hump(), {"c": 60.0}),
    "loop wave": (LoopWave(), {"a": 8e-9}),
}


@cache
def planted(name: str, samples: int = 4000) -> po.Fit:
    """MOVING fitted to a record with the named effect in it; ``"noise"`` hides nothing."""
    time = clock(samples, 2000.0)
    hidden = (HIDDEN[name],) if name in HIDDEN else ()
    return fitted(MOVING, measured(MOVING, time, swept(time), *hidden))


@cache
def entering(name: str) -> Entering:
    """The answers to corrections of the same fit."""
    return Entering(planted(name))
