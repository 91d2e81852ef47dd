"""A piezoelectric material: its constants in all four forms, and whether they can be true."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_opt.errors import InputError
from piezo_opt.lazy import lazy

FloatArray = NDArray[np.float64]

VACUUM: Final = 8.8541878188e-12
"""Permittivity of vacuum [F/m]. Source: CODATA 2022."""

_SYMMETRIC: Final = 1e-9
"""Share of a matrix' largest entry by which it may differ from its transpose: rounding only."""


@final
@dataclass(frozen=True, eq=False)
class Material:
    """A linear piezoelectric solid, poled along axis 3.

        S = s^E T + d' E,   D = d T + eps^T E       (strain-charge form)

    Strain S and stress T in Voigt's order 11, 22, 33, 23, 13, 12 with engineering shear strains.
    All other forms follow from these three matrices.

    Args:
        name: what messages and tables call it.
        compliance: (6, 6) s^E at constant field [1/Pa].
        strain_constants: (3, 6) d [m/V], which is the same as [C/N].
        permittivity: (3, 3) eps^T at constant stress, "free" [F/m].
        density: [kg/m^3].
        source: where the numbers come from.

    Raises:
        InputError: a matrix has another shape, is not finite or not symmetric, or the energy that
            the constants give is not positive for every stress and field.

    Source: ANSI/IEEE Std 176-1987, sec. 2.
    """

    name: str
    compliance: FloatArray
    strain_constants: FloatArray
    permittivity: FloatArray
    density: float
    source: str = ""

    def __post_init__(self) -> None:
        for label, shape in (
            ("compliance", (6, 6)),
            ("strain_constants", (3, 6)),
            ("permittivity", (3, 3)),
        ):
            matrix = np.array(getattr(self, label), dtype=np.float64)
            _check_shape(self.name, label, matrix, shape)
            matrix.setflags(write=False)
            object.__setattr__(self, label, matrix)
        if not 0.0 < self.density < np.inf:
            raise InputError(f"{self.name}: density {self.density:g} kg/m^3; give a positive one")
        _check_symmetry(self.name, "compliance s^E", self.compliance)
        _check_symmetry(self.name, "permittivity eps^T", self.permittivity)
        _check_energy(self.name, self.compliance, self.strain_constants, self.permittivity)

    @staticmethod
    def from_stress_form(
        name: str,
        stiffness: ArrayLike,
        stress_constants: ArrayLike,
        permittivity: ArrayLike,
        density: float,
        source: str = "",
    ) -> Material:
        """From the constants of the stress-charge form, T = c^E S - e' E, D = e S + eps^S E.

        Args:
            name, density, source: as above.
            stiffness: (6, 6) c^E [Pa].
            stress_constants: (3, 6) e [C/m^2].
            permittivity: (3, 3) eps^S at constant strain, "clamped" [F/m].

        Raises:
            InputError: as above, or a stiffness that cannot be inverted.
        """
        c = np.array(stiffness, dtype=np.float64)
        e = np.array(stress_constants, dtype=np.float64)
        eps = np.array(permittivity, dtype=np.float64)
        for label, matrix, shape in (
            ("stiffness", c, (6, 6)),
            ("stress_constants", e, (3, 6)),
            ("permittivity", eps, (3, 3)),
        ):
            _check_shape(name, label, matrix, shape)
        _check_symmetry(name, "stiffness c^E", c)
        _check_symmetry(name, "permittivity eps^S", eps)
        if float(np.linalg.eigvalsh(c)[0]) <= 0.0:
            raise InputError(
                f"{name}: the stiffness c^E is not positive, some strain would cost no energy: "
                "check its off-diagonal entries"
            )
        s = np.linalg.inv(c)
        d = e @ s
        return Material(name, 0.5 * (s + s.T), d, eps + d @ e.T, density, source)

    def reversed(self) -> Material:
        """The same material poled the other way: every piezoelectric constant changes sign."""
        return replace(self, strain_constants=-self.strain_constants)

    @lazy
    def stiffness(self) -> FloatArray:
        """(6, 6) c^E = (s^E)^-1 at constant field [Pa]."""
        return _inverse(self.compliance)

    @lazy
    def stress_constants(self) -> FloatArray:
        """(3, 6) e = d c^E [C/m^2]."""
        return np.asarray(self.strain_constants @ self.stiffness)

    @lazy
    def clamped_permittivity(self) -> FloatArray:
        """(3, 3) eps^S = eps^T - d e' at constant strain [F/m]."""
        return np.asarray(self.permittivity - self.strain_constants @ self.stress_constants.T)

    @lazy
    def voltage_constants(self) -> FloatArray:
        """(3, 6) g = (eps^T)^-1 d of the strain-voltage form [V m/N]."""
        return np.asarray(_inverse(self.permittivity) @ self.strain_constants)

    @lazy
    def open_compliance(self) -> FloatArray:
        """(6, 6) s^D = s^E - d' g at constant charge [1/Pa]."""
        return np.asarray(self.compliance - self.strain_constants.T @ self.voltage_constants)

    @lazy
    def field_constants(self) -> FloatArray:
        """(3, 6) h = (eps^S)^-1 e of the stress-voltage form [V/m]."""
        return np.asarray(_inverse(self.clamped_permittivity) @ self.stress_constants)

    @lazy
    def open_stiffness(self) -> FloatArray:
        """(6, 6) c^D = c^E + e' h at constant charge [Pa]."""
        return np.asarray(self.stiffness + self.stress_constants.T @ self.field_constants)

    @property
    def d33(self) -> float:
        """Strain along the poling axis for a field along it [m/V]."""
        return float(self.strain_constants[2, 2])

    @property
    def d31(self) -> float:
        """Strain across the poling axis for a field along it [m/V]."""
        return float(self.strain_constants[2, 0])

    @property
    def k33(self) -> float:
        """Coupling of a long bar that is poled and driven along its length: d33/sqrt(s33 eps33)."""
        return self._coupling(2)

    @property
    def k31(self) -> float:
        """Coupling of a bar driven across its length: |d31| / sqrt(s11^E eps33^T)."""
        return self._coupling(0)

    @property
    def kt(self) -> float:
        """Coupling of a wide plate in its thickness: sqrt(1 - c33^E / c33^D)."""
        return float(np.sqrt(1.0 - self.stiffness[2, 2] / self.open_stiffness[2, 2]))

    def _coupling(self, axis: int) -> float:
        stored = self.compliance[axis, axis] * self.permittivity[2, 2]
        return float(abs(self.strain_constants[2, axis]) / np.sqrt(stored))


def _inverse(matrix: FloatArray) -> FloatArray:
    """Inverse of a symmetric matrix, symmetric to the last digit."""
    found = np.linalg.inv(matrix)
    return np.asarray(0.5 * (found + found.T))


def _check_shape(name: str, label: str, matrix: FloatArray, shape: tuple[int, int]) -> None:
    if matrix.shape != shape:
        raise InputError(f"{name}: {label} has the shape {matrix.shape}; give {shape}")
    if not np.isfinite(matrix).all():
        raise InputError(f"{name}: {label} holds an entry that is not a number; give all of them")


def _check_symmetry(name: str, label: str, matrix: FloatArray) -> None:
    apart = np.abs(matrix - matrix.T)
    row, column = np.unravel_index(int(apart.argmax()), apart.shape)
    if apart[row, column] > _SYMMETRIC * np.abs(matrix).max():
        raise InputError(
            f"{name}: the {label} is not symmetric, entry ({row + 1}, {column + 1}) is "
            f"{matrix[row, column]:.4g} and ({column + 1}, {row + 1}) is "
            f"{matrix[column, row]:.4g}: make them equal"
        )


def _check_energy(name: str, s: FloatArray, d: FloatArray, eps: FloatArray) -> None:
    """u = (T' s T + 2 E' d T + E' eps E) / 2 must be positive; scaled, as units differ."""
    for label, matrix in (("compliance s^E", s), ("permittivity eps^T", eps)):
        if np.diag(matrix).min() <= 0.0 or float(np.linalg.eigvalsh(matrix)[0]) <= 0.0:
            raise InputError(
                f"{name}: the {label} is not positive, the stored energy would be negative: check "
                "signs and off-diagonal entries"
            )
    whole = np.block([[s, d.T], [d, eps]])
    size = 1.0 / np.sqrt(np.diag(whole))
    if float(np.linalg.eigvalsh(whole * size[:, None] * size[None, :])[0]) <= 0.0:
        raise InputError(
            f"{name}: the piezoelectric constants are larger than compliance and permittivity "
            "allow, the stored energy would be negative (a coupling above 1): check their units"
        )
