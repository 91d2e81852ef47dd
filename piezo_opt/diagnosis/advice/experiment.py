"""An experiment that is advised: a drive, and what it would tell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np

from piezo_opt.diagnosis.drives import Excitation
from piezo_opt.errors import InputError

SEEN: Final = 5.0
"""Sigmas from which an effect counts as shown, or two as told apart."""


@final
@dataclass(frozen=True)
class Trial:
    """What one drive would tell.

    Attributes:
        drive: the drive.
        sigmas: by how much it separates the two members most alike, or shows the hardest to see.
        hardest: the two (or the one) that are meant.
    """

    drive: Excitation
    sigmas: float
    hardest: tuple[str, ...]


@final
@dataclass(frozen=True)
class Advice:
    """One experiment, and what it would tell.

    Attributes:
        group: names that it would tell apart, or show.
        drive: what to play.
        rate: samples a second [Hz] at which it was judged.
        sigmas: expected separation of the two most alike, or of the hardest to see from noise.
        here: the same on the fitted records.
        detectable: for effects to be shown, the gate's size [SI] that shows with five sigmas.
        assumed: own parameters [SI] that are assumed of each member.
        trials: all drives judged, best first.
        sentence: the same in words.
    """

    group: tuple[str, ...]
    drive: Excitation
    rate: float
    sigmas: float
    here: float
    detectable: Mapping[str, float]
    assumed: Mapping[str, Mapping[str, float]]
    trials: tuple[Trial, ...]
    sentence: str

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units."""
        return {
            "group": list(self.group),
            "drive": self.drive.description,
            "file": f"{self.drive.name}.csv",
            "rate": self.rate,
            "sigmas": self.sigmas,
            "sigmas_here": self.here,
            "detectable": dict(self.detectable),
            "assumed": {name: dict(own) for name, own in self.assumed.items()},
        }


def check_noise(noise: float) -> None:
    """Refuse a noise [m] in which no sigmas can be counted."""
    if not 0.0 < noise < np.inf:
        raise InputError(f"noise is {noise:g} m; give a positive length in metres.")
