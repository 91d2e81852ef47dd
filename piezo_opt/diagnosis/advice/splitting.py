"""Which drive tells effects alike apart."""

from __future__ import annotations

from collections.abc import Sequence

from piezo_opt.diagnosis.advice.candidates import offered_drives
from piezo_opt.diagnosis.advice.experiment import Advice, Trial, check_noise
from piezo_opt.diagnosis.advice.members import sized
from piezo_opt.diagnosis.advice.played import judged
from piezo_opt.diagnosis.advice.separation import separation
from piezo_opt.diagnosis.advice.words import split_sentence
from piezo_opt.diagnosis.base_point import BasePoint
from piezo_opt.diagnosis.drives import Excitation
from piezo_opt.effects.base import Effect
from piezo_opt.errors import InputError
from piezo_opt.identification import Fit


def advise(
    fit: Fit,
    group: Sequence[Effect],
    noise: float,
    *,
    drives: Sequence[Excitation] | None = None,
    duration: float | None = None,
    threads: int = 2,
) -> Advice:
    """Which drive tells the effects of a group apart.

    Args:
        fit: the fit *without* the effects; sizes and shapes are those of their scores at it.
        group: two or more absent effects; variants of one name stand for each other.
        noise: root mean square of the reading's noise [m], as that of independent samples.
        drives: candidates; :func:`candidate_drives` of the first record unless given.
        duration: of each candidate [s]; that of the first record unless given.
        threads: drives that are judged at a time.

    Raises:
        InputError: fewer than two effects, a noise that is not positive, or no drive on which the
            model can be simulated.
        ModelError: the model cannot take an effect.
    """
    names = tuple(dict.fromkeys(e.name for e in group))
    if len(names) < 2:
        raise InputError(f"Nothing to tell apart in ({', '.join(names)}): name two effects.")
    check_noise(noise)
    here = BasePoint(fit, sharp=True)
    members = sized(here, group)
    offered = offered_drives(fit, drives, duration)
    told = judged(fit, offered, lambda point: separation(point, members), threads)
    if not told:
        raise InputError("No candidate drive can be simulated with the fitted model.")
    found = (Trial(drive, apart / noise, pair) for drive, (apart, pair) in told)
    trials = tuple(sorted(found, key=lambda t: -t.sigmas))
    best = trials[0]
    own = separation(here, members)
    now = 0.0 if own is None else own[0] / noise
    return Advice(
        group=names,
        drive=best.drive,
        rate=fit.records[0].rate,
        sigmas=best.sigmas,
        here=now,
        detectable={},
        assumed={m.effect.name: m.assumed() for m in reversed(members)},
        trials=trials,
        sentence=split_sentence(names, best, now),
    )
