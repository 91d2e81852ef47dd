"""An experiment in a sentence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from piezo_opt.diagnosis.advice.experiment import SEEN, Trial
from piezo_opt.diagnosis.advice.gate import gate_of
from piezo_opt.diagnosis.drives import Excitation
from piezo_opt.effects.base import Effect
from piezo_opt.units import show


def split_sentence(names: Sequence[str], best: Trial, now: float) -> str:
    """What the best drive would tell apart, by how many sigmas, and by how many it is now."""
    drive = best.drive.description
    if best.sigmas < SEEN and best.sigmas <= now:
        return (
            f"No candidate drive tells {_listed(names)} apart better than this record, by "
            f"{_sigmas(now)} sigmas: record longer, or with less noise."
        )
    least = "" if len(names) == 2 else " (the two most alike)"
    faint = "" if best.sigmas >= SEEN else " It takes a longer record, or less noise, to be sure."
    return (
        f"Play a {drive}: it separates {_listed(names)} by {_sigmas(best.sigmas)} sigmas{least}; "
        f"this record separates them by {_sigmas(now)}.{faint}"
    )


def reveal_sentence(
    drive: Excitation, effects: Sequence[Effect], detectable: Mapping[str, float]
) -> str:
    """What a drive would show that the fitted records hid, and from which size [SI] on."""
    sizes = [
        f"{e.name} from {e.gate} = {show(detectable[e.name], gate_of(e).unit)}" for e in effects
    ]
    return (
        f"This record could not show {_listed([e.name for e in effects])} of a usual size: a "
        f"{drive.description} would ({'; '.join(sizes)})."
    )


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _sigmas(number: float) -> str:
    return f"{number:.1f}" if number < 10.0 else f"{min(number, 1e6):.0f}"
