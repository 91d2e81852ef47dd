"""What a user would take instead: the same numbers, and what they cost."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np
import pytest

from piezo_opt.benchmark.alternatives import Alternatives, alternatives
from piezo_opt.report.speed_figures import work_precision
from piezo_opt.simulation.compiler import find_compiler
from piezo_opt.simulation.library import MACHINE

pytestmark = pytest.mark.skipif(
    find_compiler() is None or not MACHINE, reason="compares compiled code: no cc"
)


@pytest.fixture(scope="module")
def found() -> Alternatives:
    return alternatives(1000, 5)


def test_ways_of_the_same_scheme_err_alike(found: Alternatives) -> None:
    def errors(way: str) -> list[float]:
        return [p.error for p in found.points if p.way == way]

    hand = errors("C by hand")
    for way in ("exported C", "exported C, sample by sample", "ours, Runge-Kutta"):
        assert errors(way) == pytest.approx(hand, rel=1e-3, abs=1e-13)
    # Order four: twice the sub-steps, a sixteenth of the error.
    assert hand[0] / hand[1] == pytest.approx(16.0, rel=0.15)
    assert max(errors("ours, linear part exact")) < 1e-3 * hand[0]


def test_adaptive_solvers_cost_a_hundred_times_as_much(found: Alternatives) -> None:
    assert found.at("solve_ivp") > 100.0 * found.at(found.best)
    assert found.at("CVODES in CasADi") > 100.0 * found.at(found.best)
    assert 0.5 < found.exported < 2.0
    assert 0.5 < found.called < 2.5
    # Beside other tests, what is timed in turns still differs by a tenth.
    assert found.exported < 1.25 * found.called
    assert found.at("C by hand", 1e-15) == np.inf


def test_what_is_not_installed_is_said(found: Alternatives) -> None:
    for package, way in (("numba", "numba loop"), ("diffrax", "diffrax")):
        here = find_spec(package) is not None
        assert (way in found.ways) == here
        assert (way in found.skipped) != here
    assert all(way in str(found) for way in (*found.ways, *found.skipped))
    assert len(work_precision(found).axes[0].get_lines()) == len(found.ways) + 1
