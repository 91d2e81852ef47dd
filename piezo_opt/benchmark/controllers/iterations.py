"""A real-time iteration beside solvers that go on until they have converged, in the same loop."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from time import thread_time
from typing import Any, Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.benchmark.controllers.toolkit import ToolkitMPC, installed
from piezo_opt.benchmark.table import table
from piezo_opt.control import MPC, Limits, ModelPlant, close_loop
from piezo_opt.control.whole import WholeMPC
from piezo_opt.effects import BoucWen, Creep, Model, PiezoGain, SecondOrder
from piezo_opt.units import show

FloatArray = NDArray[np.float64]

VALUES: Final = {
    "piezo_gain.d": 1.5e-7, "bouc_wen.alpha": 5e-8, "bouc_wen.beta": 0.03,
    "bouc_wen.gamma": -0.005, "creep.c": 0.05, "creep.tau": 1.0,
    "second_order.omega": 2.0 * np.pi * 200.0, "second_order.zeta": 0.03,
}  # fmt: skip
STAGES: Final[tuple[tuple[str, Model, float], ...]] = (
    ("with a loop", PiezoGain() + BoucWen() + Creep(elements=1) + SecondOrder(), 38.0),
    ("without", PiezoGain() + Creep(elements=2) + SecondOrder(), 28.0),
)
"""Two actuators of four states, and the highest drive of each, below what the reference's top
takes: limits of range and slew rate matter in every period of it."""
PERIOD: Final = 1e-3
SPAN: Final = 6e-6
HORIZON: Final = 50
LOW, SLEW = -5.0, 8.5e3
WEIGHT: Final = 1e-5
NOISE: Final = 5e-9
CONVERGED: Final = 15
"""Linearisations a sample that stand for the converged solution: cost of the plan is the same to
1e-4 from four on."""
CONVERGED_WAY: Final = f"{CONVERGED} of them"
SHARE: Final = {CONVERGED_WAY: 3, "IPOPT": 150, "FATROP": 50, "do-mpc": 100}
"""Of the samples of the iteration, the others run on one in so many: they take seconds."""
FEWEST: Final = 20
REPEATED: Final = 5
"""Runs of the iteration's loop: each is the same to the last bit, and of every sample the shortest
time counts, which is what it takes itself and not what the machine does beside it."""


DRAWS: Final = 6
"""Draws of the sensor's noise on which the iterations' costs are compared: a single one decides on
which side of a corner of the law some samples fall, and tells a cost to 1 % only."""


@final
@dataclass(frozen=True)
class Timed:
    """One way on one actuator.

    Attributes:
        actuator, way: which.
        samples: of the loop; ``iterating`` those whose program met a limit, which alone are judged
            (all where none did).
        median, late: processor's time of a sample with its filter, middle and 99.9 % [s]; of the
            iteration the shortest of :data:`REPEATED` runs of the same loop, sample by sample.
        failed: share of the samples in which it did not converge.
        cost: of the loop, over that of :data:`CONVERGED` linearisations on the same samples; of the
            iterations the mean over :data:`DRAWS` draws of the noise.
        sure: standard error of that mean; 0 where there is one draw.
        slower: median over that of the iteration in the same run.
    """

    actuator: str
    way: str
    samples: int
    iterating: int
    median: float
    late: float
    failed: float
    cost: float
    sure: float
    slower: float


@final
@dataclass(frozen=True)
class Iterations:
    """All ways.

    Attributes:
        rows: of every actuator and way.
        skipped: why a way is not there.
    """

    rows: tuple[Timed, ...]
    skipped: str

    def __str__(self) -> str:
        head = (
            "actuator", "way", "samples", "with limits", "a sample", "99.9 %", "over middle",
            "failed", "loop's cost", "times as long",
        )  # fmt: skip
        rows = [
            (
                r.actuator, r.way, str(r.samples), str(r.iterating), show(r.median, "s"),
                show(r.late, "s"), f"{r.late / r.median:.2f}", f"{100.0 * r.failed:.1f} %",
                f"{r.cost:.4f}" + (f" +- {r.sure:.4f}" if r.sure > 0.0 else ""), f"{r.slower:.3g}",
            )
            for r in self.rows
        ]  # fmt: skip
        told = (
            f"{HORIZON} periods, 4 states; times are a processor's, of samples that met limits, of "
            f"the iteration the shortest of {REPEATED} runs of the same loop"
        )
        return "\n".join([told, table(head, rows), *([self.skipped] if self.skipped else [])])

    def row(self, actuator: str, way: str) -> Timed:
        """One of them."""
        return next(r for r in self.rows if (r.actuator, r.way) == (actuator, way))

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units."""
        return {"rows": [asdict(row) for row in self.rows], "skipped": self.skipped}


@final
class _Clocked:
    """A controller whose samples are timed, and asked whether they met limits."""

    def __init__(self, controller: Any) -> None:
        self._controller = controller
        self.spent: list[float] = []
        self.iterations: list[int] = []
        self.status: list[int] = []

    def begin(self) -> Any:
        """As the controller's own."""
        return self._controller.begin()

    def act(
        self, state: Any, reference: float, reading: float, period: float, low: float, high: float
    ) -> tuple[float, Any]:
        """The same, and how long it took."""
        began = thread_time()
        drive, after = self._controller.act(state, reference, reading, period, low, high)
        self.spent.append(thread_time() - began)
        self.iterations.append(after.iterations)
        self.status.append(after.status)
        return drive, after


def iterations(
    samples: int,
    progress: Callable[[str], None] | None = None,
    *,
    stages: Sequence[tuple[str, Model, float]] = STAGES,
) -> Iterations:
    """Run the loops.

    Args:
        samples: of the real-time iteration; solvers run on fewer.
        progress: told what runs.
        stages: actuators.
    """
    rows: list[Timed] = []
    for actuator, model, high in stages:
        rows += _compared(actuator, model, high, samples, progress or (lambda _: None))
    skipped = "" if installed() else "do-mpc is not installed: pip install 'piezo_opt[bench]'"
    return Iterations(tuple(rows), skipped)


def _compared(
    actuator: str, model: Model, high: float, samples: int, say: Callable[[str], None]
) -> list[Timed]:
    reference = SPAN * (1.0 - np.abs(2.0 * ((10.0 * PERIOD * np.arange(samples)) % 1.0) - 1.0))
    limits = Limits(LOW, high, SLEW)
    values = {k: v for k, v in VALUES.items() if k in model.parameters}

    def designed(rounds: int) -> MPC:
        return MPC(
            model, values, period=PERIOD, span=SPAN, horizon=HORIZON, limits=limits,
            weight=WEIGHT, noise=NOISE, reference=reference, rounds=rounds,
        )  # fmt: skip

    def run(controller: Any, count: int, seed: int = 0) -> tuple[_Clocked, FloatArray]:
        """A loop, and what each of its samples cost."""
        clocked = _Clocked(controller)
        loop = close_loop(
            ModelPlant(model, values), clocked, reference[:count], period=PERIOD, limits=limits,
            noise=NOISE, seed=seed,
        )  # fmt: skip
        moves = np.diff(loop.drive, prepend=0.0)
        return clocked, (loop.error / SPAN) ** 2 + WEIGHT * (moves / (SPAN / own.gain)) ** 2

    own = designed(1)
    run(own, min(100, samples))  # pages and caches
    say(f"{actuator}: real-time iteration")
    first, price = run(own, samples)
    for _ in range(REPEATED - 1):
        first.spent = np.minimum(first.spent, run(own, samples)[0].spent).tolist()
    met = np.array(first.iterations) > 0
    middle = float(np.median(_judged(first, met)))
    say(f"{actuator}: {CONVERGED} linearisations a sample")
    long = max(samples // SHARE[CONVERGED_WAY], FEWEST)
    whole, least = run(designed(CONVERGED), long)
    others = [run(designed(CONVERGED), long, seed)[1].sum() for seed in range(1, DRAWS)]

    def told(way: str, clocked: _Clocked, cost: FloatArray, rounds: int = 0) -> Timed:
        ratios = [cost[: least.size].sum() / least[: cost.size].sum()]
        if rounds:
            ratios += [
                run(designed(rounds), long, seed)[1].sum() / other
                for seed, other in enumerate(others, 1)
            ]
        n, judged = cost.size, _judged(clocked, met)
        center, late = np.quantile(judged, (0.5, 0.999))
        return Timed(
            actuator, way, n, judged.size, float(center), float(late),
            float(np.mean(np.array(clocked.status) != 0)),
            float(np.mean(ratios)),
            float(np.std(ratios, ddof=1) / np.sqrt(len(ratios))) if rounds else 0.0,
            float(center / middle),
        )  # fmt: skip

    found = [told("real-time iteration", first, price, 1)]
    found.append(told("two of them", *run(designed(2), samples), 2))
    found.append(told(CONVERGED_WAY, whole, least))
    ways: dict[str, Callable[[], Any]] = {
        "IPOPT": lambda: WholeMPC(designed(1), "ipopt"),
        "FATROP": lambda: WholeMPC(designed(1), "fatrop"),
    }
    if installed():
        ways["do-mpc"] = lambda: ToolkitMPC(designed(1))
    for way, made in ways.items():
        count = max(samples // SHARE[way], min(FEWEST, samples))
        say(f"{actuator}: {way}, {count} samples")
        found.append(told(way, *run(made(), count)))
    return found


def _judged(clocked: _Clocked, met: NDArray[np.bool_]) -> FloatArray:
    """Times of the samples that meet limits, as the iteration tells it; of all where none does."""
    spent = np.array(clocked.spent)
    chosen = met[: spent.size]
    return spent[chosen] if chosen.any() else spent
