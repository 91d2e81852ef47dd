"""Every problem asks its question, is solved, and finds its known answer; every one is a script."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol, cast

import numpy as np
import pytest

import piezo_opt as po

FOLDER = Path(__file__).resolve().parents[2] / "problems"
NAMES = sorted(f.stem for f in FOLDER.glob("*.py") if f.stem != "run_benchmark")


class Problem(Protocol):
    """What every file of the folder offers."""

    __doc__: str

    def question(self) -> po.Identification: ...
    def known(self) -> Mapping[str, float]: ...
    def check(self, fit: po.Fit) -> None: ...
    def main(self) -> None: ...


def problem(name: str) -> Problem:
    return cast(Problem, importlib.import_module(f"problems.{name}"))


def test_the_five_problems_are_there() -> None:
    assert {
        "bouc_wen_benchmark", "flexure_stage", "synthetic_recovery", "thesis_loop",
        "thesis_vibration",
    } <= set(NAMES)  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_says_what_is_asked_and_where_it_comes_from(name: str) -> None:
    one = problem(name)
    for word in ("Statement.", "known", "Source:"):
        assert word.lower() in one.__doc__.lower(), f"{name}: no {word!r} in its docstring"
    known = one.known()
    assert known
    assert np.isfinite(list(known.values())).all()


@pytest.mark.parametrize("name", NAMES)
def test_runs_as_a_script_and_finds_the_known_answer(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    # main() solves the question, prints answer and known answer, and ends with check(fit).
    problem(name).main()
    printed = capsys.readouterr().out
    assert "Converged" in printed


@pytest.mark.parametrize("name", ["thesis_loop", "synthetic_recovery", "flexure_stage"])
def test_a_wrong_answer_is_refused(name: str) -> None:
    one = problem(name)
    question = one.question()
    wrong = po.solve(question).values["piezo_gain.d"] * 1.02
    fixed = {**question.fixed, "piezo_gain.d": wrong}
    fit = po.solve(
        po.Identification(question.model, question.records, fixed=fixed, start=question.start)
    )
    with pytest.raises(AssertionError):
        one.check(fit)
