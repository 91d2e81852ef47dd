"""What the commands read: records, and a model to ask about them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import final

from piezo_opt.errors import InputError
from piezo_opt.identification import Identification, Start, default_model
from piezo_opt.measurement import Between, Campaign, Measurement
from piezo_opt.modelfile import ModelFile, read_model
from piezo_opt.readers import read, read_campaign

DEFAULT = "default"


@final
@dataclass(frozen=True)
class Reading:
    """How records are read; None leaves it to the file."""

    time: str | None = None
    drive: str | None = None
    position: str | None = None
    record: str | None = None
    between: Between | None = None
    period: str | None = None
    startup: str | None = None

    def records(self, paths: Sequence[Path]) -> Campaign:
        """Every record of these files; of a file with several records all, or the one named."""
        return Campaign.of([record for path in paths for record in self._one(path)])

    def single(self, path: Path) -> Measurement:
        """The one record of this file, or the one named; several are refused."""
        return read(
            path,
            time=self.time,
            drive=self.drive,
            position=self.position,
            record=self.record,
            between=self.between,
            period=self.period,
            startup=self.startup,
        )

    def _one(self, path: Path) -> Iterable[Measurement]:
        if self == Reading():
            return read_campaign(path)
        return (self.single(path),)


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
    if model == DEFAULT:
        chosen, remarks = default_model(records)
        return Identification(chosen, records, start=start), remarks
    return model_file(model).question(records, start=start), ()


def model_file(path: str) -> ModelFile:
    """The model file of that path; a bare word that is no file gets the usual remedy."""
    if not Path(path).suffix:
        raise InputError(f"--model {path}: give a .toml file, the .json of a fit, or 'default'")
    return read_model(path)
