"""What the model has already, in more detail: tried before an effect of another name is asked for.

Two things are no missing effects. The *details* of a present effect's shape (the exponent of a
loop, the roundness of a knee) are kept fixed until the record pays for them. And the *mechanics*
of an actuator are there even where its first fit had to leave them out.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from piezo_opt.diagnosis.rung import STRONG, Rung, Trial, bic_gain, solved
from piezo_opt.effects.motion.second_order import SecondOrder
from piezo_opt.errors import PiezoOptError
from piezo_opt.identification import Fit, Identification
from piezo_opt.identification.default import shown
from piezo_opt.identification.shapes import detail_start, own
from piezo_opt.identification.starting import resonance_start

_STIFF = (12.0, 40.0)
"""Natural frequencies of mechanics too fast to be seen, over the sampling rate."""
_ASIDE = 20
"""Iterations without a detail: whoever needs more without it has paid for it."""
_UNSEEN = 1.02
"""Error over the quasi-static one's up to which mechanics count as too fast to be seen."""


def refinements(fit: Fit, given: Identification) -> list[Trial]:
    """Richer questions about the effects that a fit's model has.

    Args:
        fit: the fit.
        given: the question at the foot of the ladder; what the user fixed there stays fixed.
    """
    return [*base_refinements(fit, given), *shape_refinements(fit)]


def shape_refinements(fit: Fit) -> list[Trial]:
    """Details of the effects that were added to the base model, and their other forms."""
    names = [name for name, effect in fit.model if not effect.structural]
    trials = [t for t in (_details(fit, name) for name in names) if t is not None]
    return [*trials, *(t for name in names for t in _forms(fit, name))]


def _forms(fit: Fit, name: str) -> list[Trial]:
    """One effect in the other forms under which a search tries it."""
    effect: Any = fit.model[name]
    others = [replace(effect, **options) for options in effect.variants]
    if effect not in others:
        return []  # written in more detail already
    return [
        Trial(fit.question.with_model(fit.model.replaced(name, o)), fit.values, refines=(name,))
        for o in others
        if o != effect
    ]


def base_refinements(fit: Fit, given: Identification) -> list[Trial]:
    """Details of the base model, and its mechanics where they were left out."""
    names = [name for name, effect in fit.model if effect.structural]
    trials = [t for t in (_details(fit, name) for name in names) if t is not None]
    mechanics = mechanics_trial(fit, given)
    return trials if mechanics is None else [*trials, mechanics]


def with_base_details(trial: Trial) -> Trial:
    """A trial in which the base model's details are free beside the suspect.

    An effect and the roundness of the loop may each explain nothing alone and all of it together.
    What was freed in vain is fixed again by :func:`lean`.
    """
    model, question = trial.question.model, trial.question
    details = [
        f"{name}.{own}" for name, effect in model if effect.structural
        for own in effect.details if f"{name}.{own}" not in (*question.free, *question.fixed)
    ]  # fmt: skip
    record = question.campaign.records[0]
    begin = {k: detail_start(model.parameters[k], record) for k in details}
    # What the user knows better is a better start than what every record suggests.
    given = {k: trial.start.get(k, model.parameters[k].nominal) for k in details}
    begin |= {k: v for k, v in given.items() if v != model.parameters[k].nominal}
    return replace(
        trial,
        question=replace(question, free=(*question.free, *details)),
        start={**trial.start, **begin},
        refines=(*trial.refines, *details),
    )


def lean(fit: Fit, rung: Rung) -> Rung:
    """A rung without the details of the base model that it does not pay for."""
    spare = [
        k for k in rung.fit.question.free
        if k not in fit.question.free and rung.fit.model[k.split(".")[0]].structural
    ]  # fmt: skip
    for name in spare:
        question = rung.fit.question
        kept = replace(question, free=tuple(k for k in question.free if k != name))
        held = fit.values.get(name, question.model.parameters[name].nominal)
        try:
            poorer = solved(
                replace(kept, values={**kept.values, name: held}),
                {**rung.fit.values, name: held},
                _ASIDE,
            )
        except (PiezoOptError, ArithmeticError):
            continue
        if bic_gain(poorer, rung.fit) < STRONG:
            trial = replace(rung.trial, refines=tuple(k for k in rung.trial.refines if k != name))
            rung = Rung(trial, poorer, rung.delta_bic - bic_gain(poorer, rung.fit))
    return rung


def plausible(rung: Rung) -> bool:
    """Whether mechanics that joined show a resonance, and what was freed found a value.

    A lag in the guise of mechanics is none, nor a phase where the drive shakes nothing; a loop
    whose exponent runs to its bound imitates something else.
    """
    values, freed, record = rung.fit.values, rung.trial.refines, rung.fit.records[0]
    at_bound = rung.suspect is None and set(freed) & set(rung.fit.at_bound)
    return not at_bound and all(
        shown(record, values[f"{name}.omega"], values[f"{name}.zeta"])
        for name, effect in rung.fit.model
        if name in freed and isinstance(effect, SecondOrder)
    )


def stiffened(fit: Fit) -> Fit | None:
    """A quasi-static fit with mechanics too fast to be seen, for forces.

    A force then acts as the displacement F / omega^2. None where the record sees any mechanics
    that the scheme can follow.
    """
    model = fit.model + SecondOrder()
    name = model.names[-1]
    step = min(record.step for record in fit.records)
    question = fit.question.with_model(model)
    for fast in _STIFF:
        held = {**question.fixed, f"{name}.omega": fast / step, f"{name}.zeta": 1.0}
        try:
            stiff = solved(replace(question, fixed=held), fit.values, 10)
        except (PiezoOptError, ArithmeticError):
            continue
        if stiff.rms <= _UNSEEN * fit.rms:
            return stiff
    return None


def _details(fit: Fit, name: str) -> Trial | None:
    """One effect in more detail: its finer form, and the details of its shape freed."""
    effect = fit.model[name]
    values = own(fit.values, name)
    finer, start = effect.finer(values)
    details = [
        k for k in finer.details
        if f"{name}.{k}" not in (*fit.question.free, *fit.question.fixed)
    ]  # fmt: skip
    if finer == effect and not details:
        return None
    record = fit.question.campaign.records[0]
    freed = tuple(f"{name}.{k}" for k in details)
    question = fit.question.with_model(fit.model.replaced(name, finer))
    question = replace(question, free=(*question.free, *freed))
    begin = {k: detail_start(finer.parameters[k], record) for k in details}
    moved = {f"{name}.{k}": v for k, v in {**start, **begin}.items()}
    return Trial(question, {**fit.values, **moved}, refines=freed or (name,))


def mechanics_trial(fit: Fit, given: Identification) -> Trial | None:
    """Free mechanics for a fit that has none, or that has them too fast to be seen."""
    unseen = next((n for n, e in fit.model if isinstance(e, SecondOrder)), "")
    model, fixed = fit.model, dict(fit.question.fixed)
    if fit.model.quasi_static:
        model = model + SecondOrder()
        unseen = model.names[-1]
    elif f"{unseen}.omega" not in fixed or f"{unseen}.omega" in given.fixed:
        return None
    fixed = {k: v for k, v in fixed.items() if not k.startswith(f"{unseen}.")}
    question = replace(fit.question, fixed=fixed).with_model(model)
    try:
        found = resonance_start(question, fit.values, fit.residual(0), unseen)
    except (PiezoOptError, ArithmeticError):
        return None
    return None if found is None else Trial(question, found, refines=(unseen,))
