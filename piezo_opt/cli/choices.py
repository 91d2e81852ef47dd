"""Solvers and transcriptions by the names that the command uses."""

from __future__ import annotations

from enum import Enum
from typing import Any

from piezo_opt import identification


class SolverName(Enum):
    """Solvers by name; the value is also the name in tables, with dashes."""

    LM = "lm"
    SCIPY = "scipy"
    NELDER_MEAD = "nelder-mead"
    DIFFERENTIAL_EVOLUTION = "differential-evolution"
    CMA_ES = "cma-es"
    IPOPT = "ipopt"


class TranscriptionName(Enum):
    """Transcriptions by name."""

    SINGLE = "single"
    MULTIPLE = "multiple"
    COLLOCATION = "collocation"


_SOLVERS = {
    SolverName.LM: "LevenbergMarquardt",
    SolverName.SCIPY: "ScipyLeastSquares",
    SolverName.NELDER_MEAD: "NelderMead",
    SolverName.DIFFERENTIAL_EVOLUTION: "DifferentialEvolution",
    SolverName.CMA_ES: "CmaEs",
    SolverName.IPOPT: "Ipopt",
}
_TRANSCRIPTIONS = {
    TranscriptionName.SINGLE: "SingleShooting",
    TranscriptionName.MULTIPLE: "MultipleShooting",
    TranscriptionName.COLLOCATION: "Collocation",
}


def solver(name: SolverName | None) -> Any:
    """The solver of that name with its own defaults; None for the transcription's choice."""
    return None if name is None else getattr(identification, _SOLVERS[name])()


def transcription(name: TranscriptionName) -> Any:
    """The transcription of that name with its own defaults."""
    return getattr(identification, _TRANSCRIPTIONS[name])()
