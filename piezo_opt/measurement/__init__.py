"""Records of an actuator: time, drive, position, and what is known about how they were taken."""

from piezo_opt.measurement.arrays import FloatArray
from piezo_opt.measurement.axes import AxesCampaign, AxesRecord
from piezo_opt.measurement.between import Between
from piezo_opt.measurement.campaign import Campaign
from piezo_opt.measurement.check import Check, check
from piezo_opt.measurement.checks import FEWEST_SAMPLES
from piezo_opt.measurement.findings import Finding, Weight
from piezo_opt.measurement.record import Measurement

__all__ = [
    "FEWEST_SAMPLES",
    "AxesCampaign",
    "AxesRecord",
    "Between",
    "Campaign",
    "Check",
    "Finding",
    "FloatArray",
    "Measurement",
    "Weight",
    "check",
]
