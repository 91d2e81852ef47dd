"""What the commands share that tune a controller in its loop: a goal, and the way to the answer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias, final

from piezo_opt.cli.declare import Option
from piezo_opt.cli.limiting import leave_early, limit_of, limited
from piezo_opt.cli.telling import telling
from piezo_opt.cli.tuning import Loop, Reference, Result, asked, described

if TYPE_CHECKING:
    from piezo_opt.control import Tuned


class Goal(Enum):
    """What is made small."""

    IAE, ISE, ITAE = "iae", "ise", "itae"


@final
@dataclass(frozen=True)
class Aim:
    """What is made small, and what bounds it."""

    criterion: Annotated[
        Goal, Option(help="Integral of |e|, of e^2, or of t |e|, to be made small.")
    ] = Goal.IAE
    effort: Annotated[float, Option(min=0.0, metavar="W", help="Weight of the drive's moves.")] = (
        0.0
    )
    overshoot: Annotated[
        float | None,
        Option(min=0.0, metavar="0.02", help="Largest overshoot, as a share of the step."),
    ] = None


Peak: TypeAlias = Annotated[
    float, Option(min=1.05, metavar="2", help="Highest sensitivity: less is more robust.")
]


def tuned_loop(
    name: str, design: Callable[..., Tuned[Any]], fit: Path, reference: Reference, loop: Loop,
    result: Result, aim: Aim, peak: float,
) -> None:  # fmt: skip
    """Tune a controller, say what it is, and write what was asked for."""
    from piezo_opt.report.control import loops

    limit = limit_of(result.max_time)
    result.check(fit, reference.reference)
    what = asked(fit, reference, loop)
    with telling(name) as tell, limited(limit):
        found = design(
            what.actuator, what.reference, period=what.period, limits=what.limits,
            delay=loop.delay, noise=what.noise, criterion=aim.criterion.value, effort=aim.effort,
            overshoot=aim.overshoot, peak=peak, scenarios=loop.scenarios, seed=loop.seed,
            progress=tell,
        )  # fmt: skip
    result.deliver(
        f"For {what.told}:\n{found}", {**found.to_dict(), **described(what, fit)},
        lambda: loops(found.loops, name, what.limits),
    )  # fmt: skip
    leave_early(found.interrupted, limit)
