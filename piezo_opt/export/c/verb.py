"""``export_c``: a folder of C that stands alone and has been shown to read what the model reads."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, final

import numpy as np

from piezo_opt.errors import InputError, ModelError
from piezo_opt.export.boards import Footprint, available, measure
from piezo_opt.export.c import beside, naming
from piezo_opt.export.c.plan import Plan, plan, system_of
from piezo_opt.export.c.printer import DOUBLE, FLOAT, Precision
from piezo_opt.export.c.replay import ADMITTED, Replay, replay
from piezo_opt.export.c.tangents import moved_by
from piezo_opt.export.c.writer import text
from piezo_opt.export.folder import appearing, check_new
from piezo_opt.export.given import Given, Source, given, interval, on, trial
from piezo_opt.export.scheme import cut
from piezo_opt.measurement import Measurement
from piezo_opt.simulation import Accuracy
from piezo_opt.simulation.compiler import find_compiler
from piezo_opt.units import show

PRECISIONS: Final[Mapping[str, Precision]] = {"double": DOUBLE, "float": FLOAT}
_RANGE: Final = (0.0, 100.0)
"""Drive [V] of a model that comes without a record and without a range."""
_ROWS: Final = 200
"""Samples that are run on a board: their table fits into its memory."""


@final
@dataclass(frozen=True, eq=False)
class Exported:
    """What was written.

    Attributes:
        folder: where it is.
        files: names of the files in it.
        accuracy: sub-steps, and the error of the scheme that they leave [m].
        replay: the compiled code beside the library; None where there is no compiler.
        pruned: effects at their null, which are not in the code.
        remarks: what else to know, in sentences.
        footprints: what the code takes on boards, where that was asked for.
    """

    folder: Path
    files: tuple[str, ...]
    accuracy: Accuracy
    replay: Replay | None
    pruned: tuple[str, ...]
    remarks: tuple[str, ...]
    footprints: tuple[Footprint, ...] = ()

    def __str__(self) -> str:
        checked = (
            "not compiled here: there is no C compiler" if self.replay is None else self.replay
        )
        lines = [f"{self.folder}: {', '.join(self.files)}; {checked}."]
        lines += [f"{one}." for one in self.footprints]
        return "\n".join([*lines, *(f"Remark: {one}" for one in self.remarks)])


def export_c(
    source: Source,
    folder: str | os.PathLike[str],
    *,
    values: Mapping[str, float] | None = None,
    step: str | float | None = None,
    precision: str = "double",
    replay: Measurement | None = None,
    name: str = "actuator",
    substeps: int | None = None,
    drive: tuple[float, float] | None = None,
    boards: Sequence[str] = (),
    sensitivities: bool = False,
) -> Exported:
    """Write a model as C99 that needs nothing but libm.

    The scheme is the library's own: the classical Runge-Kutta scheme on sub-steps that are limited
    in time and in the way of the drive. The code is compiled and replayed on a record before the
    folder appears.

    Args:
        source: a fit, a diagnosis (its final model), a model, or a file of any of them.
        folder: is made; must not exist.
        values: SI values by full name that go before those of the source.
        step: time between two calls [s or text]; by default that of the record.
        precision: ``"double"``, or ``"float"`` and nothing wider.
        replay: a record that the fit has not seen, for the check; by default the fit's own, or a
            drive made up for it.
        name: prefix of every symbol and name of the files.
        substeps: in every interval; by default chosen so that the scheme errs by 1e-6 of the
            reading's range on the record.
        drive: range of the drive [V] for a model without a record.
        boards: ``"atmega328p"``, ``"cortex-m4f"``: the float code is built and run there, too.
        sensitivities: whether ``step_sensitivities`` is written as well: the derivatives of the
            reading by all parameters, carried along as forward tangents of the same scheme.

    Raises:
        InputError: the folder exists, tools of a board are not installed, the step is too long
            for the model, the record lacks a channel, or an argument makes no sense.
        ModelError: the model holds what C cannot say, or the code does not read what the library
            reads; nothing is written then.
    """
    check_new(folder)
    return write_c(
        given(source, values), folder, step=step, precision=precision, replayed=replay, name=name,
        substeps=substeps, drive=drive, boards=boards, sensitivities=sensitivities,
    )  # fmt: skip


def planned(
    what: Given,
    *,
    step: str | float | None,
    replayed: Measurement | None,
    name: str,
    substeps: int | None,
    drive: tuple[float, float] | None,
    sensitivities: bool = False,
) -> tuple[Plan, Accuracy, Measurement]:
    """The equations with their sub-steps, and the record on which they were chosen."""
    naming.prefix(name)
    known = replayed or what.record
    every = interval(step, known, what.sampling)
    system = system_of(what)
    if known is None:
        low, high = drive or (what.sampling[1:] if what.sampling else _RANGE)
        if not low < high:
            raise InputError(f"drive = {drive}: give the lower end of the range first")
        nominal = {c: 293.15 if c == "temperature" else 1.0 for c in system.channel_names}
        known = trial(every, low, high, nominal)
    record = on(known, what.model)
    accuracy = cut(what.model, what.values, record, every, substeps)
    ready = plan(what, system, name, accuracy.substeps, every, sensitivities)
    return ready, accuracy, record


def write_c(
    what: Given,
    folder: str | os.PathLike[str],
    *,
    step: str | float | None = None,
    precision: str = "double",
    replayed: Measurement | None = None,
    name: str = "actuator",
    substeps: int | None = None,
    drive: tuple[float, float] | None = None,
    boards: Sequence[str] = (),
    sensitivities: bool = False,
) -> Exported:
    """As :func:`export_c`, of what has been read already."""
    if precision not in PRECISIONS:
        raise InputError(f"precision = {precision!r}: take 'double' or 'float'")
    numbers = PRECISIONS[precision]
    if boards and not numbers.is_float:
        raise InputError("boards: they count in float: give precision='float' (--float)")
    for board in boards:
        available(board)
    compiler = find_compiler()
    if replayed is not None and compiler is None:
        raise InputError(
            "There is no C compiler to replay the record with: install gcc or clang, or leave the "
            "record out and compare with main.c where there is one."
        )
    ready, accuracy, record = planned(
        what, step=step, replayed=replayed, name=name, substeps=substeps, drive=drive,
        sensitivities=sensitivities,
    )  # fmt: skip
    header, source = text(ready, numbers)
    files = {
        f"{name}.h": header,
        f"{name}.c": source,
        "main.c": beside.program(ready, numbers, record.position_unit),
        "CMakeLists.txt": beside.build_file(ready),
    }
    check: Replay | None = None
    remarks: list[str] = []
    with appearing(folder) as scratch:
        for file, said in files.items():
            (scratch / file).write_text(said, encoding="utf-8")
        if compiler is not None:
            check = replay(
                scratch, name, precision, compiler, what.model, what.values, record,
                accuracy.substeps, ready.system.channel_names,
                tuple(one.full for one in moved_by(ready)) if sensitivities else (),
            )  # fmt: skip
        footprints = tuple(
            _on_board(scratch, name, board, record, ready.system.channel_names, check)
            for board in boards
        )
        told = " ".join((_checked(check), *(f"{one}." for one in footprints)))
        said = beside.read_me(ready, numbers, _scheme(ready, accuracy), told)
        (scratch / "README.md").write_text(said, encoding="utf-8")
    if replayed is None:
        remarks.append(
            f"Replayed on {record.name}: give a record that the fit has not seen (replay=, "
            "--replay) for a check on your own drive."
        )
    return Exported(
        Path(folder), (*files, "README.md"), accuracy, check, what.pruned, tuple(remarks),
        footprints,
    )  # fmt: skip


def _on_board(
    folder: Path,
    name: str,
    board: str,
    record: Measurement,
    channels: Sequence[str],
    check: Replay | None,
) -> Footprint:
    """What the code takes on a board; it must read there what it reads here."""
    some = slice(0, _ROWS)
    inputs = [record.time - record.time[0], record.drive, *(record.channels[c] for c in channels)]
    found = measure(folder, name, board, [column[some] for column in inputs])
    if check is not None:
        apart = float(np.abs(found.reading - check.reading[some]).max()) / (check.stroke or 1.0)
        if not apart <= ADMITTED["float"]:
            raise ModelError(
                f"{board}: the code reads something else there, by {apart:.1e} of the stroke; "
                "nothing was written."
            )
    return found


def _scheme(ready: Plan, accuracy: Accuracy) -> str:
    if not ready.flowing:
        return "There is nothing to integrate: the code is exact."
    cut = accuracy.substeps
    limits = [f"are no longer than {show(cut.longest, 's')}"]
    if cut.largest_move < 1e30:
        limits.append(f"move the {ready.input} by no more than {show(cut.largest_move, 'V')}")
    return (
        "The states move by the classical Runge-Kutta scheme on sub-steps that "
        f"{' and '.join(limits)}; its error is {show(accuracy.error, 'm')} rms, found by halving "
        "every sub-step. Members `longest_substep` and `largest_move` change that."
    )


def _checked(check: Replay | None) -> str:
    if check is None:
        return "The code has not been compiled here, because there was no C compiler."
    said = str(check)
    return f"{said[0].upper()}{said[1:]}."
