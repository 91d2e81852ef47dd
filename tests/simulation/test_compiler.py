"""The cache of compiled libraries: built once, never believed blindly, never in the way."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from time import sleep
from typing import Any, final

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.effects import BoucWen, PiezoGain, SecondOrder
from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place
from piezo_opt.measurement import Measurement
from piezo_opt.simulation import Simulator, Substeps, compiler, library
from piezo_opt.simulation.compiler import find_compiler, load
from piezo_opt.simulation.engine import engine
from piezo_opt.simulation.forms import Form, Written
from piezo_opt.simulation.library import functions_of
from piezo_opt.values import Values

COMPILER = find_compiler()
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="compiles C: no compiler")

TEXT = "double po_run(double x) { return 2.0 * x + 0.125; }\n"
# The module alone, without the package around it: starting a process is then quick.
LOADING = f"""
import ctypes, importlib.util, sys, types
package = sys.modules["piezo_opt"] = types.ModuleType("piezo_opt")
package.__path__ = [{os.path.dirname(po.__file__)!r}]
spec = importlib.util.spec_from_file_location("compiler", {compiler.__file__!r})
module = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)
library = module.load({TEXT!r})
library.po_run.restype, library.po_run.argtypes = ctypes.c_double, [ctypes.c_double]
print(library.po_run(3.0))
"""


@final
@dataclass(frozen=True)
class Own(Effect):
    """A power of the drive, as nobody else has it."""

    power: int = 1
    place = Place.STRAIN
    size = Parameter("m", "displacement at 1 V", nominal=0.0, bounds=(0.0, 1.0), null=0.0)
    held = Parameter("1", "factor", nominal=1.0, bounds=(0.0, 2.0), fixed=True)

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        return Equations(gives=p.held * p.size * chain.drive.value**self.power)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache directory of the test's own."""
    directory = tmp_path / "cache"
    monkeypatch.setenv("PIEZO_OPT_CACHE", str(directory))
    return directory


@pytest.fixture
def compilations(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A log with one line for each library that the compiler was asked for."""
    log, wrapper = tmp_path / "log", tmp_path / "logging_cc"
    log.touch()
    wrapper.write_text(
        f'#!/bin/sh\ncase "$*" in *-shared*) echo "$*" >> "{log}";; esac\nexec "{COMPILER}" "$@"\n'
    )
    wrapper.chmod(0o755)
    monkeypatch.setenv("PIEZO_OPT_CC", str(wrapper))
    return log


def value(library: ctypes.CDLL | None) -> float:
    assert library is not None
    library.po_run.restype, library.po_run.argtypes = ctypes.c_double, [ctypes.c_double]
    return float(library.po_run(3.0))


def in_another_process() -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-W", "error", "-c", LOADING],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def answer(process: subprocess.Popen[str]) -> float:
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    return float(out)


def libraries(cache: Path) -> list[Path]:
    return sorted(cache.rglob("*.so"))


@needs_compiler
def test_a_text_is_compiled_once_and_another_text_again(cache: Path, compilations: Path) -> None:
    assert value(load(TEXT)) == 6.125
    assert value(load(TEXT)) == 6.125
    assert answer(in_another_process()) == 6.125
    assert len(compilations.read_text().splitlines()) == 1
    assert value(load(TEXT.replace("2.0", "3.0"))) == 9.125
    assert len(compilations.read_text().splitlines()) == 2
    assert len(libraries(cache)) == 2


@needs_compiler
def test_processes_that_build_at_once_leave_one_whole_library(cache: Path) -> None:
    processes = [in_another_process() for _ in range(4)]
    assert [answer(p) for p in processes] == [6.125] * 4
    assert len(libraries(cache)) == 1
    assert {p.name for p in cache.iterdir()} == {libraries(cache)[0].parent.name, ".pruned"}


@needs_compiler
@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_a_cut_off_library_is_built_again_and_kills_nobody(cache: Path, share: float) -> None:
    assert answer(in_another_process()) == 6.125
    (library,) = libraries(cache)
    whole = library.read_bytes()
    library.write_bytes(whole[: int(share * len(whole))])
    # Without a check of its content the loader maps it and the process dies of a bus error.
    assert answer(in_another_process()) == 6.125
    (again,) = libraries(cache)
    assert again.stat().st_size == len(whole)


@needs_compiler
def test_a_changed_library_is_built_again(cache: Path) -> None:
    assert answer(in_another_process()) == 6.125
    (library,) = libraries(cache)
    other = bytearray(library.read_bytes())
    middle = other.find(np.float64(0.125).tobytes())
    assert middle > 0
    other[middle : middle + 8] = np.float64(7.0).tobytes()
    library.write_bytes(bytes(other))
    assert answer(in_another_process()) == 6.125


@needs_compiler
def test_rebuilding_leaves_alone_who_uses_the_old_file(cache: Path) -> None:
    mine = load(TEXT)
    (library,) = libraries(cache)
    damaged = library.with_suffix(".tmp")
    damaged.write_bytes(library.read_bytes()[:5000])
    damaged.replace(library)
    assert answer(in_another_process()) == 6.125
    assert value(mine) == 6.125
    assert value(load(TEXT)) == 6.125


@needs_compiler
@pytest.mark.parametrize("where", ["a name too long", "a file for the text"])
def test_a_cache_that_cannot_be_written_is_done_without(
    cache: Path, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    # Also root cannot make a directory where a file is.
    if where == "a file for the text":
        load(TEXT)
        (library,) = libraries(cache)
        shutil.rmtree(library.parent)
        library.parent.write_text("in the way")
    else:
        monkeypatch.setenv("PIEZO_OPT_CACHE", str(cache / ("long" * 100)))
    assert value(load(TEXT)) == 6.125
    assert answer(in_another_process()) == 6.125
    assert libraries(cache) == []


@needs_compiler
def test_a_compiler_that_does_not_know_the_processor_is_asked_for_a_plain_library(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wrapper = tmp_path / "old_cc"
    wrapper.write_text(
        f'#!/bin/sh\ncase "$*" in *-march=native*) exit 1;; esac\nexec "{COMPILER}" "$@"\n'
    )
    wrapper.chmod(0o755)
    monkeypatch.setenv("PIEZO_OPT_CC", str(wrapper))
    assert value(load(TEXT)) == 6.125
    assert len(libraries(cache)) == 1


@pytest.mark.parametrize("command", ["", "no_such_compiler_anywhere", "false"])
def test_without_a_working_compiler_there_is_no_library(
    cache: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    monkeypatch.setenv("PIEZO_OPT_CC", command)
    assert load(TEXT) is None
    assert libraries(cache) == []


@needs_compiler
def test_without_a_compiler_the_numbers_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    model = PiezoGain() + BoucWen() + SecondOrder()
    time = np.arange(60) / 1e4
    drive = 30.0 * np.sin(2 * np.pi * 300 * time)
    record = Measurement(time, drive, 1e-7 * drive)
    values = Values.nominal(model)

    def simulated() -> Simulator:
        engine.cache_clear()
        return Simulator(
            model, record, values, directions=("bouc_wen.beta",), substeps=Substeps(2e-5, 5.0)
        )

    compiled = simulated()
    assert compiled.compiled
    expected = compiled.with_sensitivities(values)
    monkeypatch.setenv("PIEZO_OPT_CC", "")
    without = simulated()
    assert not without.compiled
    found = without.with_sensitivities(values)
    engine.cache_clear()
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-12 * np.ptp(other))


@needs_compiler
def test_threads_write_programs_one_at_a_time(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """CasADi frees expressions without the interpreter's lock: two threads at it may crash."""
    inside, most = 0, 0
    known = library.written

    def written(effect: Effect, runtime: frozenset[str]) -> tuple[Form, dict[str, Written]]:
        nonlocal inside, most
        inside += 1
        most = max(most, inside)
        sleep(0.02)
        found = known(effect, runtime)
        inside -= 1
        return found

    monkeypatch.setattr(library, "written", written)
    with ThreadPoolExecutor(max_workers=4) as pool:
        made = list(pool.map(lambda n: functions_of(Own(n), frozenset()), (1, 2, 3, 4)))
    assert all(one is not None for one in made)
    assert len(libraries(cache)) == 4
    assert most == 1


SAYING = """
import hashlib
from piezo_opt.assembly import System, assemble
from piezo_opt.effects import BoucWen, Creep, PiezoGain, SecondOrder
system = assemble(PiezoGain() + BoucWen() + Creep() + SecondOrder(), {"bouc_wen.n": 1.0})
print(hashlib.sha256(system.recipe.encode()).hexdigest())
"""


def test_a_recipe_is_the_same_in_every_process() -> None:
    said = {
        subprocess.run(
            [sys.executable, "-c", SAYING], capture_output=True, text=True, check=True,
            env={**os.environ, "PYTHONHASHSEED": seed},
        ).stdout
        for seed in ("1", "2")
    }  # fmt: skip
    assert len(said) == 1


def test_the_library_follows_from_every_file_that_it_is_written_by() -> None:
    """A kept library of another version of one of them would go on being used."""
    folder, prefix = Path(library.__file__).parent, "from piezo_opt.simulation."
    found, left = set(), ["library"]
    while left:
        name = left.pop()
        found.add(name)
        lines = (folder / f"{name}.py").read_text().splitlines()
        asked = [line.removeprefix(prefix).split()[0] for line in lines if line.startswith(prefix)]
        left += [one for one in asked if one not in found]
    told = {Path(name).stem for name in library.WRITERS if name.endswith(".py")}
    # The compiler has a part of its own in the key, and lists of operations are not kept.
    assert found - {"compiler", "compose"} == told
    assert {"core.h", "core.c", "machine.h", "assembler.h"} <= {*library.WRITERS}


@needs_compiler
def test_a_program_is_written_once_and_again_for_whatever_differs(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[Effect, frozenset[str]]] = []
    known = library.written
    assert functions_of(BoucWen(), frozenset()) is not None  # the catalogue is there by now

    def written(effect: Effect, runtime: frozenset[str]) -> tuple[Form, dict[str, Written]]:
        asked.append((effect, runtime))
        return known(effect, runtime)

    monkeypatch.setattr(library, "written", written)
    plain, free = frozenset[str](), frozenset(["held"])
    wanted = [(Own(5), plain), (Own(5), free), (Own(6), plain)]
    for effect, runtime in [*wanted, wanted[0], wanted[2]]:
        assert functions_of(effect, runtime) is not None
    assert asked == wanted
    assert len(libraries(cache)) == 3
