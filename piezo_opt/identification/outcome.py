"""How a solver ended, and what it did on the way."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import final

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class Ending(Enum):
    """How a solver ended."""

    CONVERGED = "converged"
    LIMIT = "limit"
    """The limit of iterations or evaluations was reached."""
    INTERRUPTED = "interrupted"
    """Stopped by the user; the best so far is kept."""
    FAILED = "failed"
    """No finite or no better point was found."""


@final
@dataclass(frozen=True)
class Outcome:
    """How it ended, as a word and as a sentence that names the remedy.

    Attributes:
        ending: the word.
        sentence: the sentence.
        far: error over the noise in its highest frequencies, where that is more than ten; else 0.
        promised: of one that was stopped, the error [m] after a full Gauss-Newton step, were the
            reading linear in the unknowns; None where nobody asked.
    """

    ending: Ending
    sentence: str
    far: float = 0.0
    promised: float | None = None

    @property
    def success(self) -> bool:
        """Whether the solver converged."""
        return self.ending is Ending.CONVERGED


@final
@dataclass(frozen=True, eq=False)
class Trace:
    """Every iterate of the solver.

    Attributes:
        names: the unknowns.
        values: (iterations, k) SI values.
        rms: (iterations,) root mean square of the counted residuals [m].
    """

    names: tuple[str, ...]
    values: FloatArray
    rms: FloatArray


@final
@dataclass(frozen=True)
class Evaluations:
    """Simulations spent over all records and phases, start values included."""

    simulations: int
    with_sensitivities: int

    @property
    def total(self) -> int:
        """Both kinds together."""
        return self.simulations + self.with_sensitivities
