"""Refits race: a few iterations for all, the rest for those worth following."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from piezo_opt.diagnosis import contest, rung
from piezo_opt.diagnosis.rung import Rung, Trial, race
from piezo_opt.effects import Model, SecondOrder
from piezo_opt.errors import ModelError
from piezo_opt.identification import Ending

BELOW: Any = SimpleNamespace(rms=2.0)


def ending(error: float, *, converged: bool = False, before: float = 1.0) -> Any:
    """A fit as the race reads it; its question is itself, to be told apart.

    Its last iteration began at ``before`` times its error.
    """
    outcome, trace = SimpleNamespace(success=converged), SimpleNamespace(rms=np.array([before, 1]))
    found = SimpleNamespace(rms=error, outcome=outcome, values={}, wall_s=0.0, trace=trace)
    found.question = found
    return found


def entering(
    error: float, suspect: Any = True, *, converged: bool = False, before: float = 1.0
) -> Trial:
    """A trial whose first iterations end at this error."""
    return Trial(ending(error, converged=converged, before=before), {}, suspect)


@pytest.fixture
def followed(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Fits are their questions; the errors of those that are followed are listed."""
    seen: list[float] = []

    def solved(question: Any, _: Mapping[str, float], iterations: int, *__: Any, **___: Any) -> Any:
        if iterations == rung._LATER:
            seen.append(question.rms)
            if question.rms == 1.25:
                raise ModelError("it is not finite here")
        return question

    monkeypatch.setattr(rung, "solved", solved)
    monkeypatch.setattr(rung, "bic_gain", lambda *_: 0.0)
    monkeypatch.setattr(rung, "too_coarse", lambda fit: fit.rms == 1.3)
    return seen


def test_only_those_near_the_best_are_followed_and_always_three(followed: list[float]) -> None:
    race(BELOW, [entering(e) for e in (1.0, 1.4, 1.45, 1.49, 1.51)], 1)
    assert followed == [1.0, 1.4, 1.45, 1.49]
    followed.clear()
    race(BELOW, [entering(e) for e in (9.0, 1.0, 5.0, 7.0)], 1)
    assert followed == [1.0, 5.0, 7.0]


def test_who_still_falls_fast_is_followed_within_twice_the_best(followed: list[float]) -> None:
    """Where it was stopped says nothing of where it ends."""
    falling, slow = entering(1.9, before=1.3), entering(1.8)
    leading = [entering(e) for e in (1.0, 1.1, 1.2)]
    race(BELOW, [*leading, slow, falling], 1)
    assert followed == [1.0, 1.1, 1.2, 1.9]
    followed.clear()
    race(BELOW, [*leading, falling], 1, most=2)
    assert 1.9 not in followed
    # Nor is who has converged, be it on sub-steps that are too coarse and with a last leap.
    ended = entering(1.3, converged=True, before=1.3)
    race(BELOW, [*(entering(e) for e in (0.8, 0.81, 0.82)), ended], 1)
    assert 1.3 not in followed
    # Not with more than twice what the best leaves, nor four times what a rival of before does.
    followed.clear()
    race(BELOW, [*leading, entering(2.1, before=1.3)], 1)
    race(BELOW, [falling], 1, rivals=[Rung(slow, ending(0.45), 0.0)])
    assert followed == [1.0, 1.1, 1.2]


def test_who_is_of_no_use_beyond_an_error_is_given_up_there(
    followed: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    given: list[float] = []
    counted = rung.solved

    def solved(question: Any, start: Any, iterations: int, beyond: float, **more: Any) -> Any:
        given.append(beyond)
        return counted(question, start, iterations, beyond, **more)

    monkeypatch.setattr(rung, "solved", solved)
    falling = entering(5.0, before=1.3)
    rungs = race(BELOW, [entering(e) for e in (3.5, 4.5)] + [falling], 1, hope=4.0)
    assert followed == [3.5, 5.0]
    assert given == [4.0] * 5
    assert len(rungs) == 3


def test_nobody_is_followed_far_behind_a_rival_of_an_earlier_race(followed: list[float]) -> None:
    before = race(BELOW, [entering(1.0), entering(2.0)], 1)
    followed.clear()
    rungs = race(BELOW, [entering(e) for e in (3.9, 4.1, 4.2)], 1, rivals=before)
    assert followed == [3.9]
    assert sorted(r.fit.rms for r in rungs) == [3.9, 4.1, 4.2]


def test_who_is_to_reach_what_stands_is_given_up_far_from_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """At twice the error where a search slows down; four times the error is not followed.

    Who is followed is given up beyond what would put it in a group with what stands.
    """
    asked: list[tuple[int, float]] = []

    def solved(
        question: Any, _: Any, iterations: int, beyond: float = float("inf"), **__: bool
    ) -> Any:
        asked.append((iterations, beyond))
        return question

    monkeypatch.setattr(rung, "solved", solved)
    monkeypatch.setattr(rung, "bic_gain", lambda *_: 0.0)
    trials = [entering(e) for e in (3.8, 4.1)]
    race(BELOW, trials, 1, standing=ending(1.0))
    assert asked == [(rung._FIRST, 2.0), (rung._FIRST, 2.0), (rung._LATER, 1.2)]
    asked.clear()
    race(BELOW, trials, 1)
    free = float("inf")
    assert asked == [(rung._FIRST, free)] * 2 + [(rung._LATER, free)] * 2
    # Four times what a rival of before leaves is as far as nobody is followed from.
    asked.clear()
    race(BELOW, trials, 1, rivals=[Rung(entering(1.0), ending(1.0), 0.0)])
    assert asked == [(rung._FIRST, 4.0)] * 2 + [(rung._LATER, free)]


def test_who_is_given_up_beyond_an_error_is_not_mended_beyond_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[tuple[float, float]] = []

    def solve(*_: Any, solver: Any, transcription: Any, **__: Any) -> Any:
        asked.append((solver.beyond, transcription.mend))
        return SimpleNamespace(outcome=SimpleNamespace(ending=Ending.LIMIT))

    monkeypatch.setattr(rung, "solve", solve)
    rung.solved(BELOW, {}, 10, 2.0)
    rung.solved(BELOW, {}, 10, 2.0, mend=False)
    rung.solved(BELOW, {}, 10)
    free = float("inf")
    assert asked == [(2.0, 2.0), (2.0, 0.0), (free, free)]


def test_an_interrupt_ends_more_than_the_fit_that_it_meets(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A search stops where it is and says so: nobody may go on as if it had ended."""
    stopped: Any = SimpleNamespace(
        question=BELOW, values={}, outcome=SimpleNamespace(ending=Ending.INTERRUPTED)
    )
    monkeypatch.setattr(rung, "solve", lambda *_, **__: stopped)
    with pytest.raises(KeyboardInterrupt):
        rung.solved(BELOW, {})
    with pytest.raises(KeyboardInterrupt):
        rung.finely(stopped)


def test_a_fit_that_cannot_be_had_finely_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: Any, **__: Any) -> Any:
        raise ModelError("too stiff")

    coarse: Any = SimpleNamespace(question=BELOW, values={})
    monkeypatch.setattr(rung, "solve", refused)
    assert rung.finely(coarse) is coarse


def test_who_has_converged_is_not_followed(followed: list[float]) -> None:
    race(BELOW, [entering(1.0, converged=True), entering(1.1)], 1)
    assert followed == [1.1]


def test_who_has_converged_on_sub_steps_that_are_too_coarse_is_followed_from_there(
    followed: list[float],
) -> None:
    race(BELOW, [entering(1.0), entering(1.3, converged=True)], 1)
    assert followed == [1.0, 1.3]


def test_sub_steps_are_mended_only_for_those_that_are_followed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Or where nothing else gives an error at all."""
    asked: list[tuple[float, int, bool]] = []

    def solved(question: Any, _: Any, iterations: int, *__: float, mend: bool = True) -> Any:
        asked.append((question.rms, iterations, mend))
        return ending(1.4) if mend and question.rms != question.rms else question

    monkeypatch.setattr(rung, "solved", solved)
    monkeypatch.setattr(rung, "bic_gain", lambda *_: 0.0)
    rungs = race(BELOW, [entering(e) for e in (1.0, 1.1, 1.2, 9.0, float("nan"))], 1)
    first, later = rung._FIRST, rung._LATER
    assert asked[:4] == [(e, first, False) for e in (1.0, 1.1, 1.2, 9.0)]
    assert [one[1:] for one in asked[4:6]] == [(first, False), (first, True)]
    assert asked[6:] == [(e, later, True) for e in (1.0, 1.1, 1.2, 1.4)]
    assert sorted(r.fit.rms for r in rungs) == [1.0, 1.1, 1.2, 1.4, 9.0]


def test_the_slowest_is_followed_first(followed: list[float]) -> None:
    trials = [entering(e) for e in (1.0, 1.1, 1.2)]
    for trial, seconds in zip(trials, (0.1, 0.3, 0.2), strict=True):
        trial.question.wall_s = seconds  # type: ignore[misc]
    race(BELOW, trials, 1)
    assert followed == [1.1, 1.2, 1.0]


def test_a_podium_is_followed_however_far_behind(followed: list[float]) -> None:
    trials = [entering(e, None) for e in (1.0, 1.1, 3.0, 3.1, 3.2, 1.9)]
    race(BELOW, trials, 1, most=6, podium=4)
    assert sorted(followed) == [1.0, 1.1, 1.9, 3.0]


def test_more_detail_is_followed_unless_it_has_lost_what_it_began_with(
    followed: list[float],
) -> None:
    ahead = [entering(0.1), entering(0.11), entering(0.12)]
    race(BELOW, [*ahead, entering(2.1, None), entering(2.3, None), entering(2.1)], 1)
    assert followed == [0.1, 0.11, 0.12, 2.1]


def test_no_more_are_followed_than_asked_for(followed: list[float]) -> None:
    trials = [entering(e, None) for e in (1.0, 1.1, 1.2, 1.3, 1.4, 1.9)]
    assert len(race(BELOW, trials, 1, most=4)) == 6
    assert followed == [1.0, 1.1, 1.2, 1.3]


def test_who_cannot_go_on_stays_where_it_is(followed: list[float]) -> None:
    rungs = race(BELOW, [entering(1.0), entering(1.25)], 1)
    assert followed == [1.0, 1.25]
    assert sorted(r.fit.rms for r in rungs) == [1.0, 1.25]


def test_between_laws_that_leave_but_noise_their_details_decide(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A mount has more freedom than friction has; static friction may fit better still."""
    shaped: list[str] = []

    def in_detail(_: Any, found: Rung, __: int) -> Rung:
        assert found.suspect is not None
        shaped.append(found.suspect.name)
        return found

    monkeypatch.setattr(contest, "_explained", lambda _: True)
    monkeypatch.setattr(contest, "_shaped", in_detail)
    monkeypatch.setattr(contest, "_founded", lambda _, found, __: found)
    monkeypatch.setattr(contest, "_simpler", lambda *_: False)
    monkeypatch.setattr(contest, "judged", lambda _, rungs: list(rungs))

    rungs = [named("mount", 1.0), named("friction", 1.05), named("creep", 1.2)]
    assert len(contest.contest(BELOW, rungs, BELOW)) == 5
    assert shaped == ["mount", "friction"]
    shaped.clear()
    assert len(contest.contest(BELOW, [rungs[0], rungs[2]], BELOW)) == 2
    assert not shaped


def named(name: str, error: float, *, still: bool = False) -> Rung:
    fit = ending(error)
    fit.model = Model(()) if still else Model.of(SecondOrder())
    return Rung(Trial(None, {}, SimpleNamespace(name=name)), fit, 0.0)  # type: ignore[arg-type]


def test_who_stands_without_mechanics_gets_them_where_the_best_has_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A force brings its own; a bent sensor is not to lose for that."""
    equipped: list[str] = []

    def founded(_: Any, found: Rung, __: int) -> Rung:
        assert found.suspect is not None
        equipped.append(found.suspect.name)
        return found

    monkeypatch.setattr(contest, "_explained", lambda _: True)
    monkeypatch.setattr(contest, "_shaped", lambda _, found, *__: found)
    monkeypatch.setattr(contest, "_founded", founded)
    monkeypatch.setattr(contest, "_simpler", lambda *_: False)
    monkeypatch.setattr(contest, "judged", lambda _, rungs: list(rungs))
    force, bent = named("cubic_stiffness", 1.0), named("sensor_nonlinearity", 2.4, still=True)
    far = named("creep", 2.6, still=True)
    assert len(contest.contest(BELOW, [force, bent, far], BELOW)) == 5
    assert equipped == ["cubic_stiffness", "sensor_nonlinearity"]
    equipped.clear()
    contest.contest(BELOW, [named("drift", 1.0, still=True), bent], BELOW)
    assert equipped == []


def brought(monkeypatch: pytest.MonkeyPatch, least: dict[str, float]) -> dict[str, bool]:
    """Who goes on in other forms, and whether second starts are over, of contenders of a contest.

    Args:
        least: errors that contenders are brought to at first, by name; the others stay.
    """
    on: dict[str, bool] = {}

    def chance(_: Any, found: Rung, *__: Any) -> contest._Chance:
        assert found.suspect is not None
        name = found.suspect.name
        return contest._Chance(named(name, least.get(name, found.fit.rms)), found.suspect, ())

    def further(_: Any, begun: contest._Chance, __: int, *, over: bool) -> Rung:
        on[begun.suspect.name] = over
        return begun.rung

    monkeypatch.setattr(contest, "_chance", chance)
    monkeypatch.setattr(contest, "_further", further)
    monkeypatch.setattr(contest, "_explained", lambda fit: fit.rms < 0.6)
    monkeypatch.setattr(contest, "settled", lambda _: False)
    monkeypatch.setattr(contest, "_after", lambda *_: None)
    monkeypatch.setattr(contest, "judged", lambda _, rungs: list(rungs))
    rungs = [named(str(error), error) for error in (1.0, 1.24, 1.26, 1.59, 1.61)]
    contest.contest(named("nothing", 2.0).fit, rungs, BELOW)
    return on


def test_who_is_behind_has_no_second_start_and_no_other_forms(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of 36 contenders of the bench beyond a quarter more error than the best none has won."""
    assert brought(monkeypatch, {}) == {"1.0": False, "1.24": False}
    assert brought(monkeypatch, {"1.26": 0.9}) == {"1.0": False, "1.24": False}


def test_where_one_leaves_but_noise_only_who_is_level_goes_on_and_in_other_forms_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A mount left but noise, and friction was sought for as long again at twice the error."""
    assert brought(monkeypatch, {"1.0": 0.5}) == {"1.0": True}
    assert brought(monkeypatch, {"1.24": 0.5, "1.0": 0.54}) == {"1.0": True, "1.24": True}
    assert brought(monkeypatch, {"1.24": 0.5, "1.0": 0.56}) == {"1.24": True}


def test_slow_forms_and_details_are_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """Forms at twice the error of the one there is; details begin at it, and have a quarter more.

    Nobody who leaves but noise has other forms.
    """
    tried: list[tuple[list[str], tuple[float, ...]]] = []

    def best(_: Any, found: Rung, trials: list[str], __: Any, ___: int, *beyond: float) -> Rung:
        tried.append((trials, beyond))
        return found

    monkeypatch.setattr(contest, "_best", best)
    monkeypatch.setattr(contest, "shape_refinements", lambda _: [])
    monkeypatch.setattr(contest, "other_forms", lambda *_: ["another form"])
    monkeypatch.setattr(contest, "with_base_details", lambda trial, *_: trial)
    for noise, forms in ((False, [(["another form"], (2.0,))]), (True, [])):
        monkeypatch.setattr(contest, "explained", lambda _, noise=noise: noise)
        tried.clear()
        contest._shaped(BELOW, named("creep", 1.0), 1)
        assert tried == [([], (1.25,)), *forms]


def test_who_is_ahead_does_not_begin_at_what_another_one_does(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begun: list[tuple[str, str]] = []

    def after(_: Any, found: Rung, other: Rung, __: int) -> None:
        assert found.suspect is not None
        assert other.suspect is not None
        begun.append((found.suspect.name, other.suspect.name))

    monkeypatch.setattr(
        contest, "_chance", lambda _, found, *__: contest._Chance(found, found.suspect, ())
    )
    monkeypatch.setattr(contest, "_further", lambda _, begun, *__, **___: begun.rung)
    monkeypatch.setattr(contest, "_explained", lambda _: False)
    monkeypatch.setattr(contest, "settled", lambda _: False)
    monkeypatch.setattr(contest, "_after", after)
    monkeypatch.setattr(contest, "judged", lambda _, rungs: list(rungs))
    rungs = [named("best", 1.0), named("near", 1.2), named("far", 3.0)]
    contest.contest(named("nothing", 4.0).fit, rungs, BELOW)
    assert sorted(begun) == [("far", "best"), ("far", "near"), ("near", "best")]
