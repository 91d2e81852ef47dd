"""When a record was sampled, and what of it counts."""

from __future__ import annotations

import numpy as np
import pytest

from tests.measurement.records import sine


def test_of_an_even_record() -> None:
    record = sine()
    assert record.uniform
    assert record.step == pytest.approx(0.01, rel=1e-12)
    assert record.rate == pytest.approx(100.0, rel=1e-12)
    assert record.duration == pytest.approx(3.99)
    assert record.gaps == ()
    assert record.remarks == ()


def test_times_printed_with_few_digits_are_even() -> None:
    record = sine(time=np.round(np.arange(400) / 6400, 6))
    assert record.uniform
    assert record.rate == pytest.approx(6400, rel=1e-4)


def test_counted_starts_with_the_start_up() -> None:
    record = sine(startup=1.0)
    assert np.flatnonzero(record.counted)[0] == 100
    assert record.counted.sum() == 300
