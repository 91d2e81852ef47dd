"""The process that reads, fits and searches, so that the server never waits and never falls.

A :class:`Job` goes in by a pipe; what is found on the way comes back as messages, the last of
which is :class:`Ended`. An interrupt (SIGINT) ends the job that runs, with the best so far where
there is one, and nothing else.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from enum import Enum
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeAlias, final

from piezo_opt.errors import InputError, PiezoOptError
from piezo_opt.measurement import Campaign, Check, FloatArray
from piezo_opt.readers import headers
from piezo_opt.workbench.answers import (
    Checked,
    Fitted,
    Judged,
    Looked,
    Planned,
    Scored,
    fitted,
    judged,
    looked,
    planned,
    read,
    scored,
)
from piezo_opt.workbench.edits import Adopt, begin
from piezo_opt.workbench.load import Load
from piezo_opt.workbench.session import Session

if TYPE_CHECKING:  # loaded when they are needed, or while nothing is asked
    from piezo_opt.identification import Fit, Progress
    from piezo_opt.identification.monitor import ProgressCallback


_EVERY_S: Final = 0.5
"""After which the curve of a model that is being solved is drawn again."""
_VISIBLE: Final = 0.02
"""Change of the error that is worth telling."""
_SMALL: Final = 1 << 22
"""[bytes] A file below that is read again for its headers without being noticed."""


class Kind(Enum):
    """What a job is for."""

    LOOK = "look"
    FIT = "fit"
    SCORE = "score"
    SEARCH = "search"
    NEXT = "next"
    REPORT = "report"
    C = "c"


@final
@dataclass(frozen=True)
class Job:
    """One piece of work, told whole: a worker that has forgotten everything can do it.

    Attributes:
        kind: what for.
        session: the records and the steps that hold.
        target: file or folder to write, for a report or C.
    """

    kind: Kind
    session: Session
    target: str = ""


@final
@dataclass(frozen=True)
class Begun:
    """A step is being solved: how many edits it has."""

    depth: int


@final
@dataclass(frozen=True)
class Iterate:
    """One iterate of the step that is being solved."""

    number: int
    rms: float


@final
@dataclass(frozen=True, eq=False)
class Drawn:
    """What the model reads of each record at the last iterate [m]."""

    readings: tuple[FloatArray, ...]


@final
@dataclass(frozen=True, eq=False)
class Solved:
    """A step, by the edits that led to it."""

    depth: int
    fit: Fitted


@final
@dataclass(frozen=True, eq=False)
class Ahead:
    """The best of a search so far: the edit that takes it over, and its fit without statistics."""

    edit: Adopt
    fit: Fitted


@final
@dataclass(frozen=True, eq=False)
class Found:
    """What a search found: the edit that takes it over (None for nothing), in words."""

    edit: Adopt | None
    sentences: tuple[str, ...]


@final
@dataclass(frozen=True)
class Headers:
    """How the columns of the first file are headed."""

    names: tuple[str, ...]


@final
@dataclass(frozen=True)
class Ended:
    """The job is over: why it could not be done, in a sentence, or nothing."""

    failed: str = ""


Message: TypeAlias = (
    Begun | Iterate | Drawn | Solved | Ahead | Found | Ended
    | Looked | Checked | Judged | Scored | Planned | Headers | str
)  # fmt: skip


@final
class _Line:
    """The way back to the server; an interrupt waits until a message is whole."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._sending = self._asked = self._working = False
        signal.signal(signal.SIGINT, self._interrupt)

    def send(self, message: Message) -> None:
        """Hand a message over.

        Raises:
            KeyboardInterrupt: the job was interrupted meanwhile.
        """
        self._sending = True
        try:
            self._connection.send(message)
        finally:
            self._sending = False
        if self._asked and self._working:
            self._asked = False
            raise KeyboardInterrupt

    @contextmanager
    def working(self) -> Iterator[None]:
        """A block in which an interrupt is heard."""
        self._asked, self._working = False, True
        try:
            yield
        finally:
            self._working = False

    def _interrupt(self, *_: object) -> None:
        if self._working and self._sending:
            self._asked = True
        elif self._working:
            raise KeyboardInterrupt


@final
class _Memory:
    """Records and fits of this process, by what led to them."""

    def __init__(self) -> None:
        self._load: Load | None = None
        self._check: Check | None = None
        self._fits: dict[str, Fit] = {}
        self._remarks: tuple[str, ...] = ()

    def check(self, load: Load, tell: Callable[[Campaign], None] = lambda _: None) -> Check:
        """What the records show; these are told before it is known."""
        known = None if load != self._load else self._check
        records = load.records() if known is None else known.given
        tell(records)
        if known is None:
            known = load.checked(records)
            self._load, self._check, self._fits = load, known, {}
        return known

    def fit(self, session: Session, send: Callable[[Message], None], *, tell: bool) -> Fit:
        """The fit of the steps that hold; what is not known of the way there is solved now."""
        from piezo_opt.identification import (
            Ending,
            Identification,
            as_driven,
            default_model,
            solve,
        )

        records = self.check(session.load).fit_for_use()
        fit: Fit | None = None
        for depth in range(session.depth + 1):
            at = replace(session, depth=depth)
            known = self._fits.get(at.key)
            if known is None:
                send(Begun(depth))
                if fit is None:
                    driven, held = as_driven(records)
                    model, remarks = default_model(driven)
                    self._remarks = (*held, *remarks)
                    question, start = Identification(model, driven), None
                else:
                    question, start = at.path[-1].question(fit), begin(at.path[-1], fit)
                known = solve(question, start=start, progress=_showing(send, curves=tell))
                if known.outcome.ending is Ending.INTERRUPTED:
                    raise KeyboardInterrupt
                self._fits[at.key] = known
            fit = known
            if tell:
                send(Solved(depth, fitted(fit, self._remarks if depth == 0 else ())))
        assert fit is not None
        return fit


def _showing(send: Callable[[Message], None], *, curves: bool) -> ProgressCallback:
    """Tells every iterate, and now and then what the model reads there, where it is to be seen."""
    last = -math.inf

    def told(progress: Progress) -> None:
        nonlocal last
        send(Iterate(progress.iteration, progress.rms))
        if curves and progress.readings and time.monotonic() - last > _EVERY_S:
            send(Drawn(progress.readings))
            last = time.monotonic()

    return told


def run(connection: Connection) -> None:
    """Do jobs until the other end of the pipe is closed, or the server is no more."""
    threading.Thread(target=_end_with_the_server, daemon=True).start()
    line, memory = _Line(connection), _Memory()
    while True:
        try:
            job: Job = connection.recv()
        except (EOFError, OSError):
            return
        line.send(Ended(_done(job, memory, line)))
        if job.kind is Kind.LOOK and not connection.poll():
            _warm()


def _end_with_the_server() -> None:
    """A search must not go on for minutes when the server was killed."""
    server = multiprocessing.parent_process()
    if server is not None:
        server.join()
        os._exit(1)


def _warm() -> None:
    """Load what the next click needs, and compile it where that was never done, while nobody waits.

    What fails here fails again, and is told, when it is asked for.
    """
    with suppress(Exception):
        import piezo_opt.diagnosis
        from piezo_opt.simulation.library import catalogue

        assert piezo_opt.diagnosis
        catalogue()


def _done(job: Job, memory: _Memory, line: _Line) -> str:
    """Does a job; why it could not be done, or nothing."""
    try:
        with line.working():
            _do(job, memory, line.send)
    except KeyboardInterrupt:
        return "Stopped: the model is as it was before."
    except PiezoOptError as error:
        return " ".join(str(error).split())
    except MemoryError:
        return "There is not enough memory: cut the record or thin it."
    except Exception as error:
        said = " ".join(str(error).split())[:300]
        return f"An error of the program itself, not of the input ({type(error).__name__}: {said})."
    return ""


def _do(job: Job, memory: _Memory, send: Callable[[Message], None]) -> None:
    session = job.session
    match job.kind:
        case Kind.LOOK:
            _look(memory, session.load, send)
        case Kind.FIT:
            memory.fit(session, send, tell=True)
        case Kind.SCORE:
            from piezo_opt.diagnosis import diagnose

            fit = memory.fit(session, send, tell=False)
            send(judged(fit))
            send(scored(diagnose(fit, ladder=False)))
        case Kind.SEARCH:
            _search(memory.fit(session, send, tell=False), send)
        case Kind.NEXT:
            _next(memory.fit(session, send, tell=False), send)
        case Kind.REPORT:
            _report(memory, session, job.target, send)
        case Kind.C:
            from piezo_opt.export import export_c

            send(str(export_c(memory.fit(session, send, tell=False), job.target)))


def _look(memory: _Memory, load: Load, send: Callable[[Message], None]) -> None:
    """The records, and the columns that there are to choose from."""
    first = load.sources[0].path if load.sources else ""
    small = os.path.exists(first) and os.path.getsize(first) < _SMALL
    try:
        send(looked(memory.check(load, lambda records: send(read(records)))))
    except PiezoOptError:
        small = True
        raise
    finally:
        if small:
            with suppress(PiezoOptError):
                send(Headers(headers(first)))


def _search(fit: Fit, send: Callable[[Message], None]) -> None:
    from piezo_opt.diagnosis import diagnose

    told = fit

    def better(best: Fit) -> None:
        nonlocal told
        if best.model != told.model or abs(best.rms - told.rms) > _VISIBLE * told.rms:
            told = best
            send(Ahead(_adopted(best), fitted(best, ())))

    found = diagnose(fit, progress=send, better=better)
    final = found.final
    same = final.model == fit.model and final.question.free == fit.question.free
    edit = None if same else _adopted(final)
    if found.experiments:
        send(planned(found.experiments, found.invisible))
    send(Found(edit, (found.headline, *found.structure.clues, *found.advice)))


def _adopted(fit: Fit) -> Adopt:
    return Adopt(fit.model, fit.question.free, dict(fit.values))


def _next(fit: Fit, send: Callable[[Message], None]) -> None:
    """The drives that would show what this record could not have shown."""
    from piezo_opt.diagnosis import diagnose
    from piezo_opt.diagnosis.advice import experiments
    from piezo_opt.effects.catalogue import CATALOGUE

    noise = diagnose(fit, ladder=False).noise.rms
    offered = [e for kind in CATALOGUE.values() if not kind.structural for e in kind.entries()]
    send("comparing drives")
    send(planned(*experiments((), fit, offered, noise, hidden=True)))


def _report(
    memory: _Memory, session: Session, target: str, send: Callable[[Message], None]
) -> None:
    from piezo_opt.comparison import compare
    from piezo_opt.report import write_report

    depths = range(session.depth + 1)
    fits = [memory.fit(replace(session, depth=d), send, tell=False) for d in depths]
    if not fits:
        raise InputError("There is no fit yet: fit the model first.")
    write_report(Path(target), fits[-1], compare(*fits), title="Workbench", overwrite=True)
