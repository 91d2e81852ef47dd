"""What a video tells of a displacement."""

from __future__ import annotations

import os
from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, final

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.files import replacing
from piezo_opt.measurement import FEWEST_SAMPLES, FloatArray, Measurement
from piezo_opt.measurement.arrays import BoolArray
from piezo_opt.readers.drives import DriveSignal
from piezo_opt.readers.memory import hdf5_in_memory
from piezo_opt.units import show
from piezo_opt.video.box import Box
from piezo_opt.video.judging import Lost


@final
@dataclass(frozen=True, eq=False)
class Track:
    """The place of a feature, frame by frame.

    Attributes:
        time: (N,) instants [s], from the file.
        place: (N, 2) x and y of the box's centre [px]; not a number where the frame is lost.
        covariance: (N, 2, 2) of the place [px^2].
        lost: why a frame is lost; None where it is not.
        reference: x and y [px] of the point that distances are from.
        scale: [m/px].
        box: of the feature, in the first frame.
        first: (H, W) the first frame, for pictures.
        name: of the video.
        source: its file.
        whole_pixels: whether places were rounded to pixels.
        notes: what was concluded, in sentences.
    """

    time: FloatArray
    place: FloatArray
    covariance: FloatArray
    lost: tuple[Lost | None, ...]
    reference: tuple[float, float]
    scale: float
    box: Box
    first: FloatArray
    name: str = "track"
    source: str = ""
    whole_pixels: bool = False
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return int(self.time.size)

    @cached_property
    def valid(self) -> BoolArray:
        """(N,) frames that are believed."""
        return np.array([why is None for why in self.lost])

    @cached_property
    def _away(self) -> FloatArray:
        return np.asarray(self.place - np.array(self.reference))

    @cached_property
    def distance(self) -> FloatArray:
        """(N,) Euclidean distance from the reference point [m]; not a number where lost."""
        return np.asarray(self.scale * np.linalg.norm(self._away, axis=1))

    @cached_property
    def sigma(self) -> FloatArray:
        """(N,) of the distance [m]: sqrt(u' C u) with u towards the feature; NaN where lost.

        Of changes of the distance. Where the box lies on the feature, and where the reference
        point, is the user's choice and errs the same in all frames.
        """
        length = np.linalg.norm(self._away, axis=1, keepdims=True)
        with np.errstate(invalid="ignore", divide="ignore"):
            ahead = np.where(length > 0.0, self._away / length, 1.0 / np.sqrt(2.0))
        variance = np.einsum("ni,nij,nj->n", ahead, self.covariance, ahead)
        return np.asarray(self.scale * np.sqrt(variance))

    @property
    def usual_sigma(self) -> float:
        """The median sigma [m]."""
        return float(np.median(self.sigma[self.valid]))

    def record(self, drive: DriveSignal, delay: float = 0.0) -> Measurement:
        """The distance beside a drive that something else recorded.

        A lost frame keeps its drive; its reading is left out, and a straight line stands there. The
        sigma becomes a channel.

        Args:
            drive: over its own clock.
            delay: instant of the video [s] at which the drive's clock is zero.

        Raises:
            InputError: fewer than eight frames lie within the drive's time.
        """
        clock = self.time - delay
        within = (clock >= drive.time[0]) & (clock <= drive.time[-1])
        if np.count_nonzero(within & self.valid) < FEWEST_SAMPLES:
            raise InputError(
                f"{self.source}: only {np.count_nonzero(within & self.valid)} frames that are not "
                f"lost lie within the drive's {drive.time[0]:g} s to {drive.time[-1]:g} s (the "
                f"video runs from {clock[0]:g} s to {clock[-1]:g} s): say when it began, "
                "delay='0.4 s'"
            )
        # A record does not begin or end with a reading that nothing stands in for.
        inside = np.flatnonzero(within & self.valid)
        rows = slice(int(inside[0]), int(inside[-1]) + 1)
        valid, time = self.valid[rows], clock[rows]
        kept = time[valid]
        return Measurement(
            time=time,
            drive=drive.at(time),
            position=np.interp(time, kept, self.distance[rows][valid]),
            channels={"sigma": np.interp(time, kept, self.sigma[rows][valid])},
            channel_units={"sigma": "m"},
            name=self.name,
            drive_unit=drive.unit,
            between=drive.between,
            source=self.source,
            left_out=~valid,
            allow_saturated=True,
            notes=self.notes,
        )

    def write(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
        """Write the frames that are not lost as .csv, .h5 or .hdf5: all of the file or none.

        Columns: time [s], displacement [m] (the distance) and sigma [m].

        Raises:
            InputError: another suffix, or the file exists or cannot be written.
        """
        suffix = Path(path).suffix.lower()
        if suffix not in (".csv", ".h5", ".hdf5"):
            raise InputError(f"{path}: a track is written as .csv, .h5 or .hdf5: choose one")
        columns = {
            ("time", "s"): self.time, ("displacement", "m"): self.distance,
            ("sigma", "m"): self.sigma,
        }  # fmt: skip
        kept = {key: values[self.valid] for key, values in columns.items()}
        with replacing(path, overwrite=overwrite) as temporary:
            if suffix == ".csv":
                with temporary.open("x", encoding="utf-8", newline="\n") as lines:
                    lines.write(",".join(f"{name} [{unit}]" for name, unit in kept) + "\n")
                    for row in zip(*(v.tolist() for v in kept.values()), strict=True):
                        lines.write(",".join(map(repr, row)) + "\n")
                return
            with hdf5_in_memory(temporary) as file:
                for (name, unit), values in kept.items():
                    file.create_dataset(name, data=values).attrs["units"] = unit

    @property
    def sentence(self) -> str:
        """The outcome in words."""
        count = int(np.count_nonzero(self.valid))
        travel = float(np.ptp(self.distance[self.valid]))
        return (
            f"{count} of {len(self)} frames tell a distance: it moves by {show(travel, 'm')}, each "
            f"known to ± {show(2.0 * self.usual_sigma, 'm')} (two sigma, "
            f"{2.0 * self.usual_sigma / self.scale:.2g} pixels)."
        )

    def __str__(self) -> str:
        why = Counter(one.value for one in self.lost if one is not None)
        lines = [self.sentence, *self.notes]
        lines += [
            f"{number} {'frame' if number == 1 else 'frames'} lost: {said}."
            for said, number in why.most_common()
        ]
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units and pixels."""
        return {
            "schema": "piezo_opt/track/1",
            "source": self.source,
            "scale": self.scale,
            "reference": list(self.reference),
            "box": [self.box.x, self.box.y, self.box.width, self.box.height],
            "notes": list(self.notes),
            "time": self.time.tolist(),
            "distance": self.distance.tolist(),
            "sigma": self.sigma.tolist(),
            "x": self.place[:, 0].tolist(),
            "y": self.place[:, 1].tolist(),
            "lost": [None if one is None else one.value for one in self.lost],
        }
