"""Powers, exponentials and logarithms from tables, written as C.

A sub-step waits for one power a stage where the exponent of a loop is free, and ``exp(c log(y))``
by the C library is eight tenths of the whole sub-step then. With c known beforehand

    y^c = 2^(e c) m_j^c (1 + d)^c,    y = 2^e m_j (1 + d),    |d| < 1/128,

where the first two factors stand in tables that are written once a run, and the last is a binomial
series: no division, no branch, no call. Exponentials and logarithms are made of the same parts. The
error of a power is some units of the last digit for exponents up to 8 in size (1e-13 at -8), where
the result is neither above nor below 1e200 and its inverse; not a number stays not a number.

Source: Tang (1989, 1990), ACM Transactions on Mathematical Software 15(2), 144-157 and 16(4),
378-400 (exponential and logarithm from tables and short polynomials).
"""

from __future__ import annotations

import math
from typing import Final

_CELLS: Final = 64
"""Cells of the mantissa; the lines below take its first six bits."""
_INVERSE: Final = tuple(1.0 / (1.0 + (j + 0.5) / _CELLS) for j in range(_CELLS))


def _array(name: str, numbers: tuple[float, ...]) -> str:
    return f"static const double {name}[{len(numbers)}] = {{{', '.join(map(repr, numbers))}}};\n"


POWERS: Final = (
    "#include <stdint.h>\n#include <string.h>\n"
    + _array("po_inverse", _INVERSE)
    + _array("po_log_middle", tuple(-math.log(one) for one in _INVERSE))
    + _array("po_roots", tuple(2.0 ** (j / _CELLS) for j in range(_CELLS)))
    + """\
typedef struct { double high[65], low[32], middle[64], series[8]; } po_powers;

/* Tables of y^c: 2^(32 c (i - 32)), 2^(c i), powers of the cells' middles, binomials. */
static po_powers po_powers_of(const double c)
{
    po_powers t;
    for (int i = 0; i < 65; ++i) t.high[i] = exp2(c * (32 * (i - 32)));
    for (int i = 0; i < 32; ++i) t.low[i] = exp2(c * i);
    for (int i = 0; i < 64; ++i) t.middle[i] = exp(c * po_log_middle[i]);
    t.series[0] = 1.0;
    for (int k = 1; k < 8; ++k) t.series[k] = t.series[k - 1] * (c - (k - 1)) / k;
    return t;
}

/* y = 2^(e - 1023) (1 + d) / po_inverse[j] */
static inline double po_parts(const double y, int *const e, int *const j)
{
    uint64_t bits;
    double m;
    memcpy(&bits, &y, 8);
    *e = (int)(bits >> 52) & 2047;
    *j = (int)(bits >> 46) & 63;
    bits = (bits & 0xfffffffffffffu) | 0x3ff0000000000000u;
    memcpy(&m, &bits, 8);
    return m * po_inverse[*j] - 1.0;
}

/* y^c of a y that is positive and normal. */
static inline double po_power(const double y, const po_powers *const t)
{
    int e, j;
    const double d = po_parts(y, &e, &j), *const b = t->series;
    /* What is not finite is not lost. */
    const double whole = t->high[(e + 1) >> 5] * t->low[(e + 1) & 31] * t->middle[j] + 0.0 * y;
    const double d2 = d * d;
    const double part = ((b[0] + b[1] * d) + d2 * (b[2] + b[3] * d))
        + d2 * d2 * ((b[4] + b[5] * d) + d2 * (b[6] + b[7] * d));
    return whole * part;
}

/* log y of a y that is positive and normal, to 1e-16 and not to its last digit near 1. */
static inline double po_log(const double y)
{
    int e, j;
    const double d = po_parts(y, &e, &j), d2 = d * d;
    const double part = d2 * ((-1.0 / 2 + d * (1.0 / 3)) + d2 * ((-1.0 / 4 + d * (1.0 / 5))
        + d2 * (-1.0 / 6 + d * (1.0 / 7))));
    return ((e - 1023) * 0.6931471805599453 + po_log_middle[j]) + (d + part) + 0.0 * y;
}

/* exp x; overflows above 709 and ends at 1e-308 below. */
static inline double po_exp(const double x)
{
    const double within = x < -708.0 ? -708.0 : x > 709.0 ? 709.0 : x;
    /* The nearest 64th of a power of two, as the last bits of a large number. */
    const double shifted = within * 92.332482616893656 + 0x1.8p52, k = shifted - 0x1.8p52;
    const double r = (within - k * 0x1.62e42fefa0000p-7) - k * 0x1.cf79abc9e3b39p-46;
    uint64_t bits, root;
    memcpy(&bits, &shifted, 8);
    memcpy(&root, &po_roots[bits & 63], 8);
    root += (uint64_t)((int64_t)(bits << 12) >> 18) << 52;
    double whole;
    memcpy(&whole, &root, 8);
    const double r2 = r * r;
    const double part = (r + r2 * (0.5 + r * (1.0 / 6))) + r2 * r2 * (1.0 / 24 + r * (1.0 / 120));
    return x > 709.0 ? INFINITY : whole + whole * part;
}

/* tanh x, to 1e-16 and not to its last digit near 0. */
static inline double po_tanh(const double x)
{
    const double y = po_exp(-2.0 * fabs(x));
    return copysign((1.0 - y) / (1.0 + y), x);
}
"""
)
"""C text that defines ``po_powers_of``, ``po_power``, ``po_log``, ``po_exp`` and ``po_tanh``."""
