"""Solvers of nonlinear programs, all through CasADi: IPOPT, FATROP and an SQP method."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import FrameType
from typing import Any, Final, final

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from piezo_opt.errors import InputError, ModelError
from piezo_opt.identification.horizon import Solved
from piezo_opt.identification.outcome import Ending
from piezo_opt.identification.program import Curvature, Program, functions

FloatArray = NDArray[np.float64]
Report = Callable[[FloatArray], None]


@final
@dataclass(frozen=True)
class Ipopt:
    """Interior-point method with a sparse direct factorisation (MUMPS).

    Args:
        iterations: most iterations.
        tolerance: optimality error at convergence, in the program's own units of order one.
        curvature: ``"exact"`` Hessian, or ``"gauss_newton"``: without the curvature of residuals
            and constraints, cheaper and never indefinite, slower at the end.

    References: Waechter & Biegler (2006), Math. Program. 106(1), 25-57.
    """

    iterations: int = 500
    tolerance: float = 1e-8
    curvature: Curvature = "exact"

    def __post_init__(self) -> None:
        _check(self.name, self.iterations, self.tolerance, self.curvature)

    @property
    def name(self) -> str:
        """Name in tables."""
        return "ipopt"

    @property
    def stagewise(self) -> bool:
        """It takes any sparsity: the unknowns are shared."""
        return False

    def solve(self, program: Program, report: Report) -> Solved:
        """From the program's start to a minimum."""
        made = functions(program, self.curvature)
        watch = _Watch(program, report)
        options: dict[str, Any] = {
            "print_time": False, "ipopt.sb": "yes", "ipopt.print_level": 0,
            "ipopt.max_iter": self.iterations, "ipopt.tol": self.tolerance,
            # The program is scaled already, and a bound is a bound.
            "ipopt.nlp_scaling_method": "none", "ipopt.bound_relax_factor": 0.0,
            # A start near a bound is meant; the default would push it far inside.
            "ipopt.bound_push": 1e-4, "ipopt.bound_frac": 1e-4, "ipopt.mu_init": 1e-2,
            "show_eval_warnings": False,
            "grad_f": made.gradient, "jac_g": made.jacobian, "hess_lag": made.hessian,
            "iteration_callback": watch,
        }  # fmt: skip
        solver = ca.nlpsol("po_ipopt", "ipopt", made.problem, options)
        return _run(solver, program, watch, self.iterations, _IPOPT)


@final
@dataclass(frozen=True)
class Fatrop:
    """Interior-point method that factorises stage by stage along time.

    Every stage gets its own copy of the unknowns, as states that do not move. For multiple
    shooting; a periodic start ties the end to the beginning and is refused. It reports its start
    and its end only, not every iterate.

    When it pays: not yet. A fit of 8000 samples and 7 unknowns took 19 s against IPOPT's 5 s, most
    of it in derivatives that CasADi's interface insists on deriving itself. With stretches of 30
    samples the same record sent it into an iteration that did not end within minutes, and then
    not even Ctrl-C stops it: keep stretches short. So :class:`Ipopt` is the default.

    Args:
        iterations: most iterations.
        tolerance: optimality error at convergence, in the program's own units of order one.

    References: Vanroye, Sathya, De Schutter & Decre (2023), FATROP: A Fast Constrained Optimal
    Control Problem Solver for Robot Trajectory Optimization and Control, IROS, 10036-10043.
    """

    iterations: int = 500
    tolerance: float = 1e-8

    def __post_init__(self) -> None:
        _check(self.name, self.iterations, self.tolerance, "exact")

    @property
    def name(self) -> str:
        """Name in tables."""
        return "fatrop"

    @property
    def stagewise(self) -> bool:
        """It wants every stage to have its own copy of the unknowns."""
        return True

    def solve(self, program: Program, report: Report) -> Solved:
        """From the program's start to a minimum."""
        if not ca.has_nlpsol("fatrop"):
            raise InputError(
                "This CasADi comes without FATROP; install the casadi wheel of the package index, "
                "or take solver=Ipopt()."
            )
        stages = program.stages
        if stages is None or max(stages.controls) > 0:
            raise ModelError(
                "FATROP solves multiple shooting only (its interface would spend minutes on "
                "differentiating a collocation); take solver=Ipopt()."
            )
        options: dict[str, Any] = {
            "print_time": False, "structure_detection": "manual", "N": len(stages.states) - 1,
            "nx": list(stages.states), "nu": list(stages.controls), "ng": list(stages.others),
            "show_eval_warnings": False,
            "fatrop": {
                "print_level": 0, "max_iter": self.iterations, "tolerance": self.tolerance,
            },
        }  # fmt: skip
        solver = ca.nlpsol("po_fatrop", "fatrop", functions(program, "exact").problem, options)
        report(program.start[program.unknowns])
        return _run(solver, program, report, self.iterations, _FATROP)


@final
@dataclass(frozen=True)
class Sqp:
    """Sequential quadratic programming with a Gauss-Newton Hessian (CasADi's own).

    Its quadratic programs are solved by an active-set method with sparse QR (qrqp), which suits
    small programs: long records are for :class:`Ipopt`.

    Args:
        iterations: most iterations.
        tolerance: infeasibility and optimality error at convergence.

    References: Nocedal & Wright (2006), Numerical Optimization, 2nd ed., ch. 18.
    """

    iterations: int = 100
    tolerance: float = 1e-8

    def __post_init__(self) -> None:
        _check(self.name, self.iterations, self.tolerance, "gauss_newton")

    @property
    def name(self) -> str:
        """Name in tables."""
        return "sqp"

    @property
    def stagewise(self) -> bool:
        """It takes any sparsity: the unknowns are shared."""
        return False

    def solve(self, program: Program, report: Report) -> Solved:
        """From the program's start to a minimum."""
        made = functions(program, "gauss_newton")
        watch = _Watch(program, report)
        options: dict[str, Any] = {
            "print_time": False, "print_header": False, "print_iteration": False,
            "print_status": False, "max_iter": self.iterations, "show_eval_warnings": False,
            "tol_du": self.tolerance, "tol_pr": self.tolerance, "error_on_fail": False,
            "jac_fg": made.both, "hess_lag": made.full_hessian, "iteration_callback": watch,
            "qpsol": "qrqp",
            "qpsol_options": {
                "print_iter": False, "print_header": False, "print_info": False,
                "print_time": False, "error_on_fail": False,
            },
        }  # fmt: skip
        solver = ca.nlpsol("po_sqp", "sqpmethod", made.problem, options)
        return _run(solver, program, watch, self.iterations, _SQP)


_GOOD: Final = "optimality and constraints are met"
_START: Final = "start from other values (values={...}), tighten the bounds, or fix an unknown"

_IPOPT: Final[Mapping[object, tuple[Ending, str]]] = {
    "Solve_Succeeded": (Ending.CONVERGED, _GOOD),
    "Solved_To_Acceptable_Level": (Ending.CONVERGED, "the last digits no longer improve"),
    "Search_Direction_Becomes_Too_Small": (
        Ending.CONVERGED, "the last digits no longer improve"
    ),
    "Maximum_Iterations_Exceeded": (Ending.LIMIT, ""),
    "Infeasible_Problem_Detected": (
        Ending.FAILED, f"IPOPT found no simulation within the bounds; {_START}."
    ),
    "Restoration_Failed": (
        Ending.FAILED, f"IPOPT could not bring the stretches of the record together; {_START}."
    ),
    "Diverging_Iterates": (Ending.FAILED, f"The unknowns ran away; {_START}."),
    "Invalid_Number_Detected": (
        Ending.FAILED, f"The model is not finite at the start values; {_START}."
    ),
}  # fmt: skip
_FATROP: Final[Mapping[object, tuple[Ending, str]]] = {0: (Ending.CONVERGED, _GOOD)}
_SQP: Final[Mapping[object, tuple[Ending, str]]] = {
    "Solve_Succeeded": (Ending.CONVERGED, _GOOD),
    "Search_Direction_Becomes_Too_Small": (
        Ending.CONVERGED, "the last digits no longer improve"
    ),
    "Maximum_Iterations_Exceeded": (Ending.LIMIT, ""),
}  # fmt: skip


def _check(name: str, iterations: int, tolerance: float, curvature: str) -> None:
    if iterations < 1 or not tolerance > 0 or curvature not in ("exact", "gauss_newton"):
        raise InputError(
            f"{name}: iterations={iterations}, tolerance={tolerance}, curvature={curvature!r}; "
            "give at least one iteration, a positive tolerance, and 'exact' or 'gauss_newton'."
        )


def _run(
    solver: Any,
    program: Program,
    report: Report | _Watch,
    iterations: int,
    statuses: Mapping[object, tuple[Ending, str]],
) -> Solved:
    """Solve, and say how it ended."""
    raised: BaseException | None = None
    found = None
    with _Interrupt(report if isinstance(report, _Watch) else None) as interrupt:
        try:
            found = solver(x0=program.start, lbx=program.low, ubx=program.high, lbg=0.0, ubg=0.0)
        except RuntimeError as error:
            raised = error
    if interrupt.asked:
        raise KeyboardInterrupt
    if isinstance(report, _Watch) and report.raised is not None:
        raise report.raised
    if found is None:
        return Solved(
            program.start, Ending.FAILED, f"The solver gave up ({_first_line(raised)}); {_START}."
        )
    x = np.array(found["x"], dtype=float).ravel()
    if not isinstance(report, _Watch):
        report(x[program.unknowns])
    stats = solver.stats()
    status, taken = stats["return_status"], int(stats.get("iter_count", 0))
    if status in statuses:
        ending, sentence = statuses[status]
    elif taken >= iterations:
        ending, sentence = Ending.LIMIT, ""
    else:
        ending, sentence = Ending.FAILED, f"The solver gave up (status {status}); {_START}."
    if ending is Ending.LIMIT:
        sentence = (
            f"Stopped after {iterations} iterations short of a minimum; go on with "
            "solve(question, start=fit), or raise iterations."
        )
    return Solved(x, ending, sentence)


def _first_line(error: BaseException | None) -> str:
    return str(error).strip().splitlines()[0] if str(error).strip() else "no reason given"


@final
class _Interrupt:
    """Remembers a Ctrl-C while compiled code runs, which may take it for a failed evaluation.

    A solver that calls back is stopped at its next iterate, by what the watch raises there;
    another one by an exception out of its next evaluation.
    """

    def __init__(self, watch: _Watch | None) -> None:
        self._watch = watch
        self._before: Any = None
        self.asked = False

    def __enter__(self) -> _Interrupt:
        # Only the main thread receives signals.
        if threading.current_thread() is threading.main_thread():
            self._before = signal.signal(signal.SIGINT, self._remember)
        return self

    def __exit__(self, *_: object) -> None:
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)

    def _remember(self, _number: int, _frame: FrameType | None) -> None:
        self.asked = True
        if self._watch is None:
            raise KeyboardInterrupt
        self._watch.raised = KeyboardInterrupt()


@final
class _Watch(ca.Callback):
    """Hands the unknowns of every iterate on; keeps what is raised there, to raise it outside."""

    def __init__(self, program: Program, report: Report) -> None:
        ca.Callback.__init__(self)
        self._program = program
        self._report = report
        self.raised: BaseException | None = None
        self.construct("po_watch", {})

    def get_n_in(self) -> int:
        """The outputs of a solver."""
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        """Whether to stop."""
        return 1

    def get_sparsity_in(self, i: int) -> Any:
        """Sizes of the outputs of a solver."""
        name = ca.nlpsol_out(i)
        if name == "f":
            return ca.Sparsity.scalar()
        if name in ("x", "lam_x"):
            return ca.Sparsity.dense(self._program.start.size)
        if name in ("g", "lam_g"):
            return ca.Sparsity.dense(self._program.constraints)
        return ca.Sparsity(0, 0)

    def eval(self, arguments: Any) -> list[float]:
        """One iterate."""
        if self.raised is not None:
            return [1.0]
        try:
            self._report(np.array(arguments[0], dtype=float).ravel()[self._program.unknowns])
        except BaseException as error:
            self.raised = error
            return [1.0]
        return [0.0]
