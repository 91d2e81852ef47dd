"""Numbers in sentences."""

from __future__ import annotations

from piezo_opt.units import show


def brief(value: float, unit: str) -> str:
    """An SI number with a prefix and three significant digits: more would pretend to be known.

    >>> brief(2.0852e-07, "m")
    '209 nm'
    """
    return show(float(f"{value:.3g}"), unit)
