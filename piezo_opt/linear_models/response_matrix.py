"""Matrix of frequency responses of several drives and axes: noise and distortion with it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.measurement import AxesCampaign, AxesRecord, FloatArray
from piezo_opt.measurement.arrays import ComplexArray
from piezo_opt.units import show

SCHEMA: Final = "piezo_opt.response_matrix/1"
_EXCITED: Final = 1e-2
"""Share of the strongest line above which a line counts as excited, as for a single axis."""
_SURE: Final = 0.1
"""Relative standard deviation of a smoothed standard deviation, for weights: n complex samples
give one of 1 / (2 sqrt(n)), and weights off by a tenth cost a hundredth of the variance."""


@final
@dataclass(frozen=True, eq=False)
class Spectra:
    """Fourier coefficients of the mean period at the excited lines, by realisation.

    A line of amplitude a has |X| = a.

    Attributes:
        frequency: (K,) [Hz].
        drives: (K, D, R) [drive_unit].
        positions: (K, A, R) [position_unit].
        noise: (K, A, A) covariance of one realisation's mean period from noise; NaN with one
            period.
        amplitude: (D,) rms of the drives.
        periods: P.
        silent: (A,) share of the reading's rms at lines that no drive excites.
    """

    frequency: FloatArray
    drives: ComplexArray
    positions: ComplexArray
    noise: ComplexArray
    amplitude: FloatArray
    periods: int
    silent: FloatArray

    @staticmethod
    def of(records: AxesRecord | Iterable[AxesRecord] | AxesCampaign) -> Spectra:
        """Of realisations of one level.

        Raises:
            InputError: a record without a period.
        """
        campaign = AxesCampaign.of(records)
        folded = [one.folded() for one in campaign]
        first = campaign.records[0]
        samples = folded[0][0].shape[1]
        u = [np.fft.rfft(drives, axis=1) * (2.0 / samples) for drives, _ in folded]
        y = [np.fft.rfft(positions, axis=1) * (2.0 / samples) for _, positions in folded]
        mean_u = np.stack([one.mean(axis=0) for one in u], axis=-1)
        mean_y = np.stack([one.mean(axis=0) for one in y], axis=-1)
        size = np.sqrt(np.mean(np.abs(mean_u) ** 2, axis=(1, 2)))
        size[0] = 0.0
        excited = size > _EXCITED * size.max()
        if not excited.any():
            raise InputError("no drive moves: there is nothing to respond to")
        lines, axes = size.size, mean_y.shape[1]
        noise = np.full((lines, axes, axes), np.nan, dtype=np.complex128)
        periods = min(one.shape[0] for one in y)
        if periods > 1:
            noise = np.mean([_covariance(one) / one.shape[0] for one in y], axis=0)
        power = np.sum(np.abs(mean_y[1:]) ** 2, axis=(0, 2))
        quiet = np.sum(np.abs(mean_y[1:][~excited[1:]]) ** 2, axis=(0, 2))
        frequency = np.fft.rfftfreq(samples, 1.0 / first.rate)
        return Spectra(
            np.asarray(frequency[excited]), mean_u[excited], mean_y[excited],
            np.asarray(noise[excited]), campaign.amplitude, periods, np.sqrt(quiet / power),
        )  # fmt: skip

    @property
    def realisations(self) -> int:
        """R."""
        return int(self.drives.shape[2])

    @property
    def gram(self) -> ComplexArray:
        """(K, D, D) sum_r U U^H."""
        return np.asarray(self.drives @ _hermitian(self.drives))

    def least_squares(self) -> ComplexArray:
        """(K, A, D) the response that leaves least of the positions, line by line.

        Raises:
            InputError: drives that cannot be told apart at some line.
        """
        gram = self.gram
        if self.realisations < self.drives.shape[1]:
            raise InputError(
                f"{self.realisations} realisations cannot tell {self.drives.shape[1]} drives "
                "apart: record at least as many as there are drives"
            )
        with np.errstate(all="ignore"):
            condition = np.linalg.cond(gram)
        if not bool(np.all(condition < 1.0 / np.sqrt(np.finfo(np.float64).eps))):
            worst = float(self.frequency[int(np.argmax(np.nan_to_num(condition, nan=np.inf)))])
            raise InputError(
                f"the drives move together at {show(worst, 'Hz')} in every realisation, so their "
                "shares cannot be told apart: use orthogonal or independent random phases"
            )
        return np.asarray(self.positions @ _hermitian(self.drives) @ np.linalg.inv(gram))

    def total(self) -> ComplexArray:
        """(K, A, A) covariance of one realisation's position from noise and distortion.

        C = 1 / (R - D) sum_r (Y_r - G U_r) (Y_r - G U_r)^H, NaN without a realisation to spare.
        """
        spare = self.realisations - self.drives.shape[1]
        if spare < 1:
            return np.full_like(self.noise, np.nan)
        left = self.positions - self.least_squares() @ self.drives
        return np.asarray(left @ _hermitian(left) / spare)

    def sigma(self) -> FloatArray:
        """(K, A) smooth standard deviation of one realisation's position, for weights.

        From the total covariance, else from the noise, else one for all lines; its variance is
        averaged over as many lines as make it sure to `_SURE`.
        """
        spare = self.realisations - self.drives.shape[1]
        total = self.total() if spare > 0 else self.noise
        free = spare if spare > 0 else self.realisations * (self.periods - 1)
        variance = np.real(np.einsum("kaa->ka", total))
        if not np.isfinite(variance).all():
            return np.ones(variance.shape)
        wide = max(1, min(len(variance), round(1.0 / (4.0 * _SURE**2 * free)) | 1))
        smooth = np.stack([_averaged(one, wide) for one in variance.T], axis=1)
        scale = np.mean(np.abs(self.positions) ** 2, axis=(0, 2))
        return np.asarray(np.sqrt(np.maximum(smooth, np.finfo(np.float64).eps * scale)))


@final
@dataclass(frozen=True, eq=False)
class ResponseMatrix:
    """Best linear approximation of every axis to every drive, and what is not linear.

    Attributes:
        frequency: (K,) excited lines [Hz].
        response: (K, A, D) G [position_unit / drive_unit].
        noise: (K, A, D) standard deviation of G from noise alone; NaN with a single period.
        total: (K, A, D) from noise and the draw of the phases; NaN without spare realisations.
        distortion: (K, A) standard deviation of one realisation's position from distortion alone
            [position_unit].
        noise_of_reading: (K, A) the same from noise, of the mean period [position_unit].
        reading: (K, A) rms over the realisations of the position's lines [position_unit].
        amplitude: (D,) rms of the drives [drive_unit].
        periods, realisations: P and R.
        units: drive_unit and position_unit.
    """

    frequency: FloatArray
    response: ComplexArray
    noise: FloatArray
    total: FloatArray
    distortion: FloatArray
    noise_of_reading: FloatArray
    reading: FloatArray
    amplitude: FloatArray
    periods: int
    realisations: int
    units: tuple[str, str]

    def shares(self) -> tuple[FloatArray, FloatArray]:
        """(A,) distortion and (A,) noise of one realisation over the reading, rms of all lines."""
        size = np.sqrt(np.sum(self.reading**2, axis=0))
        return (
            np.asarray(np.sqrt(np.sum(self.distortion**2, axis=0)) / size),
            np.asarray(np.sqrt(np.sum(self.noise_of_reading**2, axis=0)) / size),
        )

    def __str__(self) -> str:
        drive = self.units[0]
        distortion, noise = self.shares()
        pieces = [
            f"{self.response.shape[2]} drives of "
            f"{', '.join(show(float(a), drive) for a in self.amplitude)} rms, "
            f"{self.response.shape[1]} axes, {self.frequency.size} lines from "
            f"{show(float(self.frequency[0]), 'Hz')} to {show(float(self.frequency[-1]), 'Hz')}, "
            f"{self.realisations} realisations of {self.periods} periods.",
            "axis  distortion %  noise %   of the reading, one realisation",
        ]
        pieces += [
            f"{k + 1:>4}  {100.0 * d:>12.2f}  {100.0 * n:>7.2f}"
            for k, (d, n) in enumerate(zip(distortion, noise, strict=True))
        ]
        return "\n".join(pieces)

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units."""
        return {
            "schema": SCHEMA,
            "drive_unit": self.units[0],
            "position_unit": self.units[1],
            "amplitude": self.amplitude.tolist(),
            "periods": self.periods,
            "realisations": self.realisations,
            "frequency": self.frequency.tolist(),
            "real": self.response.real.tolist(),
            "imaginary": self.response.imag.tolist(),
            "noise": self.noise.tolist(),
            "total": self.total.tolist(),
            "distortion_of_reading": self.distortion.tolist(),
            "noise_of_reading": self.noise_of_reading.tolist(),
        }


def response_matrix(records: AxesRecord | Iterable[AxesRecord] | AxesCampaign) -> ResponseMatrix:
    """Best linear approximation of R realisations of P steady periods with D drives at once.

        Y_r = G U_r + E_r,   G = (sum_r Y_r U_r^H) (sum_r U_r U_r^H)^-1
        C_noise = mean_r cov_p(Y_rp) / P,   C_total = sum_r E_r E_r^H / (R - D)
        C_distortion = C_total - C_noise, its diagonal at least 0
        cov(vec G) = (sum_r U_r U_r^H)^-T kron C

    with U and Y the spectra of the mean period. Orthogonal phases make U U^H a multiple of the
    unit matrix, which gives the smallest variance, but are not needed.

    Args:
        records: realisations of one amplitude, with a period.

    Raises:
        InputError: no period, fewer realisations than drives, drives that move together, or
            records of several amplitudes.

    Source: Pintelon & Schoukens (2012), System Identification: A Frequency Domain Approach, 2nd
    ed., sec. 2.7 and 4.3; Dobrowiecki & Schoukens (2007), Automatica 43, 1488-1495.
    """
    campaign = AxesCampaign.of(records)
    if len(campaign.levels) > 1:
        raise InputError(
            f"the records have {len(campaign.levels)} amplitudes of the drives: ask for the "
            "response of one of campaign.levels"
        )
    spectra = Spectra.of(campaign)
    response = spectra.least_squares()
    inverse = np.real(np.einsum("kdd->kd", np.linalg.inv(spectra.gram)))
    noise = np.real(np.einsum("kaa->ka", spectra.noise))
    total = np.real(np.einsum("kaa->ka", spectra.total()))
    less = np.where(np.isfinite(noise), total - noise, total)
    first = campaign.records[0]
    return ResponseMatrix(
        spectra.frequency, response,
        np.sqrt(noise[:, :, np.newaxis] * inverse[:, np.newaxis]),
        np.sqrt(total[:, :, np.newaxis] * inverse[:, np.newaxis]),
        np.sqrt(np.maximum(less, 0.0)), np.sqrt(noise),
        np.sqrt(np.mean(np.abs(spectra.positions) ** 2, axis=2)),
        spectra.amplitude, spectra.periods, spectra.realisations,
        (first.drive_unit, first.position_unit),
    )  # fmt: skip


def _hermitian(matrix: ComplexArray) -> ComplexArray:
    return np.conj(np.swapaxes(matrix, -1, -2))


def _covariance(spectra: ComplexArray) -> ComplexArray:
    """(K, A, A) of P periods (P, K, A)."""
    left = spectra - spectra.mean(axis=0)
    return np.asarray(np.einsum("pka,pkb->kab", left, np.conj(left)) / (len(spectra) - 1))


def _averaged(values: FloatArray, wide: int) -> FloatArray:
    """(K,) running mean over an odd number of lines, fewer at the ends."""
    sums = np.concatenate([[0.0], np.cumsum(values)])
    at = np.arange(values.size)
    low, high = np.maximum(at - wide // 2, 0), np.minimum(at + wide // 2 + 1, values.size)
    return np.asarray((sums[high] - sums[low]) / (high - low))
