"""The correspondence with the thesis: computed, complete, and what the page shows."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from piezo_opt.cli import app
from piezo_opt.errors import InputError
from piezo_opt.report.thesis import chapter_four
from piezo_opt.studies import Row, Study, study_thesis
from piezo_opt.studies.page import tables_of, write_tables
from piezo_opt.studies.thesis.control import hysteresis_loops, vibration_answers
from piezo_opt.studies.thesis.hysteresis import loop_fit
from tests.docs.pages import disagreement

PAGE = Path(__file__).resolve().parents[2] / "docs" / "thesis.md"


@pytest.fixture(scope="module")
def study() -> Study:
    return study_thesis()


def row(study: Study, what: str) -> Row:
    (found,) = [one for one in study.rows if one.what.startswith(what)]
    return found


def numbers(text: str) -> list[float]:
    return [float(one) for one in re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", text)]


@pytest.mark.parametrize(
    ("what", "tolerance"),
    [
        ("Step of the displacement, loop", 1e-3),
        ("Uncontrolled hysteresis", 0.012),
        ("LQR", 1e-4),
        ("Pole placement", 1e-4),
        ("ZV shaper", 3e-4),
        ("Overshoot and settling", 3e-3),
        ("Two poles from", 1e-4),
        ("Mesh", 1e-9),
    ],
)
def test_what_can_be_reproduced_is(study: Study, what: str, tolerance: float) -> None:
    one = row(study, what)
    printed, ours = numbers(one.published), numbers(one.ours)
    assert len(ours) >= len(printed)
    for known, found in zip(printed, ours, strict=False):
        assert found == pytest.approx(known, rel=tolerance)


def test_what_cannot_be_says_why(study: Study) -> None:
    assert "not identifiable" in row(study, "Four poles").remark.lower()
    assert "not identifiable" in row(study, "Resonance of the vib").remark.lower()
    assert "not tuned" in row(study, "Gain of the finite").remark
    assert numbers(row(study, "Four poles").ours)[0] == pytest.approx(98.01, abs=1.0)
    assert numbers(row(study, "PID on the loop").ours)[0] < 0.15


def test_every_row_is_whole(study: Study) -> None:
    assert len(study.rows) >= 25
    assert len({(one.what, one.source) for one in study.rows}) == len(study.rows)
    for one in study.rows:
        assert one.what
        assert one.published
        assert one.ours
        assert one.source
        assert "nan" not in one.ours
        assert one.what in str(study)


def test_the_page_shows_this_run(study: Study) -> None:
    """Numbers to their digits; how many simulations a fit takes is the solver's affair."""

    def shown(text: str) -> str:
        lines = [line for line in text.splitlines() if "What the fit cost" not in line]
        return "\n".join(lines)

    problem = disagreement(shown(tables_of(PAGE)), shown(study.markdown()))
    assert problem is None, f"{problem}\npiezo-opt study thesis --page docs/thesis.md"


def test_the_controllers_are_drawn(study: Study, tmp_path: Path) -> None:
    """Each in its panel; what the fixture has computed is not computed again."""
    fit = loop_fit()
    loops, (time, answers) = hysteresis_loops(fit), vibration_answers()
    assert f"{1e6 * loops['PID'].largest:.3f}" in row(study, "PID on the loop").ours
    drawn = chapter_four(fit, loops, time, answers)
    shown = [{t.get_text() for t in a.get_legend().get_texts()} for a in drawn.axes]
    assert shown[2] == set(loops)
    assert shown[3] == set(answers)
    drawn.savefig(tmp_path / "drawn.png")


def test_tables_are_put_between_the_marks(tmp_path: Path) -> None:
    study = Study("t", (("One", (Row("a | b", "1", "2", "", "s"),)),))
    page = tmp_path / "page.md"
    page.write_text("above\n")
    with pytest.raises(InputError, match="has no lines"):
        write_tables(page, study)
    with pytest.raises(InputError, match="no such page"):
        tables_of(tmp_path / "none.md")
    page.write_text(
        "above\n<!-- begin of the study's tables -->\nold\n<!-- end of the study's tables -->\nx\n"
    )
    write_tables(page, study)
    assert "| a \\| b (s) | 1 | 2 |  |" in tables_of(page)
    assert page.read_text().startswith("above\n")
    assert page.read_text().endswith("x\n")
    assert "old" not in page.read_text()


def test_the_command_refuses_a_page_without_marks(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("nothing\n")
    done = CliRunner().invoke(app, ["study", "thesis", "--page", str(page)])
    assert done.exit_code == 2
    assert "has no lines" in done.stderr
