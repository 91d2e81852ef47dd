"""The thesis' numbers beside ours, each from its own records or equations.

*Modelling and Control of Hysteresis and Vibration in Piezoelectric Actuator* (Universiti Teknologi
Malaysia, 2015).
"""

from piezo_opt.studies.row import Study
from piezo_opt.studies.thesis.control import control_rows
from piezo_opt.studies.thesis.hysteresis import hysteresis_rows
from piezo_opt.studies.thesis.records import record_rows
from piezo_opt.studies.thesis.solids import solid_rows
from piezo_opt.studies.thesis.transfer import loop_rows, vibration_rows


def study_thesis() -> Study:
    """Everything, computed now: some ten seconds."""
    return Study(
        "Modelling and Control of Hysteresis and Vibration in Piezoelectric Actuator (UTM, 2015)",
        (
            ("Records", record_rows()),
            ("Transfer function of the loop", loop_rows()),
            ("Hysteresis", hysteresis_rows()),
            ("Transfer function of the vibration", vibration_rows()),
            ("Control", control_rows()),
            ("Finite elements", solid_rows()),
        ),
    )


__all__ = ["study_thesis"]
