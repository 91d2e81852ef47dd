"""The workbench: compare, see, learn, add, and watch the error fall, in a browser."""

from piezo_opt.workbench.serve import serve
from piezo_opt.workbench.session import Session, read_session

__all__ = ["Session", "read_session", "serve"]
