"""Stiffness and mass of a body.

With displacement u and potential phi, S = B_u u and E = -B_phi phi, virtual work gives

    M u'' + K_uu u + K_up phi = F,      K_uu = int B_u' c^E B_u
            K_up' u - K_pp phi = -Q,    K_up = int B_u' e' B_phi,   K_pp = int B_phi' eps^S B_phi

by 2 x 2 x 2 Gauss points in trilinear bricks.

Source: Allik & Hughes (1970), Int. J. Numer. Meth. Eng. 2(2), 151-157.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from piezo_opt.finite_elements.body import Body, FloatArray
from piezo_opt.finite_elements.library import library

_GAUSS = 3
"""Degree of the quadrature: 2 points an axis, exact for what constant strains need on any brick."""


@final
@dataclass(frozen=True, eq=False)
class Matrices:
    """Assembled matrices; unknown 4 n + k is displacement k of node n, or its potential (k = 3).

    Attributes:
        stiffness: (4 N, 4 N) [[K_uu, a K_up], [a K_up', -a^2 K_pp]] [N/m].
        mass: (4 N, 4 N), zero for potentials [kg].
        volts: a, volts of one unit of the potential's unknown, which makes both blocks alike.
    """

    stiffness: Any
    mass: Any
    volts: float


def assembled(body: Body) -> Matrices:
    """Stiffness and consistent mass of a body.

    Raises:
        InputError: scikit-fem is not installed.
    """
    fem = library("skfem")
    basis = fem.Basis(body.mesh(fem), fem.ElementHex1(), intorder=_GAUSS)
    first = body.materials[0]
    volts = float(np.sqrt(first.stiffness[2, 2] / first.clamped_permittivity[2, 2]))
    gradients = [np.asarray(basis.basis[i][0].grad) for i in range(8)]
    values = np.array([np.asarray(basis.basis[i][0])[0] for i in range(8)])
    weight = np.asarray(basis.dx)
    unknowns = (4 * body.bricks[:, :, None] + np.arange(4)).reshape(body.elements, 32)
    stiffness = np.zeros((body.elements, 32, 32))
    mass = np.zeros((body.elements, 8, 8))
    for index, material in enumerate(body.materials):
        own = np.flatnonzero(body.material_of == index)
        if own.size == 0:
            continue
        law = np.block(
            [
                [material.stiffness, material.stress_constants.T],
                [material.stress_constants, -material.clamped_permittivity],
            ]
        )
        stiffness[own] = _elements([g[:, own] for g in gradients], weight[own], law, volts)
        weighted = material.density * weight[own]
        mass[own] = np.einsum("iq,jq,eq->eij", values, values, weighted)
    whole = np.zeros((body.elements, 8, 4, 8, 4))
    for axis in range(3):
        whole[:, :, axis, :, axis] = mass
    return Matrices(
        _scattered(stiffness, unknowns, 4 * body.nodes),
        _scattered(whole.reshape(body.elements, 32, 32), unknowns, 4 * body.nodes),
        volts,
    )


def strain_rows(gradients: list[FloatArray], volts: float) -> FloatArray:
    """(9, elements, points, 32): strain, and minus the field, by the unknowns of an element."""
    count, points = gradients[0].shape[1:]
    rows = np.zeros((9, count, points, 8, 4))
    for node, (dx, dy, dz) in enumerate(gradients):
        own = rows[:, :, :, node]
        own[0, :, :, 0], own[1, :, :, 1], own[2, :, :, 2] = dx, dy, dz
        own[3, :, :, 1], own[3, :, :, 2] = dz, dy
        own[4, :, :, 0], own[4, :, :, 2] = dz, dx
        own[5, :, :, 0], own[5, :, :, 1] = dy, dx
        own[6, :, :, 3], own[7, :, :, 3], own[8, :, :, 3] = volts * dx, volts * dy, volts * dz
    return rows.reshape(9, count, points, 32)


def _elements(
    gradients: list[FloatArray], weight: FloatArray, law: FloatArray, volts: float
) -> FloatArray:
    """(elements, 32, 32) by products of long rows: one call of a matrix library an element."""
    root = np.sqrt(weight)
    rows = strain_rows([g * root for g in gradients], volts)
    stressed = (law @ rows.reshape(9, -1)).reshape(rows.shape)
    count = weight.shape[0]
    left = np.ascontiguousarray(rows.transpose(1, 3, 0, 2)).reshape(count, 32, -1)
    right = np.ascontiguousarray(stressed.transpose(1, 0, 2, 3)).reshape(count, -1, 32)
    return np.asarray(left @ right)


def _scattered(blocks: FloatArray, unknowns: NDArray[np.int64], size: int) -> Any:
    rows = np.repeat(unknowns, 32, axis=1).ravel()
    columns = np.tile(unknowns, (1, 32)).ravel()
    return sparse.coo_matrix((blocks.ravel(), (rows, columns)), shape=(size, size)).tocsc()
