"""``piezo-opt fem``: finite elements of a block or a stack."""

from __future__ import annotations

from enum import Enum
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from piezo_opt.cli import options as o
from piezo_opt.cli import outputs
from piezo_opt.cli.declare import Commands, Option, echo
from piezo_opt.errors import InputError
from piezo_opt.units import quantity, show


class Base(Enum):
    """How the base of a block is held."""

    CLAMPED = "clamped"
    ROLLERS = "rollers"


fem = Commands("fem", "Finite elements of a piezoelectric block or stack.")


@fem.command()
def block(
    material: Annotated[str, Option(metavar="NAME", help="The ceramic.")] = "PZT-5H",
    width: Annotated[str, Option(metavar="'5 mm'", help="Size along x.")] = "5 mm",
    depth: Annotated[str, Option(metavar="'5 mm'", help="Size along y.")] = "5 mm",
    height: Annotated[str, Option(metavar="'4 mm'", help="Height of a layer, along z.")] = "4 mm",
    layers: Annotated[int, Option(min=1, metavar="N", help="Number of layers on one another.")] = 1,
    elements: Annotated[
        str, Option(metavar="NX,NY,NZ", help="Bricks along x, y and in a layer along z.")
    ] = "10,10,8",
    support: Annotated[Base, Option(help="How the base is held.")] = Base.CLAMPED,
    voltage: Annotated[str, Option(metavar="'150 V'", help="Voltage of the drive.")] = "150 V",
    modes: Annotated[int, Option(min=1, metavar="N", help="Modes to find.")] = 10,
    damping: Annotated[
        float, Option(metavar="ZETA", help="Damping ratio of every mode, for --response.")
    ] = 0.01,
    vtk: Annotated[
        Path | None, Option(metavar="OUT.vtk", help="Static answer for a viewer.")
    ] = None,
    record: Annotated[
        Path | None, Option(metavar="OUT.csv", help="Slow ramp to the voltage, a record.")
    ] = None,
    picture: Annotated[Path | None, Option(metavar="OUT.png", help="The deformed body.")] = None,
    shapes: Annotated[Path | None, Option(metavar="OUT.png", help="Mode shapes.")] = None,
    response: Annotated[Path | None, Option(metavar="OUT.png", help="Frequency response.")] = None,
    json: o.Json = None,
    overwrite: o.Overwrite = False,
) -> None:
    """Static answer and modes of a block, by default the thesis' one.

    \b
    Examples:
      piezo-opt fem block --picture block.png --record ramp.csv
      piezo-opt fem block --layers 20 --height "0.1 mm" --elements 8,8,1
    """
    outputs.check(
        {
            "--vtk": vtk, "--record": record, "--picture": picture, "--shapes": shapes,
            "--response": response, "--json": json,
        },
        overwrite=overwrite,
    )  # fmt: skip
    from piezo_opt import finite_elements as fe
    from piezo_opt.physics import material as ceramic
    from piezo_opt.readers import write

    body = fe.stack(
        ceramic(material),
        quantity(width, "m"),
        quantity(depth, "m"),
        quantity(height, "m"),
        layers=layers,
        elements=_elements(elements),
        support=fe.Support(support.value),
    )
    system = fe.System(body)
    volts = quantity(voltage, "V")
    answer, found = fe.static(system, volts), fe.modes(system, modes)
    small = fe.reduced(system, modes, damping=damping)
    echo(f"{body.elements} elements, {body.nodes} nodes, base {support.value}")
    echo(
        f"{show(volts, 'V')}: top {show(answer.tip, 'm')}, width {show(answer.widening, 'm')}, "
        f"charge {show(answer.charge, 'C')}, capacitance {show(answer.capacitance, 'F')}"
    )
    shares = {float(f): float(g) / small.gain for f, g in zip(
        small.frequencies, small.gains, strict=True
    )}  # fmt: skip
    for number, frequency in enumerate(found.frequencies.tolist(), start=1):
        share = f"  {100.0 * shares[frequency]:.1f} % of the stroke" if frequency in shares else ""
        echo(f"mode {number:>2}  {show(frequency, 'Hz'):>10}{share}")
    if vtk is not None:
        fe.write_vtk(answer, vtk, overwrite=overwrite)
    if record is not None:
        write(fe.ramp(system, volts), record, overwrite=overwrite)
    _draw(picture, shapes, response, (answer, found, small), overwrite=overwrite)
    if json is not None:
        outputs.write_json(
            json,
            {
                "schema": "piezo_opt/fem-block/1",
                "elements": body.elements,
                "voltage": volts,
                "top": answer.tip,
                "widening": answer.widening,
                "capacitance": answer.capacitance,
                "frequencies": found.frequencies.tolist(),
                "moved_by_the_voltage": {
                    "frequencies": small.frequencies.tolist(),
                    "gains": small.gains.tolist(),
                },
            },
            overwrite=overwrite,
        )


@fem.command()
def thesis(json: o.Json = None, overwrite: o.Overwrite = False) -> None:
    """The thesis' block beside what the thesis prints, and what could make the difference."""
    outputs.check({"--json": json}, overwrite=overwrite)
    from dataclasses import asdict

    from piezo_opt.finite_elements import compare_with_thesis

    told = compare_with_thesis()
    rows = (
        ("thesis, Appendix D", told.printed),
        ("ours, base clamped", told.clamped),
        ("  elements of half the size", told.finer),
        ("  a tenth of the permittivity", told.tenth_permittivity),
        ("  largest displacement of a node", told.corner),
        ("ours, base on rollers", told.free),
        ("d33 V", told.formula),
        ("ours, widening on rollers", told.widening),
        ("d31 V w / l (thesis: 2 w2)", told.widening_formula),
        ("ours, five blocks on one another", told.five_clamped_blocks),
    )
    for label, value in rows:
        echo(f"{label:<34} {show(value, 'm'):>9}")
    echo(
        f"The thesis prints {told.factor:.1f} times d33 V and {told.factor_clamped:.1f} times what "
        f"its block gives here. Mesh, support and permittivity do not explain that; five blocks in "
        f"series would, to {100.0 * abs(told.printed / told.five_clamped_blocks - 1.0):.1f} %."
    )
    if json is not None:
        outputs.write_json(
            json, {"schema": "piezo_opt/fem-thesis/1", **asdict(told)}, overwrite=overwrite
        )


def _elements(text: str) -> tuple[int, int, int]:
    parts = text.split(",")
    if len(parts) != 3 or not all(part.strip().isdigit() for part in parts):
        raise InputError(f"--elements {text}: give three whole numbers, 10,10,8")
    nx, ny, nz = (int(part) for part in parts)
    return nx, ny, nz


def _draw(
    picture: Path | None,
    shapes: Path | None,
    response: Path | None,
    answers: tuple[Any, Any, Any],
    *,
    overwrite: bool,
) -> None:
    if picture is None and shapes is None and response is None:
        return
    from piezo_opt.report import finite_elements as draw

    drawn = (
        (picture, draw.deformed, answers[0]),
        (shapes, draw.mode_shapes, answers[1]),
        (response, draw.frequency_response, answers[2]),
    )
    for path, make, answer in drawn:
        if path is not None:
            outputs.write_picture(path, partial(make, answer), overwrite=overwrite)
