"""The check before anything is fitted: what records show about themselves, mended or refused."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, final

from piezo_opt.errors import InputError
from piezo_opt.measurement.campaign import Campaign
from piezo_opt.measurement.findings import NAMES, Finding, Weight, disagreements, found
from piezo_opt.measurement.picture import picture
from piezo_opt.measurement.record import Measurement

_SAID = {
    Weight.REFUSED: "Refused",
    Weight.MENDED: "Mended",
    Weight.REMARK: "Remark",
}

_CUTS = frozenset({"block_twice", "jump"})
"""Findings whose remedy makes several records of one: applied last."""


@final
@dataclass(frozen=True, eq=False)
class Check:
    """What records show about themselves.

    Attributes:
        given: the records as they were given.
        records: the same after what was mended; a record that is two has become two.
        findings: (record, finding), in the order of the records.
        accepted: names of findings that are taken as they are.
        mended: names of findings whose remedy was asked for.
    """

    given: Campaign
    records: Campaign
    findings: tuple[tuple[str, Finding], ...]
    accepted: frozenset[str] = frozenset()
    mended: frozenset[str] = frozenset()

    @property
    def refused(self) -> tuple[tuple[str, Finding], ...]:
        """Of the findings those that are neither accepted nor mended and forbid a fit."""
        answered = self.accepted | self.mended
        return tuple(
            (name, one)
            for name, one in self.findings
            if one.weight is Weight.REFUSED and one.name not in answered
        )

    def fit_for_use(self) -> Campaign:
        """The records after what was mended.

        Raises:
            InputError: a finding forbids a fit, and is neither accepted nor mended.
        """
        for name, one in self.refused:
            raise InputError(f"{name}: {one}")
        return self.records

    def pictures(self, width: int = 72) -> str:
        """Drive and reading of each record over time as text, with the places that are meant."""
        return "\n\n".join(
            picture(record, [one for name, one in self.findings if name == record.name], width)
            for record in self.given
        )

    def to_dict(self) -> dict[str, Any]:
        """The check as plain data."""
        return {
            "schema": "piezo_opt/check/1",
            "records": list(self.given.names),
            "findings": [
                {"record": name, **one.to_dict(), "answer": self._answer(one)}
                for name, one in self.findings
            ],
            "fit_for_use": not self.refused,
        }

    def _answer(self, one: Finding) -> str:
        if one.name in self.accepted:
            return "accepted"
        mended = one.name in self.mended or one.weight is Weight.MENDED
        return "mended" if mended else one.weight.value

    def __str__(self) -> str:
        lines = []
        for name, one in self.findings:
            said = {"accepted": "Accepted", "mended": "Mended"}.get(
                self._answer(one), _SAID[one.weight]
            )
            lines.append(f"{said} ({one.name}): {name}: {one}")
        if not self.findings:
            lines.append("Nothing was found that speaks against a fit.")
        elif self.refused:
            names = ", ".join(dict.fromkeys(one.name for _, one in self.refused))
            lines.append(f"To be answered before a fit: {names}.")
        return "\n".join(lines)


def check(
    records: Measurement | Iterable[Measurement] | Campaign,
    *,
    accept: Iterable[str] = (),
    mend: Iterable[str] = (),
) -> Check:
    """What records show about themselves, before anything is fitted.

    Wrong readings, a wrong unit, a wrong clock, channels that are shifted against each other:
    each finding is a sentence with samples and remedy. Readings that are none are left out and a
    jittering clock is made even unless they are accepted; what would make a fit wrong must be
    accepted or mended.

    Args:
        records: one record, several, or a campaign.
        accept: names of findings to be taken as they are.
        mend: names of findings whose remedy shall be applied.

    Raises:
        InputError: a name that no finding has, or that has nothing to mend here.
    """
    campaign = Campaign.of(records)
    accepted, asked = _names("accept", accept), _names("mend", mend)
    if both := accepted & asked:
        raise InputError(f"{min(both)} is both accepted and to be mended: say one of them")
    told: list[tuple[str, Finding]] = []
    kept: list[Measurement] = []
    for record in campaign:
        # A record remembers what was found; looking takes half a second for a million samples.
        findings = found(record, accepted) if accepted else record.findings
        told += [(record.name, one) for one in findings]
        kept += _mended(record, findings, accepted, asked)
    # On the records as they were given, too: one of them may have become two.
    if len(campaign) > 1 and len(kept) == len(campaign):
        told += [(campaign.names[0], one) for one in disagreements(Campaign(tuple(kept)))]
    for name in asked:
        if not any(one.name == name and one.mend is not None for _, one in told):
            raise InputError(
                f"mend {name}: there is nothing of that kind to mend; found: "
                f"{', '.join(one.name for _, one in told) or 'nothing'}"
            )
    return Check(campaign, Campaign(tuple(kept)), tuple(told), accepted, asked)


def _names(what: str, given: Iterable[str]) -> frozenset[str]:
    if given is None:
        raise InputError(f"{what} is None: give names of findings, or leave it out")
    names = frozenset((given,) if isinstance(given, str) else given)
    for name in names:
        if name not in NAMES:
            raise InputError(
                f"{what} {name!r}: no finding has that name; there are {', '.join(NAMES)}"
            )
    return names


def _mended(
    record: Measurement,
    findings: tuple[Finding, ...],
    accepted: frozenset[str],
    asked: frozenset[str],
) -> list[Measurement]:
    """The record with the remedies applied, noting each; one that cuts it comes last."""
    records = [record]
    due = [
        one
        for one in findings
        if one.mend is not None
        and one.name not in accepted
        and (one.name in asked or one.weight is Weight.MENDED)
    ]
    for one in sorted(due, key=lambda o: o.name in _CUTS):
        assert one.mend is not None
        done = one.remedy if one.weight is Weight.MENDED else f"Mended as asked ({one.name})."
        note = f"{one.sentence} {done}"
        records = [new.with_(notes=(*new.notes, note)) for old in records for new in one.mend(old)]
    return records
