"""Lags of first or second order: what amplifier, sensor and charge coupling have in common."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from piezo_opt.effects.base import Effect, Parameter
from piezo_opt.errors import ModelError
from piezo_opt.symbolic import Expression, stack

DAMPING = Parameter(
    "1", "damping ratio of the two poles", nominal=1.0, bounds=(0.3, 3.0), typical=(0.5, 1.5),
    fixed=True, detail=True,
)  # fmt: skip
"""Of an effect with the option ``poles``, 1 or 2: above 1 two lags in series, at 0.71 the filter of
Butterworth; with less than 0.3 it would ring, as mechanics do."""


def lagging(effect: Any, z: Expression, value: Expression, p: Any) -> Expression:
    """Rates of the states z of a lag, of which the first is what follows a value:

        tau z_1' = value - z_1
        tau z_1' = z_2,   tau z_2' = value - z_1 - 2 zeta z_2   two poles

    Raises:
        ModelError: neither one pole nor two.
    """
    if effect.poles not in (1, 2):
        raise ModelError(f"{effect.name}: poles is {effect.poles}; give 1 or 2.")
    if effect.poles == 1:
        return stack([(value - z[0]) / p.tau])
    return stack([z[1] / p.tau, (value - z[0] - 2.0 * p.zeta * z[1]) / p.tau])


def with_second_pole(effect: Any, own: Mapping[str, float]) -> tuple[Effect, Mapping[str, float]]:
    """The effect with two poles whose delays add up to that of its one; itself if it has two."""
    if effect.poles == 2:
        return effect, {}
    return replace(effect, poles=2), {"tau": 0.5 * own["tau"] / DAMPING.nominal}


def like_a_lag(effect: Any, other: str, own: Mapping[str, float]) -> Mapping[str, float] | None:
    """A short delay is a lag of that time constant; what lags elsewhere lags as much here.

    Mechanics that do not ring are two poles, or one of the delay of a slow signal 2 zeta / omega.
    """
    if other == "delay":
        return {"share": 1.0, "tau": own["T"]}
    if other in ("amplifier_lag", "sensor_lag"):
        return {"share": own["share"], "tau": own["tau"]}
    if other == "second_order" and effect.poles == 1:
        return {"share": 1.0, "tau": 2.0 * own["zeta"] / own["omega"]}
    if other == "second_order":
        zeta = min(max(own["zeta"], DAMPING.bounds[0]), DAMPING.bounds[1])
        return {"share": 1.0, "tau": 1.0 / own["omega"], "zeta": zeta}
    return None
