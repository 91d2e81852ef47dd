"""One run: a contender from a start, its best-so-far history, and what it cost."""

from __future__ import annotations

import math
import os
import signal
import time
from dataclasses import dataclass
from multiprocessing import current_process, get_all_start_methods, get_context
from multiprocessing.connection import Connection
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.benchmark.optimisation.contenders import CONTENDERS
from piezo_opt.benchmark.optimisation.posed import Posed
from piezo_opt.benchmark.optimisation.recording import Recorded, Spent
from piezo_opt.errors import PiezoOptError

FloatArray = NDArray[np.float64]

SKIPPED: Final = "skipped"
_PATIENCE: Final = 20.0
"""Times the limit of processor time that a run may take on a clock."""


@final
@dataclass(frozen=True, eq=False)
class History:
    """What a run found, and when.

    Attributes:
        prices: (m,) ascending [simulations] at which the cost improved.
        costs: (m,) descending best cost so far [m^2].
        ending: ``"converged"``, ``"budget"``, ``"time"``, ``"failed"``, ``"skipped"``, or another
            word of the solver's.
        reason: why it was skipped or failed.
        seconds: wall time.
        cpu_s: [s] of processor time.
        spent: [simulations] in all.
    """

    prices: FloatArray
    costs: FloatArray
    ending: str
    reason: str
    seconds: float
    cpu_s: float
    spent: float


def run(posed: Posed, name: str, seed: int, budget: float, limit_s: float) -> History:
    """Let a contender run from a problem's start number ``seed``.

    Args:
        posed: the problem.
        name: the contender's.
        seed: number of the start, and seed of a contender that throws dice.
        budget: [simulations for each unknown and one more] that it may spend.
        limit_s: [s] of processor time after which a contender in a process of its own is ended.
    """
    contender = CONTENDERS[name]
    forks = "fork" in get_all_start_methods() and not current_process().daemon
    if contender.apart and forks:
        return _apart(posed, name, seed, budget, limit_s)
    return _here(posed, name, seed, budget, None)


def _here(posed: Posed, name: str, seed: int, budget: float, out: Connection | None) -> History:
    began, cpu = time.perf_counter(), time.process_time()
    start, _ = posed.start(seed)
    tell = None if out is None else out.send
    cost = Recorded(posed.objective(), posed.ratio, budget * (start.size + 1), tell)
    ending, reason = "failed", ""
    try:
        ending, reason = CONTENDERS[name].run(posed, cost, start, seed)
        reason = "" if ending == "converged" else reason
    except Spent:
        ending = "budget"
    except PiezoOptError as refusal:
        ending, reason = SKIPPED, str(refusal)
    except Exception as error:  # other people's solvers raise what they like: they have failed
        reason = f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
    found = History(
        np.array(cost.prices), np.array(cost.costs), ending, reason,
        time.perf_counter() - began, time.process_time() - cpu, cost.spent,
    )  # fmt: skip
    if out is not None:
        out.send(found)
    return found


def _apart(posed: Posed, name: str, seed: int, budget: float, limit_s: float) -> History:
    """The same in a process of its own, which may be silenced, and ended."""
    began = time.perf_counter()
    context = get_context("fork")
    mine, theirs = context.Pipe(duplex=False)
    child = context.Process(
        target=_silent, args=(posed, name, seed, budget, theirs, limit_s), daemon=True
    )
    child.start()
    theirs.close()
    improved: list[tuple[float, float]] = []
    try:
        while mine.poll(max(0.0, began + _PATIENCE * limit_s - time.perf_counter())):
            told = mine.recv()
            if isinstance(told, History):
                return told
            improved.append(told)
        ending, reason = "time", f"ended after {limit_s:g} s"
    except EOFError:
        child.join()
        ending, reason = "failed", f"its process died (code {child.exitcode})"
        if child.exitcode in (-signal.SIGXCPU, -signal.SIGKILL):
            ending, reason = "time", f"ended after {limit_s:g} s"
    finally:
        child.kill()
        child.join()
        mine.close()
    prices, costs = np.array(improved).reshape(-1, 2).T
    spent = float(prices[-1]) if prices.size else 0.0
    seconds = time.perf_counter() - began
    return History(prices, costs, ending, reason, seconds, min(seconds, limit_s), spent)


def _silent(
    posed: Posed, name: str, seed: int, budget: float, out: Connection, limit_s: float
) -> None:
    import resource  # there where processes fork

    # A busy machine must not end a run: processor time counts, whole seconds of it.
    whole = math.ceil(limit_s)
    resource.setrlimit(resource.RLIMIT_CPU, (whole, whole + 1))
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    _here(posed, name, seed, budget, out)
