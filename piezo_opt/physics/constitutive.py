"""The constitutive equations as functions of what is given, actuator and sensor mode."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_opt.errors import InputError
from piezo_opt.physics.material import Material

FloatArray = NDArray[np.float64]


def strain_form(
    material: Material, stress: ArrayLike, field: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Strain (..., 6) [1] and charge density (..., 3) [C/m^2] of stress [Pa] and field [V/m].

        S = s^E T + d' E,   D = d T + eps^T E

    Raises:
        InputError: stress has not six components, or field not three.

    Source: ANSI/IEEE Std 176-1987, eqs. 42 and 43.
    """
    t, e = _components("stress", stress, 6), _components("field", field, 3)
    d = material.strain_constants
    return t @ material.compliance + e @ d, t @ d.T + e @ material.permittivity


def stress_form(
    material: Material, strain: ArrayLike, field: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Stress (..., 6) [Pa] and charge density (..., 3) [C/m^2] of strain and field [V/m].

        T = c^E S - e' E,   D = e S + eps^S E

    Raises:
        InputError: strain has not six components, or field not three.

    Source: ANSI/IEEE Std 176-1987, eqs. 38 and 39.
    """
    s, field_ = _components("strain", strain, 6), _components("field", field, 3)
    e = material.stress_constants
    return s @ material.stiffness - field_ @ e, s @ e.T + field_ @ material.clamped_permittivity


def actuator(material: Material, field: ArrayLike) -> FloatArray:
    """Strain (..., 6) of a free actuator in a field (..., 3) [V/m]: S = d' E, as T = 0."""
    return np.asarray(_components("field", field, 3) @ material.strain_constants)


def sensor(material: Material, stress: ArrayLike) -> FloatArray:
    """Charge density (..., 3) [C/m^2] of a shorted sensor under stress (..., 6): D = d T."""
    return np.asarray(_components("stress", stress, 6) @ material.strain_constants.T)


def open_sensor(material: Material, stress: ArrayLike) -> FloatArray:
    """Field (..., 3) [V/m] of a sensor without load under stress (..., 6): E = -g T, as D = 0."""
    return np.asarray(-_components("stress", stress, 6) @ material.voltage_constants.T)


def _components(label: str, values: ArrayLike, count: int) -> FloatArray:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 0 or array.shape[-1] != count:
        raise InputError(f"{label} has the shape {array.shape}; give {count} on its last axis")
    return array
