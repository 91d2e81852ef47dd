"""Control: linear designs, shapers, feedforward, and the closed loop they are judged in."""

from piezo_opt.control.closed_loop import ClosedLoop, Controller, Limits, close_loop
from piezo_opt.control.cost import Criterion
from piezo_opt.control.feedforward import InverseCompensation
from piezo_opt.control.identified import Identified, identified
from piezo_opt.control.linear_law import LinearLaw
from piezo_opt.control.linearise import linearise
from piezo_opt.control.lqg import LQG
from piezo_opt.control.margins import Margins, margins
from piezo_opt.control.modes import Mode, modes
from piezo_opt.control.moving_horizon import MovingHorizon
from piezo_opt.control.mpc import MPC
from piezo_opt.control.observe import Observer
from piezo_opt.control.observer import kalman
from piezo_opt.control.optimal_feedforward import Feedforward, optimal_feedforward
from piezo_opt.control.pid import PID
from piezo_opt.control.plant import ModelPlant, Plant
from piezo_opt.control.robust_shaper import robust
from piezo_opt.control.scenarios import scenarios
from piezo_opt.control.shapers import Shaper, ei, insensitivity, zv, zvd
from piezo_opt.control.state_feedback import StateFeedback, lqr, lqr_as_program, pole_placement
from piezo_opt.control.tune_loop import Tuned
from piezo_opt.control.tune_lqr import tune_lqr
from piezo_opt.control.tune_mpc import TunedMPC, tune_mpc
from piezo_opt.control.tune_pid import tune_pid
from piezo_opt.control.tune_shaper import TunedShaper, tune_shaper

__all__ = [
    "LQG",
    "MPC",
    "PID",
    "ClosedLoop",
    "Controller",
    "Criterion",
    "Feedforward",
    "Identified",
    "InverseCompensation",
    "Limits",
    "LinearLaw",
    "Margins",
    "Mode",
    "ModelPlant",
    "MovingHorizon",
    "Observer",
    "Plant",
    "Shaper",
    "StateFeedback",
    "Tuned",
    "TunedMPC",
    "TunedShaper",
    "close_loop",
    "ei",
    "identified",
    "insensitivity",
    "kalman",
    "linearise",
    "lqr",
    "lqr_as_program",
    "margins",
    "modes",
    "optimal_feedforward",
    "pole_placement",
    "robust",
    "scenarios",
    "tune_lqr",
    "tune_mpc",
    "tune_pid",
    "tune_shaper",
    "zv",
    "zvd",
]
