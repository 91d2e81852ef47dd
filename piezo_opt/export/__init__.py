"""Export: a model leaves the house as code that needs nothing of it."""

from piezo_opt.export.arduino import Sketch, export_arduino
from piezo_opt.export.boards import BOARDS, Footprint
from piezo_opt.export.c.replay import Replay
from piezo_opt.export.c.verb import Exported, export_c
from piezo_opt.export.fmu import Unit, export_fmu
from piezo_opt.export.laws import ExportedController, export_controller

__all__ = [
    "BOARDS", "Exported", "ExportedController", "Footprint", "Replay", "Sketch", "Unit",
    "export_arduino", "export_c", "export_controller", "export_fmu",
]  # fmt: skip
