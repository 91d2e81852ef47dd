"""``export_fmu``: one file that any tool of the FMI standard imports."""

from __future__ import annotations

import hashlib
import os
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, final

from piezo_opt.errors import InputError, ModelError
from piezo_opt.export.c.plan import Plan
from piezo_opt.export.c.printer import DOUBLE
from piezo_opt.export.c.verb import planned
from piezo_opt.export.c.writer import text
from piezo_opt.export.fmu import description, fmi2, fmi3
from piezo_opt.export.fmu.build import PLATFORMS, compiler_for, library, own_platform
from piezo_opt.export.fmu.variables import variables
from piezo_opt.export.given import Source, given, interval
from piezo_opt.files import replacing
from piezo_opt.measurement import Measurement
from piezo_opt.simulation import Accuracy

VERSIONS: Final = ("2.0", "3.0")
_LINES: Final = 256
"""Lines of a delayed drive that a unit keeps at least: six kilobytes."""
_SHORTER: Final = 16
"""How many times shorter than usual an importer's steps may be before lines of a delayed drive are
joined; what is joined moves the reading by less than a step of the drive does."""
_DAY: Final = (1980, 1, 1, 0, 0, 0)
"""Date of the files in the archive: the same model gives the same bytes."""


@final
@dataclass(frozen=True, eq=False)
class Unit:
    """A functional mock-up unit that was written.

    Attributes:
        path: where it is.
        version: of the standard.
        exchange: whether it is for model exchange.
        platforms: systems that it has a library for.
        accuracy: sub-steps, and the error of the scheme that they leave [m].
        size: bytes.
    """

    path: Path
    version: str
    exchange: bool
    platforms: tuple[str, ...]
    accuracy: Accuracy
    size: int

    def __str__(self) -> str:
        kind = "model exchange" if self.exchange else "co-simulation"
        return (
            f"{self.path}: FMI {self.version}, {kind}, for {' and '.join(self.platforms)}, "
            f"{self.size / 1024:.0f} kB."
        )


def export_fmu(
    source: Source,
    path: str | os.PathLike[str],
    *,
    values: Mapping[str, float] | None = None,
    version: str = "2.0",
    exchange: bool = False,
    step: str | float | None = None,
    name: str = "actuator",
    drive: tuple[float, float] | None = None,
    record: Measurement | None = None,
    platforms: Sequence[str] = (),
    overwrite: bool = False,
) -> Unit:
    """Write a model as a functional mock-up unit, with names, units and start values.

    In co-simulation the unit integrates itself, as exported C does. Between communication points
    an input goes along a straight line: to where the rate leads that FMI 2.0 lets an importer set,
    or else to the value that was set before the step. A hysteresis loop follows the rate of the
    drive, which model exchange does not hand over: such a unit has it as a second input.

    Args:
        source: a fit, a diagnosis (its final model), a model, or a file of any of them.
        path: ends with ``.fmu``.
        values: SI values by full name that go before those of the source.
        version: of the standard, ``"2.0"`` or ``"3.0"``.
        exchange: model exchange (FMI 2.0) in the place of co-simulation.
        step: usual communication step [s or text]; by default that of the record.
        name: of the model, a word in C.
        drive: range of the drive [V] for a model without a record.
        record: on which sub-steps are chosen; by default the fit's own.
        platforms: systems to build for, by default this one: ``"linux"``, ``"windows"``,
            ``"mac"``, ``"linux-arm"``, ``"mac-arm"``.
        overwrite: whether an existing file is replaced.

    Raises:
        InputError: the file exists, the step is too long for the model, there is no compiler, or
            an argument makes no sense.
        ModelError: the model holds what C cannot say; or has states that jump, or a delay, and is
            asked for as model exchange.
    """
    target = Path(path)
    if target.suffix != ".fmu":
        raise InputError(f"{target}: a unit's file ends with .fmu")
    if version not in VERSIONS:
        raise InputError(f"version = {version!r}: take '2.0' or '3.0'")
    if exchange and version != "2.0":
        raise InputError("Model exchange is written for FMI 2.0: leave version= out.")
    systems = tuple(dict.fromkeys(platforms)) or (own_platform(),)
    for system in systems:
        compiler_for(system)
    folders = [PLATFORMS[system].names[VERSIONS.index(version)] for system in systems]
    if len(set(folders)) < len(folders):
        raise InputError(
            "FMI 2.0 has one folder for both processors of a system: take version='3.0', or write "
            "a file for each."
        )
    with replacing(target, overwrite=overwrite) as scratch:
        what = given(source, values)
        every = interval(step, record or what.record, what.sampling)
        ready, accuracy, _ = planned(
            what, step=every, replayed=record, name=name, substeps=None, drive=drive
        )
        if exchange and ready.delay is not None:
            late = next(n for n, e in what.model if e.name == "delay")
            raise ModelError(
                f"{late}: model exchange has no place for the past of the drive: export it for "
                f"co-simulation, or leave {late} out and delay the drive in your tool."
            )
        # Nobody knows the importer's steps before.
        ready = replace(ready, corners=max(_LINES, _SHORTER * ready.corners))
        if exchange and ready.jumps is not None:
            raise ModelError(
                "The model has states that jump where the drive turns, which model exchange cannot "
                "follow: export it for co-simulation."
            )
        _write(ready, scratch, version, exchange, every, systems)
        size = scratch.stat().st_size
    return Unit(target, version, exchange, systems, accuracy, size)


def _write(
    ready: Plan, archive: Path, version: str, exchange: bool, step: float, systems: Sequence[str]
) -> None:
    """Build the libraries and pack everything."""
    header, code = text(ready, DOUBLE)
    every = variables(ready, exchange)
    token = hashlib.sha256(f"{header}{code}{every}{version}".encode()).hexdigest()[:32]
    token = "{" + "-".join((token[:8], token[8:12], token[12:16], token[16:20], token[20:])) + "}"
    own = f"fmi{version[0]}.c"
    sources = {f"{ready.prefix}.h": header, f"{ready.prefix}.c": code}
    if version == "2.0":
        sources[own] = fmi2.source(ready, every, token, exchange)
        told = description.fmi2(ready, every, token, exchange, step)
    else:
        sources[own] = fmi3.source(ready, every, token)
        sources["buildDescription.xml"] = description.build_description(ready)
        told = description.fmi3(ready, every, token, step)
    with tempfile.TemporaryDirectory(prefix="piezo_opt_fmu_") as folder:
        here = Path(folder)
        (here / "sources").mkdir()
        for file, said in sources.items():
            (here / "sources" / file).write_text(said, encoding="utf-8")
        for system in systems:
            which = PLATFORMS[system].names[VERSIONS.index(version)]
            library(here / "sources" / own, system, ready.prefix, here / "binaries" / which)
        (here / "modelDescription.xml").write_text(told, encoding="utf-8")
        with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as packed:
            for one in sorted(found for found in here.rglob("*") if found.is_file()):
                entry = zipfile.ZipInfo(one.relative_to(here).as_posix(), _DAY)
                entry.compress_type = zipfile.ZIP_DEFLATED
                entry.external_attr = 0o644 << 16
                packed.writestr(entry, one.read_bytes())
