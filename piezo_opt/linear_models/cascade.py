"""The poles of a transfer function as a chain of sections of first and second order."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import NDArray

from piezo_opt.measurement import FloatArray

ComplexArray = NDArray[np.complex128]


@final
@dataclass(frozen=True, eq=False)
class Cascade:
    """Sections in series, driven by u; each is driven by the one before it.

        second order:  w' = W v,   v' = W (u - q0 w - q1 v),    w/u = W^2 / (s^2 + q1 W s + q0 W^2)
        first order:   w' = W (u - q0 w),                       w/u = W / (s + q0 W)

    A chain stays regular where poles coincide, which a sum of partial fractions does not. From the
    back, its n states have the relative degrees n, n - 1, ..., 1: the last m + 1 of them span all
    numerators of degree m.

    Args:
        orders: (K,) 1 or 2 for each section.
        rates: (K,) reference angular frequency W of each section [1/s].
        stable: whether q = exp(p), which puts every pole into the left half plane; else q = p.

    The unknowns p are (p0, p1) of each section in turn, (p0) of one of first order.
    """

    orders: tuple[int, ...]
    rates: FloatArray
    stable: bool

    @property
    def order(self) -> int:
        """Number n of states, poles and unknowns."""
        return sum(self.orders)

    def coefficients(self, p: NDArray[np.inexact]) -> NDArray[np.inexact]:
        """(n,) q of the unknowns p."""
        return np.exp(p) if self.stable else p

    def matrices(self, p: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """x' = A x + B u: A (n, n) [1/s], B (n,) [1/s], and dA/dp (n, n, n), its last axis p."""
        n = self.order
        q = self.coefficients(p)
        slope = q if self.stable else np.ones_like(q)
        a, b, da = np.zeros((n, n)), np.zeros(n), np.zeros((n, n, n))
        at = 0
        for order, rate in zip(self.orders, self.rates, strict=True):
            driven = at + order - 1
            if order == 2:
                a[at, at + 1] = rate
            for k in range(order):
                a[driven, at + k] = -rate * q[at + k]
                da[driven, at + k, at + k] = -rate * slope[at + k]
            if at == 0:
                b[driven] = rate
            else:
                a[driven, self._output_before(at)] = rate
            at += order
        return a, b, da

    def _output_before(self, at: int) -> int:
        """Index of the output w of the section that ends before the state ``at``."""
        ends = np.cumsum(self.orders)
        k = int(np.searchsorted(ends, at))
        return at - self.orders[k]

    @property
    def by_degree(self) -> tuple[int, ...]:
        """(n,) states from the highest relative degree down to 1."""
        found: list[int] = []
        at = self.order
        for order in reversed(self.orders):
            at -= order
            found += [at] if order == 1 else [at, at + 1]
        return tuple(found)

    def denominators(self, p: NDArray[np.inexact]) -> list[NDArray[np.inexact]]:
        """Monic polynomial of each section, rising powers of s."""
        q = self.coefficients(p)
        found, at = [], 0
        for order, rate in zip(self.orders, self.rates, strict=True):
            if order == 1:
                found.append(np.array([q[at] * rate, 1.0 + 0.0 * q[at]]))
            else:
                found.append(np.array([q[at] * rate**2, q[at + 1] * rate, 1.0 + 0.0 * q[at]]))
            at += order
        return found

    def denominator(self, p: NDArray[np.inexact]) -> NDArray[np.inexact]:
        """(n + 1,) monic, rising powers of s."""
        product: NDArray[np.inexact] = np.ones(1)
        for factor in self.denominators(p):
            product = polynomial.polymul(product, factor)
        return product

    def numerator(
        self, p: NDArray[np.inexact], weights: NDArray[np.inexact], through: complex = 0.0
    ) -> NDArray[np.inexact]:
        """(n + 1,) numerator over :meth:`denominator` of sum_j weights_j x_j + through u.

        Args:
            p: (n,) unknowns.
            weights: (n,) of the states.
            through: of the drive itself.
        """
        factors = self.denominators(p)
        total: NDArray[np.inexact] = through * self.denominator(p)
        at, gain = 0, 1.0
        for k, (order, rate) in enumerate(zip(self.orders, self.rates, strict=True)):
            gain *= rate**order
            rest: NDArray[np.inexact] = np.ones(1)
            for factor in factors[k + 1 :]:
                rest = polynomial.polymul(rest, factor)
            own = (
                np.array([weights[at]])
                if order == 1
                else np.array([weights[at], weights[at + 1] / rate])
            )
            total = polynomial.polyadd(total, gain * polynomial.polymul(own, rest))
            at += order
        padded = np.zeros(self.order + 1, dtype=np.result_type(total, p))
        padded[: total.size] = total
        return padded

    def poles(self, p: FloatArray) -> ComplexArray:
        """(n,) [1/s], section by section."""
        roots = [polynomial.polyroots(factor) for factor in self.denominators(p)]
        return np.concatenate(roots).astype(np.complex128)

    def followed_by(self, order: int, rate: float) -> Cascade:
        """The same chain with one more section at its end."""
        return Cascade((*self.orders, order), np.append(self.rates, rate), self.stable)
