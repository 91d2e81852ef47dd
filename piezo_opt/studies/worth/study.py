"""Every controller, designed on three models of a plant, and tried on the plant itself."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, field
from typing import Any, Final, final

import numpy as np
from scipy import stats

from piezo_opt.benchmark.jobs import run_jobs
from piezo_opt.benchmark.plants.driven import Driven, Rig, rig
from piezo_opt.benchmark.table import table
from piezo_opt.control import Limits, close_loop
from piezo_opt.errors import InputError, PiezoOptError
from piezo_opt.measurement import FloatArray
from piezo_opt.studies.worth.designs import CONTROLLERS, DESIGNS, Wanted
from piezo_opt.studies.worth.models import MODELS, Known, known

SCHEMA: Final = "piezo_opt/worth/1"
REFERENCES: Final = ("triangle", "staircase")
HERTZ: Final = 10.0
PERIODS: Final = 4
"""Of the triangle."""
LOW, HIGH = 0.2, 0.8
"""Ends of the references, as shares of what the gain makes of the highest drive: the loop keeps a
fresh actuator from coming back to 0."""
STEPS, HELD, RISER = 4, 0.06, 0.01
"""Steps of the staircase up, and as many down; how long each lasts, and how long it rises [s]."""
SLEW: Final = 200.0
"""Ranges of the drive that the amplifier passes in a second; the triangle takes about 15."""
LEVEL: Final = 0.95


@final
@dataclass(frozen=True)
class Tracked:
    """One controller, designed on one model, on one plant.

    Attributes:
        reference, controller, model: which.
        rms: error on the plant, over the reference's span; nan where there is no design.
        why: why there is none.
    """

    reference: str
    controller: str
    model: str
    rms: float = float("nan")
    why: str = ""


@final
@dataclass(frozen=True)
class Judged:
    """One plant.

    Attributes:
        seed: of the plant.
        noise: of its sensor, over the span of the references.
        verdict, steps: of its diagnosis.
        left: rms that each model leaves of the record, over the noise.
        rows: what the controllers did.
        seconds: processor's time of the fits and the diagnosis, and of the controllers.
        error: why there is nothing; empty where there is something.
    """

    seed: int
    noise: float = float("nan")
    verdict: str = ""
    steps: tuple[str, ...] = ()
    left: Mapping[str, float] = field(default_factory=dict)
    rows: tuple[Tracked, ...] = ()
    seconds: tuple[float, float] = (0.0, 0.0)
    error: str = ""


@final
@dataclass(frozen=True)
class Median:
    """A median, the 95 % interval of its order statistics (none below 6), and of how many."""

    value: float
    low: float
    high: float
    count: int

    @staticmethod
    def of(values: Sequence[float]) -> Median:
        """Of the finite ones."""
        finite = np.array([v for v in values if np.isfinite(v)])
        if not finite.size:
            return Median(float("nan"), float("nan"), float("nan"), 0)
        middle = float(np.median(finite))
        # P(fewer than k of n lie below the median) is binomial: order statistics k and n + 1 - k.
        k = int(stats.binom.ppf((1.0 - LEVEL) / 2.0, finite.size, 0.5))
        if k == 0:
            return Median(middle, float("nan"), float("nan"), finite.size)
        ordered = np.sort(finite)
        return Median(middle, float(ordered[k - 1]), float(ordered[-k]), finite.size)

    def told(self, unit: str = "") -> str:
        """Three digits, and the interval where there is one."""
        if not self.count:
            return ""
        ends = "" if not np.isfinite(self.low) else f" ({self.low:.3g} to {self.high:.3g})"
        return f"{self.value:.3g}{ends}{unit}"


@final
@dataclass(frozen=True, eq=False)
class Worth:
    """What came out.

    Attributes:
        plants: those that were finished.
        asked: how many there should be.
    """

    plants: tuple[Judged, ...]
    asked: int

    @property
    def done(self) -> tuple[Judged, ...]:
        """Plants with an answer."""
        return tuple(p for p in self.plants if not p.error)

    def errors(self, reference: str, controller: str, model: str) -> list[float]:
        """rms errors over the span, one a plant, nan where there was no design."""
        wanted = (reference, controller, model)
        return [
            next(
                (r.rms for r in p.rows if (r.reference, r.controller, r.model) == wanted),
                float("nan"),
            )
            for p in self.done
        ]  # fmt: skip

    def ratio(self, reference: str, above: tuple[str, str], below: tuple[str, str]) -> Median:
        """Of the errors of two (controller, model), plant by plant."""
        pairs = zip(self.errors(reference, *above), self.errors(reference, *below), strict=True)
        return Median.of([a / b for a, b in pairs])

    @property
    def ratios(self) -> tuple[tuple[str, str, Median], ...]:
        """Reference, what is compared, and how many times larger the first error is."""
        known = "diagnosed"
        compared = [
            (f"PID over {one}, both on the {known} model", ("PID", known), (one, known))
            for one in CONTROLLERS if one not in ("PID", "inverse")
        ] + [
            (f"{one}, {worse} over {better}", (one, worse), (one, better))
            for one in CONTROLLERS
            for worse, better in (("undiagnosed", "diagnosed"), ("diagnosed", "truth"))
        ]  # fmt: skip
        found = [
            (reference, what, self.ratio(reference, above, below))
            for reference in REFERENCES for what, above, below in compared
        ]  # fmt: skip
        return tuple(row for row in found if row[2].count)

    def points(self) -> dict[str, dict[str, dict[str, list[float]]]]:
        """Errors over the span by reference, controller and model, as a picture takes them."""
        return {
            r: {c: {m: self.errors(r, c, m) for m in MODELS} for c in CONTROLLERS}
            for r in REFERENCES
        }

    def __str__(self) -> str:
        done = self.done
        lines = [
            f"{len(done)} of {self.asked} plants with creep and a second mode; {100 * LEVEL:g} % "
            "intervals of the medians",
            "",
        ]
        head = ("reference", "controller", *(f"on {m} [% of span]" for m in MODELS))
        cells = []
        for reference in REFERENCES:
            for controller in CONTROLLERS:
                each = [Median.of(self.errors(reference, controller, m)) for m in MODELS]
                if any(m.count for m in each):
                    cells.append((reference, controller, *(_percent(m, len(done)) for m in each)))
        lines += [table(head, cells), ""]
        lines.append(table(
            ("reference", "how many times larger the error is", "median"),
            [(r, what, m.told()) for r, what, m in self.ratios],
        ))  # fmt: skip
        found = sum({"creep", "second_mode"} <= set(p.steps) for p in done)
        noise = Median.of([100.0 * p.noise for p in done])
        left = ", ".join(
            f"{m} {Median.of([p.left.get(m, float('nan')) for p in done]).value:.3g}"
            for m in MODELS[:2]
        )
        lines += [
            "",
            f"The diagnosis named creep and second_mode on {found} of {len(done)}. Error of the "
            f"fit over the noise, median: {left}. Noise: {noise.told()} % of the span.",
            f"Processor's time of a plant, median: {_seconds(done, 0):.0f} s to fit and diagnose, "
            f"{_seconds(done, 1):.0f} s to design and try.",
        ]
        lines += [f"plant {p.seed} failed: {p.error}" for p in self.plants if p.error]
        why = {f"{r.controller} on {r.model}: {r.why}" for p in done for r in p.rows
               if r.why and r.controller != "inverse"}  # fmt: skip
        return "\n".join([*lines, *(f"no design: {one}" for one in sorted(why))])

    def to_dict(self) -> dict[str, Any]:
        """Plain data with a ``schema`` key."""
        return {
            "schema": SCHEMA,
            "asked": self.asked,
            "interrupted": len(self.plants) < self.asked,
            "plants": [asdict(p) for p in self.plants],
            "medians": [
                {"reference": r, "controller": c, "model": m,
                 **asdict(Median.of(self.errors(r, c, m)))}
                for r in REFERENCES for c in CONTROLLERS for m in MODELS
            ],
            "ratios": [{"reference": r, "what": w, **asdict(m)} for r, w, m in self.ratios],
        }  # fmt: skip


def study_worth(
    plants: int = 20,
    seed: int = 0,
    *,
    controllers: Sequence[str] = CONTROLLERS,
    references: Sequence[str] = REFERENCES,
    samples: int = 3000,
    executor: Executor | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Worth:
    """What a diagnosis is worth: controllers on an undiagnosed, a diagnosed and the best model.

    Each plant is drawn with its own gain, loop, resonance, creep and second mode, and shares no
    code with the package. A record of it is fitted and diagnosed; every controller is designed on
    each model and follows, on the plant, within the same range and slew rate, a triangle of 10 Hz
    and a staircase. It reads nothing but the measurement.

    Args:
        plants: how many.
        seed: of the first plant; the others follow.
        controllers: names of :data:`CONTROLLERS`.
        references: "triangle", "staircase".
        samples: of a record.
        executor: processes that share the plants.
        progress: plants done, plants in all.

    Returns:
        the study; an interrupt (Ctrl-C, a time limit) gives the plants that were finished.

    Raises:
        InputError: a name or a number that there is not.
        KeyboardInterrupt: before the first plant was finished.
    """
    for name, names in [*((c, CONTROLLERS) for c in controllers),
                        *((r, REFERENCES) for r in references)]:  # fmt: skip
        if name not in names:
            raise InputError(f"There is no '{name}': there are {', '.join(names)}.")
    if plants < 1 or samples < 1000:
        raise InputError(
            f"plants = {plants}, samples = {samples}: give at least 1 plant and 1000 samples."
        )
    shared = (tuple(controllers), tuple(references), samples)
    done: list[Judged] = []
    try:
        jobs = range(seed, seed + plants)
        done.extend(run_jobs(_judged, shared, jobs, executor, progress, _lost))
    except KeyboardInterrupt:
        if not done:
            raise
    return Worth(tuple(sorted(done, key=lambda p: p.seed)), plants)


def references_of(one: Rig) -> dict[str, FloatArray]:
    """References [m], one value a period, from rest at 0."""
    period = 1.0 / one.rate
    stroke = one.scale.gain * one.scale.high
    low, high = LOW * stroke, HIGH * stroke
    rate = 2.0 * HERTZ * (high - low)
    lead = rate * np.arange(0.0, low / rate, period)
    phase = (HERTZ * np.arange(0.0, PERIODS / HERTZ, period)) % 1.0
    triangle = low + (high - low) * (1.0 - np.abs(2.0 * phase - 1.0))
    up = np.linspace(low, high, STEPS + 1)
    levels = np.concatenate([[0.0], up, up[-2::-1]])
    begins = HELD * np.arange(levels.size - 1)
    corners = np.concatenate([begins, begins + RISER])
    at = np.concatenate([levels[:-1], levels[1:]])
    order = np.argsort(corners)
    clock = np.arange(0.0, HELD * (levels.size - 1), period)
    return {
        "triangle": np.concatenate([lead, triangle]),
        "staircase": np.interp(clock, corners[order], at[order]),
    }


def _judged(shared: tuple[tuple[str, ...], tuple[str, ...], int], seed: int) -> Judged:
    controllers, references, samples = shared
    began = time.process_time()
    one = rig(seed, samples)
    span = (HIGH - LOW) * one.scale.gain * one.scale.high
    try:
        what = known(one, samples)
    except PiezoOptError as error:
        return Judged(seed, error=str(error))
    fitted = time.process_time()
    limits = Limits(one.scale.low, one.scale.high, SLEW * one.scale.span)
    rows = [
        _tracked(one, what, controller, model, name, Wanted(r, 1.0 / one.rate, limits, one.noise))
        for name, r in references_of(one).items() if name in references
        for controller in controllers
        for model in MODELS
    ]  # fmt: skip
    return Judged(
        seed, one.noise / span, what.verdict, what.steps,
        {m: fit.rms / one.noise for m, fit in what.fits.items()}, tuple(rows),
        (fitted - began, time.process_time() - fitted),
    )  # fmt: skip


def _tracked(
    one: Rig, what: Known, controller: str, model: str, name: str, wanted: Wanted
) -> Tracked:
    try:
        made = DESIGNS[controller](what.fits[model], wanted)
        loop = close_loop(
            Driven(one), made, wanted.reference, period=wanted.period, limits=wanted.limits,
            noise=wanted.noise, seed=one.seed,
        )  # fmt: skip
    except PiezoOptError as error:
        return Tracked(name, controller, model, why=str(error))
    span = (HIGH - LOW) * one.scale.gain * one.scale.high
    return Tracked(name, controller, model, loop.rms / span)


def _lost(seed: int, sentence: str) -> Judged:
    """A plant whose process died."""
    return Judged(seed, error=sentence)


def _percent(median: Median, plants: int) -> str:
    """In per cent, and of how many plants where not of all."""
    scaled = Median(100.0 * median.value, 100.0 * median.low, 100.0 * median.high, median.count)
    return scaled.told(f" of {median.count}" if 0 < median.count < plants else "")


def _seconds(done: Sequence[Judged], index: int) -> float:
    return float(np.median([p.seconds[index] for p in done])) if done else float("nan")
