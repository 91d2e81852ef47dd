"""Studies: what others published beside what is computed here, from one run."""

from piezo_opt.studies.row import Row, Study
from piezo_opt.studies.thesis import study_thesis

__all__ = ["Row", "Study", "study_thesis"]
