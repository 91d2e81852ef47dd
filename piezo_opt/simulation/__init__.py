"""Simulation: schedule, scheme, the compiled core, and what comes out."""

from piezo_opt.simulation.accuracy import Accuracy, Substeps
from piezo_opt.simulation.many import Many, simulate_many
from piezo_opt.simulation.scheme import INITIAL
from piezo_opt.simulation.simulate import TOLERANCE, Initial, Response, Simulator, simulate

__all__ = [
    "INITIAL", "TOLERANCE", "Accuracy", "Initial", "Many", "Response", "Simulator", "Substeps",
    "simulate", "simulate_many",
]  # fmt: skip
