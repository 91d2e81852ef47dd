"""Small records of kinds that went wrong once, with what is in them.

Each function gives samples of time [s], drive [V] and displacement [m] without its noise.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from piezo_opt.measurement import FloatArray
from tests.first_hour import plant

Signals = tuple[FloatArray, FloatArray, FloatArray]


def _clock(count: int, rate: float) -> FloatArray:
    return np.arange(count) / rate


def late_limit() -> Signals:
    """The drive is cut at 104 V, which one late peak alone reaches."""
    t = _clock(8000, 2000)
    u = 50 + 40 * np.sin(2 * np.pi * 2.3 * t) * np.cos(2 * np.pi * 0.41 * t)
    late = (t > 3.6) & (t < 3.85)
    u[late] += 45 * np.sin(np.pi * (t[late] - 3.6) / 0.25) ** 2
    return t, u, plant.moved(np.minimum(plant.fine(u, 10), 104.0), 1 / 2000, 10)


def late_slew() -> Signals:
    """The amplifier rises at most 9 kV/s and falls at most 22 kV/s; one late burst asks more."""
    t = _clock(8000, 2000)
    u = 50 + 30 * np.sin(2 * np.pi * 3 * t)
    late = (t > 3.6) & (t < 3.8)
    u[late] += 25 * np.sign(np.sin(2 * np.pi * 40 * (t[late] - 3.6)))
    asked = plant.fine(u, 20).tolist()
    rise, fall, now = 9e3 / 40_000, 2.2e4 / 40_000, asked[0]
    given = []
    for one in asked:
        now += min(max(one - now, -fall), rise)
        given.append(now)
    return t, u, plant.moved(np.array(given), 1 / 2000, 20)


SLACK: Final = 0.2
"""Half width of the play in ``short_small_play`` [V]."""


def short_small_play() -> Signals:
    """A play of the drive of 0.2 V under triangles of up to 90 V that become smaller."""
    t = _clock(5000, 2000)
    u = 90 * (0.2 + 0.8 * np.exp(-t / 2)) * (1 - np.abs((2 * 1.7 * t) % 2 - 1))
    played = []
    now = 0.0
    for one in plant.fine(u, 10).tolist():
        now = min(max(now, one - SLACK), one + SLACK)
        played.append(now)
    return t, u, plant.moved(np.array(played), 1 / 2000, 10)


def _noisy_drive() -> tuple[FloatArray, FloatArray]:
    t = _clock(1500, 600)
    lines = np.arange(1, 200) * 0.4
    phases = np.random.default_rng(4).uniform(0, 2 * np.pi, lines.size)
    u = np.sum(np.cos(2 * np.pi * np.outer(t, lines) + phases), axis=1)
    return t, 20 * u / u.std()


def _forced(cubic: float, damping: float) -> Signals:
    t, u = _noisy_drive()
    strain = plant.D * plant.fine(u, 30)
    y = plant.forced(
        strain, 1 / 600 / 30, omega=2 * np.pi * 70, zeta=0.05, cubic=cubic, damping=damping
    )
    return t, u, y[::30]


def hardening() -> Signals:
    """A resonator with a hardening spring and no hysteresis."""
    return _forced(8e9, 0.0)


def quadratic_damping() -> Signals:
    """A resonator with damping that grows with speed and no hysteresis."""
    return _forced(0.0, 3e4)


def _staircase(rate: float) -> Signals:
    t = _clock(int(15 * rate), rate)
    u = 20.0 * np.floor(t / 3)
    return t, u, plant.reading(u, 1 / rate)


def staircase() -> Signals:
    """Steps of 20 V every 3 s."""
    return _staircase(1000.0)


def short_staircase() -> Signals:
    """The same at a tenth of the rate."""
    return _staircase(100.0)


def _late_start(rate: float) -> Signals:
    t = _clock(int(30 * rate), rate)
    u = np.where(t < 10, 0.0, 40 - 40 * np.cos(2 * np.pi * 2 * (t - 10)))
    return t, u, plant.reading(u, 1 / rate, parts=2)


def late_start() -> Signals:
    """Ten seconds of rest, then a sine."""
    return _late_start(2000.0)


def short_late_start() -> Signals:
    """The same at a twentieth of the rate."""
    return _late_start(100.0)


RAIL: Final = ((900, 2), (2100, 6), (3333, 3), (5000, 4))
"""First sample and length of the runs at the sensor's rail."""


def dropouts() -> Signals:
    """Runs of two to six readings at the rail; the noise comes on top, as it does to the rest."""
    t = _clock(6000, 2000)
    u = 50 + 45 * np.sin(2 * np.pi * 2.1 * t)
    y = plant.reading(u, 1 / 2000)
    for first, count in RAIL:
        y[first : first + count] = 40e-6
    return t, u, y


def butterfly() -> Signals:
    """Strain with the square of a polarisation that switches."""
    t = _clock(4000, 200)
    u = 500 * np.sin(2 * np.pi * 0.2 * t)
    rising = np.diff(u, prepend=u[0]) > 0
    goal = np.tanh((u - np.where(rising, 180, -180)) / 60)
    polarisation = np.empty_like(u)
    now = 0.0
    for index, one in enumerate(goal.tolist()):
        now += 0.15 * (one - now)
        polarisation[index] = now
    return t, u, 4e-6 * polarisation**2 + 4e-9 * u * polarisation


def six_periods() -> Signals:
    """A drive played six times to the last bit behind an amplifier with a lag of 0.8 ms."""
    t = _clock(4800, 2000)
    one = 50 + 40 * np.sin(2 * np.pi * 2.5 * t[:800]) + 8 * np.sin(2 * np.pi * 60 * t[:800])
    u = np.tile(one, 6)
    share = 1 - np.exp(-1 / (2000 * 8e-4))
    slow = [u[0]]
    for wanted in u[1:].tolist():
        slow.append(slow[-1] + (wanted - slow[-1]) * share)
    return t, u, plant.reading(np.array(slow), 1 / 2000)


def held(seed: int) -> Callable[[], Signals]:
    """Bouc-Wen and a resonance of 150 Hz under a multisine that a converter holds."""

    def make() -> Signals:
        t = _clock(3000, 1000)
        lines = np.array([3, 7, 13, 29, 47, 71, 97, 131, 149, 173])
        phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, lines.size)
        u = 50 + 4 * np.sum(np.sin(2 * np.pi * np.outer(t, lines) + phases), axis=1)
        strain = 1e-7 * u - plant.loop(u, 4e-8, 0.03, 0.02)
        y = plant.resonator(strain, 1e-3, 2 * np.pi * 150, 0.05, kind="zoh")
        return t, u, y

    return make


def _sweep(count: int, phase: Callable[[FloatArray], FloatArray], *, looped: bool) -> Signals:
    t = _clock(count, 4000)
    u = 40 * np.sin(2 * np.pi * phase(t))
    y = plant.reading(u, 1 / 4000, parts=8, omega=2 * np.pi * 180, looped=looped)
    return t, u, y


def sweep_linear() -> Signals:
    """1 to 400 Hz in 2 s over a resonance at 180 Hz."""
    return _sweep(8000, lambda t: t + 399 / 4 * t * t, looped=False)


def sweep_loop() -> Signals:
    """The same with a loop."""
    return _sweep(8000, lambda t: t + 399 / 4 * t * t, looped=True)


def sweep_long() -> Signals:
    """The same frequencies on a logarithmic scale in 20 s, without a loop."""
    return _sweep(80_000, lambda t: 20 / np.log(400) * (400 ** (t / 20) - 1), looped=False)


MODES: Final = ((250.0, 1.0, 0.03), (560.0, 0.5, 0.02), (1010.0, -0.3, 0.015))
"""Natural frequency [Hz], share in the reading and damping ratio."""


def short_three_modes() -> Signals:
    """50 to 1500 Hz in 1 s over three resonances that lie side by side."""
    t = _clock(6000, 6000)
    c = plant.fine(10 * np.sin(2 * np.pi * (50 * t + 1450 / 2 * t * t)), 20)
    strain = plant.D * c - plant.loop(c)
    y = sum(
        share * plant.resonator(strain, 1 / 6000 / 20, 2 * np.pi * hertz, zeta)
        for hertz, share, zeta in MODES
    )
    return t, c[::20], np.asarray(y)[::20]


class Kind(NamedTuple):
    """How a record is made, and its noise [m]."""

    make: Callable[[], Signals]
    noise: float


KINDS: Final[dict[str, Kind]] = {
    "late_limit": Kind(late_limit, 1e-8),
    "late_slew": Kind(late_slew, 1e-8),
    "short_small_play": Kind(short_small_play, 1e-8),
    "short_three_modes": Kind(short_three_modes, 2e-9),
    "hardening": Kind(hardening, 1e-8),
    "quadratic_damping": Kind(quadratic_damping, 1e-8),
    "staircase": Kind(staircase, 1e-8),
    "short_staircase": Kind(short_staircase, 1e-8),
    "late_start": Kind(late_start, 1e-8),
    "short_late_start": Kind(short_late_start, 1e-8),
    "dropouts": Kind(dropouts, 1e-8),
    "butterfly": Kind(butterfly, 2e-8),
    "six_periods": Kind(six_periods, 3e-8),
    **{f"held_{seed}": Kind(held(seed), 2e-9) for seed in range(11, 17)},
    "sweep_linear": Kind(sweep_linear, 3e-9),
    "sweep_loop": Kind(sweep_loop, 3e-9),
    "sweep_long": Kind(sweep_long, 3e-9),
}
LINEAR: Final = 'effects = ["piezo_gain", "second_order", "offset"]\n'
"""A model file of a resonator without hysteresis."""


def put(folder: Path, name: str) -> Path:
    """The record as a file of text, with its noise."""
    kind = KINDS[name]
    t, u, y = kind.make()
    y = y + kind.noise * np.random.default_rng(len(name)).standard_normal(t.size)
    file = folder / f"{name}.csv"
    with file.open("w", encoding="utf-8") as out:
        out.write("time [s],voltage [V],displacement [um]\n")
        out.writelines(
            f"{a:.9g},{b:.9g},{c:.9g}\n"
            for a, b, c in zip(t.tolist(), u.tolist(), (1e6 * y).tolist(), strict=True)
        )
    return file
