"""Problems x solvers x seeded starts, and the coverage of the intervals: prints both tables.

    python problems/run_benchmark.py                     every problem in this folder
    python problems/run_benchmark.py --only thesis_loop --starts 20 --json race.json
    python problems/run_benchmark.py --coverage 100      coverage on synthetic_recovery instead
    python problems/run_benchmark.py --coverage 100 --selected     where creep was found first
    python problems/run_benchmark.py --drives            how much better than a triangle drives are

Runs in parallel with --workers; wall times are cleanest with one. Ctrl-C prints what there is.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import sys
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

import piezo_opt as po
from piezo_opt.benchmark.coverage import Coverage, coverage
from piezo_opt.benchmark.optimisers import Contender, Race, race
from piezo_opt.effects import Creep
from piezo_opt.errors import InputError
from piezo_opt.signals import Criterion, best_for, ceiling
from piezo_opt.simulation import simulate

HERE = Path(__file__).resolve().parent
CONTENDERS = (
    Contender(po.LevenbergMarquardt()),
    Contender(po.ScipyLeastSquares()),
    Contender(po.NelderMead()),
    Contender(po.CmaEs()),
    Contender(po.DifferentialEvolution()),
)

CRITERIA = (Criterion.DEVIATIONS, Criterion.DETERMINANT)


def problem(name: str) -> ModuleType:
    """A problem's file as a module, wherever this script is run from."""
    spec = importlib.util.spec_from_file_location(name, HERE / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def names() -> list[str]:
    """Every file of this folder that asks a question."""
    files = sorted(HERE.glob("*.py"))
    return [f.stem for f in files if "\ndef question(" in f.read_text(encoding="utf-8")]


def creeping() -> tuple[po.Identification, dict[str, float], float]:
    """A question whose records creep, its true values, and the noise [m]."""
    synthetic = problem("synthetic_recovery")
    clean = synthetic.clean()
    asked = synthetic.question()
    model = asked.model + Creep()
    truth = {**synthetic.known(), "creep.c": 0.05, "creep.tau": 0.05}
    reading = simulate(model, clean, truth).reading
    question = asked.with_model(model).with_records(clean.with_(position=reading))
    return question, truth, synthetic.NOISE * float(np.ptp(clean.position))


def show(done: int, of: int) -> None:
    """Progress on the terminal."""
    end = "\n" if done == of else ""
    print(f"\r  {done} of {of}", end=end, file=sys.stderr, flush=True)


def drives(chosen: list[str]) -> None:
    """The best drive for all parameters of each problem, by either criterion.

    Deviations are so many times smaller than an equal triangle's, in geometric mean, and so is the
    region in which the parameters lie together. "at most": of a static model, for any drive.
    """
    print(
        f"{'problem':<22}{'parameters':>10}{'deviations':>12}{'at most':>9}{'together':>10}  drive"
    )
    for name in chosen:
        fit = po.solve(problem(name).question())
        try:
            apart, joint = (best_for(fit, criterion=one) for one in CRITERIA)
        except InputError as refused:
            print(f"{name:<22}{refused}", flush=True)
            continue
        most = f"{ceiling(fit).at_most:.2f}" if fit.model.quasi_static else ""
        row = f"{name:<22}{len(apart.parameters):>10}{apart.gain:>12.2f}{most:>9}"
        print(f"{row}{joint.joint_gain:>10.2f}  {apart.drive.description}", flush=True)


def main() -> None:
    """Read the options, run, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=names(), default=names(), metavar="PROBLEM")
    parser.add_argument("--starts", type=int, default=5, help="starts of each problem")
    parser.add_argument("--seed", type=int, default=0, help="of the drawn starts")
    parser.add_argument("--limit", type=float, default=20.0, help="seconds of one run")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument("--coverage", type=int, metavar="SEEDS", help="coverage instead")
    parser.add_argument("--selected", action="store_true", help="after a diagnosis found creep")
    parser.add_argument("--drives", action="store_true", help="the best drives instead")
    parser.add_argument("--json", type=Path, help="write all runs to this file")
    options = parser.parse_args()
    if options.drives:
        drives(options.only)
        return
    pool: Any = ProcessPoolExecutor(options.workers) if options.workers > 1 else nullcontext()
    result: Race | Coverage
    with pool as executor:
        if options.coverage is not None and options.selected:
            question, truth, noise = creeping()
            result = coverage(
                question, truth, noise, seeds=range(options.coverage), without=["creep"],
                executor=executor, progress=show,
            )  # fmt: skip
        elif options.coverage is not None:
            synthetic = problem("synthetic_recovery")
            clean = synthetic.clean()
            result = coverage(
                synthetic.question().with_records(clean),
                synthetic.known(),
                synthetic.NOISE * float(np.ptp(clean.position)),
                seeds=range(options.coverage),
                executor=executor,
                progress=show,
            )
        else:
            result = race(
                {name: problem(name).question() for name in options.only},
                CONTENDERS,
                starts=options.starts,
                seed=options.seed,
                limit_s=options.limit,
                executor=executor,
                progress=show,
            )
    print(result)
    if options.json is not None:
        options.json.write_text(json.dumps(result.to_dict(), indent=2) + "\n")


if __name__ == "__main__":
    main()
