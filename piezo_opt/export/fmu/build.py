"""A unit's library for this computer, or for others by a compiler from the package index."""

from __future__ import annotations

import platform
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Final, final

from piezo_opt.errors import InputError, ModelError
from piezo_opt.simulation.compiler import find_compiler


@final
@dataclass(frozen=True)
class Platform:
    """A system for which a library is built.

    Attributes:
        names: of its folder, in FMI 2.0 and in FMI 3.0.
        target: what the cross compiler calls it.
        suffix: of a library there.
    """

    names: tuple[str, str]
    target: str
    suffix: str


PLATFORMS: Final[Mapping[str, Platform]] = {
    "linux": Platform(("linux64", "x86_64-linux"), "x86_64-linux-gnu.2.17", ".so"),
    "windows": Platform(("win64", "x86_64-windows"), "x86_64-windows-gnu", ".dll"),
    "mac": Platform(("darwin64", "x86_64-darwin"), "x86_64-macos", ".dylib"),
    "linux-arm": Platform(("linux64", "aarch64-linux"), "aarch64-linux-gnu.2.17", ".so"),
    "mac-arm": Platform(("darwin64", "aarch64-darwin"), "aarch64-macos", ".dylib"),
}
"""Systems by name."""

_FLAGS: Final = ("-std=c99", "-O2", "-shared", "-fvisibility=hidden", "-ffp-contract=off")


def own_platform() -> str:
    """The name of the system that this runs on.

    Raises:
        InputError: it is none of those that FMI has a name for here.
    """
    machine = "-arm" if platform.machine().lower() in ("arm64", "aarch64") else ""
    system = {"linux": "linux", "darwin": "mac", "win32": "windows"}.get(sys.platform, "")
    if f"{system}{machine}" not in PLATFORMS:
        raise InputError(
            f"Units cannot be built for {sys.platform} on {platform.machine()}: name another "
            f"system, platforms=('linux',): there are {', '.join(PLATFORMS)}."
        )
    return f"{system}{machine}"


def compiler_for(name: str) -> list[str]:
    """The command that compiles for a system.

    Raises:
        InputError: there is no such system, or nothing to compile for it with.
    """
    if name not in PLATFORMS:
        raise InputError(f"platform {name!r}: there are {', '.join(PLATFORMS)}")
    own = find_compiler()
    if own is not None and name == own_platform():
        return [own, "-fPIC"]
    if find_spec("ziglang") is None:
        raise InputError(
            f"There is no compiler for {name}: pip install 'piezo_opt[cross]' brings one for every "
            "system."
        )
    return [sys.executable, "-m", "ziglang", "cc", "-target", PLATFORMS[name].target, "-s"]


def library(source: Path, name: str, identifier: str, target: Path) -> None:
    """Compile one source to a library for a system.

    Args:
        source: the unit's C file.
        name: of the system.
        identifier: the library's name without its suffix.
        target: folder to put it into.

    Raises:
        InputError: as :func:`compiler_for`.
        ModelError: the code does not compile.
    """
    target.mkdir(parents=True, exist_ok=True)
    out = target / f"{identifier}{PLATFORMS[name].suffix}"
    maths = [] if name == "windows" else ["-lm"]
    done = subprocess.run(
        [*compiler_for(name), *_FLAGS, str(source), *maths, "-o", str(out)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode:
        first = next((t for t in done.stderr.splitlines() if "error" in t), done.stderr[:200])
        raise ModelError(f"The unit does not compile for {name}: {first}")
    for beside in target.iterdir():
        if beside != out:  # what a linker for Windows leaves
            beside.unlink()
