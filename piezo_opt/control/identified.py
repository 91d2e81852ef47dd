"""An actuator as a design takes it: a model, its values, and how sure they are."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.choosing import expected
from piezo_opt.effects import Model
from piezo_opt.errors import InputError
from piezo_opt.identification import Fit, load_fit
from piezo_opt.modelfile import ModelFile, read_model
from piezo_opt.values import Values

FloatArray = NDArray[np.float64]


@final
@dataclass(frozen=True, eq=False)
class Identified:
    """What is known of an actuator.

    Attributes:
        model: the sum of its effects.
        values: SI values by full name, those of the record included.
        names: of what was estimated; empty where that is not known.
        covariance: (k, k) of these, NaN rows for those at a bound.
        bounds: by full name, where they are not those of the parameters.
        period: of the sampling of the record [s], if known.
        drive: lowest and highest drive of the record [V], if known.
        noise: rms of what the model left of the record [m], if known.
    """

    model: Model
    values: Values
    names: tuple[str, ...] = ()
    covariance: FloatArray | None = None
    bounds: Mapping[str, tuple[float, float]] | None = None
    period: float | None = None
    drive: tuple[float, float] | None = None
    noise: float | None = None

    @property
    def numbers(self) -> Values:
        """A value for every parameter of the model, and nothing else."""
        own = self.values.of_record(0)
        nominal = Values.nominal(self.model)
        return nominal.with_({k: v for k, v in own.items() if k in self.model.parameters})


Source: TypeAlias = Fit | Identified | ModelFile | Model | str | os.PathLike[str]
"""A fit, the file of one, a model file, or a model with values."""


def identified(source: Source, values: Mapping[str, float] | None = None) -> Identified:
    """What is known of an actuator, from whatever holds it.

    Args:
        source: a fit, a saved one (.h5), its JSON, a model file, or a model.
        values: SI values by full name that go before its own.

    Raises:
        InputError: the file holds no model, or a value has no parameter.
    """
    known = _identified(source)
    for name in values or {}:
        if name not in known.model.parameters:
            raise InputError(
                f"values: the model has no parameter '{name}'; it has "
                f"{', '.join(known.model.parameters)}."
            )
    return known if not values else replace(known, values=known.values.with_(values))


def _identified(source: Source) -> Identified:
    if isinstance(source, Identified):
        return source
    if isinstance(source, Model):
        return Identified(source, Values.nominal(source))
    if isinstance(source, Fit):
        record = source.records[0]
        return Identified(
            source.model, source.values, source.names, source.covariance, source.question.bounds,
            float(record.step), (float(record.drive.min()), float(record.drive.max())), source.rms,
        )  # fmt: skip
    if not isinstance(source, ModelFile):
        expected((str, os.PathLike), source, "The plant", "a fit, a model, or a file of one")
    if not isinstance(source, ModelFile) and Path(source).suffix.lower() in (".h5", ".hdf5"):
        return _identified(load_fit(source))
    file = source if isinstance(source, ModelFile) else read_model(source)
    period, drive = None, None
    if file.sampling is not None:
        period, drive = file.sampling[0], file.sampling[1:]
    names, covariance = file.uncertainty or ((), None)
    return Identified(
        file.model, file.numbers, names, covariance, file.bounds, period, drive, file.rms
    )
