"""One rung of the ladder: what may be tried at a fit, refitted in a race, and judged by BIC."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from piezo_opt.diagnosis.scores import Suspect, effective_samples
from piezo_opt.diagnosis.stopping import Pool
from piezo_opt.errors import NO_FIT
from piezo_opt.identification import (
    Ending,
    Fit,
    Identification,
    LevenbergMarquardt,
    SingleShooting,
    solve,
    too_coarse,
)
from piezo_opt.simulation import INITIAL

STRONG = 10.0
"""Difference of BIC that counts as very strong evidence (Kass & Raftery 1995)."""
WORTH = 0.06
"""Share by which the error must fall for an effect to be worth a name: less than a third of what
is left is not."""
_FIRST, _LATER = 10, 30
"""Iterations of a refit before and after it is decided which are worth following."""
_CLOSE = 1e-5
"""Decrease of the cost in one iteration at which they end. Strong evidence on ten thousand
independent samples is a thousandth of the cost; on the plateaus of a bent loop less is not the
end."""
_RACE = 1.5
"""Error over the best rival's beyond which a refit is out of the race..."""
_PODIUM = 3
"""...unless it is among the best so many."""
_OUTSIDE = 2.0
"""Error over that of what stands beyond which a refit that has slowed down is given up before it is
decided which are worth following; and over the best one's up to which one that has not is."""
_HOPELESS = 4.0
"""Error over that of a rival from an earlier race, or of what stands, beyond which nobody is
followed, and whoever has slowed down is given up before that is decided."""
_REACH = 1.2
"""Error over that of what stands beyond which one that is followed is given up once it has slowed
down: not even in a group with it."""
_SLOWED = 0.8
"""Error over that of the iteration before from which a search has slowed down."""
_BEHIND = 1.1
"""Error over that of the fit below up to which more detail stays in the race."""


@final
@dataclass(frozen=True, eq=False)
class Trial:
    """A richer question and where its fit begins.

    Attributes:
        question: the richer question.
        start: values to begin at.
        suspect: the effect that is added; None for a refinement of what the model has.
        refines: what a refinement frees or adds, by name.
        ground: what joins because the suspect was scored on it: mechanics, or a spring.
    """

    question: Identification
    start: Mapping[str, float]
    suspect: Suspect | None = None
    refines: tuple[str, ...] = ()
    ground: tuple[str, ...] = ()


@final
@dataclass(frozen=True, eq=False)
class Rung:
    """A trial and its fit.

    Attributes:
        trial: what was tried.
        fit: the richer fit.
        delta_bic: by how much BIC falls.
    """

    trial: Trial
    fit: Fit
    delta_bic: float

    @property
    def suspect(self) -> Suspect | None:
        """The effect that was added; None for a refinement."""
        return self.trial.suspect


def adding(below: Fit, suspect: Suspect) -> Trial:
    """The model with a suspect, started at its one-step size, shapes free.

    Args:
        below: the fit that lacks it; mechanics on which it was scored and which that one has not
            join with it.
        suspect: the effect.
    """
    fit = suspect.base
    model = fit.model + suspect.effect
    joined = tuple(n for n in fit.model.names if n not in below.model)
    name = model.names[-1]
    gate = suspect.effect.parameters[suspect.effect.gate or ""]
    size = float(np.clip(suspect.size, *gate.bounds))
    start = {
        **fit.values,
        **{f"{name}.{k}": v for k, v in suspect.shapes.items()},
        f"{name}.{suspect.effect.gate}": size,
    }
    return Trial(fit.question.with_model(model), start, suspect, ground=joined)


def solved(
    question: Identification,
    start: Mapping[str, float],
    iterations: int = 40,
    beyond: float = float("inf"),
    *,
    mend: bool = True,
) -> Fit:
    """A fit good enough to compare models by; an interrupt ends the ladder, not only this fit.

    Args:
        question: the question.
        start: values to begin at.
        iterations: most steps taken.
        beyond: rms [m] at which a search that has slowed down is given up, and so is one that is
            beyond it as soon as sub-steps that have become far too coarse are chosen anew.
        mend: whether they are.
    """
    solver = LevenbergMarquardt(iterations=iterations, tolerance=_CLOSE, beyond=beyond)
    coarse = SingleShooting(refine=False, mend=beyond if mend else 0.0)
    return _heeding(
        solve(question, start=start, solver=solver, transcription=coarse, statistics=False)
    )


def finely(fit: Fit) -> Fit:
    """A fit on sub-steps fine enough to estimate by; itself where that cannot be had.

    What the scheme's error has shifted a few steps bring back.
    """
    solver = LevenbergMarquardt(iterations=_FIRST, tolerance=_CLOSE)
    try:
        return _heeding(solve(fit.question, start=fit.values, solver=solver, statistics=False))
    except NO_FIT:
        return fit


def _heeding(fit: Fit) -> Fit:
    """A fit that nobody interrupted.

    Raises:
        KeyboardInterrupt: somebody did.
    """
    if fit.outcome.ending is Ending.INTERRUPTED:
        raise KeyboardInterrupt
    return fit


def race(
    fit: Fit,
    trials: Sequence[Trial],
    threads: int,
    *,
    most: int | None = None,
    podium: int = _PODIUM,
    rivals: Sequence[Rung] = (),
    begun: Sequence[Rung] = (),
    standing: Fit | None = None,
    hope: float = float("inf"),
) -> list[Rung]:
    """Refit all trials; only those that are still near the best are followed to their end.

    Args:
        fit: the fit below.
        trials: what is tried.
        threads: refits that run at a time.
        most: refits that are followed at most; without it all that are near, and more detail of
            what the model has unless it is behind.
        podium: refits that are followed however far behind the best.
        rivals: refits of the same fit that have been followed before; not returned again.
        begun: refits, of this fit or another one, that have been in a race before and are in this
            one from there; returned.
        standing: what stands where they would, and they are to reach, where there is such a fit.
        hope: rms [m] beyond which a refit is of no use: once it has slowed down it is given up.
    """
    there = float("inf") if standing is None else standing.rms
    hopeless = _HOPELESS * min([r.fit.rms for r in rivals] + [there])

    def one(trial: Trial) -> Rung | None:
        try:
            beyond = min(_OUTSIDE * there, hopeless, hope)
            richer = solved(trial.question, trial.start, _FIRST, beyond, mend=False)
            if not np.isfinite(richer.rms):
                richer = solved(trial.question, trial.start, _FIRST, beyond)
        except NO_FIT:
            return None
        return Rung(trial, richer, bic_gain(fit, richer))

    def further(rung: Rung) -> Rung:
        if rung.fit.outcome.success and not too_coarse(rung.fit):
            return rung
        try:
            beyond = min(_REACH * there, hope)
            richer = solved(rung.fit.question, rung.fit.values, _LATER, beyond)
        except NO_FIT:
            return rung
        return replace(rung, fit=richer, delta_bic=bic_gain(fit, richer))

    with Pool(max_workers=threads) as pool:
        rungs = [replace(rung, delta_bic=bic_gain(fit, rung.fit)) for rung in begun]
        rungs += [rung for rung in pool.map(one, trials) if rung is not None]
        if not rungs:
            return []
        ranked = sorted(r.fit.rms for r in rungs)
        near = min(_RACE * ranked[0], ranked[:most][-1])
        last = ranked[:podium][-1]
        # More detail of what the model has comes before another name: it is followed unless it
        # has lost what it began with.
        detail = _BEHIND * fit.rms if most is None else 0.0

        def worth(rung: Rung) -> bool:
            error, falling = rung.fit.rms, most is None and _falling(rung.fit)
            if error > hope and not falling:
                return False
            if rung.suspect is None and error <= detail:
                return True
            # Where a search ends that falls fast cannot be told from where it was stopped.
            reach = _OUTSIDE * ranked[0] if falling else 0.0
            return error <= min(max(near, last, reach), hopeless)

        worthy = [worth(rung) for rung in rungs]
        behind = [r for r, w in zip(rungs, worthy, strict=True) if not w]
        running = [r for r, w in zip(rungs, worthy, strict=True) if w]
        # The slowest first: begun last, one of them would keep all others waiting.
        running.sort(key=lambda r: -r.fit.wall_s)
        return [*behind, *pool.map(further, running)]


def _falling(fit: Fit) -> bool:
    """Whether a fit was stopped while it fell fast: by much in its last iteration."""
    error = fit.trace.rms
    stopped = not fit.outcome.success and error.size > 1
    return stopped and bool(error[-1] < _SLOWED * error[-2])


def judged(before: Fit, rungs: Sequence[Rung]) -> list[Rung]:
    """Rungs with strong evidence, best first, on the samples that the closest fit leaves free."""
    if not rungs:
        return []
    closest = min(rungs, key=lambda r: r.fit.rms)
    n = effective_samples(closest.fit.residuals)
    counted = [replace(r, delta_bic=bic_gain(before, r.fit, n)) for r in rungs]
    return sorted((r for r in counted if r.delta_bic > STRONG), key=lambda r: -r.delta_bic)


def bic_gain(before: Fit, after: Fit, samples: float | None = None) -> float:
    """By how much BIC falls from one fit to a richer one, on as many samples as carry news.

        N_e ln(SSR_0 / SSR_1) - (k_1 - k_0) ln N_e

    with N_e the effective number of samples, from the richer fit's residuals unless given, and k
    the numbers that act: parameters of which only products do count as one.
    Rivals are compared with the same N_e.

    Source: Schwarz (1978), Annals of Statistics 6(2), 461-464.
    """
    n = effective_samples(after.residuals) if samples is None else samples
    ssr0 = float(before.residuals @ before.residuals)
    ssr1 = float(after.residuals @ after.residuals)
    if not np.isfinite(ssr1) or ssr1 <= 0:
        return -np.inf
    more = numbers(after) - numbers(before)
    return n * float(np.log(ssr0 / ssr1)) - more * float(np.log(max(n, 2.0)))


def numbers(fit: Fit) -> int:
    """How many numbers of a fit act over the whole record.

    Not those that are redundant by definition, nor where a trailing state begins: what a record
    says of that does not grow with its length.
    """
    heads = tuple(
        f"{INITIAL}{name}.{state}"
        for name, effect in fit.model for state, declared in effect.declared_states.items()
        if declared.trailing
    )  # fmt: skip
    begins = sum(name.startswith(heads) for name in fit.names)
    return len(fit.names) - begins - sum(effect.redundant for _, effect in fit.model)
