"""Of several rungs: which is asked first, what it is worth, and who may be meant as well."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from piezo_opt.diagnosis import choice, grouping, ladder
from piezo_opt.diagnosis.grouping import group_of
from piezo_opt.diagnosis.held_out import HeldOut, rms
from piezo_opt.diagnosis.rung import Rung, Trial
from piezo_opt.errors import InputError


class Named(dict[str, Any]):
    """Effects by name, iterated in pairs as a model is."""

    quasi_static = False

    def __iter__(self) -> Iterator[Any]:
        return iter(self.items())


EVEN = np.tile([1.0, -1.0], 2000)
"""Held-out errors, each independent of the others."""
NOTHING: Any = SimpleNamespace(free=(), model=Named(bouc_wen=None))
JUDGED = HeldOut(NOTHING, NOTHING, "by a record")
UNJUDGED = HeldOut(NOTHING, None, "by BIC alone")


class Fitted(SimpleNamespace):
    """As a fit, one thing whatever it holds."""

    __eq__ = object.__eq__
    __hash__ = object.__hash__


def fit(error: float, elsewhere: float = 1.0) -> Any:
    """What the ladder reads of a fit: its error, and that on the held-out record."""
    return Fitted(
        rms=error, elsewhere=elsewhere, question=NOTHING, values={}, names=(), at_bound=(),
        model=Named(bouc_wen=SimpleNamespace(structural=True, parameters={})), records=(None,),
    )  # fmt: skip


def suspect(name: str, angle: float = 90.0, *, wrong_side: bool = False) -> Any:
    """An effect whose direction is so many degrees off the first axis."""
    turn = np.deg2rad(angle)
    return SimpleNamespace(
        name=name, effect=SimpleNamespace(rare=False), p_value=0.0, score=0.0,
        wrong_side=wrong_side, direction=np.array([np.cos(turn), np.sin(turn)]),
    )  # fmt: skip


def effect(name: str, error: float, elsewhere: float = 1.0, gain: float = 100.0) -> Rung:
    return Rung(Trial(NOTHING, {}, suspect(name)), fit(error, elsewhere), gain)


def detail(name: str, error: float, elsewhere: float = 1.0, gain: float = 50.0) -> Rung:
    return Rung(Trial(NOTHING, {}, None, (name,)), fit(error, elsewhere), gain)


def label(rung: Rung) -> str:
    return rung.trial.refines[0] if rung.suspect is None else rung.suspect.name


def asked(rungs: Sequence[Rung], held: HeldOut = JUDGED) -> list[str]:
    return [label(rung) for rung, _ in choice.ordered(rungs, held, 1)]


@pytest.fixture
def judged(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Held-out errors are those of the stubs; the fitted errors of who was asked are listed."""
    seen: list[float] = []

    def elsewhere(of: Any, held: HeldOut) -> Any:
        assert held is JUDGED
        seen.append(of.rms)
        return of.elsewhere * EVEN

    monkeypatch.setattr(choice, "elsewhere", elsewhere)
    monkeypatch.setattr(choice, "explained", lambda _: False)
    monkeypatch.setattr(choice, "nothing_to_win", lambda _: False)
    return seen


@pytest.mark.usefixtures("judged")
def test_both_records_decide_which_is_best() -> None:
    """One fits best and predicts worst, one predicts best and fits worst: neither is first."""
    rungs = [
        effect("bent", 1.0, 4.0), effect("stiff", 1.6, 2.2), effect("fair", 1.2, 2.5),
    ]  # fmt: skip
    assert asked(rungs) == ["fair", "stiff", "bent"]
    pairs = choice.ordered(rungs, JUDGED, 2)
    assert [rms(error) for _, error in pairs] == pytest.approx([2.5, 2.2, 4.0])
    assert asked([]) == []


@pytest.mark.usefixtures("judged")
def test_what_the_model_has_comes_before_an_effect_that_is_hardly_better() -> None:
    """Within 3 % in either error, which is 6 % in their product."""
    best, other = effect("best", 1.0, 1.0), effect("other", 1.01, 1.01)
    near, far = detail("near", 1.0, 1.06), detail("far", 1.03, 1.031)
    assert asked([best, other, near, far]) == ["near", "best", "other", "far"]
    # Nor does an effect come first that is no stronger on the fitted record.
    for gain, first in ((91.0, "far"), (89.0, "best")):
        assert asked([best, other, detail("far", 1.03, 1.2, gain)])[0] == first


@pytest.mark.usefixtures("judged")
def test_of_two_that_predict_as_well_the_one_with_fewer_parameters_is_first() -> None:
    rich = effect("rich", 0.999, 1.0, 80.0)
    for elsewhere, first in ((1.009, "lean"), (1.011, "rich")):
        lean = effect("lean", 1.0, elsewhere, 100.0)
        assert asked([rich, lean])[0] == first
    assert asked([rich, effect("poor", 1.07, 1.0, 100.0)])[0] == "rich"


@pytest.mark.usefixtures("judged")
@pytest.mark.parametrize(
    ("gain", "better", "exact", "first"),
    [
        (90.1, 0.005, True, "reaching"),
        (89.9, 0.005, True, "likelier"),
        # On 4000 samples a thousandth is worth 8, and a spare parameter costs about as much.
        (90.1, 0.0013, True, "reaching"),
        (90.1, 0.0012, True, "likelier"),
        # Who leaves more than noise is not right yet, and has nothing to spare.
        (90.1, 0.0012, False, "reaching"),
        (89.9, 0.0012, False, "likelier"),
    ],
)
def test_of_two_that_bic_hardly_tells_apart_the_one_that_both_records_prefer_is_first(
    monkeypatch: pytest.MonkeyPatch, gain: float, better: float, exact: bool, first: str
) -> None:
    """Within strong evidence, 10; friction with a Stribeck effect does nearly what a mount does."""
    monkeypatch.setattr(choice, "nothing_to_win", lambda _: exact)
    likelier = effect("likelier", 1.0, 1.0 + better, 100.0)
    reaching = effect("reaching", 1.0, 1.0, gain)
    assert asked([likelier, reaching])[0] == asked([reaching, likelier])[0] == first


@pytest.mark.usefixtures("judged")
def test_of_two_that_predict_as_well_the_one_that_leaves_but_noise_is_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    exact, lean = effect("exact", 0.999, 1.0, 80.0), effect("lean", 1.0, 1.001, 100.0)
    monkeypatch.setattr(choice, "explained", lambda of: of.rms < 1.0)
    assert asked([lean, exact]) == ["exact", "lean"]
    monkeypatch.setattr(choice, "explained", lambda _: True)
    assert asked([lean, exact]) == ["lean", "exact"]


def test_what_is_out_of_sight_is_not_asked(judged: list[float]) -> None:
    """Beyond twice the best error a rung need not predict anything, however well it would."""
    rungs = [effect("best", 1.0, 1.0), effect("seen", 1.95, 1.0), effect("lost", 2.05, 0.1)]
    assert asked(rungs) == ["best", "seen"]
    assert sorted(judged) == [1.0, 1.95]
    # And a fit that is two rungs' once.
    judged.clear()
    assert asked([*rungs, replace(rungs[1])]) == ["best", "seen", "seen"]
    assert sorted(judged) == [1.0, 1.95]


def test_a_record_that_nobody_comes_near_does_not_decide(judged: list[float]) -> None:
    """Up to three times the fitted error it is of the same thing."""
    del judged
    closest, reaching = effect("closest", 1.0, 3.2), effect("reaching", 1.2, 2.4)
    assert asked([closest, reaching]) == ["reaching", "closest"]
    closest, reaching = effect("closest", 1.0, 32.0), effect("reaching", 1.2, 24.0)
    assert asked([closest, reaching]) == ["closest", "reaching"]


def test_with_nothing_held_out_the_order_is_that_of_bic(judged: list[float]) -> None:
    rungs = [effect("first", 1.1), effect("closest", 1.0), effect("third", 3.0)]
    assert asked(rungs, UNJUDGED) == ["first", "closest", "third"]
    near, far = detail("near", 1.029), detail("far", 1.031)
    assert asked([*rungs, far, near], UNJUDGED) == ["near", "first", "closest", "third", "far"]
    assert all(error is None for _, error in choice.ordered(rungs, UNJUDGED, 1))
    assert judged == []


def test_with_nothing_held_out_the_likelier_suspect_wins_where_bic_hardly_prefers_another() -> None:
    """Up to a difference of 6."""
    for gain, first in ((94.1, "likely"), (93.9, "strong")):
        strong, likely = effect("strong", 1.0, gain=100.0), effect("likely", 1.0, gain=gain)
        other = effect("other", 1.0, gain=99.0)
        for rung, score in ((strong, 0.4), (likely, 0.5), (other, 0.3)):
            assert rung.suspect is not None
            vars(rung.suspect)["score"] = score
        assert asked([strong, other, likely], UNJUDGED)[0] == first
        # A rarer form of an effect is behind the usual ones, whatever its score.
        rare = effect("rare", 1.0, gain=99.9)
        assert rare.suspect is not None
        vars(rare.suspect).update(score=0.9, effect=SimpleNamespace(rare=True))
        assert asked([strong, other, likely, rare], UNJUDGED)[0] == first


@pytest.mark.parametrize("raised", [InputError("no"), ZeroDivisionError("no"), None])
def test_what_cannot_be_simulated_elsewhere_is_asked_last(
    raised: Exception | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whether it raises or predicts what is no number."""

    def lost(_: object, **_way: bool) -> Any:
        if raised is not None:
            raise raised
        return np.full(3, np.nan)

    record: Any = SimpleNamespace(position=np.ones(3), counted=np.ones(3, dtype=bool))
    sound, broken = effect("sound", 1.9), effect("broken", 1.0)
    monkeypatch.setattr(sound.fit, "predict", lambda _, **_way: np.zeros(3), raising=False)
    monkeypatch.setattr(broken.fit, "predict", lost, raising=False)
    monkeypatch.setattr(choice, "explained", lambda _: False)
    monkeypatch.setattr(choice, "nothing_to_win", lambda _: False)
    held = replace(JUDGED, record=record)
    (first, error), (last, none) = choice.ordered([broken, sound], held, 1)
    assert (label(first), label(last)) == ("sound", "broken")
    assert (rms(error), rms(none)) == (1.0, np.inf)


@pytest.fixture
def unit_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of every fit the noise is 1."""
    for room in (choice, grouping):
        monkeypatch.setattr(room, "noise_floor", lambda _: SimpleNamespace(rms=1.0, high=1.05))


def square(name: str, mean_square: float, gain: float) -> Rung:
    return effect(name, float(np.sqrt(mean_square)), gain=gain)


@pytest.mark.usefixtures("unit_noise")
def test_rivals_within_strong_evidence_are_in_the_group() -> None:
    taken = square("taken", 1.05, 100.0)
    even, behind = square("even", 5.0, 90.1), square("behind", 1.06, 89.9)
    better = square("better", 1.05, 200.0)
    rungs = [taken, even, behind, better, detail("bouc_wen.n", 1.0)]
    below = square("below", 1.06, 0.0).fit
    assert group_of(below, taken, rungs, ()) == ("taken", "even", "better")


@pytest.mark.usefixtures("unit_noise")
@pytest.mark.parametrize(
    ("taken", "rival", "meant"),
    [
        # It leaves a tenth of the noise's square: up to twice that misfit, four times its square.
        (1.1, 1.39, True),
        (1.1, 1.41, False),
        # It leaves half of it: up to a fifth more of the whole error, whose square is 2.16.
        (1.5, 2.15, True),
        (1.5, 2.17, False),
        # It is exact: its form is the true one, and whoever is behind is wrong.
        (1.07, 1.08, False),
        (1.09, 1.10, True),
        (0.9, 0.91, False),
    ],
)
def test_where_the_best_is_not_exact_another_form_may_be_meant(
    taken: float, rival: float, meant: bool
) -> None:
    rungs = [square("taken", taken, 200.0), square("rival", rival, 100.0)]
    below = square("below", taken, 0.0).fit
    assert group_of(below, rungs[0], rungs, ()) == (("taken", "rival") if meant else ("taken",))


@pytest.mark.usefixtures("unit_noise")
@pytest.mark.parametrize(
    ("below", "rival", "meant"),
    [
        # A hundredth of what the effect explains (24) is below what noise hides (an eighth more).
        (25.0, 1.239, True),
        (25.0, 1.241, False),
        # A hundredth of 99 is not.
        (100.0, 1.254, True),
        (100.0, 1.255, False),
    ],
)
def test_a_rival_behind_by_a_tenth_of_the_effect_may_be_meant(
    below: float, rival: float, meant: bool
) -> None:
    rungs = [square("taken", 1.0, 200.0), square("rival", rival, 100.0)]
    group = group_of(square("below", below, 0.0).fit, rungs[0], rungs, ())
    assert group == (("taken", "rival") if meant else ("taken",))


@pytest.mark.usefixtures("unit_noise")
def test_who_was_not_refitted_is_in_the_group_by_direction() -> None:
    """Parallel within a cosine of 0.995, which is 5.7 degrees, and on its allowed side."""
    taken = square("taken", 1.0, 200.0)
    beaten = square("beaten", 1.2, 100.0)
    everybody = [
        suspect("taken", 90.0), suspect("beaten", 90.0), suspect("parallel", 95.5),
        suspect("opposite", 270.0), suspect("beside", 96.0),
        suspect("forbidden", 90.0, wrong_side=True),
    ]  # fmt: skip
    found = group_of(square("below", 2.0, 0.0).fit, taken, [taken, beaten], everybody)
    assert found == ("taken", "parallel", "opposite")


@pytest.mark.usefixtures("unit_noise")
@pytest.mark.parametrize(
    ("offered", "names", "refined"),
    [
        (effect("drift", 0.95), [], ()),
        (effect("drift", 0.93), ["drift"], ()),
        (detail("bouc_wen.n", 0.985), [], ()),
        (detail("bouc_wen.n", 0.975), [], ("bouc_wen.n",)),
    ],
)
def test_a_name_asks_for_six_percent_of_the_error_and_a_detail_for_two(
    offered: Rung, names: list[str], refined: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same rung in every round: from the second on it wins nothing more."""
    monkeypatch.setattr(ladder, "scored", lambda *_: ((), ()))
    monkeypatch.setattr(choice, "refinements", lambda *_: [offered.trial])
    monkeypatch.setattr(choice, "race", lambda *_, **__: [offered])
    monkeypatch.setattr(choice, "settled", lambda _: True)
    monkeypatch.setattr(choice, "contest", lambda _, rungs, *__, **___: rungs)
    monkeypatch.setattr(ladder, "with_statistics", lambda found: found)
    foot = fit(1.0)
    climbed = ladder.climb(foot, UNJUDGED, (), threads=1)
    assert [step.name for step in climbed.steps] == names
    assert climbed.refined == refined
    assert climbed.final is (offered.fit if names or refined else foot)


@pytest.mark.usefixtures("unit_noise")
@pytest.mark.parametrize("refined", [True, False])
def test_names_are_asked_for_again_at_the_end_where_details_came_after_them(
    refined: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    rounds = iter([[effect("drift", 8.0)], [detail("bouc_wen.n", 4.0)] if refined else []])
    asked: list[bool] = []

    def pruned(found: Any, steps: Any, *_: object, last: bool = False) -> Any:
        asked.append(last)
        return found, list(steps), []

    monkeypatch.setattr(ladder, "scored", lambda *_: ((), ()))
    monkeypatch.setattr(choice, "refinements", lambda *_: [detail("any", 1.0).trial])
    monkeypatch.setattr(choice, "race", lambda *_, **__: next(rounds, []))
    monkeypatch.setattr(choice, "settled", lambda _: True)
    monkeypatch.setattr(choice, "contest", lambda _, rungs, *__, **___: rungs)
    monkeypatch.setattr(ladder, "with_statistics", lambda found: found)
    monkeypatch.setattr(ladder, "exchange", lambda _, found, steps, *__, **___: (found, steps, []))
    monkeypatch.setattr(ladder, "prune", pruned)
    monkeypatch.setattr(ladder, "pair", lambda *_, **__: None)
    monkeypatch.setattr(ladder, "short_of_noise", lambda *_, **__: False)
    ladder.climb(fit(10.0), UNJUDGED, (), threads=1)
    assert asked == ([False, True] if refined else [False])


@pytest.mark.usefixtures("judged")
@pytest.mark.parametrize(("elsewhere", "missed"), [(1.29, False), (1.31, True)])
def test_a_fit_that_predicts_three_tenths_worse_than_it_fits_may_have_a_wrong_name(
    elsewhere: float, missed: bool
) -> None:
    assert choice.misjudged(effect("any", 1.0, elsewhere).fit, JUDGED) is missed


@pytest.mark.usefixtures("judged", "unit_noise")
@pytest.mark.parametrize(
    ("left", "shows", "elsewhere", "lone", "short"),
    [
        (1.09, True, 9.0, False, False),
        (1.04, True, 1.3, True, False),
        (1.04, False, 1.4, True, True),
        (1.06, False, 1.0, True, True),
        (1.06, False, 1.0, False, False),
        (1.11, True, 1.0, False, True),
        (1.11, False, 1.4, False, False),
        (1.11, False, 1.5, False, True),
        (1.11, False, 1.0, True, True),
    ],
)
def test_a_ladder_ends_short_of_the_noise_where_more_is_left_that_no_record_bears_out(
    left: float, shows: bool, elsewhere: float, lone: bool, short: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """Slow noise has no structure, and the other record has as much of it."""
    monkeypatch.setattr(choice, "structure", lambda *_: SimpleNamespace(left=shows))
    found = effect("any", left, elsewhere).fit
    assert choice.short_of_noise(found, JUDGED, lone=lone) is short


@pytest.mark.usefixtures("unit_noise")
@pytest.mark.parametrize(("left", "told"), [(8.0, False), (1.0, True)])
def test_groups_are_told_again_where_but_noise_is_left(
    left: float, told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before, what is still missing may make a rival look worse than it is."""
    rounds = iter([[effect("drift", left)]])
    asked: list[Any] = []

    def regrouped(_: Any, found: Any, steps: Any, *__: object) -> Any:
        asked.append(found)
        return list(steps)

    monkeypatch.setattr(ladder, "scored", lambda *_: ((), ()))
    monkeypatch.setattr(choice, "refinements", lambda *_: [detail("any", 1.0).trial])
    monkeypatch.setattr(choice, "race", lambda *_, **__: next(rounds, []))
    monkeypatch.setattr(choice, "settled", lambda _: True)
    monkeypatch.setattr(choice, "contest", lambda _, rungs, *__, **___: rungs)
    monkeypatch.setattr(ladder, "with_statistics", lambda found: found)
    monkeypatch.setattr(ladder, "pair", lambda *_, **__: None)
    monkeypatch.setattr(ladder, "regrouped", regrouped)
    monkeypatch.setattr(ladder, "short_of_noise", lambda *_, **__: False)
    climbed = ladder.climb(fit(10.0), UNJUDGED, (), threads=1)
    assert [step.name for step in climbed.steps] == ["drift"]
    assert bool(asked) is told


def all_afresh(
    monkeypatch: pytest.MonkeyPatch, near: Rung, *, calm: bool = False, left: bool = False,
    first: bool = True, below: float = 5.0,
) -> bool:  # fmt: skip
    """Whether every effect begins afresh where this is the closest refit.

    Args:
        below: error of the fit below it.
        calm: whether it leaves what may be noise.
        left: whether the fit below it leaves structure.
        first: whether nothing has been found yet.
    """
    asked: list[object] = []
    monkeypatch.setattr(choice, "refinements", lambda _: [near.trial])
    monkeypatch.setattr(choice, "race", lambda *_, **__: [near])
    monkeypatch.setattr(choice, "settled", lambda _: calm)
    monkeypatch.setattr(choice, "_unsettled", lambda *_, **__: left)
    monkeypatch.setattr(choice, "elsewhere", lambda of, _: np.full(3, of.elsewhere))
    monkeypatch.setattr(choice, "entrants", lambda *given: asked.append(given[2]) or ([], []))
    monkeypatch.setattr(choice, "contest", lambda _, rungs, *__, **___: rungs)
    everybody = (suspect("drift"),)
    everybody[0].score = 0.0
    choice.refits(
        fit(below), JUDGED, everybody, first=first, bar=-1.0, tell=lambda _: None, threads=1
    )
    assert asked in ([], [everybody])
    return bool(asked)


@pytest.mark.usefixtures("unit_noise")
@pytest.mark.parametrize(
    ("error", "elsewhere", "calm", "asked_again"),
    [
        (1.0, 1.29, True, False), (1.0, 1.31, True, True), (1.09, 1.5, True, True),
        (1.11, 1.5, True, False), (1.3, 3.8, True, False), (1.3, 4.0, True, True),
        (1.3, 4.0, False, False),
    ],
)  # fmt: skip
def test_who_explains_one_record_and_not_the_other_has_every_effect_asked(
    error: float, elsewhere: float, calm: bool, asked_again: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """Where it leaves but noise on the record that is fitted: else there are other reasons.

    Where it leaves what may be slow noise the other record must be missed by more.
    """
    near = effect("bent", error, elsewhere)
    assert all_afresh(monkeypatch, near, calm=calm) is asked_again


@pytest.mark.usefixtures("unit_noise")
@pytest.mark.parametrize(
    ("error", "elsewhere", "calm"), [(1.0, 2.6, True), (1.3, 4.0, True), (1.9, 5.8, False)]
)
def test_beside_what_was_found_missing_the_other_record_is_no_reason(
    error: float, elsewhere: float, calm: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A warm gain beside a delay left but noise: forty fresh starts later it still did."""
    near = effect("bent", error, elsewhere)
    assert all_afresh(monkeypatch, near, calm=calm, left=not calm)
    assert not all_afresh(monkeypatch, near, calm=calm, left=not calm, first=False)
    far = effect("bent", 2.1, 2.1)
    assert all_afresh(monkeypatch, far, left=True, first=False)


@pytest.mark.usefixtures("unit_noise")
@pytest.mark.parametrize(
    ("error", "elsewhere", "fresh"),
    [(1.9, 1.9, False), (2.1, 2.1, True), (1.9, 5.6, False), (1.9, 5.8, True)],
)
def test_where_the_closest_is_far_from_noise_or_from_the_other_record_all_begin_afresh(
    error: float, elsewhere: float, fresh: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A mount and friction had imitated a warm-up to 1.9 times the noise, and 9 elsewhere."""
    bent = effect("bent", error, elsewhere)
    assert all_afresh(monkeypatch, bent, left=True, below=3.0) is fresh


@pytest.mark.usefixtures("unit_noise")
@pytest.mark.parametrize(
    ("below", "elsewhere", "first", "fresh"),
    [(4.5, 3.0, True, True), (4.7, 3.0, True, False), (4.7, 9.1, True, True),
     (4.7, 3.0, False, True)],
)  # fmt: skip
def test_where_the_scores_have_shown_the_way_what_is_left_is_another_effects(
    below: float, elsewhere: float, first: bool, fresh: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A mode that takes 5 noises to 3 is none of those forty that would begin afresh."""
    near = effect("lag", 3.0, elsewhere)
    assert all_afresh(monkeypatch, near, left=True, first=first, below=below) is fresh


@pytest.mark.usefixtures("unit_noise")
@pytest.mark.parametrize(
    ("error", "elsewhere", "afresh"),
    [
        (1.0, 1.29, False), (1.0, 1.31, True), (1.09, 1.5, True), (1.11, 1.5, False),
        (1.0, 2.9, True), (1.0, 3.1, False),
    ],
)  # fmt: skip
def test_who_explains_one_record_and_misses_one_like_it_is_begun_afresh(
    error: float, elsewhere: float, afresh: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It may have ended in a minimum of its own; what is missed by far is another matter."""
    told: list[bool] = []

    def contest(_: Any, rungs: list[Rung], *__: object, afresh: bool) -> list[Rung]:
        told.append(afresh)
        return rungs

    near = effect("bent", error, elsewhere)
    monkeypatch.setattr(choice, "refinements", lambda _: [near.trial])
    monkeypatch.setattr(choice, "race", lambda *_, **__: [near])
    monkeypatch.setattr(choice, "settled", lambda _: True)
    monkeypatch.setattr(choice, "plausible", lambda _: True)
    monkeypatch.setattr(choice, "elsewhere", lambda of, _: np.full(3, of.elsewhere))
    monkeypatch.setattr(choice, "entrants", lambda *_: ([], []))
    monkeypatch.setattr(choice, "contest", contest)
    for first in (True, False):
        choice.refits(fit(9.0), JUDGED, (), first=first, bar=-1.0, tell=lambda _: None, threads=1)
    # Beside what was found the base model is bent less.
    assert told == [afresh, False]


@pytest.mark.usefixtures("unit_noise")
@pytest.mark.parametrize(
    ("first", "helped", "raced"),
    [
        (True, False, ["plain", "detailed", "detailed"]), (True, True, ["plain"]),
        (False, False, ["detailed"]),
    ],
)  # fmt: skip
def test_where_nobody_helps_every_effect_is_begun_beside_the_details_of_the_base(
    first: bool, helped: bool, raced: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Asymmetry beside a loop whose exponent is fixed explains nothing, and all beside a free one.

    Beside what was found the details are free from the first, and nobody is begun twice; before
    that, who has begun in an earlier round is not begun again, only with the details.
    """
    seen: list[Any] = []
    contests = iter([helped, True])
    near = effect("bent", 5.0)
    known = replace(near, trial="known")  # type: ignore[arg-type]

    def race(
        _: Any, trials: Sequence[Any], __: int, begun: Sequence[Rung] = (), **___: Any
    ) -> list[Rung]:
        seen.extend(trials)
        return [near, *(replace(near, trial=trial) for trial in trials), *begun]

    def contest(_: Any, rungs: list[Rung], *__: object, **___: object) -> list[Rung]:
        return rungs if next(contests) else []

    monkeypatch.setattr(choice, "refinements", lambda _: [])
    monkeypatch.setattr(choice, "race", race)
    monkeypatch.setattr(choice, "settled", lambda _: False)
    monkeypatch.setattr(choice, "plausible", lambda _: True)
    monkeypatch.setattr(choice, "elsewhere", lambda of, _: np.full(3, of.elsewhere))
    monkeypatch.setattr(choice, "further", lambda *_: [])
    monkeypatch.setattr(choice, "entrants", lambda *given: (["plain"], list(given[4])))
    monkeypatch.setattr(choice, "with_base_details", lambda _: "detailed")
    monkeypatch.setattr(choice, "contest", contest)
    found, afresh = choice.refits(
        fit(9.0), JUDGED, (), first=first, bar=-1.0, tell=lambda _: None, threads=1, known=[known]
    )
    # Those beside details are not told as begun afresh: a search for pairs begins without them.
    assert [rung.trial for rung in afresh] == (["plain", "known"] if first else ["detailed"])
    assert seen == raced
    assert bool(found) is (first or helped)


@pytest.mark.usefixtures("judged")
@pytest.mark.parametrize(
    ("error", "elsewhere", "first", "taken"),
    [
        # What is left is far less than the other record shows, and that hardly changes.
        (0.3, 1.01, True, True), (0.3, 1.03, True, False), (0.3, 1.01, False, False),
        # Less than half has been explained, or the other record shows little more.
        (0.51, 1.01, True, False), (0.4, 1.01, True, False),
    ],
)  # fmt: skip
def test_what_is_found_first_may_leave_another_record_as_it_was(
    error: float, elsewhere: float, first: bool, taken: bool
) -> None:
    random = np.random.default_rng(1)
    before = random.normal(size=500)
    after = elsewhere * before * np.sign(random.normal(size=500))
    ordered = [(effect("dead_zone", error), after)]
    assert (choice.chosen(fit(1.0), before, ordered, JUDGED, first=first) is not None) == taken


@pytest.mark.usefixtures("judged")
@pytest.mark.parametrize(
    ("error", "elsewhere", "first", "taken"),
    [
        (0.59, 0.99, True, True), (0.61, 0.99, True, False), (0.59, 1.01, True, False),
        (0.59, 0.99, False, False),
    ],
)  # fmt: skip
def test_a_first_effect_that_explains_much_need_but_not_hurt_on_the_other_record(
    error: float, elsewhere: float, first: bool, taken: bool
) -> None:
    """A second mode that steps do not show: creep beside it is what they show above all."""
    random = np.random.default_rng(1)
    before = random.normal(size=500)
    after = random.normal(size=500)  # another error, not less beyond chance
    after *= elsewhere * np.sqrt(np.mean(before**2) / np.mean(after**2))
    ordered = [(effect("second_mode", error), after)]
    assert (choice.chosen(fit(1.0), before, ordered, JUDGED, first=first) is not None) == taken


@pytest.mark.usefixtures("judged")
@pytest.mark.parametrize(
    ("shown", "error", "elsewhere", "first", "taken"),
    [
        (3.1, 0.49, 1.09, True, True), (3.1, 0.49, 1.11, True, False),
        # The other record shows the same thing, or most is still to be explained.
        (2.9, 0.49, 1.09, True, False), (3.1, 0.51, 1.09, True, False),
        # What is named beside others must prove itself.
        (3.1, 0.49, 1.09, False, False),
    ],
)  # fmt: skip
def test_a_first_effect_may_lose_a_tenth_where_the_other_record_shows_something_else(
    shown: float, error: float, elsewhere: float, first: bool, taken: bool
) -> None:
    """Fringes in front of a charge that a chirp shows: nobody else takes 18 noises to 3."""
    random = np.random.default_rng(1)
    before = random.normal(size=500)
    before *= shown / np.sqrt(np.mean(before**2))
    after = elsewhere * before * np.sign(random.normal(size=500))
    ordered = [(effect("sensor_nonlinearity", error), after)]
    assert (choice.chosen(fit(1.0), before, ordered, JUDGED, first=first) is not None) == taken


@pytest.mark.usefixtures("judged", "unit_noise")
@pytest.mark.parametrize(
    ("error", "elsewhere", "several", "astray"),
    [
        (2.1, 1.0, False, True), (1.9, 1.0, True, False),
        (1.2, 3.7, False, True), (1.2, 3.5, False, False), (1.05, 3.7, False, False),
        # Two effects may explain one record, the second in the place of another one.
        (1.0, 3.1, True, True), (1.0, 2.9, True, False),
    ],
)  # fmt: skip
def test_a_fit_is_astray_where_it_leaves_much_or_misses_the_other_record(
    error: float, elsewhere: float, several: bool, astray: bool
) -> None:
    assert choice.astray(fit(error, elsewhere), JUDGED, several=several) is astray


@pytest.mark.parametrize(
    ("noise_left", "fine_error", "taken"),
    [(True, 0.5, True), (True, 1.5, False), (False, 0.5, False)],
)
@pytest.mark.usefixtures("judged")
def test_what_leaves_but_noise_is_fitted_finely_before_it_is_refused(
    noise_left: bool, fine_error: float, taken: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The scheme's error looks like a shift of the resonance: another record shows that most."""
    finely: list[float] = []

    def fine(of: Any) -> Any:
        finely.append(of.rms)
        return fit(of.rms, fine_error)

    monkeypatch.setattr(choice, "finely", fine)
    monkeypatch.setattr(choice, "stilled", lambda _: None)
    monkeypatch.setattr(choice, "explained", lambda _: noise_left)
    before, after = EVEN, 2.0 * EVEN
    rungs = [(effect("fringes", 0.4, 2.0), after), (effect("other", 0.6, 2.0), after)]
    found = choice.chosen(fit(1.0), before, rungs, JUDGED, first=True)
    # Once is enough: it is the best one's chance.
    assert finely == ([0.4] if noise_left else [])
    assert (found is not None) == taken
    if found is not None:
        rung, error = found
        assert label(rung) == "fringes"
        assert rung.fit.elsewhere == fine_error
        assert rms(error) == pytest.approx(fine_error)


@pytest.mark.parametrize(("without", "taken"), [(0.5, True), (1.5, False), (None, False)])
@pytest.mark.usefixtures("judged")
def test_what_leaves_but_noise_is_tried_without_mechanics_before_it_is_refused(
    without: float | None, taken: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the base model lacked may have looked like mechanics, which ring on the other record."""
    still = None if without is None else fit(0.4, without)
    monkeypatch.setattr(choice, "finely", lambda of: of)
    monkeypatch.setattr(choice, "stilled", lambda _: still)
    monkeypatch.setattr(choice, "explained", lambda _: True)
    before, after = EVEN, 2.0 * EVEN
    rungs = [(effect("asymmetry", 0.4, 2.0), after)]
    found = choice.chosen(fit(1.0), before, rungs, JUDGED, first=True)
    assert (found is not None) == taken
    if found is not None:
        rung, error = found
        assert rung.fit is still
        assert rms(error) == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("still", "moved", "shows", "asked"),
    [
        (True, 3.4, False, True), (True, 3.6, False, False),
        # Mechanics that show a resonance are found for themselves; a model may have some already.
        (True, 3.4, True, False), (False, 3.4, False, False),
    ],
)  # fmt: skip
def test_suspects_are_asked_beside_mechanics_that_explain_more_than_all_of_them(
    still: bool, moved: float, shows: bool, asked: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A saturation hides the resonance: mechanics alone look like a lag, 29 of 55 noises."""

    def on(rung: Rung, quasi_static: bool) -> Rung:
        rung.fit.model.quasi_static = quasi_static
        return rung

    below = fit(9.0)
    below.model.quasi_static = still
    mechanics = on(detail("second_order", moved), quasi_static=False)
    rungs = [on(effect("creep", 5.0), still), on(effect("drift", 6.0), still), mechanics]
    there = (suspect("saturation"), suspect("delay"))
    vars(there[1])["p_value"] = 0.5
    grounds: list[Any] = []

    def scored(ground: Any, *_: object) -> Any:
        grounds.append(ground)
        return there, ()

    monkeypatch.setattr(choice, "plausible", lambda _: shows)
    monkeypatch.setattr(choice, "scored", scored)
    monkeypatch.setattr(choice, "shortlist", lambda likely, _: likely)
    monkeypatch.setattr(choice, "adding", lambda at, s: (at, s.name))
    monkeypatch.setattr(choice, "with_base_details", lambda trial: trial)
    trials = choice._on_mechanics(below, rungs, there, 1e-3, 1)
    assert trials == ([(below, "saturation")] if asked else [])
    assert grounds == ([mechanics.fit] if asked else [])


@pytest.mark.usefixtures("unit_noise")
def test_who_is_asked_beside_mechanics_enters_the_contest(monkeypatch: pytest.MonkeyPatch) -> None:
    alone, beside = effect("creep", 5.0), effect("saturation", 1.0)
    contested: list[Rung] = []

    def contest(_: Any, rungs: list[Rung], *__: object, **___: object) -> list[Rung]:
        contested.extend(rungs)
        return rungs

    monkeypatch.setattr(choice, "refinements", lambda _: ["trial"])
    monkeypatch.setattr(choice, "_on_mechanics", lambda *_: ["beside"])
    monkeypatch.setattr(
        choice, "race", lambda _, t, __, **___: [beside] if t == ["beside"] else [alone]
    )
    monkeypatch.setattr(choice, "settled", lambda _: True)
    monkeypatch.setattr(choice, "plausible", lambda _: True)
    monkeypatch.setattr(choice, "elsewhere", lambda of, _: np.full(3, of.elsewhere))
    monkeypatch.setattr(choice, "contest", contest)
    choice.refits(fit(9.0), JUDGED, (), first=True, bar=-1.0, tell=lambda _: None, threads=1)
    assert contested == [alone, beside]


@pytest.mark.parametrize(
    ("over", "left", "more"), [(1.0, False, False), (1.0, True, True), (1.05, False, True)]
)
def test_a_record_shows_more_where_it_is_above_the_noise_or_has_structure(
    monkeypatch: pytest.MonkeyPatch, over: float, left: bool, more: bool
) -> None:
    monkeypatch.setattr(choice, "noise_floor", lambda _: SimpleNamespace(rms=1.0))
    monkeypatch.setattr(choice, "structure", lambda *_: SimpleNamespace(left=left))
    assert choice.shows_more(fit(over)) is more
