"""Inverse compensation as C, the law of :class:`piezo_opt.control.InverseCompensation`."""

from __future__ import annotations

from typing import Final

from piezo_opt.control import InverseCompensation
from piezo_opt.export.c.lacking import lacking
from piezo_opt.export.c.printer import Precision

_ROUNDS: Final = 40
"""Steps of Newton's method at most; it takes three or four. A fixed point, u = (r + h) / d_e again
and again, is slow just after a turn, where the loop is nearly as steep as the gain."""
_CLOSE: Final = {"double": 1e-15, "float": 3e-7}
"""Last step over the drive: rounding moves it by as much."""

_HEADER: Final = """\
/* {n}: the drive that a hysteretic actuator needs for a position, without an inverse model.
      u = (r + h) / d_e,   h' = alpha u' - beta |u'| h - gamma u' |h|
   Rakotondrabe (2011), IEEE Trans. Autom. Sci. Eng. 8(2), 428-431. SI units. */
#ifndef {guard}_H
#define {guard}_H

#ifdef __cplusplus
extern "C" {{
#endif

typedef struct {{
    {real} gain;                       /* stroke per volt [m/V] */
    {real} alpha;                      /* strength of the loop [m/V] */
    {real} beta;                       /* width of the loop [1/V] */
    {real} gamma;                      /* roundness of the loop [1/V] */
    {real} drive;                      /* of the last sample [V] */
    {real} loop;                       /* hysteretic displacement there [m] */
    int status;                        /* 0, or 1: limits were met, 2: no number was given */
}} {n};

/* The values of the fit, at rest without a drive. */
void {n}_init({n} *c);

/* The drive [V] within its limits [V] that brings the actuator to a position [m]. */
{real} {n}_act({n} *c, {real} reference, {real} low, {real} high);

#ifdef __cplusplus
}}
#endif

#endif
"""

_SOURCE: Final = """\
/* {n}: the drive that a hysteretic actuator needs for a position. */
#include "{n}.h"

#include <float.h>
#include <math.h>

{lacking}/* h after dh/du = alpha - rate h over a length [V]. */
static {real} {n}_relaxed({real} h, {real} alpha, {real} rate, {real} length)
{{
    if ({fabs}(rate * length) < {tiny}) return h + (alpha - rate * h) * length;
    return h - (alpha / rate - h) * {expm1}(-rate * length);
}}

/* h after the drive has moved one way to a new value, and its slope there: exact on either side of
   h = 0, where the law changes its slope. */
static {real} {n}_loop(const {n} *c, {real} drive, {real} *slope)
{{
    {real} left = drive - c->drive, h = c->loop;
    const {real} way = left < {zero} ? -{one} : {one};
    int part;
    for (part = 0; part < 2; ++part) {{
        const {real} heading = h < {zero} || h > {zero} ? h : c->alpha * left;
        const {real} side = heading < {zero} ? -{one} : {one};
        const {real} rate = c->beta * way + c->gamma * side;
        const {real} end = {n}_relaxed(h, c->alpha, rate, left);
        *slope = c->alpha - rate * end;
        if (part == 1 || end * side >= {zero}) return end;
        left -= {fabs}(rate) > {zero} ? {log1p}(-rate * h / c->alpha) / rate : -h / c->alpha;
        h = {zero};
    }}
    return h;
}}

void {n}_init({n} *c)
{{
    c->gain = {gain};
    c->alpha = {alpha};
    c->beta = {beta};
    c->gamma = {gamma};
    c->drive = {zero};
    c->loop = {zero};
    c->status = 0;
}}

{real} {n}_act({n} *c, {real} reference, {real} low, {real} high)
{{
    {real} drive = c->drive, slope = {zero};
    int i;
    for (i = 0; i < {rounds}; ++i) {{
        const {real} miss = reference + {n}_loop(c, drive, &slope) - c->gain * drive;
        const {real} steep = c->gain - slope;
        const {real} moved = miss / (steep * c->gain > {zero} ? steep : c->gain);
        drive += moved;
        if ({fabs}(moved) <= {close} * {fabs}(drive)) break;
    }}
    /* A reference that is no number has no drive: it is held. */
    c->status = {fabs}(drive) <= {largest} ? 0 : 2;
    if (c->status) drive = c->drive;
    c->status |= drive < low || drive > high;
    if (drive < low) drive = low;
    if (drive > high) drive = high;
    c->loop = {n}_loop(c, drive, &slope);
    c->drive = drive;
    return drive;
}}
"""


def inverse_compensation(
    law: InverseCompensation, name: str, precision: Precision
) -> tuple[str, str]:
    """Header and source of the law.

    Args:
        law: its numbers.
        name: prefix of every symbol.
        precision: type of the numbers.
    """
    needed = "\n".join(lacking(("expm1", "log1p"), name, precision))
    words = {
        "lacking": f"{needed}\n", "n": name, "guard": name.upper(), "real": precision.name,
        "rounds": _ROUNDS, "close": precision.number(_CLOSE[precision.name]),
        "zero": precision.number(0.0), "one": precision.number(1.0),
        "largest": "FLT_MAX" if precision.is_float else "DBL_MAX",
        "tiny": precision.number(1e-12 if precision.name == "double" else 1e-7),
        **{f: precision.call(f) for f in ("fabs", "log1p", "expm1")},
        **{k: precision.number(getattr(law, k)) for k in ("gain", "alpha", "beta", "gamma")},
    }  # fmt: skip
    return _HEADER.format(**words), _SOURCE.format(**words)
