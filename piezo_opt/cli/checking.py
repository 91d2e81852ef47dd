"""What every command does with the records that it has read: look at what they show."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, final

from piezo_opt.cli import options as o
from piezo_opt.errors import InputError
from piezo_opt.measurement import Campaign, Measurement, check


@final
@dataclass(frozen=True)
class Checking:
    """What the user answers to what a check finds: options of every command that begins with it."""

    accept: o.Accept = None
    mend: o.Mend = None

    def records(self, given: Campaign) -> Campaign:
        """The records, mended as asked; what they show against a fit is refused in one sentence."""
        return check(given, accept=self.accept or (), mend=self.mend or ()).fit_for_use()

    def judging(self, record: Measurement) -> Measurement:
        """A record to judge on, mended as the fitted ones where it shows the same."""
        accept = self.accept or ()
        shown = check(record, accept=accept).findings
        mend = {one.name for _, one in shown if one.mend is not None} & set(self.mend or ())
        answered = check(record, accept=accept, mend=mend).fit_for_use().records
        if len(answered) > 1:
            raise InputError(f"{record.name}: it is {len(answered)} records: judge on one of them")
        return answered[0]


UNANSWERED: Final = Checking()
"""What needs an answer is refused."""
