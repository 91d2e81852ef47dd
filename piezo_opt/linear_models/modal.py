"""Modal model of a stage with several drives and axes, whose effects depend on the amplitude."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.measurement import AxesRecord, FloatArray
from piezo_opt.measurement.arrays import ComplexArray
from piezo_opt.units import show

SCHEMA: Final = "piezo_opt.modal_model/1"
_SETTLED: Final = 1e-6
"""Share of a free oscillation that may be left where a record from rest ends: below any noise."""
_LONGEST: Final = 4
"""Lengths of the record that are added for it at most: a creep slower than that is a drift of it,
and its fold is a constant."""


@final
@dataclass(frozen=True, eq=False)
class ModalModel:
    """Common modes of all drives and axes; what depends on amplitude is tabled over it.

        y = G(s) diag(v) u,   v_d = g_d e^(-s (tau + tau_d))
        G(s) = sum_k R_k a_k / (s + a_k) + sum_m (A_m + B_m s / w_m) H_m(s) + D
        H_m(s) = w_m^2 / (s^2 + 2 zeta_m w_m s + w_m^2)

    Each drive has effects of its own in front of the common dynamics: a gain g_d that depends on
    its amplitude, complex because the loss of a hysteresis turns the phase at all frequencies
    alike, and a lag tau_d. The modes soften with the amplitude: w_m and zeta_m are tabled, too.
    Between the amplitudes of the table all of it moves on straight lines, and stays beyond them.
    One amplitude makes the model linear. R_k (creep, amplifier), A_m, B_m and D are (A, D).

    This is the quasi-linear description of a hysteretic stage: what it answers on average to a
    drive of that rms, not the harmonics that it adds.

    Attributes:
        amplitudes: (L,) rms of a drive [drive_unit], rising.
        rates: (r,) a_k [1/s].
        frequencies: (L, n) w_m / 2 pi [Hz].
        damping: (L, n) zeta_m [1].
        delay: tau [s].
        gains: (L, D) g_d [1].
        lags: (L, D) tau_d [s].
        residues: (r + 2 n + 1, A, D) R_k, then A_m and B_m by turns, then D
            [position_unit / drive_unit].
        units: drive_unit and position_unit.

    Source: Pintelon & Schoukens (2012), System Identification, 2nd ed., sec. 4.2 (a nonlinear
    system as a linear one at each amplitude); Ewins (2000), Modal Testing, sec. 2.
    """

    amplitudes: FloatArray
    rates: FloatArray
    frequencies: FloatArray
    damping: FloatArray
    delay: float
    gains: ComplexArray
    lags: FloatArray
    residues: FloatArray
    units: tuple[str, str] = ("V", "m")

    def __post_init__(self) -> None:
        levels, modes = self.frequencies.shape
        drives = self.residues.shape[2]
        for what, shape, expected in (
            ("amplitudes", self.amplitudes.shape, (levels,)),
            ("damping", self.damping.shape, (levels, modes)),
            ("gains", self.gains.shape, (levels, drives)),
            ("lags", self.lags.shape, (levels, drives)),
            ("residues", self.residues.shape[:1], (self.rates.size + 2 * modes + 1,)),
        ):
            if shape != expected:
                raise InputError(f"{what} of a modal model have shape {shape}, expected {expected}")
        stable = bool(np.all(self.frequencies > 0.0) and np.all(self.damping > 0.0))
        if not stable or not bool(np.all(self.rates > 0.0)):
            raise InputError("a modal model has positive frequencies, damping and rates: it decays")

    @property
    def modes(self) -> int:
        """n."""
        return int(self.frequencies.shape[1])

    @property
    def axes(self) -> int:
        """A."""
        return int(self.residues.shape[1])

    @property
    def drives(self) -> int:
        """D."""
        return int(self.residues.shape[2])

    def response(self, frequency: FloatArray, amplitude: FloatArray | None = None) -> ComplexArray:
        """(K, A, D) response at frequencies (K,) [Hz] to drives of rms (D,) [drive_unit].

        Without an amplitude that of the middle of the table.
        """
        if amplitude is None:
            amplitude = np.full(self.drives, self.amplitudes[len(self.amplitudes) // 2])
        s = np.asarray(2j * np.pi * frequency)
        whole = float(np.sqrt(np.mean(amplitude**2)))
        omega = 2.0 * np.pi * self._at(self.frequencies, whole)
        found = basis(s, self.rates, omega, self._at(self.damping, whole))
        made = np.tensordot(found, self.residues, axes=1)
        gain = np.array([self._at(self.gains, a)[d] for d, a in enumerate(amplitude)])
        lag = np.array([self._at(self.lags, a)[d] for d, a in enumerate(amplitude)])
        return np.asarray(made * front(s, gain, self.delay + lag)[:, np.newaxis])

    def _at(self, table: Any, amplitude: float) -> Any:
        """A row of a table (L, ...) between its amplitudes."""
        if len(self.amplitudes) == 1:
            return table[0]
        high = int(np.clip(np.searchsorted(self.amplitudes, amplitude), 1, len(table) - 1))
        low = high - 1
        share = (amplitude - self.amplitudes[low]) / (self.amplitudes[high] - self.amplitudes[low])
        share = float(np.clip(share, 0.0, 1.0))
        return (1.0 - share) * table[low] + share * table[high]

    def simulate(self, record: AxesRecord) -> FloatArray:
        """(N, A) positions for the drives of a record [position_unit]; its positions are not read.

        A record with a period is in its periodic steady state: exact for a drive that is
        band-limited between samples, every period from its own drive. Without a period the stage
        was at rest, at the drive's first value, before the record.

        Raises:
            InputError: another number of drives, or another unit.
        """
        if record.drives.shape[1] != self.drives or record.drive_unit != self.units[0]:
            raise InputError(
                f"{record.name}: has {record.drives.shape[1]} drives in {record.drive_unit} and the"
                f" model {self.drives} in {self.units[0]}: give the drives that it was fitted to"
            )
        if record.period is not None:
            folded, _ = record.folded()
            made = self._periodic(folded, record).reshape(-1, self.axes)
            rest = len(record) - len(made)
            return np.concatenate([made, made[:rest]]) if rest else made
        slowest = min(float(self.rates.min(initial=np.inf)), self._slowest_mode)
        wait = min(-np.log(_SETTLED) / slowest * record.rate, _LONGEST * len(record))
        moved = record.drives - record.drives[0]
        padded = np.concatenate([moved, np.zeros((int(np.ceil(wait)), self.drives))])
        made = self._periodic(padded[np.newaxis], record)[0, : len(record)]
        still = self.response(np.zeros(1), record.amplitude)[0].real @ record.drives[0]
        return np.asarray(made + still)

    @property
    def _slowest_mode(self) -> float:
        rates = 2.0 * np.pi * self.frequencies * self.damping
        return float(rates.min(initial=np.inf))

    def _periodic(self, drives: FloatArray, record: AxesRecord) -> FloatArray:
        """(P, samples, A) from (P, samples, D)."""
        samples = drives.shape[1]
        lines = np.asarray(np.fft.rfftfreq(samples, 1.0 / record.rate))
        response = self.response(lines, record.amplitude)
        answer = np.einsum("kad,pkd->pka", response, np.fft.rfft(drives, axis=1))
        return np.asarray(np.fft.irfft(answer, n=samples, axis=1))

    def __str__(self) -> str:
        levels = ", ".join(show(float(a), self.units[0]) for a in self.amplitudes)
        lines = [
            f"{self.drives} drives, {self.axes} axes, {self.modes} modes, delay "
            f"{show(self.delay, 's')}, real poles "
            f"{', '.join(show(float(a) / (2.0 * np.pi), 'Hz') for a in self.rates) or 'none'}; "
            f"at {levels} rms.",
            "mode  frequency Hz            damping %       strength",
        ]
        strength = self.strength
        for m in range(self.modes):
            hertz = " ".join(f"{f:8.1f}" for f in self.frequencies[:, m])
            share = " ".join(f"{100.0 * z:5.2f}" for z in self.damping[:, m])
            peak = show(float(strength[m]), "/".join(self.units[::-1]))
            lines.append(f"{m + 1:>4}  {hertz}   {share}   {peak}")
        if len(self.amplitudes) > 1:
            lines.append("drive  gain at these amplitudes, phase in degrees, lag in us")
            for d in range(self.drives):
                gain = " ".join(f"{abs(g):6.3f}" for g in self.gains[:, d])
                turn = " ".join(f"{np.degrees(np.angle(g)):6.2f}" for g in self.gains[:, d])
                lag = " ".join(f"{1e6 * t:6.2f}" for t in self.lags[:, d])
                lines.append(f"{d + 1:>5}  {gain}   {turn}   {lag}")
        return "\n".join(lines)

    @property
    def strength(self) -> FloatArray:
        """(n,) largest peak of each mode over axes and drives, |A_m + j B_m| / (2 zeta_m)."""
        modal = self.residues[self.rates.size : -1]
        size = np.hypot(modal[0::2], modal[1::2]).max(axis=(1, 2))
        middle = len(self.amplitudes) // 2
        return np.asarray(size / (2.0 * self.damping[middle]))

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units; `from_dict` reads it."""
        return {
            "schema": SCHEMA,
            "drive_unit": self.units[0],
            "position_unit": self.units[1],
            "amplitudes": self.amplitudes.tolist(),
            "rates": self.rates.tolist(),
            "frequencies": self.frequencies.tolist(),
            "damping": self.damping.tolist(),
            "delay": self.delay,
            "gains_real": self.gains.real.tolist(),
            "gains_imaginary": self.gains.imag.tolist(),
            "lags": self.lags.tolist(),
            "residues": self.residues.tolist(),
        }

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> ModalModel:
        """The model of `to_dict`.

        Raises:
            InputError: it is none.
        """
        if data.get("schema") != SCHEMA:
            raise InputError(f"schema {data.get('schema')!r} is no modal model, {SCHEMA!r} is")
        try:
            numbers = {
                name: np.asarray(data[name], dtype=np.float64)
                for name in (
                    *("amplitudes", "rates", "frequencies", "damping", "lags", "residues"),
                    *("gains_real", "gains_imaginary"),
                )
            }
            units = (str(data["drive_unit"]), str(data["position_unit"]))
            delay = float(data["delay"])
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"a modal model without a proper {error}: write it again") from error
        if numbers["frequencies"].ndim != 2 or numbers["residues"].ndim != 3:
            raise InputError("tables of a modal model have other dimensions: write it again")
        gains = numbers.pop("gains_real") + 1j * numbers.pop("gains_imaginary")
        return ModalModel(delay=delay, gains=gains, units=units, **numbers)


def basis(s: ComplexArray, rates: FloatArray, omega: FloatArray, zeta: FloatArray) -> ComplexArray:
    """(K, r + 2 n + 1) what the residues weigh, at s (K,) [1/s]."""
    real = rates / (s[:, np.newaxis] + rates)
    modal = resonances(s, omega, zeta)
    pairs = np.stack([modal, modal * s[:, np.newaxis] / omega], axis=2).reshape(s.size, -1)
    return np.concatenate([real, pairs, np.ones((s.size, 1))], axis=1)


def resonances(s: ComplexArray, omega: FloatArray, zeta: FloatArray) -> ComplexArray:
    """(K, n) H_m(s), 1 at rest."""
    at = s[:, np.newaxis]
    return np.asarray(omega**2 / (at**2 + 2.0 * zeta * omega * at + omega**2))


def front(s: ComplexArray, gain: ComplexArray, lag: FloatArray) -> ComplexArray:
    """(K, D) what stands in front of the dynamics; real at rest."""
    at = s[:, np.newaxis]
    return np.asarray(np.where(at == 0.0, gain.real, gain) * np.exp(-at * lag))
