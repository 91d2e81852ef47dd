"""A picture as a value: panels, axes, traces, units and colours; who draws it is another matter."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final, final

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_PREFIXES: Final = {-15: "f", -12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
_NEVER: Final = frozenset({"1", "s", "rad", "K", "kg"})


class Tone(Enum):
    """A colour by its name; on dark paper it is another one, and so is ink.

    Source: Okabe & Ito (2008), Color Universal Design.
    """

    INK = "ink"
    VERMILLION = "vermillion"
    BLUE = "blue"
    GREEN = "green"
    PINK = "pink"
    YELLOW = "yellow"
    SKY = "sky"


MODELS: Final = (Tone.VERMILLION, Tone.BLUE, Tone.GREEN, Tone.PINK, Tone.YELLOW, Tone.SKY)
"""Of models side by side, in the order given; measurements are ink."""


class Style(Enum):
    """How a trace is drawn."""

    LINE = "line"
    MARKED = "marked"
    """A line with its points."""
    CLOUD = "cloud"
    """Points alone, in any order."""
    BAND = "band"
    """What lies between two curves."""


@final
@dataclass(frozen=True)
class Axis:
    """One axis.

    Attributes:
        name: what it shows.
        unit: of its numbers, "1" for plain ones.
        logarithmic: whether it is.
        factor: its numbers are so many times those in SI units.
    """

    name: str
    unit: str
    logarithmic: bool = False
    factor: float = 1.0

    @property
    def label(self) -> str:
        """``"error [µm]"``; no brackets for a plain number."""
        return self.name if self.unit == "1" else f"{self.name} [{self.unit}]"


@final
@dataclass(frozen=True, eq=False)
class Trace:
    """One curve, in the units of its panel's axes; NaN where there is none.

    Attributes:
        label: what a legend calls it; empty for what another trace of its colour says.
        x, y: (N,) points, in the order in which they are joined.
        tone: its colour.
        style: how it is drawn.
        high: (N,) the upper curve of a band.
    """

    label: str
    x: FloatArray
    y: FloatArray
    tone: Tone
    style: Style = Style.LINE
    high: FloatArray | None = None


@final
@dataclass(frozen=True, eq=False)
class Panel:
    """Traces over one pair of axes.

    Attributes:
        title: what it shows, or nothing.
        across, up: abscissa and ordinate.
        traces: what is drawn, the first one lowest.
        zero: whether the line of zero is drawn.
        limits: of the ordinate; None for those of the traces. An upper limit of NaN is theirs.
        level: a height that is marked, and what it says.
        shaded: a stretch of the abscissa that is set apart, and why.
    """

    title: str
    across: Axis
    up: Axis
    traces: tuple[Trace, ...]
    zero: bool = False
    limits: tuple[float, float] | None = None
    level: tuple[float, str] | None = None
    shaded: tuple[float, float, str] | None = None


@final
@dataclass(frozen=True, eq=False)
class Picture:
    """Panels that belong together.

    Attributes:
        panels: from above to below with one abscissa, or from left to right with one ordinate.
        beside: whether they stand side by side.
    """

    panels: tuple[Panel, ...]
    beside: bool = False


def prefixed(unit: str, *values: FloatArray) -> tuple[float, str]:
    """Factor and unit that bring the largest of these SI values between 1 and 1000.

    ``prefixed("m", array([2e-6]))`` gives ``(1e6, "µm")``.
    """
    # Two passes without a copy: a million samples are asked for at every zoom.
    largest = max(
        (
            max(float(np.fmax.reduce(v, axis=None)), -float(np.fmin.reduce(v, axis=None)))
            for v in values
            if v.size
        ),
        default=0.0,
    )
    if unit in _NEVER or not 0.0 < largest < math.inf or not unit[:1].isalpha():
        return 1.0, unit
    exponent = 3 * math.floor(math.log10(largest) / 3 + 1e-9)
    exponent = min(max(exponent, -15), 9)
    if unit.startswith("V") and -1.0 <= math.log10(largest) < 3.0:
        exponent = 0  # nobody speaks of 500 mV next to 100 V
    return 10.0**-exponent, f"{_PREFIXES[exponent]}{unit}"


def clock(time: FloatArray) -> tuple[float, str]:
    """Factor and unit in which a stretch of time [s] has readable numbers."""
    span = float(time[-1] - time[0])
    if span < 1e-3:
        return 1e6, "µs"
    return (1e3, "ms") if span < 1.0 else (1.0, "s")


def plain(picture: Picture) -> dict[str, Any]:
    """A picture for a page: plain data and arrays, each rounded to what can be seen.

    Where all traces of a panel have one rising abscissa it comes once, as the panel's ``x``.
    """
    return {"beside": picture.beside, "panels": [_panel(one) for one in picture.panels]}


def _panel(panel: Panel) -> dict[str, Any]:
    one = panel.traces[0].x if panel.traces else np.zeros(0)
    shared = all(trace.x is one for trace in panel.traces) and bool(np.all(np.diff(one) >= 0.0))
    return {
        "title": panel.title,
        "across": _axis(panel.across),
        "up": _axis(panel.up),
        "zero": panel.zero,
        "limits": panel.limits,
        "level": panel.level,
        "shaded": panel.shaded,
        "x": _rounded(one, 9) if shared else None,
        "traces": [
            {
                "label": trace.label,
                "x": None if shared else _rounded(trace.x, 9),
                "y": _rounded(trace.y, 6),
                "high": None if trace.high is None else _rounded(trace.high, 6),
                "tone": trace.tone.value,
                "style": trace.style.value,
            }
            for trace in panel.traces
        ],
    }


def _axis(axis: Axis) -> dict[str, Any]:
    return {"label": axis.label, "logarithmic": axis.logarithmic, "factor": axis.factor}


def _rounded(signal: FloatArray, digits: int) -> FloatArray:
    """Numbers with so many digits of the largest one: more would only be sent, not seen."""
    most = float(np.nanmax(np.abs(signal), initial=0.0))
    return signal if most == 0.0 else np.round(signal, digits - 1 - math.floor(math.log10(most)))
