"""Several records of one actuator, held together."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import final

from piezo_opt.errors import InputError
from piezo_opt.measurement.record import Measurement


@final
@dataclass(frozen=True, eq=False)
class Campaign:
    """Several records of one actuator, with names of their own and the same units.

    Raises `InputError` when there is no record, a name occurs twice, or units differ.
    """

    records: tuple[Measurement, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "records", tuple(self.records))
        for record in self.records:
            if not isinstance(record, Measurement):
                raise InputError(
                    f"{record!r} is no record: give what piezo_opt.read returns, or several of it."
                )
        if not self.records:
            raise InputError("a campaign needs at least one record")
        seen: set[str] = set()
        for record in self.records:
            if record.name in seen:
                raise InputError(
                    f"two records are called {record.name!r}: leave one out where they are the "
                    "same, else give one another name, rename('...')"
                )
            seen.add(record.name)
        first = self.records[0]
        for record in self.records[1:]:
            for what in ("drive_unit", "position_unit"):
                mine, other = getattr(record, what), getattr(first, what)
                if mine != other:
                    raise InputError(
                        f"{record.name} has {what} {mine} but {first.name} has {other}: "
                        "records of one campaign share their units"
                    )

    @staticmethod
    def of(records: Measurement | Iterable[Measurement] | Campaign) -> Campaign:
        """A campaign from one record, several, or one already made.

        Raises:
            InputError: something that is no record.
        """
        if isinstance(records, Campaign):
            return records
        if isinstance(records, Measurement):
            return Campaign((records,))
        several = tuple(records) if isinstance(records, Iterable) else (records,)
        for record in several:
            if not isinstance(record, Measurement):
                raise InputError(
                    f"{records!r} is no record: give what piezo_opt.read returns, or several of it."
                )
        return Campaign(several)

    def __iter__(self) -> Iterator[Measurement]:
        return iter(self.records)

    def __len__(self) -> int:
        return len(self.records)

    def __getitem__(self, name: str) -> Measurement:
        for record in self.records:
            if record.name == name:
                return record
        raise InputError(f"no record {name!r}: there are {', '.join(self.names)}")

    @property
    def names(self) -> tuple[str, ...]:
        """The records' names, in order."""
        return tuple(record.name for record in self.records)
