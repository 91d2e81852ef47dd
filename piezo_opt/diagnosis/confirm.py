"""Whether another record wants what was found, once the base model may follow that record.

A held-out record of another kind may show above all what the fitted one does not determine (a
resonance that triangles hardly shake): its error then stays where it was, however right the new
effect is. What leaves nothing but noise on the fitted record is judged once more: the base model is
fitted to the held-out record without the effect, and with the effect as it was found, none of whose
parameters may move. Both have the same freedom there. An effect that is not in that record stands
in its way, and one that the record cannot show is not confirmed.
"""

from __future__ import annotations

from dataclasses import replace

from piezo_opt.diagnosis.held_out import HeldOut, agrees
from piezo_opt.diagnosis.refinements import explained
from piezo_opt.diagnosis.rung import WORTH, solved
from piezo_opt.errors import NO_FIT
from piezo_opt.identification import Fit
from piezo_opt.measurement import Measurement
from piezo_opt.simulation import INITIAL


def confirmed(foot: Fit, fit: Fit, held: HeldOut) -> bool:
    """Whether a base model that is fitted to the held-out record fits better beside the effects.

    Args:
        foot: the fit at the foot of the ladder.
        fit: the richer fit; it must leave but noise.
        held: the other record.
    """
    if held.record is None or not explained(fit):
        return False
    try:
        without, beside = (_following(one, held.record) for one in (foot, fit))
    except NO_FIT:
        return False
    seen = beside.rms < (1.0 - WORTH) * without.rms
    return seen and agrees(without.residuals, beside.residuals)


def _following(fit: Fit, record: Measurement) -> Fit:
    """The base model fitted to another record, the effects beside it as they were found."""
    given = {name for name, effect in fit.model if not effect.structural}
    declared = fit.model.parameters
    kept = {
        k: v for k, v in fit.values.items()
        if k in declared and k.split(".")[0] in given and not declared[k].per_record
    }  # fmt: skip
    question = replace(
        fit.question.with_records(record),
        free=tuple(k for k in fit.question.free if k not in kept),
        fixed={**fit.question.fixed, **kept},
    )
    return solved(question, {k: v for k, v in fit.values.items() if not k.startswith(INITIAL)})
