"""The thesis' finite-element model, and what it says beside what its own data say."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, final

import numpy as np

from piezo_opt.datasets import load
from piezo_opt.finite_elements.body import Body
from piezo_opt.finite_elements.grid import Support, block, mirrored, stack, supported
from piezo_opt.finite_elements.statics import static
from piezo_opt.finite_elements.system import System
from piezo_opt.physics import PZT_5H, Material

WIDTH: Final = 5e-3
"""Along x and y [m]: 10 elements of 0.5 mm."""
HEIGHT: Final = 4e-3
"""[m]: 8 elements of 0.5 mm."""
ELEMENTS: Final = (10, 10, 8)
"""800 bricks, 11 x 11 x 9 = 1089 nodes."""


def thesis_block(support: Support = Support.CLAMPED) -> Body:
    """5 x 5 x 4 mm of PZT-5H, 800 bricks, base clamped and grounded, the drive on top."""
    return block(PZT_5H, WIDTH, WIDTH, HEIGHT, elements=ELEMENTS, support=support)


@final
@dataclass(frozen=True)
class ThesisBlock:
    """Displacements of the top at the thesis' highest voltage [m], by what was assumed.

    Attributes:
        voltage: the highest of Appendix D [V].
        printed: what Appendix D prints for it.
        clamped: ours, base clamped.
        finer: ours on half the element size.
        free: ours, base on rollers; equal to d33 V.
        formula: d33 V.
        widening: ours on rollers, growth along x; the thesis' 2 w2 = d32 V w / l.
        widening_formula: d31 V w / l.
        five_clamped_blocks: ours, five such blocks on one another, on the same mesh.
        tenth_permittivity: clamped, with a tenth of the permittivity at constant strain.
        corner: ours clamped, largest length of a node's displacement in any direction.
    """

    voltage: float
    printed: float
    clamped: float
    finer: float
    free: float
    formula: float
    widening: float
    widening_formula: float
    five_clamped_blocks: float
    tenth_permittivity: float
    corner: float

    @property
    def factor(self) -> float:
        """Printed over d33 V."""
        return self.printed / self.formula

    @property
    def factor_clamped(self) -> float:
        """Printed over ours with the base clamped."""
        return self.printed / self.clamped


def compare_with_thesis() -> ThesisBlock:
    """Our block beside Appendix D, and what could and what could not make the difference.

    Raises:
        InputError: scikit-fem is not installed.
    """
    record = load("thesis/fe")
    voltage, printed = float(record.drive[-1]), float(record.position[-1])
    body = thesis_block()
    answer = static(body, voltage)
    # A quarter between two mirrors: half the width in as many elements is half their size.
    half = 0.5 * WIDTH
    nx, ny, nz = ELEMENTS
    fine = block(PZT_5H, half, half, HEIGHT, elements=(nx, ny, 2 * nz))
    column = stack(PZT_5H, half, half, HEIGHT, layers=5, elements=(nx // 2, ny // 2, nz))
    loose = static(supported(body, Support.ROLLERS), voltage)
    weak = Material.from_stress_form(
        "PZT-5H with a tenth of the permittivity",
        PZT_5H.stiffness, PZT_5H.stress_constants, 0.1 * PZT_5H.clamped_permittivity,
        PZT_5H.density,
    )  # fmt: skip
    dry = replace(body, materials=(weak.reversed(), weak))
    return ThesisBlock(
        voltage=voltage,
        printed=printed,
        clamped=answer.tip,
        finer=static(mirrored(fine, "xy"), voltage).tip,
        free=loose.tip,
        formula=PZT_5H.d33 * voltage,
        widening=loose.widening,
        widening_formula=PZT_5H.d31 * voltage * WIDTH / HEIGHT,
        five_clamped_blocks=static(mirrored(column, "xy"), voltage).tip,
        tenth_permittivity=static(System(dry), voltage).tip,
        corner=float(np.linalg.norm(answer.displacement, axis=1).max()),
    )
