"""Which records a session looks at, how they are read, and what was answered to their check."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, final

from piezo_opt.errors import InputError

if TYPE_CHECKING:  # a session is there, and a browser begins, before numpy is loaded
    from piezo_opt.measurement import Campaign, Check

READ_BY: Final = (
    "time", "drive", "position", "rate", "record", "between", "period", "startup", "trim", "gain",
    "scale", "decimal",
)  # fmt: skip
"""What a user may say about a file, each as text; what is not said is left to the file."""


@final
@dataclass(frozen=True)
class Source:
    """One file, and what the user says about it.

    Raises:
        InputError: something else than the options of :func:`~piezo_opt.readers.read` is said.
    """

    path: str
    said: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        said = {k: v for k, v in self.said.items() if v != ""}
        for key, value in said.items():
            if key not in READ_BY or not isinstance(value, str):
                raise InputError(
                    f"{self.path}: {key!r} cannot be said about a file: there are "
                    f"{', '.join(READ_BY)}, each as text"
                )
        if not isinstance(self.path, str) or not self.path:
            raise InputError(f"{self.path!r} is no file: name one")
        object.__setattr__(self, "said", said)

    def records(self) -> Campaign:
        """The records of the file."""
        from piezo_opt.measurement import Campaign
        from piezo_opt.readers import read, read_campaign

        said: dict[str, Any] = dict(self.said)
        one = "record" in said
        return Campaign.of(read(self.path, **said)) if one else read_campaign(self.path, **said)

    @property
    def code(self) -> str:
        """The same in Python: an expression that is a collection of records."""
        said = "".join(f", {key}={value!r}" for key, value in self.said.items())
        if "record" in self.said:
            return f"[po.read({self.path!r}{said})]"
        return f"po.read_campaign({self.path!r}{said})"


@final
@dataclass(frozen=True)
class Load:
    """Files, and the answers to what their check finds.

    Attributes:
        sources: the files.
        accept, mend: names of findings, as :func:`~piezo_opt.measurement.check` takes them.
    """

    sources: tuple[Source, ...]
    accept: tuple[str, ...] = ()
    mend: tuple[str, ...] = ()

    def records(self) -> Campaign:
        """The records as they are read.

        Raises:
            InputError: a file cannot be read.
        """
        from piezo_opt.measurement import Campaign

        if not self.sources:
            raise InputError("There is no record: drop a file on the page, or name one")
        return Campaign.of([record for source in self.sources for record in source.records()])

    def checked(self, records: Campaign) -> Check:
        """What the records show about themselves.

        Raises:
            InputError: an answer has no finding.
        """
        from piezo_opt.measurement import check

        return check(records, accept=self.accept, mend=self.mend)

    @property
    def code(self) -> tuple[str, ...]:
        """The same in lines of Python, which define ``records``."""
        parts = ", ".join(f"*{source.code}" for source in self.sources)
        answers = "".join(
            f", {word}={names!r}"
            for word, names in (("accept", self.accept), ("mend", self.mend))
            if names
        )
        return (
            f"records = po.Campaign.of([{parts}])",
            f"records = po.check(records{answers}).fit_for_use()",
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "sources": [{"path": s.path, "said": dict(s.said)} for s in self.sources],
            "accept": list(self.accept),
            "mend": list(self.mend),
        }

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> Load:
        """What :meth:`to_dict` gave.

        Raises:
            InputError: it is something else.
        """
        try:
            sources = tuple(Source(one["path"], dict(one["said"])) for one in data["sources"])
            answers = [tuple(map(str, data[word])) for word in ("accept", "mend")]
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise InputError(f"These are no records of a session ({error!r}).") from None
        return Load(sources, *answers)
