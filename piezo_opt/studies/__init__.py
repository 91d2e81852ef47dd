"""Studies: what others published beside ours, and what a diagnosis is worth."""

from piezo_opt.studies.row import Row, Study
from piezo_opt.studies.thesis import study_thesis
from piezo_opt.studies.worth import Worth, study_worth

__all__ = ["Row", "Study", "Worth", "study_thesis", "study_worth"]
