"""Classes of hidden effects: how each is drawn, how strong it may be, and where it can show."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal, TypeAlias, final

import numpy as np

from piezo_opt.benchmark.foreign import mechanics, on_drive, on_reading, on_strain, outside
from piezo_opt.benchmark.foreign.charge import SourceResistance
from piezo_opt.benchmark.foreign.scene import Scene
from piezo_opt.benchmark.foreign.simulate import Effect

Random: TypeAlias = np.random.Generator
Place: TypeAlias = Literal["drive", "strain", "motion", "reading"]


@final
@dataclass(frozen=True)
class Hides:
    """How a class is drawn.

    Attributes:
        place: in the chain.
        draw: an effect whose strength is 1, from a source of numbers, the scales of the plant,
            and the usual rate of its drive [V/s].
        low, high: plausible strengths, in the units of the effect; times the shortest time that
            a record shows where ``timed``.
        moving: True where it needs a resonance in the record.
        fine: whether it needs a small stroke, as interferometers read.
        hum: whether it needs a record that shows the mains.
        slow: whether it needs a record of at least a second.
    """

    place: Place
    draw: Callable[[Random, Scene, float], Effect]
    low: float
    high: float
    timed: bool = False
    moving: bool = False
    fine: bool = False
    hum: bool = False
    slow: bool = False


def log_uniform(random: Random, low: float, high: float) -> float:
    """Drawn so that its logarithm is uniform."""
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def _damping(random: Random) -> float | None:
    return None if random.uniform() < 0.5 else random.uniform(0.5, 1.0)


def _amplifier(random: Random, scene: Scene, usual: float) -> Effect:  # noqa: ARG001
    return on_drive.LowPass(_damping(random), 1.0)


def _delay(random: Random, scene: Scene, usual: float) -> Effect:  # noqa: ARG001
    return on_drive.DeadTime(1.0)


def _slew(random: Random, scene: Scene, usual: float) -> Effect:  # noqa: ARG001
    down = 1.0 if random.uniform() < 0.5 else log_uniform(random, 0.4, 2.5)
    return on_drive.SlewRate(3.0 * usual, down, 1.0)


def _saturation(random: Random, scene: Scene, usual: float) -> Effect:  # noqa: ARG001
    if random.uniform() < 0.5:
        return on_drive.Clipping(both=bool(random.uniform() < 0.5), strength=1.0)
    return on_drive.Compression(1.0)


def _dead_zone(random: Random, scene: Scene, usual: float) -> Effect:  # noqa: ARG001
    if random.uniform() < 0.5:
        return on_drive.LostMotion(1.0)
    centred = scene.low < 0.0 and random.uniform() < 0.5
    return on_drive.DeadBand(
        0.0 if centred else scene.middle + random.uniform(-0.4, 0.4) * scene.half, 1.0
    )


def _charge(random: Random, scene: Scene, usual: float) -> Effect:  # noqa: ARG001
    rc = log_uniform(random, 0.02, 0.2) * scene.quick
    return SourceResistance(rc, 0.5 * scene.stroke / scene.half, 1.0)


def _curved(random: Random, scene: Scene, usual: float) -> Effect:  # noqa: ARG001
    return on_strain.Curved(2 if random.uniform() < 0.6 else 3, 1.0)


def _creep(random: Random, scene: Scene, usual: float) -> Effect:  # noqa: ARG001
    form = random.integers(3)
    if form == 0:
        return on_strain.LogarithmicCreep(log_uniform(random, 1e-3, 0.1) * scene.duration, 1.0)
    if form == 1:
        return on_strain.DelayedElasticity(log_uniform(random, 0.03, 0.6) * scene.duration, 1.0)
    return on_strain.PowerCreep(scene.duration, random.uniform(0.1, 0.4), 1.0)


def _temperature(random: Random, scene: Scene, usual: float) -> Effect:  # noqa: ARG001
    return on_strain.GainWarms(1.0 if random.uniform() < 0.7 else -1.0)


def _expansion(random: Random, scene: Scene, usual: float) -> Effect:  # noqa: ARG001
    return on_strain.StackExpands(1.0 if random.uniform() < 0.5 else -1.0)


def _plays(random: Random) -> tuple[float, ...]:
    return tuple(np.sort(random.uniform(0.08, 0.6, 3)).tolist())


def _asymmetry(random: Random, scene: Scene, usual: float) -> Effect:  # noqa: ARG001
    falling = bool(random.uniform() < 0.5)
    return on_strain.UnequalPlay(_plays(random), random.uniform(0.1, 0.25), falling, 1.0)


def _rate(random: Random, scene: Scene, usual: float) -> Effect:  # noqa: ARG001
    power = None if random.uniform() < 0.5 else random.uniform(0.25, 1.0)
    return on_strain.RatePlay(_plays(random), random.uniform(0.1, 0.25), usual, power, 1.0)


def _cubic(random: Random, scene: Scene, usual: float) -> Effect:  # noqa: ARG001
    # Softening is kept from giving way.
    return mechanics.Duffing(scene.stroke, 1.0 if random.uniform() < 0.7 else -0.2)


def _friction(random: Random, scene: Scene, usual: float) -> Effect:  # noqa: ARG001
    form = random.integers(3)
    if form == 0:  # nearly Coulomb's: the motion before it slips is small
        return mechanics.Dahl(scene.stroke * log_uniform(random, 0.003, 0.01), scene.stroke, 1.0)
    if form == 1:
        return mechanics.Dahl(scene.stroke * log_uniform(random, 0.01, 0.1), scene.stroke, 1.0)
    return mechanics.LuGre(
        scene.stroke * log_uniform(random, 0.005, 0.05), random.uniform(0.2, 1.0),
        scene.stroke * log_uniform(random, 0.01, 0.1), random.uniform(0.0, 0.1), scene.stroke, 1.0,
    )  # fmt: skip


def _hysteretic(random: Random, scene: Scene, usual: float) -> Effect:  # noqa: ARG001
    if random.uniform() < 0.5:
        yields = scene.stroke * np.geomspace(0.02, random.uniform(0.2, 0.8), 8)
        return mechanics.Iwan(tuple(yields.tolist()), 1.0)
    size = scene.stroke * log_uniform(random, 0.05, 0.4)
    beta = random.uniform(0.5, 1.2)
    return mechanics.HystereticSpring(
        size, beta, random.uniform(-0.4, 0.4) * beta, int(random.integers(1, 3)), 1.0
    )


def _drag(random: Random, scene: Scene, usual: float) -> Effect:  # noqa: ARG001
    if random.uniform() < 0.5:
        return mechanics.DragDamping(scene.stroke, 1.0)
    return mechanics.AmplitudeDamping(scene.stroke, 1.0)


def _second_mode(random: Random, scene: Scene, usual: float) -> Effect:  # noqa: ARG001
    assert scene.resonance is not None
    most = min(5.0, np.pi * scene.rate / scene.resonance.omega * 0.6)
    omega = scene.resonance.omega * random.uniform(1.4, max(most, 1.6))
    zeta = log_uniform(random, 0.01, 0.1)
    if random.uniform() < 0.6:
        return on_reading.ParallelMode(omega, zeta, 1.0)
    return on_reading.FrameMode(omega, zeta, 1.0)


def _sensor_lag(random: Random, scene: Scene, usual: float) -> Effect:  # noqa: ARG001
    return on_reading.SensorFilter(_damping(random), 1.0)


def _bent_sensor(random: Random, scene: Scene, usual: float) -> Effect:  # noqa: ARG001
    return on_reading.SensorPolynomial(2 if random.uniform() < 0.5 else 3, 1.0)


def _fringes(random: Random, scene: Scene, usual: float) -> Effect:  # noqa: ARG001
    wavelength = float(random.choice([632.8e-9, 1310e-9, 1550e-9]))
    return on_reading.PeriodicError(wavelength, random.uniform(0.0, 2.0 * np.pi), 1.0)


def _drift(random: Random, scene: Scene, usual: float) -> Effect:  # noqa: ARG001
    form = random.uniform()
    if form < 0.45:
        return on_reading.Ramp(1.0 if random.uniform() < 0.5 else -1.0)
    if form < 0.8:
        return on_reading.Settling(log_uniform(random, 0.1, 1.5) * scene.duration, 1.0)
    return on_reading.RandomWalk(int(random.integers(2**31)), 1.0)


def _hum(random: Random, scene: Scene, usual: float) -> Effect:  # noqa: ARG001
    frequency = (50.0 if random.uniform() < 0.6 else 60.0) * random.uniform(0.998, 1.002)
    count = max(min(int(random.integers(1, 5)), int(0.45 * scene.rate / frequency)), 1)
    shares = (1.0, *(random.uniform(0.0, 0.4, count - 1)).tolist())
    phases = tuple(random.uniform(0.0, 2.0 * np.pi, count).tolist())
    return on_reading.Hum(frequency, shares, phases, 1.0)


def _backlash(random: Random, scene: Scene, usual: float) -> Effect:  # noqa: ARG001
    return on_reading.Backlash(1.0)


def _sticking(random: Random, scene: Scene, usual: float) -> Effect:  # noqa: ARG001
    begins = tuple(random.uniform(0.0, 0.97, int(random.integers(4, 15))).tolist())
    return outside.Sticking(begins, log_uniform(random, 0.003, 0.03), 1.0)


def _lines(random: Random, scene: Scene, usual: float) -> Effect:  # noqa: ARG001
    return outside.EncoderLines(1.0)


def _gain_step(random: Random, scene: Scene, usual: float) -> Effect:  # noqa: ARG001
    begin = random.uniform(0.2, 0.7)
    lasting = random.uniform() < 0.5
    return outside.GainStep(begin, 2.0 if lasting else begin + random.uniform(0.05, 0.25), 1.0)


def _wandering(random: Random, scene: Scene, usual: float) -> Effect:  # noqa: ARG001
    frequency = log_uniform(random, 20.0 / scene.duration, 0.15 * scene.rate)
    return outside.Wandering(frequency, int(random.integers(2**31)), 1.0)


def _dropouts(random: Random, scene: Scene, usual: float) -> Effect:  # noqa: ARG001
    count = int(random.integers(10, 50))
    heights = random.uniform(0.3, 1.0, count) * random.choice([-1.0, 1.0], count)
    return outside.Dropouts(
        tuple(random.uniform(0.0, 1.0, count).tolist()), tuple(heights.tolist()),
        tuple(random.integers(1, 7, count).tolist()), 1.0,
    )  # fmt: skip


INSIDE: Final = MappingProxyType[str, Hides](
    {
        "amplifier_lag": Hides("drive", _amplifier, 0.01, 30.0, timed=True),
        "delay": Hides("drive", _delay, 0.01, 10.0, timed=True),
        "slew_limit": Hides("drive", _slew, 0.05, 30.0),
        "saturation": Hides("drive", _saturation, 0.01, 1.0),
        "dead_zone": Hides("drive", _dead_zone, 1e-3, 0.2),
        "charge_back_coupling": Hides("motion", _charge, 3e-3, 0.6, moving=True),
        "asymmetry": Hides("strain", _asymmetry, 0.02, 1.2),
        "rate_dependence": Hides("strain", _rate, 0.01, 1.5),
        "nonlinear_gain": Hides("strain", _curved, 2e-3, 0.4),
        "creep": Hides("strain", _creep, 2e-3, 0.2),
        "temperature": Hides("strain", _temperature, 2e-4, 2e-2, slow=True),
        "thermal_expansion": Hides("strain", _expansion, 1e-4, 3e-2, slow=True),
        "cubic_stiffness": Hides("motion", _cubic, 3e-3, 0.6, moving=True),
        "friction": Hides("motion", _friction, 3e-4, 5e-2, moving=True),
        "hysteretic_force": Hides("motion", _hysteretic, 3e-3, 0.6, moving=True),
        "nonlinear_damping": Hides("motion", _drag, 3e-3, 5.0, moving=True),
        "second_mode": Hides("motion", _second_mode, 1e-3, 0.3, moving=True),
        "sensor_lag": Hides("reading", _sensor_lag, 0.01, 30.0, timed=True),
        "sensor_curvature": Hides("reading", _bent_sensor, 1e-3, 0.2),
        "sensor_nonlinearity": Hides("reading", _fringes, 2e-4, 3e-2, fine=True),
        "drift": Hides("reading", _drift, 1e-3, 0.3),
        "mains_pickup": Hides("reading", _hum, 1e-4, 5e-2, hum=True),
        "backlash": Hides("reading", _backlash, 3e-4, 0.1),
    }
)  # fmt: skip
"""Classes that the catalogue has a row for."""

BEYOND: Final = MappingProxyType[str, Hides](
    {
        "random_sticking": Hides("reading", _sticking, 0.02, 1.0),
        "encoder_lines": Hides("reading", _lines, 1e-3, 0.3),
        "gain_step": Hides("strain", _gain_step, 2e-3, 0.3),
        "wandering_vibration": Hides("reading", _wandering, 1e-4, 5e-2),
        "sensor_dropouts": Hides("reading", _dropouts, 1e-3, 0.5),
    }
)
"""Classes that no catalogue has."""

OUTSIDE: Final = tuple(BEYOND)
CLASSES: Final = ("none", *INSIDE, *OUTSIDE)
