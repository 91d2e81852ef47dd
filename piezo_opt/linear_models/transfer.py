"""A fitted transfer function: numbers with their intervals, errors, and what to doubt."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, final

import numpy as np
from numpy.polynomial import polynomial

from piezo_opt.comparison import Metrics, Misfit, Whiteness, whiteness
from piezo_opt.comparison.metrics import measure
from piezo_opt.linear_models.cascade import ComplexArray
from piezo_opt.linear_models.judging import least
from piezo_opt.linear_models.question import LinearQuestion
from piezo_opt.linear_models.reduction import Reduced, truncate
from piezo_opt.linear_models.refining import Poles
from piezo_opt.linear_models.remarks import remarks
from piezo_opt.linear_models.responses import Prepared, Scale, columns
from piezo_opt.measurement import Campaign, FloatArray, Measurement
from piezo_opt.units import show

if TYPE_CHECKING:
    import control

SCHEMA: Final = "piezo_opt.linear_model/1"
_STEP: Final = 1e-40
"""Complex step: its square is below rounding, so that the derivative is exact to rounding."""


@final
@dataclass(frozen=True, eq=False)
class TransferFit:
    """What :func:`fit_transfer` found.

        G(s) = (b_m s^m + ... + b_0) / (s^n + a_(n-1) s^(n-1) + ... + a_0)

    Attributes:
        question: what was asked.
        poles_found: the poles as the fit knows them.
        numerator: (m + 1,) falling powers of s, [position_unit / drive_unit s^(k - n)].
        denominator: (n + 1,) falling powers, monic.
        covariance: (m + 1 + n,) square, of numerator and of the denominator without its 1; of a
            white error, sigma^2 (J' J)^-1 with exact J.
        sigma: standard deviation of the error [position_unit], with N - d degrees of freedom.
        misfits: the error on each record.
    """

    question: LinearQuestion
    poles_found: Poles
    numerator: FloatArray
    denominator: FloatArray
    covariance: FloatArray
    sigma: float
    misfits: tuple[Misfit, ...] = field(repr=False)

    @cached_property
    def transfer(self) -> control.TransferFunction:
        """The model for python-control, drive [V] to reading [m]."""
        import control

        return control.tf(self.numerator, self.denominator, inputs="drive", outputs="reading")

    @cached_property
    def poles(self) -> ComplexArray:
        """(n,) [1/s], slowest first."""
        return _in_order(self.poles_found.cascade.poles(self.poles_found.p))

    @cached_property
    def zeros(self) -> ComplexArray:
        """(m,) [1/s], slowest first."""
        return _in_order(polynomial.polyroots(self.numerator[::-1]).astype(np.complex128))

    @cached_property
    def pole_sigma(self) -> FloatArray:
        """(n, 2) standard deviations of real and imaginary part [1/s]."""
        m = self.question.zeros + 1
        inner = self.covariance[m:, m:]
        return _root_sigma(self.poles, self.denominator, inner, monic=True)

    @cached_property
    def zero_sigma(self) -> FloatArray:
        """(m, 2) standard deviations of real and imaginary part [1/s]."""
        m = self.question.zeros + 1
        return _root_sigma(self.zeros, self.numerator, self.covariance[:m, :m], monic=False)

    @property
    def numerator_sigma(self) -> FloatArray:
        """(m + 1,) standard deviations."""
        return np.asarray(np.sqrt(np.diag(self.covariance)[: self.question.zeros + 1]))

    @property
    def denominator_sigma(self) -> FloatArray:
        """(n + 1,) standard deviations; 0 for the leading 1."""
        own = np.sqrt(np.diag(self.covariance)[self.question.zeros + 1 :])
        return np.concatenate([[0.0], own])

    @property
    def dc_gain(self) -> float:
        """G(0) [position_unit / drive_unit]."""
        return float(self.numerator[-1] / self.denominator[-1])

    @property
    def dc_gain_sigma(self) -> float:
        """Standard deviation of :attr:`dc_gain`."""
        slope = np.zeros(self.covariance.shape[0])
        slope[self.question.zeros] = 1.0 / self.denominator[-1]
        slope[-1] = -self.dc_gain / self.denominator[-1]
        return float(np.sqrt(slope @ self.covariance @ slope))

    @cached_property
    def metrics(self) -> Metrics:
        """Fit %, MSE, FPE and others on the records fitted to."""
        return measure(self.misfits, self.question.unknowns, held_out=False)

    @cached_property
    def whiteness(self) -> tuple[Whiteness, ...]:
        """Residual tests, one for each record."""
        return tuple(whiteness(one) for one in self.misfits)

    @cached_property
    def remarks(self) -> tuple[str, ...]:
        """What to doubt, in sentences."""
        return remarks(self)

    def reduced(self, poles: int) -> Reduced:
        """Fewer poles for the same model, by balanced truncation; the gain at rest is kept.

        Raises:
            InputError: the model is unstable, or has fewer poles.
        """
        first = self.question.records.records[0]
        unit = f"{first.position_unit}/{first.drive_unit}"
        return truncate(self.transfer, poles, keep_gain=True, unit=unit)

    def on(self, records: Measurement | Iterable[Measurement] | Campaign) -> tuple[Misfit, ...]:
        """The model on other records; start and offset alone are estimated there."""
        return predicted(self, records)

    def __str__(self) -> str:
        from piezo_opt.linear_models.telling import told

        return told(self)

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units."""
        records = self.question.records.records
        return {
            "schema": SCHEMA,
            "records": [one.name for one in records],
            "drive_unit": records[0].drive_unit,
            "position_unit": records[0].position_unit,
            "between": [one.between.value for one in records],
            "start": self.question.start.value,
            "detrend": self.question.detrend.value,
            "stable": self.question.stable,
            "numerator": self.numerator.tolist(),
            "numerator_sigma": self.numerator_sigma.tolist(),
            "denominator": self.denominator.tolist(),
            "denominator_sigma": self.denominator_sigma.tolist(),
            "poles": [[x.real, x.imag] for x in self.poles],
            "pole_sigma": self.pole_sigma.tolist(),
            "zeros": [[x.real, x.imag] for x in self.zeros],
            "zero_sigma": self.zero_sigma.tolist(),
            "dc_gain": self.dc_gain,
            "dc_gain_sigma": self.dc_gain_sigma,
            "metrics": self.metrics.to_dict(),
            "remarks": list(self.remarks),
        }


def result(question: LinearQuestion, found: Poles, scale: Scale) -> TransferFit:
    """Polynomials, covariance and errors in SI units from the scaled optimum."""
    cascade, p, point = found.cascade, found.p, found.point
    gain = scale.reading / scale.drive
    n, m = question.poles, question.zeros
    beta = np.concatenate([p, point.weights])

    def polynomials(values: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        own, weights = values[:n], values[n:]
        all_weights = np.zeros(n, dtype=values.dtype)
        chosen = list(cascade.by_degree[: min(m + 1, n)])
        all_weights[chosen] = weights[: len(chosen)]
        through = weights[-1] if m == n else 0.0
        top = cascade.numerator(own, all_weights, through)[: m + 1][::-1] * gain
        return np.concatenate([top, cascade.denominator(own)[:-1][::-1]])

    slope = np.empty((m + 1 + n, beta.size))
    for k in range(beta.size):
        moved = beta.astype(np.complex128)
        moved[k] += 1j * _STEP
        slope[:, k] = polynomials(moved).imag / _STEP
    values = polynomials(beta).real
    freedom = max(1, point.residual.size - question.unknowns)
    variance = point.cost / freedom
    inner = _inverse(point.jacobian)[: beta.size, : beta.size] * variance
    return TransferFit(
        question,
        found,
        values[: m + 1],
        np.concatenate([[1.0], values[m + 1 :]]),
        slope @ inner @ slope.T,
        float(np.sqrt(variance)) * scale.reading,
        _misfits(question, found, scale),
    )


def predicted(
    fit: TransferFit, records: Measurement | Iterable[Measurement] | Campaign
) -> tuple[Misfit, ...]:
    """The model on records that it has not seen: poles and numerator kept, start and offset free.

    The free part is found by least squares on the counted samples, as for a fit.
    """
    question = fit.question.on(records)
    own = Scale.of(fit.question)
    prepared = [Prepared.of(one, question, own) for one in question.records.records]
    cascade, p = fit.poles_found.cascade, fit.poles_found.p
    found = []
    for record, one in zip(question.records.records, prepared, strict=True):
        made = columns(one, cascade, p, question, slopes=False)
        forced = made.shared @ fit.poles_found.point.weights
        free = np.hstack([made.own, made.trend])
        left = one.reading - forced
        error = (left - free @ least(free[one.counted], left[one.counted])) * own.reading
        found.append(Misfit(record, record.position - error))
    return tuple(found)


def _misfits(question: LinearQuestion, found: Poles, scale: Scale) -> tuple[Misfit, ...]:
    made = []
    for record, mine in zip(question.records.records, found.point.own, strict=True):
        one = Prepared.of(record, question, scale)
        block = columns(one, found.cascade, found.p, question, slopes=False)
        modelled = block.shared @ found.point.weights
        modelled = modelled + np.hstack([block.own, block.trend]) @ mine
        made.append(Misfit(record, record.position - (one.reading - modelled) * scale.reading))
    return tuple(made)


def _inverse(jacobian: FloatArray) -> FloatArray:
    """(J' J)^-1 by a scaled singular value decomposition; blind directions become very wide."""
    size = np.linalg.norm(jacobian, axis=0)
    size[size == 0.0] = 1.0
    _, sigma, vt = np.linalg.svd(jacobian / size, full_matrices=False)
    sigma = np.maximum(sigma, sigma[0] * 1e-12)
    half = (vt.T / sigma) / size[:, None]
    return np.asarray(half @ half.T)


def _in_order(roots: ComplexArray) -> ComplexArray:
    return roots[np.lexsort((roots.imag, np.round(np.abs(roots), 9)))]


def _root_sigma(
    roots: ComplexArray, falling: FloatArray, covariance: FloatArray, *, monic: bool
) -> FloatArray:
    """(r, 2) of roots from the covariance of coefficients: dr = -sum_k s^k dc_k / P'(r)."""
    degree = falling.size - 1
    slope = polynomial.polyval(roots, polynomial.polyder(falling[::-1]))
    powers = np.arange(degree, -1, -1)[1 if monic else 0 :]
    move = -(roots[:, None] ** powers) / slope[:, None]
    real = np.einsum("ra,ab,rb->r", move.real, covariance, move.real)
    imaginary = np.einsum("ra,ab,rb->r", move.imag, covariance, move.imag)
    spread: FloatArray = np.sqrt(np.maximum(np.column_stack([real, imaginary]), 0.0))
    return spread


def half_width(fit: TransferFit) -> float:
    """Standard deviations of a 95 % interval with the fit's degrees of freedom."""
    from scipy import special

    freedom = max(1, fit.metrics.samples - fit.question.unknowns)
    return float(special.stdtrit(freedom, 0.975))


def headline(fit: TransferFit) -> Mapping[str, str]:
    """The measures of a fit as people read them."""
    unit = fit.question.records.records[0].position_unit
    return {
        "fit": f"{fit.metrics.fit_percent:.2f} %",
        "rms": show(fit.metrics.rms, unit),
        "MSE": f"{fit.metrics.mse:.4g} {unit}^2",
        "FPE": "" if fit.metrics.fpe is None else f"{fit.metrics.fpe:.4g} {unit}^2",
    }


__all__ = ["SCHEMA", "TransferFit", "half_width", "headline", "predicted", "result"]
