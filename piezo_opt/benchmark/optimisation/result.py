"""What came out: tables, profiles, and what they say in words."""

from __future__ import annotations

import csv
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, Literal, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.benchmark.optimisation.profiles import (
    Curve,
    data_profile,
    performance_profile,
    work,
)
from piezo_opt.benchmark.optimisation.run import SKIPPED, History
from piezo_opt.benchmark.table import table
from piezo_opt.errors import InputError

FloatArray = NDArray[np.float64]
Kind = Literal["data", "performance"]

SCHEMA: Final = "piezo_opt/optimisers/1"
TOLERANCES: Final = (1e-1, 1e-3, 1e-5, 1e-7)
"""Shares of what there is to be gained that may be left; those of More and Wild."""
SOLVED: Final = 1e-6
"""Distance of the cost from the best known, relative to it, within which a case is solved."""


@final
@dataclass(frozen=True, eq=False)
class Result:
    """One contender from one start of a variant of a problem.

    Attributes:
        problem, variant, seed, contender: which.
        size: number of unknowns.
        first: cost at the start [m^2].
        least: best known cost, from outside the race [m^2].
        ratio, simulation_s, slopes, compile_s: of the problem, as in ``Posed``.
        history: what it found, and when.
    """

    problem: str
    variant: int
    seed: int
    contender: str
    size: int
    first: float
    least: float
    ratio: float
    simulation_s: float
    slopes: float
    compile_s: float
    history: History

    @property
    def case(self) -> tuple[str, int]:
        """Problem and seed, which the variant follows from."""
        return self.problem, self.seed

    @property
    def reached(self) -> float:
        """Cost reached over the best known, minus 1; infinite for nothing."""
        costs = self.history.costs
        return float(costs[-1] / self.least - 1.0) if costs.size else float("inf")

    @property
    def price(self) -> float:
        """Simulations until it was solved; infinite if it was not."""
        there = np.flatnonzero(self.history.costs <= (1.0 + SOLVED) * self.least)
        return float(self.history.prices[there[0]]) if there.size else float("inf")


@final
@dataclass(frozen=True, eq=False)
class Comparison:
    """Everything that was run.

    Attributes:
        problems, contenders: names in the order given.
        results: of all runs.
        budget: [simulations for each unknown and one more] of a run.
    """

    problems: tuple[str, ...]
    contenders: tuple[str, ...]
    results: tuple[Result, ...]
    budget: float

    def without(self, *hidden: str) -> Comparison:
        """The same without some contenders, as if they had never run: ratios are found anew.

        Raises:
            InputError: one that did not take part, or nobody is left.
        """
        for name in hidden:
            if name not in self.contenders:
                raise InputError(
                    f"'{name}' did not take part: there are {', '.join(self.contenders)}."
                )
        left = tuple(c for c in self.contenders if c not in hidden)
        if not left:
            raise InputError("hiding all contenders leaves nobody: show at least one.")
        shown = tuple(r for r in self.results if r.contender in left)
        return replace(self, contenders=left, results=shown)

    @property
    def skipped(self) -> Mapping[str, str]:
        """Contenders that could not run anywhere, and why."""
        reasons = {}
        for name in self.contenders:
            own = [r for r in self.results if r.contender == name]
            if own and all(r.history.ending == SKIPPED for r in own):
                reasons[name] = own[0].history.reason
        return reasons

    def lowered(self) -> Mapping[str, float]:
        """Problems in which somebody went below the best known, and by which share of it."""
        found: dict[str, float] = {}
        for r in self.results:
            if r.reached < -1e-9:
                found[r.problem] = min(found.get(r.problem, 0.0), r.reached)
        return found

    def works(self, tolerance: float) -> tuple[dict[str, FloatArray], FloatArray]:
        """Prices of all contenders that ran, over the cases (c,), and numbers of unknowns (c,)."""
        cases = list(dict.fromkeys(r.case for r in self.results))
        place = {case: k for k, case in enumerate(cases)}
        sizes = np.zeros(len(cases))
        least = np.full(len(cases), np.inf)
        for r in self.results:
            sizes[place[r.case]] = r.size
            lowest = r.history.costs[-1] if r.history.costs.size else np.inf
            least[place[r.case]] = min(least[place[r.case]], r.least, lowest)
        racing = [c for c in self.contenders if c not in self.skipped]
        works = {c: np.full(len(cases), np.inf) for c in racing}
        for r in self.results:
            if r.contender in works:
                at = place[r.case]
                works[r.contender][at] = work(
                    r.history.prices, r.history.costs, r.first, float(least[at]), tolerance
                )
        return works, sizes

    def profile(self, kind: Kind, tolerance: float) -> dict[str, Curve]:
        """Data or performance profile of all contenders that ran."""
        works, sizes = self.works(tolerance)
        return data_profile(works, sizes) if kind == "data" else performance_profile(works)

    def sentences(self, kind: Kind, tolerance: float) -> tuple[str, str]:
        """What a profile says, in two sentences with numbers."""
        curves = self.profile(kind, tolerance)
        cases = self.works(tolerance)[1].size
        return _data(curves, cases, self.budget) if kind == "data" else _ratios(curves, cases)

    def write_csv(self, folder: Path, tolerance: float) -> list[Path]:
        """One file a profile: ``solver, at, share``, a row for each step of a staircase."""
        written = []
        kinds: tuple[Kind, Kind] = ("data", "performance")
        for kind in kinds:
            path = folder / f"{kind}_profile_{tolerance:.0e}.csv"
            with path.open("w", newline="", encoding="utf-8") as file:
                rows = csv.writer(file)
                rows.writerow(["solver", "at", "share"])
                for name, curve in self.profile(kind, tolerance).items():
                    for at, share in zip(curve.at, curve.share, strict=True):
                        rows.writerow([name, repr(float(at)), repr(float(share))])
            written.append(path)
        return written

    def whole_s(self, problems: int, contenders: int, seeds: int) -> float:
        """[s] of processor time that a comparison of another size would take.

        Args:
            problems, contenders, seeds: its size; the mean run of this one is taken for it.
        """
        mean = np.mean([r.history.cpu_s for r in self.results])
        return float(mean) * problems * contenders * seeds

    def to_dict(self) -> dict[str, Any]:
        """Plain data with a ``schema`` key."""
        return {
            "schema": SCHEMA,
            "budget": self.budget,
            "skipped": dict(self.skipped),
            "below_best_known": dict(self.lowered()),
            "runs": [
                {
                    "problem": r.problem, "variant": r.variant, "seed": r.seed,
                    "contender": r.contender, "unknowns": r.size, "first_cost": r.first,
                    "best_known_cost": r.least, "above_best_known": r.reached,
                    "simulations_to_solve": r.price, "ending": r.history.ending,
                    "reason": r.history.reason, "seconds": r.history.seconds,
                    "spent": r.history.spent, "prices": r.history.prices.tolist(),
                    "costs": r.history.costs.tolist(),
                }
                for r in self.results
            ],
            "profiles": {
                kind: {
                    f"{tolerance:.0e}": {
                        name: {"at": c.at.tolist(), "share": c.share.tolist()}
                        for name, c in self.profile(kind, tolerance).items()
                    }
                    for tolerance in TOLERANCES
                }
                for kind in _KINDS
            },
        }  # fmt: skip

    def __str__(self) -> str:
        cases = len({r.case for r in self.results})
        lines = [
            f"{len(self.problems)} problems, {cases} cases, {len(self.contenders)} contenders, "
            f"{len(self.results)} runs; a run ends at {self.budget:g} simulations for each unknown "
            "and one more.",
            "",
            self._by_contender(),
            "",
            self._by_problem(),
        ]
        told = [f"  {name} did not run: {why}" for name, why in self.skipped.items()]
        told += [
            f"  {name}: somebody went below the best known, by {-100.0 * share:.2g} % of the cost"
            for name, share in self.lowered().items()
        ]
        return "\n".join([*lines, *([""] if told else []), *told])

    def _by_contender(self) -> str:
        rows = []
        cheapest = self._cheapest()
        for name in self.contenders:
            own = [r for r in self.results if r.contender == name]
            if not own or name in self.skipped:
                continue
            solved = [r for r in own if np.isfinite(r.price)]
            ratios = [r.price / cheapest[r.case] for r in solved]
            rows.append(
                (
                    name, f"{100.0 * len(solved) / len(own):.0f} %",
                    _usual([r.price for r in solved], ".0f"), _usual(ratios, ".3g"),
                    _usual([max(0.0, r.reached) for r in own], ".1e"),
                    _usual([r.history.seconds for r in own], ".2g"),
                )
            )  # fmt: skip
        head = ("solver", "solved", "simulations", "x cheapest", "above best", "seconds")
        return f"{table(head, rows)}\n(medians; solved: within {SOLVED:g} of the best known cost)"

    def _by_problem(self) -> str:
        rows = []
        for name in self.problems:
            own = [r for r in self.results if r.problem == name]
            if not own:
                continue
            shares = {
                c: np.mean([np.isfinite(r.price) for r in own if r.contender == c] or [0.0])
                for c in self.contenders
                if c not in self.skipped
            }
            always = sum(share == 1.0 for share in shares.values())
            best = max(shares, key=lambda c: float(shares[c]))
            rows.append(
                (
                    name, f"{own[0].size}", f"{1e6 * own[0].simulation_s:.0f}",
                    f"{own[0].ratio:.2f}", f"{max(r.slopes for r in own):.0e}",
                    f"{own[0].compile_s:.1f}", f"{always} of {len(shares)}",
                    f"{best} {100.0 * float(shares[best]):.0f} %",
                )
            )  # fmt: skip
        head = (
            "problem", "unknowns", "µs", "price with slopes", "Jacobian off by", "compiling [s]",
            "always solved by", "best",
        )  # fmt: skip
        return table(head, rows)

    def _cheapest(self) -> dict[tuple[str, int], float]:
        found: dict[tuple[str, int], float] = {}
        for r in self.results:
            found[r.case] = min(found.get(r.case, np.inf), r.price)
        return found


_KINDS: Final[tuple[Kind, Kind]] = ("data", "performance")
_MOST: Final = 0.9
_TRADITION: Final = "nelder_mead"


def _usual(numbers: Collection[float], form: str) -> str:
    if not numbers:
        return "-"
    middle = float(np.median(list(numbers)))
    return format(middle, form) if np.isfinite(middle) else "-"


def _data(curves: Mapping[str, Curve], cases: int, budget: float) -> tuple[str, str]:
    order = sorted(curves, key=lambda c: (curves[c].reaches(_MOST), -curves[c].last))
    first = order[0]
    at = curves[first].reaches(_MOST)
    if np.isfinite(at):
        one = (
            f"{first} is the first to have solved {100 * _MOST:.0f} % of the {cases} cases, at "
            f"{at:.3g} simulations for each unknown and one more"
        )
        if len(order) > 1:
            then = curves[order[1]].reaches(_MOST)
            also = f"at {then:.3g}" if np.isfinite(then) else "never"
            one += f"; {order[1]} follows {also}" if np.isfinite(then) else "; no other ever does"
    else:
        one = (
            f"Nobody solves {100 * _MOST:.0f} % of the {cases} cases within {budget:g} simulations "
            f"for each unknown and one more; {first} comes nearest with "
            f"{100 * curves[first].last:.0f} %"
        )
    slow = _TRADITION if _TRADITION in curves else order[-1]
    half = curves[slow].reaches(0.5)
    when = f"half of them at {half:.3g}" if np.isfinite(half) else "never half of them"
    two = f"{slow} has solved {when}, and {100 * curves[slow].last:.0f} % at the end"
    return f"{one}.", f"{two}."


def _ratios(curves: Mapping[str, Curve], cases: int) -> tuple[str, str]:
    first = max(curves, key=lambda c: (curves[c](1.0), curves[c](2.0)))
    one = (
        f"{first} is the cheapest in {100 * curves[first](1.0):.0f} % of the {cases} cases, and "
        f"within twice the cheapest in {100 * curves[first](2.0):.0f} %"
    )
    order = sorted(curves, key=lambda c: curves[c].last)
    slow = _TRADITION if _TRADITION in curves else order[0]
    curve = curves[slow]
    if curve.share.size:
        middle = float(np.median(curve.at))
        two = (
            f"{slow} solves {100 * curve.last:.0f} % in the end, at a median of {middle:.3g} times "
            "the price of the cheapest"
        )
    else:
        two = f"{slow} solves none of them"
    return f"{one}.", f"{two}."
