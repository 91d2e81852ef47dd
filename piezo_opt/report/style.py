"""How pictures look: colours that everybody can tell apart, units with sensible prefixes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from piezo_opt.measurement import FloatArray
from piezo_opt.pictures.picture import MODELS as TONES
from piezo_opt.pictures.picture import Tone
from piezo_opt.pictures.thinning import outline

BLACK: Final = "#000000"
ORANGE: Final = "#E69F00"
SKY: Final = "#56B4E9"
GREEN: Final = "#009E73"
BLUE: Final = "#0072B2"
VERMILLION: Final = "#D55E00"
PURPLE: Final = "#CC79A7"
GREY: Final = "#8A8F98"
"""Okabe & Ito (2008), Color Universal Design; grey for what is only there to compare with."""

COLOURS: Final = {
    Tone.INK: BLACK, Tone.VERMILLION: VERMILLION, Tone.BLUE: BLUE, Tone.GREEN: GREEN,
    Tone.PINK: PURPLE, Tone.YELLOW: ORANGE, Tone.SKY: SKY,
}  # fmt: skip
"""Tones on white paper."""
MODELS: Final = tuple(COLOURS[tone] for tone in TONES)
"""Colours of models side by side, in the order given; measurements are black."""
MODEL_COLOURS: Final = ("Orange", "Blue", "Green", "Pink", "Yellow", "Light blue")
"""What a reader calls them."""

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


def thinned(*signals: FloatArray) -> tuple[FloatArray, ...]:
    """Signals of one length with as many points as a picture can show.

    They are those at which the *last* signal is smallest and largest in its stretch of samples,
    so that no peak is lost; short signals come back as they are.
    """
    kept = outline([signals[-1]])
    return tuple(signal if kept.size == signal.size else signal[kept] for signal in signals)


def legend_below(made: Figure, axis: Axes) -> None:
    # The only layout that makes room for a legend outside of all axes; it costs two more passes.
    made.set_layout_engine("constrained")
    handles, names = axis.get_legend_handles_labels()
    fitting = max(1, 90 // (max(map(len, names)) + 8))
    made.legend(handles, names, loc="outside lower center", ncols=min(fitting, len(names)))
