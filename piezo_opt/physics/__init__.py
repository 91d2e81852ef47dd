"""Physics of the ceramic: constitutive equations, materials, stacks and bimorphs.

What is known of an actuator before it is measured: nominal values and priors of a model.
"""

from piezo_opt.physics.bimorph import Bimorph, Wiring
from piezo_opt.physics.constitutive import (
    actuator,
    open_sensor,
    sensor,
    strain_form,
    stress_form,
)
from piezo_opt.physics.expected import Expected
from piezo_opt.physics.material import VACUUM, Material
from piezo_opt.physics.materials import (
    MATERIALS,
    PIC151,
    PZT_4,
    PZT_5A,
    PZT_5H,
    material,
    poled_ceramic,
)
from piezo_opt.physics.stack import Stack

__all__ = [
    "MATERIALS",
    "PIC151",
    "PZT_4",
    "PZT_5A",
    "PZT_5H",
    "VACUUM",
    "Bimorph",
    "Expected",
    "Material",
    "Stack",
    "Wiring",
    "actuator",
    "material",
    "open_sensor",
    "poled_ceramic",
    "sensor",
    "strain_form",
    "stress_form",
]
