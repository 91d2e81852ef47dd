"""Where the error lives: every view of one misfit, and what stands out in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from piezo_opt.comparison.after_events import AfterEvents, after_events
from piezo_opt.comparison.by_amplitude import ByAmplitude, by_amplitude
from piezo_opt.comparison.by_branch import ByBranch, by_branch
from piezo_opt.comparison.by_frequency import ByFrequency, by_frequency
from piezo_opt.comparison.misfit import Misfit
from piezo_opt.comparison.over_time import OverTime, over_time


@final
@dataclass(frozen=True, eq=False)
class Where:
    """Five views of where the error of one model on one record lives."""

    over_time: OverTime
    by_branch: ByBranch
    by_frequency: ByFrequency
    by_amplitude: ByAmplitude
    after_events: AfterEvents

    @property
    def sentences(self) -> tuple[str, ...]:
        """One for each view in which something stands out; empty for white noise."""
        views = (
            self.by_branch,
            self.after_events,
            self.by_frequency,
            self.by_amplitude,
            self.over_time,
        )
        return tuple(view.sentence for view in views if view.sentence)


def where(misfit: Misfit) -> Where:
    """Look at a misfit over time, by branch, frequency and amplitude, and after events."""
    return Where(
        over_time=over_time(misfit),
        by_branch=by_branch(misfit),
        by_frequency=by_frequency(misfit),
        by_amplitude=by_amplitude(misfit),
        after_events=after_events(misfit),
    )
