"""The main job on a record that ships with the package: read, fit, see where it fails, report.

>>> from piezo_opt import demo
>>> print(demo.run("somewhere"))  # doctest: +SKIP
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final, final

from piezo_opt import datasets
from piezo_opt.comparison import Comparison, compare, uncontrolled_iae
from piezo_opt.effects.motion.second_order import SecondOrder
from piezo_opt.effects.strain.bouc_wen import BoucWen
from piezo_opt.effects.strain.piezo_gain import PiezoGain
from piezo_opt.errors import InputError
from piezo_opt.files import target_of
from piezo_opt.identification import Fit, Identification, Start, solve
from piezo_opt.units import show

__all__ = ["PAGE", "Demo", "found", "question", "run"]

PAGE: Final = "piezo-opt-demo.html"
_TITLE: Final = "piezo_opt demo: the thesis' measured loop"
_MECHANICS: Final = {"second_order.omega": 8.0321, "second_order.zeta": 0.1992}


@final
@dataclass(frozen=True, eq=False)
class Demo:
    """What the demo found, and where its page is to be."""

    fit: Fit
    comparison: Comparison
    page: Path

    def __str__(self) -> str:
        record = self.fit.records[0]
        area = show(uncontrolled_iae(record), "m*s")
        left = show(self.comparison.entries[0].metrics.iae, "m*s")
        slow = (
            ""
            if self.fit.compiled
            else "\nThere is no C compiler: this ran on the slower virtual machine. Install gcc "
            "for long records."
        )
        return (
            f"{record!r}\n{record.source}\n"
            f"Hysteresis alone: the reading is off a straight line by {area} over the loop; the "
            f"model below leaves {left}.\n\n"
            f"{self.fit}\n\n{self.comparison}{slow}"
        )

    def write_page(self) -> None:
        """Draw the page; that of an earlier demo is replaced."""
        from piezo_opt.report import write_report

        write_report(self.page, self.fit, title=_TITLE, overwrite=True)


def question() -> Identification:
    """Bouc-Wen behind the mechanics of the thesis' Eq. 3.5 on its Table 3.1, from a virgin start.

    The record is quasi-static, so the mechanics are kept at omega 8.0321 rad/s, zeta 0.1992.
    """
    return Identification(
        PiezoGain() + BoucWen() + SecondOrder(),
        datasets.load("thesis/hysteresis"),
        fixed=_MECHANICS,
        start=Start.REST,
    )


def run(out: str | os.PathLike[str] = ".") -> Demo:
    """Fit, compare and write the page; arguments and errors as those of :func:`found`."""
    done = found(out)
    done.write_page()
    return done


def found(out: str | os.PathLike[str] = ".") -> Demo:
    """Fit and compare; the page is not drawn yet.

    Args:
        out: a folder, which gets ``piezo-opt-demo.html``, or the page's own name.

    Raises:
        InputError: the page cannot be written, or a file that is not an earlier demo's page is
            in its place.
    """
    given = Path(out)
    page = given / PAGE if given.is_dir() else given
    if page.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{page}: there is no such folder: make it, or name a page, {PAGE}")
    target_of(page)
    if page.exists() and not _own(page):
        raise InputError(f"{page}: exists already and is no page of the demo: choose another name")
    fit = solve(question())
    return Demo(fit, compare(fit), page)


def _own(page: Path) -> bool:
    """Whether the file is the page of an earlier demo."""
    try:
        with page.open(encoding="utf-8", errors="replace") as file:
            return "<title>piezo_opt demo:" in file.read(2000)
    except OSError:
        return False
