"""What a worker hands over about records, fits and suspects: plain data and arrays, no objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.measurement import Campaign, Check, Measurement
from piezo_opt.pictures import Picture
from piezo_opt.pictures.places import pictures
from piezo_opt.pictures.thinning import lasting
from piezo_opt.units import show

if TYPE_CHECKING:  # records are shown before effects and solvers are loaded
    from piezo_opt.diagnosis import Diagnosis
    from piezo_opt.diagnosis.advice import Advice
    from piezo_opt.effects import Effect
    from piezo_opt.identification import Fit

FloatArray = NDArray[np.float64]
Indices = NDArray[np.intp]
Signals = tuple[FloatArray, FloatArray, FloatArray]
"""Time [s], drive and position of a record."""

_SURE: Final = 1e-3
"""Chance by noise alone below which a suspect stands out."""


@final
@dataclass(frozen=True, eq=False)
class Looked:
    """Records: what they show, the signals of each (time, drive, position), and what counts.

    ``kept`` are the samples that draw a long stretch of each.
    """

    told: dict[str, Any]
    signals: tuple[Signals, ...]
    counted: tuple[NDArray[np.bool_], ...]
    kept: tuple[Indices, ...]


@final
@dataclass(frozen=True, eq=False)
class Fitted:
    """A fit: what it says, the modelled reading of each record, and its iterates' rms [m].

    ``kept`` are the samples that draw a long stretch of each record, reading and residual.
    """

    told: dict[str, Any]
    readings: tuple[FloatArray, ...]
    trace: tuple[float, ...]
    kept: tuple[Indices, ...]


@final
@dataclass(frozen=True, eq=False)
class Judged:
    """Where a fit fails, in sentences, and for each record the pictures of where its residual
    lives."""

    sentences: tuple[str, ...]
    places: tuple[dict[str, Picture], ...]


@final
@dataclass(frozen=True, eq=False)
class Scored:
    """Suspects at a fit: what each would explain, and its curve over each record's residual.

    ``kept`` are the samples that draw a long stretch of each curve.
    """

    told: dict[str, Any]
    curves: dict[str, tuple[FloatArray, ...]]
    kept: dict[str, tuple[Indices, ...]]


@final
@dataclass(frozen=True, eq=False)
class Drive:
    """A drive worth playing next: why, its samples, and the file that is played."""

    name: str
    sentence: str
    unit: str
    time: FloatArray
    drive: FloatArray
    csv: str


@final
@dataclass(frozen=True, eq=False)
class Planned:
    """What a record cannot tell: the drives that would, and the names that none would show."""

    drives: tuple[Drive, ...]
    never: tuple[str, ...]


def planned(experiments: Sequence[Advice], never: Sequence[str]) -> Planned:
    """Drives with their samples, at the rate at which they were judged."""
    drives = []
    with TemporaryDirectory() as folder:
        for one in experiments:
            file = Path(folder) / "drive.csv"
            drive = one.drive
            drive.write(file, overwrite=True)
            text = file.read_text(encoding="utf-8")
            drives.append(
                Drive(drive.name, one.sentence, drive.unit, drive.time, drive.values, text)
            )
    return Planned(tuple(drives), tuple(never))


@final
@dataclass(frozen=True, eq=False)
class Checked:
    """What records show that have been handed over already."""

    told: dict[str, Any]


def read(records: Campaign) -> Looked:
    """Columns, units and sampling of records that nobody has checked yet."""
    told = {"records": [_told(r, r.notes) for r in records], "findings": [], "fit_for_use": False}
    return Looked(told, *_arrays(records))


def looked(found: Check) -> Looked | Checked:
    """The same with what the records show, and what was mended."""
    data = found.to_dict()
    told = {
        "records": [_told(r, r.remarks) for r in found.records],
        **{k: data[k] for k in ("findings", "fit_for_use")},
    }
    if found.records.records == found.given.records:
        return Checked(told)
    return Looked(told, *_arrays(found.records))


def _arrays(
    records: Campaign,
) -> tuple[tuple[Signals, ...], tuple[NDArray[np.bool_], ...], tuple[Indices, ...]]:
    signals = tuple((r.time, r.drive, r.position) for r in records)
    kept = tuple(lasting([r.drive, r.position]) for r in records)
    return signals, tuple(r.counted for r in records), kept


def _told(r: Measurement, remarks: Sequence[str]) -> dict[str, Any]:
    return {
        "name": r.name,
        "source": r.source,
        "samples": len(r),
        "not counted": int(len(r) - r.counted.sum()),
        "duration": show(r.duration, "s"),
        "sampling": show(r.rate, "Hz") if r.uniform else f"uneven, {show(r.rate, 'Hz')}",
        "between": r.between.value,
        "period": "" if r.period is None else show(r.period, "s"),
        "units": {"drive": r.drive_unit, "position": r.position_unit, **r.channel_units},
        "ranges": {
            name: f"{show(float(np.min(x)), unit)} to {show(float(np.max(x)), unit)}"
            for name, x, unit in (
                ("drive", r.drive, r.drive_unit),
                ("position", r.position, r.position_unit),
                *((n, x, r.channel_units[n]) for n, x in r.channels.items()),
            )
        },
        "remarks": list(remarks),
        "span": [float(r.time[0]), float(r.time[-1])],
    }


def fitted(fit: Fit, remarks: Sequence[str]) -> Fitted:
    """A fit in words and numbers."""
    bounds = {n: fit.question.bounds.get(n, p.bounds) for n, p in fit.model.parameters.items()}
    data = fit.to_dict()
    told = {
        "rms": fit.rms,
        "rms_text": show(fit.rms, "m"),
        "fit_percent": fit.fit_percent,
        "sentence": fit.outcome.sentence,
        "effects": [
            {"name": n, "about": e.summary, "place": e.place.value, "instead": _instead(e, fit)}
            for n, e in fit.model.named
        ],
        "parameters": [
            {
                "name": name,
                "value": one["value"],
                "std": one["std"],
                "unit": one["unit"],
                "kept": not one["estimated"],
                "at_bound": one["at_bound"],
                "bounds": [v if np.isfinite(v) else None for v in bounds[name]],
                "about": fit.model.parameters[name].meaning,
            }
            for name, one in data["parameters"].items()
            if name in bounds
        ],
        "blind": list(fit.blind),
        "remarks": [*remarks, *(r for r in fit.remarks if r not in remarks)],
        "json": data,
        "toml": model_file(fit),
    }
    kept = tuple(
        lasting([record.drive, record.position, reading, record.position - reading])
        for record, reading in zip(fit.records, fit.readings, strict=True)
    )
    return Fitted(told, fit.readings, tuple(map(float, fit.trace.rms)), kept)


def judged(fit: Fit) -> Judged:
    """Where a fit fails; of a long record that takes longer than the fit itself."""
    from piezo_opt.comparison import compare

    entry = compare(fit).entries[0]
    places = tuple(
        pictures([("model", misfit, found)])
        for misfit, found in zip(entry.misfits, entry.where, strict=True)
    )
    return Judged(entry.sentences, places)


def _instead(one: Effect, fit: Fit) -> list[str]:
    """Effects of the same place that the model does not have."""
    from piezo_opt.effects.catalogue import CATALOGUE

    return [
        name
        for name, kind in CATALOGUE.items()
        if kind().place is one.place and name not in fit.model and name != one.name
    ]


def scored(found: Diagnosis) -> Scored:
    """Suspects, likeliest first.

    A suspect's curve is what one Gauss-Newton step along it explains: its direction u, of length
    one, times u'r (which is its one-step size times the length of the direction).
    """
    fit = found.fit
    weights = fit.question.weights or (1.0,) * len(fit.records)
    counts = [int(record.counted.sum()) for record in fit.records]
    scale = np.sqrt(np.repeat(weights, counts))
    residual = scale * fit.residuals
    curves = {}
    for one in found.suspects:
        whole = one.direction * float(one.direction @ residual) / scale
        curves[one.name] = tuple(
            _spread(part, record.counted)
            for part, record in zip(
                np.split(whole, np.cumsum(counts)[:-1]), fit.records, strict=True
            )
        )
    suspects = [
        {
            "name": one.name,
            "effect": {"effect": one.name, **one.effect.options},
            "about": one.effect.summary,
            "explains": one.score,
            "rms_text": show(one.predicted_rms, "m"),
            "visibility": one.visibility,
            "overlaps": [{"name": n, "cosine": c} for n, c in one.overlaps[:4]],
            "p_value": one.p_value,
            "sure": one.p_value < _SURE and not one.wrong_side,
            "wrong_side": one.wrong_side,
        }
        for one in found.suspects
    ]
    told = {
        "suspects": suspects,
        "unscored": [{"name": one.name, "why": one.why} for one in found.unscored],
        "noise": found.noise.sentence,
    }
    kept = {
        name: tuple(lasting([np.nan_to_num(part)]) for part in parts)
        for name, parts in curves.items()
    }
    return Scored(told, curves, kept)


def model_file(fit: Fit) -> str:
    """A fit's model, its values and what was said of them, as a TOML file."""
    asked = fit.question
    effects = []
    for _, one in fit.model:
        options = "".join(f", {k} = {_toml(v)}" for k, v in one.options.items())
        effects.append(f"{{effect = {_toml(one.name)}{options}}}")
    lines = ["effects = [", *(f"    {one}," for one in effects), "]"]
    for key in ("free", "per_record"):
        if names := getattr(asked, key):
            lines.append(f"{key} = [{', '.join(map(_toml, names))}]")
    known = {n: v for n, v in fit.values.items() if n in fit.model.parameters}
    for key, table in (
        ("values", {n: v for n, v in known.items() if n not in asked.fixed}),
        ("fixed", asked.fixed),
        ("bounds", {n: list(pair) for n, pair in asked.bounds.items()}),
    ):
        if table:
            lines += ["", f"[{key}]", *(f"{_toml(n)} = {_toml(v)}" for n, v in table.items())]
    return "\n".join(lines) + "\n"


def _toml(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    return repr(value)


def _spread(part: FloatArray, counted: NDArray[np.bool_]) -> FloatArray:
    """Counted samples in their places; NaN between them."""
    whole = np.full(counted.size, np.nan)
    whole[counted] = part
    return whole
