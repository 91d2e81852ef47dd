"""What a user can do wrong, said in one sentence."""

from __future__ import annotations


class PiezoOptError(Exception):
    """Base of every error that the package raises on purpose."""


class InputError(PiezoOptError, ValueError):
    """The input cannot be used: says what, where, why, and what to do."""


class ModelError(PiezoOptError, ValueError):
    """The sum of effects makes no sense: names the effect and hands over the fix."""
