"""Exported code on a board: built with its tools, run in its simulator, and what that takes."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.errors import InputError, ModelError
from piezo_opt.export.boards import atmega328p, cortex_m4f
from piezo_opt.export.boards.board import LEAST, RUN, WRITE, Board

BOARDS: Final[Mapping[str, Board]] = {
    board.name: board for board in (atmega328p.BOARD, cortex_m4f.BOARD)
}
"""Boards by name."""
_SECONDS: Final = 120.0
"""Longest time for a simulation."""


@final
@dataclass(frozen=True, eq=False)
class Footprint:
    """What exported code takes on a board.

    Attributes:
        board: its name.
        flash: bytes of the smallest program with one actuator, the library's functions included.
        ram: bytes of its variables.
        stack: bytes of the stack that a call has used at most, the caller's own included.
        counts: ``"cycles"`` or ``"instructions"``.
        mean, most: of them in a step.
        reading: (N,) what the board read.
    """

    board: str
    flash: int
    ram: int
    stack: int
    counts: str
    mean: float
    most: int
    reading: NDArray[np.float64]

    def __str__(self) -> str:
        return (
            f"{BOARDS[self.board].told}: {self.flash} bytes of flash, {self.ram} of RAM and "
            f"{self.stack} of stack, {self.mean:.0f} {self.counts} a step ({self.most} at most)"
        )


def available(board: str) -> Board:
    """The board of that name, with its tools.

    Raises:
        InputError: there is no such board, or its tools are not installed.
    """
    if board not in BOARDS:
        raise InputError(f"board = {board!r}: there are {', '.join(BOARDS)}")
    on = BOARDS[board]
    for tool in (on.compiler, on.size, on.runner[0]):
        if shutil.which(tool) is None:
            raise InputError(
                f"{board}: {tool} is not installed: apt-get install {' '.join(on.packages)}"
            )
    return on


def measure(
    folder: Path, name: str, board: str, inputs: Sequence[NDArray[np.float64]]
) -> Footprint:
    """Build a folder that ``export_c`` wrote in float for a board, and run it there.

    Args:
        folder: with the code.
        name: its prefix.
        board: one of ``BOARDS``.
        inputs: (N,) instants [s], drive [V], and further channels, every sample one step.

    Raises:
        InputError: there is no such board, or its tools are not installed.
        ModelError: the code does not build or does not end there.
    """
    on = available(board)
    with tempfile.TemporaryDirectory(prefix="piezo_opt_board_") as scratch:
        here = Path(scratch)
        for file, said in on.support:
            (here / file).write_text(said)
        start = f'#include "{name}.h"\n' + on.startup.format(n=name)
        columns = [f"at(0, {k})" for k in range(1, len(inputs))]
        least = LEAST.format(n=name, volatile=", ".join(["in"] * len(columns)))
        small = _built(on, folder, name, here, "least", start + least)
        flash, ram = _sizes(on, here, small)
        program = start + _around(on, name, inputs) + RUN.format(
            n=name, first=", ".join(columns), rows=len(inputs[0]),
            inputs="".join(f", v{k} = at(i, {k})" for k in range(1, len(inputs))),
            names="".join(f", v{k}" for k in range(1, len(inputs))),
        )  # fmt: skip
        told = _run(on, here, _built(on, folder, name, here, "run", program))
    if len(told) != 2 * len(inputs[0]):
        raise ModelError(
            f"{board}: the simulation said {len(told)} numbers and not {2 * len(inputs[0])}: the "
            "program did not end there."
        )
    bits, took, stack = np.array([told[0], *told[1:-1:2]]), np.array(told[2:-1:2]), told[-1]
    reading = bits.astype(np.uint32).view(np.float32).astype(float)
    return Footprint(
        board, flash, ram, int(stack), on.counts, float(took.mean()), int(took.max()), reading
    )


def _around(on: Board, name: str, inputs: Sequence[NDArray[np.float64]]) -> str:
    """The board's text with the table of inputs: interval and what the drive and channels are."""
    first = np.asarray(inputs[0])
    columns = [np.concatenate([[0.0], np.diff(first)]), *inputs[1:]]
    rows = (
        "{" + ", ".join(f"{float(v):.9e}f" for v in row) + "}" for row in zip(*columns, strict=True)
    )
    table = on.table.format(columns=len(columns), values=",\n    ".join(rows))
    return on.around.format(n=name, table=table, write=WRITE.format(n=name))


def _built(on: Board, folder: Path, name: str, here: Path, what: str, program: str) -> Path:
    """A program with the code, built for the board."""
    source, target = here / f"{what}.c", here / f"{what}.elf"
    source.write_text(program)
    code = str((folder / f"{name}.c").resolve())
    done = subprocess.run(
        [on.compiler, *on.flags, *on.linked, f"-I{folder.resolve()}", source.name, code, "-lm",
         "-o", target.name],
        cwd=here, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode:
        first = next((t for t in done.stderr.splitlines() if "error" in t), done.stderr[:200])
        raise ModelError(f"{on.name}: the code does not build with {on.compiler}: {first}")
    return target


def _sizes(on: Board, here: Path, program: Path) -> tuple[int, int]:
    """Flash and RAM: code, constants and start values; start values and what begins at zero."""
    told = subprocess.run(
        [on.size, program.name], cwd=here, capture_output=True, text=True, check=True
    )
    text, data, bss = map(int, told.stdout.splitlines()[1].split()[:3])
    return text + data, data + bss


def _run(on: Board, here: Path, program: Path) -> list[int]:
    """The numbers that a program says."""
    try:
        done = subprocess.run(
            [*on.runner, program.name], cwd=here, capture_output=True, text=True, check=False,
            timeout=_SECONDS, stdin=subprocess.DEVNULL,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise ModelError(f"{on.name}: the simulation did not end in {_SECONDS:.0f} s") from None
    # One simulator puts colours around each line and a full stop in the place of its end.
    return [
        int(one, 16) for one in re.findall(r"\b([0-9a-f]{8})\b", _plain(done.stdout + done.stderr))
    ]


def _plain(told: str) -> str:
    return re.sub(r"\x1b\[[0-9;]*m", "", told)
