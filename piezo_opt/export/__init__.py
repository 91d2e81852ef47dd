"""Export: a model leaves the house as C that needs nothing of it."""

from piezo_opt.export.c.replay import Replay
from piezo_opt.export.c.verb import Exported, export_c

__all__ = ["Exported", "Replay", "export_c"]
