"""What a page says about each kind of result. A new kind registers a function of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import singledispatch
from typing import final

import numpy as np

from piezo_opt.comparison import Comparison, Entry, columns, compare
from piezo_opt.errors import InputError
from piezo_opt.identification import Fit
from piezo_opt.measurement import Measurement
from piezo_opt.pictures.picture import prefixed
from piezo_opt.report import figures
from piezo_opt.report.page import (
    Block,
    Folded,
    Heading,
    Lead,
    Listing,
    Picture,
    Points,
    Table,
    Text,
)
from piezo_opt.report.style import MODEL_COLOURS
from piezo_opt.simulation import INITIAL
from piezo_opt.units import show

_UNKNOWN = 100.0
"""Times a value that its interval reaches beyond it: then the record says nothing of it."""
_MOST_RECORDS = 6
"""Records of one result that are drawn; the others are in its tables."""


@singledispatch
def chapter(result: object) -> list[Block]:
    """The blocks of one result, in the order they are read.

    Raises `InputError` for something that is no result.
    """
    raise InputError(f"a report cannot show a {type(result).__name__}: give fits and comparisons")


@final
@dataclass(frozen=True, eq=False)
class Judged:
    """A fit with its error on its own records, which somebody has looked at already.

    What a long record tells takes seconds to find, and is not found twice.
    """

    fit: Fit
    own: Comparison


def together(results: Sequence[object]) -> list[object]:
    """The results, each fit joined with the comparison of it alone on its own records."""
    own = {
        id(one.entries[0].fit): one
        for one in results
        if isinstance(one, Comparison) and len(one.entries) == 1 and not one.held_out
    }
    joined = {id(own[id(one)]) for one in results if isinstance(one, Fit) and id(one) in own}
    return [
        Judged(one, own[id(one)]) if isinstance(one, Fit) and id(one) in own else one
        for one in results
        if id(one) not in joined
    ]


@chapter.register
def _fit(fit: Fit) -> list[Block]:
    return _judged(Judged(fit, compare(fit)))


@chapter.register
def _judged(judged: Judged) -> list[Block]:
    fit, own = judged.fit, judged.own
    entry = own.entries[0]
    table = columns(own)[1:]
    blocks: list[Block] = [
        Heading(f"Fit of {named(fit.records)}: {' + '.join(fit.model.names)}"),
        Lead(f"{fit.outcome.sentence} {_verdict(entry)}", good=fit.outcome.success),
        *_pictures((entry,)),
        *records_of(fit.records),
        Heading("What the numbers are", 3),
        *values_of(fit),
    ]
    if fit.blind:
        blocks += [Heading("What the data cannot see", 3), Points(fit.blind)]
    if fit.remarks:
        blocks += [Heading("Remarks", 3), Points(fit.remarks)]
    return [
        *blocks,
        Folded("The model's equations", (Listing(str(fit.model)),)),
        *way_of(fit),
        Folded("Further measures of the error, and the run", (Table(table), *_run(fit))),
    ]


def named(records: Sequence[Measurement]) -> str:
    """The records by name, at most three."""
    names = [record.name for record in records]
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


@chapter.register
def _comparison(comparison: Comparison) -> list[Block]:
    names = ", ".join(comparison.records)
    kind = "held-out " if comparison.held_out else ""
    noun = "records" if len(comparison.records) > 1 else "record"
    blocks: list[Block] = [
        Heading(f"Comparison on the {kind}{noun} {names}"),
        Lead(_winner(comparison)),
        Table(columns(comparison)),
    ]
    if comparison.held_out:
        blocks.append(
            Text(
                "The models were not fitted to these samples: the error is that of a prediction. "
                "Of a record that begins anew, only its offset and its start are estimated on it.",
                quiet=True,
            )
        )
    return [*blocks, *_pictures(comparison.entries)]


def _verdict(entry: Entry) -> str:
    if not all(noise.conclusive for noise in entry.whiteness):
        return "There are too few samples to tell noise from structure."
    if all(noise.white for noise in entry.whiteness):
        return "What is left passes as noise."
    return "What is left is not noise: there is structure that this model does not explain."


def _winner(comparison: Comparison) -> str:
    ordered = sorted(comparison.entries, key=lambda entry: entry.metrics.rms)
    unit = comparison.entries[0].misfits[0].record.position_unit
    best = ordered[0]
    text = f"{best.label}: {show(best.metrics.rms, unit)} rms, fit {best.metrics.fit_percent:.2f} %"
    if len(ordered) == 1:
        return f"{text}. {_verdict(best)}"
    others = ", ".join(f"{show(o.metrics.rms, unit)} ({o.label})" for o in ordered[1:])
    return f"Smallest error with {text}; against {others}. {_verdict(best)}"


def records_of(records: tuple[Measurement, ...]) -> list[Block]:
    blocks: list[Block] = [Heading("What was measured" if len(records) > 1 else "The record", 3)]
    for record in records:
        blocks.append(Text(repr(record).strip("<>") + "."))
        if record.source:
            blocks.append(Text(f"Source: {record.source}", quiet=True))
        if record.remarks:
            blocks.append(Points(record.remarks))
    return blocks


def _pictures(entries: tuple[Entry, ...]) -> list[Block]:
    blocks: list[Block] = []
    misfits, colours = entries[0].misfits, coloured(entries)
    for k, misfit in enumerate(misfits[:_MOST_RECORDS]):
        name = misfit.record.name
        blocks += [
            Heading(f"Measured and modelled: {name}", 3),
            Picture(
                figures.loop(entries, k), f"The reading against the drive. {coloured(entries)}"
            ),
            Picture(
                figures.over_time(entries, k),
                f"The reading over time and, below, what the model leaves over. {colours}",
            ),
            Heading(f"Where it fails: {name}", 3),
        ]
        for entry in entries:
            if len(entries) > 1:
                blocks.append(Text(f"{entry.label}:"))
            blocks.append(Points(entry.sentences_of(k)))
        blocks += pictures_of_error(entries, k)
    if len(misfits) > _MOST_RECORDS:
        blocks.append(
            Text(f"{len(misfits) - _MOST_RECORDS} more records are in the table only.", quiet=True)
        )
    return blocks


def coloured(entries: Sequence[Entry]) -> str:
    """Which colour is what: "Black: measured. Orange: model."."""
    labels = [entry.label for entry in entries] if len(entries) > 1 else ["model"]
    lines = [f"{colour}: {one}." for colour, one in zip(MODEL_COLOURS, labels, strict=False)]
    return " ".join(["Black: measured.", *lines])


def pictures_of_error(entries: tuple[Entry, ...], record: int) -> list[Block]:
    drawn = (
        (
            figures.by_branch(entries, record),
            "The error against the drive; where both means leave zero the loop has another shape.",
        ),
        (
            figures.spectrum(entries, record),
            "Where the error's curve rises to the reading's, the model explains nothing; a high "
            "coherence says that gain, lag or resonance are wrong at that frequency.",
        ),
        (
            figures.after_events(entries, record),
            "Positive: the measurement has gone further in the direction of the movement than "
            "the model. A straight slope over decades is creep.",
        ),
        (
            figures.by_amplitude(entries, record),
            "An error that grows with the swing belongs to the hysteresis or the gain.",
        ),
        *(
            (
                figures.correlations(entry, record),
                "Correlation of the error with itself and with the drive"
                + (f", {entry.label}" if len(entries) > 1 else "")
                + ": that of noise stays inside the band.",
            )
            for entry in entries
        ),
    )
    return [Picture(figure, caption) for figure, caption in drawn if figure is not None]


def values_of(fit: Fit) -> list[Block]:
    kept = [n for n in fit.values if n not in fit.names and not n.startswith(INITIAL)]
    rows = [_row(fit, name) for name in (*fit.names, *kept)]
    heads = ("parameter", "value", "± 95 %", "unit", "meaning")
    cells = tuple(zip(*rows, strict=True))
    blocks: list[Block] = [Table(tuple(zip(heads, cells, strict=True)), prose=("unit", "meaning"))]
    if fit.at_bound:
        blocks.append(
            Text(
                f"At a bound: {', '.join(fit.at_bound)}. The data ask for more than the bound "
                "allows, so nothing is known of their spread."
            )
        )
    if fit.coloured:
        blocks.append(Text("What is left is correlated in time; the intervals allow for it.", True))
    drawn = (
        (
            figures.estimates(fit),
            "The shorter the bar, the better the record knows the value. An orange bar reaches "
            "past zero: not even the sign is known.",
        ),
        (figures.multi_start(fit), "Starts that end at the same height found the same optimum."),
    )
    return [*blocks, *(Picture(f, caption) for f, caption in drawn if f is not None)]


def way_of(fit: Fit) -> list[Block]:
    """How the solver came to a fit, for those who ask."""
    drawn = figures.trajectories(fit)
    if drawn is None:
        return []
    shown = Picture(drawn, "Every unknown by iteration, and the error.")
    return [Folded("How the solver got there", (shown,))]


def _row(fit: Fit, name: str) -> tuple[str, str, str, str, str]:
    factor, unit = prefixed(fit.unit(name), np.array([fit.values[name]]))
    if name not in fit.names:
        spread = "fixed"
    elif name in fit.at_bound:
        spread = "at bound"
    else:
        half = factor * (fit.interval(name)[1] - fit.values[name])
        known = half < _UNKNOWN * abs(factor * fit.values[name])
        spread = f"{float(f'{half:.2g}'):g}" if known else "unknown"
    if name.startswith(INITIAL):
        meaning = "deviation from rest at the start"
    else:
        meaning = fit.model.parameters[name.partition("[")[0]].meaning
    value = f"{factor * fit.values[name]:.5g}"
    return name, value, spread, "" if unit == "1" else unit, meaning


def _run(fit: Fit) -> list[Block]:
    facts = [
        ("solver", f"{fit.solver}, {fit.transcription}"),
        ("simulations", f"{fit.evaluations.total}"),
        ("of these with sensitivities", f"{fit.evaluations.with_sensitivities}"),
        ("iterations", f"{max(0, fit.trace.rms.size - 1)}"),
        ("time", f"{fit.wall_s:.2f} s"),
        ("core", "compiled C" if fit.compiled else "virtual machine (no C compiler: slower)"),
    ]
    facts += [
        (f"scheme error, {record.name}", f"{show(accuracy.error, record.position_unit)} rms")
        for record, accuracy in zip(fit.records, fit.accuracy, strict=True)
    ]
    return [
        Table(
            (("", tuple(name for name, _ in facts)), ("spent", tuple(text for _, text in facts)))
        ),
    ]
