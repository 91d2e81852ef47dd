"""A sketch for an Arduino: a signal, or the drive that makes the actuator follow it."""

from piezo_opt.export.arduino.verb import Sketch, export_arduino

__all__ = ["Sketch", "export_arduino"]
