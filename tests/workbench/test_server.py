"""The server: who is answered, what is refused, and that the script gives the page's numbers."""

from __future__ import annotations

import json
import os
import runpy
import signal
import sys
import time
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from starlette.testclient import TestClient

from piezo_opt.effects import Creep
from piezo_opt.modelfile import read_model
from piezo_opt.workbench.app import _view, application
from piezo_opt.workbench.bench import Bench
from piezo_opt.workbench.edits import Add, Remove
from piezo_opt.workbench.load import Load, Source
from piezo_opt.workbench.session import Session, read_session
from tests.readers.damage import damaged

PORT = 8123
HOST = f"http://127.0.0.1:{PORT}"


class Page:
    """A page as a script sees it."""

    def __init__(self, bench: Bench, client: TestClient) -> None:
        self.bench, self.client = bench, client

    def get(self, path: str, **more: Any) -> Any:
        return self.client.get(f"/secret/{path}", **more)

    def do(self, what: str, **more: Any) -> Any:
        return self.client.post("/secret/do", json={"do": what, **more})

    def state(self, until: Callable[[dict[str, Any]], bool] = lambda s: not s["busy"]) -> Any:
        for _ in range(1200):
            state = self.get("state").json()
            if until(state):
                return state
            time.sleep(0.05)
        raise AssertionError(f"it never came: {state['busy']} {state['problem']}")

    def fitted(self) -> Any:
        """The state with a fit, whichever tests came before in this process."""
        state = self.state()
        return state if state["steps"] else self.step("fit")

    def step(self, what: str, **more: Any) -> Any:
        assert self.do(what, **more).status_code == 200
        return self.state()


@pytest.fixture(scope="module")
def page(record: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """One server and one worker for all tests: a process takes seconds to begin."""
    file = tmp_path_factory.mktemp("sessions") / "session.json"
    bench = Bench(Session(Load((Source(str(record)),))), file)
    with TestClient(application(bench, "secret", PORT), base_url=HOST) as client:
        yield Page(bench, client)


def test_records_are_shown_before_anything_is_fitted(page: Page) -> None:
    state = page.state()
    (told,) = state["records"]["records"]
    assert (told["name"], told["samples"], told["sampling"]) == ("loop", 400, "20 Hz")
    assert told["units"] == {"drive": "V", "position": "m"}
    assert state["records"]["fit_for_use"]
    assert (state["steps"], state["fit"]) == ([], None)
    assert page.do("find").json()["sentence"].startswith("There is no fit yet")


def test_a_story_gives_a_script_with_exactly_its_numbers(
    page: Page, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page.state()
    first = page.step("fit")
    assert [step["title"] for step in first["steps"]] == ["default model"]
    suspects = {s["name"]: s for s in first["scores"]["suspects"]}
    assert suspects["creep"]["sure"]
    assert "bouc_wen" not in suspects
    # The curve of a suspect lies over the residual and explains the share that is told.
    view = page.get("view", params={"suspect": "creep"}).json()
    above, below = view["time"]["panels"]
    assert [trace["label"] for trace in above["traces"]] == ["measured", "modelled"]
    left, curve = (np.array(trace["y"]) for trace in below["traces"])
    assert 1 - np.sum((left - curve) ** 2) / np.sum(left**2) == pytest.approx(
        suspects["creep"]["explains"], rel=1e-3
    )
    assert left == pytest.approx(
        below["up"]["factor"] / above["up"]["factor"]
        * (np.array(above["traces"][0]["y"]) - np.array(above["traces"][1]["y"])),
        abs=1e-2,
    )  # fmt: skip

    # By branch: all points, and the means of bins, which lie in the middle of them.
    place = page.get("place", params={"by": "branch"}).json()
    drive = np.array(view["plane"]["panels"][0]["traces"][0]["x"])
    counts = [len(panel["traces"][0]["y"]) for panel in place["panels"]]
    assert sum(counts) == drive.size == left.size
    for panel in place["panels"]:
        points, means = (np.array(trace["y"]) for trace in panel["traces"])
        at = np.histogram(panel["traces"][0]["x"], _edges(panel["traces"][1]["x"]))[0]
        assert np.average(means, weights=at) == pytest.approx(points.mean(), abs=0.1 * left.std())
    assert set(place["views"]) == {"branch", "amplitude", "time", "frequency", "events"}
    half = {"left": float(np.median(drive)), "right": 1e3, "low": -1.0, "high": 1.0}
    inside = page.get("brushed", params=half).json()
    assert inside["samples"] == int(np.sum(drive >= half["left"]))
    clock = np.array(above["x"])
    shaded = sum(
        int(np.sum((clock >= begin) & (clock <= end))) for begin, end in inside["stretches"]
    )
    assert shaded == inside["samples"]
    assert page.get("brushed", params={**half, "right": "nan"}).status_code == 400
    refused = page.get("place", params={"by": "colour"})
    assert refused.status_code == 400
    assert "no picture by 'colour'" in refused.json()["sentence"]

    page.step("add", effect=suspects["creep"]["effect"])
    page.step("fix", name="bouc_wen.gamma", value=0.001)
    page.step("undo")
    page.step("bound", name="creep.tau", low=0.5, high=4.0)
    page.step("free", name="bouc_wen.n")
    page.step("exchange", name="bouc_wen", effect="dahl")
    page.step("undo")
    page.step("redo")
    last = page.step("undo")
    assert [step["title"] for step in last["steps"]] == [
        "default model", "add creep", "bounds of creep.tau", "free bouc_wen.n",
        "dahl in the place of bouc_wen",
    ]  # fmt: skip
    assert last["depth"] == 3
    assert last["steps"][1]["rms"] < 0.6 * last["steps"][0]["rms"]
    trace = last["steps"][1]["trace"]
    assert trace[-1] == pytest.approx(last["steps"][1]["rms"], rel=1e-6)

    told = page.get("download/fit.json").json()
    assert told["wall_s"] > 0.0
    assert replayed(page, tmp_path, monkeypatch) == told

    (tmp_path / "model.toml").write_text(page.get("download/model.toml").text)
    read = read_model(tmp_path / "model.toml")
    assert read.values["creep.tau"] == told["parameters"]["creep.tau"]["value"]
    assert (read.free, read.bounds["creep.tau"]) == (("bouc_wen.n",), (0.5, 4.0))
    assert tomllib.loads(page.get("download/model.toml").text)["effects"][1]["effect"] == "bouc_wen"

    # All of it is in the file, whoever kills the server now.
    kept = read_session(page.bench.file)
    assert (kept.depth, len(kept.edits), kept.script) == (3, 4, page.get("download/script.py").text)


def test_the_model_is_drawn_while_it_is_solved(page: Page) -> None:
    load = page.state()["load"]
    load["sources"][0]["said"] = {"trim": ":19.9 s"}  # which no test before has had solved
    page.step("load", load=load)
    seen: list[tuple[str, Any]] = []
    heard = page.bench._heard

    def listening(worker: Any, message: Any) -> None:
        heard(worker, message)
        view = json.loads(_view(page.bench, {"record": "0", "suspect": "creep"}))
        seen.append((type(message).__name__, view["time"]["panels"]))

    page.bench._heard = listening  # type: ignore[method-assign]
    try:
        state = page.step("fit")
    finally:
        page.bench._heard = heard  # type: ignore[method-assign]
    names = [name for name, _ in seen]
    first = names.index("Drawn")
    assert first < names.index("Solved")
    below = seen[first][1][1]
    left = np.array(below["traces"][0]["y"]) / below["up"]["factor"]
    assert len(below["traces"]) == 1  # suspects were scored elsewhere
    trace = state["steps"][0]["trace"]
    assert np.sqrt(np.mean(left**2)) == pytest.approx(trace[0], rel=1e-6)
    left = np.array(seen[-1][1][1]["traces"][0]["y"]) / seen[-1][1][1]["up"]["factor"]
    assert np.sqrt(np.mean(left**2)) == pytest.approx(trace[-1], rel=1e-6)
    load["sources"][0]["said"] = {}
    page.step("load", load=load)


def replayed(page: Page, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """What the script writes, but for the wall time, which no second run has."""
    script, out = tmp_path / "script.py", tmp_path / "again.json"
    script.write_text(page.get("download/script.py").text)
    monkeypatch.setattr(sys, "argv", [str(script), str(out)])
    runpy.run_path(str(script))
    told = page.get("download/fit.json").json()
    return {**json.loads(out.read_text()), "wall_s": told["wall_s"]}


def _edges(middles: list[float]) -> Any:
    """Edges of bins of equal width, the outer ones a little wider."""
    half = 0.5 * (middles[1] - middles[0])
    edges = np.array([middles[0] - half, *(np.array(middles) + half)])
    edges[[0, -1]] += [-1e-3 * half, 1e-3 * half]
    return edges


def test_a_search_is_taken_over_and_its_script_needs_no_search(
    page: Page, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page.state()
    page.step("load", load=page.bench.session.load.to_dict())
    page.step("fit")
    state = page.step("find")
    assert state["sentences"][0].startswith("Missing: creep.")
    assert (state["depth"], state["steps"][1]["title"]) == (1, "find all")
    assert "diagnose(" not in "".join(
        line
        for line in page.get("download/script.py").text.splitlines()
        if not line.startswith("#")
    )
    assert replayed(page, tmp_path, monkeypatch) == page.get("download/fit.json").json()


def test_drives_that_would_tell_more_can_be_seen_and_played(page: Page) -> None:
    page.fitted()
    state = page.step("next")
    drives = state["plan"]["drives"]
    assert drives
    shown = page.get("drive?number=0").json()
    lines = page.get("download/drive-0.csv").text.splitlines()
    head = next(k for k, line in enumerate(lines) if line.startswith("time [s]"))
    clock, drive = np.loadtxt(lines[head + 1 :], delimiter=",", usecols=(0, 1), unpack=True)
    (panel,) = shown["panels"]
    values = panel["traces"][0]["y"]
    assert (min(values), max(values)) == pytest.approx((drive.min(), drive.max()))
    assert panel["x"][-1] == pytest.approx(clock[-1])
    # It stays within what was played.
    assert drive.min() >= -1e-9
    assert drive.max() <= 94.1
    for number in ("99", "x", "-1", ""):
        assert page.get(f"drive?number={number}").status_code == 400
    assert page.get("download/drive-99.csv").status_code == 400


def test_a_killed_worker_is_told_and_the_next_click_goes_on(page: Page) -> None:
    state = page.fitted()
    depth = state["depth"]
    assert page.do("find").status_code == 200
    worker = page.bench._worker
    assert worker is not None
    assert worker.process.pid is not None
    os.kill(worker.process.pid, signal.SIGKILL)
    state = page.state()
    assert "has died (-9); nothing is lost" in state["problem"]
    assert state["depth"] == depth
    state = page.step("remove", name="offset")
    assert (state["problem"], state["depth"]) == ("", depth + 1)
    assert "offset" not in [one["name"] for one in state["fit"]["effects"]]
    page.step("undo")


def test_a_search_that_is_stopped_shows_the_best_so_far_within_a_fifth_of_a_second(
    page: Page, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = page.fitted()
    while before["depth"] > 0:  # what is missing is still to be found, which takes a while
        before = page.step("undo")
    assert page.do("find").status_code == 200
    assert page.do("add", effect="delay").json()["sentence"].startswith("Wait, or stop it first")
    for _ in range(1200):
        if page.bench._best is not None:
            break
        time.sleep(0.01)
    began = time.perf_counter()
    assert page.do("cancel").status_code == 200
    shown = page.get("state").json()
    spent = time.perf_counter() - began
    assert spent < 0.2
    assert shown["kind"] != "search"
    assert (shown["depth"], shown["shown"], shown["steps"][1]["title"]) == (1, 1, "find all")
    assert shown["fit"]["rms"] < before["fit"]["rms"]
    assert shown["sentences"][0].startswith("Not finished: the search was stopped. The best")
    assert page.get("download/fit.json").status_code == 400  # not yet solved as the script does
    after = page.state()
    assert (after["depth"], after["problem"]) == (1, "")
    assert after["fit"]["rms"] <= 1.0001 * shown["fit"]["rms"]
    assert any(one["std"] is not None for one in after["fit"]["parameters"])
    assert replayed(page, tmp_path, monkeypatch) == page.get("download/fit.json").json()


def test_a_search_that_is_stopped_at_once_leaves_the_model_as_it_was(page: Page) -> None:
    before = page.fitted()
    while before["depth"] > 0:
        before = page.step("undo")
    assert page.do("find").status_code == 200
    assert page.do("cancel").status_code == 200
    after = page.state()
    assert after["sentences"] == [
        "Not finished: the search was stopped. It had found nothing better so far."
    ]
    assert (after["depth"], after["problem"]) == (0, "")
    assert after["fit"] == before["fit"]
    assert after["scores"] == before["scores"]


def test_a_step_that_cannot_be_solved_leaves_the_model_as_it_was(page: Page) -> None:
    before = page.fitted()
    page.do("add", effect="friction")  # acts on a motion that this model does not have
    after = page.state()
    assert "quasi-static" in after["problem"]
    assert after["steps"] == before["steps"]
    assert after["depth"] == before["depth"]


@pytest.mark.parametrize(
    ("headers", "path"),
    [
        ({"host": "evil.example"}, "/secret/state"),
        ({"host": "127.0.0.1"}, "/secret/state"),
        ({"origin": "http://evil.example"}, "/secret/state"),
        ({"origin": "null"}, "/secret/state"),
        ({"origin": "http://localhost:9"}, "/secret/state"),
        ({"sec-fetch-site": "cross-site"}, "/secret/state"),
        ({"sec-fetch-site": "same-site"}, "/secret/state"),
        ({}, "/state"),
        ({}, "/"),
        ({}, "/wrong/state"),
        ({}, "/secre/state"),
        ({}, "//secret/state"),
    ],
)
def test_strangers_are_refused(page: Page, headers: dict[str, str], path: str) -> None:
    for method in ("GET", "POST"):
        answer = page.client.request(method, path, headers=headers)
        assert answer.status_code == 403
        assert "records" not in answer.text


def test_the_own_page_is_answered_and_may_load_nothing_from_elsewhere(page: Page) -> None:
    answer = page.get("", headers={"origin": HOST, "sec-fetch-site": "same-origin"})
    assert answer.status_code == 200
    policy = answer.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    for name in ("workbench.js", "pictures.js", "workbench.css", "uplot.js", "uplot.css"):
        text = page.get(f"assets/{name}").text
        assert "innerHTML" not in text or name == "uplot.js"
        assert "http://" not in text.replace("http://www.w3.org", "")
        if name != "uplot.js":
            assert "https://" not in text
    assert page.get("assets/..%2Fapp.py").status_code == 404


@pytest.mark.parametrize(
    "body",
    [b"", b"{", b"[]", b"7", b"[" * 100_000, b'{"do": "add"}', b'{"do": "load", "load": 3}',
     b'{"do": "fix", "name": "a", "value": "x"}', b'{"do": "bound", "name": "a"}',
     b'{"do": "add", "effect": "no"}', b'{"do": ["add"]}', b" " * (1 << 21)],
)  # fmt: skip
def test_clicks_that_make_no_sense_are_one_sentence(page: Page, body: bytes) -> None:
    answer = page.client.post("/secret/do", content=body)
    assert answer.status_code == 400
    assert len(answer.json()["sentence"].splitlines()) == 1


def test_a_tab_that_has_not_seen_the_last_change_is_asked_to_look(page: Page) -> None:
    version = page.state()["version"]
    assert page.do("undo", version=version - 1).status_code == 409
    assert page.state()["version"] == version


def test_a_narrow_screen_asks_for_fewer_points_and_loses_no_peak(page: Page) -> None:
    page.fitted()
    all_, few = (
        page.get("view", params=asked).json()["time"]["panels"][1]["traces"][0]["y"]
        for asked in ({}, {"points": "210"})
    )
    assert (len(all_), len(few)) == (400, 200)
    assert (min(few), max(few)) == (min(all_), max(all_))
    assert len(page.get("view", params={"points": "0"}).json()["time"]["panels"][0]["x"]) == 200


@pytest.mark.parametrize(
    "query", ["record=9", "record=x", "begin=nan&end=2", "begin=a", "record=-1"]
)
def test_views_that_make_no_sense_are_refused(page: Page, query: str) -> None:
    assert page.get(f"view?{query}").status_code == 400


def test_a_dropped_file_replaces_the_records_and_what_was_done_stays_in_a_file(page: Page) -> None:
    steps = len(page.fitted()["steps"])
    markup = "<img src=x onerror=alert(1)>"
    rows = "".join(f"{k},{k % 20},{0.1 * (k % 20):.3f},{k % 3}\n" for k in range(100))
    text = f"time [s],voltage [V],displacement [um],{markup} [V]\n{rows}"
    where = f"/secret/upload?name=../../{markup}.csv"
    assert page.client.post(where, content=text.encode()).status_code == 200
    state = page.state()
    folder = page.bench.file.with_suffix(".files")
    assert [file.name for file in folder.iterdir()] == ["img_src_x_onerror_alert_1_.csv"]
    assert markup in state["records"]["records"][0]["units"]
    assert state["steps"] == []
    aside = page.bench.file.parent.glob("session-*.json")
    kept = read_session(max(aside, key=lambda file: int(file.stem.partition("-")[2])))
    assert len(kept.edits) + 1 == steps


def test_columns_without_units_are_chosen_on_the_page(page: Page) -> None:
    page.state()
    rows = "".join(f"{k},{k % 20},{0.1 * (k % 20):.3f}\n" for k in range(100))
    where = "/secret/upload?name=bare.csv"
    assert page.client.post(where, content=f"ticks,a,b\n{rows}".encode()).status_code == 200
    state = page.state()
    assert state["records"] is None
    assert state["problem"]
    assert state["headers"] == ["ticks", "a", "b"]
    load = state["load"]
    load["sources"][0]["said"] = {"time": "ticks [ms]", "drive": "a [V]", "position": "b [um]"}
    state = page.step("load", load=load)
    (told,) = state["records"]["records"]
    assert (told["duration"], state["problem"]) == ("99 ms", "")
    assert told["ranges"]["position"] == "0 m to 1.9 um"
    script = page.get("download/script.py").text
    assert "time='ticks [ms]', drive='a [V]', position='b [um]')" in script


def test_columns_without_a_header_are_chosen_by_number(page: Page) -> None:
    page.state()
    rows = "".join(f"{k % 20},{0.1 * (k % 20):.3f},{k % 7}\n" for k in range(100))
    assert page.client.post("/secret/upload?name=b.csv", content=rows.encode()).status_code == 200
    state = page.state()
    assert "no header" in state["problem"] or "header should be" in state["problem"]
    assert state["headers"] == ["1", "2", "3"]
    load = state["load"]
    load["sources"][0]["said"] = {
        "drive": "1 [V]", "position": "2 [um]", "rate": "1 kHz", "between": "held",
        "trim": "10 ms:",
    }  # fmt: skip
    state = page.step("load", load=load)
    (told,) = state["records"]["records"]
    assert (told["samples"], told["between"], state["problem"]) == (90, "held", "")


def test_files_that_are_no_records_are_one_sentence_each(page: Page) -> None:
    rng = np.random.default_rng(3)
    page.state()
    broken = [
        ("empty.csv", b""),
        ("noise.h5", rng.bytes(3000)),
        ("noise.mat", rng.bytes(3000)),
        ("signed.h5", b"\x89HDF\r\n\x1a\n" + rng.bytes(500)),
        ("short.csv", b"time [s],voltage [V],displacement [um]\n0,0,0\n"),
        ("words.csv", b"time [s],voltage [V],displacement [um]\n0,a,b\n1,c,d\n"),
        ("program.exe", b"MZ"),
        ("", b"\x00" * 100),
    ]
    for name, content in broken:
        assert page.client.post(f"/secret/upload?name={name}", content=content).status_code == 200
        state = page.state()
        assert state["problem"]
        assert "error of the program" not in state["problem"]
        assert len(state["problem"].splitlines()) == 1
        assert state["records"] is None


def test_a_hundred_damaged_copies_are_read_or_one_sentence_each(page: Page, record: Path) -> None:
    """Text, cut off or with bytes changed: each is told, and the page goes on."""
    content, generator = record.read_bytes(), np.random.default_rng(47)
    page.state()
    told = []
    for copy in range(100):
        name = f"wounded_{copy}.csv"
        sent = page.client.post(f"/secret/upload?name={name}", content=damaged(content, generator))
        assert sent.status_code == 200
        state = page.state()
        sentence = state["problem"]
        assert bool(sentence) == (state["records"] is None)
        assert "error of the program" not in sentence
        assert "Traceback" not in sentence
        assert len(sentence.splitlines()) <= 1
        told.append(bool(sentence))
    assert 10 < sum(told) < 90
    sent = page.client.post("/secret/upload?name=whole.csv", content=content)
    assert sent.status_code == 200
    assert page.state()["records"]["records"][0]["samples"] == 400


def test_a_resumed_session_goes_through_its_steps_again(record: Path, tmp_path: Path) -> None:
    kept = Session(Load((Source(str(record)),)), True, (Add(Creep()), Remove("offset")), 1)
    bench = Bench(kept, tmp_path / "again.json")
    with TestClient(application(bench, "secret", PORT), base_url=HOST) as client:
        state = Page(bench, client).state()
    assert state["depth"] == 1
    assert [step["title"] for step in state["steps"]] == [
        "default model", "add creep", "remove offset",
    ]  # fmt: skip
    assert all(step["rms"] for step in state["steps"])
    assert [one["name"] for one in state["fit"]["effects"]][-1] == "creep"
