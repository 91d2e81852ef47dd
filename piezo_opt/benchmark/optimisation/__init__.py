"""Optimisers compared: the same problems, the same starts, everybody's price in simulations."""

from piezo_opt.benchmark.optimisation.cases import CASES, Case
from piezo_opt.benchmark.optimisation.compare import compare_optimisers
from piezo_opt.benchmark.optimisation.contenders import CONTENDERS, Contender
from piezo_opt.benchmark.optimisation.posed import Posed, posed
from piezo_opt.benchmark.optimisation.result import Comparison, Result

__all__ = [
    "CASES",
    "CONTENDERS",
    "Case",
    "Comparison",
    "Contender",
    "Posed",
    "Result",
    "compare_optimisers",
    "posed",
]
