"""Which effect: every absent effect scored at its null, without refitting.

For a gate with derivative S, after what the fitted parameters explain (S_perp):

    gain = (S_perp' r)^2 / (S_perp' S_perp)          sum of squares it would explain
    predicted rms = sqrt((r'r - gain) / N)
    one-step size = S_perp' r / (S_perp' S_perp)

How likely noise alone gives such a gain is asked after its filter (:mod:`following`). The best over
a grid of shapes is taken and paid for: p is multiplied by the number of distinguishable shapes and
of effects looked at.

Sources: Rao (1948), Proc. Cambridge Phil. Soc. 44, 50-57 (score test); Davies (1987), Biometrika
74(1), 33-43 (a parameter present only under the alternative).
"""

from __future__ import annotations

import traceback
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.diagnosis.base_point import BasePoint, Direction
from piezo_opt.diagnosis.colour import Colour
from piezo_opt.diagnosis.following import Whitened
from piezo_opt.diagnosis.richer import on_mechanics, on_spring
from piezo_opt.effects.base import Effect, Place
from piezo_opt.errors import NO_FIT, PiezoOptError
from piezo_opt.identification import Fit
from piezo_opt.stopping import Pool

FloatArray = NDArray[np.float64]


@final
@dataclass(frozen=True, eq=False)
class Suspect:
    """One absent effect and what it would explain.

    Attributes:
        effect: the effect, ready to be added.
        name: its snake_case name.
        score: share of the residual's sum of squares that it would explain, 0..1.
        predicted_rms: error after adding it [m].
        visibility: |S_perp| / |S|: could this record have shown it (0 no, 1 fully).
        overlaps: names it could be mistaken for, with the cosine between their directions.
        p_value: chance of such a score by noise alone, corrected for the search.
        size: one-step value of the gate.
        shapes: best shape values by own name.
        wrong_side: whether a one-sided gate would have to move to its forbidden side.
        direction: S_perp (M,) of the best shapes, of length one.
        base: the fit that it was scored at.
    """

    effect: Effect
    name: str
    score: float
    predicted_rms: float
    visibility: float
    overlaps: tuple[tuple[str, float], ...]
    p_value: float
    size: float
    shapes: dict[str, float]
    wrong_side: bool
    direction: FloatArray
    base: Fit


@final
@dataclass(frozen=True)
class Unscored:
    """An effect that could not be scored, and why."""

    name: str
    why: str


@final
@dataclass(frozen=True, eq=False)
class _Best:
    effect: Effect
    point: BasePoint
    shapes: dict[str, float]
    unit: FloatArray
    visibility: float
    gain: float
    chance: float
    size: float
    wrong_side: bool
    looks: int


def score(
    point: BasePoint,
    candidates: Sequence[Effect],
    threads: int = 2,
    stiff: BasePoint | None = None,
    moving: BasePoint | None = None,
) -> tuple[tuple[Suspect, ...], tuple[Unscored, ...]]:
    """Score candidates at a fit; suspects come likeliest first.

    Args:
        point: the fit.
        candidates: absent effects.
        threads: effects that are scored at a time.
        stiff: beside a quasi-static fit, the same fit on a spring without mass, for forces.
        moving: beside it, one with mechanics, for what else the motion drives.
    """

    whites = {at: Whitened(at) for at in (point, stiff, moving) if at is not None}

    def one(effect: Effect) -> _Best | Unscored:
        channels = tuple(point.question.campaign.records[0].channels)
        at, refusal = point, point.question.model.refusal(effect, channels)
        ground = stiff if effect.place is Place.MOTION else moving
        if refusal is not None and ground is not None:
            at, refusal = ground, ground.question.model.refusal(effect, channels)
        if refusal is not None:
            return Unscored(effect.name, refusal)
        try:
            best = _best(effect, at, whites[at], at.directions(effect))
        except PiezoOptError as error:
            return Unscored(effect.name, str(error))
        except Exception as error:
            return Unscored(effect.name, _where(error, effect))
        return best or Unscored(effect.name, "its sensitivities are not finite on this record.")

    with Pool(max_workers=threads) as pool:
        answers = list(pool.map(one, candidates))
    best = [a for a in answers if isinstance(a, _Best)]
    heard = {b.effect.name for b in best}
    # Of an effect that was scored in one form it does not matter that another has no place here.
    unheard = (a for a in answers if isinstance(a, Unscored) and a.name not in heard)
    unscored = {a.name: a for a in unheard}
    searched = max(1, len(heard))
    names = [b.effect.name for b in best]
    cosines = np.eye(len(best))
    for i, j in combinations(range(len(best)), 2):
        cosines[i, j] = cosines[j, i] = abs(float(best[i].unit @ best[j].unit))
    suspects = []
    for i, b in enumerate(best):
        closest: dict[str, float] = {}
        for name, cosine in zip(names, cosines[i].tolist(), strict=True):
            # Of several forms of an effect the one that is more alike.
            closest[name] = max(cosine, closest.get(name, 0.0))
        del closest[names[i]]
        overlaps = sorted(closest.items(), key=lambda pair: -pair[1])
        gain = 0.0 if b.wrong_side else b.gain
        p = b.chance * b.looks * searched
        own = float(b.point.residual @ b.point.residual)
        suspects.append(
            Suspect(
                effect=b.effect,
                name=names[i],
                score=gain / own if own > 0 else 0.0,
                predicted_rms=point.fit.rms * float(np.sqrt(max(0.0, 1.0 - gain / own)))
                if own
                else 0.0,
                visibility=b.visibility,
                overlaps=tuple((n, round(c, 4)) for n, c in overlaps if c > 0.5),
                p_value=1.0 if b.wrong_side else min(1.0, p),
                size=b.size,
                shapes=b.shapes,
                wrong_side=b.wrong_side,
                direction=b.unit,
                base=b.point.fit,
            )
        )
    suspects.sort(key=lambda s: (-s.score, s.p_value))
    return tuple(suspects), tuple(unscored.values())


def by_name(suspects: Sequence[Suspect]) -> tuple[Suspect, ...]:
    """One suspect a name: the best of an effect's usual forms, of others where it has none here."""
    best: dict[str, Suspect] = {}
    for suspect in sorted(suspects, key=lambda s: (s.effect.rare, -s.score, s.p_value)):
        best.setdefault(suspect.name, suspect)
    return tuple(sorted(best.values(), key=lambda s: (-s.score, s.p_value)))


def _best(
    effect: Effect, point: BasePoint, white: Whitened, directions: Iterable[Direction]
) -> _Best | None:
    """The shapes that explain most, and how many look different; None without any."""
    r = point.residual
    gate = effect.parameters[effect.gate or ""]
    null = gate.null if gate.null is not None else 0.0
    top: _Best | None = None
    hidden: _Best | None = None
    seen: list[FloatArray] = []
    for d in directions:
        power = float(d.projected @ d.projected)
        whole = float(d.whole @ d.whole)
        if power <= 1e-18 * whole or power == 0.0:
            nothing = np.zeros_like(d.projected)
            hidden = hidden or _Best(
                effect, point, dict(d.shapes), nothing, 0.0, 0.0, 1.0, 0.0, False, 1
            )  # fmt: skip
            continue
        along = float(d.projected @ r)
        size = along / power
        wrong = (size < 0 and gate.bounds[0] >= null) or (size > 0 and gate.bounds[1] <= null)
        gain = along**2 / power
        unit = d.projected / np.sqrt(power)
        if all(abs(float(unit @ other)) < 0.95 for other in seen):
            seen.append(unit)
        if top is None or (top.wrong_side, -top.gain) > (wrong, -gain):
            top = _Best(
                effect, point, dict(d.shapes), unit, float(np.sqrt(power / whole)), gain, 1.0,
                size, wrong, 1,
            )  # fmt: skip
    if top is None:
        return hidden
    return replace(top, chance=white.chance(top.unit), looks=len(seen))


def _where(error: Exception, effect: Effect) -> str:
    """An error inside a user's effect, with the line of the effect's own file that led to it."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [
        frame for frame in frames if frame.filename == type(effect).equations.__code__.co_filename
    ]
    at = (own or frames)[-1]
    text = (str(error).splitlines() or [""])[0].rstrip(":. ")
    return f"{at.filename}, line {at.lineno}: {type(error).__name__}: {text}."


def scored(
    fit: Fit, candidates: Sequence[Effect], threads: int, colour: Colour
) -> tuple[tuple[Suspect, ...], tuple[Unscored, ...]]:
    """Scores of all absent candidates.

    At a quasi-static fit forces are scored on a spring without mass, and what else needs motion
    with the mechanics that the fit may have left out.
    """
    absent = [e for e in candidates if e.name not in fit.model]
    stiff = moving = None
    if fit.model.quasi_static:
        stiff = on_spring(fit)
        if any("motion" in e.requires and e.place is not Place.MOTION for e in absent):
            moving = on_mechanics(fit)
    grounds = [None if ground is None else _point(ground, colour) for ground in (stiff, moving)]
    return score(BasePoint(fit, colour=colour), absent, threads, *grounds)


def _point(fit: Fit, colour: Colour) -> BasePoint | None:
    """The point of a fit; None where it cannot be simulated again, at the edge of stability."""
    try:
        point = BasePoint(fit, colour=colour)
        return point if point.substeps else None
    except NO_FIT:
        return None


def at_foot(
    fit: Fit, candidates: Sequence[Effect], threads: int
) -> tuple[tuple[Suspect, ...], tuple[Unscored, ...]]:
    """Scores at a fit alone, with its noise taken as white."""
    left = [e for e in candidates if e.name not in fit.model]
    return score(BasePoint(fit), left, threads)
