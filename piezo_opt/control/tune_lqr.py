"""State feedback and observer whose weights are tuned for a goal in time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from numpy.typing import ArrayLike

from piezo_opt.control.closed_loop import Limits
from piezo_opt.control.cost import Criterion
from piezo_opt.control.identified import Source
from piezo_opt.control.lqg import LQG
from piezo_opt.control.lqg_family import LQGFamily
from piezo_opt.control.tune_loop import Tuned, task, tune


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
        plant: a fit, the JSON of one, or a model with ``values``. A delay in it is rounded up to
            whole periods.
        reference: (N,) [m], one value a period, or several of them; a measured record's position
            will do.
        period: of the sampling [s]; that of the record unless given.
        values: SI values by full name, which go before those of the plant.
        limits: of the drive.
        delay: whole periods that computing takes.
        criterion: "iae", "ise" or "itae".
        effort: weight of the drive's moves.
        overshoot: most of it, as a share of each reference's last step.
        drive: highest drive that is used [V], below the limit at which it is cut off.
        peak: largest sensitivity peak of the linearised loop; None for none.
        scenarios: draws from the fit's covariance over which cost and constraints are taken; 0 for
            the fit's own values alone.
        seed: of the draws, and of the noise.
        noise: standard deviation of the sensor [m].
        disturbance: added to the position [m], (N,) or one value.
        at: drive around which the loop is linearised for the peak [V].
        progress: told how it goes.

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
