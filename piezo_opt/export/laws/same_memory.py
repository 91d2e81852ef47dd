"""Predictive control in C beside Python, sample by sample from the same memory.

A loop with a tight controller need not forget a difference of rounding: around a delay it may
double it at every sample, with either controller as good as the other. So what is compared is one
sample at a time: the drive that follows from what is remembered, and what is remembered after it.
"""

from __future__ import annotations

import ctypes
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.control import MPC, Limits, ModelPlant
from piezo_opt.control.mpc import MPCState
from piezo_opt.errors import ModelError
from piezo_opt.export.laws.mpc import memory

FloatArray = NDArray[np.float64]

SAMPLES: Final = 1200
"""Of the check."""


def apart(
    folder: Path, name: str, compiler: str, law: MPC, limits: Limits, precision: str
) -> tuple[int, float]:
    """Samples, and the largest difference of a drive as a share of the drives' range.

    The model itself is the plant, and its sensor has faults: no number, infinite, stuck, and out of
    range; references are out of reach, or none. Where limits bind, or did a sample before, moves of
    next to nothing have a sign that rounding decides, the loop's law follows that sign, and what is
    best jumps: there half of the samples must agree, to a hundred times the difference. In double
    the estimated states count as well.

    Raises:
        ModelError: the code does not compile, or answers beyond the limits or with no number.
    """
    with tempfile.TemporaryDirectory(prefix="piezo_opt_replay_") as scratch:
        code = _loaded(folder, Path(scratch), name, compiler)
        kind = memory(law, name, precision)
        own = kind()
        assert code.size() == ctypes.sizeof(kind)
        init, act = getattr(code, f"{name}_init"), getattr(code, f"{name}_act")
        real = ctypes.c_float if precision == "float" else ctypes.c_double
        act.restype, act.argtypes = real, [ctypes.c_void_p, real, real]
        if law.knows_ahead:
            act = _ahead(getattr(code, f"{name}_act_ahead"), real, law)
        init.argtypes, init.restype = [ctypes.c_void_p], None
        init(ctypes.byref(own))
        return SAMPLES, _compared(law, limits, own, act, precision)


def _compared(law: MPC, limits: Limits, own: Any, act: Any, precision: str) -> float:
    generator = np.random.default_rng(0)
    h = law.observer.horizon
    values = dict(zip(h.system.parameter_names, h.p.tolist(), strict=True))
    plant = ModelPlant(h.system.model, values)
    low, high = max(limits.low, -100.0), min(limits.high, 100.0)
    time = np.arange(SAMPLES)
    triangle = 1.0 - np.abs(2.0 * ((time / 400.0) % 1.0) - 1.0)
    reference = law.gain * (low + (high - low) * (0.1 + 0.8 * triangle))
    reference[500:520] = 3.0 * law.gain * high
    reference[[610, 611]] = np.nan
    state, drive = law.begin(), min(max(0.0, limits.low), limits.high)
    reading = last = plant.begin(drive)
    waiting = [drive] * law.delay
    drives, states = np.empty((SAMPLES, 2)), np.empty((2, SAMPLES, h.states + 1))
    free, inside, bound = np.empty(SAMPLES, dtype=bool), True, False
    for k in range(SAMPLES):
        seen = reading + law.observer.noises[2] * float(generator.normal())
        if k % 97 == 11:
            seen = (float("nan"), float("inf"), -float("inf"))[k // 97 % 3]
        if 700 <= k < 720:
            seen = last
        if 900 <= k < 905:
            seen = 1e3 * law.span
        last = seen
        _remember(own, state)
        drives[k, 1] = act(ctypes.byref(own), float(reference[k]), seen)
        least, most = limits.around(drive, law.period)
        asked, state = law.act(state, float(reference[k]), seen, law.period, least, most)
        drive = drives[k, 0] = min(max(asked, least), most)
        assert state.estimate is not None
        states[:, k] = state.estimate.states, own.x[:]
        # What binds in a program leaves moves of nothing in the plan that the next one begins with.
        binds = state.iterations > 0 or own.iterations > 0
        free[k] = not (binds or bound)
        bound = binds
        # What a float takes for a limit may lie beyond it by its last digit.
        slack = 1e-6 * max(abs(least), abs(most))
        inside = inside and least - slack <= drives[k, 1] <= most + slack
        waiting.append(drive)
        reading = plant.advance(waiting.pop(0), law.period)
    if not inside:
        raise ModelError("The exported code passes the limits, or answers with what is no number.")
    span = float(np.ptp(drives[:, 0])) or 1.0
    off = np.abs(drives[:, 1] - drives[:, 0]) / span
    found = [float(off[free].max(initial=0.0))]
    if not free.all():
        found.append(1e-2 * float(np.median(off[~free])))
    if precision == "double":
        wide = np.ptp(states[0], axis=0)
        found.append(float((np.abs(states[1] - states[0]) / np.where(wide > 0.0, wide, 1.0)).max()))
    return max(found)


def _ahead(call: Any, real: Any, law: MPC) -> Callable[[Any, float, float], float]:
    """The function that takes the references of a whole horizon, where the law knows them."""
    call.restype, call.argtypes = real, [ctypes.c_void_p, ctypes.c_void_p, real]

    def act(own: Any, reference: float, seen: float) -> float:
        goals = law.following(own._obj.samples, reference)
        if not np.isfinite(reference):
            goals = np.full(law.horizon, np.nan)
        return float(call(own, (real * law.horizon)(*goals), seen))

    return act


def _remember(own: Any, state: MPCState) -> None:
    """Put what Python remembers into the memory of the code."""
    if state.estimate is None or state.moves is None:
        return
    own.x[:] = state.estimate.states.tolist()
    own.spread[:] = state.estimate.covariance.ravel().tolist()
    own.held, own.drive = state.estimate.drive, state.pending[-1]
    own.moves[:] = state.moves.tolist()
    own.waiting[:] = list(state.pending)
    own.samples, own.off = state.sample, state.estimate.off


def _loaded(folder: Path, scratch: Path, name: str, compiler: str) -> ctypes.CDLL:
    size = scratch / "size.c"
    size.write_text(f'#include "{name}.h"\nlong size(void) {{ return (long)sizeof({name}); }}\n')
    target = scratch / "replayed.so"
    built = subprocess.run(
        [compiler, "-std=c99", "-O2", "-shared", "-fPIC", f"-I{folder}", str(size),
         str(folder / f"{name}.c"), "-lm", "-o", str(target)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if built.returncode:
        first = (built.stderr.strip() or "no message").splitlines()[0]
        raise ModelError(f"The exported code does not compile with {compiler}: {first}")
    code = ctypes.CDLL(str(target))
    code.size.restype = ctypes.c_long
    return code
