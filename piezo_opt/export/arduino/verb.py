"""``export_arduino``: a sketch folder, as the Arduino environment opens it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, final

import numpy as np

from piezo_opt.control import InverseCompensation
from piezo_opt.errors import InputError
from piezo_opt.export.arduino.text import SHAPES, SKETCH
from piezo_opt.export.c import naming
from piezo_opt.export.c.printer import FLOAT
from piezo_opt.export.c.verb import planned
from piezo_opt.export.c.writer import text
from piezo_opt.export.folder import appearing, check_new
from piezo_opt.export.given import Given, Source, given
from piezo_opt.export.laws import inverse_compensation
from piezo_opt.units import quantity, show

_BAUD: Final = 115200


@final
@dataclass(frozen=True, eq=False)
class Sketch:
    """A sketch that was written.

    Attributes:
        folder: where it is.
        files: names of the files in it.
        sentence: what it does.
    """

    folder: Path
    files: tuple[str, ...]
    sentence: str

    def __str__(self) -> str:
        return f"{self.folder}: {', '.join(self.files)}; {self.sentence}."


def export_arduino(
    source: Source,
    folder: str | os.PathLike[str],
    *,
    values: Mapping[str, float] | None = None,
    signal: str = "triangle",
    low: str | float = 0.0,
    high: str | float = 125.0,
    period: str | float = "50 s",
    step: str | float = "50 ms",
    periods: int = 0,
    full_scale: str | float = "150 V",
    pin: int = 9,
    inverse: bool = False,
) -> Sketch:
    """Write a sketch that plays a signal to an actuator, with its model running beside it.

    By default the triangle of Abdullahi's thesis (2015), 0 to 125 V and back in 50 s; with
    ``signal="square"``, ``period="1 s"`` its square wave. With ``inverse`` the signal is the
    position that is wanted and the drive is what brings the actuator there, ``u = (r + h) / d_e``
    (its Eq. 3.14).

    Args:
        source: a fit, a diagnosis, a model, or a file of any of them.
        folder: is made; its name becomes that of the sketch.
        values: SI values by full name that go before those of the source.
        signal: ``"triangle"`` or ``"square"``.
        low, high: ends of the signal: drive [V], or position [m] with ``inverse``.
        period: of the signal [s].
        step: between two samples [s], whole milliseconds.
        periods: after which the drive goes to zero; 0 for never.
        full_scale: drive at the largest value of the pin [V].
        pin: number of the pin.
        inverse: whether the signal is a position.

    Raises:
        InputError: the folder exists, or an argument makes no sense.
        ModelError: the model has no inverse of this kind, or holds what C cannot say.
    """
    target = check_new(folder)
    word = naming.prefix(target.name)
    if signal not in SHAPES:
        raise InputError(f"signal = {signal!r}: there are {', '.join(SHAPES)}")
    unit = "m" if inverse else "V"
    ends = quantity(low, unit), quantity(high, unit)
    length, every, most = quantity(period, "s"), quantity(step, "s"), quantity(full_scale, "V")
    times = {"step_ms": round(1e3 * every), "period_ms": round(1e3 * length)}
    exact = abs(times["step_ms"] - 1e3 * every) + abs(times["period_ms"] - 1e3 * length) < 1e-6
    if not exact or times["step_ms"] < 1 or every > 0.5 * length:
        raise InputError(
            f"step = {show(every, 's')}, period = {show(length, 's')}: take whole milliseconds, "
            "and at least two samples a period"
        )
    if not ends[0] < ends[1] or not most > 0.0:
        raise InputError(
            f"low = {low}, high = {high}, full_scale = {full_scale}: the lower end comes first, "
            "and the full scale is positive"
        )
    if not inverse and ends[1] > most:
        raise InputError(f"high = {high} is above full_scale = {full_scale}: the pin ends there")
    if periods < 0 or not 0 <= pin <= 53:
        raise InputError(f"periods = {periods}, pin = {pin}: give numbers from 0 on")
    what = given(source, values)
    law = InverseCompensation.of_values(what.model, what.values) if inverse else None
    begin = 0.0 if inverse else ends[0]
    ready, _, _ = planned(
        what, step=every, replayed=None, name=_model_name(word), substeps=None,
        drive=(min(0.0, begin), most),
    )  # fmt: skip
    header, body = text(ready, FLOAT)
    files = {f"{ready.prefix}.h": header, f"{ready.prefix}.c": body}
    if law is not None:
        files["inverse.h"], files["inverse.c"] = inverse_compensation(law, "inverse", FLOAT)
    shape_words, shape = SHAPES[signal]
    goal = "position" if inverse else "drive"
    span = " to ".join(show(end, unit) for end in ends)
    sentence = f"a {signal} of {span} in {show(length, 's')} as the {goal}"
    numbers = {
        "low": ends[0], "high": ends[1], "full_scale": most, "begin": begin,
    }  # fmt: skip
    sketch = SKETCH.format(
        n=ready.prefix, title=f"{word}: {naming.plain(_title(what))}",
        what=naming.plain(f"{sentence[0].upper()}{sentence[1:]}."),
        **times, full_volts=show(most, "V"), baud=_BAUD, pin=pin, periods=periods,
        **{key: FLOAT.number(float(np.float32(value))) for key, value in numbers.items()},
        include='#include "inverse.h"\n' if law is not None else "",
        signal_words=f"ends of the signal: {goal} [{unit}]", shape_words=shape_words, shape=shape,
        declare="inverse law;\n" if law is not None else "",
        setup="inverse_init(&law);\n    " if law is not None else "",
        drive="inverse_act(&law, wanted, 0.0f, FULL_SCALE)" if law is not None else "wanted",
        scale=" * METRE" if inverse else "",
    )  # fmt: skip
    files = {f"{target.name}.ino": sketch, **files}
    with appearing(target) as scratch:
        for file, said in files.items():
            (scratch / file).write_text(said, encoding="utf-8")
    return Sketch(target, tuple(files), sentence)


def _model_name(word: str) -> str:
    """The prefix of the model, which the sketch's own file does not have."""
    return "actuator" if word != "actuator" else "model_of_actuator"


def _title(what: Given) -> str:
    return f"{' + '.join(what.model.names)}, from {what.told}."
