"""Draws the picture at the head of the README: what ``piezo-opt demo`` fits.

python docs/first_picture.py
"""

from __future__ import annotations

from pathlib import Path

from piezo_opt import compare, demo, solve
from piezo_opt.report import figures

PICTURE = Path(__file__).with_name("first_picture.png")


def draw(path: Path) -> float:
    """Fit the measured loop that comes along, and draw it with the model.

    Returns:
        rms error of the model [m].
    """
    fit = solve(demo.question())
    drawn = figures.loop(compare(fit, names=("model",)).entries)
    drawn.savefig(path, dpi=100)
    return fit.rms


if __name__ == "__main__":
    draw(PICTURE)
