"""The command ``piezo-opt``: parse, call, print."""

from piezo_opt.cli.app import app, main

__all__ = ["app", "main"]
