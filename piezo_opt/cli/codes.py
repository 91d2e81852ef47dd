"""Exit codes of the commands; the rest of the package is not loaded for them."""

from __future__ import annotations

from typing import Final

FAILED: Final = 1
"""An error of the program itself, or an output that could not be written."""
BAD_INPUT: Final = 2
INTERRUPTED: Final = 130
"""After Ctrl-C, as shells give it: 128 and the number of the signal."""
