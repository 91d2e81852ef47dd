"""Modal models from periodic records: least squares over all axes, drives, levels and lines."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Final, final

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.linear_models.modal import ModalModel, basis, front, resonances
from piezo_opt.linear_models.modal_starting import Poles, first_delay, found_modes
from piezo_opt.linear_models.response_matrix import Spectra
from piezo_opt.measurement import AxesCampaign, AxesRecord, FloatArray
from piezo_opt.measurement.arrays import ComplexArray

_FIRST_DAMPING: Final = 1e-2
"""Of a step, over the diagonal of the normal equations."""
_CONVERGED: Final = 1e-5
"""Relative fall of the cost that ends the iteration: far below what noise makes of it, and far
above rounding."""
_REFINEMENTS: Final = 2
_TRIES: Final = 8
_STEP: Final = 5.0
"""Factor of the damping of a step, down after a good one and up after a bad one."""


@final
@dataclass(frozen=True, eq=False)
class ModalFit:
    """A model and how the fit ended.

    Attributes:
        model: what was found.
        cost: weighted sum of squares.
        iterations: steps taken.
        converged: whether nothing was left to gain.
        interrupted: whether Ctrl-C or a limit of time ended it: the best so far.
    """

    model: ModalModel
    cost: float
    iterations: int
    converged: bool
    interrupted: bool


@final
@dataclass(frozen=True, eq=False)
class Level:
    """What the fit needs of the realisations of one amplitude.

    Attributes:
        s: (K,) [1/s].
        drives: (K, D, R) U.
        positions: (K, A, R) Y.
        gram: (K, D, D) sum_r U U^H.
        power: (A,) sum over lines and realisations of |Y|^2 / sigma^2.
        weight: (K, A) 1 / sigma.
        amplitude: rms of a drive.
    """

    s: ComplexArray
    drives: ComplexArray
    positions: ComplexArray
    gram: ComplexArray
    power: FloatArray
    weight: FloatArray
    amplitude: float

    @staticmethod
    def of(spectra: Spectra) -> Level:
        """Of the spectra of one level."""
        weight = 1.0 / spectra.sigma()
        power = np.sum(np.sum(np.abs(spectra.positions) ** 2, axis=2) * weight**2, axis=0)
        return Level(
            np.asarray(2j * np.pi * spectra.frequency), spectra.drives,
            spectra.positions, spectra.gram, np.asarray(power), weight,
            float(np.sqrt(np.mean(spectra.amplitude**2))),
        )  # fmt: skip


@final
@dataclass(frozen=True, eq=False)
class Unknowns:
    """Everything that is not linear, as one vector p.

    log a_k; tau F; then for each level log w_m and log zeta_m, and for each level but the middle
    one Re g_d, Im g_d and tau_d F, with F the highest angular frequency: all of order one.
    """

    real: int
    modes: int
    drives: int
    levels: int
    fastest: float

    @property
    def middle(self) -> int:
        """The level whose gains are one and whose lags are none."""
        return self.levels // 2

    @property
    def size(self) -> int:
        """Length of p."""
        return self.real + 1 + 2 * self.modes * self.levels + 3 * self.drives * (self.levels - 1)

    def modes_of(self, level: int) -> int:
        """Where the modes of a level begin in p."""
        return self.real + 1 + 2 * self.modes * level

    def front_of(self, level: int) -> int | None:
        """Where gains and lags of a level begin in p; None for the middle one."""
        if level == self.middle:
            return None
        before = level if level < self.middle else level - 1
        return self.modes_of(self.levels) + 3 * self.drives * before

    def start(self, poles: Poles, delay: float) -> FloatArray:
        """(n,) p with the same modes at every level."""
        p = np.zeros(self.size)
        p[: self.real] = np.log(poles.rates)
        p[self.real] = delay * self.fastest
        for level in range(self.levels):
            at = self.modes_of(level)
            p[at : at + self.modes] = np.log(poles.omega)
            p[at + self.modes : at + 2 * self.modes] = np.log(poles.zeta)
            place = self.front_of(level)
            if place is not None:
                p[place : place + self.drives] = 1.0
        return p

    def bounded(self, p: FloatArray, slowest: float) -> FloatArray:
        """p that lines from the angular frequency ``slowest``, which far apart, can tell.

        Real poles lie a decade around the lines, modes between the first line and twice the last
        one. A resonance narrower than the distance of lines, 2 zeta w < slowest, is not seen, nor
        one above the last line whose band does not reach it; one with zeta over ten is two real
        poles.
        """
        held = p.copy()
        low = np.log(0.1 * slowest)
        held[: self.real] = np.clip(held[: self.real], low, np.log(10.0 * self.fastest))
        held[self.real] = max(held[self.real], 0.0)
        for level in range(self.levels):
            at = self.modes_of(level)
            omega = np.clip(held[at : at + self.modes], np.log(slowest), np.log(2.0 * self.fastest))
            held[at : at + self.modes] = omega
            zeta = slice(at + self.modes, at + 2 * self.modes)
            beyond = np.maximum(1.0 - self.fastest * np.exp(-omega), 0.0)
            floor = np.log(np.maximum(0.5 * slowest * np.exp(-omega), beyond))
            held[zeta] = np.clip(held[zeta], floor, np.log(10.0))
        return held

    def at(self, p: FloatArray, level: int) -> Parts:
        """What p says of a level."""
        at, place = self.modes_of(level), self.front_of(level)
        gain = np.ones(self.drives, dtype=np.complex128)
        lag = np.zeros(self.drives)
        if place is not None:
            d = self.drives
            gain = p[place : place + d] + 1j * p[place + d : place + 2 * d]
            lag = p[place + 2 * d : place + 3 * d] / self.fastest
        return Parts(
            np.exp(p[: self.real]), np.exp(p[at : at + self.modes]),
            np.exp(p[at + self.modes : at + 2 * self.modes]), float(p[self.real]) / self.fastest,
            gain, lag,
        )  # fmt: skip


@final
@dataclass(frozen=True, eq=False)
class Parts:
    """Rates, modes, delay, gains and lags of one level."""

    rates: FloatArray
    omega: FloatArray
    zeta: FloatArray
    delay: float
    gain: ComplexArray
    lag: FloatArray


@final
@dataclass(frozen=True, eq=False)
class Solved:
    """The best residues at given p.

    Attributes:
        cost: weighted sum of squares.
        residues: (b, A, D).
        hessian: (n, n) of p alone, the residues following; Gauss-Newton.
        gradient: (n,) descent direction's right side, -d cost / d p / 2.
    """

    cost: float
    residues: FloatArray
    hessian: FloatArray
    gradient: FloatArray


def fit_modes(
    records: AxesRecord | Iterable[AxesRecord] | AxesCampaign,
    modes: int,
    *,
    real: int = 2,
    pooled: bool = False,
    start: ModalModel | None = None,
    iterations: int = 60,
    progress: Callable[[str], None] | None = None,
) -> ModalFit:
    """One modal model of all realisations and amplitudes.

    Least squares of what the model leaves of the positions' spectra,

        sum_l sum_r sum_k sum_a |Y_a - (G_l U)_a|^2 / sigma_la(k)^2,

    sigma the smooth standard deviation of noise and distortion. At given poles, delays and gains
    the residues are linear and are solved for; the others move by Levenberg-Marquardt with exact
    derivatives from the modes that vector fitting finds at the middle amplitude.

    Args:
        records: realisations with a period; several amplitudes give tables over amplitude.
        modes: n.
        real: number of real poles, for creep and amplifier.
        pooled: one linear model for all amplitudes.
        start: a model of these orders to go on from.
        iterations: at most.
        progress: told what goes on. Ctrl-C gives the best so far.

    Raises:
        InputError: too few realisations, orders that the lines cannot tell, a wrong start.

    Source: Golub & Pereyra (1973), SIAM J. Numer. Anal. 10, 413-432; Kaufman (1975), BIT 15, 49-57;
    Pintelon & Schoukens (2012), ch. 9.
    """
    campaign = AxesCampaign.of(records)
    first = campaign.records[0]
    spectra = [Spectra.of(one) for one in campaign.levels]
    if modes < 0 or real < 0 or modes + real == 0:
        raise InputError(f"{modes} modes and {real} real poles are no model: give at least one")
    lines = spectra[0].frequency.size
    if 4 * (real + 2 * modes + 1) > lines:
        raise InputError(
            f"{modes} modes and {real} real poles have {real + 2 * modes + 1} shapes, and there "
            f"are {lines} lines: ask for fewer modes, a quarter as many shapes as lines at most"
        )
    levels = [Level.of(one) for one in spectra]
    groups = [0] * len(levels) if pooled else list(range(len(levels)))
    unknowns = Unknowns(
        real, modes, first.drives.shape[1], 1 + max(groups),
        2.0 * np.pi * float(spectra[0].frequency[-1]),
    )  # fmt: skip
    if start is None:
        p = unknowns.start(*_begun(spectra[len(spectra) // 2], first.rate, real, modes))
    else:
        p = _from_model(start, unknowns)
    slowest = 2.0 * np.pi * float(spectra[0].frequency[0])
    way = _descended(levels, groups, unknowns, p, slowest, iterations, progress)
    p, residues = way.p, way.solved.residues
    amplitudes = [
        float(np.sqrt(np.mean([o.amplitude**2 for o, g in zip(levels, groups, strict=True)
                               if g == level])))
        for level in range(unknowns.levels)
    ]  # fmt: skip
    parts = [unknowns.at(p, level) for level in range(unknowns.levels)]
    order = np.argsort(parts[unknowns.middle].omega)
    places = np.concatenate([real + np.ravel([2 * order, 2 * order + 1], order="F"), [-1]])
    model = ModalModel(
        np.array(amplitudes), parts[0].rates,
        np.stack([one.omega[order] for one in parts]) / (2.0 * np.pi),
        np.stack([one.zeta[order] for one in parts]), parts[0].delay,
        np.stack([one.gain for one in parts]), np.stack([one.lag for one in parts]),
        np.concatenate([residues[:real], residues[places]]),
        (first.drive_unit, first.position_unit),
    )  # fmt: skip
    return ModalFit(model, way.solved.cost, way.iterations, way.converged, way.interrupted)


def _begun(spectra: Spectra, rate: float, real: int, modes: int) -> tuple[Poles, float]:
    response = spectra.least_squares()
    lines, axes, drives = response.shape
    elements = response.reshape(lines, axes * drives)
    delay = first_delay(spectra.frequency, elements, rate)
    advanced = elements * np.exp(2j * np.pi * spectra.frequency * delay)[:, np.newaxis]
    sigma = np.repeat(spectra.sigma(), drives, axis=1)
    return found_modes(spectra.frequency, advanced, sigma, real, modes), delay


def _from_model(model: ModalModel, unknowns: Unknowns) -> FloatArray:
    if model.rates.size != unknowns.real or model.modes != unknowns.modes:
        raise InputError(
            f"a start with {model.modes} modes and {model.rates.size} real poles is none for "
            f"{unknowns.modes} and {unknowns.real}: give one with the same"
        )
    same = len(model.amplitudes) == unknowns.levels
    middle = len(model.amplitudes) // 2
    poles = Poles(model.rates, 2.0 * np.pi * model.frequencies[middle], model.damping[middle])
    p = unknowns.start(poles, model.delay)
    for level in range(unknowns.levels if same else 0):
        at, place = unknowns.modes_of(level), unknowns.front_of(level)
        p[at : at + model.modes] = np.log(2.0 * np.pi * model.frequencies[level])
        p[at + model.modes : at + 2 * model.modes] = np.log(model.damping[level])
        if place is not None:
            p[place : place + 3 * model.drives] = np.concatenate(
                [model.gains[level].real, model.gains[level].imag,
                 model.lags[level] * unknowns.fastest]
            )  # fmt: skip
    return p


@final
@dataclass(frozen=True, eq=False)
class Way:
    """Where the descent is."""

    p: FloatArray
    solved: Solved
    iterations: int = 0
    converged: bool = False
    interrupted: bool = False


def _descended(
    levels: list[Level],
    groups: list[int],
    unknowns: Unknowns,
    p: FloatArray,
    slowest: float,
    iterations: int,
    progress: Callable[[str], None] | None,
) -> Way:
    """Levenberg-Marquardt on p; the residues follow."""
    p = unknowns.bounded(p, slowest)
    way = Way(p, _solved(levels, groups, unknowns, p, slopes=True))
    damping = _FIRST_DAMPING
    try:
        for iteration in range(iterations):
            if progress is not None:
                share = np.sqrt(way.solved.cost / sum(float(one.power.sum()) for one in levels))
                progress(
                    f"{unknowns.modes} modes, iteration {iteration + 1}, weighted error "
                    f"{100.0 * share:.3f} %"
                )
            here = way.solved
            scale = np.sqrt(np.maximum(np.diag(here.hessian), 0.0))
            scale[scale == 0.0] = 1.0
            matrix = here.hessian / np.outer(scale, scale)
            for _ in range(_TRIES):
                lifted = matrix + damping * np.eye(p.size)
                step = np.linalg.solve(lifted, here.gradient / scale) / scale
                p = unknowns.bounded(way.p + step, slowest)
                there = _solved(levels, groups, unknowns, p, slopes=False)
                if there.cost < here.cost:
                    break
                damping *= _STEP
            else:
                return replace(way, converged=True)
            damping /= _STEP
            way = Way(p, _solved(levels, groups, unknowns, p, slopes=True), iteration + 1)
            if here.cost - there.cost < _CONVERGED * here.cost:
                return replace(way, converged=True)
    except KeyboardInterrupt:
        return replace(way, interrupted=True)
    return way


def _solved(
    levels: list[Level], groups: list[int], unknowns: Unknowns, p: FloatArray, *, slopes: bool
) -> Solved:
    """Residues, cost and the reduced normal equations at p."""
    drives = unknowns.drives
    shapes = unknowns.real + 2 * unknowns.modes + 1
    axes = levels[0].positions.shape[1]
    normal = np.zeros((axes, shapes * drives, shapes * drives))
    made = []
    for level, group in zip(levels, groups, strict=True):
        parts = unknowns.at(p, group)
        phi = basis(level.s, parts.rates, parts.omega, parts.zeta)
        ahead = front(level.s, parts.gain, parts.delay + parts.lag)
        made.append((parts, phi, ahead))
        _add_normal(normal, phi, ahead, level)
    inverse = np.zeros_like(normal)
    for axis in range(axes):
        scale = np.sqrt(np.diag(normal[axis]))
        scale[scale == 0.0] = 1.0
        # Directions that rounding alone gives are left out.
        inverse[axis] = np.linalg.pinv(
            normal[axis] / np.outer(scale, scale),
            rcond=scale.size * np.finfo(np.float64).eps, hermitian=True,
        ) / np.outer(scale, scale)  # fmt: skip
    residues = np.zeros((shapes, axes, drives))
    # Normal equations see half the digits; what is left over, met again, gives the others.
    for _ in range(_REFINEMENTS):
        met = np.zeros((axes, shapes * drives))
        for level, (_parts, phi, ahead) in zip(levels, made, strict=True):
            met += _met(level, phi, ahead, _left(level, phi, ahead, residues))
        step = np.einsum("aij,aj->ai", inverse, met)
        residues += step.reshape(axes, shapes, drives).swapaxes(0, 1)
    left = [
        _left(level, phi, ahead, residues)
        for level, (_parts, phi, ahead) in zip(levels, made, strict=True)
    ]
    cost = sum(
        float(np.sum(np.abs(one * level.weight[:, :, np.newaxis]) ** 2))
        for one, level in zip(left, levels, strict=True)
    )
    if not slopes:
        return Solved(cost, residues, np.zeros((0, 0)), np.zeros(0))
    hessian, gradient = np.zeros((p.size, p.size)), np.zeros(p.size)
    coupling = np.zeros((axes, p.size, shapes * drives))
    for level, group, (parts, phi, ahead), rest in zip(levels, groups, made, left, strict=True):
        _add_slopes(
            hessian, gradient, coupling, level, unknowns, group, parts, phi, ahead, residues, rest
        )
    for axis in range(axes):
        hessian -= coupling[axis] @ inverse[axis] @ coupling[axis].T
    return Solved(cost, residues, hessian, gradient)


def _left(
    level: Level, phi: ComplexArray, ahead: ComplexArray, residues: FloatArray
) -> ComplexArray:
    """(K, A, R) positions that are left over."""
    response = np.tensordot(phi, residues, axes=1) * ahead[:, np.newaxis]
    return np.asarray(level.positions - response @ level.drives)


def _met(level: Level, phi: ComplexArray, ahead: ComplexArray, left: ComplexArray) -> FloatArray:
    """(A, shapes D) inner products of the columns with what is left over."""
    driven = np.conj(ahead[:, :, np.newaxis] * level.drives)
    seen = np.einsum("kar,kdr->kad", left, driven) * level.weight[:, :, np.newaxis] ** 2
    found = [np.real(np.conj(phi).T @ seen[:, a]).reshape(-1) for a in range(seen.shape[1])]
    return np.stack(found)


def _add_normal(normal: FloatArray, phi: ComplexArray, ahead: ComplexArray, level: Level) -> None:
    """Adds inner products of the columns phi_n e_j: re sum_k w^2 conj(phi_n) phi_m M_mj."""
    grams = ahead[:, :, np.newaxis] * level.gram * np.conj(ahead[:, np.newaxis])
    shapes, drives = phi.shape[1], grams.shape[1]
    for axis in range(normal.shape[0]):
        square = level.weight[:, axis] ** 2
        block = normal[axis].reshape(shapes, drives, shapes, drives)
        for i in range(drives):
            for j in range(drives):
                inner = np.conj(phi).T @ (phi * (square * grams[:, i, j])[:, np.newaxis])
                # The row is the conjugated column: drive j of n, drive i of m.
                block[:, j, :, i] += inner.real


def _add_slopes(
    hessian: FloatArray,
    gradient: FloatArray,
    coupling: FloatArray,
    level: Level,
    unknowns: Unknowns,
    group: int,
    parts: Parts,
    phi: ComplexArray,
    ahead: ComplexArray,
    residues: FloatArray,
    left: ComplexArray,
) -> None:
    """Adds a level's inner products of derivatives by p with each other, the residual, and phi."""
    places, slopes = _slopes(level.s, unknowns, group, parts, phi, ahead, residues)
    seen = np.einsum("kar,kdr->kad", left, np.conj(level.drives))
    ahead_gram = level.gram * np.conj(ahead[:, np.newaxis])
    for axis in range(residues.shape[1]):
        square = (level.weight[:, axis] ** 2)[:, np.newaxis]
        own = slopes[:, :, axis]
        through = np.einsum("pkd,kde->pke", own, level.gram) * square
        flat = own.reshape(len(own), -1)
        hessian[np.ix_(places, places)] += np.real(through.reshape(len(own), -1) @ np.conj(flat).T)
        gradient[places] += np.real(np.conj(flat) @ (seen[:, axis] * square).reshape(-1))
        met = np.einsum("pkd,kde->pke", own, ahead_gram) * square
        inner = np.stack(
            [np.real(met[:, :, j] @ np.conj(phi)) for j in range(unknowns.drives)], axis=2
        )
        coupling[axis][places] += inner.reshape(len(own), -1)


def _slopes(
    s: ComplexArray,
    unknowns: Unknowns,
    group: int,
    parts: Parts,
    phi: ComplexArray,
    ahead: ComplexArray,
    residues: FloatArray,
) -> tuple[list[int], ComplexArray]:
    """Places in p, and (q, K, A, D) derivatives of a level's response by them."""
    at = s[:, np.newaxis]
    real, modes, drives = unknowns.real, unknowns.modes, unknowns.drives
    before = ahead[:, np.newaxis]
    response = np.tensordot(phi, residues, axes=1) * before
    places: list[int] = []
    made: list[ComplexArray] = []

    def add(place: int, slope: ComplexArray) -> None:
        places.append(place)
        made.append(slope)

    for k in range(real):
        # a / (s + a) by log a: a s / (s + a)^2
        shape = phi[:, k] * s / (s + parts.rates[k])
        add(k, shape[:, np.newaxis, np.newaxis] * residues[k] * before)
    add(real, -(at / unknowns.fastest)[:, np.newaxis] * response)
    omega, zeta = parts.omega, parts.zeta
    modal = resonances(s, omega, zeta)
    # H by log w: H (2 - (2 zeta w s + 2 w^2) H / w^2);  H by log zeta: -2 zeta s H^2 / w
    by_omega = modal * (2.0 - 2.0 * (zeta * at / omega + 1.0) * modal)
    by_zeta = -2.0 * zeta * at / omega * modal**2
    start = unknowns.modes_of(group)
    for m in range(modes):
        a, b = residues[real + 2 * m], residues[real + 2 * m + 1]
        over = at[:, :, np.newaxis] / omega[m]
        h, dw, dz = (
            one[:, m, np.newaxis, np.newaxis] for one in (modal, by_omega, by_zeta)
        )  # fmt: skip
        add(start + m, (dw * a + (dw - h) * over * b) * before)
        add(start + modes + m, dz * (a + over * b) * before)
    place = unknowns.front_of(group)
    if place is not None:
        for d in range(drives):
            only = np.zeros_like(response)
            only[:, :, d] = response[:, :, d]
            add(place + d, only / parts.gain[d])
            add(place + drives + d, 1j * only / parts.gain[d])
            add(place + 2 * drives + d, -(at / unknowns.fastest)[:, np.newaxis] * only)
    return places, np.stack(made)
