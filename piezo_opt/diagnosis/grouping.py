"""Which effects the record cannot tell from the one that is named."""

from __future__ import annotations

from collections.abc import Sequence

from piezo_opt.diagnosis.noise import noise_floor
from piezo_opt.diagnosis.rung import STRONG, Rung
from piezo_opt.diagnosis.scores import Suspect

_FORM = 2.0
"""Misfit beyond the noise over the best effect's own up to which a rival may be meant."""
_ALIKE_RMS = 1.2
"""The same for the whole error: slow noise makes the misfit look larger than it is."""
_EXACT = 0.08
"""Misfit over the noise (squares) up to which a form counts as exact."""


def group_of(taken: Rung, rungs: Sequence[Rung], suspects: Sequence[Suspect]) -> tuple[str, ...]:
    """Effects that the record cannot tell from the taken one, itself first.

    Refitted rivals within strong evidence of the best, and directions nearly parallel to it. Where
    the best itself leaves more than noise, its form is not the true one, and a rival that misses by
    less than twice as much may be meant as well.
    """
    assert taken.suspect is not None
    names = [taken.suspect.name]
    noise = noise_floor(taken.fit).rms ** 2
    missed = max(0.0, taken.fit.rms**2 - noise)
    meant = min(noise + _FORM**2 * missed, (_ALIKE_RMS * taken.fit.rms) ** 2)
    for rung in rungs:
        if rung.suspect is None:
            continue
        even = taken.delta_bic - rung.delta_bic < STRONG
        if even or (missed > _EXACT * noise and rung.fit.rms**2 < meant):
            names.append(rung.suspect.name)
    refitted = {r.suspect.name for r in rungs if r.suspect is not None}
    for suspect in suspects:
        if suspect.name not in refitted and not suspect.wrong_side:
            cosine = abs(float(suspect.direction @ taken.suspect.direction))
            if cosine > 0.995:
                names.append(suspect.name)
    return tuple(dict.fromkeys(names))
