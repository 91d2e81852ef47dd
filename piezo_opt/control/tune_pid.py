"""A PID tuned on the identified actuator, as a nonlinear program."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from numpy.typing import ArrayLike

from piezo_opt.control.closed_loop import Limits
from piezo_opt.control.cost import Criterion
from piezo_opt.control.identified import Source
from piezo_opt.control.pid import PID
from piezo_opt.control.pid_family import PIDFamily
from piezo_opt.control.task import task
from piezo_opt.control.tune_loop import Tuned, tune


def tune_pid(
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
    peak: float | None = 2.0,
    scenarios: int = 0,
    seed: int = 0,
    noise: float = 0.0,
    disturbance: ArrayLike = 0.0,
    at: float = 0.0,
    start: PID | None = None,
    simplex_only: bool = False,
    progress: Callable[[str], None] | None = None,
) -> Tuned[PID]:
    """Choose kp, ki, kd and the filter's tau of a :class:`PID` for given references.

        min  mean of IAE (or ISE, ITAE) / its scale + effort * sum du^2 / (N U^2)
        with overshoot, drive and sensitivity peak of every scenario within their limits

    by single shooting through the sampled loop, with exact derivatives: computing delay, limits of
    drive and slew rate, derivative filter and anti-windup included. U is the drive that the
    reference's span takes. The logarithms of the gains are searched.

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
        start: gains to begin with; unless given the better of two that follow from the plant.
        simplex_only: Nelder-Mead on the same program, to compare with.
        progress: told how it goes.

    Raises:
        InputError: references that are none, a plant without response, or no start from which the
            loop is stable.
    """
    what = task(
        plant, reference, period=period, values=values, limits=limits, delay=delay,
        criterion=criterion, effort=effort, overshoot=overshoot, drive=drive, peak=peak,
        scenarios=scenarios, seed=seed, noise=noise, disturbance=disturbance, at=at,
    )  # fmt: skip
    return tune(what, PIDFamily, start, simplex_only=simplex_only, progress=progress)
