"""What a user can do wrong, said in one sentence."""

from __future__ import annotations

from typing import Final


class PiezoOptError(Exception):
    """Base of every error that the package raises on purpose."""


class InputError(PiezoOptError, ValueError):
    """The input cannot be used: says what, where, why, and what to do."""


class ModelError(PiezoOptError, ValueError):
    """The sum of effects makes no sense: names the effect and hands over the fix."""


NO_FIT: Final = (PiezoOptError, ArithmeticError, ValueError)
"""What a fit without a finite start or an answer raises: one of many trials is passed over."""
