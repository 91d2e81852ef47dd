"""A model: an immutable sum of named effects."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, final

from piezo_opt.effects.declare import Parameter, Place
from piezo_opt.errors import ModelError

if TYPE_CHECKING:
    from piezo_opt.effects.effect import Effect

_ARROWS = {
    Place.INPUT: "drive v",
    Place.LOOP: "hysteretic displacement h",
    Place.STRAIN: "free displacement s",
    Place.MOTION: "position x",
    Place.OUTPUT: "reading y",
}


@final
@dataclass(frozen=True)
class Model:
    """An immutable sum of effects: ``PiezoGain() + BoucWen() + SecondOrder()``.

    Effects on a line (INPUT, OUTPUT) act in the order written; on a balance the order cannot
    matter. Names are the effects' own, with ``_2``, ``_3`` ... for repeated ones.
    """

    named: tuple[tuple[str, Effect], ...]

    @staticmethod
    def of(*effects: Effect) -> Model:
        """The sum of these effects."""
        model = Model(())
        for effect in effects:
            model = model + effect
        return model

    def __post_init__(self) -> None:
        if not all(isinstance(pair, tuple) and len(pair) == 2 for pair in self.named):
            raise ModelError("A model is a sum: write PiezoGain() + BoucWen(), or Model.of(...).")
        loops = [n for n, e in self.named if any(s.loop for s in e.declared_states.values())]
        if len(loops) > 1:
            raise ModelError(
                f"The model has {len(loops)} hysteresis loops ({', '.join(loops)}); keep one: "
                f"model.without('{loops[-1]}')."
            )
        moved = [n for n, e in self.named if any(s.position for s in e.declared_states.values())]
        if len(moved) > 1:
            raise ModelError(
                f"The model has {len(moved)} positions ({', '.join(moved)}); keep one mechanics: "
                f"model.without('{moved[-1]}')."
            )

    def __add__(self, other: Effect | Model) -> Model:
        if isinstance(other, Model):
            model = self
            for _, effect in other.named:
                model = model + effect
            return model
        if isinstance(other, type) and hasattr(other, "check_frozen"):
            raise ModelError(f"{other.__name__} is a class: write {other.__name__}().")
        if not hasattr(other, "check_frozen"):
            raise ModelError(f"{other!r} is no effect: a model is a sum of effects.")
        other.check_frozen()
        name, count = other.name, 1
        taken = {n for n, _ in self.named}
        if other.structural and name in taken:
            raise ModelError(f"The model already has {name}; a second one could not be told apart.")
        while name in taken:
            count += 1
            name = f"{other.name}_{count}"
        return Model((*self.named, (name, other)))

    def without(self, name: str) -> Model:
        """The model less the effect of that name."""
        self[name]
        return Model(tuple((n, e) for n, e in self.named if n != name))

    def replaced(self, name: str, effect: Effect) -> Model:
        """The model with another effect in the place of the named one."""
        self[name]
        return Model.of(*(effect if n == name else e for n, e in self.named))

    def __getitem__(self, name: str) -> Effect:
        for n, effect in self.named:
            if n == name:
                return effect
        raise ModelError(f"The model has no effect '{name}'; it has {', '.join(self.names)}.")

    def __contains__(self, name: object) -> bool:
        return any(n == name for n, _ in self.named)

    def __iter__(self) -> Iterator[tuple[str, Effect]]:
        return iter(self.named)

    def __len__(self) -> int:
        return len(self.named)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects in the order written."""
        return tuple(n for n, _ in self.named)

    def at(self, place: Place) -> tuple[tuple[str, Effect], ...]:
        """The effects of one place, in the order written."""
        return tuple((n, e) for n, e in self.named if e.place is place)

    @property
    def loop(self) -> str | None:
        """Name of the effect that owns the hysteresis loop, if any."""
        return next(
            (n for n, e in self.named if any(s.loop for s in e.declared_states.values())), None
        )

    @property
    def hysteresis(self) -> str | None:
        """Name of the hysteresis law: what the strain remembers, whether by a loop or by plays."""
        return next((n for n, e in self.named if e.is_hysteresis_law), None)

    @property
    def quasi_static(self) -> bool:
        """Whether the position follows the free displacement at once (no mechanics)."""
        return not any(s.position for _, e in self.named for s in e.declared_states.values())

    @cached_property
    def parameters(self) -> Mapping[str, Parameter]:
        """All declared parameters by full name, ``"bouc_wen.alpha"``."""
        return {f"{n}.{k}": p for n, e in self.named for k, p in e.parameters.items()}

    @property
    def gates(self) -> Mapping[str, str]:
        """Full name of the gate of each optional effect, by effect name."""
        return {n: f"{n}.{e.gate}" for n, e in self.named if e.gate is not None}

    def refusal(self, effect: Effect, channels: tuple[str, ...] = ()) -> str | None:
        """Why this effect cannot be added to this model, as a sentence; None if it can."""
        for need in effect.requires:
            if need == "loop" and self.loop is None:
                return (
                    f"{effect.name} adds to the rate of a hysteresis loop and the model has none: "
                    "add BoucWen() first."
                )
            if need == "hysteresis" and self.hysteresis is None:
                return (
                    f"{effect.name} acts on the hysteresis and the model has none: add BoucWen() "
                    "first."
                )
            if need == "motion" and self.quasi_static:
                return (
                    f"{effect.name} acts on the motion balance and the model is quasi-static: "
                    "add SecondOrder() first, or Spring() where the record is too slow for it."
                )
            if need.startswith("channel:") and need.removeprefix("channel:") not in channels:
                return (
                    f"{effect.name} needs the recorded channel '{need.removeprefix('channel:')}' "
                    "and the record has none."
                )
        return None

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON: ``{"effects": [{"effect": name, **options}, ...]}``."""
        return {"effects": [{"effect": e.name, **e.options} for _, e in self.named]}

    def __str__(self) -> str:
        lines = ["command u"]
        for place in Place:
            members = self.at(place)
            if members:
                joint = " -> " if place.is_line else " + "
                lines.append(
                    f"  -> {place.value} [{place.unit}]: "
                    f"{joint.join(n for n, _ in members)} -> {_ARROWS[place]}"
                )
        if self.quasi_static:
            lines.append("  (no mechanics: quasi-static, x = s)")
        lines += ["", "Equations"]
        for name, effect in self.named:
            first, *rest = effect.equation.splitlines() or [""]
            lines.append(f"  {name:<20} {first}")
            lines += [f"  {'':<20} {line}" for line in rest]
        lines += ["", f"  {'parameter':<26} {'nominal':>11} {'bounds':>24}  unit     meaning"]
        for full, p in self.parameters.items():
            low, high = p.bounds
            note = " (fixed)" if p.fixed else ""
            lines.append(
                f"  {full:<26} {p.nominal:>11.4g} {f'[{low:.3g}, {high:.3g}]':>24}  "
                f"{p.unit:<8} {p.meaning}{note}"
            )
        return "\n".join(lines)
