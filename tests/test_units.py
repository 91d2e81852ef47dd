"""The border of units."""

import contextlib
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezo_opt.errors import InputError
from piezo_opt.units import (
    _PLAIN,
    _parse,
    _registry,
    parse_header,
    quantity,
    same_dimension,
    show,
    si_unit,
    to_si,
)


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("20 nm", "m", 2e-8),
        ("1um", "m", 1e-6),
        ("1 µm", "m", 1e-6),  # micro sign
        ("1 μm", "m", 1e-6),  # Greek letter
        ("2 micron", "m", 2e-6),
        ("-3.5e2 mV", "V", -0.35),
        ("1.5 kV", "V", 1500.0),
        ("40 ms", "s", 0.04),
        ("25 degC", "K", 298.15),
        ("25 °C", "K", 298.15),
        ("50 nm/V", "m/V", 5e-8),
        ("2 %", "1", 0.02),
        ("0.5", "1", 0.5),
        ("60 rpm", "rad/s", 2 * math.pi),
        (3.5, "m", 3.5),
        (2, "s", 2.0),
    ],
)
def test_a_quantity_is_its_si_value(text: str | float, unit: str, value: float) -> None:
    assert quantity(text, unit) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "unit", "says"),
    [
        ("20", "m", "no unit"),
        ("nm", "m", "does not start with a number"),
        ("", "m", "does not start with a number"),
        ("20 V", "m", "not a quantity in m"),
        ("20 furlongy", "m", "unknown unit 'furlongy'"),
        ("2 9**9**9**9", "m", "unknown unit"),
        ("1e999 m", "m", "too large"),
        (math.nan, "m", "finite"),
    ],
)
def test_a_bad_quantity_says_why(text: str | float, unit: str, says: str) -> None:
    with pytest.raises(InputError, match=says.replace("*", r"\*")):
        quantity(text, unit)


def test_a_header_is_a_name_and_a_unit() -> None:
    assert parse_header("voltage [V]") == ("voltage", "V")
    assert parse_header(" tip displacement [um] ") == ("tip displacement", "um")
    for text, says in (
        ("voltage", "no unit"),
        ("x []", "unit is missing"),
        ("x [foo]", "unknown unit 'foo'"),
        ("x [m] y", "no unit"),
    ):
        with pytest.raises(InputError, match=says):
            parse_header(text)


def test_to_si_converts_scales_and_offsets() -> None:
    values, unit = to_si([0.0, 100.0], "degC")
    assert unit == "K"
    np.testing.assert_allclose(values, [273.15, 373.15], rtol=1e-14)
    values, unit = to_si([[1.0, -2.0]], "um")
    assert (unit, values.shape) == ("m", (1, 2))
    np.testing.assert_allclose(values, [[1e-6, -2e-6]], rtol=1e-14)


def test_si_values_pass_bit_for_bit_and_are_copied() -> None:
    original = np.array([0.1, 1 / 3])
    values, _ = to_si(original, "V")
    values[0] = 7.0
    assert original[0] == 0.1
    assert values[1] == 1 / 3


@pytest.mark.parametrize(
    ("unit", "si"),
    [
        ("um", "m"),
        ("um/V", "m/V"),
        ("um/ms^2", "m/s^2"),
        ("mN", "N"),
        ("kHz", "Hz"),
        ("mrad", "rad"),
        ("rpm", "rad/s"),
        ("%", "1"),
        ("1/ms", "1/s"),
        ("N/um", "N/m"),
    ],
)
def test_the_si_unit_has_factor_one(unit: str, si: str) -> None:
    assert si_unit(unit) == si
    assert si_unit(si) == si
    assert to_si(1.0, si)[0] == 1.0


def test_same_dimension() -> None:
    assert same_dimension("mV", "kV")
    assert not same_dimension("mV", "um")


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (2e-8, "m", "20 nm"),
        (999.99e-9, "m", "1 um"),
        (-2.5e-6, "m", "-2.5 um"),
        (3e-8, "m/V", "30 nm/V"),
        (1500.0, "V", "1.5 kV"),
        (4000.0, "s", "4000 s"),
        (0.04, "s", "40 ms"),
        (293.15, "K", "293.1 K"),
        (0.0, "V", "0 V"),
        (0.25, "1", "0.25"),
        (2e-7, "m^2", "2e-07 m^2"),
    ],
)
def test_show(value: float, unit: str, text: str) -> None:
    assert show(value, unit) == text


@given(
    value=st.floats(1e-14, 1e14) | st.floats(-1e14, -1e-14),
    unit=st.sampled_from(["m", "V", "s", "m/V", "N", "Hz"]),
)
def test_what_is_shown_reads_back_to_four_digits(value: float, unit: str) -> None:
    assert quantity(show(value, unit), unit) == pytest.approx(value, rel=6e-4)


@given(st.text(max_size=60) | st.from_regex(r"[0-9.]{1,4} ?[a-z%^*/0-9 ]{0,12}", fullmatch=True))
def test_any_text_is_a_quantity_or_an_input_error(text: str) -> None:
    with contextlib.suppress(InputError):
        assert math.isfinite(quantity(text, "m"))


@pytest.mark.parametrize("unit", sorted(_PLAIN))
def test_the_short_way_agrees_with_the_units_library(unit: str) -> None:
    """Half a record's units are looked up in a table: the table must say what the library says."""
    library = _registry().Quantity(1.0, _parse(unit)).to_base_units()
    factor, symbol = _PLAIN[unit]
    assert _parse(symbol).dimensionality == library.dimensionality
    assert factor * _registry().Quantity(1.0, symbol).to_base_units().magnitude == pytest.approx(
        library.magnitude, rel=1e-15
    )
