"""Boards on which exported code is built and run: what it takes there, and what it reads."""

from piezo_opt.export.boards.measure import BOARDS, Footprint, available, measure

__all__ = ["BOARDS", "Footprint", "available", "measure"]
