"""Model files: effects, values, bounds and priors in a TOML file a person writes.

A whole example; every part but ``effects`` may be left out::

    effects = ["piezo_gain", {effect = "creep", elements = 2}, "bouc_wen", "second_order"]
    free = ["bouc_wen.n"]           # declared fixed, to be estimated all the same
    per_record = ["piezo_gain.d"]   # one value for each record
    noise = "20 nm"                 # needed with priors

    [values]                        # start values, in SI units or with a unit
    "bouc_wen.alpha" = "0.08 um/V"

    [fixed]                         # kept at these values
    "second_order.omega" = 8.0321

    [bounds]
    "creep.tau" = ["10 ms", "100 s"]

    [priors]                        # normal: mean and standard deviation
    "piezo_gain.d" = {mean = "0.2 um/V", std = "10 nm/V"}

The JSON file that a fit, a diagnosis, a comparison or a design writes is a model file too: its
estimates become start values. Of a diagnosis that is the model it ended with, of a comparison the
one with the smallest error, of a design the actuator that it is for. The keys above may stand in a
JSON file as well.
"""

from __future__ import annotations

import difflib
import json
import os
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.effects.catalogue import model_from_dict
from piezo_opt.effects.model import Model
from piezo_opt.errors import InputError, PiezoOptError
from piezo_opt.files import checked
from piezo_opt.identification import Identification, Prior, Start
from piezo_opt.measurement import Between, Campaign, Measurement
from piezo_opt.simulation import INITIAL
from piezo_opt.units import quantity
from piezo_opt.values import Values

__all__ = ["ModelFile", "read_model"]

FloatArray = NDArray[np.float64]

_KEYS: Final = ("effects", "values", "fixed", "bounds", "priors", "free", "per_record", "noise")


@final
@dataclass(frozen=True, eq=False)
class ModelFile:
    """What a model file says, in SI units.

    Attributes:
        model: the sum of its effects.
        values: start values by full name.
        fixed: values that are kept.
        bounds: (low, high) by full name.
        priors: normal priors by full name.
        free: parameters declared fixed that shall be estimated.
        per_record: parameters with one value for each record.
        noise: standard deviation of the reading's noise [m], or None.
        sampling: step [s] and range of the drive [V] of the fitted record, if told.
        between: how its drive moved between samples, if told.
        rms: of what the fit left [m], if told.
        uncertainty: names of the estimates and their (k, k) covariance, NaN rows for those at a
            bound, if told.
    """

    model: Model
    values: Mapping[str, float] = field(default_factory=dict)
    fixed: Mapping[str, float] = field(default_factory=dict)
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    priors: Mapping[str, Prior] = field(default_factory=dict)
    free: tuple[str, ...] = ()
    per_record: tuple[str, ...] = ()
    noise: float | None = None
    sampling: tuple[float, float, float] | None = None
    between: Between | None = None
    rms: float | None = None
    uncertainty: tuple[tuple[str, ...], FloatArray] | None = None

    def question(
        self,
        records: Measurement | Iterable[Measurement] | Campaign,
        *,
        start: Start | None = None,
    ) -> Identification:
        """The identification of this model on these records.

        Their drives move between samples as the fitted one's did, where nobody has said how.
        """
        return Identification(
            self.model,
            [record.driven(self.between) for record in Campaign.of(records)],
            values=self.values,
            fixed=self.fixed,
            free=self.free,
            bounds=self.bounds,
            priors=self.priors,
            per_record=self.per_record,
            start=start,
            noise=self.noise,
        )

    @property
    def numbers(self) -> Values:
        """A value for every parameter: nominal ones where the file says nothing."""
        return Values.nominal(self.model).with_({**self.values, **self.fixed})


def read_model(path: str | os.PathLike[str]) -> ModelFile:
    """Read a model file (.toml or .json), or the JSON of a fit, diagnosis, comparison or design.

    Raises:
        InputError: one sentence with the file, the key, what is wrong and what to do.
    """
    file = checked(path)
    suffix = file.suffix.lower()
    if suffix not in (".toml", ".json"):
        raise InputError(f"{file}: a model is read from .toml, or from the .json of a fit")
    try:
        text = file.read_text(encoding="utf-8")
        data = tomllib.loads(text) if suffix == ".toml" else json.loads(text)
    except UnicodeDecodeError as error:
        raise InputError(f"{file}: is not text: a model file is written in UTF-8") from error
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{file}: is not valid TOML: {error}") from error
    except (json.JSONDecodeError, RecursionError) as error:
        raise InputError(f"{file}: is not valid JSON: {error}") from error
    if not isinstance(data, dict):
        raise InputError(f"{file}: is not a model: write effects = [...]")
    written = suffix == ".toml" or "effects" in data
    return _from_toml(file, data) if written else _from_fit(file, data)


def _from_toml(file: Path, data: Mapping[str, Any]) -> ModelFile:
    for key in data:
        if key not in _KEYS:
            near = difflib.get_close_matches(key, _KEYS, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(_KEYS)}"
            raise InputError(f"{file}: there is no key {key!r}: {hint}")
    model = _model(file, data)
    noise = data.get("noise")
    return ModelFile(
        model=model,
        values=_numbers(file, "values", data, model),
        fixed=_numbers(file, "fixed", data, model),
        bounds={
            name: _pair(file, f"bounds.{name}", pair, _unit(model, name))
            for name, pair in _table(file, "bounds", data, model).items()
        },
        priors={
            name: _prior(file, f"priors.{name}", prior, _unit(model, name))
            for name, prior in _table(file, "priors", data, model).items()
        },
        free=_names(file, "free", data, model),
        per_record=_names(file, "per_record", data, model),
        noise=None if noise is None else _number(file, "noise", noise, "m"),
    )


def _from_fit(file: Path, data: Mapping[str, Any]) -> ModelFile:
    if isinstance(data.get("final_model"), Mapping):
        # The JSON of a diagnosis holds the whole fit that it ended with.
        data = data["final_model"]
    entries = data.get("entries")
    if isinstance(entries, list) and all(isinstance(one, Mapping) for one in entries) and entries:
        # That of a comparison holds several: the one that errs least.
        data = min(entries, key=lambda one: _size(one.get("rms")))
    if isinstance(data.get("plant"), Mapping):
        # That of a design holds the actuator that it is for.
        data = data["plant"]
    parameters = data.get("parameters")
    if not isinstance(parameters, Mapping) or not isinstance(data.get("model"), Mapping):
        raise InputError(f"{file}: is not the JSON of a fit or a diagnosis: write one with --json")
    model = _model(file, data["model"])
    values: dict[str, float] = {}
    fixed: dict[str, float] = {}
    for name, entry in parameters.items():
        declared = model.parameters.get(name.partition("[")[0])
        if not isinstance(entry, Mapping) or (declared is None and not name.startswith(INITIAL)):
            raise InputError(f"{file}: parameters: the model has no {name!r}")
        number = _number(file, f"parameters.{name}.value", entry.get("value"), None)
        values[name] = number
        if declared is not None and not declared.fixed and entry.get("estimated") is False:
            fixed[name] = number
    free = tuple(
        name
        for name, declared in model.parameters.items()
        if declared.fixed and parameters.get(name, {}).get("estimated") is True
    )
    rms = _size(data.get("rms"))
    return ModelFile(
        model, values, fixed, free=free, sampling=_sampling(data), between=_between(data),
        rms=rms if 0.0 < rms < float("inf") else None,
        uncertainty=_uncertainty(data),
    )  # fmt: skip


def _uncertainty(data: Mapping[str, Any]) -> tuple[tuple[str, ...], FloatArray] | None:
    """The covariance of the estimates; None where the file does not tell."""
    try:
        names = tuple(map(str, data["correlation"]["names"]))
        matrix = np.array(data["correlation"]["matrix"], dtype=float)
        size = np.array([data["parameters"][n]["std"] for n in names], dtype=float)
        covariance = matrix * np.outer(size, size)
    except (KeyError, TypeError, ValueError):
        return None
    return (names, covariance) if covariance.shape == (len(names), len(names)) else None


def _sampling(data: Mapping[str, Any]) -> tuple[float, float, float] | None:
    """Step and range of the drive of the first record; None where the file does not tell."""
    try:
        first = data["sampling"][0]
        step, (low, high) = float(first["step"]), map(float, first["drive"])
    except (KeyError, IndexError, TypeError, ValueError):
        return None
    return (step, low, high) if 0.0 < step < float("inf") and low < high else None


def _between(data: Mapping[str, Any]) -> Between | None:
    """How the drive of the first record moved; None where the file does not tell."""
    try:
        return Between(data["sampling"][0]["between"])
    except (KeyError, IndexError, TypeError, ValueError):
        return None


def _size(error: object) -> float:
    """An error as a number, the largest where it is none."""
    number = isinstance(error, int | float) and not isinstance(error, bool)
    return float(error) if number else float("inf")  # type: ignore[arg-type]


def _model(file: Path, data: Mapping[str, Any]) -> Model:
    effects = data.get("effects")
    if not isinstance(effects, list) or not effects:
        raise InputError(
            f'{file}: effects: a model needs a list of effects, effects = ["piezo_gain", ...]'
        )
    entries = [{"effect": one} if isinstance(one, str) else one for one in effects]
    try:
        return model_from_dict({"effects": entries})
    except PiezoOptError as error:
        raise InputError(f"{file}: effects: {error}") from error
    except (TypeError, ValueError) as error:
        raise InputError(f"{file}: effects: an option has a wrong value: {error}") from error


def _table(file: Path, key: str, data: Mapping[str, Any], model: Model) -> dict[str, Any]:
    """A table by full parameter name, with or without quotes around the names."""
    table = data.get(key, {})
    if not isinstance(table, Mapping):
        raise InputError(f"{file}: {key}: is a table, [{key}], with one line for each parameter")
    flat: dict[str, Any] = {}
    for name, value in table.items():
        # An unquoted key, bouc_wen.alpha = 1, is a table within the table to TOML.
        if isinstance(value, Mapping) and name in model:
            flat.update({f"{name}.{own}": one for own, one in value.items()})
        else:
            flat[name] = value
    for name in flat:
        _check_name(file, key, name, model)
    return flat


def _check_name(file: Path, key: str, name: str, model: Model) -> None:
    if name.partition("[")[0] in model.parameters or name.startswith(INITIAL):
        return
    near = difflib.get_close_matches(name, model.parameters, n=1)
    hint = f"did you mean {near[0]!r}?" if near else f"it has {', '.join(model.parameters)}"
    raise InputError(f"{file}: {key}: the model has no parameter {name!r}: {hint}")


def _unit(model: Model, name: str) -> str | None:
    declared = model.parameters.get(name.partition("[")[0])
    return None if declared is None else declared.unit


def _numbers(file: Path, key: str, data: Mapping[str, Any], model: Model) -> dict[str, float]:
    return {
        name: _number(file, f"{key}.{name}", value, _unit(model, name))
        for name, value in _table(file, key, data, model).items()
    }


def _number(file: Path, key: str, value: object, unit: str | None) -> float:
    """An SI number, or text with a unit where the unit of the parameter is known."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise InputError(f"{file}: {key}: {value!r} is not a number: write 0.1 or '20 nm'")
    if isinstance(value, str) and unit is None:
        raise InputError(f"{file}: {key}: {value!r} is text: write a number in SI units")
    try:
        return quantity(value, unit or "1")
    except (PiezoOptError, OverflowError) as error:
        raise InputError(f"{file}: {key}: {error}") from error


def _bound(file: Path, key: str, value: object, unit: str | None) -> float:
    # An infinite bound is none; every other number must be finite.
    if isinstance(value, float) and value in (float("inf"), -float("inf")):
        return value
    return _number(file, key, value, unit)


def _pair(file: Path, key: str, value: object, unit: str | None) -> tuple[float, float]:
    if not isinstance(value, list) or len(value) != 2:
        raise InputError(f"{file}: {key}: {value!r} is no pair: write [low, high]")
    low, high = (_bound(file, key, one, unit) for one in value)
    if not low < high:
        raise InputError(f"{file}: {key}: {value[0]} is not below {value[1]}: write [low, high]")
    return low, high


def _prior(file: Path, key: str, value: object, unit: str | None) -> Prior:
    if not isinstance(value, Mapping) or set(value) != {"mean", "std"}:
        raise InputError(f"{file}: {key}: write {{mean = ..., std = ...}}")
    mean = _number(file, f"{key}.mean", value["mean"], unit)
    std = _number(file, f"{key}.std", value["std"], unit)
    try:
        return Prior(mean, std)
    except PiezoOptError as error:
        raise InputError(f"{file}: {key}: {error}") from error


def _names(file: Path, key: str, data: Mapping[str, Any], model: Model) -> tuple[str, ...]:
    names = data.get(key, [])
    if not isinstance(names, list) or not all(isinstance(one, str) for one in names):
        raise InputError(f'{file}: {key}: is a list of parameters, ["bouc_wen.n"]')
    for name in names:
        _check_name(file, key, name, model)
    return tuple(names)
