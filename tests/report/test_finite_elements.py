"""Pictures of finite-element answers show what was computed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from piezo_opt.errors import InputError
from piezo_opt.finite_elements import block, modes, reduced, static
from piezo_opt.physics import PZT_5H
from piezo_opt.report import finite_elements as draw

BODY = block(PZT_5H, 5e-3, 5e-3, 4e-3, elements=(3, 3, 2))


def test_deformed_body() -> None:
    answer = static(BODY, 100.0)
    figure = draw.deformed(answer)
    body, bar = figure.axes
    assert body.get_xlabel() == "x [mm]"
    assert bar.get_ylabel() == "displacement along z [nm]"
    assert bar.get_ylim()[1] == pytest.approx(1e9 * answer.displacement[:, 2].max(), rel=1e-9)
    assert "100 V" in body.get_title()


def test_modes_and_response() -> None:
    found, small = modes(BODY, 8), reduced(BODY, 8)
    shapes = draw.mode_shapes(found)
    assert len(shapes.axes) == 6
    assert shapes.axes[0].get_title() == f"1: {1e-3 * found.frequencies[0]:.1f} kHz"
    above, below = draw.frequency_response(small).axes
    drawn = above.lines[-1].get_xydata()
    peak = np.argmax(drawn[:, 1])
    assert drawn[peak, 0] == pytest.approx(1e-3 * small.frequencies[0], rel=0.01)
    assert drawn[peak, 1] == pytest.approx(1e12 * np.abs(small.gains[0]) / 0.02, rel=0.05)
    assert below.get_xlabel() == "frequency [kHz]"
    none = replace(small, frequencies=np.zeros(0), gains=np.zeros(0), forces=np.zeros(0))
    with pytest.raises(InputError, match="no mode moves the top"):
        draw.frequency_response(none)
