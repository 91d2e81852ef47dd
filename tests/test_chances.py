"""Chances are those of the library that takes longer to load than a fit."""

from __future__ import annotations

import math

import pytest
import scipy.special
from hypothesis import given
from hypothesis import strategies as st

from piezo_opt.chances import (
    chi_squared_quantile,
    chi_squared_tail,
    f_tail,
    normal_quantile,
    t_quantile,
)

CHANCES = st.floats(-12.0, -1e-3).map(lambda power: 10.0**power)


@given(CHANCES)
def test_normal_numbers(chance: float) -> None:
    assert normal_quantile(chance) == pytest.approx(scipy.special.ndtri(chance), rel=1e-12)
    upper = scipy.special.ndtri(1.0 - chance)
    assert normal_quantile(1.0 - chance) == pytest.approx(upper, rel=1e-12, abs=1e-14)


@given(st.floats(0.5, 1e5), CHANCES)
def test_sums_of_squares(freedom: float, chance: float) -> None:
    value = float(scipy.special.chdtri(freedom, chance))
    # Gamma(a) is known to some units in the last place of a log(a), and so is all that follows.
    close = 1e-12 + 1e-15 * freedom
    assert chi_squared_tail(freedom, value) == pytest.approx(chance, rel=20.0 * close)
    assert chi_squared_quantile(freedom, chance) == pytest.approx(value, rel=close)


@given(st.floats(0.5, 1e5), st.floats(0.0, 3.0))
def test_chances_around_the_middle(freedom: float, share: float) -> None:
    known = float(scipy.special.chdtrc(freedom, share * freedom))
    close = 1e-12 + 1e-14 * freedom
    assert chi_squared_tail(freedom, share * freedom) == pytest.approx(known, rel=close, abs=1e-300)


@given(st.floats(1.0, 1e6), st.floats(0.501, 1.0 - 1e-9))
def test_students_t(freedom: float, chance: float) -> None:
    known = float(scipy.special.stdtrit(freedom, chance))
    assert t_quantile(freedom, chance) == pytest.approx(known, rel=1e-10, abs=1e-12)


@given(st.floats(1.0, 1e5), st.floats(1.0, 1e5), st.floats(0.0, 5.0))
def test_ratios_of_squares(above: float, below: float, value: float) -> None:
    known = float(scipy.special.fdtrc(above, below, value))
    assert f_tail(above, below, value) == pytest.approx(known, rel=1e-9, abs=1e-300)


def test_ends() -> None:
    assert chi_squared_tail(3.0, 0.0) == 1.0
    assert chi_squared_tail(3.0, float("inf")) == 0.0
    assert math.isnan(chi_squared_tail(3.0, math.nan))
    assert chi_squared_tail(1.0, 1e-300) == pytest.approx(1.0)
