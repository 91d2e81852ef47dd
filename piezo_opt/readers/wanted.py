"""What a caller says about a file, and what is done to its signals because of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, TypeVar, final

from piezo_opt.choosing import expected
from piezo_opt.errors import InputError
from piezo_opt.measurement import Between, Measurement
from piezo_opt.units import factor, quantity, show, si_unit

_TEXTS: Final = {"time": "1 [s]", "position": "3 [um]", "trim": "2 s:8 s"}


@final
@dataclass(frozen=True)
class Wanted:
    """Names of columns, the clock, what the record is, and how its signals are treated.

    Attributes:
        time, drive, position: columns by name, number or ``"name [unit]"``.
        between, period, startup, allow_saturated: as in `Measurement`.
        rate: of an even clock, ``"1 kHz"`` or [Hz]; ``"even"`` for one between the ends of the
            column of time.
        trim: ``"2 s:8 s"``; either end may be left out.
        every: every n-th sample is kept, after a filter.
        gain: of an amplifier that the drive was recorded before.
        scale: what one unit of the position's column is, ``"2.5 um/V"``, or a plain factor.
        decimal: sign of decimals in a text file.
    """

    time: str | None = None
    drive: str | None = None
    position: str | None = None
    between: Between | None = None
    period: float | str | None = None
    startup: float | str | None = None
    allow_saturated: bool = False
    rate: float | str | None = None
    trim: str | None = None
    every: int = 1
    gain: float | str | None = None
    scale: float | str | None = None
    decimal: str | None = None

    def __post_init__(self) -> None:
        if self.decimal not in (None, ".", ","):
            raise InputError(f"decimal is '.' or ',', not {self.decimal!r}")
        if isinstance(self.every, bool) or not isinstance(self.every, int) or self.every < 1:
            raise InputError(f"every is a number of samples from 1 on, not {self.every!r}")
        for what in ("time", "drive", "position", "trim"):
            if (said := getattr(self, what)) is not None:
                example = f"{what}='{_TEXTS.get(what, '2 [V]')}'"
                expected(str, said, what, f"a text, {example}")
                if not said.strip():
                    raise InputError(f"{what} is an empty text: leave it out, or give {example}")
        for value in (self.stretch, self.hertz, self.amplification, self.factor):
            del value  # a wrong one is refused here and not in the middle of a file

    @property
    def stretch(self) -> tuple[float | None, float | None]:
        """Beginning and end of what is kept [s]; None for an end that is left out."""
        if self.trim is None:
            return None, None
        begin, colon, end = self.trim.partition(":")
        example = "write for example '2 s:8 s', '2 s:' or ':8 s'"
        if not colon or not (begin.strip() or end.strip()):
            raise InputError(f"trim={self.trim!r} is no stretch of time: {example}")
        ends = [_said("trim", one.strip(), "s") if one.strip() else None for one in (begin, end)]
        if ends[0] is not None and ends[1] is not None and ends[0] >= ends[1]:
            raise InputError(f"trim={self.trim!r} ends before it begins: {example}")
        return ends[0], ends[1]

    @property
    def hertz(self) -> float | None:
        """The rate of an even clock [Hz]; None for none, or one between the ends."""
        if self.rate is None or self.rate == "even":
            return None
        hertz = _said("rate", self.rate, "Hz")
        if hertz <= 0.0:
            raise InputError(f"rate is {hertz:g} Hz: give a positive one, rate='1 kHz'")
        return hertz

    @property
    def amplification(self) -> float | None:
        """The amplifier's gain [1]."""
        if self.gain is None:
            return None
        value = _said("gain", self.gain, "1")
        if value == 0.0:
            raise InputError("gain is 0: give the amplification of the drive, gain=15")
        return value

    @property
    def factor(self) -> tuple[float, str] | None:
        """The scale in SI, and its unit."""
        if self.scale is None:
            return None
        value, unit = (
            _named("scale", self.scale, factor)
            if isinstance(self.scale, str)
            else (_said("scale", self.scale, "1"), "1")
        )
        if value == 0.0:
            raise InputError("scale is 0: give what one unit of the reading is, scale='2.5 um/V'")
        return value, unit

    def scaled_unit(self, unit: str) -> str:
        """What a position in a unit is measured in after the scale."""
        _, own = self.factor or (1.0, "1")
        return si_unit(unit) if own == "1" else si_unit(f"{own}*{si_unit(unit)}")


def _said(what: str, value: float | str, unit: str) -> float:
    """A quantity that an option gives."""
    return _named(what, value, lambda one: quantity(one, unit))


_Value = TypeVar("_Value", str, float | str)
_Read = TypeVar("_Read")


def _named(what: str, value: _Value, read: Callable[[_Value], _Read]) -> _Read:
    """What an option gives; the sentence about a wrong one begins with the option's name."""
    try:
        return read(value)
    except InputError as error:
        begins = str(error).startswith(repr(value))
        raise InputError(f"{what}={error}" if begins else f"{what}={value!r}: {error}") from error


def treated(record: Measurement, wanted: Wanted) -> Measurement:
    """The record after gain, scale and thinning; each is said in a note."""
    notes = list(record.notes)
    drive, position, unit = record.drive, record.position, record.position_unit
    if (gain := wanted.amplification) is not None:
        drive = gain * drive
        notes.append(f"The drive was multiplied by {gain:g}, the gain of the amplifier.")
    if wanted.factor is not None:
        unit = wanted.scaled_unit(unit)
        position = wanted.factor[0] * position
        notes.append(f"The reading was multiplied by {wanted.scale}.")
    if notes != list(record.notes):
        record = record.with_(
            drive=drive, position=position, position_unit=unit, notes=tuple(notes)
        )
    return record if wanted.every == 1 else _thinned(record, wanted.every)


def _thinned(record: Measurement, every: int) -> Measurement:
    """Every n-th sample, after a filter that takes out what they cannot carry."""
    if not record.uniform:
        raise InputError(
            f"{record.name}: every={every} filters first, which needs an even clock: give "
            "rate='...' where the clock only looks uneven, or take record.resample(rate='...')"
        )
    fewer = record.resample(step=every * record.step)
    return fewer.with_(
        notes=(
            *record.notes,
            f"Every {_th(every)} sample was kept, after a low-pass filter at "
            f"{show(0.4 * fewer.rate, 'Hz')} on drive and reading: nothing above "
            f"{show(0.5 * fewer.rate, 'Hz')} is left.",
        )
    )


def _th(number: int) -> str:
    ending = {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{'th' if number % 100 in (11, 12, 13) else ending}"
