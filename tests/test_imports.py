"""The import contract is kept, and it would notice if it were not."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A copy of the package and its contract, to break."""
    shutil.copytree(
        ROOT / "piezo_opt", tmp_path / "piezo_opt", ignore=shutil.ignore_patterns("__pycache__")
    )
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    return tmp_path


def contract(folder: Path) -> subprocess.CompletedProcess[str]:
    """Lint the imports of the package in this folder."""
    return subprocess.run(
        [Path(sys.executable).with_name("lint-imports"), "--no-cache", "--no-logo"],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
        check=False,
    )


def test_the_contract_is_kept(copy: Path) -> None:
    done = contract(copy)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "3 kept, 0 broken" in done.stdout


@pytest.mark.parametrize(
    ("file", "line", "broken"),
    [
        ("units.py", "from piezo_opt.simulation import simulate", "Imports point one way"),
        ("effects/base.py", "import piezo_opt.assembly", "Imports point one way"),
        ("effects/base.py", "import casadi", "CasADi stays behind its border"),
        ("measurement/record.py", "import matplotlib.pyplot", "Only the report draws"),
        ("attic.py", "", "Imports point one way"),
    ],
)
def test_a_wrong_import_is_noticed(copy: Path, file: str, line: str, broken: str) -> None:
    with (copy / "piezo_opt" / file).open("a") as source:
        source.write(f"\n{line}\n")
    done = contract(copy)
    assert done.returncode == 1
    assert f"{broken} BROKEN" in done.stdout


def test_every_folder_is_a_package() -> None:
    # The contract does not look into a folder without __init__.py, and neither do the docs.
    folders = {file.parent for file in (ROOT / "piezo_opt").rglob("*.py")}
    assert [str(f.relative_to(ROOT)) for f in folders if not (f / "__init__.py").exists()] == []


def test_nobody_waits_for_what_only_some_need() -> None:
    """Each of these takes a quarter of a second and more to load."""
    heavy = ("cma", "control", "matplotlib.pyplot", "pandas")
    said = f"import sys, piezo_opt.cli; print([n for n in {heavy} if n in sys.modules])"
    done = subprocess.run([sys.executable, "-c", said], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
