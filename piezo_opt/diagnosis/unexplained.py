"""What no effect explains, in a sentence: where it enters, of what it is a function, a formula."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.diagnosis.entering import Entering, Quantity
from piezo_opt.diagnosis.forces import Force, beyond, forces
from piezo_opt.diagnosis.formula import Formula
from piezo_opt.diagnosis.noise import NoiseFloor, repetition
from piezo_opt.diagnosis.propose import propose
from piezo_opt.effects.base import Place
from piezo_opt.identification import Fit


@final
@dataclass(frozen=True, eq=False)
class Unexplained:
    """What is left after every effect of the catalogue.

    Attributes:
        place: where the correction most likely enters.
        places: every place that describes it as well, that one included.
        against: the signal of which the correction is a function; None where it is a function of
            none (an input that nobody recorded, single events).
        share: of what the noise does not explain, the part that this function explains on
            stretches left out, 0..1; 0 where there is none.
        formula: a proposed law, None where none is worth its price.
        forces: the smallest correction of every place, likeliest place first.
    """

    place: Place
    places: tuple[Place, ...]
    against: str | None
    share: float
    formula: Formula | None
    forces: tuple[Force, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "place": self.place.name.lower(),
            "places": [p.name.lower() for p in self.places],
            "against": self.against,
            "share": self.share,
            "formula": None if self.formula is None else str(self.formula),
            "formula_share": None if self.formula is None else self.formula.share,
            "forces": [
                {"place": f.place.name.lower(), "rms": f.rms, "unit": f.place.unit,
                 "relative": f.relative, "share": f.share, "described": f.described}
                for f in self.forces
            ],
        }  # fmt: skip

    def __str__(self) -> str:
        if self.against is None:
            return (
                f"The smallest correction enters the {self.place.value}, but it is a function of "
                "no signal of the chain: look for an input that was not recorded, or for single "
                "events."
            )
        others = [p.value for p in self.places if p is not self.place]
        also = f" (or the {' or the '.join(others)}: this record cannot tell)" if others else ""
        text = (
            f"What is left enters the {self.place.value}{also} as a function of {self.against}, "
            f"which explains {100 * self.share:.0f} % of it."
        )
        if self.formula is None:
            return text
        rivals = f" Nearly as good: {', '.join(self.formula.rivals)}." * bool(self.formula.rivals)
        return (
            f"{text} Proposed: {self.formula} ({100 * self.formula.share:.0f} %); add it with "
            f"model + formula.as_effect() and fit again.{rivals}"
        )


def unexplained(fit: Fit, noise: NoiseFloor, threads: int = 1) -> Unexplained | None:
    """Where and of what the residual of a fit is a function; None where it is but noise.

    Args:
        fit: the fit after which structure is left.
        noise: its noise floor.
        threads: places that are asked at a time.
    """
    chain = Entering(fit)
    if beyond(chain.residual, noise) == 0.0:
        return None
    found = forces(fit, noise, entering=chain, threads=threads)
    first = found[0]
    # Functions of a signal have too few knots to follow what repeats along the position.
    length = repetition(fit)
    if length is not None:
        wave = propose(chain, Place.OUTPUT, noise, length)
        if wave is not None and wave.share > first.described:
            along = Quantity.POSITION.value
            return Unexplained(Place.OUTPUT, (Place.OUTPUT,), along, wave.share, wave, found)
    places = tuple(force.place for force in found if force.likely)
    if not places:
        return Unexplained(first.place, (first.place,), None, 0.0, None, found)
    formula = propose(chain, first.place, noise)
    return Unexplained(first.place, places, str(first.against[0]), first.described, formula, found)
