"""``piezo-opt bench optimisers``: who finds the optimum, and at what price."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from piezo_opt.cli import options as o
from piezo_opt.cli import outputs
from piezo_opt.cli.declare import Option, echo
from piezo_opt.cli.solving import pool
from piezo_opt.cli.telling import telling
from piezo_opt.errors import InputError

_SHOWN = (1e-3, 1e-7)
"""Tolerances of the pictures: near, and to the last digits."""


def optimisers(
    problems: Annotated[
        str | None, Option(metavar="A,B", help="Problems by name; all unless given.")
    ] = None,
    solvers: Annotated[
        str | None, Option(metavar="A,B", help="Solvers by name; all unless given.")
    ] = None,
    hide: Annotated[
        str | None,
        Option(metavar="A,B", help="Solvers left out of tables and profiles, not of the log."),
    ] = None,
    seeds: Annotated[int, Option(min=1, metavar="N", help="Starts of each problem.")] = 20,
    variants: Annotated[
        int, Option(min=1, metavar="N", help="Perturbed copies of each problem.")
    ] = 4,
    budget: Annotated[
        float, Option(metavar="N", help="Simulations for each unknown and one more.")
    ] = 400.0,
    limit: Annotated[float, Option(metavar="S", help="Seconds of processor time of a run.")] = 3.0,
    workers: Annotated[int, Option(min=1, metavar="N", help="Processes that share the runs.")] = 1,
    log: Annotated[
        Path | None,
        Option(metavar="FILE.h5", help="Keeps finished runs; a second call goes on from it."),
    ] = None,
    out: Annotated[
        Path | None,
        Option(metavar="DIR", help="Folder for pictures of the profiles and their numbers."),
    ] = None,
    json: o.Json = None,
    overwrite: o.Overwrite = False,
) -> None:
    """Let optimisers run from the same starts of the same problems.

    Prices are simulations: one with sensitivities counts what it costs. Ctrl-C prints what was
    done. The comparison over all problems and solvers takes about half an hour on two cores.

    \b
    Examples:
      piezo-opt bench optimisers --problems thesis_loop,resonance --seeds 2
      piezo-opt bench optimisers --workers 2 --log race.h5 --out race
      piezo-opt bench optimisers --log race.h5 --hide gauss_newton,fatrop --out race --overwrite
    """
    from piezo_opt.benchmark.optimisation import CASES, CONTENDERS, compare_optimisers

    outputs.check({"--json": json, "--log": log}, overwrite=overwrite, grows=frozenset({"--log"}))
    if out is not None:
        _check_folder(out, overwrite=overwrite)
    with telling("Race") as tell, pool(workers) as executor:
        found = compare_optimisers(
            _names(problems), _names(solvers), seeds=seeds, variants=variants, budget=budget,
            limit_s=limit, executor=executor, log=log,
            progress=lambda done, of: tell(f"{done} of {of} runs (Ctrl-C prints those)"),
        )  # fmt: skip
    shown = found.without(*(_names(hide) or ()))
    echo(str(shown))
    whole = found.whole_s(len(CASES), len(CONTENDERS), 20) / workers / 60.0
    echo(
        f"\nAll {len(CASES)} problems, {len(CONTENDERS)} solvers and 20 seeds would take about "
        f"{whole:.0f} minutes on {workers} idle cores, by the processor time of these runs."
    )
    for kind in ("data", "performance"):
        echo(f"\n{kind.capitalize()} profile at {_SHOWN[0]:g}:")
        for sentence in shown.sentences(kind, _SHOWN[0]):
            echo(f"  {sentence}")
    if json is not None:
        outputs.write_json(json, shown.to_dict(), overwrite=overwrite)
    if out is not None:
        _write(out, shown)


def _names(text: str | None) -> list[str] | None:
    return None if text is None else [one.strip() for one in text.split(",") if one.strip()]


def _check_folder(out: Path, *, overwrite: bool) -> None:
    if out.exists() and not out.is_dir():
        raise InputError(f"--out {out}: is a file; name a folder.")
    if out.is_dir() and any(out.iterdir()) and not overwrite:
        raise InputError(f"--out {out}: is not empty; choose another folder or give --overwrite.")
    if not out.parent.is_dir():
        raise InputError(f"--out {out}: there is no folder {out.parent}; make it first.")


def _write(out: Path, shown: object) -> None:
    from piezo_opt.benchmark.optimisation import Comparison
    from piezo_opt.report.optimiser_figures import profile

    assert isinstance(shown, Comparison)
    out.mkdir(exist_ok=True)
    for tolerance in _SHOWN:
        shown.write_csv(out, tolerance)
        for kind in ("data", "performance"):
            picture = profile(shown, kind, tolerance)
            picture.savefig(out / f"{kind}_profile_{tolerance:.0e}.png", dpi=150)
