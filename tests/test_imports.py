"""The import contract is kept, and it would notice if it were not."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import piezo_opt

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
        ("effects/effect.py", "import piezo_opt.assembly", "Imports point one way"),
        ("effects/effect.py", "import casadi", "CasADi stays behind its border"),
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


def loaded_by(statement: str, *, asked: tuple[str, ...]) -> list[str]:
    """Which of these modules a fresh interpreter has loaded after a statement."""
    said = f"import sys\n{statement}\nprint(*[n for n in {asked!r} if n in sys.modules], sep='\\n')"
    done = subprocess.run([sys.executable, "-c", said], capture_output=True, text=True, check=True)
    return done.stdout.split()


HEAVY = (
    *("cma", "control", "h5py", "matplotlib", "pandas", "pint", "pydantic", "rich"),
    *("scipy.interpolate", "scipy.io", "scipy.optimize", "scipy.signal", "scipy.sparse"),
    *("scipy.stats", "scipy.special", "scipy.linalg"),
)


def test_nobody_waits_for_what_only_some_need() -> None:
    """Each of these takes a tenth of a second to a second to load."""
    assert loaded_by("import piezo_opt", asked=(*HEAVY, "casadi", "numpy")) == []
    help_ = "from piezo_opt.cli import app\nfrom contextlib import redirect_stdout, suppress"
    help_ += "\nimport io\nwith redirect_stdout(io.StringIO()), suppress(SystemExit):"
    help_ += "\n    app(['--help'])"
    assert loaded_by(help_, asked=HEAVY) == []


def test_a_fit_loads_no_more_than_it_asks(tmp_path: Path) -> None:
    """Special functions and linear algebra are asked by every fit; the rest by none of a CSV."""
    record = tmp_path / "loop.csv"
    rows = "".join(f"{k / 100},{k % 40},{0.2 * (k % 40):.3f}\n" for k in range(200))
    record.write_text("time [s],voltage [V],displacement [um]\n" + rows)
    statement = "from piezo_opt.cli import app\nfrom contextlib import redirect_stdout, suppress"
    statement += "\nimport io\nwith redirect_stdout(io.StringIO()), suppress(SystemExit):"
    statement += f"\n    app(['fit', {str(record)!r}])"
    asked_by_every_fit = {"scipy.special", "scipy.linalg"}
    assert loaded_by(statement, asked=tuple(set(HEAVY) - asked_by_every_fit)) == []


def test_the_workbench_has_an_address_before_numpy_is_loaded() -> None:
    """A browser takes its time to begin: it shall do so while the rest is loaded."""
    statement = "from piezo_opt.cli.workbench import workbench"
    statement += "\nfrom piezo_opt.workbench.load import Load, Source"
    statement += "\nfrom piezo_opt.workbench.serve import serve"
    statement += "\nfrom piezo_opt.workbench.session import Session"
    assert loaded_by(statement, asked=("numpy", "uvicorn", "starlette", *HEAVY)) == []


def test_the_front_door_says_where_each_name_lives() -> None:
    """What the type checker reads, what is public and what is loaded on demand are one list."""
    source = ast.parse((ROOT / "piezo_opt" / "__init__.py").read_text())
    block = next(node for node in source.body if isinstance(node, ast.If))
    typed = {
        alias.name: str(node.module).removeprefix("piezo_opt.")
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    rooms = {name for name, room in typed.items() if room == "piezo_opt"}
    assert {name: room for name, room in typed.items() if name not in rooms} == piezo_opt._ROOM_OF
    assert set(piezo_opt.__all__) == set(typed)
    for name in piezo_opt.__all__:
        assert getattr(piezo_opt, name) is not None
    with pytest.raises(AttributeError, match="has no attribute 'nonsense'"):
        _ = piezo_opt.nonsense
