"""Functional mock-up units: a model for any tool that speaks FMI 2.0 or 3.0."""

from piezo_opt.export.fmu.verb import Unit, export_fmu

__all__ = ["Unit", "export_fmu"]
