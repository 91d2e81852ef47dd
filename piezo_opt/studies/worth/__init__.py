"""What a diagnosis is worth to a controller, on plants that share no code with the package."""

from piezo_opt.studies.worth.designs import CONTROLLERS
from piezo_opt.studies.worth.models import MODELS
from piezo_opt.studies.worth.study import Judged, Tracked, Worth, study_worth

__all__ = ["CONTROLLERS", "MODELS", "Judged", "Tracked", "Worth", "study_worth"]
