"""Advised drives on plants: a few here, a hundred by ``piezo-opt bench advice``."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

import piezo_opt as po
from piezo_opt.benchmark import advised
from piezo_opt.benchmark.advised import Resolved, resolved
from piezo_opt.cli import app
from piezo_opt.errors import InputError


def test_an_advised_drive_resolves_its_group() -> None:
    (told,) = resolved(8, cases=("bent gain",))
    assert told.group[0] == "nonlinear_gain"
    assert len(told.group) > 1
    assert told.right == 8
    assert told.sigmas > 5.0
    assert "8 of 8 plants resolved" in str(told)
    with pytest.raises(InputError, match="no case 'bend'"):
        next(resolved(8, cases=("bend",)))


def test_a_fit_that_was_interrupted_is_no_evidence(monkeypatch: pytest.MonkeyPatch) -> None:
    """It would hold its start: the plant would count as judged."""
    whole = advised.solve

    def halted(question: po.Identification, **said: Any) -> po.Fit:
        fit = whole(question, **said)
        return replace(
            fit, outcome=replace(fit.outcome, ending=po.identification.Ending.INTERRUPTED)
        )

    monkeypatch.setattr(advised, "solve", halted)
    with pytest.raises(KeyboardInterrupt):
        next(resolved(2, cases=("bent gain",)))


def test_the_command_keeps_the_cases_that_were_finished(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = Resolved("lag", ("delay", "lag"), "a sine", 12.0, 1.0, 2, 2)
    out = tmp_path / "told.json"

    def early(*_: object, **__: object) -> Iterator[Resolved]:
        yield one
        raise KeyboardInterrupt

    monkeypatch.setattr(advised, "resolved", early)
    done = CliRunner().invoke(app, ["bench", "advice", "--max-time", "1 h", "--json", str(out)])
    assert done.exit_code == 130, done.output
    assert str(one) in done.stdout
    assert "after 1 of 4 cases" in done.stderr
    assert [case["right"] for case in json.loads(out.read_text())["cases"]] == [2]
    monkeypatch.undo()
    done = CliRunner().invoke(app, ["bench", "advice", "--max-time", "0.2 s"])
    assert done.exit_code == 2, done.output
    assert "over before there was a result" in done.stderr
