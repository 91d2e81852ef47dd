"""Every python block of every page runs, and prints what the page states."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType

import pytest

from tests.docs.pages import Block, blocks, disagreement

ROOT = Path(__file__).resolve().parents[2]
PAGES = [
    page
    for page in (
        ROOT / "README.md",
        ROOT / "CONTRIBUTING.md",
        *sorted((ROOT / "docs").glob("*.md")),
    )
    if blocks(page)
]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_page(
    page: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    # A real module, because dataclasses look up the module that their class comes from.
    program = ModuleType(f"page_{page.stem}")
    monkeypatch.setitem(sys.modules, program.__name__, program)
    (tmp_path / "data").symlink_to(ROOT / "data")
    monkeypatch.chdir(tmp_path)
    capsys.readouterr()
    for block in blocks(page):
        # The empty lines make a traceback point into the page.
        code = compile("\n" * (block.line - 1) + block.code, str(page), "exec")
        exec(code, program.__dict__)
        printed = capsys.readouterr().out
        if block.prints is not None:
            problem = disagreement(block.prints, printed)
            assert problem is None, f"{page.name}, line {block.line}: {problem}"


def test_the_pages_that_teach_run_code() -> None:
    assert {page.name for page in PAGES} >= {
        *("README.md", "extending.md", "how_to_choose.md", "index.md", "thesis.md", "tutorial.md"),
    }


def test_blocks(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(
        "# x\n```python\na = 1\n```\n```sh\nls\n```\n```python\na\n```\n\n```text\n1\n```\n"
    )
    assert blocks(page) == [Block(3, "a = 1\n", None), Block(9, "a\n", "1\n")]


@pytest.mark.parametrize(
    ("stated", "printed", "agrees"),
    [
        ("rms 0.169 um", "rms 0.1688 um", True),
        ("rms 0.169 um", "rms 0.171 um", False),
        ("rms  0.169 um", "rms 0.169 nm", False),
        ("tau 1.2e-8", "tau 1.25e-08", True),
        ("tau 1.2e-8", "tau 1.4e-08", False),
        ("n -5", "n 5", False),
        ("bouc_wen.alpha 3", "bouc_wen.alpha   3", True),
        ("first\n...\nlast 1", "first\nanything\nat all\nlast 1", True),
        ("took ... s", "took 0.31 s", True),
        ("first\n...\nlast 1", "first\nanything", False),
        ("Table 3.1 b", "Table 3.1", False),
    ],
)
def test_disagreement(stated: str, printed: str, agrees: bool) -> None:
    assert (disagreement(stated, printed) is None) is agrees
