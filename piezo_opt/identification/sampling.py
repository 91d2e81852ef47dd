"""Records cut into sub-steps: the rows of which nonlinear programs are made."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from piezo_opt.assembly import System
from piezo_opt.errors import ModelError
from piezo_opt.identification.objective import Objective
from piezo_opt.identification.problem import Start
from piezo_opt.measurement import Measurement
from piezo_opt.simulation import INITIAL
from piezo_opt.simulation.engine import engine
from piezo_opt.simulation.schedule import Segment, corners, cycle, segments

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

_RUNAWAY = 1e3
"""A simulated state that leaves by more than this many sizes is no guess."""


@final
@dataclass(frozen=True, eq=False)
class Chain:
    """A stretch of time simulated from one start, cut into R sub-steps.

    Attributes:
        record: index of the record.
        segment: one sub-step a row; ``reading`` counts them.
        target: (R,) measured reading at the end of each sub-step, 0 where none is counted [m].
        weight: (R,) square root of the weight of that residual, 0 where none is counted.
        states: (R + 1, n) states at the start and after each sub-step, simulated at the start
            values, finite always.
        closed: whether it ends where it began (one period of a periodic record).
    """

    record: int
    segment: Segment
    target: FloatArray
    weight: FloatArray
    states: FloatArray
    closed: bool


def chains(objective: Objective, theta: FloatArray, from_record: bool) -> tuple[Chain, ...]:
    """The records of a question, cut into the sub-steps that its simulators chose.

    Args:
        objective: the question by single shooting.
        theta: SI values of the unknowns, from which the states are guessed.
        from_record: whether the position is guessed from what the record reads.
    """
    found: list[Chain] = []
    question = objective.question
    weights = question.weights or (1.0,) * len(objective.simulators)
    for i, simulator in enumerate(objective.simulators):
        record = question.campaign.records[i]
        numbers = objective.unknowns.of_record(i, theta)
        system = simulator.system
        drive = corners(record, system.channel_names)
        p = np.array([numbers[n] for n in system.parameter_names])
        delay = None if system.delay is None else _delay(system, objective, i, p)
        whole = segments(drive, record.time - record.time[0], delay)
        parts = [(whole, False)]
        if question.start_of(record) is Start.PERIODIC:
            parts.insert(0, (cycle(drive, float(record.period or 0.0)), True))
        for segment, closed in parts:
            count = simulator.accuracy.substeps.of(segment).astype(np.intp)
            cut = _cut(segment, count)
            target, weight = np.zeros(cut.length.size), np.zeros(cut.length.size)
            if not closed:
                at = segment.reading
                ends = np.cumsum(count) - 1
                read = ends[at >= 0]
                counted = objective.counted[i][at[at >= 0]]
                target[read] = np.where(counted, record.position[at[at >= 0]], 0.0)
                weight[read] = np.where(counted, float(np.sqrt(weights[i])), 0.0)
            stroke = float(np.ptp(record.position)) or 1.0
            states = _guess(system, cut, p, numbers, record if from_record else None, stroke)
            found.append(Chain(i, cut, target, weight, states, closed))
    return tuple(found)


def _delay(system: System, objective: Objective, index: int, p: FloatArray) -> float:
    assert system.delay is not None
    moved = np.array(system.delay.jac_sparsity(0, 0).T.row(), dtype=int)
    names = {system.parameter_names[k] for k in moved}
    for k in objective.unknowns.columns(index):
        member = objective.unknowns.members[k]
        if member.local in names:
            raise ModelError(
                f"'{member.name}' is estimated and moves the readings against the drive, which "
                "only single shooting follows; take transcription=SingleShooting(), or keep it: "
                f"fixed={{'{member.name}': ...}}."
            )
    return float(system.delay(p))


def _cut(segment: Segment, count: IntArray) -> Segment:
    """Every sub-step as a segment of its own."""
    which = np.repeat(np.arange(count.size), count)
    within = np.arange(which.size) - np.repeat(np.cumsum(count) - count, count)
    length = (segment.length / count)[which]
    past = within * length
    slope, beside = segment.slope[which], segment.channel_slopes[which]
    nothing = np.zeros(which.size)
    return Segment(
        length=length,
        time=segment.time[which] + past,
        drive=segment.drive[which] + slope * past,
        slope=slope,
        channels=np.ascontiguousarray(segment.channels[which] + beside * past[:, None]),
        channel_slopes=np.ascontiguousarray(beside),
        length_by_delay=nothing,
        drive_by_delay=nothing,
        time_by_delay=nothing,
        channels_by_delay=np.zeros_like(beside),
        reading=np.arange(which.size, dtype=np.int32),
        travel=(segment.travel / count)[which],
    )


def _guess(
    system: System,
    cut: Segment,
    p: FloatArray,
    numbers: dict[str, float],
    record: Measurement | None,
    stroke: float,
) -> FloatArray:
    """States simulated at the start values, the position corrected to what a record reads.

    A simulation alone is a poor guess where the resonance is wrong: it has the phase of another
    frequency. With the position from the record the program begins near the data, and the gaps
    tell what is wrong. States that run away are held at their last sane value.
    """
    deviation = np.array([numbers.get(INITIAL + n, 0.0) for n in system.state_names])
    given = (cut.time[0], cut.drive[0], cut.channels[0], p, deviation)
    first = np.array(system.start(*given), dtype=float).ravel()
    ones = np.ones(cut.length.size, dtype=np.int32)
    run = engine(system, (), True).run(cut, ones, p, first, np.zeros((first.size, 0)), states=True)
    assert run.states is not None
    states = np.vstack([first, run.states])
    lengths = np.array([unit == "m" for unit in system.state_units], dtype=bool)
    sane = np.isfinite(states).all(axis=1)
    with np.errstate(invalid="ignore"):
        sane &= (np.abs(states[:, lengths]) <= _RUNAWAY * stroke).all(axis=1)
    last = np.maximum.accumulate(np.where(sane, np.arange(sane.size), 0))
    held = np.where(np.isfinite(states[last]), states[last], 0.0)
    place = position_of(system)
    if place is None or record is None:
        return held
    end = cut.time + cut.length
    time = np.append(cut.time[0], end)
    drive = np.append(cut.drive[0], cut.drive + cut.slope * cut.length)
    slope = np.append(cut.slope[0], cut.slope)
    beside = np.vstack([cut.channels[:1], cut.channels + cut.channel_slopes * cut.length[:, None]])
    rates = np.vstack([cut.channel_slopes[:1], cut.channel_slopes])
    modelled = system.reading.map(time.size)(
        time, held.T, drive, slope, beside.T, rates.T, ca.repmat(ca.DM(p), 1, time.size)
    )
    measured = np.interp(time, record.time - record.time[0], record.position)
    missing = measured - np.array(modelled).ravel()
    held[:, place] += np.where(np.isfinite(missing), missing, 0.0)
    return held


def position_of(system: System) -> int | None:
    """Index of the position of the mechanics among the states, None for a quasi-static chain."""
    for name, effect in system.model:
        for state, declared in effect.declared_states.items():
            if declared.position:
                return system.state_names.index(f"{name}.{state}")
    return None


def state_sizes(parts: tuple[Chain, ...], units: tuple[str, ...], stroke: float) -> FloatArray:
    """A positive size of every state, from the guess; a small share of the stroke at least."""
    top = np.max([np.abs(part.states).max(axis=0) for part in parts], axis=0)
    least = np.array([1e-3 * stroke if unit == "m" else 0.0 for unit in units])
    sizes = np.maximum(top, least)
    return np.where(sizes > 0, sizes, 1.0)
