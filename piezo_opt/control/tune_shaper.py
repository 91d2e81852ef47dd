"""Which shaper for an identified actuator, and why."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.control.identified import Source, identified
from piezo_opt.control.linearise import linearise
from piezo_opt.control.modes import Mode, modes, vibration
from piezo_opt.control.observable import remarks
from piezo_opt.control.robust_shaper import robust
from piezo_opt.control.scenarios import scenarios as drawn
from piezo_opt.control.shapers import Shaper, ei, insensitivity, zv, zvd
from piezo_opt.errors import InputError
from piezo_opt.units import quantity, show

FloatArray = NDArray[np.float64]

CHECKS: Final = 400
"""Further actuators on which shapers are compared: 95 % is known to 1 % of all then."""
DESIGN: Final = 60
"""Actuators of the program: their mean is known to 13 % of their spread."""
_APART: Final = 1_000_003


@final
@dataclass(frozen=True, eq=False)
class Row:
    """What a shaper does.

    Attributes:
        shaper: the shaper.
        vibration: left on the fit's values, as a share of that of a bare step.
        likely, worst: left on the actuators that the record allows: 95 % have less; the largest.
        smoothing: standard deviation of the impulses' times, by which an edge is spread [s].
        insensitivity: width of the range of frequencies with 5 % or less, over the frequency.
    """

    shaper: Shaper
    vibration: float
    likely: float
    worst: float
    smoothing: float
    insensitivity: float

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units."""
        return {
            "name": self.shaper.name,
            "amplitudes": self.shaper.amplitudes.tolist(),
            "times": self.shaper.times.tolist(),
            "delay": self.shaper.delay,
            "vibration": self.vibration, "likely": self.likely, "worst": self.worst,
            "smoothing": self.smoothing, "insensitivity": self.insensitivity,
        }  # fmt: skip


@final
@dataclass(frozen=True, eq=False)
class TunedShaper:
    """Shapers side by side, and the one to take.

    Attributes:
        shaper: the one to take, and ``reason`` why.
        rows: all of them, the shortest first.
        modes: of the fit's values, the largest first.
        frequencies: (k,) of the largest mode of the actuators that the record allows [Hz].
        allowed: share of the swinging that may stay.
        scenarios, seed: draws of the design.
        remarks: sentences on the plant.
    """

    shaper: Shaper
    reason: str
    rows: tuple[Row, ...]
    modes: tuple[Mode, ...]
    frequencies: FloatArray
    allowed: float
    scenarios: int
    seed: int
    remarks: tuple[str, ...] = ()

    def __str__(self) -> str:
        told = " and ".join(
            f"{show(m.omega / (2.0 * np.pi), 'Hz')} with damping {m.zeta:.3g}"
            + ("" if len(self.modes) == 1 else f" ({100 * m.share:.0f} % of the swing)")
            for m in self.modes
        )
        low, high = np.quantile(self.frequencies, (0.025, 0.975))
        lines = [
            f"modes that swing: {told}; the first lies between {show(float(low), 'Hz')} and "
            f"{show(float(high), 'Hz')} (95 %)",
            "",
            f"{'shaper':<8}{'delay':>10}{'spread':>10}{'left':>9}{'95 %':>9}{'worst':>9}"
            f"{'width at 5 %':>14}",
        ]
        for row in self.rows:
            lines.append(
                f"{row.shaper.name:<8}{show(row.shaper.delay, 's'):>10}"
                f"{show(row.smoothing, 's'):>10}{100 * row.vibration:>7.2f} %"
                f"{100 * row.likely:>7.2f} %{100 * row.worst:>7.2f} %"
                f"{100 * row.insensitivity:>12.0f} %"
            )
        impulses = ", ".join(
            f"{a:.4f} at {show(float(t), 's')}"
            for a, t in zip(self.shaper.amplitudes, self.shaper.times, strict=True)
        )
        return "\n".join([*lines, "", f"{self.reason} Impulses: {impulses}.", *self.remarks])

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units, with a ``schema`` key."""
        return {
            "schema": "piezo_opt/tune_shaper/1",
            "controller": {
                "kind": "shaper", "name": self.shaper.name,
                "amplitudes": self.shaper.amplitudes.tolist(),
                "times": self.shaper.times.tolist(),
            },
            "reason": self.reason,
            "shapers": [row.to_dict() for row in self.rows],
            "modes": [
                {"omega": m.omega, "zeta": m.zeta, "share": m.share} for m in self.modes
            ],
            "frequencies": self.frequencies.tolist(),
            "allowed": self.allowed,
            "scenarios": self.scenarios,
            "seed": self.seed,
            "remarks": list(self.remarks),
        }  # fmt: skip


def tune_shaper(
    plant: Source,
    *,
    values: Mapping[str, float] | None = None,
    allowed: float = 0.05,
    delay: float | str | None = None,
    spread: float = 0.0,
    scenarios: int = DESIGN,
    seed: int = 0,
    at: float | str = 0.0,
    progress: Callable[[str], None] | None = None,
) -> TunedShaper:
    """Compare ZV, ZVD, EI and a robust shaper on what a record allows, and say which to take.

    The robust one minimises the mean square of the vibration over actuators drawn from the fit's
    covariance, all modes included, and is as long as ZVD. All are judged on 400 other draws. The
    shortest is taken that leaves ``allowed`` or less on 95 % of them.

    Args:
        plant: a fit, the JSON of one, or a model with ``values``, for which ``spread`` tells.
        values: SI values by full name, which go before those of the plant.
        allowed: share of a bare step's swinging that may stay.
        delay: longest of the robust shaper [s].
        spread: by which the frequencies may be off beside what the covariance says, as one standard
            deviation of their share: 0.02 for a load that changes them by 2 %.
        scenarios: draws of the design.
        seed: of the draws.
        at: drive around which the model is linearised [V].
        progress: told how it goes.

    Raises:
        InputError: nothing of the model swings, or it runs away by itself; shares that are none.
    """
    known = identified(plant, values)
    if not 0.0 < allowed < 1.0 or not 0.0 <= spread < 0.5 or scenarios < 1:
        raise InputError(
            f"allowed = {allowed}, spread = {spread}, scenarios = {scenarios}: give shares, 0.05, "
            "and one scenario or more"
        )
    say = progress or (lambda _: None)

    def actuators(count: int, seed: int) -> list[tuple[Mode, ...]]:
        own, generator = known.numbers, np.random.default_rng(seed)
        sets = [own] * count if known.covariance is None else [
            own.with_({k: v for k, v in d.of_record(0).items() if k in own})
            for d in drawn(known, count, seed)
        ]  # fmt: skip
        found = []
        for one in sets:
            # A normal deviation beyond twice its spread is no load that somebody puts on.
            off = 1.0 + spread * float(np.clip(generator.normal(), -2.0, 2.0))
            swinging = modes(linearise(known.model, one, at=at))
            found.append(tuple(Mode(off * m.omega, m.zeta, m.share) for m in swinging))
        return found

    linear = linearise(known.model, known.numbers, at=at)
    said = remarks(linear)
    own = modes(linear)
    first = own[0]
    say(f"{scenarios} actuators that the record allows")
    design = actuators(scenarios, seed)
    longest = None if delay is None else quantity(delay, "s")
    shapers = [
        zv(first.omega, first.zeta), zvd(first.omega, first.zeta),
        ei(first.omega, first.zeta, allowed), robust([own, *design], longest),
    ]  # fmt: skip
    say(f"{len(shapers)} shapers on {CHECKS} others")
    others = actuators(CHECKS, seed + _APART)
    rows = tuple(sorted((_row(s, own, others) for s in shapers), key=lambda r: r.shaper.delay))
    chosen, reason = _chosen(rows, allowed)
    frequencies = np.array([one[0].omega for one in others]) / (2.0 * np.pi)
    return TunedShaper(
        chosen, reason, rows, own, frequencies, allowed, scenarios, seed, said
    )  # fmt: skip


def _row(shaper: Shaper, own: Sequence[Mode], others: Sequence[Sequence[Mode]]) -> Row:
    left = np.array([vibration(shaper.amplitudes, shaper.times, one) for one in others])
    mean = float(shaper.amplitudes @ shaper.times)
    return Row(
        shaper, vibration(shaper.amplitudes, shaper.times, own), float(np.quantile(left, 0.95)),
        float(left.max()), float(np.sqrt(shaper.amplitudes @ (shaper.times - mean) ** 2)),
        insensitivity(shaper, own[0].omega, own[0].zeta),
    )  # fmt: skip


def _chosen(rows: Sequence[Row], allowed: float) -> tuple[Shaper, str]:
    """The shortest that keeps what is allowed, and else the one that leaves least."""
    good = [row for row in rows if row.likely <= allowed]
    if good:
        # Of equal length the one that leaves less.
        row = min(good, key=lambda r: (round(r.shaper.delay / rows[0].shaper.delay, 2), r.likely))
        why = (
            f"it is the shortest that leaves {100 * allowed:g} % of the swing or less on 95 % of "
            "the actuators that the record allows"
        )
    else:
        row = min(rows, key=lambda r: r.likely)
        why = (
            f"none leaves {100 * allowed:g} % or less on 95 % of the actuators that the record "
            f"allows, and it leaves least, {100 * row.likely:.2g} %; a record that tells the "
            "resonance better, or a longer delay, would help"
        )
    return row.shaper, f"Take {row.shaper.name}: {why}."
