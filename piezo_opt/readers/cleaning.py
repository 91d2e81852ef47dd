"""Signs in a line of text that mean what a plainer one means, replaced before it is read.

1 234,5 and 1'234.5     digits in groups, by an unbreakable blank or an apostrophe
\u22125                      a minus that is no hyphen
1.25D-03                an exponent as Fortran writes it
zeros, end-of-file      what a logger that was broken off, or an old system, leaves at an end
"""

from __future__ import annotations

import re
from typing import Final

_GROUP: Final = re.compile(r"(?<=\d)['\u2019\u00a0\u202f\u2009](?=\d{3}(?!\d))")
_EXPONENT: Final = re.compile(r"(?<=[\d.])[dD](?=[+-]\d{1,3}(?!\w))")
_ODD: Final = re.compile(r"['\u2019\u00a0\u202f\u2009\u2212\ufeff\0\x1a]|[\d.][dD][+-]\d")
_ENDS: Final = "\ufeff\0\x1a"


def cleaned(line: str) -> str:
    """The line with plain signs; most lines have no other."""
    if _ODD.search(line) is None:
        return line
    plain = _GROUP.sub("", line.strip(_ENDS)).replace("\u2212", "-")
    return _EXPONENT.sub("e", plain)
