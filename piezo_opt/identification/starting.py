"""Starting values found from the record: gain, loop, resonance, and one-step sizes of effects.

The stroke per volt, the strength of the loop and the offset enter the reading (nearly) linearly,
so for every trial of the shape parameters they follow from one linear least-squares step on exact
sensitivities (variable projection; Golub & Pereyra 2003, Inverse Problems 19(2), R1-R26). What is
searched over is small: the width of the loop, and the resonance, whose cost has many local minima
and whose candidates come from the spectrum.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.effects.model import Model
from piezo_opt.identification.monitor import Monitor
from piezo_opt.identification.objective import ENOUGH_A_SAMPLE, Objective
from piezo_opt.identification.problem import Identification, Start
from piezo_opt.identification.shapes import resonances, shape_grid
from piezo_opt.identification.solvers.levenberg_marquardt import LevenbergMarquardt
from piezo_opt.identification.stretch import busiest
from piezo_opt.identification.unknowns import Unknowns, theta_of, unknowns
from piezo_opt.measurement import Measurement
from piezo_opt.simulation import INITIAL
from piezo_opt.values import Values

FloatArray = NDArray[np.float64]

_WIDTHS = (1.0, 3.0, 10.0)
"""Trial widths of the loop, times one over the drive's range."""
_ROUNDNESSES = (0.0, -1.0, 0.8)
"""Trial roundnesses, as a share of the width."""
_DAMPINGS = (0.1, 0.02, 0.5)
_ROUGH = 1e-3
"""Error of the scheme that trials may have, as a share of the reading's range."""
_LIKELIEST, _FEWEST = 5, 64
"""Natural frequencies of a grid that are simulated, and samples from which spectra tell which."""
_STIFFER = 1.2
"""Power left beside the likeliest natural frequency, over that left without mechanics, beyond which
the actuator is stiffer than the record can show."""
_STRETCH = 2500
"""Samples that are enough to choose a resonance by."""
_LOOPED, _TURNED = 20_000, 0.5
"""The same for the width of a loop, if the drive goes up and down by so much of its range there."""
_FOLLOWED = 4
"""Trials that are followed by a few Gauss-Newton steps."""
_TELLING = 12
"""Steps that tell another minimum from a slow way to the same one."""
_BETTER = 0.98
"""Cost over that of a fit up to which another start leads to a better one: half a percent of rms
is within what a fit that ended early has left."""
_CHEAP = 1000
"""Samples up to which several trials are followed by a few Gauss-Newton steps."""


@final
@dataclass(frozen=True, eq=False)
class _Trial:
    cost: float
    theta: FloatArray


def starting_values(
    question: Identification, monitor: Monitor, base: Mapping[str, float] | None = None
) -> Values:
    """A value for every parameter: the user's own where given, found from the records elsewhere.

    Args:
        question: what is asked.
        monitor: counts the simulations.
        base: values found before of the same question without its optional effects.

    Raises:
        InputError, ModelError: as the simulation does.
    """
    model = question.model
    declared = model.parameters
    start = dict(Values.nominal(model))
    start.update({k: v for k, v in question.values.items() if isinstance(v, float)})
    start.update({k: v for k, v in question.fixed.items() if isinstance(v, float)})
    record = question.campaign.records[0]
    given = set(question.values) | set(question.fixed)
    settled = {k for k, p in declared.items() if p.fixed and k not in question.free} | given
    gain, offset = record.line
    for name, p in declared.items():
        if name in settled:
            continue
        if p.per_record and p.unit == "m":
            start[name] = offset
        elif p.unit == "m/V":
            start[name] = gain
    structural = [n for n, e in model if e.structural]
    shapes = [
        n for n in declared
        if n not in settled and n.split(".")[0] in structural and declared[n].unit == "1/V"
        and declared[n].bounds[0] >= 0.0
    ]  # fmt: skip
    frequencies = [
        n for n in declared
        if n not in settled and n.split(".")[0] in structural and declared[n].unit == "rad/s"
    ]  # fmt: skip
    gates = [name for name, gate in model.gates.items() if gate not in settled]
    if not shapes and not frequencies and not gates:
        return Values(start)

    if base is None:
        start.update(_base_start(question, start, settled, shapes, frequencies, monitor))
    else:
        start.update(base)
    for name in gates:
        start.update(_scan_gate(question, name, start, monitor))
    return Values(start)


def _base_start(
    question: Identification,
    begin: Mapping[str, float],
    settled: Collection[str],
    shapes: Sequence[str],
    frequencies: Sequence[str],
    monitor: Monitor,
) -> dict[str, float]:
    """The start with the structural effects' gains, loop and resonance found from the record."""
    start, model = dict(begin), question.model
    declared, record = model.parameters, question.campaign.records[0]
    gain, _ = record.line
    swing = float(np.ptp(record.drive)) or 1.0
    # Gains that the drive multiplies are no longer gains of a line once there is a loop.
    for name in declared:
        if (
            name.endswith(".alpha")
            and name.split(".")[0] == (model.loop or "")
            and (name not in settled)
        ):
            start[name] = 0.2 * gain
    structural = Model(tuple((n, e) for n, e in model.named if e.structural))
    calm = question.with_model(structural if len(structural) else model)
    if frequencies:
        search = _Search(_stretch(_light(calm)), monitor)
        quiet = _without_motion(calm)
        residual = record.position - record.position.mean()
        if quiet is not None:
            still = _Search(_light(quiet), monitor)
            found = _loop_start(still, start, shapes, swing, monitor)
            residual = still.misfit(found)
            start.update(found)
        dampings = [
            n for n in declared
            if n not in settled and n == frequencies[0].rpartition(".")[0] + ".zeta"
        ]  # fmt: skip
        best = _scan_resonance(
            search, start, frequencies[0], dampings, resonances(record, residual), {}
        )
    else:
        best = _loop_start(_Search(_light(calm), monitor), start, shapes, swing, monitor)
    return {**start, **best}


def _loop_start(
    whole: _Search,
    start: dict[str, float],
    shapes: Sequence[str],
    swing: float,
    monitor: Monitor,
) -> dict[str, float]:
    """The widths of the loop that suit the record, by a stretch of it where that shows the loop."""
    question = whole.question
    record = question.campaign.records[0]
    known = [name for name in shapes if name in question.model.parameters]
    drive = (part := busiest(record, _LOOPED)).drive
    risen = float((drive - np.minimum.accumulate(drive)).max())
    fallen = float((np.maximum.accumulate(drive) - drive).max())
    shown = min(risen, fallen) >= _TURNED * swing
    if part is record or not shown or question.start_of(record) is not Start.FREE:
        return _scan_widths(whole, start, known, swing)
    brief = _Search(replace(question, records=part), monitor)
    # What was before the stretch is not what was before the record.
    return {
        name: value
        for name, value in _scan_widths(brief, start, known, swing).items()
        if not name.startswith(INITIAL)
    }


def another_start(question: Identification, values: Values, residual: FloatArray) -> Values | None:
    """Where a fit that may be stuck could go on; None where no other start leads below it.

    Tried are the loop's widths and roundnesses at the resonance of the fit, and the resonances that
    its residual and the response suggest with its loop. The likeliest are followed for some steps.

    Args:
        question: of the fit.
        values: where it ended.
        residual: measured minus modelled on all samples of the first record [m].
    """
    record, loop = question.campaign.records[0], question.model.loop
    search = _Search(_light(question), Monitor(()))
    here = dict(values)
    begun: list[dict[str, float]] = []
    if loop is not None and search.free(f"{loop}.beta") and search.free(f"{loop}.gamma"):
        wide = {f"{loop}.alpha": 0.2 * record.line[0]}
        wide = {k: v for k, v in wide.items() if search.free(k)}
        for width in np.divide(_WIDTHS, float(np.ptp(record.drive)) or 1.0).tolist():
            for share in _ROUNDNESSES:
                shape = {f"{loop}.beta": width, f"{loop}.gamma": share * width}
                begun.append({**here, **wide, **shape})
    for name, effect in question.model:
        moves = any(s.position for s in effect.declared_states.values())
        if moves and search.free(f"{name}.omega"):
            begun += [{**here, f"{name}.omega": w} for w in resonances(record, residual)]
    trials = sorted((search.trial(one) for one in begun), key=lambda pair: pair[0])[:_FOLLOWED]
    ends = [search.followed(found, iterations=_TELLING) for _, found in trials]
    cost, best = min(ends, key=lambda pair: pair[0], default=(np.inf, here))
    return Values(best) if cost < _BETTER * search.trial(here)[0] else None


def resonance_start(
    question: Identification,
    values: Mapping[str, float],
    residual: FloatArray,
    mechanics: str,
    softness: Mapping[str, float],
) -> Values | None:
    """Where to begin when mechanics join a quasi-static fit; None where nothing can begin.

    Nothing can where no trial can be simulated, or where even the stiffest mechanics that the
    record could show would round off what it does show.

    Args:
        question: with the mechanics.
        values: of the quasi-static fit.
        residual: measured minus modelled on the counted samples of the first record [m].
        mechanics: name of the second order in the model.
        softness: strengths of forces over omega^2, by name: what they do where nothing resonates
            they do with every omega.
    """
    light = _light(question)
    record = light.campaign.records[0]
    grid = (np.geomspace(0.1, 0.9, 14) * np.pi / record.step).tolist()
    candidates = _likeliest(record, residual, resonances(record, residual), grid)
    if not candidates:
        return None
    search = _Search(light, Monitor(()))
    start = {**Values.nominal(question.model), **values}
    best = _scan_resonance(
        search, start, f"{mechanics}.omega", [f"{mechanics}.zeta"], candidates, softness
    )
    if best == start:
        return None
    return Values({**start, **best})


def _likeliest(
    record: Measurement, residual: FloatArray, peaks: list[float], grid: list[float]
) -> list[float]:
    """Peaks, and the natural frequencies of a grid that explain most of a residual.

    By the spectra; all where time is uneven, and none where even the likeliest leaves far more than
    no mechanics do. Mechanics behind a quasi-static model make nearly g G Y of its reading's
    spectrum Y,

        G = 1 / (1 - (f / f_0)^2 + 2 i zeta f / f_0)

    with a gain g that follows.
    """
    n = residual.size
    if not record.uniform or n < _FEWEST:
        return [*peaks, *grid]
    window = np.hanning(n)
    reading = record.position[record.counted] - residual
    line = np.linspace(reading[0], reading[-1], n)
    answer, left = (np.fft.rfft(window * x)[1:] for x in (reading - line, residual))
    turn = 2.0 * np.pi * np.fft.rfftfreq(n, record.step)[1:]
    whole = answer + left

    def unexplained(omega: float) -> float:
        share = turn / omega
        moved = answer / (1.0 - share**2 + 2.0j * _DAMPINGS[0] * share)
        power = float(np.vdot(moved, moved).real) or 1.0
        rest = whole - float(np.vdot(moved, whole).real) / power * moved
        return float(np.vdot(rest, rest).real)

    beside = {omega: unexplained(omega) for omega in (*peaks, *grid)}
    if min(beside.values()) > _STIFFER * unexplained(np.inf):
        return []
    return [*peaks, *sorted(grid, key=lambda omega: beside[omega])[:_LIKELIEST]]


def _light(question: Identification) -> Identification:
    """The question about its first record only: enough for a start."""
    first = question.campaign.records[0]
    return replace(question, records=first, weights=(), priors={}, noise=None)


def _stretch(question: Identification) -> Identification:
    """The question about the stretch in which most happens: enough for a resonance.

    Only where the states at the start are free: a stretch begins with what was before it.
    """
    record = question.campaign.records[0]
    if len(record) <= 1.5 * _STRETCH or question.start_of(record) is not Start.FREE:
        return question
    return replace(question, records=busiest(record, _STRETCH))


def _without_motion(question: Identification) -> Identification | None:
    """The same question with quasi-static mechanics, where the model allows it."""
    model = question.model
    movers = [n for n, e in model if any(s.position for s in e.declared_states.values())]
    left = Model(tuple((n, e) for n, e in model.named if n not in movers))
    if not movers or len(left) == 0 or any("motion" in e.requires for _, e in left):
        return None
    return question.with_model(left)


@final
class _Search:
    """Linear steps on exact sensitivities from trial values of the shapes."""

    def __init__(self, question: Identification, monitor: Monitor) -> None:
        self.question = question
        self._monitor = monitor
        self._objective: Objective | None = None
        self._unknowns: Unknowns | None = None
        self._linear_of: dict[tuple[str, ...], NDArray[np.intp]] = {}

    def _ready(self, start: dict[str, float]) -> tuple[Objective, Unknowns]:
        if self._objective is None or self._unknowns is None:
            self._unknowns = unknowns(self.question, Values(start))
            at = theta_of(self._unknowns, start)
            self._objective = Objective(
                self.question, self._unknowns, at, self._monitor, _ROUGH, most=ENOUGH_A_SAMPLE,
                exact=True,
            )  # fmt: skip
        return self._objective, self._unknowns

    def trial(
        self,
        start: dict[str, float],
        extra: Sequence[str] = (),
        worst: float = np.inf,
    ) -> tuple[float, dict[str, float]]:
        """Cost and values after one linear step, or at the start if the step is worse.

        A step that would not lead below the cost ``worst`` is not simulated. Sub-steps are those
        that the first trial chose.
        """
        objective, unknown = self._ready(start)
        theta = theta_of(unknown, start)
        point = objective.linearised(theta)
        cost = objective.cost_at(point)
        # Sub-steps are those of the first trial: a stiffer one diverges, and is no candidate.
        if not np.isfinite(cost) or not point.usable:
            return float("inf"), start
        step = np.zeros(theta.size)
        linear = self._linear(unknown, extra)
        slope, bend = point.normal
        step[linear] = _linear_step(bend[linear[:, None], linear], slope[linear])
        if worst < np.inf and min(cost, objective.foreseen(point, step)) >= worst:
            return cost, start
        moved = unknown.clip(theta + step)
        after = objective.cost(objective.residual(moved, most=min(cost, worst)))
        if after < cost:
            theta, cost = moved, after
        return cost, dict(unknown.values(theta))

    def _linear(self, unknown: Unknowns, extra: Sequence[str]) -> NDArray[np.intp]:
        """Places of the unknowns that enter the reading (nearly) linearly."""
        key = tuple(extra)
        if key not in self._linear_of:
            declared = self.question.model.parameters
            self._linear_of[key] = np.flatnonzero([
                m.name.startswith("initial.") or m.name in extra
                or declared[m.local].unit in ("m/V", "m")
                for m in unknown.members
            ])  # fmt: skip
        return self._linear_of[key]

    @property
    def samples(self) -> int:
        """Samples of the record."""
        return len(self.question.campaign.records[0])

    def free(self, name: str) -> bool:
        """Whether a parameter of the model is an unknown without a given start."""
        declared = self.question.model.parameters.get(name)
        if declared is None or name in self.question.fixed or name in self.question.values:
            return False
        return not declared.fixed or name in self.question.free

    def followed(
        self, start: dict[str, float], iterations: int = 4
    ) -> tuple[float, dict[str, float]]:
        """Cost and values after some Gauss-Newton steps in all unknowns."""
        objective, unknown = self._ready(start)
        solution = LevenbergMarquardt(iterations=iterations, tolerance=1e-4).minimise(
            objective, theta_of(unknown, start)
        )
        cost = objective.cost(objective.residual(solution.theta))
        return cost, dict(unknown.values(solution.theta))

    def misfit(self, start: dict[str, float]) -> FloatArray:
        """Measured minus modelled on all samples of the first record."""
        objective, unknown = self._ready(start)
        reading = objective.readings(theta_of(unknown, start))[0]
        return np.asarray(self.question.campaign.records[0].position - reading)


def _linear_step(bend: FloatArray, slope: FloatArray) -> FloatArray:
    """The step to the minimum of a quadratic with this matrix (k, k) and gradient (k,).

    A touch of ridge keeps directions that the record cannot see where they are.
    """
    norms = np.sqrt(bend.diagonal())
    norms = np.where(norms == 0.0, 1.0, norms)
    normal = bend / (norms[:, None] * norms)
    normal.flat[:: slope.size + 1] += 1e-6
    return np.asarray(np.linalg.solve(normal, -slope / norms) / norms)


def _scan_widths(
    search: _Search, start: dict[str, float], widths: Sequence[str], swing: float
) -> dict[str, float]:
    """The best of a few widths and roundnesses of the loop.

    The cost has a second minimum where the loop opens instead of closing (gamma < 0). Where the
    simulation is cheap the best few trials are followed for some steps before one is chosen.
    """
    trials = [search.trial(start)]
    for name in widths:
        beside = f"{name.rpartition('.')[0]}.gamma"
        several = search.free(beside) and search.samples <= _CHEAP
        shares = _ROUNDNESSES if several else (0.0,)
        for width in _WIDTHS:
            for share in shares:
                trial = {**start, name: width / swing}
                if search.free(beside):
                    trial[beside] = share * width / swing
                trials.append(search.trial(trial))
    trials.sort(key=lambda pair: pair[0])
    if search.samples > _CHEAP or len(trials) == 1:
        return trials[0][1]
    # The best of each roundness: trials of one roundness end in the same minimum.
    sides: dict[float, dict[str, float]] = {}
    for _, found in trials:
        side = float(np.sign(found.get(f"{widths[0].rpartition('.')[0]}.gamma", 0.0)))
        sides.setdefault(side, found)
    return min((search.followed(found) for found in sides.values()), key=lambda p: p[0])[1]


def _scan_resonance(
    search: _Search,
    start: dict[str, float],
    name: str,
    dampings: list[str],
    candidates: list[float],
    softness: Mapping[str, float],
) -> dict[str, float]:
    """The best frequency at a middle damping, then the best damping there."""

    def at(omega: float, zeta: float) -> dict[str, float]:
        forces = {force: soft * omega**2 for force, soft in softness.items()}
        return {**start, **forces, name: omega, **dict.fromkeys(dampings, zeta)}

    best_cost, best = np.inf, dict(start)
    middle, *others = _DAMPINGS
    for omega in candidates:
        cost, found = search.trial(at(omega, middle), worst=best_cost)
        if cost < best_cost:
            best_cost, best = cost, found
    for zeta in others if dampings else ():
        cost, found = search.trial(at(best[name], zeta), worst=best_cost)
        if cost < best_cost:
            best_cost, best = cost, found
    return best


def _scan_gate(
    question: Identification, effect: str, start: dict[str, float], monitor: Monitor
) -> dict[str, float]:
    """One-step size of an optional effect at the best of a few shapes."""
    model = question.model
    gate = model.gates[effect]
    present = [n for n, e in model.named if e.structural or n == effect]
    lone = Model(tuple((n, e) for n, e in model.named if n in present))
    search = _Search(_light(question.with_model(lone)), monitor)
    null = lone.parameters[gate].null
    begin = {**start, gate: float(null if null is not None else 0.0)}
    record = question.campaign.records[0]
    settled = {
        n.removeprefix(f"{effect}.") for n in (*question.values, *question.fixed)
        if n.startswith(f"{effect}.")
    }  # fmt: skip
    residual = search.misfit(begin)
    best_cost, best = search.trial(begin, (gate,))
    for shapes in shape_grid(model[effect], record, residual, settled):
        trial = {**begin, **{f"{effect}.{k}": v for k, v in shapes.items()}}
        if trial == begin:  # what has no shapes is tried already, and so are the nominal ones
            continue
        cost, found = search.trial(trial, (gate,), best_cost)
        if cost < best_cost:
            best_cost, best = cost, found
    found = {k: v for k, v in best.items() if k.startswith(f"{effect}.")}
    # A gate that did not move would leave its shapes without any effect to be fitted by.
    parameter = lone.parameters[gate]
    if found.get(gate) == parameter.null:
        typical = parameter.typical or parameter.bounds
        found[gate] = 0.01 * (typical[0] + typical[1]) * 0.5
    return found
