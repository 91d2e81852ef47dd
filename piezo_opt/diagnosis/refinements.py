"""What the model has already, in more detail: tried before an effect of another name is asked for.

Two things are no missing effects. The *details* of a present effect's shape (the exponent of a
loop, the roundness of a knee) are kept fixed until the record pays for them. And the *mechanics*
of an actuator are there even where its first fit had to leave them out.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from piezo_opt.diagnosis.noise import noise_floor
from piezo_opt.diagnosis.rung import STRONG, Rung, Trial, bic_gain, solved
from piezo_opt.diagnosis.stopping import Pool
from piezo_opt.effects.base import Effect, Place
from piezo_opt.effects.motion.second_order import SecondOrder
from piezo_opt.effects.motion.spring import Spring
from piezo_opt.errors import PiezoOptError
from piezo_opt.identification import Fit, with_statistics
from piezo_opt.identification.default import shown
from piezo_opt.identification.shapes import detail_start, own
from piezo_opt.identification.starting import resonance_start

_RISING = 0.35
"""Damping below which a response rises towards its resonance."""
_KNOWN = 0.05
"""Relative standard deviation of a natural frequency that is seen without being shaken."""
EXPLAINED = 1.08
"""Error over the noise floor up to which nothing is left to be won."""
_ASIDE = 20
"""Iterations without a detail: whoever needs more without it has paid for it."""


def refinements(fit: Fit) -> list[Trial]:
    """Richer questions about the effects that a fit's model has; what is fixed stays fixed."""
    return [*base_refinements(fit), *shape_refinements(fit)]


def shape_refinements(fit: Fit) -> list[Trial]:
    """Details of the effects that were added to the base model, and their other forms."""
    names = [name for name, effect in fit.model if not effect.structural]
    trials = [t for t in (_details(fit, name) for name in names) if t is not None]
    return [*trials, *(t for name in names for t in other_forms(fit, name))]


def other_forms(fit: Fit, name: str) -> list[Trial]:
    """One effect in the other forms under which a search tries it."""
    effect = fit.model[name]
    others = forms(effect)
    if effect not in others:
        return []  # written in more detail already
    return [
        Trial(fit.question.with_model(fit.model.replaced(name, o)), fit.values, refines=(name,))
        for o in others
        if o != effect
    ]


def forms(effect: Effect) -> list[Effect]:
    """The forms of an effect under which a search tries it."""
    # A form is what its options say, and what the others of the forms' options are by default.
    asked = {option for options in effect.variants for option in options}
    kept = {option: value for option, value in effect.options.items() if option not in asked}
    written: Any = type(effect)
    return [written(**kept, **options) for options in effect.variants]


def base_refinements(fit: Fit) -> list[Trial]:
    """Details of the base model, and its mechanics where they were left out."""
    names = [name for name, effect in fit.model if effect.structural]
    trials = [t for t in (_details(fit, name) for name in names) if t is not None]
    mechanics = mechanics_trial(fit)
    return trials if mechanics is None else [*trials, mechanics]


def with_base_details(trial: Trial, also: str = "") -> Trial:
    """A trial in which the base model's details are free beside the suspect.

    An effect and the roundness of the loop may each explain nothing alone and all of it together.
    What was freed in vain is fixed again by :func:`lean`.

    Args:
        trial: the trial.
        also: name of an effect whose details are free, too.
    """
    model, question = trial.question.model, trial.question
    details = [
        f"{name}.{own}" for name, effect in model if effect.structural or name == also
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


def lean(fit: Fit, rung: Rung, threads: int) -> Rung:
    """A rung without the details that it does not pay for, of the base model or of its effect.

    Args:
        fit: the fit below.
        rung: a richer one.
        threads: refits that run at a time.
    """
    own = "" if rung.suspect is None else rung.suspect.name
    spare = [
        k for k in rung.fit.question.free
        if k not in fit.question.free
        and (rung.fit.model[k.split(".")[0]].structural or k.split(".")[0] == own)
    ]  # fmt: skip
    with Pool(max_workers=threads) as pool:
        while spare:
            # Asked side by side; after one that goes the others are asked again, without it.
            few = spare[:threads]
            for name, poorer in zip(few, pool.map(partial(_aside, fit, rung), few), strict=True):
                spare.remove(name)
                if poorer is not None and bic_gain(poorer, rung.fit) < STRONG:
                    refines = tuple(k for k in rung.trial.refines if k != name)
                    delta = rung.delta_bic - bic_gain(poorer, rung.fit)
                    rung = Rung(replace(rung.trial, refines=refines), poorer, delta)
                    break
    return rung


def _aside(fit: Fit, rung: Rung, name: str) -> Fit | None:
    """A rung's fit with one detail as it is below; None where that cannot be fitted."""
    question = rung.fit.question
    held = fit.values.get(name, question.model.parameters[name].nominal)
    kept = replace(
        question, free=tuple(k for k in question.free if k != name),
        values={**question.values, name: held},
    )  # fmt: skip
    try:
        return solved(kept, {**rung.fit.values, name: held}, _ASIDE)
    except (PiezoOptError, ArithmeticError):
        return None


def plausible(rung: Rung) -> bool:
    """Whether mechanics that joined show a resonance, and what was freed found a value.

    A lag in the guise of mechanics is none, nor a phase where the drive shakes nothing; a loop
    whose exponent runs to its bound imitates something else. Of mechanics on which an effect was
    scored the rise towards a resonance is enough.
    """
    freed = rung.trial.refines
    at_bound = rung.suspect is None and set(freed) & set(rung.fit.at_bound)
    mechanics = [name for name, effect in rung.fit.model if isinstance(effect, SecondOrder)]
    return not at_bound and all(
        _resonates(rung.fit, name) or (name not in freed and _rises(rung.fit, name))
        for name in mechanics
        if name in (*freed, *rung.trial.ground)
    )


def explained(fit: Fit) -> bool:
    """Whether a fit leaves nothing but noise."""
    return fit.rms <= EXPLAINED * noise_floor(fit).rms


def _resonates(fit: Fit, mechanics: str) -> bool:
    """Whether a record shows these mechanics: a peak, or the rise towards one that is not reached.

    Below the resonance the response grows with the frequency, which no lag's does. Where that
    leaves nothing but noise and says to a twentieth where the peak must be, it need not be shaken.
    """
    record, omega = fit.records[0], f"{mechanics}.omega"
    if shown(record, fit.values[omega], fit.values[f"{mechanics}.zeta"]):
        return True
    if not _rises(fit, mechanics) or not explained(fit):
        return False
    return bool(with_statistics(fit).std[omega] < _KNOWN * fit.values[omega])


def _rises(fit: Fit, mechanics: str) -> bool:
    """Whether the response to these mechanics grows towards a resonance that can be sampled."""
    omega, zeta = (fit.values[f"{mechanics}.{own}"] for own in ("omega", "zeta"))
    return zeta < _RISING and omega * fit.records[0].step < np.pi


def stiffened(fit: Fit) -> Fit | None:
    """A quasi-static fit behind a spring, which forces act on; None where that cannot be simulated.

    A force f then acts as the displacement f / omega^2, at once.
    """
    question = fit.question.with_model(fit.model + Spring())
    try:
        return solved(question, fit.values, 10)
    except (PiezoOptError, ArithmeticError):
        return None


def moved(fit: Fit) -> Fit | None:
    """A quasi-static fit with free mechanics; None where it shows none."""
    trial = mechanics_trial(fit)
    if trial is None:
        return None
    try:
        found = solved(trial.question, trial.start, 10)
    except (PiezoOptError, ArithmeticError):
        return None
    return found if found.rms < fit.rms else None


def stilled(fit: Fit) -> Fit | None:
    """A fit without mechanics that it does not pay for; None where it has none, pays or needs them.

    What a fit lacks may look like mechanics that nothing has shaken.
    """
    model = fit.model
    for name, effect in fit.model:
        if isinstance(effect, SecondOrder):
            model = model.without(name)
    if model is fit.model:
        return None
    try:
        still = solved(fit.question.with_model(model), fit.values)
    except (PiezoOptError, ArithmeticError):
        return None
    return still if bic_gain(still, fit) < STRONG else None


def _details(fit: Fit, name: str) -> Trial | None:
    """One effect in more detail: its finer form, and the details of its shape freed."""
    effect = fit.model[name]
    values = own(fit.values, name)
    finer, start = effect.finer(values)
    record = fit.question.campaign.records[0]
    if any(s.remanent for s in effect.declared_states.values()) and any(
        finer.parameters[k].unit == "s" and v < record.step for k, v in start.items()
    ):
        finer, start = effect, {}  # a memory that is gone at the next sample needs no detail
    # A force that a time makes of the velocity needs a mass: a spring without one holds none.
    still = effect.place is Place.MOTION and any(isinstance(e, Spring) for _, e in fit.model)
    details = [
        k for k in finer.details
        if f"{name}.{k}" not in (*fit.question.free, *fit.question.fixed)
        and not (still and finer.parameters[k].unit == "s")
    ]  # fmt: skip
    if finer == effect and not details:
        return None
    freed = tuple(f"{name}.{k}" for k in details)
    question = fit.question.with_model(fit.model.replaced(name, finer))
    question = replace(question, free=(*question.free, *freed))
    begin = {k: detail_start(finer.parameters[k], record) for k in details}
    moved = {f"{name}.{k}": v for k, v in {**start, **begin}.items()}
    return Trial(question, {**fit.values, **moved}, refines=freed or (name,))


def mechanics_trial(fit: Fit) -> Trial | None:
    """Free mechanics for a fit that has none, or none with a mass.

    Forces that act on a spring without mass are as strong per omega^2 as they were there.
    """
    if not massless(fit):
        return None
    spring = next((name for name, effect in fit.model if isinstance(effect, Spring)), "")
    mechanics = SecondOrder()
    model = fit.model.replaced(spring, mechanics) if spring else fit.model + mechanics
    joined = next(name for name, effect in model if effect == mechanics)
    question = fit.question.with_model(model)
    softness = {
        gate: fit.values[gate] / fit.values[f"{spring}.omega"] ** 2
        for name, gate in fit.model.gates.items()
        if spring and fit.model[name].place is Place.MOTION
    }
    try:
        found = resonance_start(question, fit.values, fit.residual(0), joined, softness)
    except (PiezoOptError, ArithmeticError):
        return None
    return None if found is None else Trial(question, found, refines=(joined,))


def massless(fit: Fit) -> bool:
    """Whether a fit has no mechanics, or forces on a spring in their place."""
    return fit.model.quasi_static or any(isinstance(effect, Spring) for _, effect in fit.model)
