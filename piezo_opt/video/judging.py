"""Which frames are believed, and how well each tells the place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cache
from typing import Final, final

import numpy as np
from scipy.stats import chi2

from piezo_opt.measurement import FloatArray
from piezo_opt.video.learning import UNSURE, half_a_pixel
from piezo_opt.video.pattern import Pattern, Registered
from piezo_opt.video.sighting import Sighting

_CONTRAST: Final = 0.5
"""Of the usual one, below which a window is not taken for the feature: any flat stretch of a
picture is the pattern with little contrast, and noise."""
_NOISIER: Final = 1.5
"""Of the usual variance: frames of a compressed video differ by that much among themselves."""
_CHANCE: Final = 1e-3
"""How often the blocks of a frame may look that uneven before the frame is held for it."""


class Lost(Enum):
    """Why a frame says nothing of the place."""

    GONE = "nothing like the feature is in the picture"
    UNLIKE = "the feature looks different, is covered, or is gone"
    TWICE = "two places look like the feature"
    UNSURE = "the place is not sure enough"


@final
@dataclass(frozen=True, eq=False)
class Judged:
    """What frames are believed to show.

    Attributes:
        place: (N, 2) x and y [px]; not a number where lost.
        covariance: (N, 2, 2) [px^2].
        lost: why, frame by frame; None where a place is believed.
        unevenness: variance of a place, as blocks disagree, over that of independent noise.
        white: mean variance of a place by independent noise [px^2].
    """

    place: FloatArray
    covariance: FloatArray
    lost: tuple[Lost | None, ...]
    unevenness: float
    white: float

    @property
    def variance(self) -> float:
        """Mean variance of a place, as blocks disagree [px^2]."""
        return self.unevenness * self.white

    @property
    def coded(self) -> float:
        """What of it is more than independent noise makes [px^2]."""
        return (self.unevenness - 1.0) * self.white


def judged(
    seen: Sequence[Sequence[Sighting]],
    pattern: Pattern,
    common: Sequence[FloatArray] | None = None,
    *,
    sure: float = UNSURE,
) -> Judged:
    """What each frame is believed to show.

    A window is taken for the feature when it has at least half its usual contrast, and differs from
    the pattern by no more than noise and what half a pixel would make. A frame with two such
    windows is not believed, nor one whose place is not sure: to half a pixel (two sigma), or less.

    The covariance is that of independent noise of the frame's own size, times how much more the
    blocks of all frames disagree than such noise makes them (their median, one at least), or the
    frame's own where its blocks disagree by more than chance, and what all blocks err alike.

    Args:
        seen: places frame by frame, the best first.
        pattern: of the feature.
        common: variances (2,) [px^2] of what all blocks of a frame err alike, frame by frame.
        sure: sigma [px] beyond which a place is not believed.
    """
    best = [places[0].registered for places in seen if places]
    gain = float(np.median([one.gain for one in best])) if best else 1.0
    # Frames that show something else are among them: the smaller half is of those that do not.
    noise = float(np.median([one.variance for one in best])) if best else 0.0
    changed = half_a_pixel(pattern) * float(np.var(pattern.box))

    def taken(one: Registered) -> bool:
        bearable = _NOISIER * noise * max(1.0, one.gain / gain) + changed * one.gain**2
        return one.gain >= _CONTRAST * gain and one.variance <= bearable

    good = [one for one in best if taken(one)]
    unevenness = max(1.0, float(np.median([one.unevenness for one in good]))) if good else 1.0
    white = float(np.mean([0.5 * np.trace(one.white) for one in good])) if good else 0.0
    place = np.full((len(seen), 2), np.nan)
    covariance = np.full((len(seen), 2, 2), np.nan)
    lost: list[Lost | None] = []
    for number, places in enumerate(seen):
        why = None
        if not places:
            why = Lost.GONE
        elif not taken(places[0].registered):
            why = Lost.UNLIKE
        elif any(taken(other.registered) for other in places[1:]):
            why = Lost.TWICE
        else:
            one = places[0].registered
            own = one.white * max(unevenness, one.unevenness / _by_chance(one.blocks))
            if common is not None:
                own = own + np.diag(common[number])
            if float(np.linalg.eigvalsh(own)[1]) > sure**2:
                why = Lost.UNSURE
            else:
                place[number], covariance[number] = places[0].place, own
        lost.append(why)
    return Judged(place, covariance, tuple(lost), unevenness, white)


@cache
def _by_chance(blocks: int) -> float:
    """An unevenness beyond which blocks disagree by more than chance.

    It is a mean of squares over x and y, with as many free scores each as blocks but one.
    """
    free = 2 * (blocks - 1)
    return float(chi2.ppf(1.0 - _CHANCE, free) / free)
