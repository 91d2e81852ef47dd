"""Diagnosis: where a model fails, which effect is missing, and whether adding it holds."""

from piezo_opt.diagnosis.diagnose import Diagnosis, Stopped, diagnose
from piezo_opt.diagnosis.entering import Quantity
from piezo_opt.diagnosis.forces import Force, forces
from piezo_opt.diagnosis.formula import Formula
from piezo_opt.diagnosis.frontier import Effort
from piezo_opt.diagnosis.unexplained import Unexplained, unexplained

__all__ = [
    "Diagnosis",
    "Effort",
    "Force",
    "Formula",
    "Quantity",
    "Stopped",
    "Unexplained",
    "diagnose",
    "forces",
    "unexplained",
]
