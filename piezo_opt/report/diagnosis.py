"""The chapter of a diagnosis, from the verdict down to what to measure next."""

from __future__ import annotations

import re
from typing import Final

from piezo_opt.comparison import Entry, compare
from piezo_opt.diagnosis import Diagnosis
from piezo_opt.diagnosis.judge import worded
from piezo_opt.diagnosis.told import in_words
from piezo_opt.effects.catalogue import CATALOGUE
from piezo_opt.report import diagnosis_figures, figures
from piezo_opt.report.chapters import (
    chapter,
    coloured,
    named,
    pictures_of_error,
    records_of,
    values_of,
    way_of,
)
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
from piezo_opt.units import show

_BLIND = 0.05
"""Visibility below which the fitted parameters hide an effect almost wholly."""
_TOLD: Final = {
    "complete": "nothing is missing",
    "missing": "an effect is missing",
    "unexplained": "no effect explains the error",
    "open": "not finished",
}
"""Verdicts in words."""


@chapter.register
def _diagnosis(diagnosis: Diagnosis) -> list[Block]:
    entries = _before_and_after(diagnosis)
    return [
        Heading(f"Diagnosis of {named(diagnosis.fit.records)}: {_TOLD[diagnosis.verdict]}"),
        Lead(_headline(diagnosis), good=diagnosis.verdict != "unexplained"),
        Text(f"{diagnosis.noise.sentence} {diagnosis.held_out}".strip(), quiet=True),
        *_ladder(diagnosis),
        *_seen(entries),
        *records_of(diagnosis.fit.records),
        *_where(entries),
        *_suspects(diagnosis),
        *_left_over(diagnosis),
        *_rivals(diagnosis),
        *_final(diagnosis),
        *_cannot_tell(diagnosis),
        *_advice(diagnosis),
    ]


def _headline(diagnosis: Diagnosis) -> str:
    """The diagnosis' own, with the field's name of an effect that has several forms."""
    said = diagnosis.headline
    for step in diagnosis.steps:
        said = re.sub(rf"\b{re.escape(step.name)}\b", step.told, said, count=1)
        # Its form and what it may be instead stand in one pair of brackets.
        said = said.replace(f"{step.told} (or ", f"{step.told} (or ".replace(") (or ", "; or "))
    return said


def _before_and_after(diagnosis: Diagnosis) -> tuple[Entry, ...]:
    if diagnosis.final is diagnosis.fit:
        return compare(diagnosis.fit, names=("model",)).entries
    return compare(diagnosis.fit, diagnosis.final, names=("before", "after")).entries


def _seen(entries: tuple[Entry, ...]) -> list[Block]:
    """Measured and modelled; of several records the one that the first model fits worst."""
    k = _worst(entries[0])
    before = " before and after the diagnosis" if len(entries) > 1 else ""
    colours = coloured(entries)
    return [
        Heading(f"Measured and modelled: {entries[0].misfits[k].record.name}", 3),
        Picture(figures.loop(entries, k), f"The reading against the drive{before}. {colours}"),
        Picture(
            figures.over_time(entries, k),
            f"The reading over time and, below, what the model leaves over. {colours}",
        ),
        Picture(
            figures.zoom(entries, k),
            f"The stretch of that record in which the first model's error is largest. {colours}",
        ),
    ]


def _where(entries: tuple[Entry, ...]) -> list[Block]:
    k = _worst(entries[0])
    first = entries[0]
    return [
        Heading(f"Where it fails: {first.misfits[k].record.name}", 3),
        Points(first.sentences_of(k)),
        *pictures_of_error(entries, k),
    ]


def _worst(entry: Entry) -> int:
    errors = [metrics.rms for metrics in entry.by_record]
    return errors.index(max(errors))


def _suspects(diagnosis: Diagnosis) -> list[Block]:
    shown = diagnosis_figures.suspects(diagnosis)
    if shown is None:
        return []
    found = diagnosis.suspects
    return [
        Heading("Which effect is missing", 3),
        Picture(
            shown,
            "Left: what each absent effect, alone, would explain of the error. Right: how visible "
            "it is in this record, the share of its influence on the reading that no fitted "
            "parameter can imitate, and effects whose influence looks alike.",
        ),
        Table(
            (
                ("effect", tuple(s.name for s in found)),
                ("what it is", tuple(_meaning(s.name) for s in found)),
                ("explains", tuple(f"{100 * s.score:.1f} %" for s in found)),
                ("rms with it", tuple(show(s.predicted_rms, "m") for s in found)),
                ("visible", tuple(diagnosis_figures.percent(s.visibility) for s in found)),
                ("by chance", tuple(f"{s.p_value:.2g}" for s in found)),
                ("alike", tuple(_alike(s.overlaps) for s in found)),
            ),
            prose=("what it is", "alike"),
        ),
        Text(
            "By chance: how likely noise alone explains as much. Alike: effects whose influence "
            "on the reading has nearly the same shape; 1.00 is the same.",
            quiet=True,
        ),
    ]


def _meaning(name: str) -> str:
    """The field's words for an effect of the catalogue; empty for others."""
    kind = CATALOGUE.get(name)
    return "" if kind is None else kind().summary


def _alike(overlaps: tuple[tuple[str, float], ...]) -> str:
    return ", ".join(f"{name} {cosine:.2f}" for name, cosine in overlaps[:3] if cosine > 0.7)


def _ladder(diagnosis: Diagnosis) -> list[Block]:
    shown = diagnosis_figures.ladder(diagnosis)
    if shown is None:
        return []
    steps = diagnosis.steps
    blocks: list[Block] = [
        Heading("The ladder", 3),
        Picture(
            shown,
            "Blue: the error of the whole model, refitted with each effect that is added. Orange: "
            "on data that were not fitted. Green: the noise, with its 95 % range; below it there "
            "is nothing to explain.",
        ),
    ]
    table = Table(
        (
            ("added", tuple(s.told for s in steps)),
            ("what it is", tuple(_meaning(s.name) for s in steps)),
            ("rms before", tuple(show(s.rms_before, "m") for s in steps)),
            ("rms after", tuple(show(s.rms_after, "m") for s in steps)),
            ("held out after", tuple(worded(s.held_out_after) for s in steps)),
            ("BIC falls by", tuple(f"{s.delta_bic:.0f}" for s in steps)),
            ("cannot be told from", tuple(", ".join(s.group[1:]) for s in steps)),
        ),
        prose=("what it is", "cannot be told from"),
    )
    if steps:
        blocks += [
            table,
            Text(
                "Held out: each part of the record as predicted from the others. BIC (Bayesian "
                "information criterion) charges for every further parameter: where it falls, the "
                "step is worth it, and by ten or more, that is sure.",
                quiet=True,
            ),
        ]
    said = _beside(diagnosis)
    return [*blocks, *([Points(said)] if said else [])]


def _beside(diagnosis: Diagnosis) -> tuple[str, ...]:
    """What the model needed beside the effects, in sentences."""
    joined = [name for name in diagnosis.refined if name in diagnosis.final.model]
    freed = [name for name in diagnosis.refined if name not in joined]
    said = [
        f"The base model has {name} now: {_meaning(name).rstrip('.')[:1].lower()}"
        f"{_meaning(name).rstrip('.')[1:]}. Every actuator has it; it is no finding."
        for name in joined
    ]
    if freed:
        them = "it is" if len(freed) == 1 else "they are"
        said.append(f"Fitted as well, because the record shows what {them}: {', '.join(freed)}.")
    return tuple(said)


def _left_over(diagnosis: Diagnosis) -> list[Block]:
    left = diagnosis.unexplained
    clues = (*diagnosis.structure.clues, *(() if left is None else (str(left),)))
    if not clues:
        return []
    blocks: list[Block] = [Heading("What no effect explains", 3), Points(clues)]
    shown = diagnosis_figures.correction(diagnosis)
    if left is None or shown is None:
        return blocks
    caption = (
        "The smallest correction that brings the error down to the noise. An effect is a function "
        "of signals: a narrow line on the right is a law, a cloud is none."
    )
    return [
        *blocks,
        Picture(shown, caption),
        Table(
            (
                ("correction enters", tuple(f.place.value for f in left.forces)),
                ("size", tuple(f"{show(f.rms, f.place.unit)} rms" for f in left.forces)),
                ("of the drive's", tuple(f"{100 * f.relative:.2g} %" for f in left.forces)),
                ("explains", tuple(f"{100 * f.share:.0f} %" for f in left.forces)),
                ("as a function", tuple(f"{100 * f.described:.0f} %" for f in left.forces)),
            ),
        ),
    ]


def _rivals(diagnosis: Diagnosis) -> list[Block]:
    found = diagnosis.rivals
    if not found:
        return []
    return [
        Heading("Other hysteresis laws", 3),
        Points(in_words(found)),
        Table(
            (
                ("law", tuple(r.name for r in found)),
                ("rms", tuple(show(r.rms, "m") for r in found)),
                ("held out", tuple(worded(r.held_out) for r in found)),
                ("BIC falls by", tuple(f"{r.delta_bic:.0f}" for r in found)),
                ("does without", tuple(", ".join(r.without) for r in found)),
                ("better", tuple("yes" if r.better else "no" for r in found)),
            ),
        ),
    ]


def _final(diagnosis: Diagnosis) -> list[Block]:
    return [
        Heading("What the final model's numbers are", 3),
        *values_of(diagnosis.final),
        *way_of(diagnosis.final),
        Folded("The final model's equations", (Listing(str(diagnosis.final.model)),)),
    ]


def _cannot_tell(diagnosis: Diagnosis) -> list[Block]:
    said = [
        f"{step.name} and {', '.join(step.group[1:])} explain it equally well: the answer is the "
        "group."
        for step in diagnosis.steps
        if len(step.group) > 1
    ]
    hidden = [s.name for s in diagnosis.suspects if s.visibility < _BLIND and not s.score > 0.1]
    if hidden:
        said.append(
            f"Whether {' or '.join(hidden)} is there: other parameters of the model do more than "
            f"{100 * (1 - _BLIND):.0f} % of what it would do."
        )
    said += diagnosis.final.blind
    said += [
        f"{one.name} was not looked at: {_less(one.name, one.why)}" for one in diagnosis.unscored
    ]
    return [Heading("What this record cannot tell", 3), Points(tuple(said))] if said else []


def _less(name: str, why: str) -> str:
    """A reason without the name that it begins with."""
    before, colon, after = why.partition(": ")
    if colon and name in before.split(", "):
        return after
    return f"it{why.removeprefix(name)}" if why.startswith(f"{name} ") else why


def _advised(diagnosis: Diagnosis) -> tuple[str, ...]:
    """What to do, without what the record cannot tell, which has been said."""
    said = ("cannot be told from", "could not have shown")
    return tuple(one for one in diagnosis.advice if not any(words in one for words in said))


def _advice(diagnosis: Diagnosis) -> list[Block]:
    blocks: list[Block] = []
    if advised := _advised(diagnosis):
        blocks += [Heading("What to do next", 3), Points(advised)]
    return [
        *blocks,
        *(Picture(diagnosis_figures.to_play(one), one.sentence) for one in diagnosis.experiments),
    ]
