"""A recipe to a loaded library, written and compiled once and kept by the recipe's hash.

The recipe is whatever the C text follows from: the text itself, or less where writing it takes
long. A library is kept as ``HASH OF THE RECIPE/HASH OF THE LIBRARY.so``. It is opened only when its
content has the hash that its name says: the loader maps the file, and a cut-off one would not be
refused but kill the process with a bus error. Whatever fails the test is removed and built again.

Of two processes that would build the same library the second one waits. A file is written beside
its place and renamed into it, which is atomic and leaves alone who has the old file mapped. A
cache directory that cannot be written is replaced by a temporary one for this process.

Environment: ``PIEZO_OPT_CC`` is the compiler; an empty one means that there is none.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import platform
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from typing import Final

from piezo_opt.keeping import digest, own_directory, prune, used

FLAGS: Final = (
    "-O3", "-fno-tree-slp-vectorize", "-march=native", "-fno-math-errno", "-fno-trapping-math",
    "-std=gnu11", "-fPIC", "-w",
)  # fmt: skip
"""Nothing that changes the order of additions: the numbers are those of the other engine. Packing
scalars into vectors takes longer to compile and, in straight-line code, longer to run."""

PROBES: Final = ("po_run", "po_forms")
"""Symbols of which every library has one."""


def find_compiler() -> str | None:
    """Path of the C compiler, or None when there is none."""
    return _found(os.environ.get("PIEZO_OPT_CC"), os.environ.get("PATH"))


@cache
def _found(wished: str | None, path: str | None) -> str | None:
    """The compiler that is wished for, or the first that there is, along a search path."""
    names = ("cc", "gcc", "clang") if wished is None else (wished,)
    return next((file for name in names if name and (file := shutil.which(name, path=path))), None)


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


def load(
    recipe: str,
    write: Callable[[str], str | Mapping[str, str]] = str,
    progress: Callable[[int, int], None] | None = None,
) -> ctypes.CDLL | None:
    """The compiled library of a recipe, or None when it cannot be built here.

    Args:
        recipe: all that the C text depends on.
        write: makes the C text of it, or several texts by file name, of which those that end in
            ``.c`` are compiled side by side; not called where the library is kept. Unless given,
            the recipe is the C text.
        progress: told how many texts are compiled, and of how many.

    Raises:
        InputError: the cache directory is not the user's alone.
    """
    compiler = find_compiler()
    if compiler is None:
        return None
    key = digest(f"{_fingerprint(compiler)}\n{recipe}".encode())

    def texts() -> Mapping[str, str]:
        told = write(recipe)
        return {"core.c": told} if isinstance(told, str) else told

    say = progress or (lambda _done, _all: None)
    loaded = None
    command = (compiler, *FLAGS)
    with contextlib.suppress(OSError):
        loaded = _load_into(own_directory(), key, texts, command, say)
    return loaded or _load_into(Path(_private_directory()), key, texts, command, say)


@cache
def _private_directory() -> str:
    """A directory of this process, for when the cache cannot be written."""
    import atexit

    path = tempfile.mkdtemp(prefix="piezo_opt_")
    atexit.register(shutil.rmtree, path, ignore_errors=True)
    return path


def _load_into(
    directory: Path,
    key: str,
    texts: Callable[[], Mapping[str, str]],
    command: tuple[str, ...],
    progress: Callable[[int, int], None],
) -> ctypes.CDLL | None:
    kept = directory / key
    loaded = _open_kept(kept)
    if loaded is not None:
        return loaded
    try:
        kept.mkdir(parents=True, exist_ok=True)
        with _alone(kept):
            loaded = _open_kept(kept)  # another process may have built it meanwhile
            if loaded is not None:
                return loaded
            with tempfile.TemporaryDirectory(prefix=".build_", dir=directory) as scratch:
                made = _compile(Path(scratch), texts(), command, progress)
                if made is None:
                    return None
                os.replace(made, kept / f"{digest(made.read_bytes())}.so")
        prune(directory)
    except OSError:
        return None
    return _open_kept(kept)


@contextlib.contextmanager
def _alone(kept: Path) -> Iterator[None]:
    """Let other processes wait that would build the same at the same time."""
    try:
        import fcntl
    except ImportError:  # no such locks here: both build, and the later one stays
        yield
        return
    with (kept / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _open_kept(kept: Path) -> ctypes.CDLL | None:
    """The first library of a directory that is what its name says and that loads."""
    try:
        names = sorted(name for name in os.listdir(kept) if name.endswith(".so"))
    except OSError:
        return None
    for library in (kept / name for name in names):
        try:
            if digest(library.read_bytes()) == library.stem:
                loaded = ctypes.CDLL(str(library))
                if any(hasattr(loaded, probe) for probe in PROBES):
                    used(kept)
                    return loaded
        except OSError:
            pass
        # Removing is safe even where another process has it mapped: the file lives on until then.
        with contextlib.suppress(OSError):
            library.unlink()
    return None


def _compile(
    scratch: Path,
    texts: Mapping[str, str],
    command: tuple[str, ...],
    progress: Callable[[int, int], None],
) -> Path | None:
    for name, text in texts.items():
        (scratch / name).write_text(text)
    sources = [scratch / name for name in texts if name.endswith(".c")]
    for cc in (command, tuple(part for part in command if part != "-march=native")):
        target = scratch / "core.so"
        if len(sources) == 1:
            if _run(*cc, "-shared", "-o", str(target), str(sources[0]), "-lm"):
                return target
            continue
        objects = [source.with_suffix(".o") for source in sources]
        commands = [
            (*cc, "-c", "-o", str(o), str(s)) for s, o in zip(sources, objects, strict=True)
        ]
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            done = 0
            progress(0, len(sources))
            for good in pool.map(lambda one: _run(*one), commands):
                done += good
                progress(done, len(sources))
        named = [str(o) for o in objects]
        if done == len(sources) and _run(*cc, "-shared", "-o", str(target), *named, "-lm"):
            return target
    return None


def _run(*command: str) -> bool:
    """Whether a command succeeds."""
    return subprocess.run(command, capture_output=True, check=False).returncode == 0
