"""A slow voltage on a body, as a record like a measured one."""

from __future__ import annotations

from typing import Final

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.finite_elements.body import Body
from piezo_opt.finite_elements.statics import static
from piezo_opt.finite_elements.system import System
from piezo_opt.measurement import FEWEST_SAMPLES, Measurement

THESIS_STEPS: Final = 40
"""Increments of the thesis' ramp (Appendix D: 41 rows)."""


def ramp(
    what: Body | System, voltage: float, *, samples: int = THESIS_STEPS + 1, step: float = 0.1
) -> Measurement:
    """Mean displacement of the top while the voltage grows evenly from 0 to ``voltage`` [V].

    The body is linear and the ramp slow against its modes, so that one static answer gives all.

    Args:
        what: a body, or its system with driven electrodes.
        voltage: at the end [V].
        samples: of the record.
        step: between samples [s].

    Raises:
        InputError: too few samples, or the support leaves the body loose.
    """
    if samples < FEWEST_SAMPLES:
        raise InputError(f"a ramp of {samples} samples: give at least {FEWEST_SAMPLES}")
    answer = static(what, voltage)
    share = np.linspace(0.0, 1.0, samples)
    return Measurement(
        time=step * np.arange(samples, dtype=np.float64),
        drive=voltage * share,
        position=answer.tip * share,
        name="ramp",
        source=f"static finite elements, {answer.body.elements} bricks",
    )
