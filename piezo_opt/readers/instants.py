"""Instants written as text: a date with a clock, or the clock of a day."""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import date
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_opt.measurement import FloatArray

_CLOCK = r"(\d{1,2}):(\d{2}):(\d{2}(?:[.,]\d*)?)\s*([AaPp][Mm])?"
_ZONE = r"\s*(?:Z|([+-])(\d{2}):?(\d{2})|UTC)?"
_DATE = r"(?:(\d{4})[-/.](\d{1,2})[-/.](\d{1,2})|(\d{1,2})\.(\d{1,2})\.(\d{4}))"
_INSTANT = re.compile(rf"\s*(?:{_DATE}(?:[T_]|\s+))?{_CLOCK}{_ZONE}\s*")
_DAY = 86400.0


def is_instant(cell: str) -> bool:
    """Whether a cell is a clock such as 12:30:05.25, with or without a date before it."""
    return ":" in cell and _INSTANT.fullmatch(cell) is not None


def seconds_reader() -> Callable[[str], float]:
    """A function from an instant to seconds [s] since the midnight before the first one.

    Counted from there a microsecond survives in double precision; from the year 1 it would not.
    The function raises `ValueError` for what is no instant.
    """
    first: list[int] = []

    def seconds_of(cell: str) -> float:
        match = _INSTANT.fullmatch(cell)
        if match is None:
            raise ValueError(f"{cell[:40]!r} is not a time")
        y, m, d, d2, m2, y2, hour, minute, second, half, sign, ahead, minutes = match.groups()
        hours = int(hour)
        if half:
            hours = hours % 12 + (12 if half.upper() == "PM" else 0)
        if hours > 23 or int(minute) > 59:
            raise ValueError(f"{cell[:40]!r} is not a time of day")
        seconds = 3600.0 * hours + 60.0 * int(minute) + float(second.replace(",", "."))
        if sign:
            away = 3600.0 * int(ahead) + 60.0 * int(minutes)
            seconds += -away if sign == "+" else away
        if y or y2:
            day = _day(int(y or y2), int(m or m2), int(d or d2))
            if not first:
                first.append(day)
            seconds += _DAY * (day - first[0])
        return seconds

    return seconds_of


def dated(cell: str) -> bool:
    """Whether the instant has a date."""
    match = _INSTANT.fullmatch(cell)
    return match is not None and bool(match[1] or match[6])


def since_first(instants: FloatArray, *, with_dates: bool) -> FloatArray:
    """Seconds since the first instant; clocks without dates go on over midnight."""
    time = instants - instants[0]
    if not with_dates:
        midnights = np.cumsum(np.concatenate([[False], np.diff(time) < -0.5 * _DAY]))
        time = time + _DAY * midnights
    return np.asarray(time, dtype=np.float64)


def seconds_from_stamps(stamps: NDArray[Any]) -> FloatArray:
    """Stamps or spans of time (N,) as seconds since the first one [s]; not a number where none."""
    spans = (stamps - stamps[0]).astype("timedelta64[ns]") if stamps.size else stamps
    seconds = spans.astype(np.int64) * 1e-9
    return np.where(np.isnat(spans), np.nan, seconds) if stamps.size else np.zeros(0)


@lru_cache(maxsize=64)
def _day(year: int, month: int, day: int) -> int:
    return date(year, month, day).toordinal()
