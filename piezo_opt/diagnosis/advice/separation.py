"""How far apart absent effects are on one drive.

Two effects i, j are

    min over shapes, sizes and starts of j of |phi_i S_perp_i - phi_j S_perp_j|

apart, and the other way round, the smaller of the two. phi_i is the size that is assumed of i,
S_perp what the fitted parameters leave of a derivative by a gate. j's memory may start anywhere
within its bounds, and what i's start could do is projected out.
"""

from __future__ import annotations

from collections.abc import Sequence

from piezo_opt.diagnosis.advice.members import Member
from piezo_opt.diagnosis.advice.memory import starts_of
from piezo_opt.diagnosis.advice.nearest import Able, complement, distance_to
from piezo_opt.diagnosis.base_point import BasePoint


def separation(point: BasePoint, members: Sequence[Member]) -> tuple[float, tuple[str, str]] | None:
    """Smallest distance [m] between what one member does and the best another can do.

    The two names come with it: whose signal it is, and who comes nearest. None where a member's
    own shapes cannot be simulated, or where there is no other.
    """
    able: list[list[Able]] = []
    for member in members:
        found = point.directions(member.effect, [member.shapes, *member.grid])
        if not found or found[0].shapes != dict(member.shapes):
            return None
        able.append([Able(d, starts_of(point, member, d.shapes)) for d in found])
    least: tuple[float, tuple[str, str]] | None = None
    for i, one in enumerate(members):
        does = one.size * able[i][0].direction.projected
        free = complement(able[i][0].starts)
        for j, other in enumerate(members):
            if one.effect.name == other.effect.name:
                continue
            apart = distance_to(free(does), other.effect, able[j], free)
            if least is None or apart < least[0]:
                least = apart, (one.effect.name, other.effect.name)
    return least
