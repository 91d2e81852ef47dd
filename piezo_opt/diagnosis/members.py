"""What a model of the search is made of: a base, the effects beside it, and details that are free.

Which way a set was reached, and in which order, does not matter: equal sets are equal objects.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import final

from piezo_opt.effects.base import Effect, Place
from piezo_opt.effects.catalogue import CATALOGUE
from piezo_opt.effects.model import Model
from piezo_opt.effects.motion.spring import Spring
from piezo_opt.identification import Identification, ringing

_ORDER = {name: place for place, name in enumerate(CATALOGUE)}


Hypothesis = tuple[tuple[str, ...], Effect | None, tuple[str, ...]]
"""What a set says is there: names of its base and of its effects, in whatever form, and its law, of
which a form with free weights can do what others cannot."""


@final
@dataclass(frozen=True)
class Members:
    """One candidate set.

    Attributes:
        base: the base model: what the user's model has, in another law or with mechanics that
            joined.
        effects: what was added to it, in the catalogue's order.
        free: parameters that are free beside those of the question at the foot, sorted.
    """

    base: Model
    effects: tuple[Effect, ...] = ()
    free: tuple[str, ...] = ()

    @staticmethod
    def of(question: Identification, foot: Identification) -> Members:
        """The set that a question asks about, beside the one at the foot of the search."""
        own = set(foot.model.names)
        base = Model(
            tuple(
                (n, e) for n, e in question.model.named
                if n in own or (e.structural and not isinstance(e, Spring))
            )
        )  # fmt: skip
        added = [e for n, e in question.model.named if n not in own and not e.structural]
        free = tuple(sorted(k for k in question.free if k not in foot.free))
        return Members(base, tuple(sorted(added, key=_place)), free)

    @property
    def hypothesis(self) -> Hypothesis:
        """What it says is there."""
        return self.base.names, self.base[self.law] if self.law else None, self.names

    @property
    def law(self) -> str | None:
        """Name of the base's hysteresis law: what its strain remembers."""
        return self.base.hysteresis

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(effect.name for effect in self.effects)

    @property
    def model(self) -> Model:
        """The whole model. Forces on a chain without mechanics act on a spring without mass, which
        comes and goes with them: on its own it would change nothing."""
        model = self.base
        if model.quasi_static and any(e.place is Place.MOTION for e in self.effects):
            model = model + Spring()
        for effect in self.effects:
            model = model + effect
        return model

    def without(self, name: str) -> Members:
        """The set without one effect, and without its details."""
        return Members(
            self.base, tuple(e for e in self.effects if e.name != name),
            tuple(k for k in self.free if k.split(".")[0] != name),
        )  # fmt: skip

    def with_(self, effect: Effect) -> Members:
        """The set with one effect more; in the place of one of the same name."""
        fewer = self.without(effect.name)
        return replace(fewer, effects=tuple(sorted((*fewer.effects, effect), key=_place)))

    def question(self, foot: Identification) -> Identification:
        """What is asked about it: all that the foot knows, nothing else."""
        model = self.model
        asked = foot.with_model(model)
        free = (*asked.free, *(k for k in self.free if k in model.parameters))
        return ringing(replace(asked, free=free), foot.model)


def _place(effect: Effect) -> tuple[int, str]:
    return _ORDER.get(effect.name, len(_ORDER)), repr(effect)
