"""Instants written as text: a date with a clock, the clock of a day, or the time that went by."""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import date
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_opt.measurement import FloatArray

_CLOCK = (
    r"(?P<hour>\d{1,4}):(?P<minute>\d{2}):(?P<second>\d{2})(?:[.,](?P<part>\d*)|:(?P<milli>\d{3}))?"
    r"\s*(?P<half>[AaPp][Mm])?"
)
# Without hours the seconds have decimals: 12:30 is half past twelve.
_SHORT = r"(?P<minutes>\d{1,4}):(?P<seconds>\d{2}[.,]\d+)"
_ZONE = r"\s*(?:Z|(?P<sign>[+-])(?P<ahead>\d{2}):?(?P<ahead_minutes>\d{2})|UTC)?"
_DATE = (
    r"(?:(?P<year>\d{4})[-/.](?P<month>\d{1,2})[-/.](?P<day>\d{1,2})"
    r"|(?P<day2>\d{1,2})\.(?P<month2>\d{1,2})\.(?P<year2>\d{4})"
    r"|(?P<either>\d{1,2})[/-](?P<other>\d{1,2})[/-](?P<year3>\d{4}))"
)
_INSTANT = re.compile(rf"\s*(?:(?:{_DATE}(?:[T_]|\s+))?{_CLOCK}{_ZONE}|{_SHORT})\s*")
_DAY = 86400.0


def is_instant(cell: str) -> bool:
    """Whether a cell is a clock such as 12:30:05.25, with or without a date before it."""
    return ":" in cell and _INSTANT.fullmatch(cell) is not None


def seconds_reader() -> Callable[[str], float]:
    """A function from an instant to seconds [s] since the midnight before the first one.

    Counted from there a microsecond survives in double precision; from the year 1 it would not.
    Without a date hours may go beyond a day: time that went by. Of 12/31/2020 and 31/12/2020 it is
    said by the numbers which is the month; where it is not, only instants of one day are read.
    The function raises `ValueError` for what is no instant.
    """
    first: list[_Day] = []

    def seconds_of(cell: str) -> float:
        match = _INSTANT.fullmatch(cell)
        if match is None:
            raise ValueError(f"{cell[:40]!r} is not a time")
        if match["minutes"]:
            return 60.0 * int(match["minutes"]) + float(match["seconds"].replace(",", "."))
        hours, half = int(match["hour"]), match["half"]
        if half:
            hours = hours % 12 + (12 if half.upper() == "PM" else 0)
        day = _day_of(match)
        if int(match["minute"]) > 59 or (hours > 23 and (day is not None or half)):
            raise ValueError(f"{cell[:40]!r} is not a time of day")
        digits = match["part"] or match["milli"] or "0"
        seconds = (
            3600.0 * hours + 60.0 * int(match["minute"]) + float(f"{match['second']}.{digits}")
        )
        if match["sign"]:
            away = 3600.0 * int(match["ahead"]) + 60.0 * int(match["ahead_minutes"])
            seconds += -away if match["sign"] == "+" else away
        if day is not None:
            if not first:
                first.append(day)
            seconds += _DAY * _days_since(first[0], day)
        return seconds

    return seconds_of


_Day = tuple[int | None, int | None]
"""Number of a day where the month is the first number and where it is the second; None for none."""


def _day_of(match: re.Match[str]) -> _Day | None:
    """The day of an instant; None without a date. `ValueError` for one that no calendar has."""
    if match["either"]:
        one, other, year = int(match["either"]), int(match["other"]), int(match["year3"])
        found = _day(year, one, other), _day(year, other, one)
    elif match["year"] or match["year2"]:
        known = "" if match["year"] else "2"
        number = _day(*(int(match[part + known]) for part in ("year", "month", "day")))
        found = number, number
    else:
        return None
    if found == (None, None):
        raise ValueError("there is no such day")
    return found


def _days_since(first: _Day, day: _Day) -> int:
    """Days from one to another, where both ways to read them agree or only one is possible."""
    found = {b - a for a, b in zip(first, day, strict=True) if a is not None and b is not None}
    if len(found) != 1:
        raise ValueError("which number is the month is not known: write dates as 2020-12-31")
    return found.pop()


def dated(cell: str) -> bool:
    """Whether the instant has a date."""
    match = _INSTANT.fullmatch(cell)
    return match is not None and bool(match["year"] or match["year2"] or match["year3"])


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
def _day(year: int, month: int, day: int) -> int | None:
    try:
        return date(year, month, day).toordinal()
    except ValueError:
        return None
