"""The float code on two boards: the same readings, and no more room and time than is told."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from piezo_opt.effects import (
    AmplifierLag,
    BoucWen,
    Creep,
    Model,
    PiezoGain,
    Saturation,
    SecondOrder,
)
from piezo_opt.errors import InputError
from piezo_opt.export import export_c
from piezo_opt.export.boards import BOARDS, measure
from piezo_opt.export.boards.cortex_m4f import BOARD as CORTEX
from tests.export.tools import compiler

PAGE = Path(__file__).resolve().parents[2] / "docs" / "export.md"
CREEP = PiezoGain() + BoucWen() + Creep()
MODELS: dict[str, Model] = {"creep": CREEP, "four": CREEP + SecondOrder()}
VALUES = {"creep.c": 0.03, "second_order.omega": 800.0}


def board(name: str) -> str:
    """A board whose tools are here; the test is skipped without them."""
    for tool in (BOARDS[name].compiler, BOARDS[name].runner[0]):
        compiler(tool)
    return name


def told(name: str, model: str) -> list[int]:
    """The row of the page for a board and a model: flash, RAM, stack, counts a step."""
    row = next(
        line for line in PAGE.read_text().splitlines()
        if line.startswith(f"| {BOARDS[name].told.split(',')[0]} | {model} |")
    )  # fmt: skip
    return [int(cell.replace(",", "")) for cell in re.findall(r"\| +([\d,]+) +(?=\|)", row)]


@pytest.mark.parametrize("name", BOARDS)
@pytest.mark.parametrize("model", MODELS)
def test_what_it_takes(name: str, model: str, tmp_path: Path) -> None:
    values = {k: v for k, v in VALUES.items() if k in MODELS[model].parameters}
    found = export_c(
        MODELS[model], tmp_path / "out", values=values, step="1 ms", precision="float", substeps=2,
        boards=(board(name),),
    )  # fmt: skip
    (took,) = found.footprints
    assert found.replay is not None
    apart = np.abs(took.reading - found.replay.reading[: took.reading.size])
    assert apart.max() < 1e-6 * np.ptp(found.replay.reading)
    assert took.mean <= took.most
    stated = told(name, model)
    assert [took.flash, took.ram, took.stack, took.mean] == pytest.approx(stated, rel=0.05)
    if name == "atmega328p":
        assert took.flash <= 8 * 1024
        if model == "creep":
            assert took.ram + took.stack <= 256
    else:
        assert took.flash <= 6 * 1024
        assert took.mean <= 1500
    assert f"{took.flash} bytes of flash" in (tmp_path / "out" / "README.md").read_text()


@pytest.mark.parametrize("name", BOARDS)
def test_functions_that_a_small_library_lacks(name: str, tmp_path: Path) -> None:
    """Saturation calls log1p, which avr-libc has not; the knee is crossed."""
    model = Saturation() + AmplifierLag() + PiezoGain()
    values = {"saturation.s": 1.0, "saturation.v_s": 60.0, "amplifier_lag.share": 0.5}
    found = export_c(
        model, tmp_path / "out", values=values, step="1 ms", precision="float", substeps=4,
        boards=(board(name),),
    )  # fmt: skip
    assert found.replay is not None
    reading = found.footprints[0].reading
    assert np.ptp(reading) < 0.65 * 100.0 * 1e-7
    apart = np.abs(reading - found.replay.reading[: reading.size])
    assert apart.max() < 1e-6 * found.replay.stroke


def test_instructions_are_counted(tmp_path: Path) -> None:
    """A loop of known length stands in the place of the code."""
    board("cortex-m4f")
    (tmp_path / "actuator.h").write_text(
        "typedef struct { float x; } actuator;\nvoid actuator_init(actuator *a, float u);\n"
        "float actuator_output(const actuator *a);\n"
        "float actuator_step(actuator *a, float t, float u);\n"
    )
    (tmp_path / "actuator.c").write_text(
        '#include "actuator.h"\n'
        "void actuator_init(actuator *a, float u) { a->x = u; }\n"
        "float actuator_output(const actuator *a) { return a->x; }\n"
        "float actuator_step(actuator *a, float t, float u)\n"
        "{ int n = 50000; a->x = u + t;\n"
        '  __asm volatile("1: subs %0, #1\\n bne 1b" : "+r"(n)); return a->x; }\n'
    )
    found = measure(tmp_path, "actuator", CORTEX.name, [np.arange(5.0), np.arange(5.0)])
    assert found.mean == pytest.approx(100_000, rel=2e-3)
    np.testing.assert_array_equal(found.reading, [0.0, 2.0, 3.0, 4.0, 5.0])


def test_what_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="count in float"):
        export_c(CREEP, tmp_path / "out", step="1 ms", boards=("cortex-m4f",))
    with pytest.raises(InputError, match="there are atmega328p, cortex-m4f"):
        export_c(CREEP, tmp_path / "out", step="1 ms", precision="float", boards=("z80",))
    monkeypatch.setenv("PATH", "")
    with pytest.raises(InputError, match="apt-get install gcc-avr avr-libc simavr"):
        export_c(CREEP, tmp_path / "out", step="1 ms", precision="float", boards=("atmega328p",))
    assert list(tmp_path.iterdir()) == []
