"""Control laws as C: what they remember in a struct, and one function for each sample."""

from piezo_opt.export.laws.inverse import inverse_compensation

__all__ = ["inverse_compensation"]
