"""Answers as files for a viewer."""

from __future__ import annotations

import os

from piezo_opt.files import replacing
from piezo_opt.finite_elements.body import VTK_ORDER
from piezo_opt.finite_elements.library import library
from piezo_opt.finite_elements.modes import Modes
from piezo_opt.finite_elements.statics import Static


def write_vtk(
    answer: Static | Modes, path: str | os.PathLike[str], *, overwrite: bool = False
) -> None:
    """Displacement [m] and potential [V] on the nodes as VTK; every mode its own pair.

    Args:
        answer: a static answer, or modes.
        path: file ending in .vtk or .vtu.
        overwrite: replace an existing file.

    Raises:
        InputError: meshio is not installed, or the file exists or cannot be written.
    """
    meshio = library("meshio")
    fields = (
        {"displacement": answer.displacement, "potential": answer.potential}
        if isinstance(answer, Static)
        else {
            f"{what}_{number + 1}_{frequency:.0f}_Hz": values[number]
            for number, frequency in enumerate(answer.frequencies)
            for what, values in (
                ("displacement", answer.shapes), ("potential", answer.potentials)
            )
        }
    )  # fmt: skip
    body = answer.body
    mesh = meshio.Mesh(
        body.points,
        [("hexahedron", body.bricks[:, VTK_ORDER])],
        point_data=fields,
        cell_data={"material": [body.material_of]},
    )
    with replacing(path, overwrite=overwrite) as temporary:
        mesh.write(temporary)
