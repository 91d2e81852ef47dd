"""``piezo-opt linear``: transfer functions and frequency responses without any physics."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

from piezo_opt.cli import options as o
from piezo_opt.cli import outputs
from piezo_opt.cli.checking import UNANSWERED, Checking
from piezo_opt.cli.declare import Option, echo
from piezo_opt.cli.groups import grouped
from piezo_opt.cli.inputs import AS_WRITTEN, Reading, parted
from piezo_opt.cli.limiting import leave_early, limit_of, limited
from piezo_opt.cli.telling import telling
from piezo_opt.errors import InputError
from piezo_opt.identification import Start
from piezo_opt.linear_models import (
    Detrend,
    FrequencyResponse,
    OrderSearch,
    TransferFit,
    fit_transfer,
    frequency_response,
    search_orders,
)
from piezo_opt.measurement import Campaign


@grouped
def linear(
    records: o.Records,
    poles: Annotated[
        str,
        Option(metavar="N|N-M", help="Number of poles, or a range to search."),
    ] = "1-4",
    zeros: Annotated[
        str | None,
        Option(
            metavar="N|N-M", help="Number of zeros, or a range; by default all that make sense."
        ),
    ] = None,
    response: Annotated[
        bool,
        Option("--response", help="Frequency response of periodic records instead."),
    ] = False,
    test: Annotated[
        list[Path] | None,
        Option(metavar="RECORD", help="Record that orders are judged on."),
    ] = None,
    unstable: Annotated[
        bool, Option("--unstable", help="Allow poles in the right half plane.")
    ] = False,
    detrend: Annotated[
        Detrend, Option(help="What of the reading is not the system's; estimated with it.")
    ] = Detrend.OFFSET,
    start: Annotated[
        Start, Option(help="The state at the beginning: estimated, or at rest.")
    ] = Start.FREE,
    reduce: Annotated[
        int | None,
        Option(
            metavar="N", help="Fewer poles for the same model, by balanced truncation, gain kept."
        ),
    ] = None,
    json: o.Json = None,
    report: o.Page = None,
    reading: Reading = AS_WRITTEN,
    checking: Checking = UNANSWERED,
    split: o.Split = None,
    max_time: o.MaxTime = None,
    overwrite: o.Overwrite = False,
) -> None:
    """Fit transfer functions to records, or measure the frequency response of periodic ones.

    Several orders are judged on held-out data (--split or --test) or, without, by Akaike's final
    prediction error (FPE). Ctrl-C and --max-time give the orders that were finished.

    \b
    Examples:
      piezo-opt linear sweep.csv
      piezo-opt linear sweep.csv --poles 2-6 --split "3 s" --report linear.html
      piezo-opt linear steps.csv --poles 2 --zeros 0 --between held
      piezo-opt linear steps.csv --poles 4 --zeros 1 --reduce 2
      piezo-opt linear multisine.csv --response --period "1 s"
    """
    if test and split is not None:
        raise InputError("--test and --split both say what to judge on: give one of them")
    if response and reduce is not None:
        raise InputError("--reduce: a frequency response has no poles: leave --response out")
    outputs.check(
        {"--json": json, "--report": report},
        overwrite=overwrite,
        inputs=(*records, *(test or ())),
    )
    result: FrequencyResponse | OrderSearch | TransferFit
    limit = limit_of(max_time)
    with limited(limit), telling("Orders") as tell:
        train, held_out = parted(checking.records(reading.records(records)), split)
        if test:
            held_out = Campaign(tuple(map(checking.judging, reading.records(test))))
        if response:
            result = frequency_response(train)
        else:
            how: dict[str, Any] = {"stable": not unstable, "start": start, "detrend": detrend}
            result = _fitted(train, held_out, poles, zeros, how, tell)
    echo(str(result))
    best = result.best if isinstance(result, OrderSearch) else result
    if isinstance(result, OrderSearch):
        echo(f"\n{best}")
    extra: dict[str, Any] = {}
    if reduce is not None and not isinstance(best, FrequencyResponse):
        fewer = best.reduced(reduce)
        echo(f"\n{fewer}")
        extra = {"reduced": fewer.to_dict()}
    if json is not None:
        outputs.write_json(json, {**result.to_dict(), **extra}, overwrite=overwrite)
    if report is not None:
        outputs.write_page(report, result, overwrite=overwrite)
    leave_early(isinstance(result, OrderSearch) and result.interrupted, limit)


def _fitted(
    train: Campaign,
    test: Campaign | None,
    poles: str,
    zeros: str | None,
    how: dict[str, Any],
    tell: Callable[[str], None],
) -> OrderSearch | TransferFit:
    n = number_range("--poles", poles)
    m = None if zeros is None else number_range("--zeros", zeros)
    if len(n) == 1 and m is not None and len(m) == 1 and test is None:
        return fit_transfer(train, n[0], m[0], **how)
    return search_orders(train, test=test, poles=n, zeros=m, progress=tell, **how)


def number_range(option: str, text: str) -> list[int]:
    """[3] of "3", [2, 3, 4] of "2-4"."""
    pieces = text.split("-")
    if len(pieces) > 2 or not all(piece.strip().isdecimal() for piece in pieces):
        raise InputError(f"{option} {text}: give a number or a range, such as 2 or 2-4")
    low, high = int(pieces[0]), int(pieces[-1])
    if high < low:
        raise InputError(f"{option} {text}: a range goes up, such as {high}-{low}")
    return list(range(low, high + 1))
