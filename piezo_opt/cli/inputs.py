"""What the commands read: records, and a model to ask about them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Final, final

from piezo_opt.cli import options as o
from piezo_opt.errors import InputError
from piezo_opt.identification import Identification, Start, as_driven, default_model
from piezo_opt.measurement import Campaign, Measurement
from piezo_opt.modelfile import ModelFile, read_model
from piezo_opt.readers import HOLD_SEVERAL, read, read_campaign

DEFAULT = "default"
ALL: Final = "all"
"""Every record of a file, as ``--record`` takes it."""


@final
@dataclass(frozen=True)
class Reading:
    """How records are read: options of every command that reads one; None leaves it to the file."""

    time: o.Time = None
    drive: o.Drive = None
    position: o.Position = None
    record: o.RecordName = None
    between: o.BetweenSamples = None
    period: o.Period = None
    startup: o.Startup = None
    rate: o.Rate = None
    trim: o.Trim = None
    every: o.Every = 1
    gain: o.Gain = None
    scale: o.Scale = None
    decimal: o.Decimal = None

    def records(self, paths: Sequence[Path]) -> Campaign:
        """Every record of these files; of a file with several records all, or the one named.

        Records of one name, out of several folders, are called by folder and name.
        """
        found = [(path, record) for path in paths for record in self._one(path)]
        counted = Counter(record.name for _, record in found)
        return Campaign.of(
            [
                one.rename(f"{path.absolute().parent.name}/{one.name}")
                if counted[one.name] > 1
                else one
                for path, one in found
            ]
        )

    def single(self, path: Path) -> Measurement:
        """The one record of this file, or the one named; several are refused."""
        if self.record == ALL:
            raise InputError(f"{path}: --record {ALL} is several records, and one is asked for")
        return read(path, record=self.record, **self._said)

    def _one(self, path: Path) -> Iterable[Measurement]:
        # A file that holds several records as such needs no word; one with a clock that begins
        # anew may also be one record with a wrong clock.
        if self.record == ALL or (self == Reading() and path.suffix.lower() in HOLD_SEVERAL):
            return read_campaign(path, **self._said)
        return (self.single(path),)

    @property
    def _said(self) -> dict[str, Any]:
        """What readers are told, by their own names."""
        return {one.name: getattr(self, one.name) for one in fields(self) if one.name != "record"}


AS_WRITTEN: Final = Reading()
"""What the file says and shows."""


def parted(records: Campaign, at: str | None) -> tuple[Campaign, Campaign | None]:
    """Training and test records cut at an instant; all of them and None without one."""
    if at is None:
        return records, None
    pairs = [record.split(at) for record in records]
    return Campaign(tuple(p[0] for p in pairs)), Campaign(tuple(p[1] for p in pairs))


def asked(
    model: str, records: Campaign, start: Start | None
) -> tuple[Identification, tuple[str, ...]]:
    """The question of a model file, or of the default model with what it leaves out and why."""
    file = None if model == DEFAULT else model_file(model)
    known = None if file is None else file.between
    driven, held = as_driven(record.driven(known) for record in records)
    if file is not None:
        return file.question(driven, start=start), held
    chosen, remarks = default_model(driven)
    return Identification(chosen, driven, start=start), (*held, *remarks)


def model_file(path: str) -> ModelFile:
    """The model file of that path; a bare word that is no file gets the usual remedy."""
    if not Path(path).suffix:
        raise InputError(f"--model {path}: give a .toml file, the .json of a fit, or 'default'")
    return read_model(path)
