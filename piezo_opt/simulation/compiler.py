"""A recipe to a loaded library, written and compiled once and kept by the recipe's hash.

The recipe is whatever the C text follows from: the text itself, or less where writing it takes
long. A library is kept as ``HASH OF THE RECIPE/HASH OF THE LIBRARY.so``. It is opened only when its
content has the hash that its name says: the loader maps the file, and a cut-off one would not be
refused but kill the process with a bus error. Whatever fails the test is removed and built again.

Two processes may build the same library at once: each writes its own temporary file and renames
it into place, which is atomic and leaves alone who has the old file mapped. A cache directory
that cannot be written is replaced by a temporary one for this process.

Environment: ``PIEZO_OPT_CACHE`` is the cache directory, ``PIEZO_OPT_CC`` the compiler; an empty
``PIEZO_OPT_CC`` means that there is none.
"""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Final

FLAGS: Final = (
    "-O3", "-fno-tree-slp-vectorize", "-march=native", "-fno-math-errno", "-fno-trapping-math",
    "-std=gnu11", "-shared", "-fPIC", "-w",
)  # fmt: skip
"""Nothing that changes the order of additions: the numbers are those of the other engine. Packing
scalars into vectors takes longer to compile and, in straight-line code, longer to run."""

PROBE: Final = "po_run"
"""A symbol that every library has."""


def find_compiler() -> str | None:
    """Path of the C compiler, or None when there is none."""
    wished = os.environ.get("PIEZO_OPT_CC")
    if wished is not None:
        return shutil.which(wished) if wished else None
    return next((path for name in ("cc", "gcc", "clang") if (path := shutil.which(name))), None)


def cache_directory() -> Path:
    """Where compiled libraries are kept."""
    wished = os.environ.get("PIEZO_OPT_CACHE")
    if wished:
        return Path(wished)
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "piezo_opt"


@cache
def _fingerprint(compiler: str) -> str:
    """Compiler version and processor: what a library built for one must not share with another."""
    asked = subprocess.run([compiler, "--version"], capture_output=True, text=True, check=False)
    processor = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        processor += next((line for line in lines if line.startswith("flags")), "")
    except OSError:
        pass
    return f"{asked.stdout.splitlines()[:1]}|{processor}|{FLAGS}"


def load(recipe: str, write: Callable[[str], str] = str) -> ctypes.CDLL | None:
    """The compiled library of a recipe, or None when it cannot be built here.

    Args:
        recipe: all that the C text depends on.
        write: makes the C text of it; not called where the library is kept. Unless given, the
            recipe is the C text.
    """
    compiler = find_compiler()
    if compiler is None:
        return None
    key = hashlib.sha256(f"{_fingerprint(compiler)}\n{recipe}".encode()).hexdigest()[:32]

    def text() -> str:
        return write(recipe)

    return _load_into(cache_directory(), key, text, compiler) or _load_into(
        Path(_private_directory()), key, text, compiler
    )


@cache
def _private_directory() -> str:
    """A directory of this process, for when the cache cannot be written."""
    import atexit

    path = tempfile.mkdtemp(prefix="piezo_opt_")
    atexit.register(shutil.rmtree, path, ignore_errors=True)
    return path


def _load_into(
    directory: Path, key: str, text: Callable[[], str], compiler: str
) -> ctypes.CDLL | None:
    kept = directory / key
    loaded = _open_kept(kept)
    if loaded is not None:
        return loaded
    try:
        kept.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".build_", dir=directory) as scratch:
            made = _compile(Path(scratch), text(), compiler)
            if made is None:
                return None
            os.replace(made, kept / f"{_digest(made)}.so")
    except OSError:
        return None
    return _open_kept(kept)


def _open_kept(kept: Path) -> ctypes.CDLL | None:
    """The first library of a directory that is what its name says and that loads."""
    try:
        candidates = sorted(kept.glob("*.so"))
    except OSError:
        return None
    for library in candidates:
        try:
            if _digest(library) == library.stem:
                loaded = ctypes.CDLL(str(library))
                if hasattr(loaded, PROBE):
                    return loaded
        except OSError:
            pass
        # Removing is safe even where another process has it mapped: the file lives on until then.
        with contextlib.suppress(OSError):
            library.unlink()
    return None


def _digest(library: Path) -> str:
    return hashlib.sha256(library.read_bytes()).hexdigest()[:32]


def _compile(scratch: Path, text: str, compiler: str) -> Path | None:
    source, target = scratch / "core.c", scratch / "core.so"
    source.write_text(text)
    for flags in (FLAGS, tuple(f for f in FLAGS if f != "-march=native")):
        done = subprocess.run(
            [compiler, *flags, "-o", str(target), str(source), "-lm"],
            capture_output=True, check=False,
        )  # fmt: skip
        if done.returncode == 0:
            return target
    return None
