"""Solvers and transcriptions by the names that the command uses."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import Enum
from typing import Any, Final

from piezo_opt.identification import (
    CmaEs,
    Collocation,
    DifferentialEvolution,
    Ipopt,
    LevenbergMarquardt,
    MultipleShooting,
    NelderMead,
    ScipyLeastSquares,
    SingleShooting,
)


class SolverName(Enum):
    """Solvers by name."""

    LM = "lm"
    SCIPY = "scipy"
    NELDER_MEAD = "nelder-mead"
    DIFFERENTIAL_EVOLUTION = "differential-evolution"
    CMA_ES = "cma-es"
    IPOPT = "ipopt"


class EffortName(Enum):
    """What a search for missing effects may spend, by name."""

    QUICK = "quick"
    NORMAL = "normal"
    THOROUGH = "thorough"


class TranscriptionName(Enum):
    """Transcriptions by name."""

    SINGLE = "single"
    MULTIPLE = "multiple"
    COLLOCATION = "collocation"


class IntervalsName(Enum):
    """Ways to intervals by fitting again."""

    BOOTSTRAP = "bootstrap"
    PROFILE = "profile"


_SOLVERS: Final[Mapping[SolverName, Callable[[], Any]]] = {
    SolverName.LM: LevenbergMarquardt,
    SolverName.SCIPY: ScipyLeastSquares,
    SolverName.NELDER_MEAD: NelderMead,
    SolverName.DIFFERENTIAL_EVOLUTION: DifferentialEvolution,
    SolverName.CMA_ES: CmaEs,
    SolverName.IPOPT: Ipopt,
}
_TRANSCRIPTIONS: Final[Mapping[TranscriptionName, Callable[[], Any]]] = {
    TranscriptionName.SINGLE: SingleShooting,
    TranscriptionName.MULTIPLE: MultipleShooting,
    TranscriptionName.COLLOCATION: Collocation,
}


def solver(name: SolverName | None) -> Any:
    """The solver of that name with its own defaults; None for the transcription's choice."""
    return None if name is None else _SOLVERS[name]()


def transcription(name: TranscriptionName) -> Any:
    """The transcription of that name with its own defaults."""
    return _TRANSCRIPTIONS[name]()
