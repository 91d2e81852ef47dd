"""The page: complete, self-contained, safe to write."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from importlib import import_module
from pathlib import Path

import pytest

from piezo_opt import demo
from piezo_opt.comparison import compare
from piezo_opt.effects.catalogue import effect
from piezo_opt.errors import InputError
from piezo_opt.identification import Fit, solve
from piezo_opt.report import write_report

VOID = {"meta", "br", "hr", "img", "input", "link"}


class Checked(HTMLParser):
    """Collects ids, attributes that load something, and tags that are not closed."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.loads: list[str] = []
        self.ids: list[str] = []
        self.uses: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)
        for name, value in attrs:
            if name in ("src", "href", "xlink:href", "srcset", "data", "action"):
                self.loads.append(value or "")
            if name == "id":
                self.ids.append(value or "")
            self.uses += re.findall(r"url\(#([^)]+)\)", value or "")
        if tag in ("link", "iframe", "object", "embed"):
            self.loads.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def fit() -> Fit:
    return solve(demo.question())


@pytest.fixture(scope="module")
def text(fit: Fit, tmp_path_factory: pytest.TempPathFactory) -> str:
    richer = solve(demo.question().with_model(fit.model + effect("asymmetry")), start=fit)
    file = tmp_path_factory.mktemp("page") / "page.html"
    assert write_report(file, fit, compare(fit, richer), title="A <loop> & more") == file
    return file.read_text(encoding="utf-8")


def test_nothing_comes_from_a_network(text: str) -> None:
    page = Checked()
    page.feed(text)
    assert page.open == []
    # Only pieces of the page itself and rasterised pixels are pointed at.
    assert all(one.startswith(("#", "data:image/png;base64,")) for one in page.loads)
    assert "@import" not in text
    assert re.findall(r"https?://(?!www\.w3\.org/(?:2000/svg|1999/xlink))[^\s\"<]*", text) == []


def test_pictures_do_not_share_ids(text: str) -> None:
    page = Checked()
    page.feed(text)
    targets = [one[1:] for one in page.loads if one.startswith("#")] + page.uses
    assert targets
    assert set(targets) <= set(page.ids)
    assert max(page.ids.count(one) for one in set(targets)) == 1


def test_it_says_what_an_engineer_asks(text: str, fit: Fit) -> None:
    assert "<h1>A &lt;loop&gt; &amp; more</h1>" in text
    assert "rms 169 nm, fit 96.0 %" in text
    for heading in ("The record", "Where it fails", "What the data cannot see"):
        assert f">{heading}" in text
    # The answer and the loop come first; what only developers read is folded.
    first = text.index("rms 169 nm, fit 96.0 %"), text.index("Black: measured. Orange: model.")
    folded = [k.start() for k in re.finditer("<details><summary>", text)]
    assert list(first) == sorted(first)
    assert first[1] < text.index(">The record")
    assert len(folded) == 3
    assert folded[0] < text.index("<pre>") < folded[1] < text.index("by iteration") < folded[2]
    assert folded[2] < text.index("iterations</td>")
    for sentence in (*fit.blind[:1], "The reading comes in steps of 172.5 nm"):
        assert sentence.split(" (")[0] in text
    assert "bouc_wen.alpha</td><td>80.4" in text
    assert text.count("<figure>") >= 10
    assert "Comparison on the record hysteresis" in text


def test_its_title_is_what_it_is_about(fit: Fit, tmp_path: Path) -> None:
    text = write_report(tmp_path / "x17b.html", fit).read_text(encoding="utf-8")
    title = "Fit of hysteresis: piezo_gain + bouc_wen + second_order"
    assert f"<title>{title}</title>" in text
    assert text.count(title) == 2
    assert "x17b" not in text


def test_it_does_not_overwrite(fit: Fit, tmp_path: Path) -> None:
    file = tmp_path / "page.html"
    file.write_text("precious")
    with pytest.raises(InputError, match="exists already"):
        write_report(file, fit)
    assert file.read_text() == "precious"
    write_report(file, fit, overwrite=True)
    assert "<!DOCTYPE html>" in file.read_text(encoding="utf-8")
    assert [one.name for one in tmp_path.iterdir()] == ["page.html"]


def test_it_refuses_what_is_no_result(fit: Fit, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a report cannot show a int"):
        write_report(tmp_path / "page.html", fit, 3)
    with pytest.raises(InputError, match="needs a result"):
        write_report(tmp_path / "page.html")
    with pytest.raises(InputError, match="there is no folder"):
        write_report(tmp_path / "nowhere" / "page.html", fit)
    assert list(tmp_path.iterdir()) == []


def test_what_a_fit_leaves_is_not_looked_at_twice(
    fit: Fit, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a long record that takes seconds; the page says the same."""

    def told(page: Path) -> list[str]:
        # The ids in pictures are drawn anew each time.
        return re.findall(r"<(?:h\d|p|li|td|figcaption)[ >].*", page.read_text(encoding="utf-8"))

    alone = told(write_report(tmp_path / "alone.html", fit))
    assert len(alone) > 20
    own = compare(fit)
    assert own.entries[0].where
    monkeypatch.setattr(import_module("piezo_opt.comparison.compare"), "where", pytest.fail)
    for results in ((fit, own), (own, fit)):
        page = write_report(tmp_path / "own.html", *results, overwrite=True)
        assert told(page) == alone
