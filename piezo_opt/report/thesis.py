"""The thesis' pictures of its fourth chapter, drawn anew: the loop, tracking, errors, a step."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from piezo_opt.measurement import FloatArray
from piezo_opt.report.style import BLACK, GREY, MODELS, figure, styled, thinned

if TYPE_CHECKING:
    from piezo_opt.control import ClosedLoop
    from piezo_opt.identification import Fit


def chapter_four(
    fit: Fit, loops: Mapping[str, ClosedLoop], time: FloatArray, answers: Mapping[str, FloatArray]
) -> Figure:
    """Four panels, as Figs. 4.1 to 4.4 and the step of Appendix B.

    Args:
        fit: of the measured loop.
        loops: tracking of a triangle, by controller.
        time: (N,) of the step [s].
        answers: (N,) to a step of 1, by controller.
    """
    record = fit.records[0]
    with styled():
        made, (loop, line, error, step) = figure(2, 2, width=9.6, height=6.8)
        loop.plot(record.drive, 1e6 * record.position, "o", color=BLACK, markersize=3.5,
                  label="measured")  # fmt: skip
        loop.plot(record.drive, 1e6 * (record.position - fit.residual()), color=MODELS[1],
                  label="identified Bouc-Wen")  # fmt: skip
        loop.set(xlabel="drive [V]", ylabel="position [µm]", title="The loop (Fig. 4.1)")
        loop.legend(loc="upper left")
        for (name, one), colour in zip(loops.items(), MODELS, strict=False):
            seconds, off = thinned(one.time, one.error)
            error.plot(seconds, 1e6 * off, color=colour, linewidth=1.0, label=name)
            line.plot(1e6 * one.reference, 1e6 * one.position, color=colour, label=name)
        straight = 1e6 * record.position.max() * record.drive / record.drive.max()
        line.plot(straight, 1e6 * record.position, color=GREY, linestyle=":", label="uncontrolled")
        line.set(xlabel="reference [µm]", ylabel="position [µm]", title="Tracking (Figs. 4.2, 4.3)")
        line.legend(loc="upper left")
        for end in (-0.15, 0.15):
            error.axhline(end, color=GREY, linestyle=":", linewidth=1.0)
        error.set(
            xlabel="time [s]", ylabel="error [µm]", title="Errors, dotted ±0.15 µm (Fig. 4.4)"
        )
        error.legend(loc="lower left")
        for (name, y), colour in zip(answers.items(), (GREY, *MODELS), strict=False):
            step.plot(time, y, color=colour, linewidth=1.1, label=name)
        step.set(xlabel="time [s]", ylabel="position [µm]", title="A step of 1 µm (Appendix B)")
        step.set_xlim(0.0, 5.0)
        step.legend(loc="upper right", ncols=2)
        step.set_ylim(0.0, float(1.25 * max(np.max(y) for y in answers.values())))
    return made
