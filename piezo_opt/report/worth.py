"""A picture of what a diagnosis is worth: every plant a point, every median a line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from piezo_opt.report.style import BLACK, BLUE, GREEN, VERMILLION, figure, plain_log_ticks, styled

_APART = 0.26
"""Between the models of one controller, in units of the distance of two controllers."""


def worths(points: Mapping[str, Mapping[str, Mapping[str, Sequence[float]]]]) -> Figure:
    """Tracking errors by reference, controller and model.

    Args:
        points: rms errors over the span, one a plant, nan where there is none.
    """
    shown = {
        reference: {
            controller: models for controller, models in by.items()
            if any(np.isfinite(errors).any() for errors in models.values())
        }
        for reference, by in points.items()
    }  # fmt: skip
    shown = {reference: by for reference, by in shown.items() if by}
    with styled():
        made, axes = figure(rows=max(len(shown), 1), width=7.2, height=0.4 + 2.9 * len(shown))
        for one, (reference, by) in zip(axes, shown.items(), strict=False):
            for k, models in enumerate(by.values()):
                for j, ((model, errors), colour) in enumerate(
                    zip(models.items(), (VERMILLION, BLUE, GREEN), strict=False)
                ):
                    finite = 100.0 * np.array([e for e in errors if np.isfinite(e)])
                    at = k + _APART * (j - 1)
                    spread = 0.14 * (np.linspace(0.0, 1.0, finite.size) - 0.5)
                    one.plot(
                        at + spread, finite, "o", color=colour, markersize=3.5, alpha=0.6,
                        label=model if k == len(by) - 1 else None,
                    )  # fmt: skip
                    if finite.size:
                        one.hlines(
                            float(np.median(finite)), at - 0.11, at + 0.11, color=BLACK,
                            linewidth=1.8,
                        )  # fmt: skip
            one.set_yscale("log")
            plain_log_ticks(one.yaxis)
            one.set_xticks(range(len(by)), list(by))
            one.set_xlim(-0.6, len(by) - 0.4)
            one.grid(visible=False, axis="x")
            one.set_ylabel("rms error [% of span]")
            one.set_title(f"{reference.capitalize()}: a point is a plant, a line the median")
            one.legend(title="designed on", loc="lower left", ncols=3)
    return made
