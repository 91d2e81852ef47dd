"""A meshed piezoelectric body: bricks, what each is made of, where it is held and driven."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.errors import InputError
from piezo_opt.lazy import lazy
from piezo_opt.physics import Material

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

VTK_ORDER: Final = (0, 3, 6, 2, 1, 5, 7, 4)
"""Corners of scikit-fem's brick, around the lower face and then around the upper one."""


@final
@dataclass(frozen=True, eq=False)
class Body:
    """Eight-node bricks of piezoelectric solids, with electrodes and a support.

    Sides without electrode are free of charge: the field in the air around a ceramic of a relative
    permittivity of thousands is neglected.

    Args:
        points: (N, 3) nodes [m].
        bricks: (M, 8) node numbers of each element, in scikit-fem's order.
        materials: the solids.
        material_of: (M,) which of them an element is made of.
        ground: nodes of the electrodes at 0 V.
        driven: nodes of the electrodes that share the drive.
        fixed: displacement components that are held at zero, 3 node + axis.

    Raises:
        InputError: a node is on both electrodes, or nothing is grounded or driven.
    """

    points: FloatArray
    bricks: IntArray
    materials: tuple[Material, ...]
    material_of: IntArray
    ground: IntArray
    driven: IntArray
    fixed: IntArray

    def __post_init__(self) -> None:
        for label in ("ground", "driven"):
            if getattr(self, label).size == 0:
                raise InputError(
                    f"the body has no {label} electrode, so that its potential is not determined: "
                    f"name the nodes of one as {label}="
                )
        shared = np.intersect1d(self.ground, self.driven)
        if shared.size:
            raise InputError(
                f"node {int(shared[0])} lies on the grounded and on the driven electrode, which "
                "would be a short circuit: leave a gap of one element"
            )

    @property
    def nodes(self) -> int:
        """N."""
        return int(self.points.shape[0])

    @property
    def elements(self) -> int:
        """M."""
        return int(self.bricks.shape[0])

    @property
    def height(self) -> float:
        """Extent along z [m]."""
        return float(np.ptp(self.points[:, 2]))

    @property
    def top(self) -> IntArray:
        """Nodes of the highest level."""
        return self.level(float(self.points[:, 2].max()))

    @lazy
    def over_top(self) -> FloatArray:
        """(N,) weights of the mean over the highest level, by area; zero below it."""
        faces = self.surface()
        faces = faces[np.isin(faces, self.top).all(axis=1)]
        corners = self.points[faces]
        across = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
        area = 0.5 * np.linalg.norm(np.cross(*across), axis=1)
        weights = np.zeros(self.nodes)
        np.add.at(weights, faces, area[:, None] / 4.0)
        return np.asarray(weights / weights.sum())

    def level(self, z: float) -> IntArray:
        """Nodes at a height [m]."""
        near = np.abs(self.points[:, 2] - z) <= 1e-9 * self.height
        return np.flatnonzero(near).astype(np.int64)

    def mesh(self, library: Any) -> Any:
        """The mesh as scikit-fem's own object."""
        return library.MeshHex(np.ascontiguousarray(self.points.T), self.bricks.T.copy())

    def surface(self) -> IntArray:
        """(k, 4) nodes of the outer faces, each around its edge."""
        a, b, c, d, e, f, g, h = VTK_ORDER
        sides = ((a, b, c, d), (e, f, g, h), (a, b, f, e), (b, c, g, f), (c, d, h, g), (d, a, e, h))
        faces = self.bricks[:, sides].reshape(-1, 4)
        _, first, count = np.unique(
            np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True
        )
        # A face between two bricks is listed by both of them.
        return np.asarray(faces[first[count == 1]])

    def rigid_motions(self) -> FloatArray:
        """(3 N, 6) displacements by the six motions without strain, scaled by the body's size."""
        x, y, z = (self.points - self.points.mean(axis=0)).T / self.height
        one, none = np.ones_like(x), np.zeros_like(x)
        motions = [
            (one, none, none), (none, one, none), (none, none, one),
            (none, -z, y), (z, none, -x), (-y, x, none),
        ]  # fmt: skip
        return np.column_stack([np.column_stack(motion).ravel() for motion in motions])

    @property
    def loose(self) -> int:
        """Motions without strain that the support leaves free, 0 to 6."""
        if self.fixed.size == 0:
            return 6
        return 6 - int(np.linalg.matrix_rank(self.rigid_motions()[self.fixed], tol=1e-8))
