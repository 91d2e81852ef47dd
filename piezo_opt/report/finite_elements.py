"""Pictures of finite-element answers: the deformed body, its modes, its frequency response."""

from __future__ import annotations

from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from piezo_opt.errors import InputError
from piezo_opt.finite_elements import Body, Modes, Reduced, Static
from piezo_opt.measurement import FloatArray
from piezo_opt.pictures.picture import prefixed
from piezo_opt.report.style import BLUE, GREY, figure, plain_log_ticks, styled

_SHOWN: Final = 0.15
"""Largest displacement in a picture, as a share of the body's height: seen, and still a body."""
_MOST_MODES: Final = 6


def deformed(answer: Static) -> Figure:
    """The body as it deforms, enlarged, coloured by the displacement along z; outline at rest."""
    with styled():
        made = Figure(figsize=(6.2, 4.6), layout="constrained")
        axis: Any = made.add_subplot(projection="3d")
        vertical = answer.displacement[:, 2]
        factor, unit = prefixed("m", vertical)
        scale = _draw(axis, answer.body, answer.displacement, factor * vertical)
        axis.set_title(f"{answer.voltage:g} V, displacements {_times(scale)} enlarged")
        bar = mpl.cm.ScalarMappable(Normalize(*_range(factor * vertical)), mpl.colormaps["cividis"])
        made.colorbar(bar, ax=axis, shrink=0.7, pad=0.1, label=f"displacement along z [{unit}]")
    return made


def mode_shapes(found: Modes) -> Figure:
    """The lowest modes, coloured by the length of the displacement (no unit: modes have none)."""
    count = min(_MOST_MODES, found.frequencies.size)
    columns = min(3, count)
    rows = -(-count // columns)
    with styled():
        made = Figure(figsize=(2.6 * columns, 2.5 * rows), layout="constrained")
        for number in range(count):
            axis: Any = made.add_subplot(rows, columns, number + 1, projection="3d")
            shape = found.shapes[number]
            _draw(axis, found.body, shape, np.linalg.norm(shape, axis=1), labels=False)
            factor, unit = prefixed("Hz", found.frequencies[number : number + 1])
            axis.set_title(f"{number + 1}: {factor * found.frequencies[number]:.1f} {unit}")
    return made


def frequency_response(body: Reduced) -> Figure:
    """Displacement of the top a volt, and the charge a volt, over frequency.

    Raises:
        InputError: no mode moves the top.
    """
    if body.frequencies.size == 0:
        raise InputError("no mode moves the top: there is no response to draw, ask for more modes")
    low, high = 0.1 * body.frequencies.min(), 1.3 * body.frequencies.max()
    asked = np.unique(
        np.concatenate(
            [np.geomspace(low, high, 1500)]
            + [f * (1.0 + body.damping * np.linspace(-5, 5, 201)) for f in body.frequencies]
        )
    )
    with styled():
        made, (above, below) = figure(rows=2, width=6.2, height=4.8, sharex=True)
        hertz, unit = prefixed("Hz", asked)
        for axis, values, rest, what, si in (
            (above, body.response(asked), body.gain, "displacement", "m/V"),
            (below, body.charge(asked), body.capacitance, "charge", "F"),
        ):
            size = np.abs(values)
            factor, shown = prefixed(si, np.array([rest]))
            axis.axhline(factor * abs(rest), color=GREY, linestyle="--", label="at rest")
            axis.loglog(hertz * asked, factor * size, color=BLUE, label="with its modes")
            axis.set_ylabel(f"{what} a volt [{shown}]")
            plain_log_ticks(axis.yaxis)
        above.legend(loc="upper left")
        below.set_xlabel(f"frequency [{unit}]")
        plain_log_ticks(below.xaxis)
    return made


def _draw(
    axis: Any, body: Body, displacement: FloatArray, colour: FloatArray, *, labels: bool = True
) -> float:
    """Draw the deformed surface; by how much it was enlarged."""
    largest = float(np.abs(displacement).max()) or 1.0
    scale = _SHOWN * body.height / largest
    faces = body.surface()
    factor, unit = prefixed("m", body.points)
    moved = factor * (body.points + scale * displacement)
    shade = Normalize(*_range(colour))(colour[faces].mean(axis=1))
    axis.add_collection3d(
        Poly3DCollection(
            moved[faces], facecolors=mpl.colormaps["cividis"](shade), edgecolors="#ffffff55",
            linewidths=0.25,
        )
    )  # fmt: skip
    low, high = factor * body.points.min(axis=0), factor * body.points.max(axis=0)
    _outline(axis, low, high)
    margin = _SHOWN * factor * body.height
    for k, name in enumerate("xyz"):
        getattr(axis, f"set_{name}lim")(low[k] - margin, high[k] + margin)
        getattr(axis, f"{name}axis").set_major_locator(mpl.ticker.MaxNLocator(4))
        if labels:
            getattr(axis, f"set_{name}label")(f"{name} [{unit}]")
    axis.set_box_aspect(high - low + 2.0 * margin)
    axis.view_init(elev=25.0, azim=-55.0)
    if not labels:
        axis.set_axis_off()
    return scale


def _outline(axis: Any, low: FloatArray, high: FloatArray) -> None:
    corners = np.array(
        [[low[k] if c >> k & 1 == 0 else high[k] for k in range(3)] for c in range(8)]
    )
    for a in range(8):
        for k in range(3):
            b = a | 1 << k
            if b != a:
                axis.plot(*corners[[a, b]].T, color=GREY, linewidth=0.7, linestyle=":")


def _range(values: FloatArray) -> tuple[float, float]:
    low, high = float(values.min()), float(values.max())
    return (low, high) if high > low else (low, low + 1.0)


def _times(scale: float) -> str:
    exponent = int(np.floor(np.log10(scale)))
    return f"{round(scale, -exponent):,.0f} times" if exponent > 0 else f"{scale:.1f} times"
