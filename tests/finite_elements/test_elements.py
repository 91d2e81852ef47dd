"""The bricks themselves: patch test, order of convergence, and reciprocity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from piezo_opt.finite_elements import Body, Support, System, block, static
from piezo_opt.finite_elements.assembly import assembled
from piezo_opt.finite_elements.library import library
from piezo_opt.physics import PZT_4, PZT_5H, Material

RNG = np.random.default_rng(7)


def inner(body: Body) -> np.ndarray:
    """Nodes away from the surface."""
    low, high = body.points.min(axis=0), body.points.max(axis=0)
    near = 1e-9 * body.height
    inside = (body.points > low + near) & (body.points < high - near)
    return np.flatnonzero(inside.all(axis=1))


def distorted(body: Body, share: float) -> Body:
    """Inner nodes moved at random by a share of an element's size."""
    points = body.points.copy()
    size = body.height / 4.0
    points[inner(body)] += share * size * RNG.uniform(-1.0, 1.0, (inner(body).size, 3))
    return replace(body, points=points)


def cube(n: int = 4) -> Body:
    return block(PZT_5H, 1e-3, 1e-3, 1e-3, elements=(n, n, n), support=Support.HELD)


def solved_inside(body: Body, boundary: np.ndarray, load: np.ndarray) -> np.ndarray:
    """All unknowns with those of the surface given."""
    matrices = assembled(body)
    own = inner(body)
    free = (4 * own[:, None] + np.arange(4)).ravel()
    x = boundary.copy()
    x[free] = 0.0
    right = load - matrices.stiffness @ x
    x[free] = spsolve(matrices.stiffness[free][:, free].tocsc(), right[free])
    return x


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_patch(share: float) -> None:
    """Any linear displacement and potential is met exactly, on crooked bricks too."""
    body = distorted(cube(), share)
    gradient = RNG.normal(size=(4, 3))
    linear = (body.points / 1e-3 @ gradient.T).ravel()
    found = solved_inside(body, linear, np.zeros(linear.size))
    assert np.abs(found - linear).max() < 1e-12 * np.abs(linear).max()


def test_a_wrong_strain_row_would_fail_the_patch_test_of_energy() -> None:
    """Energy of a uniform state is that of the constitutive law, each component by itself."""
    body = distorted(cube(), 0.3)
    matrices = assembled(body)
    material, volume = body.materials[0], 1e-9
    rows = {0: (0, 0), 1: (1, 1), 2: (2, 2), 3: (1, 2), 4: (0, 2), 5: (0, 1)}
    for voigt, (i, j) in rows.items():
        u = np.zeros((body.nodes, 4))
        u[:, i] += body.points[:, j] / (1.0 if i == j else 2.0)
        if i != j:
            u[:, j] += body.points[:, i] / 2.0
        energy = u.ravel() @ matrices.stiffness @ u.ravel()
        assert energy == pytest.approx(volume * material.stiffness[voigt, voigt], rel=1e-12)
        for axis in range(3):
            v = np.zeros((body.nodes, 4))
            v[:, 3] = body.points[:, axis] / matrices.volts
            mixed = u.ravel() @ matrices.stiffness @ v.ravel()
            constant = material.stress_constants[axis, voigt]
            assert mixed == pytest.approx(volume * constant, rel=1e-11, abs=1e-21)


def test_mass_is_density_times_volume() -> None:
    body = distorted(cube(), 0.3)
    matrices = assembled(body)
    for axis in range(4):
        u = np.zeros((body.nodes, 4))
        u[:, axis] = 1.0
        expected = 0.0 if axis == 3 else 7500.0 * 1e-9
        assert u.ravel() @ matrices.mass @ u.ravel() == pytest.approx(expected, rel=1e-12)


def test_second_order_on_a_smooth_answer() -> None:
    """Waves of displacement and potential, kept up by the loads that belong to them."""
    wave = np.array([2.0, 1.5, 2.5]) / 1e-3
    size, phase = np.array([1.0, -0.7, 0.4, 1.2]), np.array([0.3, 1.1, -0.4, 0.8])

    def exact(points: np.ndarray) -> np.ndarray:
        return size * np.sin((points @ wave)[..., None] + phase)

    errors = []
    for n in (4, 8):
        body = cube(n)
        matrices = assembled(body)
        x, y, z = wave
        rows = np.zeros((9, 4))
        rows[:6, :3] = [[x, 0, 0], [0, y, 0], [0, 0, z], [0, z, y], [z, 0, x], [y, x, 0]]
        rows[6:, 3] = matrices.volts * wave
        m = body.materials[0]
        law = np.block(
            [[m.stiffness, m.stress_constants.T], [m.stress_constants, -m.clamped_permittivity]]
        )
        fem = library("skfem")
        basis = fem.Basis(body.mesh(fem), fem.ElementHex1(), intorder=6)
        at = np.moveaxis(np.asarray(basis.global_coordinates()), 0, -1)
        force = exact(at) @ (rows.T @ law @ rows)
        load = np.zeros((body.nodes, 4))
        for corner in range(8):
            shape = np.asarray(basis.basis[corner][0])
            share = np.einsum("eq,eqk->ek", shape * basis.dx, force)
            np.add.at(load, body.bricks[:, corner], share)
        found = solved_inside(body, exact(body.points).ravel(), load.ravel()).reshape(-1, 4)
        between = sum(
            np.asarray(basis.basis[c][0])[..., None] * found[body.bricks[:, c]][:, None]
            for c in range(8)
        )
        errors.append(np.sqrt(np.einsum("eq,eqk->k", basis.dx, (between - exact(at)) ** 2)))
    order = np.log2(errors[0] / errors[1])
    assert np.all((order > 1.85) & (order < 2.15)), order


def test_reciprocity() -> None:
    """Charge a newton is displacement a volt, dQ/dF = du/dV: to 1e-10."""
    body = block(PZT_5H, 2e-3, 3e-3, 4e-3, elements=(3, 4, 5))
    body = distorted(body, 0.1)
    system = System(body)
    driven = static(system, 1.0)
    for node, axis in ((body.top[0], 2), (body.top[-1], 0), (body.nodes // 2, 1)):
        forces = np.zeros((body.nodes, 3))
        forces[node, axis] = 1.0
        pressed = static(system, 0.0, forces)
        assert pressed.charge == pytest.approx(
            driven.displacement[node, axis], rel=1e-10, abs=1e-10 * np.abs(driven.tip)
        )


def test_support_carries_what_is_put_on() -> None:
    body = block(PZT_4, 2e-3, 2e-3, 2e-3, elements=(3, 3, 3))
    forces = np.zeros((body.nodes, 3))
    forces[body.top] = [0.3, -0.2, 1.0]
    answer = static(body, 40.0, forces)
    total = forces.sum(axis=0)
    np.testing.assert_allclose(answer.reaction.sum(axis=0), -total, rtol=1e-9)
    assert answer.residual < 1e-10


def test_two_materials_in_series_are_two_springs() -> None:
    """Bricks of two solids without coupling: compliances add."""
    none = np.zeros((3, 6))
    solids = []
    for modulus in (60e9, 200e9):
        s = np.diag([1.0, 1.0, 1.0, 2.0, 2.0, 2.0]) / modulus
        solids.append(Material("x", s, none, PZT_5H.permittivity, 5000.0))
    body = block(PZT_5H, 1e-3, 1e-3, 2e-3, elements=(2, 2, 4), support=Support.ROLLERS)
    middle = body.points[body.bricks][:, :, 2].mean(axis=1)
    body = replace(body, materials=tuple(solids), material_of=(middle > 1e-3).astype(np.int64))
    forces = np.zeros((body.nodes, 3))
    edge = np.isin(body.points[body.top][:, :2], (0.0, 1e-3)).sum(axis=1)
    forces[body.top, 2] = 0.5**edge / 4.0  # a uniform pull of one newton
    stretched = static(body, 0.0, forces).tip
    assert stretched == pytest.approx(1e-3 / 1e-6 * (1 / 60e9 + 1 / 200e9), rel=1e-10)
