"""The rectangle of pixels that is followed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, final

from piezo_opt.errors import InputError

MARGIN: Final = 4
"""Pixels kept around the box: the pattern is moved by up to two, and a quintic spline of it feels
its end for two more."""
SMALLEST: Final = 12
"""Side [px]: nine blocks of four pixels, whose disagreement says how wrong a place may be."""


@final
@dataclass(frozen=True)
class Box:
    """Columns ``x .. x + width`` and rows ``y .. y + height`` of a picture [px].

    Raises:
        InputError: it is too small to be found again.
    """

    x: int
    y: int
    width: int
    height: int

    def __post_init__(self) -> None:
        if min(self.width, self.height) < SMALLEST:
            raise InputError(
                f"box {self}: is smaller than {SMALLEST} pixels: take more of the feature"
            )

    @staticmethod
    def of(text: str | Box) -> Box:
        """A box as a person writes it: ``"x,y,width,height"`` in pixels."""
        if isinstance(text, Box):
            return text
        numbers = _numbers(text, 4, "box", "'80,60,40,40' (left, top, width, height in pixels)")
        return Box(*(round(one) for one in numbers))

    @property
    def centre(self) -> tuple[float, float]:
        """x and y of the middle; a pixel's own centre is a whole number."""
        return self.x + 0.5 * (self.width - 1), self.y + 0.5 * (self.height - 1)

    def check(self, height: int, width: int) -> None:
        """Refuse a box that is not within a picture.

        Raises:
            InputError: it reaches over the border, or so near that the feature is not whole.
        """
        near = (
            min(self.x, self.y) < MARGIN
            or self.x + self.width > width - MARGIN
            or self.y + self.height > height - MARGIN
        )
        if near:
            raise InputError(
                f"box {self}: reaches to the border of the picture of {width} x {height} pixels: "
                f"leave {MARGIN} pixels on each side"
            )

    def __str__(self) -> str:
        return f"{self.x},{self.y},{self.width},{self.height}"


def point(text: str | tuple[float, float]) -> tuple[float, float]:
    """A point as a person writes it: ``"x,y"`` in pixels, from the centre of the top left one."""
    if not isinstance(text, str):
        x, y = text
        return float(x), float(y)
    x, y = _numbers(text, 2, "reference", "'12,80' (x and y in pixels from the top left)")
    return x, y


def _numbers(text: str, count: int, what: str, example: str) -> list[float]:
    try:
        numbers = [float(part.strip().removesuffix("px")) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(abs(one) < 1e6 for one in numbers):
        raise InputError(f"{what} {text!r}: give {count} numbers, {example}")
    return numbers
