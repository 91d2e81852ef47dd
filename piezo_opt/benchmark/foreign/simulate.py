"""One plant, one drive: the reading without noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias, final

import numpy as np

from piezo_opt.benchmark.foreign.charge import SourceResistance
from piezo_opt.benchmark.foreign.mechanics import Force
from piezo_opt.benchmark.foreign.operators import Array, Operator
from piezo_opt.benchmark.foreign.scene import Beside, Nodes, OnDrive, OnReading, OnStrain, Scene

Effect: TypeAlias = OnDrive | OnStrain | Force | Beside | OnReading | SourceResistance
"""Anything that may be hidden; a dataclass with a ``strength``."""


@final
@dataclass(frozen=True, eq=False)
class Take:
    """What is played to a plant.

    Attributes:
        drive: at the samples [V], linear between; the first ones are not recorded.
        first: sample with which the record begins.
        warmth: temperature over the reference [K], at the samples.
        parts: sub-steps of a sample.
    """

    drive: Array
    first: int
    warmth: Array
    parts: int

    @property
    def recorded(self) -> Array:
        """The drive of the record [V]."""
        return self.drive[self.first :]

    def finer(self) -> Take:
        """With sub-steps of half the length."""
        return replace(self, parts=2 * self.parts)


@final
@dataclass(frozen=True)
class Plant:
    """A plant without any effect.

    Attributes:
        operator: of the drive over ``volt``.
        volt: largest drive [V].
        gain: free displacement over the operator's output [m].
        offset: of the sensor [m].
        scene: its scales.
    """

    operator: Operator
    volt: float
    gain: float
    offset: float
    scene: Scene

    def free(self, drive: Array) -> Array:
        """Free displacement [m]."""
        found: Array = self.gain * self.operator(drive / self.volt)
        return found


def simulate(plant: Plant, effects: Sequence[Effect], take: Take) -> Array:
    """Clean reading at the recorded samples [m]; NaN where the mechanics gave way.

    Input effects act on the drive, then the hysteresis and what acts on the strain, the mechanics
    with all forces, what moves beside them, and the sensor. It starts at rest. Without a
    resonance there are no forces and no other modes.
    """
    scene = plant.scene
    samples = np.arange(take.drive.size)
    at = np.arange((take.drive.size - 1) * take.parts + 1) / take.parts
    nodes = Nodes(
        scene, (at - take.first) / scene.rate, 1.0 / (scene.rate * take.parts),
        np.interp(at, samples, take.warmth),
    )  # fmt: skip
    drive = np.interp(at, samples, take.drive)
    for effect in effects:
        if isinstance(effect, OnDrive):
            drive = effect.on_drive(drive, nodes)

    def strain(voltage: Array) -> Array:
        found = plant.free(voltage)
        for effect in effects:
            if isinstance(effect, OnStrain):
                found = effect.on_strain(voltage, found, nodes)
        return found

    forces = tuple(effect for effect in effects if isinstance(effect, Force))
    loads = [effect for effect in effects if isinstance(effect, SourceResistance)]
    if scene.resonance is None:
        position = strain(drive)
    elif loads:
        position = loads[0].moved(strain, drive, scene.resonance, nodes.step)
    else:
        free = strain(drive)
        position = scene.resonance.moved(free, forces, nodes.step)
        for effect in effects:
            if isinstance(effect, Beside):
                position = position + effect.beside(free, nodes)
    position = position + plant.offset
    for effect in effects:
        if isinstance(effect, OnReading):
            position = effect.on_reading(position, nodes)
    return position[:: take.parts][take.first :]
