"""What a model has already, in more detail: members of a search that bear no name.

The *details* of a present effect's shape (the exponent of a loop, the roundness of a knee) are
fixed until the record pays for them; an effect may be written in other *forms*; and the
*mechanics* of an actuator are there even where its first fit had to leave them out.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace

import numpy as np

from piezo_opt.diagnosis.refit import FIRST, refit
from piezo_opt.effects.base import Effect, Place
from piezo_opt.effects.model import Model
from piezo_opt.effects.motion.second_order import SecondOrder
from piezo_opt.effects.motion.spring import Spring
from piezo_opt.errors import NO_FIT
from piezo_opt.identification import Fit, Identification, ringing
from piezo_opt.identification.shapes import detail_start, own, resonances
from piezo_opt.identification.starting import resonance_start
from piezo_opt.measurement import Measurement

Richer = tuple[Identification, Mapping[str, float]]
"""A question and where its fit begins."""

_RESONANCES = 4
"""Natural frequencies from which mechanics begin, over the range that a record can show."""
_APART = 0.05
"""Logarithm of the ratio of natural frequencies from which resonances are two: the band of one with
a damping ratio of 0.025, twice that of a usual flexure."""


def in_detail(fit: Fit, *, quiet: bool = False) -> list[Richer]:
    """Each effect in all its details and its finer form, each in its other forms, and mechanics.

    Args:
        fit: the fit.
        quiet: whether it leaves only noise: then no mechanics, which have nothing left to explain.
    """
    found = [
        begun
        for name, _ in fit.model if (more := detailed(fit, name)) is not None
        for begun in _resonating(fit, name, more)
    ]  # fmt: skip
    for name, effect in fit.model:
        if not effect.structural:
            found += _in_other_forms(fit, name)
    return found if quiet else [*found, *with_mechanics(fit)]


def _resonating(fit: Fit, name: str, more: Richer) -> list[Richer]:
    """A finer form from where it begins by itself; one with a natural frequency more from each of
    the likeliest resonances of what is left, away from those that the model has."""
    question, start = more
    new = question.model[name].parameters.keys() - fit.model[name].parameters.keys()
    frequency = next((k for k in new if question.model[name].parameters[k].unit == "rad/s"), None)
    if frequency is None:
        return [more]
    has = [fit.values[k] for k, p in fit.model.parameters.items() if p.unit == "rad/s"]
    likeliest = [
        omega for omega in resonances(fit.records[0], fit.residual(0))
        if all(abs(np.log(omega / other)) > _APART for other in has)
    ]  # fmt: skip
    return [
        (question, {**start, f"{name}.{frequency}": omega}) for omega in likeliest[:_RESONANCES]
    ]


def with_mechanics(fit: Fit) -> list[Richer]:
    """Free mechanics for a fit that has none, or none with a mass, from several resonances.

    The likeliest by the spectrum first, then some a factor of two and a half apart: what excites a
    resonance may be a single event, whose spectrum is lost in that of the record. Forces that act
    on a spring without mass are as strong per omega^2 as they were there.
    """
    spring = next((name for name, effect in fit.model if isinstance(effect, Spring)), "")
    if not fit.model.quasi_static and not spring:
        return []
    mechanics = SecondOrder()
    model = fit.model.replaced(spring, mechanics) if spring else fit.model + mechanics
    joined = next(name for name, effect in model if effect == mechanics)
    question = ringing(fit.question.with_model(model), fit.model)
    softness = {
        gate: fit.values[gate] / fit.values[f"{spring}.omega"] ** 2
        for name, gate in fit.model.gates.items()
        if spring and fit.model[name].place is Place.MOTION
    }
    found: list[Richer] = []
    with suppress(*NO_FIT):
        likeliest = resonance_start(question, fit.values, fit.residual(0), joined, softness)
        found += [] if likeliest is None else [(question, likeliest)]
    step = question.campaign.records[0].step
    for omega in np.geomspace(0.05, 0.8, _RESONANCES) * np.pi / step:
        strengths = {gate: float(soft * omega**2) for gate, soft in softness.items()}
        found.append((question, {**fit.values, **strengths, f"{joined}.omega": float(omega)}))
    return found


def on_spring(fit: Fit) -> Fit | None:
    """A quasi-static fit behind a spring, which forces act on; None where that cannot be simulated.

    A force f then acts as the displacement f / omega^2, at once.
    """
    try:
        return refit(fit.question.with_model(fit.model + Spring()), fit.values, 2 * FIRST)
    except NO_FIT:
        return None


def on_mechanics(fit: Fit) -> Fit | None:
    """A quasi-static fit with free mechanics; None where it shows none."""
    best = fit
    # Others are scored at it: its direction counts, not its last digit.
    for question, start in with_mechanics(fit)[:1]:
        with suppress(*NO_FIT):
            best = min(best, refit(question, start, 2 * FIRST), key=lambda one: one.rms)
    return None if best is fit else best


def _in_other_forms(fit: Fit, name: str) -> list[Richer]:
    """One effect in the other forms under which a search tries it."""
    effect = fit.model[name]
    if effect not in effect.forms:
        return []  # written in more detail already
    does = own(fit.values, name)
    found: list[Richer] = []
    for other in effect.forms:
        if other != effect:
            begun = other.like(effect.name, does) or {}
            start = {**fit.values, **{f"{name}.{k}": v for k, v in begun.items()}}
            found.append((fit.question.with_model(fit.model.replaced(name, other)), start))
    return found


def detailed(fit: Fit, name: str) -> Richer | None:
    """One effect in its finer form, with the details of its shape free."""
    effect = fit.model[name]
    finer, start = finer_form(fit.model, name, fit.values)
    record = fit.question.campaign.records[0]
    if any(s.remanent for s in effect.declared_states.values()) and any(
        finer.parameters[k].unit == "s" and v < record.step for k, v in start.items()
    ):
        finer, start = effect, {}  # a memory that is gone at the next sample needs no detail
    # A force that a time makes of the velocity needs a mass: a spring without one holds none.
    still = _on_spring(fit.model, name)
    details = [
        k for k in finer.details
        if f"{name}.{k}" not in (*fit.question.free, *fit.question.fixed)
        and not (still and finer.parameters[k].unit == "s")
    ]  # fmt: skip
    if finer == effect and not details:
        return None
    question = fit.question.with_model(fit.model.replaced(name, finer))
    free = tuple(f"{name}.{k}" for k in details)
    begin = {k: v for k, v in freed(name, finer, record).items() if k in free}
    moved = {**{f"{name}.{k}": v for k, v in start.items()}, **begin}
    return replace(question, free=(*question.free, *free)), {**fit.values, **moved}


def finer_form(
    model: Model, name: str, values: Mapping[str, float]
) -> tuple[Effect, Mapping[str, float]]:
    """An effect of a model in its finer form, and where that begins.

    On a spring without mass a force stays as it is: what it remembers there in more detail, a
    hysteresis law remembers as well.
    """
    effect = model[name]
    return (effect, {}) if _on_spring(model, name) else effect.finer(own(values, name))


def _on_spring(model: Model, name: str) -> bool:
    """Whether an effect is a force on a spring without mass."""
    return model[name].place is Place.MOTION and any(isinstance(e, Spring) for _, e in model)


def freed(name: str, effect: Effect, record: Measurement) -> dict[str, float]:
    """The details of an effect's shape by the names that a model gives them, and where they begin.

    Args:
        name: of the effect in its model.
        effect: the effect.
        record: on whose scales they begin.
    """
    return {f"{name}.{k}": detail_start(effect.parameters[k], record) for k in effect.details}
