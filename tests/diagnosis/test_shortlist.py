"""Who is refitted: names, whatever the number of their forms."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from piezo_opt.diagnosis.shortlist import shortlist


def suspect(name: str, score: float, direction: tuple[float, ...] = (1.0, 0.0)) -> Any:
    return SimpleNamespace(name=name, score=score, direction=np.array(direction), wrong_side=False)


def test_forms_of_one_effect_do_not_crowd_out_another() -> None:
    forms = [suspect("asymmetry", 0.9 - 0.01 * k) for k in range(4)]
    others = [suspect(name, 0.5, (0.0, 1.0)) for name in "abcdefg"]
    names = [s.name for s in shortlist([*forms, *others], [*forms, *others])]
    assert names == [*["asymmetry"] * 4, "a", "b", "c", "d", "e"]


def test_a_look_alike_is_refitted_though_it_is_not_likely() -> None:
    likely, alike = suspect("delay", 0.9), suspect("amplifier_lag", 0.05, (0.8, 0.6))
    apart = suspect("drift", 0.05, (0.0, 1.0))
    assert shortlist([likely], [likely, apart, alike]) == [likely, alike]
    # Who explains less than a tenth of the best and looks like nobody waits.
    assert shortlist([likely, apart], [likely, apart]) == [likely]
