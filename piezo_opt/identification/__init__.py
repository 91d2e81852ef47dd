"""Identification: the question, its transcriptions and solvers, and the answer."""

from piezo_opt.identification.bootstrap import Bootstrap, bootstrap
from piezo_opt.identification.collocation import Collocation
from piezo_opt.identification.default import default_model, is_lag, ringing
from piezo_opt.identification.driven import as_driven
from piezo_opt.identification.expected import priors_from
from piezo_opt.identification.monitor import Progress
from piezo_opt.identification.multiple_shooting import MultipleShooting
from piezo_opt.identification.outcome import Ending, Evaluations, Outcome, Trace
from piezo_opt.identification.problem import Identification, Loss, Prior, Shape, Start
from piezo_opt.identification.profile import Profile, Profiles, profile_likelihood
from piezo_opt.identification.result import Fit, StartResult
from piezo_opt.identification.solve import solve, with_statistics
from piezo_opt.identification.solvers.cma_es import CmaEs
from piezo_opt.identification.solvers.differential_evolution import DifferentialEvolution
from piezo_opt.identification.solvers.levenberg_marquardt import LevenbergMarquardt
from piezo_opt.identification.solvers.nelder_mead import NelderMead
from piezo_opt.identification.solvers.nonlinear_program import Fatrop, Ipopt, Sqp
from piezo_opt.identification.solvers.scipy_least_squares import ScipyLeastSquares
from piezo_opt.identification.storage import load_fit, save_fit
from piezo_opt.identification.transcription import SingleShooting

__all__ = [
    "Bootstrap",
    "CmaEs",
    "Collocation",
    "DifferentialEvolution",
    "Ending",
    "Evaluations",
    "Fatrop",
    "Fit",
    "Identification",
    "Ipopt",
    "LevenbergMarquardt",
    "Loss",
    "MultipleShooting",
    "NelderMead",
    "Outcome",
    "Prior",
    "Profile",
    "Profiles",
    "Progress",
    "ScipyLeastSquares",
    "Shape",
    "SingleShooting",
    "Sqp",
    "Start",
    "StartResult",
    "Trace",
    "as_driven",
    "bootstrap",
    "default_model",
    "is_lag",
    "load_fit",
    "priors_from",
    "profile_likelihood",
    "ringing",
    "save_fit",
    "solve",
    "with_statistics",
]
