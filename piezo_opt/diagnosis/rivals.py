"""Is it the wrong hysteresis? Rival laws in the place of the model's own, refitted and compared.

A rival is no missing effect: it replaces the law and is judged like one rung of the ladder, by
BIC on the same effective samples and by held-out data.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import final

import numpy as np

from piezo_opt.diagnosis.held_out import HeldOut, agrees, elsewhere, rms
from piezo_opt.diagnosis.rung import STRONG, bic_gain
from piezo_opt.diagnosis.scores import effective_samples
from piezo_opt.diagnosis.stopping import Pool
from piezo_opt.effects.base import Effect
from piezo_opt.errors import PiezoOptError
from piezo_opt.identification import Fit, LevenbergMarquardt, SingleShooting, solve
from piezo_opt.units import show


@final
@dataclass(frozen=True)
class Rival:
    """A hysteresis law in the place of the model's own.

    Attributes:
        name: the law.
        rms: error of the refit [m].
        held_out: error on the held-out record [m], None without one.
        delta_bic: by how much BIC falls (negative: the model's own law is better).
        better: strong evidence for the rival, and the held-out data agree.
        without: effects that had been added and that the rival does without.
    """

    name: str
    rms: float
    held_out: float | None
    delta_bic: float
    better: bool
    without: tuple[str, ...] = ()

    @property
    def less(self) -> str:
        """What it does without, in words that follow a sentence; none where that is nothing."""
        return f", without {' and '.join(self.without)}" if self.without else ""

    def __str__(self) -> str:
        against = "fits better than" if self.better else "is no better than"
        return f"{self.name} {against} the model's own law{self.less} (rms {show(self.rms, 'm')})."


def rivals(
    fit: Fit, foot: Fit, held: HeldOut, laws: Sequence[type[Effect]], threads: int = 2
) -> tuple[Rival, ...]:
    """Refit with each law in the place of the model's own, best first.

    Beside what was found, and in its place: a force that was named may be what a loop of the wrong
    law leaves.

    Args:
        fit: a fit of ``held.question`` or a richer one; without a hysteresis law there is nothing
            to replace.
        foot: the fit before anything was added.
        held: what decides beside BIC.
        laws: hysteresis laws to try; those that the model's other effects cannot work with are
            left out.
        threads: refits that run at a time.
    """
    own = fit.model.loop
    if own is None:
        return ()
    before = elsewhere(fit, held)
    bases = [fit] if foot.model == fit.model or foot.model.loop != own else [fit, foot]

    def one(law: type[Effect]) -> Rival | None:
        found = [r for base in bases for r in _refits(base, own, law())]
        if not found:
            return None
        n = effective_samples(min(found, key=lambda r: r.rms).residuals)
        refitted = max(found, key=lambda r: bic_gain(fit, r, n))
        after = elsewhere(refitted, held)
        gain = bic_gain(fit, refitted)
        return Rival(
            law().name,
            refitted.rms,
            rms(after),
            gain,
            gain > STRONG and refitted.rms < 0.98 * fit.rms and agrees(before, after),
            tuple(n for n, e in fit.model if not e.structural and n not in refitted.model),
        )

    others = [law for law in laws if law().name != own]
    with Pool(max_workers=threads) as pool:
        compared = [r for r in pool.map(one, others) if r is not None]
    return tuple(sorted(compared, key=lambda r: r.rms))


def _refits(base: Fit, own: str, law: Effect) -> list[Fit]:
    """A fit with a law in the place of its own, from starts of several widths."""
    kept = {k: v for k, v in base.values.items() if not k.startswith("initial.")}
    found = []
    for widths in _widths(law, base):
        with suppress(PiezoOptError, ArithmeticError):
            question = base.question.with_model(base.model.replaced(own, law))
            found.append(
                solve(
                    question,
                    start={**kept, **widths},
                    solver=LevenbergMarquardt(iterations=60, tolerance=1e-6),
                    transcription=SingleShooting(refine=False),
                    statistics=False,
                )
            )
    return found


def in_words(compared: Sequence[Rival]) -> tuple[str, ...]:
    """Each law that is better, else that none is; nothing where none was tried."""
    better = tuple(str(r) for r in compared if r.better)
    if better or len(compared) < 2:
        return better or tuple(map(str, compared))
    *some, last = (r.name for r in compared)
    return (f"None of {', '.join(some)} and {last} fits better than the model's own law.",)


def _widths(law: Effect, fit: Fit) -> list[dict[str, float]]:
    """Starts for thresholds in volts: shares of the drive's range; one empty start without any."""
    swing = max(float(np.ptp(record.drive)) for record in fit.records)
    thresholds = [
        f"{law.name}.{name}"
        for name, p in law.parameters.items()
        if p.unit == "V" and p.bounds[0] > 0 and not p.fixed
    ]
    if not thresholds:
        return [{}]
    return [dict.fromkeys(thresholds, share * swing) for share in (0.15, 0.4, 0.8)]
