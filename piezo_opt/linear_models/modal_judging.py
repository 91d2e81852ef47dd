"""Error of a modal model on records: simulated from the drives alone, compared with the reading."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np

from piezo_opt.linear_models.modal import ModalModel
from piezo_opt.measurement import AxesCampaign, AxesRecord, FloatArray
from piezo_opt.units import show

SCHEMA: Final = "piezo_opt.axes_error/1"


@final
@dataclass(frozen=True, eq=False)
class LevelError:
    """Error at one amplitude.

    Attributes:
        amplitude: (D,) rms of the drives [drive_unit].
        records: names.
        axes: (A,) relative error of each axis, mean over periods and realisations.
        rms: (A,) rms error of each axis [position_unit].
        total: all axes in one norm, sqrt(sum e^2 / sum (y - mean y)^2) over all samples.
    """

    amplitude: FloatArray
    records: tuple[str, ...]
    axes: FloatArray
    rms: FloatArray
    total: float

    @property
    def mean(self) -> float:
        """Mean of ``axes``: what the benchmark of the fine steering mirror counts."""
        return float(self.axes.mean())


@final
@dataclass(frozen=True, eq=False)
class AxesError:
    """Simulation error by amplitude; errors are relative, 1 is the reading itself."""

    levels: tuple[LevelError, ...]
    units: tuple[str, str]

    def __str__(self) -> str:
        drive, position = self.units
        lines = ["drive rms    records  error by axis %          mean %  total %   rms"]
        for one in self.levels:
            level = show(float(np.sqrt(np.mean(one.amplitude**2))), drive)
            axes = " ".join(f"{100.0 * e:7.2f}" for e in one.axes)
            rms = " ".join(show(float(e), position) for e in one.rms)
            lines.append(
                f"{level:<12} {len(one.records):>7}  {axes:<23}  {100.0 * one.mean:>5.2f}  "
                f"{100.0 * one.total:>7.2f}   {rms}"
            )
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units."""
        return {
            "schema": SCHEMA,
            "drive_unit": self.units[0],
            "position_unit": self.units[1],
            "norm": "axes: sqrt(mean e^2) / std(y) of each axis and period, mean over periods and "
            "realisations; mean: of axes; total: sqrt(sum e^2 / sum (y - mean y)^2)",
            "levels": [
                {
                    "amplitude": one.amplitude.tolist(),
                    "records": list(one.records),
                    "axes": one.axes.tolist(),
                    "mean": one.mean,
                    "total": one.total,
                    "rms": one.rms.tolist(),
                }
                for one in self.levels
            ],
        }


def axes_error(
    model: ModalModel, records: AxesRecord | Iterable[AxesRecord] | AxesCampaign
) -> AxesError:
    """Simulate the drives of every record and compare.

    For each axis a, period p and realisation r

        e = y - simulated,   E_apr = sqrt(mean_t e^2) / std_t(y)

    ``axes`` is the mean over p and r, ``mean`` that over a: the measure of the fine steering
    mirror's benchmark, for a reading that is simulated in its steady state. ``total`` weighs axes
    by their motion. A record without a period is one period.

    Args:
        model: fitted to other realisations, for an honest error.
        records: with the drives of the model.
    """
    campaign = AxesCampaign.of(records)
    first = campaign.records[0]
    found = []
    for level in campaign.levels:
        relative, squares, power = [], [], []
        for record in level:
            error, reading = residual(model, record)
            squares.append(np.mean(error**2, axis=(0, 1)))
            power.append(np.mean(reading.var(axis=1), axis=0))
            relative.append(
                np.mean(np.sqrt(np.mean(error**2, axis=1)) / reading.std(axis=1), axis=0)
            )
        found.append(
            LevelError(
                level.amplitude, tuple(one.name for one in level),
                np.asarray(np.mean(relative, axis=0)), np.sqrt(np.mean(squares, axis=0)),
                float(np.sqrt(np.sum(squares) / np.sum(power))),
            )
        )  # fmt: skip
    return AxesError(tuple(found), (first.drive_unit, first.position_unit))


def residual(model: ModalModel, record: AxesRecord) -> tuple[FloatArray, FloatArray]:
    """(P, samples, A) measured minus simulated, and (P, samples, A) measured, less its mean."""
    simulated = model.simulate(record)
    if record.period is None:
        reading, made = record.positions[np.newaxis], simulated[np.newaxis]
    else:
        _, reading = record.folded()
        made = simulated[: record.periods * record.period].reshape(reading.shape)
    return reading - made, reading - reading.mean(axis=1, keepdims=True)
