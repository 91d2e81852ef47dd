"""The thesis' numbers beside ours, each from its own records or equations.

*Modelling and Control of Hysteresis and Vibration in Piezoelectric Actuator* (Universiti Teknologi
Malaysia, 2015).
"""

from collections.abc import Callable

from piezo_opt.studies.row import Row, Study
from piezo_opt.studies.thesis.control import control_rows
from piezo_opt.studies.thesis.hysteresis import hysteresis_rows
from piezo_opt.studies.thesis.records import record_rows
from piezo_opt.studies.thesis.solids import solid_rows
from piezo_opt.studies.thesis.transfer import loop_rows, vibration_rows


def study_thesis(progress: Callable[[str], None] | None = None) -> Study:
    """Everything, computed now: some ten seconds.

    Args:
        progress: told what is next.
    """
    parts: tuple[tuple[str, Callable[[], tuple[Row, ...]]], ...] = (
        ("Records", record_rows),
        ("Transfer function of the loop", loop_rows),
        ("Hysteresis", hysteresis_rows),
        ("Transfer function of the vibration", vibration_rows),
        ("Control", control_rows),
        ("Finite elements", solid_rows),
    )
    done = []
    for name, rows in parts:
        if progress is not None:
            progress(name)
        done.append((name, rows()))
    return Study(
        "Modelling and Control of Hysteresis and Vibration in Piezoelectric Actuator (UTM, 2015)",
        tuple(done),
    )


__all__ = ["study_thesis"]
