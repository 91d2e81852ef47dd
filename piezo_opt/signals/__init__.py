"""Drives to play: made by rule, kept to limits, or found for a question.

What is measured decides what can be known: signals that show loops, minor loops, creep, resonances
and distortion, and the best drive for given parameters or between given models.
"""

from piezo_opt.signals.arduino import Output, write_arduino
from piezo_opt.signals.best import BestDrive, best_for
from piezo_opt.signals.between import DriveBetween, best_between
from piezo_opt.signals.ceiling import Ceiling, ceiling
from piezo_opt.signals.drive import Drive
from piezo_opt.signals.families import FAMILIES, Corners, Family, Mixed, Tones
from piezo_opt.signals.information import Criterion
from piezo_opt.signals.limits import DriveLimits, predicted, within
from piezo_opt.signals.loops import decaying_triangles, square, staircase, triangle
from piezo_opt.signals.tones import Lines, Phases, chirp, multisine, sine
from piezo_opt.signals.usual import usual

__all__ = [
    "FAMILIES",
    "BestDrive",
    "Ceiling",
    "Corners",
    "Criterion",
    "Drive",
    "DriveBetween",
    "DriveLimits",
    "Family",
    "Lines",
    "Mixed",
    "Output",
    "Phases",
    "Tones",
    "best_between",
    "best_for",
    "ceiling",
    "chirp",
    "decaying_triangles",
    "multisine",
    "predicted",
    "sine",
    "square",
    "staircase",
    "triangle",
    "usual",
    "within",
    "write_arduino",
]
