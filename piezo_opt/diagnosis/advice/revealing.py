"""Which drives show the effects that the fitted records hid.

An effect shows with ``|phi S_perp| / noise`` sigmas: phi its size, S_perp what the fitted
parameters leave of the derivative by its gate.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from piezo_opt.diagnosis.advice.candidates import offered_drives
from piezo_opt.diagnosis.advice.experiment import SEEN, Advice, Trial, check_noise
from piezo_opt.diagnosis.advice.members import Member, typical
from piezo_opt.diagnosis.advice.played import judged
from piezo_opt.diagnosis.advice.words import reveal_sentence
from piezo_opt.diagnosis.base_point import BasePoint
from piezo_opt.diagnosis.drives import Excitation
from piezo_opt.effects.base import Effect
from piezo_opt.identification import Fit

_DRIVES: Final = 3
"""Experiments that are advised at most for effects that the record could not show."""


def reveal(
    fit: Fit,
    effects: Sequence[Effect],
    noise: float,
    *,
    drives: Sequence[Excitation] | None = None,
    duration: float | None = None,
    threads: int = 2,
) -> tuple[tuple[Advice, ...], tuple[str, ...]]:
    """Which few drives would show the effects that the fitted records could not have shown.

    An effect counts as not shown when, at the middle of its typical range, what the fitted
    parameters leave of it stays below five sigmas of the noise. Drives are taken greedily, each
    the one that shows most of what is left.

    Args:
        fit: the final fit.
        effects: absent effects; those that the model cannot take are passed over.
        noise: root mean square of the reading's noise [m], as that of independent samples.
        drives, duration, threads: as for :func:`advise`.

    Returns:
        the experiments, and the names that no candidate drive would show.

    Raises:
        InputError: the noise is not positive.
    """
    check_noise(noise)
    here = BasePoint(fit, sharp=True)
    hidden: list[tuple[Member, float]] = []
    for member in typical(here, effects):
        seen = _visible(here, member)
        if seen is not None and seen / noise < SEEN:
            hidden.append((member, seen / noise))
    if not hidden:
        return (), ()

    def sigmas_of(point: BasePoint) -> dict[str, float]:
        seen = {m.effect.name: _visible(point, m) for m, _ in hidden}
        return {name: (s or 0.0) / noise for name, s in seen.items()}

    told = judged(fit, offered_drives(fit, drives, duration), sigmas_of, threads)
    left = {m.effect.name: (m, now) for m, now in hidden}
    advices: list[Advice] = []
    while left and told and len(advices) < _DRIVES:
        trials = []
        for drive, sigmas in told:
            shown = [n for n in left if sigmas[n] >= SEEN]
            # Among drives that show as many, the one whose faintest stands out most.
            faintest = min(shown, key=lambda n: sigmas[n], default="")
            trials.append((len(shown), sigmas.get(faintest, 0.0), drive, shown, faintest, sigmas))
        trials.sort(key=lambda t: (-t[0], -t[1]))
        count, faint, drive, shown, faintest, sigmas = trials[0]
        if count == 0:
            break
        detectable = {n: SEEN * abs(left[n][0].size) / sigmas[n] for n in shown}
        advices.append(
            Advice(
                group=tuple(shown),
                drive=drive,
                rate=fit.records[0].rate,
                sigmas=faint,
                here=max(left[n][1] for n in shown),
                detectable=detectable,
                assumed={n: left[n][0].assumed() for n in shown},
                trials=tuple(Trial(t[2], t[1], (t[4],) if t[4] else ()) for t in trials),
                sentence=reveal_sentence(drive, [left[n][0].effect for n in shown], detectable),
            )
        )
        for name in shown:
            del left[name]
    return tuple(advices), tuple(left)


def _visible(point: BasePoint, member: Member) -> float | None:
    """What is left of a member after the base parameters have explained their share [m]."""
    try:
        found = point.directions(member.effect, [member.shapes])
    except Exception:
        # A user's effect may raise whatever it likes; the scores have reported it.
        return None
    if not found or np.linalg.norm(found[0].projected) <= 1e-7 * np.linalg.norm(found[0].whole):
        return 0.0 if found else None
    return abs(member.size) * float(np.linalg.norm(found[0].projected))
