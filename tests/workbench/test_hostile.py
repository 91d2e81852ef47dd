"""What others may do to a session, in a real browser: told in a sentence, nothing lost or run."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from piezo_opt.workbench.session import read_session
from tests.workbench.speed import CHROMIUM, PATIENCE, served

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")

MARKUP = '<img src=x onerror="window.run=1"><script>window.run=1</script>'


@contextmanager
def opened() -> Iterator[Any]:
    """A page of a browser, whose dialogs and scripts of others are noticed."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        page.set_default_timeout(PATIENCE)
        yield page
        browser.close()


def test_markup_in_names_and_columns_is_text_on_the_page_and_in_what_is_taken_away(
    record: Path, tmp_path: Path
) -> None:
    rows = record.read_text().splitlines()
    named = tmp_path / "<img src=x onerror=window.run=1>.csv"
    heads = f"time [s],voltage [V],displacement [um],{MARKUP.replace(',', '')} [K]"
    named.write_text("\n".join([heads, *(f"{row},{k}" for k, row in enumerate(rows[1:]))]))
    with served(named, tmp_path) as address, opened() as page:
        page.goto(address)
        page.wait_for_selector("#fit:not([disabled])")
        told = page.locator("#records").inner_text()
        assert MARKUP in told
        assert named.stem in told
        page.click("#fit")
        page.wait_for_selector("body[data-depth='0']")
        for view in ("frequency", "branch"):
            page.select_option("#by", view)
        with page.expect_download() as download:
            page.get_by_role("link", name="Report", exact=True).click()
        report = tmp_path / "report.html"
        download.value.save_as(report)
        assert page.evaluate("[window.run, document.images.length]") == [None, 0]
        page.goto(report.as_uri())
        assert named.stem in page.locator("main").inner_text()
        assert page.evaluate("[window.run, document.images.length]") == [None, 0]


def test_another_origin_sees_and_does_nothing_even_with_the_address(
    record: Path, tmp_path: Path
) -> None:
    with served(record, tmp_path) as address, other_origin() as elsewhere, opened() as page:
        page.goto(elsewhere)
        tried = page.evaluate(
            """async (address) => {
                const tried = {};
                const body = JSON.stringify({ do: "fit" });
                for (const [name, options] of Object.entries({
                    read: {}, simple: { method: "POST", body, mode: "no-cors" },
                    json: { method: "POST", body, headers: { "content-type": "application/json" } },
                })) {
                    const path = name === "read" ? "state" : "do";
                    try {
                        const answer = await fetch(address + path, options);
                        tried[name] = answer.type + (await answer.text());
                    } catch (error) { tried[name] = "refused"; }
                }
                const script = document.createElement("script");
                script.src = address + "assets/workbench.js";
                tried.script = await new Promise((done) => {
                    script.onload = () => done("loaded"); script.onerror = () => done("refused");
                    document.head.append(script);
                });
                const frame = document.createElement("iframe");
                frame.src = address;
                await new Promise((done) => { frame.onload = done; document.body.append(frame); });
                return tried;
            }""",
            address,
        )
        # An answer to a simple request is empty for the page that sent it, whatever it was.
        assert tried == {
            "read": "refused", "simple": tried["simple"], "json": "refused", "script": "refused",
        }  # fmt: skip
        assert tried["simple"] in ("opaque", "refused")
        assert "workbench" not in page.frames[1].content()
        page.goto(address)
        page.wait_for_selector("#fit:not([disabled])")
        assert page.locator("#steps li").count() == 0  # nothing was fitted


@contextmanager
def other_origin() -> Iterator[str]:
    """A page of another port of this machine."""

    class Page(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("content-type", "text/html")
            self.end_headers()
            self.wfile.write(b"<!DOCTYPE html><title>elsewhere</title><body>")

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Page)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/"
    finally:
        server.shutdown()
        server.server_close()


def test_a_worker_and_a_server_that_are_killed_lose_nothing(record: Path, tmp_path: Path) -> None:
    with opened() as page:
        with served(record, tmp_path) as address:
            page.goto(address)
            page.wait_for_selector("#fit:not([disabled])")
            page.click("#fit")
            page.wait_for_selector("body[data-depth='0'][data-scored='yes']")
            (server,) = children(os.getpid(), "workbench")
            page.click("#find")
            page.wait_for_selector("body[data-busy='search']")
            for worker in children(server, "workbench"):
                os.kill(worker, signal.SIGKILL)
            page.wait_for_selector("#problem:not([hidden])")
            assert "has died (-9); nothing is lost" in page.locator("#problem").inner_text()
            page.wait_for_selector("body[data-depth='0'][data-scored='yes']")
            page.locator("#suspects li[data-name='creep']").get_by_role("button").click()
            page.wait_for_selector("body[data-depth='1']")
            assert page.locator("#problem").is_hidden()
            os.kill(server, signal.SIGKILL)
            page.click("#undo")
            page.wait_for_selector("#problem:not([hidden])")
            assert "start it again with --session" in page.locator("#problem").inner_text()
        kept = read_session(tmp_path / "session.json")
        assert [edit.title for edit in kept.path] == ["add creep"]


def children(parent: int, word: str) -> list[int]:
    """Processes that a process has begun and that have a word in their command line."""
    found = []
    for folder in Path("/proc").iterdir():
        if folder.name.isdecimal():
            try:
                status = (folder / "stat").read_text().rpartition(")")[2].split()
                command = (folder / "cmdline").read_text()
            except OSError:
                continue
            if int(status[1]) == parent and word in command:
                found.append(int(folder.name))
    return found


def test_a_full_disk_is_told_and_what_was_clicked_meanwhile_is_kept_later(
    record: Path, tmp_path: Path
) -> None:
    from playwright.sync_api import expect

    disk = tmp_path / "disk"
    disk.mkdir()
    # A small disk of its own, which this process alone can see.
    small = f"mount -t tmpfs -o size=64k none {disk} && exec "
    if subprocess.run(["unshare", "-rm", "sh", "-c", small + "true"], check=False).returncode:
        pytest.skip("no disk of one's own can be made here")
    here = ["unshare", "-rm", "sh", "-c", small + '"$@"', "sh"]
    with served(record, disk, before=here) as address, opened() as page:
        (server,) = children(os.getpid(), "workbench")
        seen = Path(f"/proc/{server}/root{disk}")
        page.goto(address)
        page.wait_for_selector("#fit:not([disabled])")
        fill = seen / "fill"
        with pytest.raises(OSError, match="No space left"):
            fill.write_bytes(b"x" * 100_000)
        page.click("#fit")
        page.wait_for_selector("body[data-depth='0']")
        sentence = page.locator("#problem").inner_text()
        assert "session.json: cannot be written: the disk is full: make room" in sentence
        page.set_input_files("#file", record)
        expect(page.locator("#problem")).to_contain_text("loop.csv", timeout=PATIENCE)
        assert "No space left" in page.locator("#problem").inner_text()
        assert page.locator("#steps li").count() == 1  # what was done is still there
        assert json.loads((seen / "session.json").read_text())["fitted"] is False
        fill.unlink()
        page.locator("#suspects li[data-name='creep']").get_by_role("button").click()
        page.wait_for_selector("body[data-depth='1']")
        assert page.locator("#problem").is_hidden()
        assert [e["do"] for e in json.loads((seen / "session.json").read_text())["edits"]] == [
            "add"
        ]
        assert sorted(p.name for p in seen.iterdir()) == ["session.files", "session.json"]
