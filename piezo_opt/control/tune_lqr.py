"""State feedback and observer whose weights are tuned for a goal in time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from numpy.typing import ArrayLike

from piezo_opt.control.closed_loop import Limits
from piezo_opt.control.cost import Criterion
from piezo_opt.control.identified import Source
from piezo_opt.control.lqg import LQG
from piezo_opt.control.lqg_family import LQGFamily
from piezo_opt.control.task import task
from piezo_opt.control.tune_loop import Tuned, tune


def tune_lqr(
    plant: Source,
    reference: ArrayLike | Sequence[ArrayLike],
    *,
    period: float | str | None = None,
    values: Mapping[str, float] | None = None,
    limits: Limits | None = None,
    delay: int = 0,
    criterion: Criterion | str = Criterion.IAE,
    effort: float = 0.0,
    overshoot: float | None = None,
    drive: float | None = None,
    peak: float | None = 1.6,
    scenarios: int = 0,
    seed: int = 0,
    noise: float = 0.0,
    disturbance: ArrayLike = 0.0,
    at: float = 0.0,
    progress: Callable[[str], None] | None = None,
) -> Tuned[LQG]:
    """Choose the weights of an :class:`LQG` for given references.

    The gains are those of a linear-quadratic regulator and of a stationary Kalman filter for the
    plant linearised at a drive. What is searched are the four weights of which they are the optimum
    (of the drive and of the output's change; noise of the drive and walk of the disturbance), for
    the goal of :func:`tune_pid` on the plant itself, its loop and limits included. Derivatives are
    exact: a Lyapunov equation gives the slope of Riccati's solution.

    Args:
        plant, reference, period, values, limits, delay, criterion, effort, overshoot, drive,
        scenarios, seed, noise, disturbance, at, progress: as :func:`tune_pid` has them.
        peak: largest sensitivity peak of the linearised loop; None for none. Beyond 1.6 margins are
            still fine, and a loop that has met the limits of its drive may swing for ever.

    Raises:
        InputError: references that are none, a plant without response, a state that the reading
            does not show, or no weights for which the loop is stable.

    Source: Franklin, Powell & Workman (1998), Digital Control of Dynamic Systems, chs. 8, 9.
    """
    what = task(
        plant, reference, period=period, values=values, limits=limits, delay=delay,
        criterion=criterion, effort=effort, overshoot=overshoot, drive=drive, peak=peak,
        scenarios=scenarios, seed=seed, noise=noise, disturbance=disturbance, at=at,
    )  # fmt: skip
    return tune(what, LQGFamily, progress=progress)
