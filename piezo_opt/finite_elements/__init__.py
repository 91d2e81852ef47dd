"""Finite elements of piezoelectric bodies: static, modal and harmonic answers, and what follows.

Eight-node bricks with three displacements and a potential at each node, on scikit-fem's meshes and
quadrature: the extra ``piezo_opt[fem]``.
"""

from piezo_opt.finite_elements.body import Body
from piezo_opt.finite_elements.grid import Support, block, mirrored, stack, supported
from piezo_opt.finite_elements.harmonic import Harmonic, harmonic
from piezo_opt.finite_elements.modes import Modes, modes
from piezo_opt.finite_elements.ramp import ramp
from piezo_opt.finite_elements.reduced import Reduced, reduced
from piezo_opt.finite_elements.statics import Static, static
from piezo_opt.finite_elements.system import Circuit, System
from piezo_opt.finite_elements.thesis import ThesisBlock, compare_with_thesis, thesis_block
from piezo_opt.finite_elements.vtk import write_vtk

__all__ = [
    "Body",
    "Circuit",
    "Harmonic",
    "Modes",
    "Reduced",
    "Static",
    "Support",
    "System",
    "ThesisBlock",
    "block",
    "compare_with_thesis",
    "harmonic",
    "mirrored",
    "modes",
    "ramp",
    "reduced",
    "stack",
    "static",
    "supported",
    "thesis_block",
    "write_vtk",
]
