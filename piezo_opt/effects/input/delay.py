"""A pure delay between command and motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place


@final
@dataclass(frozen=True)
class Delay(Effect):
    """Pure delay of the command: conversion and transport time.

        v(t) = u(t - T)

    A pure delay commutes with every stage that does not change with time, so the simulation
    runs on the drive's own clock and reads the output T later: exact, with an exact derivative.

    References: Franklin, Powell & Workman (1998), Digital Control of Dynamic Systems, sec. 4.3.
    """

    place = Place.INPUT
    T = Parameter("s", "delay", nominal=0.0, bounds=(0.0, 10.0), typical=(5e-5, 1e-3), null=0.0)

    def like(self, other: str, own: Mapping[str, float]) -> Mapping[str, float] | None:
        """What lags delays a slow signal: by a share of its time constant, mechanics by
        2 zeta / omega."""
        if other in ("amplifier_lag", "sensor_lag"):
            return {"T": own["share"] * own["tau"]}
        return {"T": 2.0 * own["zeta"] / own["omega"]} if other == "second_order" else None

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The signal passes; the whole chain is read T later."""
        return Equations(gives=chain.incoming.value, delays=p.T)
