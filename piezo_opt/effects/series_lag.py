"""First-order lags in series: what amplifier, sensor and charge coupling have in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from piezo_opt.effects.base import Effect, Parameter
from piezo_opt.errors import ModelError
from piezo_opt.symbolic import Expression, stack

RATIO = Parameter(
    "1", "second time constant over the first", nominal=0.2, bounds=(0.03, 1.0),
    typical=(0.05, 0.5), fixed=True, detail=True,
)  # fmt: skip
"""Of an effect with the option ``poles``, 1 or 2."""


def lag_rates(lagged: Expression, value: Expression, taus: Sequence[Expression]) -> Expression:
    """Rates of lags in series: ``tau_1 z_1' = value - z_1, tau_2 z_2' = z_1 - z_2``."""
    before, rates = value, []
    for i, tau in enumerate(taus):
        rates.append((before - lagged[i]) / tau)
        before = lagged[i]
    return stack(rates)


def time_constants(effect: Any, p: Any) -> tuple[Expression, ...]:
    """Those of an effect's poles, from ``tau`` and ``ratio``.

    Raises:
        ModelError: neither one pole nor two.
    """
    if effect.poles not in (1, 2):
        raise ModelError(f"{effect.name}: poles is {effect.poles}; give 1 or 2.")
    both: tuple[Expression, ...] = (p.tau, p.ratio * p.tau)
    return both[: effect.poles]


def with_second_pole(effect: Any, own: Mapping[str, float]) -> tuple[Effect, Mapping[str, float]]:
    """The effect with two poles whose delays add up to that of its one; itself if it has two."""
    if effect.poles == 2:
        return effect, {}
    return replace(effect, poles=2), {"tau": own["tau"] / (1.0 + RATIO.nominal)}


def like_a_lag(other: str, own: Mapping[str, float]) -> Mapping[str, float] | None:
    """A short delay is a lag of that time constant; what lags elsewhere lags as much here."""
    if other == "delay":
        return {"share": 1.0, "tau": own["T"]}
    if other in ("amplifier_lag", "sensor_lag"):
        return {"share": own["share"], "tau": own["tau"]}
    return None
