"""Diagnosis: where a model fails, which effect is missing, and whether adding it holds."""

from piezo_opt.diagnosis.diagnose import Diagnosis, diagnose

__all__ = ["Diagnosis", "diagnose"]
