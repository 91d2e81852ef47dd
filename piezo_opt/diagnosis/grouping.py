"""Which effects the record cannot tell from the one that is named."""

from __future__ import annotations

from collections.abc import Sequence

from piezo_opt.diagnosis.noise import noise_floor
from piezo_opt.diagnosis.rung import STRONG, Rung
from piezo_opt.diagnosis.scores import Suspect
from piezo_opt.identification import Fit

_FORM = 2.0
"""Misfit beyond the noise over the best effect's own up to which a rival may be meant."""
_ALIKE_RMS = 1.2
"""The same for the whole error: slow noise makes the misfit look larger than it is."""
_NEARLY, _SLIGHTLY = 1.12, 0.01
"""Error over the best effect's, and share of what that one explains (squares), up to which a rival
may be meant in a slightly other form: a tenth of the effect, below the noise."""
_EXACT = 0.08
"""Misfit over the noise (squares) up to which a form counts as exact."""


def group_of(
    before: Fit, taken: Rung, rungs: Sequence[Rung], suspects: Sequence[Suspect]
) -> tuple[str, ...]:
    """Effects that the record cannot tell from the taken one, itself first.

    Refitted rivals within strong evidence of the best, and directions nearly parallel to it. Where
    the best itself leaves more than noise, its form is not the true one, and a rival that misses by
    less than twice as much may be meant as well; and so may one that is behind by a tenth of the
    effect, as far as that is below the noise, for laws are known no better.

    Args:
        before: the fit that lacks the effect.
        taken: the effect and its fit.
        rungs: refits of the same fit.
        suspects: scores at it.
    """
    assert taken.suspect is not None
    names = [taken.suspect.name]
    noise = noise_floor(taken.fit).rms ** 2
    missed = max(0.0, taken.fit.rms**2 - noise)
    explained = before.rms**2 - taken.fit.rms**2
    slightly = min(taken.fit.rms**2 + _SLIGHTLY * explained, (_NEARLY * taken.fit.rms) ** 2)
    meant = min(noise + _FORM**2 * missed, (_ALIKE_RMS * taken.fit.rms) ** 2)
    for rung in rungs:
        if rung.suspect is None:
            continue
        even = taken.delta_bic - rung.delta_bic < STRONG
        inexact = missed > _EXACT * noise and rung.fit.rms**2 < meant
        if even or inexact or rung.fit.rms**2 < slightly:
            names.append(rung.suspect.name)
    refitted = {r.suspect.name for r in rungs if r.suspect is not None}
    for suspect in suspects:
        if suspect.name not in refitted and not suspect.wrong_side:
            cosine = abs(float(suspect.direction @ taken.suspect.direction))
            if cosine > 0.995:
                names.append(suspect.name)
    return tuple(dict.fromkeys(names))
