"""How pictures look: colours that everybody can tell apart, units with sensible prefixes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from piezo_opt.measurement import FloatArray

BLACK: Final = "#000000"
ORANGE: Final = "#E69F00"
SKY: Final = "#56B4E9"
GREEN: Final = "#009E73"
BLUE: Final = "#0072B2"
VERMILLION: Final = "#D55E00"
PURPLE: Final = "#CC79A7"
GREY: Final = "#8A8F98"
"""Okabe & Ito (2008), Color Universal Design; grey for what is only there to compare with."""

MODELS: Final = (VERMILLION, BLUE, GREEN, PURPLE, ORANGE, SKY)
"""Colours of models side by side, in the order given; measurements are black."""
MODEL_COLOURS: Final = ("Orange", "Blue", "Green", "Pink", "Yellow", "Light blue")
"""What a reader calls them."""

MOST_POINTS: Final = 6000
"""Points of one line beyond which only an envelope is drawn: more would not be seen."""

_PREFIXES: Final = {-15: "f", -12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
_NEVER: Final = frozenset({"1", "s", "rad", "K", "kg"})
_SETTINGS: Final[dict[Any, Any]] = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 9.5,
    "axes.titlesize": 10.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    # Where a title stands anyway; without it each is measured against its axes' labels.
    "axes.titley": 1.0,
    "axes.labelsize": 9.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#555b66",
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "grid.color": "#e3e6ea",
    "grid.linewidth": 0.7,
    "xtick.color": "#333842",
    "ytick.color": "#333842",
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "legend.fontsize": 8.5,
    "legend.frameon": True,
    "legend.framealpha": 0.85,
    "legend.edgecolor": "none",
    "figure.facecolor": "white",
    "axes.facecolor": "white",
    "savefig.facecolor": "white",
    "lines.linewidth": 1.3,
    "path.simplify": True,
}


@contextmanager
def styled() -> Iterator[None]:
    """The package's look while a figure is made or saved; the user's settings come back after."""
    with mpl.rc_context(_SETTINGS):
        yield


def figure(
    rows: int = 1,
    columns: int = 1,
    *,
    width: float = 7.2,
    height: float = 3.4,
    sharex: bool = False,
    heights: tuple[float, ...] | None = None,
) -> tuple[Figure, list[Axes]]:
    """A figure of its own, without any state that others share, and its axes in reading order."""
    made = Figure(figsize=(width, height), layout="tight")
    grid = made.subplots(
        rows,
        columns,
        squeeze=False,
        sharex="col" if sharex else False,
        gridspec_kw=None if heights is None else {"height_ratios": list(heights)},
    )
    return made, list(grid.ravel())


def prefixed(unit: str, *values: FloatArray) -> tuple[float, str]:
    """Factor and unit that bring the largest of these SI values between 1 and 1000.

    ``prefixed("m", array([2e-6]))`` gives ``(1e6, "µm")``.
    """
    largest = max((float(np.nanmax(np.abs(v))) for v in values if np.isfinite(v).any()), default=0)
    if unit in _NEVER or largest == 0.0 or not unit[:1].isalpha():
        return 1.0, unit
    exponent = 3 * math.floor(math.log10(largest) / 3 + 1e-9)
    exponent = min(max(exponent, -15), 9)
    if unit.startswith("V") and -1.0 <= math.log10(largest) < 3.0:
        exponent = 0  # nobody speaks of 500 mV next to 100 V
    return 10.0**-exponent, f"{_PREFIXES[exponent]}{unit}"


def plain_log_ticks(axis: Axis) -> None:
    """Numbers as people write them on a logarithmic axis: 0.1, 1, 10 instead of powers."""
    low, high = axis.get_view_interval()
    decades = math.log10(high / low)
    axis.set_major_formatter(
        FuncFormatter(lambda x, _: f"{x:g}" if 1e-3 <= x < 1e5 else f"{x:.0e}")
    )
    if decades < 2.0:
        axis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
        axis.set_minor_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    else:
        axis.set_minor_formatter(NullFormatter())


def labelled(name: str, unit: str) -> str:
    """An axis' label: ``"error [µm]"``; no brackets for a plain number."""
    return name if unit == "1" else f"{name} [{unit}]"


def thinned(most: int, *signals: FloatArray) -> tuple[FloatArray, ...]:
    """Signals of one length drawn with at most ``most`` points.

    A window of samples is replaced by those at which the *last* signal is smallest and largest,
    so that no peak is lost; short signals come back as they are.
    """
    count = signals[-1].size
    if count <= most:
        return signals
    width = -(-2 * count // most)
    whole = count // width
    windows, rest = np.split(signals[-1], [whole * width])
    windows = windows.reshape(whole, width)
    first = np.arange(whole) * width
    kept = [first + windows.argmin(axis=1), first + windows.argmax(axis=1), [0, count - 1]]
    if rest.size:
        kept.append(whole * width + np.array([rest.argmin(), rest.argmax()]))
    places = np.unique(np.concatenate(kept))
    return tuple(np.asarray(signal[places]) for signal in signals)
