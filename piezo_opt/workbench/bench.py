"""The state of a page: the session, what is known of its steps, the worker, and who listens."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import socket
import threading
from collections.abc import AsyncIterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, final

from piezo_opt.errors import InputError
from piezo_opt.measurement import FloatArray
from piezo_opt.workbench.answers import Checked, Fitted, Judged, Looked, Planned, Scored
from piezo_opt.workbench.edits import Edit
from piezo_opt.workbench.load import Load
from piezo_opt.workbench.process import Worker, begin
from piezo_opt.workbench.session import Session
from piezo_opt.workbench.worker import (
    Ahead,
    Begun,
    Drawn,
    Ended,
    Found,
    Headers,
    Iterate,
    Job,
    Kind,
    Message,
    Solved,
)

Event = tuple[str, Any]

_AGAIN_S: Final = 0.05
"""After which a search that was stopped is interrupted again: it would sum up what it has found."""
_WAITING: Final = 1000
"""Events that a page may lag behind; one that has gone to sleep is let go, and asks again."""
_MANY: Final = 200_000
"""Samples from which only the curves of the last suspects are kept."""
_NAMES: Final = {
    Kind.LOOK: "reading the records",
    Kind.FIT: "fitting",
    Kind.SCORE: "scoring what is absent",
    Kind.SEARCH: "finding all that is missing",
    Kind.NEXT: "looking for what to play next",
    Kind.REPORT: "drawing the report",
    Kind.C: "writing and compiling C",
}


@final
class Bench:
    """One session and its worker; used in one event loop.

    Args:
        session: where it begins.
        file: where every step is kept.
    """

    def __init__(self, session: Session, file: Path) -> None:
        self.session = session
        self.file = file
        self.version = 0
        self.looked: Looked | None = None
        self.drawn: tuple[FloatArray, ...] | None = None
        self.fits: dict[int, Fitted] = {}
        self.judged: dict[int, Judged] = {}
        self.scores: dict[int, Scored] = {}
        self.headers: tuple[str, ...] = ()
        self.plan: Planned | None = None
        self.sentences: tuple[str, ...] = ()
        self.problem = ""
        self.unkept = ""
        self._listeners: set[asyncio.Queue[Event | None]] = set()
        self._job: Job | None = None
        self._waiting: list[Job] = []
        self._before = session
        self._known: tuple[dict[int, Fitted], dict[int, Judged], dict[int, Scored]] = ({}, {}, {})
        self._iterates: list[float] = []
        self._solving = -1
        self._best: Ahead | None = None
        self._unsolved = -1
        self._stopped = False
        self._results: dict[int, asyncio.Future[str]] = {}
        self._begun: Worker | None = None
        self._ahead: Job | None = None
        self._worker: Worker | None = None
        self._loop: asyncio.AbstractEventLoop | None = None

    # What a page may do

    def ahead(self, listening: socket.socket) -> None:
        """Have the records read already, while the server is still being loaded.

        Args:
            listening: the server's own, which is none of the worker's business.
        """
        self._begun = begin(listening)
        if self.session.load.sources:
            self._ahead = Job(Kind.LOOK, self.session)
            with contextlib.suppress(OSError):  # where it has died, its listener says so
                self._begun.pipe.send(self._ahead)

    def open(self) -> None:
        """Read the records of the session, and go through its steps again."""
        if self.session.load.sources:
            self._begin(self._ahead or Job(Kind.LOOK, self.session))
            if self.session.fitted:
                self._begin(Job(Kind.FIT, replace(self.session, depth=len(self.session.edits))))
        self._changed()

    def load(self, load: Load) -> None:
        """Other records, or other answers to their check: the steps begin anew."""
        self._idle()
        if self.session.fitted:
            self._keep_aside()
        self._set(Session(load))
        self.looked, self.fits, self.judged, self.scores, self.sentences = None, {}, {}, {}, ()
        self.plan, self.headers = None, ()
        if load.sources:
            self._begin(Job(Kind.LOOK, self.session))

    def fit(self) -> None:
        """Fit the default model."""
        self._idle()
        if self.looked is None or not self.looked.told["fit_for_use"]:
            raise InputError("There is no record fit for use: load one, and answer its check.")
        if self.session.fitted:
            raise InputError("The model is fitted already.")
        self._set(replace(self.session, fitted=True))
        self._begin(Job(Kind.FIT, self.session))

    def edit(self, edit: Edit) -> None:
        """One step more."""
        self._idle()
        self._need_fit()
        self.plan = None
        self._step(edit)

    def undo(self) -> None:
        """One step back."""
        self._idle()
        self._move(self.session.undone())

    def redo(self) -> None:
        """A step that was undone."""
        self._idle()
        self._move(self.session.redone())

    def search(self) -> None:
        """Find all that is missing."""
        self._idle()
        self._need_fit()
        self.sentences = ()
        self._best, self._stopped = None, False
        self._begin(Job(Kind.SEARCH, self.session))

    def next(self) -> None:
        """What this record cannot tell, and the drives that would."""
        self._idle()
        self._need_fit()
        self._begin(Job(Kind.NEXT, self.session))

    def cancel(self) -> None:
        """End the job that runs, with the best so far where there is one."""
        if self._job is None:
            raise InputError("Nothing runs that could be stopped.")
        if self._job.kind is Kind.SEARCH and not self._stopped:
            self._stop(self._job)
        else:
            self._interrupt()

    async def made(self, kind: Kind, target: Path) -> str:
        """Have a worker write a file or folder; what it said.

        Raises:
            InputError: it could not be written.
        """
        self._idle()
        self._need_fit()
        job = Job(kind, self.session, str(target))
        future = asyncio.get_running_loop().create_future()
        self._results[id(job)] = future
        self._begin(job)
        try:
            return str(await future)
        finally:
            self._results.pop(id(job), None)

    # What a page sees

    def state(self) -> dict[str, Any]:
        """All that the page shows but the curves."""
        depth, at = self.session.depth, self.shown
        now, judged, score = self.fits.get(at), self.judged.get(at), self.scores.get(at)
        steps = ["default model", *(edit.title for edit in self.session.edits)]
        shown = self.session.fitted
        return {
            "version": self.version,
            "file": str(self.file),
            "busy": "" if self._job is None else _NAMES[self._kind],
            "kind": "" if self._job is None else self._kind.value,
            "problem": " ".join(filter(None, (self.problem, self.unkept))),
            "sentences": list(self.sentences),
            "load": self.session.load.to_dict(),
            "headers": list(self.headers),
            "records": None if self.looked is None else self.looked.told,
            "steps": [
                {
                    "title": title,
                    "rms": self.fits[n].told["rms"] if n in self.fits else None,
                    "rms_text": self.fits[n].told["rms_text"] if n in self.fits else "",
                    "trace": list(self.fits[n].trace) if n in self.fits else [],
                }
                for n, title in enumerate(steps if shown else [])
            ],
            "depth": depth,
            "shown": at,
            "solving": self._solving,
            "iterates": list(self._iterates),
            "fit": None if now is None else {k: v for k, v in now.told.items() if k != "json"},
            "where": None if judged is None else list(judged.sentences),
            "scores": None if score is None else score.told,
            "plan": None
            if self.plan is None
            else {
                "drives": [{"name": d.name, "sentence": d.sentence} for d in self.plan.drives],
                "never": list(self.plan.never),
            },
        }

    @property
    def _kind(self) -> Kind:
        """What the job that runs is for; a search that was stopped only makes way for a fit."""
        assert self._job is not None
        return Kind.FIT if self._stopped else self._job.kind

    @property
    def settled(self) -> Fitted | None:
        """The fit of the steps that hold; None where there is none, or it is still solved."""
        depth = self.session.depth
        known = self.session.fitted and depth != self._unsolved
        return self.fits.get(depth) if known else None

    @property
    def shown(self) -> int:
        """The step whose fit is shown: while one is solved, the last before it; -1 for none."""
        depth = self.session.depth if self.session.fitted else -1
        return max((d for d in self.fits if d <= depth), default=-1)

    async def events(self) -> AsyncIterator[Event]:
        """The state now, and whatever happens from now on."""
        queue: asyncio.Queue[Event | None] = asyncio.Queue(_WAITING)
        self._listeners.add(queue)
        try:
            yield "state", self.state()
            while (event := await queue.get()) is not None:
                yield event
        finally:
            self._listeners.discard(queue)

    def let_go(self) -> None:
        """Let go of the pages: a server that ends waits for those that listen."""
        for queue in list(self._listeners):
            with contextlib.suppress(asyncio.QueueFull):
                queue.put_nowait(None)

    def close(self) -> None:
        """End the worker, and let go of the pages."""
        self._loop = None
        worker, self._worker = self._worker or self._begun, None
        if worker is not None:
            worker.process.kill()
            worker.process.join(5)
            worker.pipe.close()
        if self.unkept:
            self._keep()
        self.let_go()

    # Jobs

    def _idle(self) -> None:
        """Refuse where something runs that must not be disturbed; scores are only helpful."""
        if self._job is not None and self._job.kind is not Kind.SCORE:
            raise InputError(f"Wait, or stop it first: {_NAMES[self._job.kind]}.")

    def _need_fit(self) -> None:
        if self.settled is None:
            raise InputError("There is no fit yet: fit the model first.")

    def _step(self, edit: Edit) -> None:
        before, self.problem = self.session, ""
        self._known = (dict(self.fits), dict(self.judged), dict(self.scores))
        self._set(before.with_(edit))
        self._before = before
        depth = self.session.depth
        self.fits = {d: fit for d, fit in self.fits.items() if d < depth}
        self.judged = {d: judged for d, judged in self.judged.items() if d < depth}
        self.scores = {d: score for d, score in self.scores.items() if d < depth}
        self._begin(Job(Kind.FIT, self.session))

    def _stop(self, job: Job) -> None:
        """Take over the best of a search at once; its numbers are solved once more behind it."""
        best, self._stopped = self._best, True
        self.sentences = (
            "Not finished: the search was stopped. "
            + (
                "It had found nothing better so far."
                if best is None
                else "The best that it had found so far is the model now."
            ),
        )
        if best is not None:
            self._step(best.edit)
            self._unsolved = self.session.depth
            self.fits[self._unsolved] = best.fit
        self._changed()
        self._interrupt_until_over(job)

    def _interrupt_until_over(self, job: Job) -> None:
        if self._job is job and self._loop is not None:
            self._interrupt()
            self._loop.call_later(_AGAIN_S, self._interrupt_until_over, job)

    def _move(self, session: Session) -> None:
        self.problem, self.plan = "", None
        self._set(session)
        if session.depth not in self.fits:
            self._begin(Job(Kind.FIT, session))
        elif session.depth not in self.scores:
            self._begin(Job(Kind.SCORE, session))

    def _begin(self, job: Job) -> None:
        """Do a job now, or after the one that runs; scores that run make way."""
        self._waiting.append(job)
        if self._job is None:
            self._next()
        elif self._job.kind is Kind.SCORE:
            self._interrupt()

    def _next(self) -> None:
        self._job = self._waiting.pop(0) if self._waiting else None
        if self._job is not None:
            if self._worker is None:
                self._worker = self._listened(self._begun or begin())
                self._begun = None
            if self._job is not self._ahead:
                with contextlib.suppress(OSError):  # where it has died, its listener says so
                    self._worker.pipe.send(self._job)
        self._changed()

    def _listened(self, worker: Worker) -> Worker:
        """A worker with a thread that brings what it says into the event loop."""
        loop = self._loop = asyncio.get_running_loop()

        def listen() -> None:
            while True:
                try:
                    message: Message | None = worker.pipe.recv()
                except (EOFError, OSError):
                    message = None
                try:
                    loop.call_soon_threadsafe(self._heard, worker, message)
                except RuntimeError:
                    return  # the loop is closed
                if message is None:
                    return

        threading.Thread(target=listen, daemon=True).start()
        return worker

    def _interrupt(self) -> None:
        process = None if self._worker is None else self._worker.process
        if process is not None and process.pid is not None and process.is_alive():
            os.kill(process.pid, signal.SIGINT)

    def _heard(self, worker: Worker, message: Message | None) -> None:
        """One message of the worker; None when it has died."""
        if worker is not self._worker or self._loop is None:
            return
        job = self._job
        match message:
            case None:
                worker.process.join(5)
                code, self._worker = worker.process.exitcode, None
                self._over(
                    f"The process that computes has died ({code}); nothing is lost, and the next "
                    "click starts another."
                )
            case Begun(depth):
                self._solving, self._iterates, self.drawn = depth, [], None
                self._tell("begun", {"depth": depth})
            case Iterate(number, rms):
                self._iterates.append(rms)
                self._tell("iterate", {"number": number, "rms": rms})
            case Drawn(readings):
                self.drawn = readings
                self._tell("drawn", {})
            case Looked():
                self.looked, self.problem = message, ""
                self._changed()
            case Checked(told) if self.looked is not None:
                self.looked = replace(self.looked, told=told)
                self._changed()
            case Headers(names):
                self.headers = names
                self._changed()
            case Ahead():
                self._best = message
            case Solved(depth, fit):
                self.fits[depth], self.drawn = fit, None
                self._unsolved = -1 if depth == self._unsolved else self._unsolved
                self._changed()
            case Planned() | Found() if self._stopped:
                pass  # it was over by itself when it was stopped
            case Planned():
                self.plan = message
                self._changed()
            case Judged():
                assert job is not None
                self.judged[job.session.depth] = message
                self._changed()
            case Scored():
                assert job is not None
                if self.looked and sum(s[0].size for s in self.looked.signals) > _MANY:
                    self.scores.clear()
                self.scores[job.session.depth] = message
                self._changed()
            case Found(edit, sentences):
                self.sentences = sentences
                if edit is not None:
                    self._step(edit)
                self._changed()
            case str():
                if job is not None and id(job) in self._results:
                    self._results[id(job)].set_result(message)
                self._tell("said", message)
            case Ended(failed):
                self._over(failed)

    def _over(self, failed: str) -> None:
        """A job has ended; a step that could not be solved is taken back."""
        job, self._job = self._job, None
        self._solving, self._iterates, self.drawn = -1, [], None
        stopped, self._stopped = self._stopped, False
        if self.unkept:
            self._keep()
        if job is None:
            return
        future = self._results.get(id(job))
        if future is not None and not future.done():
            if failed:
                future.set_exception(InputError(failed))
            else:
                future.set_result("")
        elif failed and job.kind is not Kind.SCORE and not stopped:
            self.problem = failed
            if job.kind is Kind.FIT:
                if job.session.depth == self._unsolved:
                    del self.fits[self._unsolved]
                    self._unsolved = -1
                if job.session.depth not in self.fits:
                    self._take_back()
        depth = self.session.depth
        wanted = self.session.fitted and depth in self.fits and depth not in self.scores
        if wanted and not self._waiting and not failed:
            self._waiting.append(Job(Kind.SCORE, self.session))
        self._next()

    def _take_back(self) -> None:
        """The session as it was before a step that cannot be solved."""
        self._waiting = [j for j in self._waiting if j.kind is not Kind.FIT]
        solved = max(self.fits, default=-1)
        if solved < 0:
            if self.session.edits:
                try:
                    self._keep_aside()
                except InputError as error:  # then its own file stays as it is
                    self.problem = f"{self.problem} {error}"
                    return
            self._set(replace(self.session, fitted=False, edits=(), depth=0))
        elif self._before.depth in self.fits:
            self.fits, self.judged, self.scores = self._known
            self._set(self._before)
        else:
            self._set(replace(self.session, depth=min(self.session.depth, solved)))

    # Files and pages

    def _set(self, session: Session) -> None:
        """The session is another one now: kept at once."""
        self.session = self._before = session
        self.version += 1
        self._keep()
        self._changed()

    def _keep(self) -> None:
        """Write the session to its file; where that fails it is said, and tried again later."""
        try:
            self.session.save(self.file)
            self.unkept = ""
        except InputError as error:
            self.unkept = f"The session is not kept: {error}."

    def _keep_aside(self) -> None:
        """What was done with other records stays in a file of its own."""
        number = 1
        while (aside := self.file.with_name(f"{self.file.stem}-{number}.json")).exists():
            number += 1
        try:
            self.session.save(aside)
        except InputError as error:
            raise InputError(f"What was done so far could not be kept aside: {error}") from None

    def _changed(self) -> None:
        self._tell("state", self.state())

    def _tell(self, name: str, data: Any) -> None:
        for queue in list(self._listeners):
            try:
                queue.put_nowait((name, data))
            except asyncio.QueueFull:
                self._listeners.discard(queue)
