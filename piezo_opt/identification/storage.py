"""A fit on disk: everything needed to read it again and to ask the same question again.

HDF5 layout: the records as any file of records has them (so that `read_campaign` reads the file
too), and beside them

    /fit                    attribute   schema
    /fit/question, /fit/result          uint8: JSON
    /fit/covariance         float64 (k, k)
    /fit/reading_0000 ...   float64 (N,) modelled reading of each record [m]
    /fit/trace_values       float64 (iterations, k)
    /fit/trace_rms          float64 (iterations,) [m]
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from piezo_opt.choosing import expected
from piezo_opt.effects.catalogue import model_from_dict
from piezo_opt.effects.model import Model
from piezo_opt.errors import InputError, PiezoOptError
from piezo_opt.files import replacing
from piezo_opt.identification.outcome import Ending, Evaluations, Outcome, Trace
from piezo_opt.identification.problem import Identification, Loss, Prior, Shape, Start
from piezo_opt.identification.result import Fit, StartResult
from piezo_opt.measurement import Campaign
from piezo_opt.readers import HOLD_SEVERAL, read_campaign, write
from piezo_opt.readers.memory import hdf5_in_memory
from piezo_opt.simulation import Accuracy, Substeps
from piezo_opt.values import Values

_SCHEMA = "piezo_opt/fit-file/1"


def save_fit(fit: Fit, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
    """Write a fit with its question and records to an HDF5 file, whole or not at all.

    Raises:
        InputError: the file exists and ``overwrite`` is not given, or cannot be written.
    """
    expected(Fit, fit, "The fit", "what solve returns")
    expected((str, os.PathLike), path, "The file", "its path")
    if Path(path).suffix.lower() not in HOLD_SEVERAL:
        raise InputError(f"{path}: a fit is written as {' or '.join(HOLD_SEVERAL)}: choose one")
    with replacing(path, overwrite=overwrite) as scratch:
        # The records' writer goes by the suffix and never overwrites.
        records = scratch.with_name(f"{scratch.name}.records.h5")
        try:
            write(fit.question.campaign, records)
            scratch.write_bytes(records.read_bytes())
        except InputError as error:
            raise InputError(str(error).replace(str(records), str(path))) from None
        finally:
            records.unlink(missing_ok=True)
        with hdf5_in_memory(scratch, begin=scratch) as file:
            group = file.create_group("fit")
            group.attrs["schema"] = _SCHEMA
            # Data sets, because an attribute has no room for the results of many starts.
            for name, told in (("question", _question(fit.question)), ("result", _result(fit))):
                text = np.frombuffer(json.dumps(told).encode(), dtype=np.uint8)
                group.create_dataset(name, data=text, compression="gzip", fletcher32=True)
            group["covariance"] = fit.covariance
            group["trace_values"] = fit.trace.values
            group["trace_rms"] = fit.trace.rms
            for index, reading in enumerate(fit.readings):
                group[f"reading_{index:04d}"] = reading


def load_fit(path: str | os.PathLike[str], *, model: Model | None = None) -> Fit:
    """Read a fit that :func:`save_fit` wrote.

    Args:
        path: the file.
        model: the model, where it has effects that are in no catalogue.

    Raises:
        InputError: the file is no such file, or is broken.
    """
    import h5py

    campaign = read_campaign(path)
    try:
        with h5py.File(path, "r") as file:
            if "fit" not in file or file["fit"].attrs.get("schema") != _SCHEMA:
                raise InputError(f"{path}: holds records but no fit; write one with fit.save(...).")
            group = file["fit"]
            arrays = {name: group[name][:] for name in group}
        asked = json.loads(arrays["question"].tobytes())
        told = json.loads(arrays["result"].tobytes())
        return _fit(campaign, model, asked, told, arrays)
    except PiezoOptError:
        raise
    except (OSError, KeyError, ValueError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: the fit in this file cannot be read ({error}).") from None


def _fit(
    campaign: Campaign,
    model: Model | None,
    asked: Mapping[str, Any],
    told: Mapping[str, Any],
    arrays: Mapping[str, NDArray[Any]],
) -> Fit:
    question = Identification(
        model=model_from_dict(asked["model"]) if model is None else model,
        records=campaign,
        values=asked["values"],
        fixed=asked["fixed"],
        free=tuple(asked["free"]),
        bounds={k: (float(a), float(b)) for k, (a, b) in asked["bounds"].items()},
        priors={k: Prior(*v) for k, v in asked["priors"].items()},
        per_record=tuple(asked["per_record"]),
        start=None if asked["start"] is None else Start(asked["start"]),
        loss=Loss(Shape(asked["loss"][0]), asked["loss"][1]),
        noise=asked["noise"],
        weights=tuple(asked["weights"]),
    )
    names = tuple(told["names"])
    return Fit(
        question=question,
        values=Values(told["values"]),
        names=names,
        covariance=arrays["covariance"],
        coloured=told["coloured"],
        at_bound=tuple(told["at_bound"]),
        readings=tuple(arrays[f"reading_{i:04d}"] for i in range(len(campaign.records))),
        outcome=Outcome(Ending(told["ending"]), told["sentence"]),
        trace=Trace(names, arrays["trace_values"], arrays["trace_rms"]),
        evaluations=Evaluations(*told["evaluations"]),
        wall_s=told["wall_s"],
        blind=tuple(told["blind"]),
        remarks=tuple(told["remarks"]),
        accuracy=tuple(
            # Files of before have no scheme: theirs is the default.
            Accuracy(Substeps(a, b, k, *scheme), e, n)
            for a, b, k, e, n, *scheme in told["accuracy"]
        ),
        compiled=told["compiled"],
        solver=told["solver"],
        transcription=told["transcription"],
        starts=tuple(StartResult(*s) for s in told["starts"]),
    )


def _question(question: Identification) -> Mapping[str, Any]:
    return {
        "model": question.model.to_dict(),
        "values": dict(question.values),
        "fixed": dict(question.fixed),
        "free": list(question.free),
        "bounds": {k: list(v) for k, v in question.bounds.items()},
        "priors": {k: [p.mean, p.std] for k, p in question.priors.items()},
        "per_record": list(question.per_record),
        "start": None if question.start is None else question.start.value,
        "loss": [question.loss.shape.value, question.loss.scale],
        "noise": question.noise,
        "weights": list(question.weights),
    }


def _result(fit: Fit) -> Mapping[str, Any]:
    return {
        "values": dict(fit.values),
        "names": list(fit.names),
        "coloured": fit.coloured,
        "at_bound": list(fit.at_bound),
        "ending": fit.outcome.ending.value,
        "sentence": fit.outcome.sentence,
        "evaluations": [fit.evaluations.simulations, fit.evaluations.with_sensitivities],
        "wall_s": fit.wall_s,
        "blind": list(fit.blind),
        "remarks": list(fit.remarks),
        "accuracy": [
            [
                a.substeps.longest,
                a.substeps.largest_move,
                a.substeps.times,
                a.error,
                a.per_sample,
                a.substeps.exact,
            ]
            for a in fit.accuracy
        ],
        "compiled": fit.compiled,
        "solver": fit.solver,
        "transcription": fit.transcription,
        "starts": [[s.index, s.rms, s.ending, dict(s.values), s.evaluations] for s in fit.starts],
    }
