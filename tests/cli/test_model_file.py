"""Model files: what they say is asked, and what is wrong is named."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezo_opt import datasets, demo
from piezo_opt.effects.strain.creep import Creep
from piezo_opt.errors import PiezoOptError
from piezo_opt.identification import solve
from piezo_opt.modelfile import read_model

WHOLE = """
effects = ["piezo_gain", {effect = "creep", elements = 2}, "bouc_wen", "second_order"]
free = ["bouc_wen.n"]
per_record = ["piezo_gain.d"]
noise = "20 nm"

[values]
"bouc_wen.alpha" = "0.08 um/V"
piezo_gain.d = 2e-7

[fixed]
"second_order.omega" = 8.0321

[bounds]
"creep.tau" = ["10 ms", 100.0]
"creep.c" = [-inf, 0.5]

[priors]
"bouc_wen.beta" = {mean = 4e-3, std = "0.001 1/V"}
"""


def written(folder: Path, text: str, name: str = "model.toml") -> Path:
    file = folder / name
    file.write_text(text, encoding="utf-8")
    return file


def test_everything_a_model_file_can_say(tmp_path: Path) -> None:
    file = read_model(written(tmp_path, WHOLE))
    assert file.model.names == ("piezo_gain", "creep", "bouc_wen", "second_order")
    assert file.model["creep"] == Creep(elements=2)
    assert file.values == {"bouc_wen.alpha": pytest.approx(8e-8), "piezo_gain.d": 2e-7}
    assert file.bounds == {
        "creep.tau": (pytest.approx(0.01), 100.0),
        "creep.c": (-float("inf"), 0.5),
    }
    assert file.noise == pytest.approx(2e-8)
    assert file.numbers["second_order.omega"] == 8.0321
    assert file.numbers["second_order.zeta"] == 0.05  # nominal
    question = file.question(datasets.load("thesis/hysteresis"))
    assert question.free == ("bouc_wen.n",)
    assert question.priors["bouc_wen.beta"].std == pytest.approx(1e-3)
    assert question.fixed == {"second_order.omega": 8.0321}


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("# nothing", "effects: a model needs a list of effects"),
        ("effects = []", "effects: a model needs a list of effects"),
        ("effects = ['piezo_gain'", "is not valid TOML"),
        ("effects = ['piezo_gian']", "effects: There is no effect 'piezo_gian': did you mean"),
        ("effects = [3]", "effects: Effect 1 of the model has no name"),
        ("effects = [{effect='creep', elements=0}]", "effects: creep: the number of elements"),
        ("effects = ['piezo_gain']\nvalue = 1", "there is no key 'value': did you mean 'values'?"),
        ("effects = ['piezo_gain']\nvalues = 1", "values: is a table"),
        (
            "effects = ['piezo_gain']\n[values]\n'piezo_gain.e' = 1",
            "values: the model has no parameter 'piezo_gain.e': did you mean 'piezo_gain.d'?",
        ),
        (
            "effects = ['piezo_gain']\n[fixed]\n'piezo_gain.d' = '3 V'",
            "fixed.piezo_gain.d: '3 V' is not a quantity in m/V",
        ),
        (
            "effects = ['piezo_gain']\n[values]\n'piezo_gain.d' = nan",
            "values.piezo_gain.d: nan is not a number",
        ),
        (
            "effects = ['piezo_gain']\n[values]\n'piezo_gain.d' = true",
            "values.piezo_gain.d: True is not a number",
        ),
        (
            "effects = ['piezo_gain']\n[bounds]\n'piezo_gain.d' = [2, 1]",
            "bounds.piezo_gain.d: 2 is not below 1",
        ),
        (
            "effects = ['piezo_gain']\n[bounds]\n'piezo_gain.d' = 2",
            "bounds.piezo_gain.d: 2 is no pair",
        ),
        (
            "effects = ['piezo_gain']\n[priors]\n'piezo_gain.d' = {mean = 1}",
            "priors.piezo_gain.d: write {mean = ..., std = ...}",
        ),
        (
            "effects = ['piezo_gain']\n[priors]\n'piezo_gain.d' = {mean = 1, std = -1}",
            "priors.piezo_gain.d: Prior(1.0, -1.0)",
        ),
        ("effects = ['piezo_gain']\nfree = 'piezo_gain.d'", "free: is a list of parameters"),
        ("effects = ['piezo_gain']\nnoise = '2 V'", "noise: '2 V' is not a quantity in m"),
    ],
)
def test_what_is_wrong_is_named_with_file_and_key(tmp_path: Path, text: str, sentence: str) -> None:
    file = written(tmp_path, text)
    with pytest.raises(PiezoOptError) as caught:
        read_model(file)
    assert str(caught.value).startswith(f"{file}: ")
    assert sentence in str(caught.value)


def test_other_files_are_refused(tmp_path: Path) -> None:
    for name, text, sentence in (
        ("model.yaml", "x", "is read from .toml"),
        ("fit.json", "{", "is not valid JSON"),
        ("fit.json", "[]", "is not a model"),
        ("fit.json", "{}", "is not the JSON of a fit"),
    ):
        with pytest.raises(PiezoOptError, match=sentence):
            read_model(written(tmp_path, text, name))
    binary = tmp_path / "model.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(PiezoOptError, match="is not text"):
        read_model(binary)


def test_the_json_of_a_fit_is_a_model_file(tmp_path: Path) -> None:
    fit = solve(demo.question())
    file = read_model(written(tmp_path, json.dumps(fit.to_dict()), "fit.json"))
    assert file.model == fit.model
    assert file.fixed == {"second_order.omega": 8.0321, "second_order.zeta": 0.1992}
    assert file.values["bouc_wen.alpha"] == fit.values["bouc_wen.alpha"]
    assert file.free == ()


@given(text=st.text(max_size=80))
def test_garbage_gets_a_sentence(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    file = tmp_path_factory.mktemp("garbage") / "model.toml"
    file.write_bytes(b"effects = ['piezo_gain']\n" + text.encode("utf-8", "replace"))
    try:
        read_model(file)
        said = f"{file}: is a model"
    except PiezoOptError as error:
        said = str(error)
    assert str(file) in said
