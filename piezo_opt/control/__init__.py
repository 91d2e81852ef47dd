"""Control: linear designs, shapers, feedforward, and the closed loop they are judged in."""

from piezo_opt.control.closed_loop import ClosedLoop, Controller, Limits, close_loop
from piezo_opt.control.feedforward import InverseCompensation
from piezo_opt.control.linearise import linearise
from piezo_opt.control.observer import kalman
from piezo_opt.control.pid import PID
from piezo_opt.control.plant import ModelPlant, Plant
from piezo_opt.control.shapers import Shaper, ei, insensitivity, zv, zvd
from piezo_opt.control.state_feedback import StateFeedback, lqr, lqr_as_program, pole_placement

__all__ = [
    "PID",
    "ClosedLoop",
    "Controller",
    "InverseCompensation",
    "Limits",
    "ModelPlant",
    "Plant",
    "Shaper",
    "StateFeedback",
    "close_loop",
    "ei",
    "insensitivity",
    "kalman",
    "linearise",
    "lqr",
    "lqr_as_program",
    "pole_placement",
    "zv",
    "zvd",
]
