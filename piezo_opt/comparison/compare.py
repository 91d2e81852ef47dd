"""Fits side by side, on their own records or on records none of them has seen."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, final

import numpy as np

from piezo_opt.choosing import expected, words
from piezo_opt.comparison.labels import labels
from piezo_opt.comparison.metrics import Metrics, measure
from piezo_opt.comparison.misfit import Misfit
from piezo_opt.comparison.where import Where, where
from piezo_opt.comparison.whiteness import Whiteness, whiteness
from piezo_opt.errors import InputError
from piezo_opt.identification import Fit
from piezo_opt.measurement import Campaign, Measurement
from piezo_opt.units import show

SCHEMA: Final = "piezo_opt/comparison/1"


@final
@dataclass(frozen=True, eq=False)
class Entry:
    """One fit on one or several records.

    Attributes:
        label: what tables and pictures call it.
        fit: the fit.
        misfits: what it leaves over, one for each record.
        held_out: whether the records are others than those it was fitted to.
    """

    label: str
    fit: Fit
    misfits: tuple[Misfit, ...]
    held_out: bool

    @cached_property
    def metrics(self) -> Metrics:
        """The measures over all records together."""
        return measure(self.misfits, len(self.fit.names), held_out=self.held_out)

    @cached_property
    def by_record(self) -> tuple[Metrics, ...]:
        """The measures of each record alone."""
        known = len(self.fit.names)
        return tuple(measure((one,), known, held_out=self.held_out) for one in self.misfits)

    @cached_property
    def where(self) -> tuple[Where, ...]:
        """Where the error lives, for each record."""
        return tuple(where(one) for one in self.misfits)

    @cached_property
    def whiteness(self) -> tuple[Whiteness, ...]:
        """Whether the error is noise, for each record."""
        return tuple(whiteness(one) for one in self.misfits)

    @property
    def sentences(self) -> tuple[str, ...]:
        """The largest error, what stands out, and whether the rest is white, for each record."""
        several = len(self.misfits) > 1
        return tuple(
            f"{one.record.name}: {text}" if several else text
            for k, one in enumerate(self.misfits)
            for text in self.sentences_of(k)
        )

    def sentences_of(self, record: int) -> tuple[str, ...]:
        """The sentences of one record alone."""
        places, noise = self.where[record], self.whiteness[record]
        return (_largest(self.misfits[record]), *places.sentences, noise.sentence)


@final
@dataclass(frozen=True, eq=False)
class Comparison:
    """One or several fits, measured on the same records or each on its own.

    Attributes:
        entries: the fits in the order given.
        held_out: whether the records are others than those fitted to.
    """

    entries: tuple[Entry, ...]
    held_out: bool

    @property
    def records(self) -> tuple[str, ...]:
        """Names of the records of the first entry."""
        return tuple(one.record.name for one in self.entries[0].misfits)

    def best(self) -> Entry:
        """The entry with the smallest rms error."""
        return min(self.entries, key=lambda entry: entry.metrics.rms)

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units, with a ``schema`` key."""
        return {
            "schema": SCHEMA,
            "held_out": self.held_out,
            "entries": [
                {
                    "label": entry.label,
                    "model": entry.fit.model.to_dict(),
                    **{key: entry.fit.to_dict()[key] for key in ("parameters", "sampling")},
                    **entry.metrics.to_dict(),
                    "records": {
                        one.record.name: {
                            **metrics.to_dict(),
                            "white": noise.white if noise.conclusive else None,
                            "whiteness_p": noise.p_value,
                            "autocorrelation_outside": noise.autocorrelation_outside,
                            "cross_correlation_outside": noise.cross_correlation_outside,
                            "where": list(places.sentences),
                        }
                        for one, metrics, noise, places in zip(
                            entry.misfits,
                            entry.by_record,
                            entry.whiteness,
                            entry.where,
                            strict=True,
                        )
                    },
                }
                for entry in self.entries
            ],
        }

    def __str__(self) -> str:
        kind = "held-out " if self.held_out else ""
        lines = [f"Error on the {kind}{_listed(self.records)}", "", *_table(self)]
        for entry in self.entries:
            lines += ["", f"Where it fails: {entry.label}"]
            lines += [f"  - {sentence}" for sentence in entry.sentences]
        return "\n".join(lines)


def compare(
    *fits: Fit,
    on: Measurement | Iterable[Measurement] | Campaign | None = None,
    names: Sequence[str] = (),
) -> Comparison:
    """How big is the error, where does it live, is it white.

    Args:
        fits: one or several.
        on: a record, several or a campaign that none was fitted to; each fit predicts it with
            ``Fit.predict``. By default each fit is looked at on its own records.
        names: what to call the fits; by default what tells their models apart.

    Returns:
        The measures over counted samples and the views of where the error lives.

    Raises:
        InputError: no fit is given, or names are not as many as fits.
    """
    if not fits:
        raise InputError("compare needs at least one fit: compare(fit) or compare(fit, richer)")
    for number, one in enumerate(fits, start=1):
        expected(Fit, one, f"compare: fit {number}", "what solve returns")
    words(names, "names")
    if names and len(names) != len(fits):
        raise InputError(f"{len(names)} names for {len(fits)} fits: give one for each, or none")
    chosen = tuple(names) or labels([fit.model for fit in fits])
    if on is None:
        return Comparison(
            tuple(
                Entry(label, fit, _own(fit), held_out=False)
                for label, fit in zip(chosen, fits, strict=True)
            ),
            held_out=False,
        )
    records = Campaign.of(on).records
    # A fit's own record is no test of it, whoever calls it one.
    held_out = not all(any(r is own for own in fit.records) for fit in fits for r in records)
    return Comparison(
        tuple(
            Entry(
                label,
                fit,
                tuple(Misfit(record, fit.predict(record)) for record in records),
                held_out=held_out,
            )
            for label, fit in zip(chosen, fits, strict=True)
        ),
        held_out=held_out,
    )


def _own(fit: Fit) -> tuple[Misfit, ...]:
    return tuple(map(Misfit, fit.records, fit.readings))


def _largest(misfit: Misfit) -> str:
    record = misfit.record
    at = int(np.argmax(np.abs(misfit.error)))
    branch = {1.0: ", loading", -1.0: ", unloading"}.get(float(misfit.branch[at]), "")
    return (
        f"The largest error is {show(float(misfit.error[at]), record.position_unit)}, at "
        f"{misfit.time[at]:.6g} s and {misfit.drive[at]:.4g} {record.drive_unit}{branch}."
    )


def _listed(names: Sequence[str]) -> str:
    if len(names) == 1:
        return f"record {names[0]}"
    return f"{len(names)} records " + ", ".join(names)


def _yes_or_no(noise: Whiteness) -> str:
    if not noise.conclusive:
        return "?"
    return "yes" if noise.white else "no"


def columns(comparison: Comparison) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """The table of a comparison as text: (heading, one cell for each row), row labels first.

    A row for each entry and, where it has several records, one for each of them.
    """
    rows: list[tuple[str, Metrics, str]] = []
    for entry in comparison.entries:
        white = sum(noise.conclusive and noise.white for noise in entry.whiteness)
        total = len(entry.misfits)
        verdict = _yes_or_no(entry.whiteness[0]) if total == 1 else f"{white} of {total}"
        rows.append((entry.label, entry.metrics, verdict))
        if total > 1:
            rows.extend(
                (f"  {one.record.name}", metrics, _yes_or_no(noise))
                for one, metrics, noise in zip(
                    entry.misfits, entry.by_record, entry.whiteness, strict=True
                )
            )
    unit = comparison.entries[0].misfits[0].record.position_unit
    area = f"{unit}*s"  # an integral over time

    def squared(value: float | None) -> str:
        if value is None:
            return "-"
        return f"{value * 1e12:.4g} um^2" if unit == "m" else f"{value:.4g} {unit}^2"

    def plain(value: float | None) -> str:
        if value is None:
            return "-"
        return f"{value:.1f}" if abs(value) < 1e4 else f"{value:.0f}"

    table: tuple[tuple[str, tuple[str, ...]], ...] = (
        ("model", tuple(label for label, _, _ in rows)),
        ("fit", tuple(f"{m.fit_percent:.2f} %" for _, m, _ in rows)),
        ("rms", tuple(show(m.rms, unit) for _, m, _ in rows)),
        ("max", tuple(show(m.largest, unit) for _, m, _ in rows)),
        ("white", tuple(verdict for _, _, verdict in rows)),
        ("unknowns", tuple(f"{m.unknowns}" for _, m, _ in rows)),
        ("IAE", tuple(show(m.iae, area) for _, m, _ in rows)),
        ("MSE", tuple(squared(m.mse) for _, m, _ in rows)),
    )
    if not comparison.held_out:
        table += (
            ("FPE", tuple(squared(m.fpe) for _, m, _ in rows)),
            ("AIC", tuple(plain(m.aic) for _, m, _ in rows)),
            ("BIC", tuple(plain(m.bic) for _, m, _ in rows)),
        )
    return table


def _table(comparison: Comparison) -> list[str]:
    table = columns(comparison)
    widths = [max(len(head), *map(len, cells)) for head, cells in table]
    lines = []
    for k in range(-1, len(table[0][1])):
        cells = [head if k < 0 else column[k] for head, column in table]
        first, *others = (
            cell.ljust(width) if j == 0 else cell.rjust(width)
            for j, (cell, width) in enumerate(zip(cells, widths, strict=True))
        )
        lines.append("  " + "  ".join([first, *others]))
    return lines
