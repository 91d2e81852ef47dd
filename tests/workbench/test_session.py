"""A session is a file that loses nothing, and a script that is the same steps."""

from __future__ import annotations

import ast
import errno
import json
import os
from pathlib import Path

import pytest

from piezo_opt.effects import Creep, MainsPickup, Offset, PiezoGain, RateDependence
from piezo_opt.errors import InputError
from piezo_opt.workbench.edits import (
    Add,
    Adopt,
    Bound,
    Exchange,
    Fix,
    Free,
    Remove,
    constructed,
    edit_from_dict,
)
from piezo_opt.workbench.load import Load, Source
from piezo_opt.workbench.session import Session, read_session

NASTY = "x'\"\\\n#<script>.csv"
EVERY = (
    Add(Creep(elements=2)),
    Remove("creep"),
    Exchange("bouc_wen", RateDependence()),
    Fix("bouc_wen.beta", 0.02),
    Free("bouc_wen.n"),
    Bound("piezo_gain.d", 0.0, 1e-6),
    Adopt(PiezoGain() + Offset(), ("bouc_wen.n",), {"piezo_gain.d": 1e-7}),
)


def test_a_session_comes_back_from_its_file_with_every_kind_of_step(tmp_path: Path) -> None:
    load = Load((Source(NASTY, {"drive": "u [V]"}),), accept=("jump",), mend=("wrapped",))
    session = Session(load, True, EVERY, 5)
    session.save(tmp_path / "session.json")
    again = read_session(tmp_path / "session.json")
    assert again.to_dict() == session.to_dict()
    assert again.script == session.script
    assert [type(edit) for edit in again.edits] == [type(edit) for edit in EVERY]


def test_a_full_disk_leaves_the_earlier_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "session.json"
    Session(Load((Source("first.csv"),))).save(file)

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(InputError, match="the disk is full"):
        Session(Load((Source("second.csv"),))).save(file)
    assert read_session(file).load.sources[0].path == "first.csv"
    assert list(tmp_path.iterdir()) == [file]


def test_undo_and_redo_move_along_the_steps_and_a_new_step_forgets_what_was_undone() -> None:
    first = Session(Load(()), True).with_(EVERY[0]).with_(EVERY[1])
    back = first.undone()
    assert (back.path, back.redone()) == (EVERY[:1], first)
    assert back.with_(EVERY[3]).edits == (EVERY[0], EVERY[3])
    with pytest.raises(InputError, match="no step to undo"):
        back.undone().undone()
    with pytest.raises(InputError, match="no step to redo"):
        first.redone()


def test_names_of_files_are_data_in_the_script_and_never_code() -> None:
    text = Session(Load((Source(NASTY, {"drive": '")#\nimport os'}),)), True, EVERY, 7).script
    tree = ast.parse(text)
    texts = {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)}
    assert {NASTY, '")#\nimport os'} <= texts
    imported = [n.names[0].name for n in ast.walk(tree) if isinstance(n, ast.Import)]
    assert imported == ["sys", "piezo_opt"]
    assert sum(isinstance(n, ast.Assign) for n in tree.body) == 2 + 3 + 2 * 7 + 1


def test_an_effect_is_written_with_what_is_unusual_about_it() -> None:
    assert constructed(Creep()) == "effects.Creep()"
    assert constructed(MainsPickup(mains=60.0)) == "effects.MainsPickup(mains=60.0)"


@pytest.mark.parametrize(
    "change",
    [
        {"schema": "other"},
        {"depth": 9},
        {"depth": True},
        {"edits": [{"do": "__import__"}]},
        {"edits": [{"do": "add", "effect": {"effect": "creep", "elements": [1]}}]},
        {"edits": [{"do": "add", "effect": {"effect": "no_such"}}]},
        {"edits": [{"do": "fix", "name": "a.b", "value": float("nan")}]},
        {"edits": [{"do": "bound", "name": "a.b", "low": "x", "high": 1}]},
        {"edits": [7]},
        {"load": {"sources": [{"path": 3, "said": {}}], "accept": [], "mend": []}},
        {"load": {"sources": [{"path": "a", "said": {"every": "2"}}], "accept": [], "mend": []}},
        {"load": []},
    ],
)
def test_a_broken_session_is_one_sentence_with_its_file(
    tmp_path: Path, change: dict[str, object]
) -> None:
    file = tmp_path / "broken.json"
    file.write_text(json.dumps({**Session(Load(())).to_dict(), **change}))
    with pytest.raises(InputError, match=r"broken\.json") as told:
        read_session(file)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("text", ["", "{", "[" * 100_000, "null", '"x"', "\x00"])
def test_what_is_no_json_is_no_session(tmp_path: Path, text: str) -> None:
    file = tmp_path / "broken.json"
    file.write_text(text)
    with pytest.raises(InputError, match=r"broken\.json"):
        read_session(file)


def test_only_effects_are_made() -> None:
    with pytest.raises(InputError, match="no such step"):
        edit_from_dict({"do": "Add", "effect": "creep"})
