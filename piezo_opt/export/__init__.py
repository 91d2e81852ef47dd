"""Export: a model leaves the house as code that needs nothing of it."""

from piezo_opt.export.arduino import Sketch, export_arduino
from piezo_opt.export.boards import BOARDS, Footprint
from piezo_opt.export.c.replay import Replay
from piezo_opt.export.c.verb import Exported, export_c

__all__ = [
    "BOARDS", "Exported", "Footprint", "Replay", "Sketch", "export_arduino", "export_c",
]  # fmt: skip
