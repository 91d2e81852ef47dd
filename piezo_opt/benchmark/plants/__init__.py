"""Independent plants with hidden effects, for judging a diagnosis without flattering it.

Nothing here imports the rest of the package: physics, numerics and forms of the effects are the
bench's own, so that a diagnosis cannot find its own equations in the data.
"""

from piezo_opt.benchmark.plants.classes import CLASSES, OUTSIDE
from piezo_opt.benchmark.plants.records import Facts, HiddenRecord, Level, make

__all__ = ["CLASSES", "OUTSIDE", "Facts", "HiddenRecord", "Level", "make"]
