"""The whole way from a fit to the missing effect."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from types import NoneType
from typing import Any, final

from piezo_opt.choosing import chosen, expected, whole, words
from piezo_opt.diagnosis.advice import Advice, experiments
from piezo_opt.diagnosis.book import Start
from piezo_opt.diagnosis.colour import Colour
from piezo_opt.diagnosis.evidence import WORTH
from piezo_opt.diagnosis.frontier import Effort
from piezo_opt.diagnosis.judge import Judge, worded
from piezo_opt.diagnosis.noise import (
    NoiseFloor,
    Structure,
    exceeds,
    is_noise,
    noise_floor,
    structure,
)
from piezo_opt.diagnosis.points import Point, points
from piezo_opt.diagnosis.scores import Suspect, Unscored, at_foot, by_name, scored
from piezo_opt.diagnosis.search import search
from piezo_opt.diagnosis.sketch import sketched
from piezo_opt.diagnosis.told import Rival, Step, Told, in_words, told
from piezo_opt.diagnosis.unexplained import Unexplained, unexplained
from piezo_opt.effects.base import Effect
from piezo_opt.effects.catalogue import CATALOGUE, effect
from piezo_opt.errors import InputError, ModelError
from piezo_opt.identification import (
    Ending,
    Fit,
    Identification,
    as_driven,
    default_model,
    solve,
    with_statistics,
)
from piezo_opt.measurement import Measurement
from piezo_opt.one_thread import one_thread
from piezo_opt.stopping import TimeLimit
from piezo_opt.units import show

_CARRIES, _AS_SLOW = 3.0, 1.5
"""Held-out over fitted error from which an explanation does not carry over; where it leaves more
than noise at the highest frequencies: slower noise would be as large on the other record."""
SCHEMA = "piezo_opt/diagnosis/1"


class Stopped(Enum):
    """Who ended a diagnosis before it had come to its end."""

    LIMIT = "time limit"
    USER = "user"


@final
@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What is missing from a fitted model.

    Attributes:
        fit: the fit that was diagnosed.
        final: the fit at the top of the ladder, on all of the fitted records.
        verdict: ``"complete"``, ``"missing"`` or ``"unexplained"``; ``"open"`` where nothing
            was refitted, or the search was ended while its best left more than noise.
        noise: the noise floor.
        suspects: scores of every candidate, likeliest first: at the fit, or at the final one where
            nothing had to be added to it.
        unscored: candidates that could not be scored, and why.
        steps: accepted effects.
        refined: what was needed in more detail and is no new effect: parameters that were freed
            (an exponent, a second pole), mechanics that joined, effects in another form.
        structure: signs of structure in the final residual.
        held_out: how the judging data were chosen.
        experiments: drives worth playing next, and what each would tell.
        invisible: effects that no candidate drive would show.
        unexplained: where a correction would have to enter, and of what it is a function; None
            unless that is the verdict, and where it was ended before that was known.
        rivals: other hysteresis laws in the place of the base model's own, best first; tried where
            more than noise was left on the way.
        slight: effects that would help, but explain too little to bear a name, and how much:
            sqrt(SSR without / SSR with - 1).
        foot, top: errors of the baseline and of the final model, fitted and held out; None
            without a search.
        stopped: who ended it early, where somebody did; the rest is the best so far.
        elapsed_s: what it took [s].
        refits: fits of other sets of effects that were tried.
    """

    fit: Fit
    final: Fit
    verdict: str
    noise: NoiseFloor
    suspects: tuple[Suspect, ...]
    unscored: tuple[Unscored, ...]
    steps: tuple[Step, ...] = ()
    refined: tuple[str, ...] = ()
    structure: Structure = field(default_factory=lambda: Structure(False, ()))
    held_out: str = ""
    experiments: tuple[Advice, ...] = ()
    invisible: tuple[str, ...] = ()
    unexplained: Unexplained | None = None
    rivals: tuple[Rival, ...] = ()
    slight: tuple[tuple[str, float], ...] = ()
    foot: Point | None = None
    top: Point | None = None
    stopped: Stopped | None = None
    elapsed_s: float = 0.0
    refits: int = 0

    def best(self) -> Effect:
        """The likeliest missing effect, to be added with ``model + diagnosis.best()``.

        Raises:
            ModelError: nothing is significant.
        """
        if self.steps:
            return self.steps[0].effect
        for suspect in self.suspects:
            if suspect.p_value < 1e-3 and not suspect.wrong_side:
                return suspect.effect
        raise ModelError(
            "No candidate explains more than noise would: there is nothing to add. Look at "
            "diagnosis.structure, or offer effects of your own (candidates=...)."
        )

    @property
    def ladder(self) -> tuple[Point, ...]:
        """Errors after each thing that changed the model; empty where nothing did."""
        if self.foot is None or self.top is None:
            return ()
        model, base = self.final.model, self.fit.model
        return points(self.foot, self.steps, self.top, base, model, self.refined)

    @property
    def headline(self) -> str:
        """The verdict in a sentence."""
        return _headline(self)

    @property
    def advice(self) -> tuple[str, ...]:
        """What to do next, in sentences."""
        sentences = [f"{record.name}: {d}" for record in self.fit.records for d in record.doubts]
        for step in self.steps:
            if len(step.group) > 1:
                sentences.append(
                    f"{step.name} cannot be told from {', '.join(n for n in step.group[1:])} on "
                    "this record: the answer is the group."
                )
        named = {step.name for step in self.steps}
        blind = [s.name for s in self.suspects if s.visibility < 0.01 and s.name not in named]
        judged = bool(self.invisible) or any(e.detectable for e in self.experiments)
        if blind and not judged:
            sentences.append(
                f"This record could not have shown {', '.join(blind)}: what "
                f"{'it does' if len(blind) == 1 else 'they do'} is hidden behind the fitted "
                "parameters."
            )
        sentences += [experiment.sentence for experiment in self.experiments]
        if self.invisible:
            sentences.append(
                f"No usual drive would show {', '.join(self.invisible)} of a usual "
                "size: change the set-up (load, sensor, temperature) from one record to the next."
            )
        if not self.noise.measured:
            sentences.append(
                "The noise floor is estimated, not measured: repeat the drive at least twice."
            )
        return tuple(sentences)

    def to_dict(self) -> dict[str, Any]:
        """Plain data, lengths in metres, with a ``schema`` key."""
        return {
            "schema": SCHEMA,
            "verdict": self.verdict,
            "noise_rms": self.noise.rms,
            "noise_measured": self.noise.measured,
            "rms_baseline": self.fit.rms,
            "rms_final": self.final.rms,
            "held_out_baseline": _error(self.foot),
            "held_out_final": _error(self.top),
            "interrupted": self.stopped is not None,
            "stopped_by": None if self.stopped is None else self.stopped.value,
            "elapsed_s": self.elapsed_s,
            "refits": self.refits,
            "steps": [
                {
                    "effect": s.name,
                    "group": list(s.group),
                    "rms_before": s.rms_before,
                    "rms_after": s.rms_after,
                    "held_out_before": _finite(s.held_out_before),
                    "held_out_after": _finite(s.held_out_after),
                    "delta_bic": s.delta_bic,
                    "p_value": s.p_value,
                    "parameters": {
                        n: {"value": s.fit.values[n], "std": _finite(s.fit.std.get(n))}
                        for n in s.fit.names
                        if n.startswith(f"{s.name}.")
                    },
                }
                for s in self.steps
            ],
            "suspects": [
                {
                    "effect": s.name,
                    "score": s.score,
                    "predicted_rms": s.predicted_rms,
                    "visibility": s.visibility,
                    "overlaps": [list(pair) for pair in s.overlaps],
                    "p_value": s.p_value,
                }
                for s in self.suspects
            ],
            "unscored": [{"effect": u.name, "why": u.why} for u in self.unscored],
            "refined": list(self.refined),
            "unexplained": None if self.unexplained is None else self.unexplained.to_dict(),
            "rivals": [
                {
                    "effect": r.name,
                    "rms": r.rms,
                    "held_out": _finite(r.held_out),
                    "delta_bic": r.delta_bic,
                    "better": r.better,
                    "without": list(r.without),
                }
                for r in self.rivals
            ],
            "slight": [{"effect": name, "worth": worth} for name, worth in self.slight],
            "clues": list(self.structure.clues),
            "advice": list(self.advice),
            "experiments": [e.to_dict() for e in self.experiments],
            "final_model": self.final.to_dict(),
        }

    def __str__(self) -> str:
        lines = [self.headline, "", self.noise.sentence, self.held_out, ""]
        told = self.ladder
        if self.foot is not None and not told:
            lines += [f"Baseline: {show(self.foot.rms, 'm')} fitted{_beside(self.foot)}.", ""]
        lines.append(f"  {'suspect':<22} {'explains':>9} {'rms then':>10} {'visible':>8} {'p':>9}")
        for s in self.suspects[:8]:
            lines.append(
                f"  {s.name:<22} {100 * s.score:>7.1f} % {show(s.predicted_rms, 'm'):>10} "
                f"{100 * s.visibility:>6.0f} % {s.p_value:>9.1e}"
            )
        lines.append(
            "  (visible: the share of its influence on the reading that no fitted parameter can "
            "imitate; p: how likely noise alone explains as much)"
        )
        if told:
            wide = max([22, *(len(point.label) for point in told)])
            lines += ["", f"  {'ladder':<{wide}} {'rms':>10} {'held out':>10} {'BIC falls':>10}"]
            for point in told:
                falls = "" if point.delta_bic is None else f"{point.delta_bic:.0f}"
                lines.append(
                    f"  {point.label:<{wide}} {show(point.rms, 'm'):>10} "
                    f"{worded(point.held_out):>10} {falls:>10}".rstrip()
                )
            lines.append(
                "  (held out: the error on data that were not fitted; BIC: a criterion that "
                "charges for each parameter; a fall of 10 is strong evidence)"
            )
        for title, sentences in (
            ("Too slight to be named", tuple(_in_words(self.slight))),
            ("What is left", (*self.structure.clues, *_sentences(self.unexplained))),
            ("Other hysteresis laws", in_words(self.rivals)),
            ("Advice", self.advice),
            ("Not scored", tuple(f"{u.name}: {u.why}" for u in self.unscored)),
        ):
            if sentences:
                lines += ["", f"{title}:", *(f"  - {s}" for s in sentences)]
        return "\n".join(lines)


@one_thread()
def diagnose(
    fit: Fit | Identification | Measurement | Iterable[Measurement],
    *,
    test: Measurement | None = None,
    candidates: Sequence[Effect | type[Effect]] = (),
    withhold: Sequence[str] = (),
    ladder: bool = True,
    threads: int = 2,
    advise: bool | None = None,
    effort: Effort = Effort.NORMAL,
    worth: float = WORTH,
    max_time: float | None = None,
    progress: Callable[[str], None] | None = None,
    better: Callable[[Fit], None] | None = None,
) -> Diagnosis:
    """Name what is missing from a fitted model, and prove it on data that was not fitted.

    Args:
        fit: the baseline. A question is fitted first, records with
            :func:`default_model`, their drives as :func:`as_driven` says.
        test: a record to judge on, which is not fitted; else each block of the data is judged as
            the others predict it.
        candidates: effects of the user's own, beside the whole catalogue.
        withhold: catalogue names that shall not be considered.
        ladder: False stops after the scores.
        threads: refits that run at a time; 1 where processes share the machine already.
        advise: whether to plan experiments. Unless told, for groups that the record cannot split,
            and for effects it cannot show where it shows none; True plans both, False none.
        effort: how many sets of effects the search may expand.
        worth: the least that an effect must explain of what is left when it is taken out again, to
            bear a name: sqrt(SSR without / SSR with - 1).
        max_time: seconds after which no more is begun, and the best so far is given; unless told a
            minute and 2 ms a sample, ``math.inf`` for no limit.
        progress: called with sentences about what is going on.
        better: called with the best fit of the search so far, without its statistics, each time
            that another one is ahead.

    Returns:
        the diagnosis. An interrupt (Ctrl-C) or the time limit gives the best so far, and
        ``stopped`` says so.

    Raises:
        InputError: ``max_time`` or ``worth`` is not a positive number, or there is no effect of a
            name that is withheld.
    """
    if not (math.isfinite(worth) and worth > 0.0):
        raise InputError(f"worth={worth}: give a positive number, such as 0.35")
    if max_time is not None and not max_time > 0.0:
        raise InputError(f"max_time={max_time}: give a positive number of seconds, or math.inf")
    effort = chosen(Effort, effort, "effort")
    whole(threads, "threads", 1)
    expected(bool, ladder, "ladder", "True or False")
    expected((bool, NoneType), advise, "advise", "True, False or None")
    words(withhold, "withhold")
    if test is not None:
        expected(Measurement, test, "test", "a record, such as read returns")
    expected(Sequence, candidates, "candidates", "effects in a tuple, (Creep(), )")
    for candidate in candidates:
        kind = isinstance(candidate, type) and issubclass(candidate, Effect)
        if not kind:
            expected(Effect, candidate, "A candidate", "an effect, such as Creep()")
    own = {candidate.name for candidate in candidates}
    for name in withhold:
        if name not in own:
            effect(name)
    began = time.monotonic()
    remarks: tuple[str, ...] = ()
    if not isinstance(fit, Fit | Identification):
        records, held = as_driven(fit)
        model, remarks = default_model(records)
        remarks = (*held, *remarks)
        fit = Identification(model, records)
    if max_time is None:
        max_time = _budget(fit if isinstance(fit, Identification) else fit.question)
    limit = TimeLimit(max_time if math.isfinite(max_time) else None)
    tell = limit.checking(progress if progress is not None else _silent)
    if not isinstance(fit, Fit):
        tell("fitting the base model")
        fit = _baseline(fit, remarks, limit.left)
    offered = [
        *(
            form
            for name, kind in CATALOGUE.items()
            if not kind.structural and name not in withhold
            for form in kind.entries()
        ),
        *(c() if isinstance(c, type) else c for c in candidates),
    ]
    noise = noise_floor(fit)
    if not ladder:
        suspects, unscored = at_foot(fit, offered, threads)
        return Diagnosis(fit, fit, "open", noise, by_name(suspects), unscored)
    judge = Judge(test)
    offered, unheard = _judgeable(offered, test)
    base = fit

    def begun() -> Sequence[Start]:
        half = 0.5 * max_time if math.isfinite(max_time) else None
        return sketched(base, offered, withhold, effort, worth, threads, tell, half)

    searched = search(
        fit, offered, withhold, effort, worth, threads, tell, limit, begun, better or _silent
    )
    interrupted = searched.interrupted
    try:
        with limit:
            answer = told(searched.book, searched.suspects, worth, judge)
    except KeyboardInterrupt:
        interrupted = True
        searched.book.hurry()
        answer = told(searched.book, searched.suspects, worth, judge)
    final = fit if answer.final is fit else with_statistics(answer.final)
    floor = noise_floor(final)
    found = Diagnosis(
        fit=fit,
        final=final,
        verdict="missing" if answer.steps else "complete",
        noise=floor,
        suspects=by_name(searched.suspects),
        unscored=(*searched.unscored, *unheard),
        steps=answer.steps,
        refined=answer.refined,
        structure=_elsewhere(structure(final, floor), answer, judge, floor, worth),
        held_out=judge.sentence,
        rivals=answer.rivals,
        slight=answer.slight,
        foot=Point("baseline", fit.rms, judge.error(fit)),
        top=Point("final", final.rms, judge.error(final)),
        refits=searched.book.refits,
    )
    if interrupted:
        # The nearest name so far is no answer while more than noise is left.
        verdict = found.verdict if is_noise(final, worth) else "open"
        found = replace(found, verdict=verdict, stopped=_who(limit))
    else:
        if found.structure.left:  # whether or not there is time to say where it enters
            found = replace(found, verdict="unexplained")
        try:
            with limit:
                found = _rescored(found, offered, unheard, searched.book.colour, threads)
                found = _judged(found, worth, tell, threads)
                found = _with_experiments(found, offered, advise, tell, threads)
        except KeyboardInterrupt:
            found = replace(found, stopped=_who(limit))
    return replace(found, elapsed_s=time.monotonic() - began)


def _who(limit: TimeLimit) -> Stopped:
    return Stopped.LIMIT if limit.passed else Stopped.USER


def _rescored(
    found: Diagnosis,
    offered: Sequence[Effect],
    unheard: Sequence[Unscored],
    colour: Colour,
    threads: int,
) -> Diagnosis:
    """With the scores where the base model came out, if nothing is to be added to it.

    Where its own details had to be freed first, scores before that say what those details look
    like: p-values mean what they say only where nothing but noise is left.
    """
    if found.steps or found.final.values == found.fit.values:
        return found
    suspects, unscored = scored(found.final, offered, threads, colour)
    return replace(found, suspects=by_name(suspects), unscored=(*unscored, *unheard))


def _judged(found: Diagnosis, least: float, tell: Callable[[str], None], threads: int) -> Diagnosis:
    """With the verdict: whether what is left is noise, and if not, where a correction enters."""
    floor, final = found.noise, found.final
    correction: Unexplained | None = None
    if found.structure.left or exceeds(final.rms, floor, least):
        tell("looking for the smallest correction")
        correction = unexplained(final, floor, threads)
    # What can be described as a function of the chain's own signals is no noise either.
    described = correction is not None and correction.against is not None
    if not (found.structure.left or described):
        return found
    return replace(found, verdict="unexplained", unexplained=correction)


def _with_experiments(
    found: Diagnosis,
    offered: Sequence[Effect],
    advise: bool | None,
    tell: Callable[[str], None],
    threads: int,
) -> Diagnosis:
    """With the drives worth playing next, where they are wanted."""
    if advise is False:
        return found
    hidden = advise is True or found.verdict == "complete"
    if hidden or any(len(s.group) > 1 for s in found.steps):
        tell("comparing drives for the next experiment")
    planned, invisible = experiments(
        found.steps, found.final, offered, found.noise.rms, hidden=hidden, threads=threads
    )
    return replace(found, experiments=planned, invisible=invisible)


def _budget(question: Identification) -> float:
    """Wall time [s] that a search may take where nobody has said: long for a hopeless record."""
    return 60.0 + 2e-3 * sum(record.time.size for record in question.campaign.records)


def _baseline(asked: Identification, remarks: tuple[str, ...], seconds: float | None) -> Fit:
    """The fit of a question, with what its default model leaves out."""
    fit = solve(asked, max_time=seconds)
    if fit.outcome.ending is Ending.INTERRUPTED:
        raise KeyboardInterrupt
    return replace(fit, remarks=(*remarks, *fit.remarks))


def _elsewhere(
    found: Structure, answer: Told, judge: Judge, floor: NoiseFloor, least: float
) -> Structure:
    """What is left on the held-out record as well: an explanation must hold there, too."""
    if judge.record is None:
        return found
    there, here = judge.error(answer.final), answer.final.rms
    carries = _AS_SLOW if exceeds(here, floor, least) else _CARRIES
    if there < carries * here:
        return found
    judged = f"On the record that is judged on, '{judge.record.name}',"
    if answer.steps:
        missed = (
            f"the error is {show(there, 'm')}, {there / here:.2g} times that on the fitted one"
            if math.isfinite(there)
            else "the model with what was found is not finite"
        )
        clue = (
            f"{judged} {missed}: what was found does not carry over, or that record shows what "
            "this one cannot. Fit both together."
        )
    elif not math.isfinite(there):
        clue = (
            f"{judged} the model is not finite, so that no effect could be judged there: judge on "
            "another record, or fit both together."
        )
    else:
        return found
    return Structure(True, (*found.clues, clue), only_elsewhere=not found.left)


def _in_words(slight: Sequence[tuple[str, float]]) -> Iterator[str]:
    for name, worth in slight:
        grows = 100.0 * (math.sqrt(1.0 + worth**2) - 1.0)
        yield f"{name}: the error is {grows:.2g} % larger without it (--worth {worth:.2g})."


def _sentences(left: Unexplained | None) -> tuple[str, ...]:
    return () if left is None else (str(left),)


def _beside(foot: Point) -> str:
    return "" if foot.held_out is None else f", {worded(foot.held_out)} held out"


def _error(point: Point | None) -> float | None:
    return None if point is None else _finite(point.held_out)


def _finite(number: float | None) -> float | None:
    """JSON has neither NaN nor infinity: what is not known or not finite is null."""
    return None if number is None or not math.isfinite(number) else number


def _silent(_: object) -> None:
    return None


def _judgeable(
    offered: Sequence[Effect], record: Measurement | None
) -> tuple[list[Effect], tuple[Unscored, ...]]:
    """Effects that can be simulated on the record judged on, and those it has no channel for."""
    if record is None:
        return list(offered), ()
    lacking = {
        effect.name: need.removeprefix("channel:")
        for effect in offered
        for need in effect.requires
        if need.startswith("channel:") and need.removeprefix("channel:") not in record.channels
    }
    kept = [effect for effect in offered if effect.name not in lacking]
    why = "needs the channel '{}', which the record that is judged on does not have."
    unheard = (Unscored(name, f"{name} {why.format(channel)}") for name, channel in lacking.items())
    return kept, tuple(unheard)


def _headline(diagnosis: Diagnosis) -> str:
    if diagnosis.stopped is None:
        return _verdict(diagnosis)
    ended = "the time limit passed" if diagnosis.stopped is Stopped.LIMIT else "it was interrupted"
    if diagnosis.verdict == "open":
        before, after = show(diagnosis.fit.rms, "m"), show(diagnosis.final.rms, "m")
        if not diagnosis.steps:
            fell = f"; other changes of the model brought it to {after} so far"
            fell = fell if diagnosis.final.rms < diagnosis.fit.rms else ""
            return f"Not finished: {ended} before an effect was accepted (rms {before}{fell})."
        names = ", ".join(_with_group(s) for s in diagnosis.steps)
        return (
            f"Not finished: when {ended}, {names} had brought the error from {before} to {after}, "
            "which is more than noise."
        )
    return f"Not finished, the best when {ended}. {_verdict(diagnosis)}"


def _verdict(diagnosis: Diagnosis) -> str:
    before, after = show(diagnosis.fit.rms, "m"), show(diagnosis.final.rms, "m")
    if diagnosis.verdict == "open":
        return f"Scores at the fit (rms {before}); nothing was refitted."
    exchanged = _exchanged(diagnosis)
    if diagnosis.verdict == "complete":
        once = f" once {', '.join(diagnosis.refined)} is fitted" if diagnosis.refined else ""
        fell = f", down from {before}," if once or exchanged else ""
        return (
            f"Complete{exchanged}{once}: the residual of {after}{fell} is noise as far as this "
            "record can tell."
        )
    names = ", ".join(_with_group(s) for s in diagnosis.steps)
    if diagnosis.verdict == "missing":
        return f"Missing: {names}{exchanged}. The error falls from {before} to {after}."
    with_ = f"with {names}{exchanged}" if names else exchanged.removeprefix(", ")
    way = "falls" if diagnosis.final.rms < diagnosis.fit.rms else "goes"
    fell = f"{with_} the error {way} from {before} to {after}, but " if with_ else ""
    found = fell[:1].upper() + fell[1:]
    if diagnosis.structure.only_elsewhere and diagnosis.unexplained is None:
        return f"Unexplained: {found}the record that is judged on is not predicted as well."
    slight = ", ".join(name for name, _ in diagnosis.slight)
    but = f" but {slight}, too slight to be named" if slight else ""
    return f"Unexplained: {found}structure is left that no effect of the catalogue explains{but}."


def _with_group(step: Step) -> str:
    """An effect, and those that it may be instead."""
    *some, last = step.group
    if not some:
        return step.name
    others = ", ".join(some[1:])
    return f"{step.name} (or {others} or {last})" if others else f"{step.name} (or {last})"


def _exchanged(diagnosis: Diagnosis) -> str:
    """What became of the base model's own effects, in words; nothing where they all stayed."""
    before, after = diagnosis.fit.model, diagnosis.final.model
    own, final = before.hysteresis, after.hysteresis
    changed = [] if own == final else [f"with {final} in the place of {own}"]
    changed += [f"without {name}" for name in before.names if name not in after and name != own]
    return "".join(f", {change}" for change in changed)
