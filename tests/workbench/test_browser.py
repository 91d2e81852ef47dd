"""The story, by mouse, in a real browser that has no network, on a record that is made here."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.workbench.speed import CHROMIUM, PATIENCE, served

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")


@pytest.fixture
def address(record: Path, tmp_path: Path) -> Iterator[str]:
    """The page of the record that is made here."""
    with served(record, tmp_path) as found:
        yield found


def test_a_user_sees_what_is_missing_adds_it_and_takes_the_script_away(
    address: str, tmp_path: Path
) -> None:
    # Takes seconds: two processes and a browser begin, a model is fitted twice and once more.
    from playwright.sync_api import expect, sync_playwright

    asked: list[str] = []
    faults: list[str] = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=CHROMIUM,
            # Every name but this machine's own leads nowhere.
            args=["--no-sandbox", "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1"],
        )
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        page.set_default_timeout(PATIENCE)
        page.on("request", lambda request: asked.append(request.url))
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.on("console", lambda m: faults.append(m.text) if m.type == "error" else None)
        page.goto(address)
        expect(page.locator("#records")).to_contain_text("400", timeout=PATIENCE)
        page.click("#fit")
        page.wait_for_selector("body[data-depth='0'][data-scored='yes']")
        first = page.locator("#steps li").first.inner_text()

        assert unreached(page) == []
        creep = page.locator("#suspects li[data-name='creep']")
        creep.hover()
        expect(page.locator("#shown")).to_have_text("and what creep would explain of it")
        assert _coloured(page, "residual", (0, 114, 178)) > 300
        if keep := os.environ.get("PIEZO_OPT_PICTURE"):
            page.wait_for_timeout(300)
            page.screenshot(path=keep)
        creep.get_by_role("button").click()
        page.wait_for_selector("body[data-depth='1'][data-scored='yes']")
        assert _nanometres(page.locator("#steps li.now").inner_text()) < 0.6 * _nanometres(first)
        assert _coloured(page, "error", (213, 94, 0)) > 100
        for view in ("frequency", "events", "branch"):
            page.select_option("#by", view)
            page.wait_for_selector("#place canvas")
            page.wait_for_timeout(200)
            assert _coloured(page, "place", (213, 94, 0)) > 100
        page.click("#undo")
        page.wait_for_selector("body[data-depth='0']")
        page.keyboard.press("r")
        page.wait_for_selector("body[data-depth='1'][data-scored='yes']")

        # A stretch that is brushed in one picture is looked at in all.
        page.locator("#overlay").scroll_into_view_if_needed()
        box = page.locator("#overlay .u-over").bounding_box()
        assert box is not None
        page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 40)
        page.mouse.down()
        page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 50, steps=4)
        page.mouse.up()
        expect(page.locator("#span")).to_contain_text("10")
        samples = re.search(r"(\d+) samples", page.locator("#span").inner_text())
        assert samples is not None
        assert 95 <= int(samples[1]) <= 106

        # Half of the plane: when the record was there is shaded over time.
        page.keyboard.press("0")
        expect(page.locator("#span")).to_have_text("400 samples")
        over = page.locator("#plane .u-over")
        box = over.bounding_box()
        assert box is not None
        over.hover(position={"x": 0.5 * box["width"], "y": 2})
        page.mouse.down()
        over.hover(position={"x": box["width"] - 2, "y": box["height"] - 2})
        page.mouse.up()
        expect(page.locator("#brushed")).to_contain_text("samples inside")
        found = re.search(r"(\d+) samples", page.locator("#brushed").inner_text())
        assert found is not None
        assert 100 < int(found[1]) < 300

        # The same by keys: the right half, then a tenth less of the whole.
        page.keyboard.press("Delete")
        expect(page.locator("#brushed")).to_have_text("")
        inside = []
        for key in ("Enter", "Shift+ArrowLeft"):
            with page.expect_response("**/brushed?*") as answer:
                page.keyboard.press(key)
            inside.append(answer.value.json()["samples"])
        assert abs(inside[0] - int(found[1])) < 10
        assert 0.5 * inside[0] < inside[1] < inside[0] - 5

        for name in ("Script", "JSON"):
            with page.expect_download() as download:
                page.get_by_role("link", name=name, exact=True).click()
            download.value.save_as(tmp_path / name)
        browser.close()

    assert faults == []
    assert {url for url in asked if not url.startswith(address)} <= {"data:,"}
    script, out = tmp_path / "Script", tmp_path / "again.json"
    subprocess.run([sys.executable, str(script), str(out)], check=True, stdout=subprocess.DEVNULL)
    told, again = json.loads((tmp_path / "JSON").read_text()), json.loads(out.read_text())
    assert told["model"]["effects"][-1]["effect"] == "creep"
    told.pop("wall_s")
    again.pop("wall_s")
    assert again == told


def test_the_story_on_the_loop_of_the_thesis(tmp_path: Path) -> None:
    """The picture of the README: the likeliest suspect is added, and the error falls."""
    from playwright.sync_api import sync_playwright

    loop = Path(__file__).parents[2] / "data" / "thesis" / "hysteresis.csv"
    with served(loop, tmp_path) as address, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        page.set_default_timeout(PATIENCE)
        page.goto(address)
        page.click("#fit")
        page.wait_for_selector("body[data-depth='0'][data-scored='yes']")
        errors = [_nanometres(page.locator("#steps li").first.inner_text())]
        for depth in (1, 2):
            likeliest = page.locator("#suspects li").first
            likeliest.hover()
            likeliest.get_by_role("button").click()
            page.wait_for_selector(f"body[data-depth='{depth}'][data-scored='yes']")
            errors.append(_nanometres(page.locator("#steps li.now").inner_text()))
        page.locator("#suspects li").first.hover()
        page.wait_for_timeout(300)
        if keep := os.environ.get("PIEZO_OPT_STORY"):
            page.screenshot(path=keep)
        assert errors[2] < errors[1] < errors[0]
        assert errors[2] < 0.8 * errors[0]
        assert _coloured(page, "error", (213, 94, 0)) > 100
        browser.close()


def unreached(page) -> list[str]:  # type: ignore[no-untyped-def]
    """What can be clicked or filled in, and is not reached with the tabulator."""
    there = """() => [...document.querySelectorAll(
        "a, button, input, select, summary, .u-over[tabindex]"
    )].filter((one) => one.checkVisibility() && !one.disabled)"""
    page.evaluate(f"({there})().forEach((one, k) => one.dataset.key = k)")
    count = page.evaluate(f"({there})().length")
    page.locator("h1").click()
    reached = set()
    for _ in range(count + 10):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.dataset.key || ''"))
    return [
        page.evaluate(f"document.querySelector('[data-key=\"{key}\"]').outerHTML")
        for key in sorted({str(k) for k in range(count)} - reached)
    ]


def _nanometres(text: str) -> float:
    found = re.search(r"([\d.]+) nm", text)
    assert found is not None
    return float(found[1])


def _coloured(page, name: str, colour: tuple[int, int, int]) -> int:  # type: ignore[no-untyped-def]
    """Pixels of a picture that have a colour."""
    return int(
        page.evaluate(
            """([name, [r, g, b]]) => {
                const canvas = document.querySelector(`#${name} canvas`);
                const data = canvas.getContext("2d")
                    .getImageData(0, 0, canvas.width, canvas.height).data;
                let count = 0;
                for (let k = 0; k < data.length; k += 4)
                    if (data[k] === r && data[k + 1] === g && data[k + 2] === b) count++;
                return count;
            }""",
            [name, list(colour)],
        )
    )
