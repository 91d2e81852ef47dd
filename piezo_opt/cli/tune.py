"""``piezo-opt tune``: controllers for a fitted actuator, one file each."""

from piezo_opt.cli import (  # noqa: F401 (their commands)
    tune_feedforward,
    tune_lqr,
    tune_mpc,
    tune_pid,
    tune_shaper,
)
from piezo_opt.cli.tuning import tune

__all__ = ["tune"]
