"""One fit as the commands make it: choices by name, progress on a terminal, workers."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Final, final

from piezo_opt.cli import choices
from piezo_opt.cli import options as o
from piezo_opt.cli.choices import TranscriptionName
from piezo_opt.cli.codes import INTERRUPTED
from piezo_opt.cli.declare import Exit
from piezo_opt.cli.limiting import limit_of
from piezo_opt.cli.telling import telling
from piezo_opt.errors import InputError
from piezo_opt.identification import Ending, Fit, Identification, Progress, solve
from piezo_opt.identification.stuck import explains_nothing
from piezo_opt.spread import deaf
from piezo_opt.stopping import TimeLimit
from piezo_opt.units import show


@final
@dataclass(frozen=True)
class Solving:
    """How a question is solved: options of the commands that make one fit."""

    solver: o.Solver = None
    transcription: o.Transcription = TranscriptionName.SINGLE
    starts: o.Starts = 1
    seed: o.Seed = 0
    log: o.Log = None
    workers: o.Workers = 1
    max_time: o.MaxTime = None

    @property
    def seconds(self) -> float | None:
        """The limit of time [s]; None without one.

        Raises:
            InputError: it is no positive time.
        """
        return limit_of(self.max_time).seconds

    def fit(
        self,
        question: Identification,
        remarks: tuple[str, ...],
        what: str = "Fit",
        limit: TimeLimit | None = None,
    ) -> Fit:
        """Solve, saying how far it is; the remarks join those of the fit.

        Args:
            question: the question.
            remarks: sentences of the choice of the model.
            what: the work, as it is told.
            limit: of the whole command, where it has more than one fit; else this one's own.
        """
        with telling(what) as tell, pool(self.workers) as executor:
            answer = solve(
                question,
                transcription=choices.transcription(self.transcription),
                solver=choices.solver(self.solver),
                starts=self.starts,
                seed=self.seed,
                executor=executor,
                log=self.log,
                progress=_counted(tell),
                max_time=self.seconds if limit is None else limit.left,
            )
        return replace(answer, remarks=(*remarks, *answer.remarks))


AS_USUAL: Final = Solving()
"""One start, with the solver that suits."""


def exit_code(fit: Fit) -> int:
    """0; 130 after an interrupt, as a shell expects."""
    return INTERRUPTED if fit.outcome.ending is Ending.INTERRUPTED else 0


def leave(fit: Fit) -> None:
    """End the command with the code that the fit's ending asks for.

    Raises:
        InputError: the fit explains nothing.
    """
    code = exit_code(fit)
    if code:
        raise Exit(code)
    if explains_nothing(fit):
        raise InputError(
            "The fit explains nothing of the reading, a constant does as well: look at the record "
            "with piezo-opt check."
        )


@contextmanager
def pool(workers: int) -> Iterator[Executor | None]:
    """Processes that share the work; None for one alone."""
    if workers == 1:
        yield None
        return
    # A forked child would share the threads of libraries that are already loaded.
    context = multiprocessing.get_context("spawn")
    processes = ProcessPoolExecutor(workers, mp_context=context, initializer=deaf)
    before = set(multiprocessing.active_children())
    try:
        yield processes
    finally:
        # Whatever is needed has been handed over by now; what still runs was interrupted.
        processes.shutdown(wait=False, cancel_futures=True)
        for child in set(multiprocessing.active_children()) - before:
            child.terminate()


def _counted(tell: Callable[[str], None]) -> Callable[[Progress], None]:
    """An iteration in words."""

    def told(progress: Progress) -> None:
        tell(
            f"iteration {progress.iteration}, rms {show(progress.rms, 'm')}, "
            f"{progress.elapsed_s:.1f} s (Ctrl-C keeps the best so far)"
        )

    return told
