"""Small versions of what the docs state about intervals and other packages."""

from __future__ import annotations

import importlib.util
from itertools import islice

import control
import numpy as np
import pytest

from piezo_opt.benchmark.linear_coverage import linear_coverage
from piezo_opt.benchmark.linear_peers import (
    PEERS,
    STEP,
    Peers,
    cases,
    judged,
    linear_peers,
    ours,
    plants,
)
from piezo_opt.errors import InputError


def test_ten_records_and_a_fit_that_is_close_on_one() -> None:
    assert len({name for name, _, _ in plants()}) == 10
    assert ours(next(cases())) < 1e-3
    assert len(PEERS) == 3


def test_a_sampled_model_is_judged_alike() -> None:
    case = next(islice(cases(), 2, None))

    exact = control.c2d(control.ss(plants()[2][1]), STEP, "zoh")
    share = float(case.train.drive.std() / case.train.position.std())
    parts = [np.asarray(m) for m in (exact.A, exact.B, share * np.asarray(exact.C), exact.D)]
    assert judged(*parts, case) < 1e-9
    parts[0] = 0.99 * parts[0]
    assert judged(*parts, case) > 1e-3


def test_who_is_met_is_counted() -> None:
    found = Peers(("a", "b"), (0.1, 0.2), ((0.1, 0.3, 0.2), (0.1, 0.4, 0.9)))
    assert found.met == 1
    assert "1 of 2" in str(found)


@pytest.mark.skipif(importlib.util.find_spec("nfoursid") is not None, reason="it is installed")
def test_a_missing_peer_is_named() -> None:
    with pytest.raises(InputError, match="pip install"):
        linear_peers()


def test_coverage_is_counted() -> None:
    found = linear_coverage(6)
    assert set(found.values()) <= {k / 6 for k in range(7)}
    assert sum(found.values()) / len(found) > 0.75
