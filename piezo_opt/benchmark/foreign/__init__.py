"""A second family of plants with hidden effects, written by another hand.

Its hysteresis, its drives and the forms of its effects are those of the literature on actuators;
nothing is shared with the package, nor with the first family. Numpy and scipy alone.
"""

from piezo_opt.benchmark.foreign.classes import CLASSES, INSIDE, OUTSIDE
from piezo_opt.benchmark.foreign.records import Facts, ForeignRecord, draw_pairs, make

__all__ = ["CLASSES", "INSIDE", "OUTSIDE", "Facts", "ForeignRecord", "draw_pairs", "make"]
