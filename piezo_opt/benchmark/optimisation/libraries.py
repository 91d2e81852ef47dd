"""Solvers of other people's that are only there to be compared with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import numpy as np
import scipy
from numpy.typing import NDArray

from piezo_opt.errors import InputError
from piezo_opt.identification.objective import Objective
from piezo_opt.identification.outcome import Ending
from piezo_opt.identification.solvers.base import Solution
from piezo_opt.identification.solvers.box import Box
from piezo_opt.identification.solvers.scalar import WORST, ScalarCost

FloatArray = NDArray[np.float64]


@final
@dataclass(frozen=True)
class FiniteDifferences:
    """``scipy.optimize.least_squares`` without our sensitivities: what a script would do.

    Every simulation of a difference is charged.
    """

    tolerance: float = 1e-12

    @property
    def name(self) -> str:
        """Name in tables."""
        return "scipy_differences"

    def minimise(self, objective: Objective, start: FloatArray) -> Solution:
        """From a start within the bounds to a minimum."""
        unknowns = objective.unknowns
        theta = unknowns.clip(start)
        first = objective.residual(theta)
        unit = objective.rms(first) or 1.0
        scale = unknowns.scale

        def residual(at: FloatArray) -> FloatArray:
            with np.errstate(over="ignore", invalid="ignore"):
                found = objective.residual(unknowns.clip(at * scale)) / unit
            return np.where(np.isfinite(found), found, np.sqrt(WORST))

        found: Any = scipy.optimize.least_squares(
            residual, theta / scale, bounds=(unknowns.low / scale, unknowns.high / scale),
            loss=_LOSS[objective.question.loss.shape.value],
            f_scale=objective.question.loss.scale / unit, max_nfev=1000,
            ftol=self.tolerance, xtol=self.tolerance, gtol=self.tolerance,
        )  # fmt: skip
        return Solution(unknowns.clip(found.x * scale), Ending.CONVERGED, str(found.message))


_LOSS: Any = {"square": "linear", "soft_l1": "soft_l1", "huber": "huber", "cauchy": "cauchy"}


@final
@dataclass(frozen=True)
class ParticleSwarm:
    """A particle swarm (library ``pyswarm``) in a finite box around the start.

    Args:
        seed: of the random numbers.
        particles: at least ten, or five for each unknown.

    Reference: Kennedy & Eberhart (1995), Proc. ICNN'95, 1942-1948.
    """

    seed: int = 0
    particles: int = 5

    @property
    def name(self) -> str:
        """Name in tables."""
        return "particle_swarm"

    def minimise(self, objective: Objective, start: FloatArray) -> Solution:
        """From a start within the bounds to a minimum."""
        pyswarm = _library("pyswarm")
        theta = objective.unknowns.clip(start)
        box, cost = Box.around(objective, theta), ScalarCost(objective, theta)
        size = max(10, self.particles * theta.size)
        swarm = np.random.default_rng(self.seed).uniform(size=(size, theta.size))
        swarm[0] = box.inside(theta)
        found = pyswarm.pso(
            lambda at: cost(box.outside(np.asarray(at))), np.zeros(theta.size), np.ones(theta.size),
            swarmsize=size, maxiter=100_000, minstep=1e-10, minfunc=1e-14, seed=self.seed,
            omega=0.7298, phip=1.4962, phig=1.4962, init=swarm,
        )  # fmt: skip
        end = box.outside(np.asarray(found[0], dtype=float))
        return Solution(end, Ending.CONVERGED, "the swarm shrank to a point")


@final
@dataclass(frozen=True)
class Nlopt:
    """An algorithm of the library NLopt, on scaled unknowns within the bounds.

    Args:
        algorithm: its name there, ``"LN_BOBYQA"``.
        boxed: whether it searches a finite box around the start.

    Reference: Johnson (2007), The NLopt nonlinear-optimization package.
    """

    algorithm: str
    boxed: bool = False

    @property
    def name(self) -> str:
        """Name in tables."""
        return f"nlopt_{self.algorithm.split('_', 1)[1].lower()}"

    def minimise(self, objective: Objective, start: FloatArray) -> Solution:
        """From a start within the bounds to a minimum."""
        nlopt = _library("nlopt")
        unknowns, scale = objective.unknowns, objective.unknowns.scale
        theta = unknowns.clip(start)
        search = nlopt.opt(getattr(nlopt, self.algorithm), theta.size)
        if self.boxed:
            box, cost = Box.around(objective, theta), ScalarCost(objective, theta)
            low, high, begin = np.zeros(theta.size), np.ones(theta.size), box.inside(theta)
            search.set_min_objective(lambda at, _: cost(box.outside(np.array(at))))
        else:
            low, high, begin = unknowns.low / scale, unknowns.high / scale, theta / scale
            search.set_min_objective(_scaled(objective, theta, self.algorithm[1] == "D"))
            search.set_initial_step(0.1 * np.maximum(1.0, np.abs(begin)))
        search.set_lower_bounds(low)
        search.set_upper_bounds(high)
        search.set_ftol_rel(1e-14)
        search.set_xtol_rel(1e-12)
        search.set_maxeval(1_000_000)
        search.set_population(0)
        nlopt.srand(1)
        try:
            end = np.asarray(search.optimize(np.clip(begin, low, high)))
        except (nlopt.RoundoffLimited, nlopt.runtime_error) as error:
            found = objective.monitor.best
            why = str(error) or f"NLopt gave up ({type(error).__name__})"
            return Solution(theta if found is None else found, Ending.LIMIT, why)
        at = box.outside(end) if self.boxed else unknowns.clip(end * scale)
        return Solution(at, Ending.CONVERGED, "its own test of convergence is met")


def _scaled(objective: Objective, theta: FloatArray, derivatives: bool) -> Any:
    """The cost of scaled unknowns in units of the start's, as NLopt calls it."""
    unknowns = objective.unknowns
    scale = unknowns.scale
    if not derivatives:
        cost = ScalarCost(objective, theta)
        return lambda at, _: cost(unknowns.clip(np.array(at) * scale))
    unit: list[float] = []

    def both(at: FloatArray, gradient: FloatArray) -> float:
        point = objective.linearised(unknowns.clip(np.array(at) * scale))
        value = objective.cost(point.residual)
        if not unit:
            unit.append(value if 0.0 < value < np.inf else 1.0)
        robust = objective.robust(point)
        if gradient.size:
            gradient[:] = np.nan_to_num(scale * (robust.jacobian.T @ robust.residual) / unit[0])
        return float(min(value / unit[0], WORST))

    return both


def _library(name: str) -> Any:
    from importlib import import_module

    try:
        return import_module(name)
    except ImportError:
        raise InputError(
            f"The library '{name}' is not installed; pip install \"piezo_opt[bench]\" brings it."
        ) from None
