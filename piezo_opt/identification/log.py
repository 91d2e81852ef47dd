"""A file that keeps every finished part of a long search, so that a second call goes on from it."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.errors import InputError
from piezo_opt.files import replacing, target_of
from piezo_opt.identification.problem import Identification
from piezo_opt.identification.unknowns import Unknowns
from piezo_opt.readers.memory import hdf5_in_memory

FloatArray = NDArray[np.float64]


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Entry:
    """One finished part: its number, arrays, and numbers or words."""

    index: int
    arrays: Mapping[str, FloatArray]
    told: Mapping[str, Any]


@final
class Log:
    """HDF5: attributes ``question`` (hash) and ``schema``; one group a finished part.

    Args:
        path: the file; made where there is none.
        schema: what the parts are.
        question: hash of all that their content follows from.
        differ: what may be different where the hash is, for the refusal.

    Raises:
        InputError: the file is no such log, belongs to another question, or cannot be written.
    """

    def __init__(self, path: str | Path, schema: str, question: str, differ: str) -> None:
        import h5py

        self._path = Path(path)
        self._kind = schema.split("/")[1]
        self.lost = ""
        try:
            target_of(self._path)
        except InputError as error:
            raise InputError(f"log {error}") from None
        if self._path.exists():
            try:
                with h5py.File(self._path, "r") as file:
                    known = str(file.attrs.get("question", "")), str(file.attrs.get("schema", ""))
            except OSError as error:
                raise InputError(
                    f"{path}: not a readable log of {self._kind} ({error}); name another file."
                ) from None
            if known != (question, schema):
                raise InputError(
                    f"{path}: this log belongs to another question ({differ} differ); name another "
                    "file or delete it."
                )
            return
        try:
            with replacing(self._path, overwrite=False) as out, hdf5_in_memory(out) as file:
                file.attrs["question"] = question
                file.attrs["schema"] = schema
        except InputError as error:
            raise InputError(
                f"{path}: a log of {self._kind} cannot be written here ({error}); name another "
                "file."
            ) from None

    def append(self, entry: Entry) -> None:
        """Add one finished part in one step: a crash or a full disk leaves the parts before it.

        What cannot be written ends the log and not the search: :attr:`lost` says so.
        """
        if self.lost:
            return
        try:
            # Beside it and renamed: a file that is cut short would be no log any more. It is small.
            with replacing(self._path, overwrite=True) as scratch:
                self._write(scratch, entry)
        except InputError as error:
            self.lost = (
                f"The log ends before part {entry.index} of its {self._kind}, because it could not "
                f"be written ({error}); the results here are whole."
            )

    def _write(self, path: Path, entry: Entry) -> None:
        with hdf5_in_memory(path, begin=self._path) as file:
            group = file.create_group(f"{self._kind}_{entry.index:06d}")
            for name, array in entry.arrays.items():
                group[name] = array
            for name, value in entry.told.items():
                group.attrs[name] = value
            group.attrs["index"] = entry.index  # last: without it the part is not whole

    def entries(self) -> Iterator[Entry]:
        """Finished parts."""
        import h5py

        with h5py.File(self._path, "r") as file:
            for name in file:
                told = dict(file[name].attrs)
                if "index" in told:
                    arrays = {k: np.asarray(file[name][k][...]) for k in file[name]}
                    yield Entry(int(told.pop("index")), arrays, told)


def fingerprint(
    question: Identification, unknown: Unknowns, centre: FloatArray, *beside: object
) -> str:
    """Hash of a question, the point that a search begins at, and what else parts follow from."""
    digest = hashlib.sha256()
    digest.update(json.dumps(question.model.to_dict(), sort_keys=True).encode())
    for record in question.campaign.records:
        for column in (record.time, record.drive, record.position, *record.channels.values()):
            digest.update(np.ascontiguousarray(column).tobytes())
        digest.update(record.left_out.tobytes() if record.left_out.any() else b"")
        told = (record.between, record.period, record.startup, question.start_of(record))
        digest.update(repr((told, tuple(record.channels))).encode())
    digest.update(repr([(m.name, m.low, m.high, m.prior) for m in unknown.members]).encode())
    digest.update(repr((question.loss, question.noise, question.weights)).encode())
    digest.update(repr(sorted(unknown.kept.items())).encode())
    digest.update(centre.tobytes())
    for one in beside:
        digest.update(spelled(one).encode() + b"\0")
    return digest.hexdigest()


def spelled(thing: object) -> str:
    """What an object is and holds, the same in every process: its class, and its fields."""
    if isinstance(thing, Mapping):
        return repr([(str(k), spelled(v)) for k, v in thing.items()])
    if isinstance(thing, list | tuple):
        return repr([spelled(one) for one in thing])
    if thing is None or isinstance(thing, bool | int | float | str | bytes):
        return repr(thing)
    kind = type(thing)
    held = getattr(thing, "__dict__", {})
    fields = {name: spelled(value) for name, value in sorted(held.items())}
    name = getattr(thing, "__qualname__", "")  # of functions
    return f"{kind.__module__}.{kind.__qualname__} {name} {fields}"
