"""Control: linear designs, shapers, feedforward, and the closed loop they are judged in."""

from piezo_opt.control.closed_loop import ClosedLoop, Controller, Limits, close_loop
from piezo_opt.control.cost import Criterion
from piezo_opt.control.feedforward import InverseCompensation
from piezo_opt.control.linearise import linearise
from piezo_opt.control.margins import Margins, margins
from piezo_opt.control.mpc import MPC
from piezo_opt.control.observe import Observer
from piezo_opt.control.observer import kalman
from piezo_opt.control.pid import PID
from piezo_opt.control.plant import ModelPlant, Plant
from piezo_opt.control.scenarios import scenarios
from piezo_opt.control.shapers import Shaper, ei, insensitivity, zv, zvd
from piezo_opt.control.state_feedback import StateFeedback, lqr, lqr_as_program, pole_placement
from piezo_opt.control.tune_pid import TunedPID, tune_pid

__all__ = [
    "MPC",
    "PID",
    "ClosedLoop",
    "Controller",
    "Criterion",
    "InverseCompensation",
    "Limits",
    "Margins",
    "ModelPlant",
    "Observer",
    "Plant",
    "Shaper",
    "StateFeedback",
    "TunedPID",
    "close_loop",
    "ei",
    "insensitivity",
    "kalman",
    "linearise",
    "lqr",
    "lqr_as_program",
    "margins",
    "pole_placement",
    "scenarios",
    "tune_pid",
    "zv",
    "zvd",
]
