"""Identification: the question, its transcriptions and solvers, and the answer."""

from piezo_opt.identification.default import default_model
from piezo_opt.identification.monitor import Progress
from piezo_opt.identification.problem import Identification, Loss, Prior, Shape, Start
from piezo_opt.identification.outcome import Ending, Evaluations, Outcome, Trace
from piezo_opt.identification.result import Fit, StartResult
from piezo_opt.identification.solve import solve
from piezo_opt.identification.solvers.levenberg_marquardt import LevenbergMarquardt
from piezo_opt.identification.transcription import SingleShooting

__all__ = [
    "Ending", "Evaluations", "Fit", "Identification", "LevenbergMarquardt", "Loss", "Outcome",
    "Prior", "Progress", "Shape", "SingleShooting", "Start", "StartResult", "Trace",
    "default_model", "solve",
]  # fmt: skip
