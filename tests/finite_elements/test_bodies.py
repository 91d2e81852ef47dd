"""Bodies whose answer is known: capacitances, free expansion, sensors, stacks, refusals."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.errors import InputError
from piezo_opt.finite_elements import (
    Circuit,
    Support,
    System,
    block,
    compare_with_thesis,
    mirrored,
    modes,
    ramp,
    reduced,
    stack,
    static,
    supported,
    thesis_block,
    write_vtk,
)
from piezo_opt.physics import PZT_5A, PZT_5H, Stack

SMALL = {"elements": (3, 3, 3)}


def test_free_expansion_is_the_thesis_formula() -> None:
    """2 w2 = d31 V w / l = 5.1375e-8 m, with lateral motion free."""
    body = supported(thesis_block(), Support.ROLLERS)
    assert body.nodes == 1089
    assert body.elements == 800
    answer = static(body, 150.0)
    assert -answer.widening == pytest.approx(5.1375e-8, rel=1e-11)
    assert answer.tip == pytest.approx(593e-12 * 150.0, rel=1e-11)
    # The field is even: nothing is held, so that no stress remains.
    np.testing.assert_allclose(answer.potential, 150.0 * body.points[:, 2] / 4e-3, atol=1e-8)


def test_capacitance_free_and_clamped() -> None:
    area, height = 2e-3 * 3e-3, 1.5e-3
    for material in (PZT_5H, PZT_5A):
        body = block(material, 2e-3, 3e-3, height, support=Support.ROLLERS, **SMALL)
        free = static(body, 10.0).capacitance
        assert free == pytest.approx(material.permittivity[2, 2] * area / height, rel=1e-10)
        held = static(supported(body, Support.HELD), 10.0).capacitance
        clamped = material.clamped_permittivity[2, 2] * area / height
        assert held == pytest.approx(clamped, rel=1e-10)
        between = static(supported(body, Support.CLAMPED), 10.0).capacitance
        assert clamped < between < free


def test_open_sensor_shows_g33() -> None:
    body = block(PZT_5H, 1e-3, 1e-3, 2e-3, support=Support.ROLLERS, elements=(2, 2, 3))
    forces = np.zeros((body.nodes, 3))
    edge = np.isin(body.points[body.top][:, :2], (0.0, 1e-3)).sum(axis=1)
    forces[body.top, 2] = -(0.5**edge) / 4.0
    floating = static(System(body, Circuit.OPEN), 0.0, forces)
    pressure = 1.0 / 1e-6
    g33 = 593e-12 / PZT_5H.permittivity[2, 2]
    # Pressed along its axis it shows the sign of the voltage that poled it: top positive.
    assert floating.voltage == pytest.approx(g33 * pressure * 2e-3, rel=1e-10)
    assert floating.charge == 0.0
    assert -floating.tip == pytest.approx(PZT_5H.open_compliance[2, 2] * pressure * 2e-3, rel=1e-10)


def test_stack_by_layers_is_the_formula() -> None:
    body = stack(PZT_5H, 2e-3, 2e-3, 0.5e-3, layers=5, elements=(2, 2, 2), support=Support.ROLLERS)
    formula = Stack(PZT_5H, layers=5, thickness=0.5e-3, area=4e-6)
    answer = static(body, 100.0)
    assert answer.tip == pytest.approx(formula.stroke(100.0), rel=1e-10)
    assert answer.capacitance == pytest.approx(formula.capacitance, rel=1e-10)


def test_slender_stack_swings_as_a_rod() -> None:
    body = stack(PZT_5H, 1e-3, 1e-3, 0.5e-3, layers=20, elements=(2, 2, 1))
    formula = Stack(PZT_5H, layers=20, thickness=0.5e-3, area=1e-6)
    small = reduced(body, 12)
    main = small.frequencies[np.argmax(np.abs(small.gains))]
    # Less than 2 %: the section is a tenth of the length, the base hinders it from narrowing.
    assert main == pytest.approx(formula.resonance, rel=0.02)
    # A rod's first mode has 8 / pi^2 of the static stroke.
    assert small.gains.max() / small.gain == pytest.approx(8.0 / np.pi**2, rel=0.02)
    known = small.expected(0.2)
    assert known["piezo_gain.d"].value == pytest.approx(formula.gain, rel=0.03)
    assert known["second_order.omega"].value == pytest.approx(2.0 * np.pi * main)


def test_half_a_body_between_mirrors_is_the_whole() -> None:
    whole = static(block(PZT_5H, 2e-3, 2e-3, 1e-3, elements=(4, 4, 2)), 50.0)
    part = mirrored(block(PZT_5H, 1e-3, 1e-3, 1e-3, elements=(2, 2, 2)), "xy")
    quarter = static(part, 50.0)
    assert quarter.tip == pytest.approx(whole.tip, rel=1e-10)
    assert 4.0 * quarter.charge == pytest.approx(whole.charge, rel=1e-10)


def test_thesis_beside_its_own_data() -> None:
    told = compare_with_thesis()
    assert told.printed == pytest.approx(4.33728e-7)
    assert told.factor == pytest.approx(4.876, abs=1e-3)
    assert told.free == pytest.approx(told.formula, rel=1e-10)
    assert told.widening == pytest.approx(told.widening_formula, rel=1e-10)
    # Clamping takes an eighth; finer elements give one percent of it back.
    assert told.clamped / told.free == pytest.approx(0.866, abs=2e-3)
    assert 1.0 < told.finer / told.clamped < 1.02
    # Nothing that was tried reaches half of the printed value.
    assert max(told.finer, told.tenth_permittivity, told.corner, told.free) < 0.5 * told.printed
    assert told.five_clamped_blocks == pytest.approx(told.printed, rel=5e-3)


def test_ramp_is_a_record_like_appendix_d() -> None:
    body = block(PZT_5H, 5e-3, 5e-3, 4e-3, elements=(4, 4, 3))
    record, theirs = ramp(body, 150.0), po.load("thesis/fe")
    np.testing.assert_allclose(record.time, theirs.time, atol=1e-12)
    np.testing.assert_allclose(record.drive, theirs.drive, atol=1e-9)
    gain = static(body, 1.0).tip
    np.testing.assert_allclose(record.position, gain * record.drive, rtol=1e-9, atol=1e-20)
    # From finite elements to the dynamic model: its prior, and a fit that uses it.
    model = po.effects.PiezoGain() + po.effects.SecondOrder()
    priors = po.priors_from(reduced(body, 8).expected(0.1), model)
    assert set(priors) == {"piezo_gain.d", "second_order.omega"}
    question = po.Identification(
        po.Model.of(po.effects.PiezoGain()), record, noise=1e-9,
        priors={"piezo_gain.d": priors["piezo_gain.d"]},
    )  # fmt: skip
    assert po.solve(question).values["piezo_gain.d"] == pytest.approx(gain, rel=1e-3)


def test_vtk_is_read_again(tmp_path: object) -> None:
    import meshio

    body = block(PZT_5H, 1e-3, 2e-3, 3e-3, elements=(2, 3, 2))
    answer, found = static(body, 20.0), modes(body, 3)
    write_vtk(answer, f"{tmp_path}/static.vtk")
    read = meshio.read(f"{tmp_path}/static.vtk")
    np.testing.assert_allclose(read.point_data["displacement"], answer.displacement)
    np.testing.assert_allclose(read.point_data["potential"], answer.potential)
    # VTK's order runs around the faces: its bricks have a positive volume of the right size.
    p = read.points[read.cells_dict["hexahedron"]]
    edges = (p[:, 1] - p[:, 0], p[:, 3] - p[:, 0], p[:, 4] - p[:, 0])
    volume = np.einsum("ij,ij->i", np.cross(edges[0], edges[1]), edges[2])
    np.testing.assert_allclose(volume.sum(), 6e-9, rtol=1e-12)
    assert volume.min() > 0.0
    write_vtk(found, f"{tmp_path}/modes.vtu")
    assert len(meshio.read(f"{tmp_path}/modes.vtu").point_data) == 6
    with pytest.raises(InputError, match="exists already"):
        write_vtk(answer, f"{tmp_path}/static.vtk")


def test_surface_covers_the_box() -> None:
    body = block(PZT_5H, 1e-3, 2e-3, 3e-3, elements=(2, 3, 4))
    corners = body.points[body.surface()]
    a, b = corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0]
    area = np.linalg.norm(np.cross(a, b), axis=1).sum()
    assert area == pytest.approx(2.0 * (2e-6 + 3e-6 + 6e-6), rel=1e-12)


def test_refusals_are_sentences(monkeypatch: pytest.MonkeyPatch) -> None:
    body = block(PZT_5H, 1e-3, 1e-3, 1e-3, **SMALL)
    with pytest.raises(InputError, match="no ground electrode"):
        replace(body, ground=np.zeros(0, dtype=np.int64))
    with pytest.raises(InputError, match="short circuit"):
        replace(body, driven=body.ground)
    with pytest.raises(InputError, match="6 of the 6 motions without strain free"):
        static(supported(body, Support.FREE), 1.0)
    sliding = replace(body, fixed=3 * body.level(0.0) + 2)
    with pytest.raises(InputError, match="3 of the 6 motions"):
        static(sliding, 1.0)
    with pytest.raises(InputError, match="three components for each of the 64 nodes"):
        static(body, 1.0, np.zeros((3, 64)))
    with pytest.raises(InputError, match="width is -1 m"):
        block(PZT_5H, -1.0, 1e-3, 1e-3, **SMALL)
    with pytest.raises(InputError, match="too many"):
        block(PZT_5H, 1e-3, 1e-3, 1e-3, elements=(100, 100, 100))
    with pytest.raises(InputError, match="at least one each"):
        stack(PZT_5H, 1e-3, 1e-3, 1e-3, layers=0, elements=(1, 1, 1))
    with pytest.raises(InputError, match="1000 modes of 144 free displacements"):
        modes(body, 1000)
    with pytest.raises(InputError, match="mirrors along 'q'"):
        mirrored(body, "q")
    monkeypatch.setitem(sys.modules, "skfem", None)
    with pytest.raises(InputError, match=r"install piezo_opt\[fem\]"):
        block(PZT_5H, 1e-3, 1e-3, 1e-3, **SMALL)
