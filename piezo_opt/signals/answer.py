"""A fitted model on drives that nobody has played: readings and exact derivatives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.errors import InputError, PiezoOptError
from piezo_opt.identification import Fit, Start
from piezo_opt.identification.monitor import Monitor
from piezo_opt.identification.objective import Objective
from piezo_opt.identification.problem import plain
from piezo_opt.identification.unknowns import theta_of, unknowns
from piezo_opt.measurement import Between, Measurement
from piezo_opt.simulation import INITIAL, Initial, Simulator, Substeps
from piezo_opt.simulation.accuracy import DIVERGED
from piezo_opt.values import Values

FloatArray = NDArray[np.float64]

ROUGH: Final = 1e-4
"""Error of the scheme during a search, as a share of the reading's range."""

_UNSEEN: Final = 0.5
"""Relative standard deviation above which a combination of parameters counts as not seen."""

_HALVINGS: Final = 20
"""Halvings of a step after which the fit's own values are taken: a millionth of it."""


@final
class Answer:
    """What a fitted model would read, and how that depends on what a new fit would estimate.

    The start of a new record is as unknown as that of the fitted one, unless it was at rest.
    Further channels stand at their mean.

    Args:
        fit: the fitted model.
        rate: samples a second of the drives to come [Hz].
    """

    def __init__(self, fit: Fit, rate: float) -> None:
        self.fit = fit
        self.rate = rate
        first = fit.records[0]
        self._between = Between.LINEAR if first.between is Between.BANDLIMITED else first.between
        self._means = {k: float(c.mean()) for k, c in first.channels.items()}
        values = fit.values.of_record(0)
        self.numbers: dict[str, float] = {
            k: v for k, v in values.items() if not k.startswith(INITIAL)
        }
        start = Start.REST if fit.question.start is Start.REST else None
        fixed = fit.question.fixed
        alone = {
            plain(k): v for k, v in fixed.items() if k.endswith("[0]") and not k.startswith(INITIAL)
        }
        self.question = replace(
            fit.question,
            records=replace(first, period=None, startup=0.0, allow_saturated=True),
            fixed={**fixed, **alone}, values={}, priors={}, per_record=(), weights=(), start=start,
        )  # fmt: skip
        members = unknowns(self.question, Values(self.numbers)).members
        self.names: tuple[str, ...] = tuple(m.name for m in members)
        self.scale: FloatArray = np.array([m.scale for m in members])
        self.low: FloatArray = np.array([m.low for m in members])
        self.high: FloatArray = np.array([m.high for m in members])
        self._substeps: Substeps | None = None

    @property
    def parameters(self) -> tuple[str, ...]:
        """Those of the names that are parameters shared by all records."""
        own = self.fit.model.parameters
        return tuple(n for n in self.names if n in own and not own[n].per_record)

    def asked(self, parameters: Sequence[str] | None) -> tuple[str, ...]:
        """The parameters meant, all shared ones where none are named.

        Raises:
            InputError: one is not estimated by the fit, or none is that all records share.
        """
        if parameters is None:
            if not self.parameters:
                raise InputError(
                    "the fit estimates nothing that all records share: leave a parameter free, or "
                    "name what the drive is for"
                )
            return self.parameters
        for name in parameters:
            if name not in self.names:
                raise InputError(
                    f"the fit does not estimate {name!r}: it estimates {', '.join(self.parameters)}"
                )
        if not parameters:
            raise InputError("name one parameter at least, or none at all for every one")
        return tuple(parameters)

    def record(self, values: FloatArray, position: FloatArray | None = None) -> Measurement:
        """A drive (N,) as a record, with a reading or for a simulation."""
        first = self.fit.records[0]
        count = values.size
        return Measurement(
            time=np.arange(count, dtype=np.float64) / self.rate,
            drive=values,
            position=values if position is None else position,
            channels={k: np.full(count, mean) for k, mean in self._means.items()},
            channel_units=first.channel_units,
            drive_unit=first.drive_unit,
            position_unit=first.position_unit,
            between=self._between,
            allow_saturated=True,
        )

    def settle(
        self, values: FloatArray, error: float = ROUGH, faster: Sequence[FloatArray] = ()
    ) -> Substeps:
        """Choose the sub-steps on one drive; later ones are simulated alike.

        A slow drive asks for no sub-steps as long as its own moves from sample to sample; how far
        the drive may go within one is found on the fastest of others.

        Args:
            values: the drive (N,) [unit].
            error: of the scheme, as a share of the reading's range; as in a search unless given.
            faster: drives (N,) of which the fastest is looked at.
        """
        simulator = self._simulator(values, self.numbers, None)
        self._substeps = simulator.choose(self.numbers, error).substeps
        if faster:
            fastest = max(faster, key=lambda one: float(np.abs(np.diff(one)).max(initial=0.0)))
            self._substeps = self._coarsened(fastest, self._substeps, error)
        return self._substeps

    def _coarsened(self, values: FloatArray, finest: Substeps, error: float) -> Substeps:
        """Sub-steps as long in time and as far along the drive as the error allows."""
        move = 0.25 * float(np.ptp(values))
        with np.errstate(over="ignore", invalid="ignore"):
            while move > finest.largest_move:
                coarse, fine = replace(finest, largest_move=move), 0.5 * move
                one, other = (
                    self._simulator(values, self.numbers, substeps).reading(self.numbers)
                    for substeps in (coarse, replace(coarse, largest_move=fine))
                )
                # A halving of a scheme that has corners on its way halves the error at least.
                if 2.0 * np.sqrt(np.mean((one - other) ** 2)) <= error * np.ptp(other):
                    return coarse
                move = fine
        return finest

    def reading(self, values: FloatArray, numbers: Mapping[str, float] | None = None) -> FloatArray:
        """(N,) [m] from rest, at the fit's own values unless others are given."""
        at = {**self.numbers, **(numbers or {})}
        return self._simulator(values, at, self._substeps).reading(at)

    def sharp(self, values: FloatArray, numbers: Mapping[str, float] | None = None) -> FloatArray:
        """The same, on sub-steps chosen for this drive."""
        at = {**self.numbers, **(numbers or {})}
        return self._simulator(values, at, None).reading(at)

    def derivatives(
        self, values: FloatArray, numbers: Mapping[str, float] | None = None
    ) -> tuple[FloatArray, FloatArray] | None:
        """Reading (N,) and its derivatives by all names, each times its scale (N, k) [m].

        None where the model cannot be simulated on this drive.
        """
        at = {**self.numbers, **(numbers or {})}
        try:
            reading, slopes = self._simulator(values, at, self._substeps).with_sensitivities(at)
        except (PiezoOptError, ArithmeticError):
            return None
        if not np.isfinite(reading).all() or not np.abs(slopes).max(initial=0.0) < DIVERGED:
            return None
        return reading, slopes * self.scale

    def _simulator(
        self, values: FloatArray, numbers: Mapping[str, float], substeps: Substeps | None
    ) -> Simulator:
        return Simulator(
            self.fit.model, self.record(values), numbers, directions=self.names,
            initial=Initial.REST, runtime=self.fit.question.free, substeps=substeps,
        )  # fmt: skip


def draws(answer: Answer, count: int, seed: int) -> tuple[dict[str, float], ...]:
    """Values that the fit thinks possible: its own, then pairs on either side of it.

    Drawn from the fit's normal distribution, that of starts included, cut off at two standard
    deviations, within bounds. Unknowns at a bound stay there, and so do combinations that the
    records do not see (a relative deviation above one half), along which a straight step leads out
    of what they say. A step that leads out of it all the same, by more than a straight model's two
    deviations in every direction, is halved until it does not.

    Args:
        answer: of the fit.
        count: how many, the fit's own values among them.
        seed: of the random directions.
    """
    fit, found = answer.fit, [dict[str, float]()]
    unknown = unknowns(fit.question, fit.values)
    used = np.flatnonzero(np.isfinite(np.diag(fit.covariance)))
    if count < 2 or not used.size:
        return tuple(found)
    centre, scale = theta_of(unknown, fit.values), unknown.scale[used]
    own = np.abs(centre[used])
    known = np.array([fit.names[k] in fit.model.parameters for k in used])
    size = np.where(known & (own > 1e-3 * scale), own, scale)
    block = fit.covariance[np.ix_(used, used)] / np.outer(size, size)
    variance, vectors = np.linalg.eigh(block)
    std = np.sqrt(np.maximum(variance, 0.0))
    root = size[:, None] * vectors * np.where(std < _UNSEEN, std, 0.0)
    objective = Objective(fit.question, unknown, centre, Monitor(fit.names), accuracy=fit.accuracy)
    before = np.concatenate(objective.readings(centre))
    most = 4.0 * used.size * fit.rms**2
    named = {k: plain(n) for k, n in enumerate(fit.names) if n in (plain(n), f"{plain(n)}[0]")}
    rng = np.random.default_rng(seed)
    while len(found) < count:
        step = np.zeros(centre.size)
        step[used] = root @ np.clip(rng.normal(size=used.size), -2.0, 2.0)
        for way in (1.0, -1.0):
            for share in 0.5 ** np.arange(_HALVINGS):
                moved = unknown.clip(centre + way * share * step)
                with np.errstate(over="ignore", invalid="ignore"):  # it may be beyond every number
                    change = np.concatenate(objective.readings(moved)) - before
                    far = float(change @ change)
                if far <= most:
                    break
            else:
                moved = centre
            found.append({n: float(moved[k]) for k, n in named.items() if n in answer.parameters})
    return tuple(found[:count])
