"""``export_controller``: a designed controller leaves as C that has been shown to act alike."""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.control import (
    LQG,
    MPC,
    PID,
    InverseCompensation,
    Limits,
    Shaper,
    Tuned,
    TunedMPC,
    TunedShaper,
)
from piezo_opt.control.plant import without_delay
from piezo_opt.effects.catalogue import model_from_dict
from piezo_opt.errors import InputError, ModelError
from piezo_opt.export.c import naming
from piezo_opt.export.c.beside import BUILD
from piezo_opt.export.c.printer import DOUBLE, FLOAT, Precision
from piezo_opt.export.folder import appearing, check_new
from piezo_opt.export.given import given
from piezo_opt.export.laws.inverse import inverse_compensation
from piezo_opt.export.laws.lqg import lqg
from piezo_opt.export.laws.mpc import mpc
from piezo_opt.export.laws.pid import pid
from piezo_opt.export.laws.same_memory import apart
from piezo_opt.export.laws.shaper import shaper
from piezo_opt.export.laws.written import FAR, Written
from piezo_opt.files import checked
from piezo_opt.identification import Fit
from piezo_opt.simulation.compiler import find_compiler
from piezo_opt.units import quantity

FloatArray = NDArray[np.float64]

Law: TypeAlias = PID | LQG | MPC | InverseCompensation | Shaper
Design: TypeAlias = Tuned[Any] | TunedMPC | TunedShaper | Fit | Law | str | os.PathLike[str]
"""A design, its JSON, a controller itself, or a fit, for its inverse."""

ADMITTED: Final = {"double": 1e-8, "float": 1e-4}
"""Largest difference as a share of what the outputs span: rounding of a thousand samples of an
integral, and two ways to the same root."""
SAMPLES: Final = 1200
"""Of the check."""

_MAIN: Final = """\
/* Reads rows of {columns} from standard input, separated by commas, and writes {output}
   and status: a line that does not begin with a number is passed over. */
#include "{n}.h"

#include <stdio.h>
#include <stdlib.h>

#define COLUMNS {count}

int main(void)
{{
    char line[1024];
    {n} one;
    {n}_init(&one);
    puts("{output},status");
    while (fgets(line, sizeof line, stdin)) {{
        double row[COLUMNS];
        char *at = line;
        int found = 0;
        while (found < COLUMNS) {{
            char *end = at;
            row[found] = strtod(at, &end);
            if (end == at) break;
            ++found;
            at = *end == ',' ? end + 1 : end;
        }}
        if (found < COLUMNS) continue;
        printf("%.{digits}g,", (double){call});
        printf("%d\\n", one.status);
    }}
    return 0;
}}
"""

_README: Final = """\
# {n}

{title}

`{n}.h` and `{n}.c` are C99 and need `math.h` and `float.h` and nothing else: no allocation, no loop
without an end, numbers of the type `{real}`. `main.c` is a program to try them with.

```
cc -std=c99 -O2 {n}.c main.c -lm -o {n}_replay
./{n}_replay < rows.csv
```

Rows have {columns}. Whatever is given, the answer is a number{within}; the member `status` says
whether limits were met (1) and whether the sample was passed over (2){more}. {checked}
"""


@final
@dataclass(frozen=True, eq=False)
class ExportedController:
    """What was written.

    Attributes:
        folder: where it is.
        files: names of the files in it.
        title: what it is.
        samples, largest: of the check against Python, and the largest difference as a share of
            what the outputs span; none without a compiler.
    """

    folder: Path
    files: tuple[str, ...]
    title: str
    samples: int
    largest: float

    def __str__(self) -> str:
        told = (
            f"replayed {self.samples} samples with faults: at most {self.largest:.1e} of the "
            "outputs' range from Python"
            if self.samples
            else "not compiled here: there is no C compiler"
        )
        return f"{self.folder}: {', '.join(self.files)}; {self.title} {told[0].upper()}{told[1:]}."


def export_controller(
    design: Design,
    folder: str | os.PathLike[str],
    *,
    period: float | str | None = None,
    limits: Limits | None = None,
    precision: str = "double",
    name: str = "controller",
) -> ExportedController:
    """Write a PID, an LQG, an inverse compensation or a shaper as C99 that needs nothing but libm.

    The code takes the same steps at every call, allocates nothing, and answers with a number within
    the limits whatever it is given. It is compiled and replayed against Python, faults included,
    before the folder appears.

    Args:
        design: what ``tune_pid``, ``tune_lqr`` or ``tune_shaper`` gave, the JSON of it, a
            controller, or a fit or its JSON, for the compensation of its loop.
        folder: is made; must not exist.
        period: of the sampling [s]; that of the design unless given. A shaper needs it.
        limits: of the drive; those of the design unless given.
        precision: ``"double"``, or ``"float"`` and nothing wider.
        name: prefix of every symbol and name of the files.

    Raises:
        InputError: the folder exists, the file holds no such design, or the period is missing or
            not that of the design.
        ModelError: the code does not do what Python does; nothing is written then.
    """
    check_new(folder)
    naming.prefix(name)
    if precision not in ("double", "float"):
        raise InputError(f"precision = {precision!r}: take 'double' or 'float'")
    law, own_period, own_limits = _given(design)
    step = own_period if period is None else quantity(period, "s")
    if step is None or not 0.0 < step < float("inf"):
        raise InputError("How often the code will be called is not known: give period='1 ms'.")
    held = limits or own_limits or Limits()
    numbers = FLOAT if precision == "float" else DOUBLE
    text = _written(law, name, numbers, step, held)
    files = {
        f"{name}.h": text.header, f"{name}.c": text.source,
        "main.c": _MAIN.format(
            n=name, columns=" and ".join(text.inputs), output=text.output,
            count=len(text.inputs), call=text.call, digits=9 if numbers.is_float else 17,
        ),
        "CMakeLists.txt": BUILD.format(n=name),
    }  # fmt: skip
    compiler = find_compiler()
    with appearing(folder) as scratch:
        for file, said in files.items():
            (scratch / file).write_text(said, encoding="utf-8")
        largest, samples = float("nan"), 0
        checked = "The code has not been compiled here, because there was no C compiler."
        if compiler is not None:
            if isinstance(law, MPC):
                samples, largest = apart(scratch, name, compiler, law, held, precision)
                _admit(largest, precision)
            else:
                rows, wanted = _trial(law, step, held)
                samples = len(rows)
                largest = _replayed(scratch, name, compiler, rows, wanted, precision)
            checked = (
                f"Replayed on {samples} samples, faults among them: at most {largest:.1e} of the "
                "outputs' range from Python."
            )
        said = _README.format(
            n=name, title=f"{text.title[0].upper()}{text.title[1:]}", real=numbers.name,
            columns=" and ".join(text.inputs), checked=checked,
            more=", and the header tells the rest" if isinstance(law, MPC) else "",
            within="" if isinstance(law, Shaper) else " within the limits",
        )  # fmt: skip
        (scratch / "README.md").write_text(said, encoding="utf-8")
    return ExportedController(
        Path(folder), (*files, "README.md"), text.title, samples, largest
    )  # fmt: skip


def _written(
    law: Law, name: str, numbers: Precision, period: float, limits: Limits
) -> Written:  # fmt: skip
    if isinstance(law, PID):
        return pid(law, name, numbers, period, limits)
    if isinstance(law, Shaper):
        return shaper(law, name, numbers, period)
    if isinstance(law, InverseCompensation):
        header, source = inverse_compensation(law, name, numbers)
        ends = ", ".join(
            numbers.number(min(max(end, -FAR), FAR)) for end in (limits.low, limits.high)
        )
        return Written(
            "the drive that a hysteretic actuator needs, without an inverse model.", header,
            source, ("reference [m]",), f"{name}_act(&one, ({numbers.name})row[0], {ends})",
            "drive [V]",
        )  # fmt: skip
    if abs(period - law.period) > 1e-9 * law.period:
        raise InputError(
            f"period = {period:g} s: the design is for {law.period:g} s: design it anew for "
            "another one"
        )
    if isinstance(law, MPC):
        if limits != law.limits:
            raise InputError(
                f"limits = {limits.told()}: the design is for {law.limits.told()}: design it anew "
                "for others"
            )
        return mpc(law, name, numbers, limits)
    return lqg(law, name, numbers, limits)


def _given(design: Design) -> tuple[Law, float | None, Limits | None]:
    """The controller of a design, its period and limits."""
    if isinstance(design, Tuned | TunedMPC):
        return design.controller, design.period, design.limits
    if isinstance(design, TunedShaper):
        return design.shaper, None, None
    if isinstance(design, Fit):
        return InverseCompensation.of(design), float(design.records[0].step), None
    if isinstance(design, PID | InverseCompensation | Shaper):
        return design, None, None
    if isinstance(design, LQG):
        return design, design.period, None
    if isinstance(design, MPC):
        return design, design.period, design.limits
    return _read(checked(design))


def _read(file: Path) -> tuple[Law, float | None, Limits | None]:
    """The controller in the JSON of ``piezo-opt tune``.

    Raises:
        InputError: it holds none.
    """
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
        if "controller" not in data and "parameters" in data:
            what = given(file)
            every = None if what.sampling is None else what.sampling[0]
            return InverseCompensation.of_values(what.model, what.values), every, None
        if "feedforward" in str(data.get("schema")):
            raise InputError(
                f"{file}: is a drive and no controller: write it with --out of piezo-opt tune "
                "feedforward, and play it"
            )
        own = data["controller"]
        kind = own["kind"]
    except (UnicodeDecodeError, json.JSONDecodeError, KeyError, TypeError) as error:
        raise InputError(
            f"{file}: is not the JSON of a design: write one with piezo-opt tune pid --json"
        ) from error
    try:
        if kind == "shaper":
            times, sizes = (np.array(own[k], dtype=float) for k in ("times", "amplitudes"))
            return Shaper(str(own["name"]), sizes, times), None, None
        period = float(data["period"])
        limits = _limits(data["limits"])
        if kind == "pid":
            gains = {k: float(own[k]) for k in ("kp", "ki", "kd", "tau")}
            return PID(**gains, largest=_far(own["largest"])), period, limits
        if kind == "mpc":
            return _predictive(data, own, period, limits), period, limits
        if kind == "lqr":
            a, b, c, gain, filtered = (
                np.array(own[k], dtype=float) for k in ("a", "b", "c", "gain", "filter")
            )
            ahead, rest = float(own["precompensator"]), float(own["rest"])
            law = LQG(a, b, c, gain, ahead, filtered, rest, period, largest=_far(own["largest"]))
            return law, period, limits
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{file}: the design in it is not whole: {error}") from error
    raise InputError(f"{file}: holds a controller of the kind {kind!r}, which is not known here")


def _predictive(
    data: Mapping[str, Any], own: Mapping[str, Any], period: float, limits: Limits
) -> MPC:
    """A predictive controller, without a reference that is known before."""
    model = model_from_dict(data["plant"]["model"])
    values = {k: float(v["value"]) for k, v in data["plant"]["parameters"].items()}
    # The delay of the design holds that of the model.
    model, _ = without_delay(model, values, period)
    stroke = own["stroke"]
    return MPC(
        model, {k: v for k, v in values.items() if k in model.parameters}, period=period,
        span=float(own["span"]), horizon=int(own["horizon"]), limits=limits,
        stroke=None if stroke is None else (float(stroke[0]), float(stroke[1])),
        weight=float(own["weight"]), noise=float(own["noise"]),
        drive_noise=float(own["drive_noise"]), drift=float(own["drift"]),
        gate=_far(own["gate"]), delay=int(own["delay"]),
        iterations=int(own["iterations"]), rounds=int(own["rounds"]),
    )  # fmt: skip


def _far(value: float | None) -> float:
    """An infinite number is null in a JSON."""
    return float("inf") if value is None else float(value)


def _limits(data: Mapping[str, Any]) -> Limits:
    low = -float("inf") if data["low"] is None else float(data["low"])
    return Limits(low, _far(data["high"]), _far(data["slew"]))


def _trial(
    law: PID | LQG | InverseCompensation | Shaper, period: float, limits: Limits
) -> tuple[list[tuple[float, ...]], FloatArray]:
    """Rows of inputs with faults among them, and what Python answers."""
    generator = np.random.default_rng(0)
    time = np.arange(SAMPLES)
    triangle = np.asarray(1.0 - np.abs(2.0 * ((time / 400.0) % 1.0) - 1.0), dtype=float)
    if isinstance(law, Shaper):
        command = np.where(time % 300 == 0, np.nan, triangle + 0.5 * (time % 170 > 90))
        filled = command.copy()
        for k in range(SAMPLES):
            filled[k] = (filled[k - 1] if k else 0.0) if np.isnan(command[k]) else command[k]
        wanted = law.shaped(np.asarray(period * time, dtype=float), filled)
        return [(float(c),) for c in command], wanted
    if isinstance(law, InverseCompensation):
        return _inverse_trial(law, period, limits, triangle)
    # What moves the controller through its range, whatever its gains: a first-order plant with
    # the gain that its precompensator has, or its integral asks for.
    gain = 1.0 / law.precompensator if isinstance(law, LQG) else _gain(law, period)
    rest = law.rest if isinstance(law, LQG) else 0.0
    low, high = max(limits.low, -100.0), min(limits.high, 100.0)
    reference = rest + gain * (low + (high - low) * (0.1 + 0.9 * triangle))
    reference[500:520] = rest + 3.0 * gain * high
    reference[[610, 611]] = np.nan
    state: Any = law.begin()
    drive = place = 0.0
    rows: list[tuple[float, ...]] = []
    wanted = np.empty(SAMPLES)
    for k in range(SAMPLES):
        reading = rest + place + 1e-3 * gain * float(generator.normal())
        if k % 97 == 11:
            reading = (float("nan"), float("inf"), -float("inf"))[k // 97 % 3]
        if 700 <= k < 740:
            reading = rest
        row = float(reference[k]), reading
        least, most = limits.around(drive, period)
        asked, state = law.act(state, *row, period, least, most)
        drive = min(max(asked, least), most)
        place += 0.3 * (gain * drive - place)
        rows.append(row)
        wanted[k] = drive
    return rows, wanted


def _inverse_trial(
    law: InverseCompensation, period: float, limits: Limits, triangle: FloatArray
) -> tuple[list[tuple[float, ...]], FloatArray]:
    low, high = max(limits.low, -100.0), min(limits.high, 100.0)
    reference = law.gain * (low + (high - low) * (0.1 + 0.8 * triangle))
    reference[500:510] = 3.0 * law.gain * high
    reference[[0, 610, 611]] = np.nan, np.inf, np.nan
    state, wanted = law.begin(), np.empty(SAMPLES)
    for k, goal in enumerate(reference.tolist()):
        wanted[k], state = law.act(state, goal, 0.0, period, limits.low, limits.high)
    return [(float(r),) for r in reference], wanted


def _gain(law: PID, period: float) -> float:
    """Of a plant that suits a PID [m/V]."""
    strength = law.kp + law.ki * period + law.kd / (law.tau + period)
    if strength <= 0.0:
        raise InputError("The PID has no gain: there is nothing to export.")
    return 0.5 / strength


def _replayed(
    folder: Path, name: str, compiler: str, rows: list[tuple[float, ...]], wanted: FloatArray,
    precision: str,
) -> float:  # fmt: skip
    """The largest difference as a share of the range.

    Raises:
        ModelError: the code does not compile, or does something else.
    """
    with tempfile.TemporaryDirectory(prefix="piezo_opt_replay_") as scratch:
        binary = Path(scratch) / "replay"
        built = subprocess.run(
            [compiler, "-std=c99", "-O2", *(str(folder / f) for f in (f"{name}.c", "main.c")),
             "-lm", "-o", str(binary)],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        if built.returncode:
            first = (built.stderr.strip() or "no message").splitlines()[0]
            raise ModelError(f"The exported code does not compile with {compiler}: {first}")
        text = "".join(f"{','.join(map(repr, row))}\n" for row in rows)
        done = subprocess.run(
            [str(binary)], input=text, capture_output=True, text=True, check=True
        )  # fmt: skip
    got = np.array([line.split(",")[0] for line in done.stdout.splitlines()[1:]], dtype=float)
    span = float(np.ptp(wanted)) or 1.0
    largest = float(np.abs(got - wanted).max()) / span
    _admit(largest if got.size == wanted.size else float("nan"), precision)
    return largest


def _admit(largest: float, precision: str) -> None:
    if not largest <= ADMITTED[precision]:
        raise ModelError(
            f"The exported code ({precision}) differs from Python by {largest:.1e} of the outputs' "
            f"range, and {ADMITTED[precision]:g} is admitted: export it in double; nothing was "
            "written."
        )
