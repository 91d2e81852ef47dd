"""Intervals by fitting again, as the commands make them."""

from __future__ import annotations

from pathlib import Path

from piezo_opt.cli.choices import IntervalsName
from piezo_opt.cli.solving import pool
from piezo_opt.cli.telling import telling
from piezo_opt.identification import Bootstrap, Fit, Profiles, bootstrap, profile_likelihood


def intervals(
    fit: Fit, how: IntervalsName, *, replicates: int, seed: int, workers: int, log: Path | None
) -> Bootstrap | Profiles:
    """Intervals of a fit's unknowns, showing how far they are on a terminal.

    Args:
        fit: the fit.
        how: bootstrap or profile likelihood.
        replicates, seed: of a bootstrap.
        workers: processes.
        log: of the fit's starts; the intervals' own lies beside it.
    """
    beside = None if log is None else log.with_suffix(f".intervals{log.suffix}")
    with telling(f"Intervals ({how.value})") as tell, pool(workers) as executor:

        def told(done: int, of: int) -> None:
            tell(f"{done} of {of} (Ctrl-C keeps those)")

        if how is IntervalsName.PROFILE:
            return profile_likelihood(fit, executor=executor, log=beside, progress=told)
        return bootstrap(fit, replicates, seed=seed, executor=executor, log=beside, progress=told)
