"""Rectangular bodies: one block, and a stack of layers."""

from __future__ import annotations

from dataclasses import replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from piezo_opt.errors import InputError
from piezo_opt.finite_elements.body import Body
from piezo_opt.finite_elements.library import library
from piezo_opt.physics import Material

IntArray = NDArray[np.int64]
MOST_ELEMENTS = 40_000
"""Bricks beyond which a factorisation no longer fits into a few gigabytes."""


class Support(Enum):
    """How a rectangular body is held."""

    CLAMPED = "clamped"
    """Every node of the base is fixed."""
    ROLLERS = "rollers"
    """The base stays plane and is free to widen."""
    FREE = "free"
    """Not at all: for modes only."""
    HELD = "held"
    """Everywhere: no strain at all."""


def block(
    material: Material,
    width: float,
    depth: float,
    height: float,
    *,
    elements: tuple[int, int, int],
    support: Support = Support.CLAMPED,
) -> Body:
    """A block with electrodes on its base (grounded) and its top (driven).

    It is poled downwards, so that a positive voltage on top lengthens it.

    Args:
        material: as it is poled along +z.
        width, depth, height: along x, y, z [m].
        elements: bricks along x, y, z.
        support: how it is held.

    Raises:
        InputError: a dimension or a number of elements makes no sense.
    """
    return stack(material, width, depth, height, layers=1, elements=elements, support=support)


def stack(
    material: Material,
    width: float,
    depth: float,
    layer: float,
    *,
    layers: int,
    elements: tuple[int, int, int],
    support: Support = Support.CLAMPED,
) -> Body:
    """Layers on one another, electrodes between them in turn grounded and driven, from the base up.

    Neighbours are poled against each other, so that a positive voltage lengthens every layer.
    Electrodes have no thickness and cover the whole section.

    Args:
        material: as it is poled along +z.
        width, depth: along x and y [m].
        layer: thickness of a layer [m].
        layers: their number.
        elements: bricks along x, along y, and in each layer along z.
        support: how it is held.

    Raises:
        InputError: a dimension or a number of elements makes no sense.
    """
    for label, size in (("width", width), ("depth", depth), ("height", layer)):
        if not 0.0 < size < np.inf:
            raise InputError(f"{label} is {size:g} m; give a positive length")
    nx, ny, nz = elements
    if min(elements) < 1 or layers < 1:
        raise InputError(f"{nx} x {ny} x {nz} elements in {layers} layers: give at least one each")
    if nx * ny * nz * layers > MOST_ELEMENTS:
        raise InputError(
            f"{nx * ny * nz * layers} elements are too many to factorise here: give at most "
            f"{MOST_ELEMENTS}"
        )
    fem = library("skfem")
    heights = np.linspace(0.0, layers * layer, layers * nz + 1)
    mesh = fem.MeshHex.init_tensor(
        np.linspace(0.0, width, nx + 1), np.linspace(0.0, depth, ny + 1), heights
    )
    points = np.ascontiguousarray(mesh.p.T)
    bricks = np.ascontiguousarray(mesh.t.T).astype(np.int64)
    middle = points[bricks][:, :, 2].mean(axis=1)
    made = Body(
        points=points,
        bricks=bricks,
        materials=(material.reversed(), material),
        material_of=(np.floor(middle / layer).astype(np.int64)) % 2,
        ground=_levels(points, layer, layers, 0),
        driven=_levels(points, layer, layers, 1),
        fixed=np.zeros(0, dtype=np.int64),
    )
    return supported(made, support)


def supported(body: Body, support: Support) -> Body:
    """The same body, held in another way.

    Rollers hold the base's z, a corner of it, and the direction in which the next corner along x
    lies: enough to keep the body in place, and nothing that keeps it from widening.
    """
    points = body.points
    base = body.level(float(points[:, 2].min()))
    if support is Support.FREE:
        fixed = np.zeros(0, dtype=np.int64)
    elif support is Support.HELD:
        fixed = np.arange(3 * body.nodes, dtype=np.int64)
    elif support is Support.CLAMPED:
        fixed = (3 * base[:, None] + np.arange(3)).ravel()
    else:
        x, y = points[base, 0], points[base, 1]
        corner = base[np.lexsort((x, y))[0]]
        row = base[np.abs(y - y.min()) <= 1e-9 * body.height]
        along = row[np.argmax(points[row, 0])]
        fixed = np.concatenate([3 * base + 2, [3 * corner, 3 * corner + 1, 3 * along + 1]])
    return replace(body, fixed=np.unique(fixed).astype(np.int64))


def mirrored(body: Body, axes: str) -> Body:
    """The same body as the part of a larger one beyond its lowest planes, which are mirrors.

    A mirror holds the displacement along its normal, and is free of charge as every side without
    electrode. Half the width of a symmetric body answers as the whole one does.

    Args:
        body: the part.
        axes: normals of the mirrors: ``"x"``, ``"xy"`` or ``"xyz"``.

    Raises:
        InputError: another axis is named.
    """
    if not axes or set(axes) - set("xyz"):
        raise InputError(f"mirrors along {axes!r}: name axes out of xyz")
    held = [body.fixed]
    for axis in axes:
        k = "xyz".index(axis)
        place = body.points[:, k]
        near = np.flatnonzero(np.abs(place - place.min()) <= 1e-9 * body.height)
        held.append(3 * near + k)
    return replace(body, fixed=np.unique(np.concatenate(held)).astype(np.int64))


def _levels(points: NDArray[np.float64], layer: float, layers: int, parity: int) -> IntArray:
    """Nodes of every second interface."""
    place = points[:, 2] / layer
    level = np.round(place).astype(np.int64)
    on = (np.abs(place - level) <= 1e-9 * layers) & (level % 2 == parity)
    return np.flatnonzero(on).astype(np.int64)
