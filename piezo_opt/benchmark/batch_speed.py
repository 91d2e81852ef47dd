"""How fast many sets of parameters are simulated, beside one after the other."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.benchmark.table import table
from piezo_opt.effects import BoucWen, Model, Offset, PiezoGain, SecondOrder
from piezo_opt.measurement import Measurement
from piezo_opt.simulation import Simulator, simulate_many
from piezo_opt.values import Values

FloatArray = NDArray[np.float64]

SCHEMA: Final = "piezo_opt/batch-speed/1"
_TRUTH: Final = {
    "piezo_gain.d": 1.2e-7, "bouc_wen.alpha": 4e-8, "bouc_wen.beta": 0.05,
    "bouc_wen.gamma": 0.01, "second_order.omega": 1130.0, "second_order.zeta": 0.08,
    "offset.y0": 2e-7,
}  # fmt: skip
_SINGLE: Final = 30
"""Sets that are simulated one by one, as all of them would take too long."""


@final
@dataclass(frozen=True, eq=False)
class BatchSpeed:
    """Nanoseconds for one sub-step of one set.

    Attributes:
        sets, samples, sub_steps: size of the task.
        single: one by one, as ``simulate`` does.
        lanes: in lanes on one core.
        squares: in lanes on one core, sums of squares only.
        cores: in lanes on all cores, sums of squares only.
        threads: how many these are.
        error: largest difference of the readings in lanes from those one by one, over their range.
        vmap: by diffrax' ``vmap``, a step of Tsit5 for each two of the sub-steps above (six stages
            for eight); None where diffrax is not installed.
        vmap_error: largest difference of its readings, over their range.
    """

    sets: int
    samples: int
    sub_steps: int
    single: float
    lanes: float
    squares: float
    cores: float
    threads: int
    error: float
    vmap: float | None = None
    vmap_error: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Plain data with a ``schema`` key."""
        return {"schema": SCHEMA, **self.__dict__}

    def __str__(self) -> str:
        rows = [
            ("one by one", self.single),
            ("in lanes", self.lanes),
            ("in lanes, sums of squares", self.squares),
            (f"in lanes, {self.threads} threads", self.cores),
        ]
        if self.vmap is not None:
            rows.append(("diffrax, vmap", self.vmap))
        cells = [(name, f"{ns:.2f}", f"{self.single / ns:.2f}") for name, ns in rows]
        return (
            f"{self.sets} sets on {self.samples} samples, {self.sub_steps} sub-steps each; "
            f"readings agree to {self.error:.0e} of the range\n"
            f"{table(('', 'ns/sub-step', 'times as fast'), cells)}" + self._beside
        )

    @property
    def _beside(self) -> str:
        if self.vmap is None:
            return "\ndiffrax is not installed"
        return (
            f"\ndiffrax differs by {self.vmap_error:.0e} of the range; lanes are "
            f"{self.vmap / self.lanes:.0f} times as fast"
        )


def measure_batch(sets: int = 1000, samples: int = 2000, repetitions: int = 15) -> BatchSpeed:
    """Simulate a loop behind a resonance for many sets, each way, and take the fastest times.

    Args:
        sets: of parameters, within 10 % of each other.
        samples: of the record, at 2 kHz.
        repetitions: of each measurement.
    """
    model: Model = PiezoGain() + BoucWen() + SecondOrder() + Offset()
    record = _record(samples)
    generator = np.random.default_rng(0)
    values = {k: v * generator.uniform(0.9, 1.1, sets) for k, v in _TRUTH.items()}
    first = simulate_many(model, values, record)
    substeps = first.substeps
    own = [
        {**Values.nominal(model), **{k: float(v[i]) for k, v in values.items()}}
        for i in range(min(sets, _SINGLE))
    ]
    simulator = Simulator(model, record, own[0], substeps=substeps)
    readings = [simulator.reading(one) for one in own]
    steps = simulator.substeps(own[0])

    def batch(**more: Any) -> None:
        simulate_many(model, values, record, substeps=substeps, **more)

    # By turns, so that whatever else the machine does hits all alike.
    ways: dict[str, tuple[Callable[[], object], int]] = {
        "single": (lambda: [simulator.reading(one) for one in own], len(own)),
        "lanes": (lambda: batch(threads=1), sets),
        "squares": (lambda: batch(threads=1, readings=False), sets),
        "cores": (lambda: batch(readings=False), sets),
    }
    least = dict.fromkeys(ways, np.inf)
    for _ in range(repetitions):
        for name, (act, count) in ways.items():
            least[name] = min(least[name], _seconds(act) / count)
    error = max(
        float(np.abs(first.readings[i] - reading).max() / np.ptp(reading))
        for i, reading in enumerate(readings)
    )
    took = {name: 1e9 * seconds / steps for name, seconds in least.items()}
    vmap, off = None, None
    if find_spec("diffrax") is not None:
        run = _vmap(record, values)
        beside = run()
        off = float(np.abs(beside - first.readings).max() / np.ptp(first.readings))
        vmap = 1e9 * min(_seconds(run) for _ in range(3)) / sets / steps
    threads = os.cpu_count() or 1
    return BatchSpeed(sets, samples, steps, **took, threads=threads, error=error, vmap=vmap,
                      vmap_error=off)  # fmt: skip


def _vmap(record: Measurement, values: dict[str, FloatArray]) -> Callable[[], FloatArray]:
    """The same model in diffrax, one step a sample, compiled for all sets on one thread."""
    jax, diffrax = __import__("jax"), __import__("diffrax")
    jax.config.update("jax_enable_x64", True)
    jnp: Any = jax.numpy
    time, drive = jnp.asarray(record.time - record.time[0]), jnp.asarray(record.drive)
    line = diffrax.LinearInterpolation(time, drive)
    sets = jnp.stack([jnp.asarray(values[name]) for name in _TRUTH], axis=1)

    def rate(t: Any, x: Any, p: Any) -> Any:
        u, slope = line.evaluate(t), line.derivative(t)
        h, s, w = x
        return (
            p[1] * slope - p[2] * jnp.abs(slope) * h - p[3] * slope * jnp.abs(h), w,
            p[4] ** 2 * (p[0] * u - h - s) - 2.0 * p[5] * p[4] * w,
        )  # fmt: skip

    def one(p: Any) -> Any:
        start = (jnp.zeros(()), p[0] * drive[0], jnp.zeros(()))
        found = diffrax.diffeqsolve(
            diffrax.ODETerm(rate), diffrax.Tsit5(), time[0], time[-1], None, start, args=p,
            saveat=diffrax.SaveAt(ts=time), stepsize_controller=diffrax.StepTo(time),
            max_steps=int(time.size),
        )  # fmt: skip
        return found.ys[1] + p[6]

    whole = jax.jit(jax.vmap(one))
    return lambda: np.asarray(whole(sets), dtype=float)


def _record(samples: int) -> Measurement:
    time = np.arange(samples) / 2000.0
    slow = 30.0 - 30.0 * np.cos(2.0 * np.pi * 10.0 * time)
    drive = slow + 8.0 * np.sin(2.0 * np.pi * (20.0 + 80.0 * time) * time)
    return Measurement(time, drive, np.linspace(0.0, 1e-6, samples), name="batch")


def _seconds(act: Callable[[], object]) -> float:
    began = time.perf_counter()
    act()
    return time.perf_counter() - began
