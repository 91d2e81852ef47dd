"""The hidden-effect bench: is the missing effect named, on plants that share no code with us.

Each record is made by an independent plant, fitted with the default model, and diagnosed with a
second record of the same plant to judge on. There are two families of plants by different hands
(``benchmark.plants``, ``benchmark.foreign``); of the second, every other record is diagnosed
alone, and run blind it judges a diagnosis that was tuned on the first. What is asked of the
answer:

- one effect hidden: the first accepted effect's *group* (what the record cannot tell it from)
  holds the truth; better, its *member* is the truth, lags, delay and sensor lag counting as one;
- nothing hidden: the verdict is "complete";
- two effects hidden: both are accepted, and no third;
- something outside the catalogue: no effect is claimed to complete the explanation;
- a catalogue without the effect that is hidden: the answer is "unexplained".
"""

from __future__ import annotations

import json
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from time import perf_counter
from typing import Any, Final, TextIO, final
from zlib import crc32

import numpy as np

from piezo_opt.benchmark.families import FAMILIES, FamilyName, Pair, PlantRecord
from piezo_opt.benchmark.jobs import Counted, run_jobs
from piezo_opt.benchmark.plants import Level
from piezo_opt.benchmark.refit_everything import refit_everything
from piezo_opt.benchmark.table import table
from piezo_opt.diagnosis import Stopped, diagnose
from piezo_opt.diagnosis.judge import Judge
from piezo_opt.errors import InputError
from piezo_opt.identification import Ending, Identification, default_model, solve
from piezo_opt.measurement import Between, Measurement

SCHEMA: Final = "piezo_opt/hidden/1"
TWO: Final = "two"
"""The class of two effects at once, another pair for every seed."""
POOLED: Final = frozenset({"amplifier_lag", "delay", "sensor_lag"})
"""Effects that count as one where the exact member is asked for."""
FORMS: Final = {
    "backlash": "dead_zone",
    "sensor_curvature": "sensor_nonlinearity",
    "thermal_expansion": "temperature",
}
"""Classes that hide another form of a row of the catalogue than the class of its name."""
WITHHELD: Final = {"interferometer_fringes": "sensor_nonlinearity"}
"""Classes that are outside the catalogue only while its row is withheld."""
LEVELS: Final = (0.05, 0.01)
"""Levels at which p-values are asked whether they mean what they say."""
_OUTSIDE: Final = frozenset(name for family in FAMILIES.values() for name in family.outside)
_FEWEST: Final = 8
"""Classes that a blind run has at least: the totals of fewer would tell of one of them."""
_DISTINCT: Final = 1.0
"""What each effect of a pair must leave, over the noise, that the other cannot imitate."""
_PAIRS: Final = 60
"""Pairs that are drawn at most until one can be told apart."""


@final
@dataclass(frozen=True)
class Judged:
    """One record and what the diagnosis said of it.

    Attributes:
        label: the class that was asked for.
        effects: what was hidden; the pair for the class "two".
        seed: of the plant.
        kind, static, ratio, colour, resolution: facts about the record (see ``plants.Facts``).
        verdict: of the diagnosis; empty where it failed.
        steps: accepted effects in order.
        groups: of each accepted effect, what this record cannot tell it from, itself included.
        likeliest: the suspect with the highest score, before any refit.
        refined: what the model needed in more detail.
        baseline, final, held_out: rms error over the true noise, of the fitted record without
            and with what was accepted, and of the other record with it.
        making, fitting, diagnosing: seconds.
        alone: whether it was diagnosed without the other record.
        left_out: whether the catalogue was without what is hidden.
        p_value: the least one of the suspects, before any refit; NaN where nothing was scored.
        plainest: what refitting with each effect of the catalogue names, "" for nothing; None
            where that was not asked for.
        refitting: seconds it took.
        error: why there is no answer; empty where there is one.
    """

    label: str
    effects: tuple[str, ...]
    seed: int
    kind: str = ""
    static: bool = False
    ratio: float = 0.0
    colour: float = 0.0
    resolution: float = 0.0
    verdict: str = ""
    steps: tuple[str, ...] = ()
    groups: tuple[tuple[str, ...], ...] = ()
    likeliest: str = ""
    refined: tuple[str, ...] = ()
    baseline: float = float("nan")
    final: float = float("nan")
    held_out: float = float("nan")
    making: float = 0.0
    fitting: float = 0.0
    diagnosing: float = 0.0
    alone: bool = False
    left_out: bool = False
    p_value: float = float("nan")
    plainest: str | None = None
    refitting: float = 0.0
    error: str = ""

    @property
    def sort(self) -> str:
        """ "none", "one", "two", "outside" or "left out"."""
        if not self.effects:
            return "none"
        if self.left_out:
            return "left out"
        if set(self.effects) & _OUTSIDE:
            return "outside"
        return "one" if len(self.effects) == 1 else "two"

    @property
    def group_right(self) -> bool:
        """Whether the first answer's group holds what was hidden; lags and delays count as one."""
        hidden = {_pooled(e) for e in self.effects}
        return bool(self.groups) and bool({_pooled(n) for n in self.groups[0]} & hidden)

    @property
    def member_right(self) -> bool:
        """Whether the first answer was hidden, lags and delays counting as one."""
        return bool(self.steps) and _pooled(self.steps[0]) in {_pooled(e) for e in self.effects}

    @property
    def all_found(self) -> bool:
        """Whether everything hidden was accepted, lags and delays counting as one."""
        return {_pooled(e) for e in self.effects} <= {_pooled(s) for s in self.steps}

    @property
    def surplus(self) -> bool:
        """Whether more effects were accepted than were hidden."""
        return len(self.steps) > len(self.effects)

    @property
    def right(self) -> bool:
        """What is asked of a record of its sort, at its strictest."""
        if self.error:
            return False
        if self.sort == "none":
            return self.verdict == "complete"
        if self.sort == "outside":
            return self.verdict != "missing"
        if self.sort == "left out":
            return self.verdict == "unexplained"
        return self.all_found and self.member_right and not self.surplus

    @property
    def answer(self) -> str:
        """The answer as a column of the confusion matrix: effects, else the verdict."""
        if self.error:
            return "failed"
        if self.sort in ("none", "outside", "left out") and self.verdict != "missing":
            return self.verdict
        return "+".join(self.steps) if self.steps else self.verdict


@final
@dataclass(frozen=True)
class HiddenTable:
    """What the diagnosis said of all records.

    Attributes:
        level: size of the effects, "standard" (3..30 times the noise) or "hard" (0.7..3).
        rows: one for each record, classes in the order asked for, then by seed.
        family: of the plants.
        blind: whether only totals are told, so that nobody tunes on a record or a class.
    """

    level: Level
    rows: tuple[Judged, ...]
    family: FamilyName = "own"
    blind: bool = False

    @property
    def confusion(self) -> dict[str, dict[str, int]]:
        """How often each answer was given, by class; the commonest first."""
        found: dict[str, Counter[str]] = {}
        for row in self.rows:
            found.setdefault(row.label, Counter())[row.answer] += 1
        return {label: dict(answers.most_common()) for label, answers in found.items()}

    @property
    def shares(self) -> dict[str, tuple[int, int]]:
        """What is asked of the diagnosis: (times it held, times it was asked)."""
        by = {sort: [r for r in self.rows if r.sort == sort] for sort in _SORTS}

        def count(rows: Sequence[Judged], holds: Callable[[Judged], bool]) -> tuple[int, int]:
            return sum(not r.error and holds(r) for r in rows), len(rows)

        asked = {
            "one hidden: its group first": count(by["one"], lambda r: r.group_right),
            "one hidden: the member itself first": count(by["one"], lambda r: r.member_right),
            "one hidden: no second accepted": count(by["one"], lambda r: not r.surplus),
            "nothing hidden: complete": count(by["none"], lambda r: r.verdict == "complete"),
            "nothing hidden: nothing accepted": count(by["none"], lambda r: not r.steps),
            "two hidden: both accepted": count(by["two"], lambda r: r.all_found),
            "two hidden: no third accepted": count(by["two"], lambda r: not r.surplus),
            "outside: no effect completes it": count(
                by["outside"], lambda r: r.verdict != "missing"
            ),
            "left out: unexplained": count(by["left out"], lambda r: r.verdict == "unexplained"),
            "left out: no effect completes it": count(
                by["left out"], lambda r: r.verdict != "missing"
            ),
        }
        for level in LEVELS:
            asked[f"nothing hidden: least p below {level:g}"] = (
                sum(r.p_value < level for r in by["none"]), len(by["none"])
            )  # fmt: skip
        for sort, name, holds in _PLAINEST:
            rows = [r for r in by[sort] if r.plainest is not None]
            asked[name] = sum(holds(r) for r in rows), len(rows)
        return {name: (held, of) for name, (held, of) in asked.items() if of}

    @property
    def group_size(self) -> float:
        """Mean number of names in the first answer's group, of records with one effect hidden."""
        sizes = [len(r.groups[0]) for r in self.rows if r.sort == "one" and r.groups]
        return float(np.mean(sizes)) if sizes else float("nan")

    @property
    def over_noise(self) -> tuple[float, float]:
        """Median rms error over the true noise after the ladder, fitted and held out.

        Of the records whose effects the catalogue has.
        """
        rows = [r for r in self.rows if r.sort != "outside" and not r.error]
        if not rows:
            return float("nan"), float("nan")
        fitted, held = [r.final for r in rows], [r.held_out for r in rows]
        return float(np.median(fitted)), float(np.median(held))

    def to_dict(self) -> dict[str, Any]:
        """Plain data with a ``schema`` key; only totals where it is blind."""
        fitted, held = self.over_noise
        told: dict[str, Any] = {
            "schema": SCHEMA,
            "family": self.family,
            "level": self.level,
            "records": len(self.rows),
            "failed": sum(bool(r.error) for r in self.rows),
            "shares": {name: {"held": h, "of": n} for name, (h, n) in self.shares.items()},
            "group_size": self.group_size,
            "final_over_noise": fitted,
            "held_out_over_noise": held,
            "median_seconds": _median([r.diagnosing for r in self.rows]),
        }
        if self.blind:
            return told
        rows = [{**asdict(r), "answer": r.answer, "right": r.right} for r in self.rows]
        return {**told, "confusion": self.confusion, "rows": rows}

    def __str__(self) -> str:
        lines = [f"{len(self.rows)} records, level {self.level}, {self.family} plants", ""]
        if not self.blind:
            lines += [self._by_class(), ""]
        lines += [
            f"{name:<40} {100.0 * held / of:5.1f} %  ({held} of {of})"
            for name, (held, of) in self.shares.items()
        ]
        if np.isfinite(self.group_size):
            lines.append(f"a first group holds {self.group_size:.2f} names (mean, one hidden)")
        fitted, held_out = self.over_noise
        seconds = [r.diagnosing for r in self.rows]
        lines += [
            f"rms after the ladder over the true noise, median: {fitted:.3f} fitted, "
            f"{held_out:.3f} held out",
            f"a diagnosis takes {_median(seconds):.1f} s (median), {max(seconds):.1f} s at most",
        ]
        refitting = [r.refitting for r in self.rows if r.plainest is not None]
        if refitting:
            lines.append(f"refitting with every effect takes {_median(refitting):.1f} s (median)")
        failed = [r for r in self.rows if r.error]
        if self.blind:
            return "\n".join([*lines, f"failed: {len(failed)}"] if failed else lines)
        lines += [f"failed: {r.label}, seed {r.seed}: {r.error.splitlines()[-1]}" for r in failed]
        return "\n".join(lines)

    def _by_class(self) -> str:
        cells = []
        for label, answers in self.confusion.items():
            own = [r for r in self.rows if r.label == label]
            cells.append(
                (
                    label,
                    f"{sum(r.right for r in own)}/{len(own)}",
                    f"{_median([r.final for r in own]):.2f}",
                    f"{_median([r.held_out for r in own]):.2f}",
                    f"{_median([r.diagnosing for r in own]):.1f}",
                    ", ".join(f"{answer} {n}" for answer, n in answers.items()),
                )
            )
        head = ("hidden", "right", "rms/noise", "held out", "s", "answers")
        return table(head, cells)


_SORTS: Final = ("none", "one", "two", "outside", "left out")
_PLAINEST: Final[tuple[tuple[str, str, Callable[[Judged], bool]], ...]] = (
    (
        "one", "one hidden: refits alone name the member",
        lambda r: _pooled(r.plainest or "") in {_pooled(e) for e in r.effects},
    ),
    ("none", "nothing hidden: refits alone say so", lambda r: r.plainest == ""),
)  # fmt: skip
"""What is asked of refitting with every effect: the sort of record, its name, whether it held."""


@final
@dataclass(frozen=True)
class _Job:
    label: str
    seed: int
    level: Level
    samples: int
    threads: int
    family: FamilyName = "own"
    plainest: bool = False
    left_out: bool = False
    max_time: float | None = None


def hidden_bench(
    classes: Sequence[str] | None = None,
    seeds: int = 20,
    level: Level = "standard",
    *,
    first_seed: int = 0,
    samples: int = 8000,
    executor: Executor | None = None,
    progress: Counted | None = None,
    log: Path | None = None,
    family: FamilyName = "own",
    blind: bool = False,
    baseline: bool = False,
    leave_out: bool = False,
    max_time: float | None = None,
) -> HiddenTable:
    """Diagnose records with hidden effects, and judge the answers.

    Args:
        classes: of the family's ``CLASSES``, "two" for a pair that changes with the seed, or a pair
            by name, "creep+delay"; all classes and "two" unless given.
        seeds: records of each class.
        level: size of the effects: "standard" 3 to 30 times the noise, "hard" 0.7 to 3 times.
        first_seed: seeds run from here on.
        samples: of each record.
        executor: runs the records in parallel; each of them then keeps to one thread.
        progress: called with (records done, records in all).
        log: a file that keeps finished records, one a line; a second run goes on from it.
        family: of the plants: "own", or "foreign", by another hand.
        blind: tell only totals, of eight classes at least; nothing is logged.
        baseline: ask the plainest search, too: refit with each effect, and take the best.
        leave_out: diagnose with a catalogue that lacks what is hidden; classes of which the
            catalogue has nothing are left out of the run.
        max_time: seconds for each diagnosis; its own default unless given.

    Returns:
        the table, or the table of what was done when interrupted (Ctrl-C).

    Raises:
        InputError: an unknown class, no seeds, a log of another run, or a blind run that has a
            log or few classes.
    """
    known = (*FAMILIES[family].classes, TWO)
    labels = known if classes is None else tuple(dict.fromkeys(classes))
    if leave_out:
        labels = tuple(one for one in labels if one != "none" and one not in _OUTSIDE)
    for label in labels:
        for name in label.split("+"):
            if name not in known or (name == TWO and label != TWO):
                raise InputError(
                    f"There is no class '{name}': there are {', '.join(known)}, and "
                    "pairs, 'creep+delay'."
                )
    if blind and log is not None:
        raise InputError("A blind run tells only totals: leave out the log of its records.")
    if blind and len(labels) < _FEWEST:
        raise InputError(
            f"A blind run of {len(labels)} classes would tell of each: name {_FEWEST} or more."
        )
    if seeds < 1 or first_seed < 0 or not labels:
        raise InputError(f"{seeds} seeds from {first_seed} on: give at least one, from 0 on.")
    threads = 2 if executor is None else 1
    numbers = range(first_seed, first_seed + seeds)
    jobs = [
        _Job(label, seed, level, samples, threads, family, baseline, leave_out, max_time)
        for label in labels
        for seed in numbers
    ]
    if blind:
        # What is done of a run that is stopped shall be a fair sample of all of it.
        jobs.sort(key=lambda job: crc32(f"{job.seed} {job.label}".encode()))
    with ExitStack() as stack:
        done: list[Judged] = []
        keep: TextIO | None = None
        if log is not None:
            done = _kept(log, jobs)
            keep = stack.enter_context(log.open("a", encoding="utf-8"))
            # A run that was killed may have left half a line.
            heading = json.dumps(_heading(jobs[0])) if keep.tell() == 0 else ""
            keep.write(f"{heading}\n")
        finished = {(row.label, row.seed) for row in done}
        left = [job for job in jobs if (job.label, job.seed) not in finished]
        try:
            tell = _offset(progress, len(done), len(jobs))
            for row in run_jobs(_judge, None, left, executor, tell, _lost):
                done.append(row)
                if keep is not None:
                    keep.write(json.dumps(asdict(row)) + "\n")
                    keep.flush()
        except KeyboardInterrupt:
            if not done:
                raise
    order = {(job.label, job.seed): k for k, job in enumerate(jobs)}
    rows = tuple(sorted(done, key=lambda r: order[r.label, r.seed]))
    return HiddenTable(level, rows, family, blind)


def measurement(record: PlantRecord, name: str) -> Measurement:
    """A hidden record as a user has it: without its truth."""
    warm = record.temperature
    return Measurement(
        time=record.time,
        drive=record.drive,
        position=record.position,
        channels={} if warm is None else {"temperature": warm},
        name=name,
        between=Between.HELD if record.held else Between.LINEAR,
        allow_saturated=True,
    )


def _lost(job: _Job, sentence: str) -> Judged:
    """A record whose process died counts as one that broke the diagnosis."""
    return Judged(job.label, (), job.seed, error=sentence)


def _judge(nothing: None, job: _Job) -> Judged:  # noqa: ARG001
    begin = perf_counter()
    names: tuple[str, ...] = ()
    try:
        names, (train, other) = _made(job)
        made = perf_counter()
        record, test = measurement(train, "train"), measurement(other, "test")
        model, _ = default_model(record)
        fit = solve(Identification(model, record))
        if fit.outcome.ending is Ending.INTERRUPTED:
            raise KeyboardInterrupt
        fitted = perf_counter()
        withheld = tuple(WITHHELD[name] for name in names if name in WITHHELD)
        if job.left_out:
            withheld += tuple(sorted({row for name in names for row in _rows(name)}))
        alone = _alone(job)
        found = diagnose(
            fit,
            test=None if alone else test,
            withhold=withheld,
            threads=job.threads,
            advise=False,
            max_time=job.max_time,
        )
        if found.stopped is Stopped.USER:
            # A search that was interrupted answers with its best so far: no row of the table.
            raise KeyboardInterrupt
        ended = perf_counter()
        held_out = Judge(test).error(found.final)
        begun = perf_counter()
        plainest = refit_everything(fit, withhold=withheld) if job.plainest else None
        return Judged(
            job.label,
            names,
            job.seed,
            kind=train.meta.kind,
            static=train.meta.static,
            ratio=train.meta.ratio,
            colour=train.meta.colour,
            resolution=train.meta.resolution,
            verdict=found.verdict,
            steps=tuple(step.name for step in found.steps),
            groups=tuple(step.group for step in found.steps),
            likeliest=found.suspects[0].name if found.suspects else "",
            refined=found.refined,
            baseline=found.fit.rms / train.noise_rms,
            final=found.final.rms / train.noise_rms,
            held_out=held_out / other.noise_rms,
            making=made - begin,
            fitting=fitted - made,
            diagnosing=ended - fitted,
            alone=alone,
            left_out=job.left_out,
            p_value=min((one.p_value for one in found.suspects), default=float("nan")),
            plainest=plainest,
            refitting=perf_counter() - begun,
        )
    except Exception:
        # One record that breaks the diagnosis counts against it and does not end the bench.
        told = traceback.format_exc(limit=-3)
        return Judged(job.label, names, job.seed, error=told, making=perf_counter() - begin)


def _alone(job: _Job) -> bool:
    """Whether a record is diagnosed without the other: a half of them, by class and seed."""
    return FAMILIES[job.family].halved and (crc32(job.label.encode()) + job.seed) % 2 == 0


def _made(job: _Job) -> tuple[tuple[str, ...], Pair]:
    """What is hidden, and its pair of records."""
    family = FAMILIES[job.family]
    if job.label != TWO:
        names = tuple(name for name in job.label.split("+") if name != "none")
        return names, family.make(names, job.seed, job.samples, job.level)
    for pair in _pairs(job.seed, job.family):
        try:
            train, test = family.make(pair, job.seed, job.samples, job.level)
        except ValueError:
            continue  # no plausible plant shows both
        if job.level == "hard" or min(train.meta.distinct) >= _DISTINCT:
            return pair, (train, test)
    raise InputError(f"seed {job.seed}: no pair of effects can be told apart at level {job.level}")


def _pairs(seed: int, family: FamilyName = "own") -> Iterator[tuple[str, str]]:
    """Pairs of effects that do not count as one."""
    for first, second in islice(FAMILIES[family].pairs(seed), _PAIRS):
        if _pooled(first) != _pooled(second):
            yield first, second


def _pooled(name: str) -> str:
    return "lag" if name in POOLED else FORMS.get(name, name)


def _rows(name: str) -> frozenset[str]:
    """Rows of the catalogue that say the same as a class; lags and delays are one."""
    return POOLED if name in POOLED else frozenset({FORMS.get(name, name)})


def _median(values: Sequence[float]) -> float:
    finite = [v for v in values if np.isfinite(v)]
    return float(np.median(finite)) if finite else float("nan")


def _offset(progress: Counted | None, done: int, total: int) -> Counted | None:
    if progress is None:
        return None
    return lambda count, _: progress(done + count, total)


def _heading(job: _Job) -> dict[str, Any]:
    heading = {"schema": SCHEMA, "level": job.level, "samples": job.samples}
    if job.left_out:
        heading = {**heading, "left_out": True}
    # Logs of the first family are older than the others.
    return heading if job.family == "own" else {**heading, "family": job.family}


def _kept(log: Path, jobs: Sequence[_Job]) -> list[Judged]:
    """Finished records of an earlier run; a line that was cut off in writing is done again."""
    if not log.exists() or log.stat().st_size == 0:
        return []
    first, *lines = log.read_text(encoding="utf-8").splitlines()
    try:
        heading = json.loads(first)
    except json.JSONDecodeError:
        heading = None
    if heading != _heading(jobs[0]):
        raise InputError(f"{log}: is no log of this bench at this level: give another file")
    asked = {(job.label, job.seed) for job in jobs}
    rows = []
    for line in lines:
        try:
            row = _row(json.loads(line))
        except (json.JSONDecodeError, TypeError, KeyError):
            continue  # half a line, or an empty one
        if (row.label, row.seed) in asked:
            rows.append(row)
    return list({(row.label, row.seed): row for row in rows}.values())


def _row(data: dict[str, Any]) -> Judged:
    many = {name: tuple(data[name]) for name in ("effects", "steps", "refined")}
    groups = tuple(tuple(group) for group in data["groups"])
    return Judged(**{**data, **many, "groups": groups})
