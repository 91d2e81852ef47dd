"""Constants of a material: the four forms agree, and impossible constants are refused."""

from __future__ import annotations

import numpy as np
import pytest

from piezo_opt.errors import InputError
from piezo_opt.physics import (
    MATERIALS,
    PIC151,
    PZT_4,
    PZT_5A,
    PZT_5H,
    VACUUM,
    Material,
    actuator,
    material,
    open_sensor,
    sensor,
    strain_form,
    stress_form,
)

RNG = np.random.default_rng(1)


@pytest.mark.parametrize("name", MATERIALS)
def test_the_forms_are_one_law(name: str) -> None:
    """The same state of a solid satisfies all four forms."""
    m = MATERIALS[name]
    stress, field = 1e6 * RNG.normal(size=(20, 6)), 1e5 * RNG.normal(size=(20, 3))
    strain, charge = strain_form(m, stress, field)
    again, charge_again = stress_form(m, strain, field)
    np.testing.assert_allclose(again, stress, rtol=1e-11, atol=1e-5)
    np.testing.assert_allclose(charge_again, charge, rtol=1e-11, atol=1e-15)
    # strain-voltage and stress-voltage form
    np.testing.assert_allclose(
        stress @ m.open_compliance + charge @ m.voltage_constants, strain, rtol=1e-10, atol=1e-16
    )
    np.testing.assert_allclose(
        strain @ m.open_stiffness - charge @ m.field_constants, stress, rtol=1e-10, atol=1e-4
    )
    np.testing.assert_allclose(
        -strain @ m.field_constants.T + charge @ np.linalg.inv(m.clamped_permittivity),
        field, rtol=1e-10, atol=1e-6,
    )  # fmt: skip


@pytest.mark.parametrize("name", MATERIALS)
def test_conversions_go_there_and_back(name: str) -> None:
    m = MATERIALS[name]
    back = Material.from_stress_form(
        name, m.stiffness, m.stress_constants, m.clamped_permittivity, m.density
    )
    np.testing.assert_allclose(back.compliance, m.compliance, rtol=1e-12, atol=1e-24)
    np.testing.assert_allclose(back.strain_constants, m.strain_constants, rtol=1e-11, atol=1e-22)
    np.testing.assert_allclose(back.permittivity, m.permittivity, rtol=1e-12)


def test_conversions_meet_the_published_stress_form() -> None:
    """Both forms of these ceramics are in print; the strain form is what the table holds."""
    # Jaffe, Cook & Jaffe (1971): c [GPa] and e [C/m^2] of PZT-4.
    for (i, j), published in {
        (0, 0): 139,
        (0, 1): 77.8,
        (0, 2): 74.3,
        (2, 2): 115,
        (3, 3): 25.6,
    }.items():
        assert PZT_4.stiffness[i, j] == pytest.approx(1e9 * published, rel=5e-3)
    for (i, j), published in {(2, 0): -5.2, (2, 2): 15.1, (0, 4): 12.7}.items():
        assert PZT_4.stress_constants[i, j] == pytest.approx(published, rel=5e-3)
    # PI Ceramic, PIC151 in stress form.
    for (i, j), published in {
        (0, 0): 107.6, (0, 1): 63.13, (0, 2): 63.86, (2, 2): 100.4, (3, 3): 19.62, (5, 5): 22.24,
    }.items():  # fmt: skip
        assert PIC151.stiffness[i, j] == pytest.approx(1e9 * published, rel=5e-4)
    for (i, j), published in {(2, 0): -9.52, (2, 2): 15.14, (0, 4): 11.97}.items():
        assert PIC151.stress_constants[i, j] == pytest.approx(published, rel=5e-4)


def test_couplings_of_the_data_sheets() -> None:
    """k33, k31 and kt as the maker's tables print them, which are measured by resonance."""
    printed = {
        PZT_5H: (0.752, 0.388, 0.505), PZT_5A: (0.705, 0.344, 0.486), PZT_4: (0.700, 0.334, 0.513)
    }  # fmt: skip
    for m, (k33, k31, kt) in printed.items():
        assert m.k33 == pytest.approx(k33, rel=0.03)
        assert m.k31 == pytest.approx(k31, rel=0.03)
        assert m.kt == pytest.approx(kt, rel=0.03)


def test_actuator_and_sensor_are_one_constant() -> None:
    field = np.array([0.0, 0.0, 1e6])
    assert actuator(PZT_5H, field)[2] == pytest.approx(593e-6)
    assert actuator(PZT_5H, field)[0] == pytest.approx(-274e-6)
    stress = np.array([0.0, 0.0, -1e7, 0.0, 0.0, 0.0])
    assert sensor(PZT_5H, stress)[2] == pytest.approx(-5.93e-3)
    # g33 = d33 / eps33^T: pressed along its axis the voltage has the sign of the poling voltage.
    assert open_sensor(PZT_5H, stress)[2] == pytest.approx(1e7 * 593e-12 / (3400 * VACUUM))
    shear = actuator(PZT_5H, np.array([1e6, 0.0, 0.0]))
    assert shear[4] == pytest.approx(741e-6)
    assert np.count_nonzero(shear) == 1


def test_reversed_poling_turns_the_stroke_and_keeps_the_rest() -> None:
    other = PZT_5H.reversed()
    assert other.d33 == -PZT_5H.d33
    np.testing.assert_array_equal(other.stiffness, PZT_5H.stiffness)
    np.testing.assert_allclose(other.clamped_permittivity, PZT_5H.clamped_permittivity, rtol=1e-14)


def changed(**entries: np.ndarray) -> dict[str, object]:
    m = PZT_5H
    return {
        "name": "x", "compliance": m.compliance, "strain_constants": m.strain_constants,
        "permittivity": m.permittivity, "density": m.density, **entries,
    }  # fmt: skip


def test_impossible_constants_are_refused_in_a_sentence() -> None:
    s = np.array(PZT_5H.compliance)
    s[0, 1] *= 1.01
    with pytest.raises(InputError, match=r"compliance s\^E is not symmetric, entry \(1, 2\)"):
        Material(**changed(compliance=s))
    s = np.array(PZT_5H.compliance)
    s[0, 1] = s[1, 0] = -20e-12
    with pytest.raises(InputError, match=r"compliance s\^E is not positive"):
        Material(**changed(compliance=s))
    with pytest.raises(InputError, match="a coupling above 1"):
        Material(**changed(strain_constants=1.5 * PZT_5H.strain_constants))
    eps = np.diag([1.0, 1.0, -1.0]) * 1e-8
    with pytest.raises(InputError, match=r"permittivity eps\^T is not positive"):
        Material(**changed(permittivity=eps))
    with pytest.raises(InputError, match="give \\(3, 6\\)"):
        Material(**changed(strain_constants=PZT_5H.strain_constants.T))
    with pytest.raises(InputError, match="stiffness c\\^E is not positive"):
        Material.from_stress_form(
            "x", -PZT_5H.stiffness, PZT_5H.stress_constants, PZT_5H.clamped_permittivity, 7500.0
        )
    with pytest.raises(InputError, match="density"):
        Material(**changed(density=-1.0))
    with pytest.raises(InputError, match="no material 'PZT-9': there are PZT-5H"):
        material("PZT-9")
    assert material("pzt 5h") is PZT_5H
    with pytest.raises(InputError, match="give 6 on its last axis"):
        strain_form(PZT_5H, np.zeros(3), np.zeros(3))
