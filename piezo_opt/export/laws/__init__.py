"""Control laws as C: what they remember in a struct, and one function for each sample."""

from piezo_opt.export.laws.inverse import inverse_compensation
from piezo_opt.export.laws.verb import ExportedController, export_controller

__all__ = ["ExportedController", "export_controller", "inverse_compensation"]
