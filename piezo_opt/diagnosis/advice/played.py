"""The fitted model on drives that have not been played yet."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from piezo_opt.diagnosis.base_point import BasePoint
from piezo_opt.diagnosis.drives import Excitation
from piezo_opt.diagnosis.stopping import Pool
from piezo_opt.errors import PiezoOptError
from piezo_opt.identification import Fit, Start
from piezo_opt.identification.problem import plain
from piezo_opt.identification.unknowns import unknowns
from piezo_opt.measurement import Between, Measurement
from piezo_opt.simulation import INITIAL, Initial, Simulator
from piezo_opt.values import Values

Told = TypeVar("Told")


def judged(
    fit: Fit,
    drives: Sequence[Excitation],
    judge: Callable[[BasePoint], Told | None],
    threads: int,
) -> list[tuple[Excitation, Told]]:
    """What each drive would tell; those that cannot be simulated or judged are left out.

    Args:
        fit: the fitted model.
        drives: to be played at the rate of the first record.
        judge: what the fit on such a drive tells, None for nothing.
        threads: drives that are judged at a time.
    """
    rate = fit.records[0].rate

    def one(drive: Excitation) -> Told | None:
        point = _played(fit, drive, rate)
        return None if point is None else judge(point)

    with Pool(max_workers=threads) as pool:
        told = pool.map(one, drives)
        return [(d, t) for d, t in zip(drives, told, strict=True) if t is not None]


def _played(fit: Fit, drive: Excitation, rate: float) -> BasePoint | None:
    """The fitted model on one drive; None where it cannot be simulated.

    The start of the new record is as unknown as that of the fitted ones, unless they begin at
    rest; further channels stand at their mean.
    """
    first = fit.records[0]
    time, voltage = drive.samples(rate)
    between = Between.LINEAR if first.between is Between.BANDLIMITED else first.between
    numbers = {k: v for k, v in fit.values.of_record(0).items() if not k.startswith(INITIAL)}
    record = Measurement(
        time=time,
        drive=voltage,
        # The position of a record is not read by a simulation.
        position=voltage,
        channels={k: np.full(time.size, float(c.mean())) for k, c in first.channels.items()},
        channel_units=first.channel_units,
        name=drive.name,
        drive_unit=first.drive_unit,
        position_unit=first.position_unit,
        between=between,
        allow_saturated=True,
    )
    start = Start.REST if fit.question.start is Start.REST else None
    try:
        simulator = Simulator(
            fit.model, record, numbers, initial=Initial.REST, runtime=fit.question.free
        )
        reading = simulator.reading(numbers)
        if not np.isfinite(reading).all() or np.ptp(reading) == 0.0:
            return None
        asked = fit.question
        question = replace(
            asked,
            records=record.with_(position=reading),
            fixed={**asked.fixed, **_alone(asked.fixed)},
            values={},
            bounds={},
            priors={},
            per_record=(),
            weights=(),
            start=start,
        )
        unknown = unknowns(question, Values(numbers))
        there = replace(
            fit,
            question=question,
            values=Values(numbers),
            names=unknown.names,
            covariance=np.full((len(unknown.names),) * 2, np.nan),
            at_bound=tuple({plain(n) for n in fit.at_bound} & set(unknown.names)),
            readings=(reading,),
            accuracy=(simulator.accuracy,),
            starts=(),
        )
        return BasePoint(there, sharp=True)
    except (PiezoOptError, ArithmeticError, np.linalg.LinAlgError):
        return None


def _alone(fixed: Mapping[str, float | str]) -> dict[str, float | str]:
    """What is fixed on the first record of several, under its plain name."""
    return {
        plain(k): v for k, v in fixed.items() if k.endswith("[0]") and not k.startswith(INITIAL)
    }
