"""The thesis' finite elements and formulas beside ours."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np

from piezo_opt.datasets import load
from piezo_opt.physics import PZT_5H
from piezo_opt.studies.row import Row

MISSING = "not computed: scikit-fem is not installed (pip install piezo_opt[fem])"


def solid_rows() -> tuple[Row, ...]:
    """Appendix D, the mesh, and the formula for the widening."""
    table = load("thesis/fe")
    gain = float(np.polyfit(table.drive, table.position, 1)[0])
    first = Row(
        "Gain of the finite-element table",
        "0.43373 µm at 150 V",
        f"{1e9 * gain:.2f} nm/V, {gain / PZT_5H.d33:.1f} times d33 of PZT-5H",
        "A straight line. Shipped as it is, not tuned to.",
        "Appendix D, load",
    )
    if find_spec("skfem") is None:
        names = ("Displacement of the top at 150 V", "Mesh", "Widening 2 w2 = d31 V w/l")
        return first, *(Row(one, "", MISSING, "", "finite_elements") for one in names)
    from piezo_opt.finite_elements import compare_with_thesis, thesis_block

    seen, body = compare_with_thesis(), thesis_block()
    return (
        first,
        Row(
            "Displacement of the top at 150 V",
            f"{1e6 * seen.printed:.5f} µm",
            f"{1e6 * seen.clamped:.5f} µm, base clamped",
            f"The thesis prints {seen.factor_clamped:.1f} times ours and {seen.factor:.1f} times "
            f"d33 V; on half the element size ours moves by "
            f"{100 * abs(seen.finer / seen.clamped - 1):.1f} %.",
            "Appendix D, compare_with_thesis",
        ),
        Row(
            "Mesh",
            "800 elements, 1089 nodes",
            f"{body.bricks.shape[0]} elements, {body.points.shape[0]} nodes",
            "10 x 10 x 8 bricks of 0.5 mm.",
            "section 3.2.3, thesis_block",
        ),
        Row(
            "Widening 2 w2 = d31 V w/l",
            "5.1375e-8 m",
            f"{abs(seen.widening_formula):.4e} m; finite elements {abs(seen.widening):.4e} m",
            "The base on rollers, so that the sides are free to move.",
            "Eq. 2.10, compare_with_thesis",
        ),
    )
