"""Black-box linear models against two public packages, on ten records in one run.

Ten simulated stages (one to three resonances, lags, an amplifier, a drift of the working
point), each driven by a held random staircase and read with noise; a second record of the same
stage with another drive is kept back. Every package is given the number of poles and fits the first
record; its model is then judged on the second, where only start and offset are estimated.

Peers. SIPPY (``sippy_unipi``): output error (OE) and subspace (CVA). nfoursid: N4SID. Both are
sampled-data models and are given records less their means, over their spread. The better of all
their answers counts.

The measure is the error on the second record, which has no noise: a perfect model has none. To be
met: at least as good as the best peer on nine of ten.
"""

from __future__ import annotations

import contextlib
import io
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, final

import numpy as np

from piezo_opt.benchmark.table import table
from piezo_opt.errors import InputError
from piezo_opt.linear_models import fit_transfer
from piezo_opt.measurement import Between, FloatArray, Measurement

STEP, SAMPLES = 1e-3, 2000


@final
@dataclass(frozen=True, eq=False)
class Case:
    """A stage, its order, and two records: the first read with noise, the second clean."""

    name: str
    poles: int
    zeros: int
    train: Measurement
    test: Measurement


def _mode(hertz: float, damping: float, gain: float) -> Any:
    import control

    w = 2.0 * np.pi * hertz
    return control.tf([gain * w**2], [1.0, 2.0 * damping * w, w**2])


def _lag(seconds: float) -> Any:
    import control

    return control.tf([1.0], [seconds, 1.0])


def plants() -> tuple[tuple[str, Any, float], ...]:
    """Name, transfer function, and noise as a share of the reading's spread."""
    import control

    return (
        ("one resonance", _mode(60.0, 0.02, 1e-7), 0.01),
        ("one resonance, noisy", _mode(60.0, 0.02, 1e-7), 0.2),
        ("well damped", _mode(25.0, 0.4, 1e-7), 0.05),
        ("lag and resonance", _mode(120.0, 0.03, 1e-7) * _lag(5e-3), 0.05),
        ("two resonances", _mode(40.0, 0.02, 1e-7) + _mode(150.0, 0.01, 3e-8), 0.05),
        ("two close resonances", _mode(70.0, 0.01, 1e-7) + _mode(78.0, 0.01, 5e-8), 0.05),
        ("antiresonance", _mode(50.0, 0.02, 1e-7) + _mode(110.0, 0.02, -4e-8), 0.05),
        (
            "amplifier and two",
            (_mode(45.0, 0.03, 1e-7) + _mode(160.0, 0.02, 4e-8)) * _lag(2e-3),
            0.05,
        ),
        ("slow creep", _mode(90.0, 0.03, 1e-7) + control.tf([1.5e-8], [0.5, 1.0]), 0.02),
        (
            "three resonances",
            _mode(30.0, 0.03, 1e-7) + _mode(95.0, 0.02, 5e-8) + _mode(210.0, 0.02, 4e-8),
            0.02,
        ),
    )


def cases() -> Iterator[Case]:
    """The ten records, one after another; noise as a share of the reading's spread."""
    for k, (name, plant, share) in enumerate(plants()):
        records = []
        for part in range(2):
            chance = np.random.default_rng((k, part))
            drive = np.repeat(100.0 * chance.random(SAMPLES // 4), 4)
            reading = _sampled(plant, drive) + 2e-6
            if part == 0:
                reading = reading + share * reading.std() * chance.standard_normal(SAMPLES)
            records.append(
                Measurement(
                    time=np.arange(SAMPLES, dtype=np.float64) * STEP,
                    drive=drive,
                    position=reading,
                    between=Between.HELD,
                    name=name,
                )
            )
        yield Case(name, len(plant.poles()), len(plant.zeros()), *records)


def _sampled(plant: Any, drive: FloatArray) -> FloatArray:
    import control

    exact = control.c2d(control.ss(plant), STEP, "zoh")
    time = STEP * np.arange(drive.size)
    return np.asarray(control.forced_response(exact, time, drive).outputs).ravel()


def ours(case: Case) -> float:
    """Error on the second record over its spread."""
    (left,) = fit_transfer(case.train, case.poles, case.zeros).on(case.test)
    return left.rms / float(np.std(case.test.position))


def judged(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray, case: Case) -> float:
    """The same of a sampled state space, start and offset in least squares."""
    u = (case.test.drive - case.train.drive.mean()) / case.train.drive.std()
    n = a.shape[0]
    x = np.zeros((n, n + 1))
    x[:, 1:] = np.eye(n)
    rows = np.empty((u.size, n + 1))
    for k in range(u.size):
        rows[k] = (c @ x).ravel()
        rows[k, 0] += float(d.ravel()[0]) * u[k]
        x = a @ x
        x[:, 0] += b.ravel() * u[k]
    columns = np.column_stack([rows[:, 1:], np.ones(u.size)])
    if not np.isfinite(rows).all():
        return float("inf")
    scale = float(np.std(case.train.position))
    left = case.test.position - scale * rows[:, 0]
    left = left - columns @ np.linalg.lstsq(columns, left, rcond=None)[0]
    return float(np.sqrt(np.mean(left**2)) / np.std(case.test.position))


def _centred(case: Case) -> tuple[FloatArray, FloatArray]:
    y, u = case.train.position, case.train.drive
    return (y - y.mean()) / y.std(), (u - u.mean()) / u.std()


def sippy_output_error(case: Case) -> float:
    """SIPPY's OE of the order given."""
    import control
    from sippy_unipi import system_identification

    y, u = _centred(case)
    n = case.poles
    # Its delay counts on top of the sample that a held drive takes.
    found = system_identification(y, u, "OE", OE_orders=[n, n, 0], tsample=STEP, max_iterations=500)
    system = control.ss(control.tf(found.G.num[0][0], found.G.den[0][0], STEP))
    a, b, c, d = (np.asarray(m) for m in (system.A, system.B, system.C, system.D))
    return judged(a, b, c, d, case)


def sippy_subspace(case: Case) -> float:
    """SIPPY's CVA of the order given."""
    from sippy_unipi import system_identification

    y, u = _centred(case)
    found = system_identification(
        y, u, "CVA", SS_fixed_order=case.poles, SS_f=20, SS_p=20, tsample=STEP
    )
    return judged(found.A, found.B, found.C, found.D, case)


def nfoursid_subspace(case: Case) -> float:
    """nfoursid's N4SID of the order given."""
    import pandas
    from nfoursid.nfoursid import NFourSID

    y, u = _centred(case)
    frame = pandas.DataFrame({"y": y, "u": u})
    model = NFourSID(frame, output_columns=["y"], input_columns=["u"], num_block_rows=20)
    model.subspace_identification()
    system, _ = model.system_identification(rank=case.poles)
    return judged(system.a, system.b, system.c, system.d, case)


PEERS: tuple[tuple[str, Callable[[Case], float]], ...] = (
    ("SIPPY OE", sippy_output_error),
    ("SIPPY CVA", sippy_subspace),
    ("nfoursid", nfoursid_subspace),
)


def tried(peer: Callable[[Case], float], case: Case) -> float:
    """A peer's error, infinite where it gives up; what it prints is not ours to show."""
    try:
        with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return peer(case)
    except Exception:
        return float("inf")


@final
@dataclass(frozen=True)
class Peers:
    """Errors over the spread of the reading: ours, and each peer's (infinite where it gives up)."""

    cases: tuple[str, ...]
    ours: tuple[float, ...]
    peers: tuple[tuple[float, ...], ...]

    @property
    def met(self) -> int:
        """On how many records no peer is better."""
        pairs = zip(self.ours, self.peers, strict=True)
        return sum(own <= min(others) for own, others in pairs)

    def __str__(self) -> str:
        header = ["", "ours", *[name for name, _ in PEERS]]
        rows = [
            [case, *[f"{100.0 * one:.3f} %" for one in (own, *others)]]
            for case, own, others in zip(self.cases, self.ours, self.peers, strict=True)
        ]
        return (
            f"{table(header, rows)}\n\nError on a clean record over its spread. At least as good "
            f"as the best peer on {self.met} of {len(self.cases)}."
        )


def linear_peers() -> Peers:
    """All ten records in one run; a peer that is not installed is an error that names it."""
    for name in ("sippy_unipi", "nfoursid"):
        if find_spec(name) is None:
            raise InputError(f"{name} is not installed: pip install sippy_unipi nfoursid")
    names, mine, theirs = [], [], []
    for case in cases():
        names.append(case.name)
        mine.append(ours(case))
        theirs.append(tuple(tried(peer, case) for _, peer in PEERS))
    return Peers(tuple(names), tuple(mine), tuple(theirs))
