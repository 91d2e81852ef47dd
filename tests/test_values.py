"""Numbers of a model: immutable, finite, per record."""

from __future__ import annotations

import numpy as np
import pytest

from piezo_opt.effects import BoucWen, Creep, PiezoGain
from piezo_opt.errors import ModelError
from piezo_opt.values import Values


def test_nominal_values_are_those_declared_for_every_parameter() -> None:
    model = PiezoGain() + BoucWen() + Creep()
    values = Values.nominal(model)
    assert list(values) == list(model.parameters)
    assert all(values[n] == p.nominal for n, p in model.parameters.items())


def test_a_change_makes_new_values_and_leaves_the_old() -> None:
    given = {"a.x": 1.0, "a.y": 2}
    values = Values(given)
    changed = values.with_({"a.x": 3.0, "b.z": 4.0})
    given["a.x"] = 99.0
    assert dict(values) == {"a.x": 1.0, "a.y": 2.0}
    assert dict(changed) == {"a.x": 3.0, "a.y": 2.0, "b.z": 4.0}
    assert isinstance(values["a.y"], float)
    with pytest.raises(AttributeError):
        values.numbers = {}  # type: ignore[misc]


def test_equal_values_are_one_key() -> None:
    one, other = Values({"a": 1.0, "b": 2.0}), Values({"b": 2.0, "a": 1.0})
    assert one == other
    assert len({one, other, one.with_({"a": 2.0})}) == 2


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
def test_numbers_are_finite(number: float) -> None:
    with pytest.raises(ModelError, match=r"'a\.x'.*finite"):
        Values({"a.x": number})


def test_a_vector_has_the_order_asked_for() -> None:
    values = Values({"a": 1.0, "b": 2.0, "c": 3.0})
    np.testing.assert_array_equal(values.vector(("c", "a")), [3.0, 1.0])
    with pytest.raises(KeyError, match="d"):
        values.vector(("d",))


def test_getting_with_a_default_is_that_of_a_mapping() -> None:
    values = Values({"a": 1.0})
    assert values.get("a") == 1.0
    assert values.get("b") is None
    assert values.get("b", 0.5) == 0.5
    assert values.get("a", 0.5) == 1.0


def test_a_record_takes_its_own_numbers_over_the_shared_ones() -> None:
    values = Values(
        {"piezo_gain.d": 1.0, "offset.y0": 0.0, "offset.y0[0]": 5.0, "offset.y0[11]": 6.0,
         "initial.creep.z[2][0]": 7.0, "initial.creep.z[2][1]": 8.0}
    )  # fmt: skip
    first, second, third = (values.of_record(i) for i in (0, 1, 11))
    assert (first["offset.y0"], second["offset.y0"], third["offset.y0"]) == (5.0, 0.0, 6.0)
    assert first["initial.creep.z[2]"] == 7.0
    assert second["initial.creep.z[2]"] == 8.0
    assert "initial.creep.z[2]" not in third
    assert first["piezo_gain.d"] == third["piezo_gain.d"] == 1.0


def test_a_lone_record_keeps_the_starts_of_the_elements_of_a_column() -> None:
    starts = {f"initial.creep.z[{i}]": float(i + 1) for i in range(3)}
    record = Values(starts).of_record(0)
    assert {k: record[k] for k in starts} == starts
