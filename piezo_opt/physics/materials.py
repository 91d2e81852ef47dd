"""Ceramics whose full set of constants is published.

Typical values of mass production: single pieces differ by 5 to 20 %, and the constants are those of
small signals. At the field of an actuator's full stroke d33 is up to twice as large.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

import numpy as np

from piezo_opt.choosing import expected
from piezo_opt.errors import InputError
from piezo_opt.physics.material import VACUUM, Material


def poled_ceramic(
    name: str,
    *,
    s11: float,
    s12: float,
    s13: float,
    s33: float,
    s44: float,
    d31: float,
    d33: float,
    d15: float,
    eps11: float,
    eps33: float,
    density: float,
    source: str = "",
) -> Material:
    """A ceramic poled along axis 3: transversely isotropic, ten constants (class 6mm).

    Args:
        name, source: as of :class:`Material`.
        s11, s12, s13, s33, s44: compliances s^E [1/Pa]; s66 = 2 (s11 - s12).
        d31, d33, d15: strain constants [m/V].
        eps11, eps33: free permittivities eps^T [F/m].
        density: [kg/m^3].

    Raises:
        InputError: the constants give no positive energy.
    """
    s = np.zeros((6, 6))
    s[:3, :3] = [[s11, s12, s13], [s12, s11, s13], [s13, s13, s33]]
    s[3, 3] = s[4, 4] = s44
    s[5, 5] = 2.0 * (s11 - s12)
    d = np.zeros((3, 6))
    d[2, :3] = d31, d31, d33
    d[0, 4] = d[1, 3] = d15
    return Material(name, s, d, np.diag([eps11, eps11, eps33]), density, source)


def _tabulated(
    name: str,
    s: tuple[float, float, float, float, float],
    d: tuple[float, float, float],
    eps: tuple[float, float],
    density: float,
    source: str,
) -> Material:
    """From the units of data sheets: s [1e-12 m^2/N], d [1e-12 m/V], eps relative to vacuum."""
    s11, s12, s13, s33, s44 = (1e-12 * value for value in s)
    d31, d33, d15 = (1e-12 * value for value in d)
    eps11, eps33 = (VACUUM * value for value in eps)
    return poled_ceramic(
        name, s11=s11, s12=s12, s13=s13, s33=s33, s44=s44, d31=d31, d33=d33, d15=d15,
        eps11=eps11, eps33=eps33, density=density, source=source,
    )  # fmt: skip


_MORGAN = (
    "Berlincourt, Krueger & Near, Properties of Piezoelectricity Ceramics, Morgan Electro Ceramics "
    "Technical Publication TP-226"
)

PZT_5H: Final = _tabulated(
    "PZT-5H",
    (16.5, -4.78, -8.45, 20.7, 43.5), (-274.0, 593.0, 741.0), (3130.0, 3400.0), 7500.0,
    f"{_MORGAN}; Erturk & Inman (2011), Piezoelectric Energy Harvesting, app. E",
)  # fmt: skip
"""Soft, large stroke; the ceramic of the thesis' finite-element model."""

PZT_5A: Final = _tabulated(
    "PZT-5A",
    (16.4, -5.74, -7.22, 18.8, 47.5), (-171.0, 374.0, 584.0), (1730.0, 1700.0), 7750.0,
    f"{_MORGAN}; Erturk & Inman (2011), Piezoelectric Energy Harvesting, app. E",
)  # fmt: skip
"""Soft, stable with temperature: sensors and actuators."""

PZT_4: Final = _tabulated(
    "PZT-4",
    (12.3, -4.05, -5.31, 15.5, 39.0), (-123.0, 289.0, 496.0), (1475.0, 1300.0), 7500.0,
    f"{_MORGAN}; Jaffe, Cook & Jaffe (1971), Piezoelectric Ceramics, ch. 7",
)  # fmt: skip
"""Hard: transducers at resonance."""

PIC151: Final = _tabulated(
    "PIC151",
    (16.83, -5.656, -7.107, 19.00, 50.96), (-214.0, 423.0, 610.0), (1936.0, 2109.0), 7800.0,
    "PI Ceramic, material coefficients of PIC151 for finite-element computations",
)  # fmt: skip
"""Soft, the standard ceramic of one maker's actuators."""

MATERIALS: Final[Mapping[str, Material]] = MappingProxyType(
    {material.name: material for material in (PZT_5H, PZT_5A, PZT_4, PIC151)}
)
"""All of them, by name."""


def material(name: str) -> Material:
    """The material of that name; upper and lower case, blanks, hyphens and underscores are one.

    Raises:
        InputError: there is none.
    """

    expected(str, name, "The material", "its name")

    def plain(text: str) -> str:
        return "".join(c for c in text.lower() if c.isalnum())

    for known, found in MATERIALS.items():
        if plain(known) == plain(name):
            return found
    raise InputError(f"no material {name!r}: there are {', '.join(MATERIALS)}")
