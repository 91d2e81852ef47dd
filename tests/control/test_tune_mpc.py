"""Horizon, weight and filter of a predictive controller are found, and what cannot be is said."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.control import close_loop
from piezo_opt.errors import InputError
from tests.control.test_tune_lqr import LIMITS, PERIOD, SAW, STAGE, VALUES


def test_the_design_is_better_than_where_it_began() -> None:
    found = po.tune_mpc(
        STAGE, SAW[:201], period=PERIOD, values=VALUES, limits=LIMITS, noise=5e-9
    )  # fmt: skip
    assert found.loops[0].rms < 12e-9
    assert found.loops[0].rms <= min(e for _, e in found.horizons)
    shortest = next(n for n, e in found.horizons if e <= 1.02 * min(x for _, x in found.horizons))
    assert found.horizon == shortest
    again = close_loop(
        po.ModelPlant(STAGE, VALUES), found.controller, SAW[:201], period=PERIOD, limits=LIMITS,
        noise=5e-9,
    )  # fmt: skip
    assert again.rms == pytest.approx(found.loops[0].rms, rel=1e-9)
    assert "ms)" in str(found)
    assert found.to_dict()["controller"]["horizon"] == found.horizon


def test_a_reading_beyond_the_actuator_s_range_is_passed_over() -> None:
    """The filter's gate is the range that the drive reaches; without it spikes are followed."""
    found = po.tune_mpc(
        STAGE, SAW[:201], period=PERIOD, values=VALUES, limits=LIMITS, noise=5e-9, horizon=10
    )  # fmt: skip
    assert found.gate == pytest.approx(np.ptp(SAW), rel=0.5)
    assert found.calm
    assert "is none" in str(found)
    assert found.to_dict()["controller"]["gate"] == found.gate
    own = found.controller
    open_ = po.MPC(
        STAGE, VALUES, period=PERIOD, span=own.span, horizon=10, limits=LIMITS, weight=own.weight,
        noise=found.noise, drive_noise=found.drive_noise, reference=SAW,
    )  # fmt: skip
    spikes = np.where(np.random.default_rng(3).random(SAW.size) < 0.05, 1e-3, 0.0)
    errors = []
    for controller in (own, open_):
        loop = close_loop(
            po.ModelPlant(STAGE, VALUES), controller, SAW, period=PERIOD, limits=LIMITS,
            noise=5e-9, disturbance=spikes,
        )  # fmt: skip
        errors.append(float(np.sqrt(np.mean((loop.error + spikes)[:200] ** 2))))
    assert errors[0] < 3.0 * found.loops[0].rms
    assert errors[1] > 10.0 * errors[0]


def test_what_cannot_be_is_said_at_design_time() -> None:
    asked = {"period": PERIOD, "values": VALUES, "limits": LIMITS}
    with pytest.raises(InputError, match="as long as the longest horizon"):
        po.tune_mpc(STAGE, SAW, delay=80, **asked)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="as long as the horizon"):
        po.tune_mpc(STAGE, SAW, delay=20, horizon=20, **asked)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="lower limit is below"):
        po.tune_mpc(STAGE, SAW, stroke=(1e-6, 0.0), **asked)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="asks for nothing"):
        po.tune_mpc(STAGE, np.zeros(50), **asked)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="the stroke allows 0 m to 4 um"):
        po.tune_mpc(STAGE, SAW, stroke=(0.0, 4e-6), **asked)  # type: ignore[arg-type]


@pytest.mark.parametrize("design", [po.tune_pid, po.tune_lqr, po.tune_mpc, po.optimal_feedforward])
def test_limits_that_a_reference_cannot_be_followed_in_are_said_at_design_time(
    design: Callable[..., Any],
) -> None:
    asked = {"period": PERIOD, "values": VALUES}
    with pytest.raises(InputError, match="to 24 um, and the drive's limits of -5 V and 42 V reach"):
        design(STAGE, 4.0 * SAW, limits=LIMITS, **asked)
    # 100 V/s take the drive 5 V along in half a period of 50 ms, a few per cent of the way.
    with pytest.raises(InputError, match="at 100 V/s the drive covers only"):
        design(STAGE, SAW, limits=po.Limits(-5.0, 42.0, 100.0), **asked)
