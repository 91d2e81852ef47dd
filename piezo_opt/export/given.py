"""What is exported: a model, its values, and how it is driven, from whatever holds them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias, final

import numpy as np

from piezo_opt.choosing import expected
from piezo_opt.diagnosis import Diagnosis
from piezo_opt.effects.model import Model
from piezo_opt.errors import InputError, ModelError
from piezo_opt.identification import Fit
from piezo_opt.measurement import Between, Measurement
from piezo_opt.modelfile import ModelFile, read_model
from piezo_opt.units import quantity
from piezo_opt.values import Values

Source: TypeAlias = Fit | Diagnosis | Model | ModelFile | str | os.PathLike[str]
"""What holds a model: a fit, a diagnosis (its final fit), a model, or a file of any of them."""


@final
@dataclass(frozen=True, eq=False)
class Given:
    """What is exported.

    Attributes:
        model: without the effects that are at their null.
        values: of its parameters, SI units; of several records those of the first.
        pruned: names of the effects that were left out.
        record: on which it was fitted, where that is at hand.
        sampling: its step [s] and range of the drive [V], where only these are.
        told: where it comes from, for the comments.
    """

    model: Model
    values: Values
    pruned: tuple[str, ...]
    record: Measurement | None
    told: str
    sampling: tuple[float, float, float] | None = None


def given(source: Source, values: Mapping[str, float] | None = None) -> Given:
    """The model of a fit, diagnosis, model or file, without what does nothing at its values.

    Args:
        source: what holds it.
        values: SI values by full name that go before its own; of a model the nominal ones hold
            where none are given.

    Raises:
        InputError: the file holds no model, or a value has no parameter.
        ModelError: nothing of the model is left.
    """
    record: Measurement | None = None
    sampling: tuple[float, float, float] | None = None
    if isinstance(source, Diagnosis):
        source = source.final
    if isinstance(source, Fit):
        model, numbers, record = source.model, source.values, source.records[0]
        told = f"a fit to {record.name}"
    elif isinstance(source, Model):
        model, numbers, told = source, Values.nominal(source), "a model in Python"
    elif isinstance(source, ModelFile):
        model, numbers, told = source.model, source.numbers, "a model file"
        sampling = source.sampling
    else:
        expected((str, os.PathLike), source, "The source", "a fit, a model, or a file of one")
        file = read_model(source)
        model, numbers, told = file.model, file.numbers, Path(source).name
        sampling = file.sampling
    own = numbers.of_record(0)
    for name in values or {}:
        if name not in model.parameters:
            raise InputError(
                f"values: the model has no parameter '{name}'; it has "
                f"{', '.join(model.parameters)}."
            )
    own = Values({**Values.nominal(model), **own, **(values or {})})
    pruned = tuple(
        name for name, gate in model.gates.items()
        if own[gate] == model.parameters[gate].null
    )  # fmt: skip
    for name in pruned:
        model = model.without(name)
    if not len(model):
        raise ModelError("Every effect of the model is at its null: there is nothing to export.")
    kept = Values({name: own[name] for name in model.parameters})
    return Given(model, kept, pruned, record, told, sampling)


def interval(
    step: str | float | None,
    record: Measurement | None,
    sampling: tuple[float, float, float] | None = None,
) -> float:
    """The time between two calls [s]: as given, or that of the record or of what is told of it.

    Raises:
        InputError: neither is there, or it is no time.
    """
    if step is not None:
        found = quantity(step, "s")
        if not 0.0 < found < np.inf:
            raise InputError(f"step = {step}: is no time: give the time between two calls, '1 ms'")
        return found
    if record is None and sampling is not None:
        return sampling[0]
    if record is None:
        raise InputError(
            "How often the code will be called is not known: give step='1 ms' (--step), or a "
            "record to replay."
        )
    return float(record.step)


def trial(step: float, low: float, high: float, channels: Mapping[str, float]) -> Measurement:
    """A drive for a model that comes without a record: ramps, steps, and a sweep, 1200 samples.

    Args:
        step: time between samples [s].
        low, high: range of the drive [V].
        channels: what further channels begin at; they rise by a hundredth of it.
    """
    part = np.linspace(0.0, 1.0, 400)
    ramps = np.interp(part, [0.0, 0.3, 0.55, 0.75, 0.9, 1.0], [0.0, 1.0, 0.1, 0.7, 0.4, 0.0])
    stairs = np.repeat([0.0, 1.0, 0.25, 0.75, 0.5, 0.9, 0.1, 0.5], 50)
    # From a tenth of the sampling frequency's hundredth to its tenth.
    sweep = 0.5 + 0.5 * np.sin(2.0 * np.pi * 400.0 * np.cumsum(1e-3 * 100.0**part) / 400.0)
    drive = np.asarray(low + (high - low) * np.concatenate([ramps, stairs, sweep]), dtype=float)
    time = np.asarray(step * np.arange(drive.size), dtype=float)
    return Measurement(
        time, drive, 1e-9 * drive,
        channels={n: v * (1.0 + 0.01 * time / time[-1]) for n, v in channels.items()},
        name="trial drive", allow_saturated=True,
    )  # fmt: skip


def on(record: Measurement, model: Model) -> Measurement:
    """A record as exported code is driven: each sample one straight line.

    Raises:
        InputError: it lacks a channel that the model follows.
    """
    wanted = {
        need.removeprefix("channel:")
        for _, effect in model for need in effect.requires if need.startswith("channel:")
    }  # fmt: skip
    missing = sorted(wanted - {*record.channels})
    if missing:
        raise InputError(
            f"{record.name}: the model follows the channel '{missing[0]}' and the record has "
            "none: replay another record, or export the model without that effect."
        )
    return replace(record, between=Between.LINEAR, period=None, startup=0.0)
