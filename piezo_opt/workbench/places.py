"""Where the residual of a fit lives, as curves for a screen: one small picture for each view."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.errors import InputError

if TYPE_CHECKING:  # records are shown before the solvers are loaded
    from piezo_opt.comparison.where import Where

FloatArray = NDArray[np.float64]

MOST: Final = 600
"""Points of one curve: a picture is half as wide as the page."""


@final
@dataclass(frozen=True, eq=False)
class Curve:
    """One curve of a picture: its name, and a value for each abscissa; NaN where there is none."""

    label: str
    values: FloatArray


@final
@dataclass(frozen=True, eq=False)
class Picture:
    """Curves over one quantity.

    Attributes:
        across: what the abscissa is.
        unit: its unit.
        x: (N,) abscissas, rising.
        up: what the ordinate is.
        up_unit: its unit.
        curves: what is drawn over x.
        logarithmic: whether both axes are ("both"), the abscissa alone ("x") or none ("").
    """

    across: str
    unit: str
    x: FloatArray
    up: str
    up_unit: str
    curves: tuple[Curve, ...]
    logarithmic: str = ""


def pictures(found: Where, drive_unit: str) -> dict[str, Picture]:
    """The views in which a residual can be looked at, by name.

    Args:
        found: where it lives; a view that the record has no data for has no picture.
        drive_unit: of the drive.
    """
    branch, spectrum = found.by_branch, found.by_frequency
    swing, events, time = found.by_amplitude, found.after_events, found.over_time
    made = {
        "branch": Picture(
            "drive", drive_unit, _middles(branch.edges), "mean residual", "m",
            (Curve("rising", branch.loading_mean), Curve("falling", branch.unloading_mean)),
        ),
        "amplitude": Picture(
            "swing of the half cycle", drive_unit, swing.swing, "rms residual", "m",
            (Curve("residual", swing.rms),),
        ),
        "time": Picture(
            "time", "s", _middles(time.edges), "rms residual", "m", (Curve("residual", time.rms),)
        ),
    }  # fmt: skip
    if spectrum.frequency.size > 2:
        above = spectrum.frequency > 0.0
        x, (reading, left) = _thinned(
            spectrum.frequency[above], [spectrum.reading[above], spectrum.error[above]]
        )
        made["frequency"] = Picture(
            "frequency", "Hz", x, "amplitude density", "m/sqrt(Hz)",
            (Curve("reading", np.sqrt(reading)), Curve("residual", np.sqrt(left))), "both",
        )  # fmt: skip
    if events.since.size:
        made["events"] = Picture(
            f"time since the last {events.kind}", "s", events.since, "mean residual", "m",
            (
                Curve("residual", events.mean),
                Curve("+ 2 standard errors", events.mean + 2.0 * events.uncertainty),
                Curve("- 2 standard errors", events.mean - 2.0 * events.uncertainty),
            ),
            "x",
        )  # fmt: skip
    return made


def picture(made: dict[str, Picture], name: str) -> Picture:
    """One of the pictures.

    Raises:
        InputError: there is none of that name.
    """
    if name not in made:
        raise InputError(f"This record has no picture by {name!r}: there is {', '.join(made)}.")
    return made[name]


def _middles(edges: FloatArray) -> FloatArray:
    return np.asarray(0.5 * (edges[:-1] + edges[1:]))


def _thinned(
    x: FloatArray, densities: list[FloatArray], most: int = MOST
) -> tuple[FloatArray, list[FloatArray]]:
    """Power densities averaged over bands of equal width on a logarithmic axis.

    The mean of a band is what all of its lines carry together; no line gets lost.
    """
    if x.size <= most:
        return x, densities
    edges = np.geomspace(x[0], x[-1], most + 1)
    which = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, most - 1)
    count = np.bincount(which, minlength=most)
    held = count > 0
    return (
        np.bincount(which, x, minlength=most)[held] / count[held],
        [np.bincount(which, one, minlength=most)[held] / count[held] for one in densities],
    )
