"""How big the error is, where it lives, and whether it is noise."""

from piezo_opt.comparison.compare import Comparison, Entry, columns, compare
from piezo_opt.comparison.metrics import Metrics, uncontrolled_iae
from piezo_opt.comparison.misfit import Misfit
from piezo_opt.comparison.where import Where, where
from piezo_opt.comparison.whiteness import Whiteness, whiteness

__all__ = [
    "Comparison",
    "Entry",
    "Metrics",
    "Misfit",
    "Where",
    "Whiteness",
    "columns",
    "compare",
    "uncontrolled_iae",
    "where",
    "whiteness",
]
