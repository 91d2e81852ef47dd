"""One step of the ladder: who is refitted, who is asked first, and who is worth its name."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from piezo_opt.diagnosis.contest import contest, settled
from piezo_opt.diagnosis.held_out import FOREIGN, HeldOut, agrees, elsewhere, rms
from piezo_opt.diagnosis.noise import noise_floor
from piezo_opt.diagnosis.refinements import (
    explained,
    plausible,
    refinements,
    stilled,
    with_base_details,
)
from piezo_opt.diagnosis.rung import STRONG, WORTH, Rung, Trial, adding, finely, race
from piezo_opt.diagnosis.scores import Suspect, effective_samples
from piezo_opt.diagnosis.shortlist import entrants, further, jointly, scored, shortlist
from piezo_opt.diagnosis.stopping import Pool
from piezo_opt.diagnosis.structure import structure
from piezo_opt.identification import Fit

FloatArray = NDArray[np.float64]

SIGNIFICANT = 1e-3
"""Corrected p-value below which a suspect is worth a refit."""
SHORT = 0.05
"""The same where nothing is held out: long-run variances of a few dozen samples say little, and
strong evidence after the refit asks for more than this by itself."""
_DETAIL = 0.02
"""Share by which the error must fall for more detail of what the model has."""
_TOLERATED = 1.1
"""Held-out error over that before up to which a detail is taken, or a first effect that explains
most of one record where the other shows above all something else."""
_ABOVE = 1.3
"""Residual over the floor at the highest frequencies from which it may be no noise."""
_MOVED = 0.7
"""Error with mechanics over that with any suspect below which suspects are asked beside them."""
_HALVED = 0.5
"""Error over that before below which far more has been explained than is left."""
_MUCH = 0.6
"""Error over that before below which a first effect need but not hurt on the other record until the
ladder ends: what is found beside it may be what that one shows."""
_HARDLY = 6.0
"""Difference of BIC below which there is no strong evidence between two (Kass & Raftery, 1995,
J. American Statistical Association 90(430), 773-795)."""
_IN_SIGHT = 2.0
"""Error over the best rung's beyond which a rung is not asked for its held-out error."""
_ENOUGH = 1.03
"""Error over the best rung's up to which no other effect is asked for."""
_AS_WELL = 1.01
"""Held-out error over the best rung's up to which another one predicts as well."""
_LOST = 2.0
"""Error of the closest refit over the floor beyond which every effect is tried afresh; and below
it where that one misses the other record by far (``FOREIGN``)."""
_TOLD = 0.65
"""Error of the closest refit over that of the fit below up to which the scores have shown the way:
what is left is another effect's."""
_DOUBTFUL, _NOISY = 1.3, 1.1
"""Held-out error of the closest refit over its own beyond which the same is done, where that one
leaves no more than so many times the floor; where it leaves what may be slow noise, that of another
record (``FOREIGN``)."""


def refits(
    fit: Fit,
    held: HeldOut,
    suspects: Sequence[Suspect],
    *,
    first: bool,
    bar: float,
    tell: Callable[[str], None],
    threads: int,
    known: Sequence[Rung] = (),
) -> tuple[list[Rung], list[Rung]]:
    """Refits with what a fit may be missing, each brought as far as it can be, best BIC first.

    Args:
        fit: the fit.
        held: whose question is that at the foot of the ladder.
        suspects: scores of all absent effects at the fit.
        first: whether nothing has been found yet.
        bar: p-value below which a suspect is worth a refit.
        tell: called with a sentence about what is going on.
        threads: refits that run at a time.
        known: refits of every effect from a fresh start, where that was asked before at the foot.

    Returns:
        the refits, and those of every effect from a fresh start, where that was asked.
    """
    likely = [s for s in suspects if s.p_value < bar]
    short = shortlist(likely, suspects) if likely else []
    trials = refinements(fit)
    rungs: list[Rung] = []
    fresh: list[Trial] = []
    begun: list[Rung] = []
    if short or trials:
        tell(_refitting(short))
        rungs = race(fit, [*trials, *(with_base_details(adding(fit, s)) for s in short)], threads)
        moving = _on_mechanics(fit, rungs, suspects, bar, threads)
        rungs += race(fit, moving, threads, rivals=rungs) if moving else []
    closest = min((r.fit for r in rungs), key=lambda f: f.rms, default=fit)
    floor = noise_floor(closest).rms
    calm = settled(closest)
    # Beside what was found the base model is bent less: what misses the other record there is
    # asked for its place at the end.
    missing = first and _mispredicts(closest, held, FOREIGN)
    doubtful = closest is not fit and (
        (first and closest.rms < _NOISY * floor and _mispredicts(closest, held, _DOUBTFUL))
        or (calm and missing)
    )
    if doubtful or (not calm and _unsettled(fit, first=first)):
        # Scores are taken at a fit that has been bent, and slow residuals leave none of them
        # significant: let refits tell.
        more = further(suspects, short)
        told = first and closest.rms < _TOLD * fit.rms
        lost = doubtful or missing or (closest.rms > _LOST * floor and not told)
        tell(f"{_refitting(more)}{', and all from a fresh start' if lost else ''}")
        bent = [with_base_details(adding(fit, s)) for s in more]
        if lost:
            before = known if first else ()
            fresh, begun = entrants(fit, held.question, suspects, threads, before)
        if not first:
            fresh = [with_base_details(trial) for trial in fresh]
        rungs += race(fit, [*bent, *fresh], threads, rivals=rungs, begun=begun)
    fresh += [rung.trial for rung in begun]
    entered = {id(trial) for trial in fresh}
    afresh = [rung for rung in rungs if id(rung.trial) in entered]
    found = _contested(fit, rungs, held, threads, first=first)
    if first and fresh and not found:
        # Beside the base model as it is at first nobody helps; its details may be half of it.
        rungs += race(fit, [with_base_details(trial) for trial in fresh], threads, rivals=rungs)
        found = _contested(fit, rungs, held, threads, first=first)
    return found, afresh


def refits_afresh(
    fit: Fit,
    held: HeldOut,
    suspects: Sequence[Suspect],
    tell: Callable[[str], None],
    threads: int,
    known: Sequence[Rung] = (),
) -> list[Rung]:
    """Refits with every effect from a fresh start, each brought as far as it can be, best first.

    Args:
        fit: the fit at the foot of the ladder.
        held: whose question is that at the foot.
        suspects: scores of all effects there.
        tell: called with a sentence about what is going on.
        threads: refits that run at a time.
        known: refits of every effect from a fresh start, where that was asked before.
    """
    tell("refitting with every effect from a fresh start")
    trials, begun = entrants(fit, held.question, suspects, threads, known)
    # Whoever has begun at the best one-step size may have ended where loop and effect imitate each
    # other: a limit that the drive meets at its peaks alone begins as one at a tenth of them.
    trials += jointly(fit, held.question, suspects, threads)
    return _contested(fit, race(fit, trials, threads, begun=begun), held, threads, first=True)


def _on_mechanics(
    fit: Fit, rungs: Sequence[Rung], suspects: Sequence[Suspect], bar: float, threads: int
) -> list[Trial]:
    """Suspects beside mechanics that a fit left out and that explain more than all of them do.

    Alone these mechanics may be no more than a lag in their guise; beside the effect that bends
    them the resonance shows.
    """
    moved = [r for r in rungs if r.suspect is None and not r.fit.model.quasi_static]
    least = min((r.fit.rms for r in rungs if r.suspect is not None), default=fit.rms)
    if not fit.model.quasi_static or not moved:
        return []
    best = min(moved, key=lambda r: r.fit.rms)
    if best.fit.rms > _MOVED * least or plausible(best):
        return []
    there, _ = scored(best.fit, [s.effect for s in suspects], threads)
    likely = [s for s in there if s.p_value < bar]
    short = shortlist(likely, there) if likely else []
    return [with_base_details(adding(fit, s)) for s in short]


def _contested(
    fit: Fit, rungs: Sequence[Rung], held: HeldOut, threads: int, *, first: bool
) -> list[Rung]:
    """Plausible rungs with the contenders' best fits, judged and sorted.

    Beside what was found the base model is bent less, and who misses the other record there is
    asked for its place: only what is found first has fresh starts for that.
    """
    contenders = [r for r in rungs if plausible(r)]
    closest = min((r.fit for r in contenders), key=lambda f: f.rms, default=fit)
    afresh = first and closest is not fit and _alone(closest, held)
    return contest(fit, contenders, held.question, threads, afresh=afresh)


def ordered(
    rungs: Sequence[Rung], held: HeldOut, threads: int
) -> list[tuple[Rung, FloatArray | None]]:
    """Rungs and their held-out errors: best first by both records, fitted and held out.

    A rung that bends the base model fits well and predicts badly; neither error alone decides.
    What the model has already comes before effects that do hardly better on both, or on the
    fitted one without strong evidence: a detail that is right may reach beyond a record of
    another kind no better than one that is wrong. Where nothing is held out the information
    criterion decides, and the scores between those that it hardly tells apart; rarer forms of
    effects are behind the usual ones then.
    """
    if not rungs:
        return []
    if held.record is None:
        # Nothing else decides: the information criterion; where that hardly prefers one, the
        # scores, which no search has bent, of the forms that are expected.
        enough = _ENOUGH * min(r.fit.rms for r in rungs)
        entering = [(r.suspect, r) for r in rungs if r.suspect is not None]
        strongest = max((r.delta_bic for _, r in entering), default=-np.inf)
        alike = [(s, r) for s, r in entering if r.delta_bic > strongest - _HARDLY]
        alike.sort(key=lambda pair: (pair[0].effect.rare, -pair[0].score))
        likely = alike[0][1] if alike else None
        first = sorted(
            rungs, key=lambda r: (r.suspect is not None or r.fit.rms > enough, r is not likely)
        )
        return [(rung, None) for rung in first]
    near = _IN_SIGHT * min(r.fit.rms for r in rungs)
    close = [r for r in rungs if r.fit.rms <= near]
    with Pool(max_workers=threads) as pool:
        # Each fit once: some of them are of several rungs.
        fits = list(dict.fromkeys(r.fit for r in close))
        found = dict(zip(fits, pool.map(lambda f: elsewhere(f, held), fits), strict=True))
    errors = [found[r.fit] for r in close]

    # A record that nobody comes near shows above all something else: it decides nothing yet.
    reached = [(rms(e) or 0.0) / r.fit.rms for r, e in zip(close, errors, strict=True)]
    foreign = min(reached) > FOREIGN

    def both(pair: tuple[Rung, FloatArray | None]) -> float:
        return pair[0].fit.rms * (1.0 if foreign else rms(pair[1]) or 0.0)

    pairs = sorted(zip(close, errors, strict=True), key=both)
    enough = (_ENOUGH if foreign else _ENOUGH**2) * both(pairs[0])
    strongest = max((r.delta_bic for r in close if r.suspect is not None), default=-np.inf)

    # Of those that predict as well whoever leaves nothing but noise, and pays for fewer parameters;
    # where that hardly tells them apart whoever predicts better.
    as_well = _AS_WELL * (rms(pairs[0][1]) or 0.0)
    named = [(r, e) for r, e in pairs if r.suspect is not None]
    level = [(r, e) for r, e in named if (rms(e) or 0.0) <= as_well and both((r, e)) <= enough]
    quiet = [(r, e) for r, e in level if explained(r.fit)] or level
    lean = _leanest(quiet, exact=any(nothing_to_win(r.fit) for r, _ in quiet))

    def later(pair: tuple[Rung, FloatArray | None]) -> tuple[bool, bool]:
        rung, _ = pair
        beaten = both(pair) > enough and rung.delta_bic + STRONG < strongest
        return rung.suspect is not None or beaten, rung is not lean

    return sorted(pairs, key=later)


def chosen(
    fit: Fit,
    error: FloatArray | None,
    rungs: Sequence[tuple[Rung, FloatArray | None]],
    held: HeldOut,
    *,
    first: bool,
) -> tuple[Rung, FloatArray | None] | None:
    """The first rung that is worth its name and that the held-out data do not contradict.

    A detail names nothing, and what it wins on the fitted record it may lose a little of where a
    record of another kind is judged on: without it an effect would be named for its sake. What is
    found first may leave a record of another kind about as it was, if that shows far more than what
    is then left, until the end of the ladder; and where it explains much of the fitted record it
    need but not hurt on the other until then. Beside what was found already another name must prove
    itself where it is judged. Where the held-out data contradict what leaves but noise, it is
    fitted finely first: the scheme's error looks like a shift of the resonance, which one record
    hardly shows and another above all. And it is fitted without mechanics that it does not pay for:
    they may have come of what was missing, and ring where the other record shakes them.
    """
    asked = False
    for rung, after in rungs:
        halved = rung.fit.rms < _HALVED * fit.rms
        lenient = (rung.fit.rms if halved else fit.rms) if first else np.inf
        detail = rung.suspect is None
        worth = _DETAIL if detail else WORTH
        there = rms(error) or 0.0
        foreign = halved and first and FOREIGN * fit.rms < there < np.inf
        level = (rms(after) or 0.0) <= _TOLERATED * (there or np.inf)
        unhurt = first and rung.fit.rms < _MUCH * fit.rms and (rms(after) or 0.0) <= there
        if rung.fit.rms >= (1.0 - worth) * fit.rms:
            continue
        if (level and (detail or foreign)) or unhurt or agrees(error, after, lenient):
            return rung, after
        if not asked and explained(rung.fit):
            asked = True
            for other in (finely(rung.fit), stilled(rung.fit)):
                after = None if other is None else elsewhere(other, held)
                if other is not None and agrees(error, after, lenient):
                    return replace(rung, fit=other), after
    return None


def nothing_to_win(fit: Fit) -> bool:
    """Whether not even a detail could win what it is worth."""
    return (1.0 - _DETAIL) * fit.rms < noise_floor(fit).rms


def shows_more(fit: Fit) -> bool:
    """Whether the fitted record itself shows that something is missing: more than noise is left.

    What only another record misses cannot be found here.
    """
    return not nothing_to_win(fit) or structure(fit, noise_floor(fit)).left


def astray(fit: Fit, held: HeldOut, *, several: bool) -> bool:
    """Whether a fit leaves far more than noise, or somewhat more and misses the other record.

    Of several effects that miss it the last may stand for another one, whatever it leaves here.

    Args:
        fit: the fit.
        held: whose record is the other one.
        several: whether more than one effect has been found.
    """
    over = fit.rms / noise_floor(fit).rms
    return over > _LOST or ((several or over > _NOISY) and _mispredicts(fit, held, FOREIGN))


def short_of_noise(fit: Fit, held: HeldOut, *, lone: bool) -> bool:
    """Whether a fit leaves more than noise, and no slow noise that the other record bears out.

    One effect alone must leave no more than the noise may be and carry over to the other record: a
    law with more freedom does nearly what the right one does.

    Args:
        fit: the fit.
        held: whose record is the other one.
        lone: whether just one effect has been found.
    """
    floor = noise_floor(fit)
    if lone:
        return fit.rms > floor.high or misjudged(fit, held)
    if fit.rms <= _NOISY * floor.rms:
        return False
    return structure(fit, floor).left or misjudged(fit, held)


def misjudged(fit: Fit, held: HeldOut) -> bool:
    """Whether a fit predicts the other record worse than it fits its own: a name may be its kin's.

    Args:
        fit: the fit.
        held: whose record is the other one.
    """
    return _mispredicts(fit, held, _DOUBTFUL)


def _unsettled(fit: Fit, *, first: bool) -> bool:
    """Whether a residual may yet be no noise: it shows structure, or (at first) it is slow."""
    floor = noise_floor(fit)
    return fit.rms > (_ABOVE if first else _LOST) * floor.rms or structure(fit, floor).left


def _alone(fit: Fit, held: HeldOut) -> bool:
    """Whether a fit explains one record and misses another that is like it.

    It may have ended in a minimum of its own; a record that it misses by far shows something else.
    """
    if fit.rms >= _NOISY * noise_floor(fit).rms:
        return False
    return _mispredicts(fit, held, _DOUBTFUL) and not _mispredicts(fit, held, FOREIGN)


def _mispredicts(fit: Fit, held: HeldOut, times: float) -> bool:
    """Whether a fit explains one record and not the other: it may be bent to do so."""
    there = rms(elsewhere(fit, held))
    return there is not None and there > times * fit.rms


def _refitting(suspects: Sequence[Suspect]) -> str:
    names = dict.fromkeys(s.name for s in suspects)
    return f"refitting with {', '.join(names) or 'more detail'}"


def _leanest(level: Sequence[tuple[Rung, FloatArray | None]], *, exact: bool) -> Rung | None:
    """Whom BIC prefers; of those that it hardly tells apart whom both records together prefer.

    One spare parameter costs less than strong evidence is, and what it wins on another record by
    chance is worth less than that: the log-likelihood there is added to BIC. Where not even noise
    is reached, none is right yet and no parameter spare: the least other error decides.
    """
    most = max((rung.delta_bic for rung, _ in level), default=0.0)
    even = [(rung, error) for rung, error in level if most - rung.delta_bic < STRONG]
    if not even:
        return None
    closest, least = min(even, key=lambda pair: rms(pair[1]) or 0.0)
    if not exact or least is None:
        return closest
    news = effective_samples(least)

    def evidence(pair: tuple[Rung, FloatArray | None]) -> float:
        rung, error = pair
        return rung.delta_bic - 2.0 * news * float(np.log(rms(error) or 1.0))

    return max(even, key=evidence)[0]
