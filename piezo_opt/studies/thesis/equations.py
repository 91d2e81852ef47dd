"""The thesis' transfer functions as printed, micrometres a volt."""

from __future__ import annotations

from typing import Any, Final

MICRO: Final = 1e-6


def eq_3_1() -> Any:
    """Eq. 3.1; the 3 of "310120" in its text is the exponent of the term before."""
    import control

    return control.tf([3400.0 * MICRO, 62060.0 * MICRO], [1.0, 572.5, 10120.0, 61670.0, 539200.0])


def eq_3_5() -> Any:
    """Eq. 3.5, two poles like those of Eq. 3.1."""
    import control

    return control.tf([7.4192 * MICRO], [1.0, 3.200, 64.5151])


def eq_3_8() -> Any:
    """Eq. 3.8, of the vibration record."""
    import control

    return control.tf([0.8498 * MICRO], [1.0, 0.8194, 34.8])
