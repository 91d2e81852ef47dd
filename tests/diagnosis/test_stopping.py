"""Ending a diagnosis early loses nothing that was accepted, and begins nothing new."""

from __future__ import annotations

import re
import signal
import threading
import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.diagnosis.book import Book
from piezo_opt.diagnosis.diagnose import Stopped, diagnose
from piezo_opt.diagnosis.frontier import Frontier
from piezo_opt.diagnosis.members import Members
from piezo_opt.identification import Ending
from piezo_opt.identification.monitor import Monitor
from piezo_opt.stopping import Pool, TimeLimit
from problems import hidden_effect
from tests.diagnosis.plants import but

following = Frontier.next


def test_a_pool_begins_nothing_after_an_interrupt() -> None:
    began: list[int] = []
    gate = threading.Event()

    def work(index: int) -> None:
        began.append(index)
        gate.wait(5.0)

    def interrupted() -> None:
        with Pool(max_workers=1) as pool:
            for index in range(5):
                pool.submit(work, index)
            while not began:
                time.sleep(0.001)
            threading.Timer(0.05, gate.set).start()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert began == [0]


def test_the_main_thread_is_interrupted_within_the_block_only() -> None:
    limit = TimeLimit(0.05)
    with pytest.raises(KeyboardInterrupt), limit:
        threading.Event().wait(5.0)
    assert limit.passed
    with pytest.raises(KeyboardInterrupt), limit:
        raise AssertionError("a block after the limit was entered")
    with TimeLimit(0.05):
        pass
    time.sleep(0.1)
    with TimeLimit(None) as never:
        never.check()


def test_a_process_in_the_background_is_deaf_to_interrupts_and_limited_all_the_same() -> None:
    """A shell starts what runs in its background with interrupts ignored."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with pytest.raises(KeyboardInterrupt), TimeLimit(0.05):
            threading.Event().wait(5.0)
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_threads_at_work_hear_that_their_block_was_interrupted() -> None:
    outer, heard = TimeLimit(None), threading.Event()

    def work() -> None:
        try:
            for _ in range(500):
                time.sleep(0.002)
                outer.check()
        except KeyboardInterrupt:
            heard.set()

    def interrupted() -> None:
        with outer, Pool(max_workers=1) as pool:
            pool.submit(work)
            signal.pthread_kill(threading.get_ident(), signal.SIGINT)
            time.sleep(5.0)

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert heard.is_set()
    outer.check()  # and nobody after it


def test_the_end_of_an_inner_block_does_not_end_the_outer_one() -> None:
    with TimeLimit(60.0) as outer:
        with pytest.raises(KeyboardInterrupt), TimeLimit(0.05):
            threading.Event().wait(5.0)
        outer.check()


@pytest.mark.parametrize("limit", [0.05, None])
def test_an_interrupt_that_a_library_turns_into_an_error_is_one_all_the_same(
    limit: float | None,
) -> None:
    """CasADi says that it was given arguments of a wrong type."""

    def swallowed() -> None:
        if limit is None:
            threading.Timer(0.05, signal.pthread_kill, (threading.get_ident(), 2)).start()
        try:
            threading.Event().wait(5.0)
        except KeyboardInterrupt:
            raise NotImplementedError("wrong type of arguments") from None

    with pytest.raises(KeyboardInterrupt) as caught, TimeLimit(limit):
        swallowed()
    assert isinstance(caught.value.__cause__, NotImplementedError)
    with pytest.raises(ValueError, match="not heard"), TimeLimit(limit):
        raise ValueError("not heard")
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_the_fit_of_the_base_model_heeds_the_limit_of_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stepping = Monitor.iterate

    def slowly(monitor: Monitor, *state: Any) -> None:
        time.sleep(0.1)
        stepping(monitor, *state)

    monkeypatch.setattr(Monitor, "iterate", slowly)
    train, _ = hidden_effect.data().split(hidden_effect.SPLIT)
    question = po.Identification(po.default_model(train)[0], train)
    begin = time.monotonic()
    found = diagnose(question, withhold=but("creep"), max_time=0.25)
    assert time.monotonic() - begin < 3.0
    assert found.stopped is Stopped.LIMIT
    assert found.fit.outcome.ending is Ending.LIMIT
    assert found.fit.trace.rms.size <= 3
    assert found.verdict == "open"


def interrupted(frontier: Frontier, *, quiet: bool) -> list[Members]:
    """After the base model's neighbours were fitted, before the best of them is expanded."""
    if frontier.expanded:
        raise KeyboardInterrupt
    return following(frontier, quiet=quiet)


def test_what_was_accepted_before_an_interrupt_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Frontier, "next", interrupted)
    train, test = hidden_effect.data().split(hidden_effect.SPLIT)
    found = diagnose(train, test=test, withhold=but("creep", "drift"))
    assert found.stopped is Stopped.USER
    assert [step.name for step in found.steps] == ["creep"]
    assert found.verdict == "missing"
    assert found.final.rms < 0.4 * found.fit.rms
    assert found.headline.startswith("Not finished, the best when it was interrupted. Missing:")


def test_an_answer_that_is_interrupted_while_it_is_read_is_told_from_what_is_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    concluding, times = Book.conclude, []

    def concluded(book: Book) -> None:
        concluding(book)
        times.append(book.brief)
        if len(times) == 1:
            raise KeyboardInterrupt

    monkeypatch.setattr(Book, "conclude", concluded)
    train, _ = hidden_effect.data().split(hidden_effect.SPLIT)
    found = diagnose(train, withhold=but("creep", "drift"))
    assert times == [False, True]  # the second time no fit goes on after its first iterations
    assert found.stopped is Stopped.USER
    assert [step.name for step in found.steps] == ["creep"]


def test_the_nearest_name_so_far_is_no_answer_while_more_than_noise_is_left(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(Frontier, "next", interrupted)
    train, _ = hidden_effect.data().split(hidden_effect.SPLIT)
    hum = 10.0 * hidden_effect.noise_rms() * np.sin(300.0 * train.time)
    found = diagnose(replace(train, position=train.position + hum), withhold=but("creep"))
    assert found.stopped is Stopped.USER
    assert [step.name for step in found.steps] == ["creep"]
    assert found.verdict == "open"
    assert re.fullmatch(
        r"Not finished: when it was interrupted, creep had brought the error from .* to .*, "
        r"which is more than noise\.",
        found.headline,
    )


def test_structure_is_told_though_there_was_no_time_to_say_where_it_enters() -> None:
    def interrupt(sentence: str) -> None:
        if sentence.startswith("looking for the smallest correction"):
            raise KeyboardInterrupt

    train, _ = hidden_effect.data().split(hidden_effect.SPLIT)
    hum = 10.0 * hidden_effect.noise_rms() * np.sin(300.0 * train.time)
    disturbed = replace(train, position=train.position + hum)
    found = diagnose(
        disturbed, withhold=but("creep"), progress=interrupt, effort=po.Effort.QUICK
    )  # fmt: skip
    assert found.stopped is Stopped.USER
    assert found.structure.left
    assert found.verdict == "unexplained"
    assert found.unexplained is None
    assert "Unexplained" in found.headline
    assert found.to_dict()["unexplained"] is None
