"""What the tests of exported code share: compilers, flags, and a model for every effect."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any, Final

import pytest

from piezo_opt.effects import Model
from tests.laws.test_laws import FORMS as VARIANTS
from tests.laws.test_laws import KINDS, MECHANICS, label

STRICT: Final = [
    "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Wshadow", "-Werror",
]  # fmt: skip
DIAGNOSTICS: Final = (["gcc", "-std=c99"], ["g++", "-std=c++11", "-xc++"], ["clang", "-std=c99"])
__all__ = [
    "DIAGNOSTICS", "FORMS", "KINDS", "STRICT", "compiler", "form_id", "modelled",
    "undefined_of_float",
]  # fmt: skip
FORMS: Final[list[Any]] = [*KINDS, *VARIANTS]
form_id = label


def compiler(name: str) -> str:
    """The path of a compiler; the test is skipped without it."""
    found = shutil.which(name)
    if found is None:
        pytest.skip(f"{name} is not installed")
    return found


def undefined_of_float(source: Path) -> set[str]:
    """What the object of a source asks others for, built for a processor whose numbers are float.

    A Cortex-M4F has no double: every operation on one is a call, which stands here.
    """
    cc = compiler("arm-none-eabi-gcc")
    target = source.with_suffix(".o")
    subprocess.run(
        [cc, "-std=c99", *STRICT, "-O2", "-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard",
         "-mfpu=fpv4-sp-d16", "-c", str(source), "-o", str(target)],
        check=True,
    )  # fmt: skip
    told = subprocess.run(
        ["arm-none-eabi-nm", "--undefined-only", str(target)],
        check=True, capture_output=True, text=True,
    )  # fmt: skip
    return {line.split()[-1] for line in told.stdout.splitlines()}


def modelled(form: Any) -> tuple[Model, dict[str, float]]:
    """A model in which a form of an effect acts, and values that are not at its null."""
    effect = form()
    base = MECHANICS
    states = effect.declared_states.values()
    if any(s.loop for s in states) or effect.structural:
        base = base.without("bouc_wen") if effect.name != "piezo_gain" else base
    if any(s.position for s in states):
        base = base.without("second_order")
    if effect.name in base:
        base = base.without(effect.name)
    if effect.name == "second_order":
        base = MECHANICS.without("second_order")
    values = {"second_order.omega": 900.0} if "second_order" in base else {}
    for name, parameter in effect.parameters.items():
        if parameter.null is not None:
            low, high = parameter.typical or parameter.bounds
            values[f"{effect.name}.{name}"] = high if high != parameter.null else low
    return base + effect, values
