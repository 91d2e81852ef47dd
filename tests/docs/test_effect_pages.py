"""The generated pages say what the classes declare."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

from piezo_opt.effects.catalogue import CATALOGUE

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def hooks() -> ModuleType:
    """The module that writes the pages."""
    spec = importlib.util.spec_from_file_location("docs_hooks", ROOT / "docs" / "hooks.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", CATALOGUE)
def test_a_page_holds_what_its_effect_declares(hooks: ModuleType, name: str) -> None:
    effect = CATALOGUE[name]()
    page = hooks.page(effect)
    for line in effect.equation.splitlines():
        assert f"    {line}" in page
    parameters = page.split("## Parameters")[1].split("\n## ")[0]
    rows = [line for line in parameters.splitlines() if line.startswith("| `")]
    assert len(rows) == len(effect.parameters)
    for row, (own, declared) in zip(rows, effect.parameters.items(), strict=True):
        cells = [cell.strip() for cell in row.replace(r"\|", "/").strip("|").split(" | ")]
        assert cells[0] == f"`{own}`"
        assert cells[1] == f"`{declared.unit}`"
        assert float(cells[3]) == pytest.approx(declared.nominal, rel=1e-5)
        assert ("gate" in cells[-1]) == (own == effect.gate)
    assert page.count("## References") == 1


def test_the_index_holds_every_effect(hooks: ModuleType) -> None:
    listed = [line for line in hooks.index().splitlines() if line.startswith("| [`")]
    assert [line.split("`")[1] for line in listed] == list(CATALOGUE)
