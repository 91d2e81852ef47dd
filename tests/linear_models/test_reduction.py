"""Step criteria and order reduction against formulas, and against the thesis."""

from __future__ import annotations

import control
import numpy as np
import pytest

from piezo_opt.errors import InputError
from piezo_opt.linear_models import (
    second_order_shape,
    step_criteria,
    truncate,
    two_poles_like,
)

EQUATION_3_1 = control.tf([3400.0, 62060.0], [1.0, 572.5, 10120.0, 61670.0, 539200.0])


def test_criteria_of_two_poles_follow_their_formulas() -> None:
    zeta, omega = 0.3, 40.0
    seen = step_criteria(control.tf([2.0 * omega**2], [1.0, 2 * zeta * omega, omega**2]))
    damped = omega * np.sqrt(1.0 - zeta**2)
    assert seen.final == pytest.approx(2.0, rel=1e-12)
    assert seen.overshoot == pytest.approx(np.exp(-np.pi * zeta / np.sqrt(1 - zeta**2)), rel=1e-8)
    assert seen.peak_time == pytest.approx(np.pi / damped, rel=1e-5)


def test_criteria_of_a_lag_follow_their_formulas() -> None:
    seen = step_criteria(control.tf([5e-8], [0.02, 1.0]))
    assert seen.settling_time == pytest.approx(0.02 * np.log(50.0), rel=1e-9)
    assert seen.rise_time == pytest.approx(0.02 * np.log(9.0), rel=1e-9)
    assert seen.overshoot == 0.0


def test_the_thesis_criteria_and_its_two_poles() -> None:
    seen = step_criteria(EQUATION_3_1)
    assert seen.overshoot == pytest.approx(0.529, abs=5e-4)
    assert seen.settling_time == pytest.approx(2.50, abs=5e-3)
    shape = second_order_shape(0.528, 2.5)
    assert shape.zeta == pytest.approx(0.1992, abs=5e-5)
    assert shape.omega == pytest.approx(8.0321, rel=1e-4)
    like = two_poles_like(EQUATION_3_1)
    assert like.omega == pytest.approx(8.0321, rel=5e-3)
    m, b, k = like.mass_damping_stiffness
    assert b / m == pytest.approx(2.0 * like.zeta * like.omega)
    assert 1.0 / k == pytest.approx(seen.final)


@pytest.mark.parametrize("keep_gain", [False, True])
def test_balanced_truncation_stays_within_its_bound(keep_gain: bool) -> None:
    for order in (1, 2, 3):
        reduced = truncate(EQUATION_3_1, order, keep_gain=keep_gain)
        at = 1j * np.geomspace(1e-3, 1e4, 4000)
        apart = np.abs(EQUATION_3_1(at) - reduced.system(at)).max()
        assert apart <= reduced.bound * (1.0 + 1e-6)
        assert np.all(reduced.system.poles().real < 0.0)
    if keep_gain:
        assert float(reduced.system.dcgain()) == pytest.approx(62060.0 / 539200.0, rel=1e-9)


def test_hankel_values_of_a_lag() -> None:
    # G = k / (tau s + 1) has the single value k / 2.
    assert truncate(control.tf([3.0], [0.1, 1.0]), 1).singular_values == pytest.approx([1.5])


def test_refusals_are_one_sentence() -> None:
    unstable = control.tf([1.0], [1.0, -1.0])
    for call in (step_criteria, lambda s: truncate(s, 1)):
        with pytest.raises(InputError, match="unstable"):
            call(unstable)
    with pytest.raises(InputError, match="give 1 to 4"):
        truncate(EQUATION_3_1, 5)
    with pytest.raises(InputError, match="between 0 and 1"):
        second_order_shape(1.2, 1.0)
    with pytest.raises(InputError, match="sampled"):
        step_criteria(control.tf([1.0], [1.0, -0.5], 0.1))
