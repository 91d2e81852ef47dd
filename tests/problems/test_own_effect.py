"""The story of a user's own effect, turn by turn, and that its checks can fail."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.diagnosis import Unexplained, unexplained
from piezo_opt.diagnosis.noise import noise_floor
from problems import own_effect


@cache
def base() -> po.Fit:
    return po.solve(own_effect.question())


@cache
def left() -> Unexplained:
    found = unexplained(base(), noise_floor(base()))
    assert found is not None
    return found


def test_the_record_is_exact_far_below_its_noise() -> None:
    finer = own_effect.exact_reading(2 * own_effect.FINER)
    change = np.abs(finer - own_effect.exact_reading()).max()
    assert 0.0 < change < 0.01 * own_effect.noise()


def test_the_correction_has_its_hump_where_the_magnet_is() -> None:
    height, place, breadth = own_effect.hump(left())
    known = own_effect.known()
    assert abs(place - known["eddy_brake.m"]) < 0.25 * known["eddy_brake.b"]
    # The smallest correction is too small and too flat; half of it is a good start.
    assert 0.45 < height / known["eddy_brake.c"] < 1.0
    assert 1.0 < breadth / known["eddy_brake.b"] < 2.0


def test_a_magnet_elsewhere_is_refused() -> None:
    fit = own_effect.with_own_effect(base(), left())
    own_effect.check(fit)
    moved = po.solve(
        po.Identification(
            fit.model, own_effect.data(), start=po.Start.REST, fixed={"eddy_brake.m": 5.3e-6}
        ),
        start=fit.values,
    )
    with pytest.raises(AssertionError):
        own_effect.check(moved)
