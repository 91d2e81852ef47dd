"""The classes of the bench: which effects there are, and which records show them."""

# Every builder has the same signature, whether it needs all of the plant or not.
# ruff: noqa: ARG001

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TypeAlias, final

import numpy as np

from piezo_opt.benchmark.plants.drives import Kind
from piezo_opt.benchmark.plants.hidden import Hidden, Scale, log_uniform
from piezo_opt.benchmark.plants.input_line import (
    AmplifierLag,
    ChargeBackCoupling,
    DeadZone,
    Delay,
    Saturation,
    SlewLimit,
)
from piezo_opt.benchmark.plants.material import (
    Asymmetry,
    Creep,
    NonlinearGain,
    RateDependence,
    Temperature,
    ThermalExpansion,
)
from piezo_opt.benchmark.plants.motion import CubicStiffness, Friction, HystereticForce
from piezo_opt.benchmark.plants.output_line import (
    Backlash,
    Drift,
    Fringes,
    InterferometerFringes,
    MainsPickup,
    SecondMode,
    SensorCurvature,
    SensorLag,
)
from piezo_opt.benchmark.plants.outside import (
    GainSwitching,
    LoadChange,
    StickEvents,
    UnrecordedInput,
)
from piezo_opt.benchmark.plants.physics import Base

Builder: TypeAlias = Callable[[np.random.Generator, Scale, Base], Hidden]

ALL: tuple[Kind, ...] = ("steps", "triangles", "multisine", "chirp", "combined")
QUICK: tuple[Kind, ...] = ("steps", "multisine", "chirp", "combined")
SWINGS: tuple[Kind, ...] = ("triangles", "chirp", "combined")
SWEEPS: tuple[Kind, ...] = ("triangles", "multisine", "chirp", "combined")
HOLDS: tuple[Kind, ...] = ("steps", "combined")


@final
@dataclass(frozen=True)
class Shows:
    """How an effect is made, and the records that show it.

    Attributes:
        build: draws its shape; its intensity is set later.
        kinds: classes of drives in which it is visible.
        still: how often its records are quasi-static.
        slow: it needs long records.
        zero: the drive must pass through zero.
        fine: it is smaller than anything else, and so are stroke and noise.
        linear: the drive must not be held.
        warm: it needs the temperature.
    """

    build: Builder
    kinds: tuple[Kind, ...]
    still: float = 0.0
    slow: bool = False
    zero: bool = False
    fine: bool = False
    linear: bool = False
    warm: bool = False


def _sign(random: np.random.Generator) -> float:
    return 1.0 if random.uniform() < 0.5 else -1.0


def _lag(random: np.random.Generator, scale: Scale, base: Base) -> Hidden:
    return AmplifierLag(intensity=0.0, scale=scale, ratio=log_uniform(random, 4.0, 15.0))


def _delay(random: np.random.Generator, scale: Scale, base: Base) -> Hidden:
    return Delay(intensity=0.0, scale=scale)


def _slew(random: np.random.Generator, scale: Scale, base: Base) -> Hidden:
    # At intensity 0 the fastest rate is that of a full swing in a fifth of the resonance's period.
    fastest = 5.0 * scale.span * scale.omega / (2.0 * np.pi)
    return SlewLimit(intensity=0.0, scale=scale, fastest=fastest)


def _saturation(random: np.random.Generator, scale: Scale, base: Base) -> Hidden:
    sharpness = np.inf if random.uniform() < 0.5 else random.uniform(10.0, 24.0)
    return Saturation(intensity=0.0, scale=scale, sharpness=sharpness)


def _dead_zone(random: np.random.Generator, scale: Scale, base: Base) -> Hidden:
    return DeadZone(intensity=0.0, scale=scale)


def _charge(random: np.random.Generator, scale: Scale, base: Base) -> Hidden:
    return ChargeBackCoupling(intensity=0.0, scale=scale, slow=random.uniform(0.5, 2.5))


def _asymmetry(random: np.random.Generator, scale: Scale, base: Base) -> Hidden:
    bend = random.uniform(0.5, 1.0) if random.uniform() < 0.5 else -random.uniform(0.1, 0.4)
    return Asymmetry(intensity=0.0, scale=scale, alpha=base.alpha, bend=bend, sign=_sign(random))


def _rate(random: np.random.Generator, scale: Scale, base: Base) -> Hidden:
    return RateDependence(
        intensity=0.0, scale=scale, law="relaxation" if random.uniform() < 0.7 else "width",
        beta=base.beta, bend=random.uniform(0.5, 1.2),
        slow=scale.span / scale.duration * log_uniform(random, 3.0, 30.0),
    )  # fmt: skip


def _nonlinear(random: np.random.Generator, scale: Scale, base: Base) -> Hidden:
    return NonlinearGain(
        intensity=0.0, scale=scale, odd=random.uniform(-0.4, 0.4), sign=_sign(random)
    )


def _creep(random: np.random.Generator, scale: Scale, base: Base) -> Hidden:
    return Creep(
        intensity=0.0, scale=scale, begin=scale.duration * log_uniform(random, 3e-3, 3e-2),
        power=0.0 if random.uniform() < 0.7 else random.uniform(0.05, 0.2),
    )  # fmt: skip


def _temperature(random: np.random.Generator, scale: Scale, base: Base) -> Hidden:
    return Temperature(intensity=0.0, scale=scale, span=3.0, sign=_sign(random))


def _expansion(random: np.random.Generator, scale: Scale, base: Base) -> Hidden:
    return ThermalExpansion(
        intensity=0.0, scale=scale, span=3.0, lag=random.uniform(0.002, 0.01), sign=_sign(random)
    )


def _cubic(random: np.random.Generator, scale: Scale, base: Base) -> Hidden:
    sinh = random.uniform() < 0.5
    return CubicStiffness(
        intensity=0.0, scale=scale, bend=random.uniform(0.8, 1.6) if sinh else 0.0,
        even=random.uniform(0.0, 0.4), sign=1.0 if sinh else _sign(random),
    )  # fmt: skip


def _friction(random: np.random.Generator, scale: Scale, base: Base) -> Hidden:
    return Friction(
        intensity=0.0, scale=scale, presliding=log_uniform(random, 0.01, 0.1),
        static=random.uniform(1.0, 1.4),
    )  # fmt: skip


def _memory(random: np.random.Generator, scale: Scale, base: Base) -> Hidden:
    return HystereticForce(
        intensity=0.0, scale=scale, reach=log_uniform(random, 0.05, 0.4),
        exponent=random.uniform(1.0, 1.4), skew=random.uniform(-0.3, 0.3),
    )  # fmt: skip


def _mode(random: np.random.Generator, scale: Scale, base: Base) -> Hidden:
    return SecondMode(
        intensity=0.0, scale=scale, omega=scale.omega * random.uniform(1.35, 2.4),
        zeta=log_uniform(random, 0.006, 0.05), phase=random.uniform(-0.1, 0.1),
        sign=_sign(random),
    )  # fmt: skip


def _backlash(random: np.random.Generator, scale: Scale, base: Base) -> Hidden:
    return Backlash(intensity=0.0, scale=scale)


def _sensor_lag(random: np.random.Generator, scale: Scale, base: Base) -> Hidden:
    return SensorLag(intensity=0.0, scale=scale, ratio=log_uniform(random, 4.0, 15.0))


def _fringes(random: np.random.Generator, scale: Scale, base: Base) -> Fringes:
    return Fringes(
        intensity=0.0, scale=scale, angle=random.uniform(0.0, 2.0 * np.pi),
        unequal=random.uniform(0.0, 0.15),
    )  # fmt: skip


def _unnamed_fringes(random: np.random.Generator, scale: Scale, base: Base) -> Hidden:
    fringes = _fringes(random, scale, base)
    return InterferometerFringes(intensity=0.0, scale=scale, fringes=fringes)


def _curvature(random: np.random.Generator, scale: Scale, base: Base) -> Hidden:
    return SensorCurvature(
        intensity=0.0, scale=scale, cube=random.uniform(-0.15, 0.15), sign=_sign(random)
    )


def _drift(random: np.random.Generator, scale: Scale, base: Base) -> Hidden:
    warm_up = random.uniform() < 0.5
    return Drift(
        intensity=0.0, scale=scale, warm_up=log_uniform(random, 0.4, 4.0) if warm_up else 0.0,
        sine=random.uniform(0.0, 0.05), phase=random.uniform(0.0, 2.0 * np.pi),
        sign=_sign(random),
    )  # fmt: skip


def _mains(random: np.random.Generator, scale: Scale, base: Base) -> Hidden:
    return MainsPickup(
        intensity=0.0, scale=scale, frequency=50.0 + random.uniform(-0.02, 0.02),
        phase=random.uniform(0.0, 2.0 * np.pi), harmonic=random.uniform(0.0, 0.05),
        order=int(random.choice([2, 3])),
    )  # fmt: skip


def _switching(random: np.random.Generator, scale: Scale, base: Base) -> Hidden:
    return GainSwitching(intensity=0.0, scale=scale, switches=int(random.integers(3, 16)))


def _unrecorded(random: np.random.Generator, scale: Scale, base: Base) -> Hidden:
    return UnrecordedInput(
        intensity=0.0, scale=scale, signal="telegraph" if random.uniform() < 0.5 else "sine",
        events=int(random.integers(6, 25)),
    )  # fmt: skip


def _sticks(random: np.random.Generator, scale: Scale, base: Base) -> Hidden:
    return StickEvents(intensity=0.0, scale=scale, events=int(random.integers(5, 25)))


def _load(random: np.random.Generator, scale: Scale, base: Base) -> Hidden:
    return LoadChange(intensity=0.0, scale=scale, spring=random.uniform(0.1, 0.6))


INSIDE: Mapping[str, Shows] = MappingProxyType(
    {
        "amplifier_lag": Shows(_lag, QUICK),
        "delay": Shows(_delay, QUICK, linear=True),
        "slew_limit": Shows(_slew, QUICK),
        "saturation": Shows(_saturation, ALL, still=0.2),
        "dead_zone": Shows(_dead_zone, ALL, still=0.2, zero=True),
        "charge_back_coupling": Shows(_charge, QUICK),
        "asymmetry": Shows(_asymmetry, ("triangles", "combined", "multisine"), still=0.25),
        "rate_dependence": Shows(_rate, SWINGS, still=0.15),
        "nonlinear_gain": Shows(_nonlinear, ALL, still=0.25),
        "creep": Shows(_creep, HOLDS, still=0.35, slow=True),
        "temperature": Shows(_temperature, SWINGS, still=0.85, slow=True, warm=True),
        "thermal_expansion": Shows(_expansion, SWINGS, still=0.85, slow=True, warm=True),
        "cubic_stiffness": Shows(_cubic, ALL, still=0.15),
        "friction": Shows(_friction, ALL, still=0.15),
        "hysteretic_force": Shows(_memory, ALL, still=0.15),
        "second_mode": Shows(_mode, QUICK),
        "backlash": Shows(_backlash, ("triangles", "combined", "multisine"), still=0.3),
        "sensor_lag": Shows(_sensor_lag, QUICK),
        "sensor_nonlinearity": Shows(_fringes, SWEEPS, still=0.2, fine=True),
        "sensor_curvature": Shows(_curvature, ALL, still=0.2),
        "drift": Shows(_drift, ALL, still=0.6, slow=True),
        "mains_pickup": Shows(_mains, ALL),
    }
)
"""The effects of the catalogue that one record can show."""

BEYOND: Mapping[str, Shows] = MappingProxyType(
    {
        "interferometer_fringes": Shows(_unnamed_fringes, SWEEPS, still=0.2, fine=True),
        "gain_switching": Shows(_switching, ALL, still=0.3),
        "unrecorded_input": Shows(_unrecorded, ALL, still=0.3),
        "stick_events": Shows(_sticks, ("triangles", "multisine", "combined"), still=0.2),
        "load_change": Shows(_load, ALL),
    }
)
"""What no row of the catalogue describes (fringes: when their row is withheld)."""

OUTSIDE: tuple[str, ...] = tuple(BEYOND)
"""Names of the classes outside the catalogue."""

CLASSES: tuple[str, ...] = ("none", *INSIDE, *BEYOND)
"""Names of all classes; "none" is the base plant alone."""
