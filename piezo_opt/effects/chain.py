"""What an effect reads of the chain, and what its equations give back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import final

from piezo_opt.errors import ModelError
from piezo_opt.symbolic import Expression


@final
@dataclass(frozen=True)
class Signal:
    """A signal of the chain and its time derivative.

    ``heading`` is the rate too, for what an effect gives whose rate alone asks where the signal
    goes: its value must not follow it.
    """

    value: Expression
    rate: Expression
    heading: Expression = None

    def __post_init__(self) -> None:
        if self.heading is None:
            object.__setattr__(self, "heading", self.rate)


@final
@dataclass(frozen=True)
class Chain:
    """What an effect may read. Signals are upstream of its place; states are free to read.

    Attributes:
        time: time of the record [s].
        command: the recorded drive [V] and its rate.
        incoming: on a line: the signal as the effect before left it.
        drive: end of the INPUT line [V].
        hysteresis: the hysteretic displacement h [m]: what the hysteresis law takes from the
            strain (0 without one).
        law: the rate of h by its own law [m/s], before the LOOP balance adds to it.
        free: free displacement s, the sum of the STRAIN balance [m], and its rate.
        position: position x [m] and velocity x' [m/s]; equal to ``free`` when quasi-static.
        acceleration: x'' [m/s^2]: the MOTION balance; only for rates of states.
        channels: further recorded channels by name, e.g. ``"temperature"`` [K].
    """

    time: Expression
    command: Signal
    incoming: Signal
    drive: Signal
    hysteresis: Expression
    law: Expression
    free: Signal
    position: Signal
    acceleration: Expression
    channels: Mapping[str, Signal]


@final
@dataclass(frozen=True)
class Equations:
    """What an effect gives its place and how its own states move.

    Attributes:
        gives: on a balance, what is added; on a line, the outgoing signal.
        moves: time derivative of each own state, by name.
        starts: value of own states at rest at the start of a record (0 where not named).
        becomes: states that jump instead of flowing: their value after a monotone stretch of
            the drive, from their value before and the signals at its end (play operators).
        delays: seconds by which the whole chain lags the command (only ``Delay``).
        inertia: mass that the position carries, over the mass the MOTION balance is written for:
            the balance is divided by one plus the sum of them (only ``LoadMass``).
    """

    gives: Expression
    moves: Mapping[str, Expression] = field(default_factory=dict)
    starts: Mapping[str, Expression] = field(default_factory=dict)
    becomes: Mapping[str, Expression] = field(default_factory=dict)
    delays: Expression = 0.0
    inertia: Expression = 0.0


class Symbols(SimpleNamespace):
    """Own symbols of an effect by attribute: ``p.alpha``, ``x.h``."""

    def __getattr__(self, name: str) -> Expression:
        raise ModelError(f"'{name}' is not declared in the effect's class body.")
