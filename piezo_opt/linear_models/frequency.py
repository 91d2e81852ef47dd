"""Frequency response of periodic records: best linear approximation, noise and distortion."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.errors import InputError
from piezo_opt.linear_models.cascade import ComplexArray
from piezo_opt.measurement import Campaign, FloatArray, Measurement
from piezo_opt.measurement.arrays import BoolArray
from piezo_opt.measurement.periods import by_period
from piezo_opt.units import show

if TYPE_CHECKING:
    import control

SCHEMA: Final = "piezo_opt.frequency_response/1"
_EXCITED: Final = 1e-2
"""Share of the strongest line above which a line counts as excited: a square wave keeps its first
hundred harmonics, and a converter of ten bits stays below it."""
_ABOVE_NOISE: Final = 5.0
"""Standard deviations of the drive's own noise that an excited line exceeds."""


@final
@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """The best linear approximation at the excited lines, and what is not linear.

    Attributes:
        frequency: (K,) excited lines [Hz].
        response: (K,) G [position_unit / drive_unit].
        noise: (K,) standard deviation of G from noise alone; NaN with a single period.
        total: (K,) standard deviation of G from noise and from the draw of the phases; NaN with
            fewer than two realisations.
        distortion: (K,) standard deviation of G of *one* realisation from distortion alone.
        even_frequency, even: (E,) unexcited even lines [Hz] and the reading there [position_unit].
        odd_frequency, odd: (O,) the same of the odd ones.
        floor: (all lines) noise of the averaged reading, line by line [position_unit].
        lines: frequencies of ``floor`` [Hz].
        periods, realisations: P and R.
        units: drive_unit and position_unit.
    """

    frequency: FloatArray
    response: ComplexArray
    noise: FloatArray
    total: FloatArray
    distortion: FloatArray
    even_frequency: FloatArray
    even: FloatArray
    odd_frequency: FloatArray
    odd: FloatArray
    floor: FloatArray
    lines: FloatArray
    periods: int
    realisations: int
    units: tuple[str, str]

    @property
    def data(self) -> control.FrequencyResponseData:
        """For python-control."""
        import control

        return control.frd(self.response, 2.0 * np.pi * self.frequency)

    @property
    def separates(self) -> bool:
        """Whether the drive left odd and even lines free, so that distortion has a parity."""
        return self.even.size > 0 and self.odd.size > 0

    def level(self, of: str) -> float:
        """Rms over its lines of "even", "odd" or "floor" [position_unit]; NaN without lines."""
        values = {"even": self.even, "odd": self.odd, "floor": self.floor}[of]
        return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")

    def __str__(self) -> str:
        drive, unit = self.units
        gain = f"{unit}/{drive}"
        pieces = [
            f"{self.frequency.size} lines from {show(float(self.frequency[0]), 'Hz')} to "
            f"{show(float(self.frequency[-1]), 'Hz')}, {self.realisations} realisations of "
            f"{self.periods} periods.",
            f"Gain {show(float(np.abs(self.response[0])), gain)} at the lowest line, largest "
            f"{show(float(np.abs(self.response).max()), gain)} at "
            f"{show(float(self.frequency[np.argmax(np.abs(self.response))]), 'Hz')}.",
        ]
        size = np.sqrt(np.mean(np.abs(self.response) ** 2))
        if np.isfinite(self.noise).all():
            share = float(np.sqrt(np.mean(self.noise**2)) / size)
            pieces.append(f"Noise of the mean response: {100.0 * share:.2g} % rms.")
        else:
            pieces.append("One period says nothing about noise.")
        if np.isfinite(self.distortion).all():
            share = float(np.sqrt(np.mean(self.distortion**2)) / size)
            pieces.append(f"Distortion of one realisation: {100.0 * share:.2g} % rms.")
        if self.separates:
            pieces.append(
                f"At the lines left free: even {show(self.level('even'), unit)}, odd "
                f"{show(self.level('odd'), unit)}, noise {show(self.level('floor'), unit)} rms a "
                "line."
            )
        else:
            pieces.append(
                "The drive leaves no odd and even lines free: even and odd distortion cannot be "
                "told apart. An odd multisine with detection lines can."
            )
        return "\n".join(pieces)

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units."""
        return {
            "schema": SCHEMA,
            "drive_unit": self.units[0],
            "position_unit": self.units[1],
            "periods": self.periods,
            "realisations": self.realisations,
            "frequency": self.frequency.tolist(),
            "real": self.response.real.tolist(),
            "imaginary": self.response.imag.tolist(),
            "noise": self.noise.tolist(),
            "total": self.total.tolist(),
            "distortion": self.distortion.tolist(),
            "even_frequency": self.even_frequency.tolist(),
            "even": self.even.tolist(),
            "odd_frequency": self.odd_frequency.tolist(),
            "odd": self.odd.tolist(),
        }


def frequency_response(
    records: Measurement | Iterable[Measurement] | Campaign,
) -> FrequencyResponse:
    """Best linear approximation from R realisations of P steady periods.

        U_r, Y_r  spectra of the mean period,   G_r = Y_r / U_r,   G = mean_r G_r
        noise^2 = mean_r var_p(Y_rp - G_r U_rp) / (P |U_r|^2) / R
        total^2 = var_r(G_r) / R,   distortion^2 = R (total^2 - noise^2), at least 0

    A record without a period whose drive repeats gives its repetitions; the first of them, in which
    the system settles, is left out. Where the drive leaves lines free, what is read at even and odd
    ones is even and odd distortion.

    Args:
        records: periodic and evenly sampled; several are realisations of one kind of drive.

    Raises:
        InputError: no period, uneven sampling, or records of different periods.

    Source: Pintelon & Schoukens (2012), System Identification: A Frequency Domain Approach, 2nd
    ed., ch. 4.
    """
    several = Campaign.of(records).records
    folded = [_folded(one) for one in several]
    drives = [drive for drive, _ in folded]
    if len({one.shape[1] for one in drives}) > 1 or len({one.step for one in several}) > 1:
        raise InputError(
            "realisations of one drive have the same period and sampling rate, and these do not"
        )
    samples = drives[0].shape[1]
    u = [_spectrum(drive) for drive, _ in folded]
    y = [_spectrum(reading) for _, reading in folded]
    excited = _excited(u)
    mean_u = np.stack([one.mean(axis=0) for one in u])
    mean_y = np.stack([one.mean(axis=0) for one in y])
    each: ComplexArray = mean_y[:, excited] / mean_u[:, excited]
    response: ComplexArray = each.mean(axis=0)
    count, periods = len(several), min(one.shape[0] for one in u)
    lines = np.asarray(np.fft.rfftfreq(samples, several[0].step), dtype=np.float64)
    noise = np.full(response.size, np.nan)
    floor = np.zeros(0)
    if periods > 1:
        noise = np.sqrt(sum(_noise(*pair, excited) for pair in zip(u, y, strict=True)) / count**2)
        floor = np.sqrt(
            np.mean([one.var(axis=0, ddof=1) / one.shape[0] for one in y], axis=0)[1:] / count
        )
    total = distortion = np.full(response.size, np.nan)
    if count > 1:
        total = np.std(each, axis=0, ddof=1) / np.sqrt(count)
        less = total**2 - (noise**2 if periods > 1 else 0.0)
        distortion = np.sqrt(np.maximum(less, 0.0) * count)
    even, odd = _free(excited)
    size = np.sqrt(np.mean(np.abs(mean_y) ** 2, axis=0))
    return FrequencyResponse(
        lines[excited], response, np.asarray(noise), total, distortion,
        lines[even], size[even], lines[odd], size[odd], floor, lines[1:],
        periods, count, (several[0].drive_unit, several[0].position_unit),
    )  # fmt: skip


def _folded(record: Measurement) -> tuple[FloatArray, FloatArray]:
    """(P, samples) drive and reading of the steady periods."""
    period, startup = record.period, record.startup
    if period is None:
        again = record.repetition
        if again is None:
            raise InputError(
                f"{record.name}: neither has a period nor repeats its drive, and a frequency "
                "response needs one: give the period, or fit a transfer function"
            )
        period = again * record.step
        startup = max(startup, period)
        if len(record) < 2 * again:
            raise InputError(f"{record.name}: the drive repeats only once: record more periods")
    clock = record.clock
    made = [
        by_period(record.name, clock, values, startup=startup, period=period)
        for values in (record.drive, record.position)
    ]
    return made[0], made[1]


def _spectrum(periods: FloatArray) -> NDArray[np.complex128]:
    """(P, lines) amplitudes: a line of amplitude a gives |X| = a."""
    made: ComplexArray = np.fft.rfft(periods, axis=1) * (2.0 / periods.shape[1])
    return made


def _excited(spectra: list[NDArray[np.complex128]]) -> BoolArray:
    """(lines,) whether a line of the drive is excited; never the mean."""
    size = np.sqrt(np.mean([np.abs(one.mean(axis=0)) ** 2 for one in spectra], axis=0))
    size[0] = 0.0
    noise = np.zeros(size.size)
    if all(one.shape[0] > 1 for one in spectra):
        noise = np.sqrt(
            np.mean([one.var(axis=0, ddof=1) / one.shape[0] for one in spectra], axis=0)
        )
    found: BoolArray = (size > _EXCITED * size.max()) & (size > _ABOVE_NOISE * noise)
    return found


def _noise(u: NDArray[np.complex128], y: NDArray[np.complex128], excited: BoolArray) -> FloatArray:
    """Variance of one realisation's G from noise."""
    drive, reading = u[:, excited], y[:, excited]
    gain = reading.mean(axis=0) / drive.mean(axis=0)
    left = reading - gain * drive
    count = u.shape[0]
    spread = np.var(left, axis=0, ddof=1) / count
    return np.asarray(spread / np.abs(drive.mean(axis=0)) ** 2)


def _free(excited: BoolArray) -> tuple[BoolArray, BoolArray]:
    """Unexcited even and odd lines up to the last excited one, where only odd ones are excited."""
    index = np.arange(excited.size)
    none = np.zeros_like(excited)
    if not excited.any() or bool(np.any(excited & (index % 2 == 0))):
        return none, none
    inside = (index > 0) & (index <= int(index[excited][-1])) & ~excited
    return inside & (index % 2 == 0), inside & (index % 2 == 1)
