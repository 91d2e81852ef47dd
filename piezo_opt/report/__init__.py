"""Pictures and the HTML page; the only room that draws."""

from piezo_opt.report import axes as _axes  # noqa: F401 (registers its chapters)
from piezo_opt.report import diagnosis as _diagnosis  # noqa: F401 (registers its chapter)
from piezo_opt.report import linear as _linear  # noqa: F401 (registers its chapters)
from piezo_opt.report.chapters import chapter
from piezo_opt.report.html import write_report

__all__ = ["chapter", "write_report"]
