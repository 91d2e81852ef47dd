"""Whether a loop comes to rest: linear margins know nothing of the limits of a drive."""

from __future__ import annotations

from typing import Final

import numpy as np

from piezo_opt.control.closed_loop import Controller, close_loop
from piezo_opt.control.plant import ModelPlant
from piezo_opt.control.task import Task

SHAKEN: Final = 60
CALMED: Final = 600
"""Samples of a fault of the sensor, and after it, by which a loop is tried."""


def calm(controller: Controller, what: Task) -> bool:
    """Whether a loop comes to rest at a constant reference, from rest and after a fault.

    The sensor is off by half of what the drive reaches, the other way every second sample. A cycle
    between limits of the drive, which no linear margin tells, moves more than 1 % of that, and
    keeps its size: a swing that dies away loses a tenth of it or more in a quarter of the time.
    """
    asked, plant = what.asked, what.plant
    width = what.width
    goal = np.full(SHAKEN + CALMED, float(np.mean(asked.references[0])))
    sign = 1.0 - 2.0 * ((np.arange(SHAKEN) // 2) % 2)
    shaking = np.concatenate([0.5 * width * sign, np.zeros(CALMED)])
    for off in (np.zeros(goal.size), shaking):
        loop = close_loop(
            ModelPlant(plant.model, plant.numbers), controller, goal, period=asked.period,
            limits=asked.limits, delay=asked.delay, noise=asked.noise, disturbance=off,
            seed=asked.seed,
        )  # fmt: skip
        before, after = (
            float(np.std(part - np.linspace(part[0], part[-1], part.size)))
            for part in np.split(loop.position[-CALMED // 2 :], 2)
        )
        if after > max(0.01 * width + 3.0 * asked.noise, 0.9 * before):
            return False
    return True
