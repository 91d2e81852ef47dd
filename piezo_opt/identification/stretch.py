"""A part of a long record that keeps its events."""

from __future__ import annotations

import numpy as np

from piezo_opt.measurement import Measurement

_CHANCE = 5.0
"""Chance spread of the way of n samples over sqrt(n) median moves: four deviations (one window in
many is asked) of the difference of two sums of |white noise|, each of 0.9 medians a sample."""


def busiest(record: Measurement, samples: int) -> Measurement:
    """The stretch of so many samples in which the reading moves most; the record if it is shorter.

    The way of the reading, the sum of its moves from sample to sample, is what drive and actuator
    did together: the step of a staircase with what rings after it, the resonance that a sweep runs
    through and not its faster end. Noise adds the same way to every stretch but for its chance
    spread: of neighbouring stretches whose way is the largest within that the middle one is taken,
    so that an event has its before and its after.
    Where the drive is constant over that stretch, the way of the drive counts instead.

    Args:
        record: the record; one with a period is not cut.
        samples: length of the stretch, at least 2.
    """
    n = len(record)
    if n <= samples or record.period is not None:
        return record
    for signal in (record.position, record.drive):
        moves = np.abs(np.diff(signal))
        moved = np.concatenate([[0.0], np.cumsum(moves)])
        way = moved[samples - 1 :] - moved[: n - samples + 1]
        best = int(np.argmax(way))
        quiet = way < way[best] - _CHANCE * np.median(moves) * np.sqrt(samples)
        after = np.flatnonzero(quiet[best:])
        before = np.flatnonzero(quiet[:best])
        last = best + int(after[0]) - 1 if after.size else way.size - 1
        first = int(before[-1]) + 1 if before.size else 0
        part = slice(middle := (first + last) // 2, middle + samples)
        if np.ptp(record.drive[part]) > 0.0:
            break
    return stretch(record, part)


def stretch(record: Measurement, part: slice) -> Measurement:
    """A part of a record as one that begins in the middle of a motion."""
    return record.with_(
        time=record.time[part], drive=record.drive[part], position=record.position[part],
        channels={k: v[part] for k, v in record.channels.items()}, startup=0.0,
        left_out=record.left_out[part],
        allow_saturated=True,
    )  # fmt: skip
