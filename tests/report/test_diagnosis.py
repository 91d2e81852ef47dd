"""The chapter of a diagnosis: its ladder, its order, its words."""

from __future__ import annotations

import dataclasses
import itertools
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

import piezo_opt as po
from piezo_opt.diagnosis import Diagnosis, unexplained
from piezo_opt.diagnosis.noise import Structure
from piezo_opt.diagnosis.told import Rival
from piezo_opt.report import chapter, diagnosis_figures, figures, write_report
from piezo_opt.report.page import Heading, Lead, Picture, Points, Table
from problems import hidden_effect, thesis_diagnosis
from tests.diagnosis.planted import FLOOR, planted


@pytest.fixture(scope="module")
def creeping() -> Diagnosis:
    """The creeping stack: one effect is missing, with data held out."""
    _, test = hidden_effect.data().split(hidden_effect.SPLIT)
    return po.diagnose(po.solve(hidden_effect.question()), test=test, advise=False)


@pytest.fixture(scope="module")
def loop() -> Diagnosis:
    """The thesis' loop: a group, nothing held out, a drive advised."""
    return po.diagnose(po.solve(thesis_diagnosis.question()))


def test_points_are_the_errors_of_the_steps(creeping: Diagnosis) -> None:
    (step,) = creeping.steps
    first, second = creeping.ladder
    assert (first.label, second.label) == ("baseline", "+ creep")
    assert (first.rms, second.rms) == (step.rms_before, step.rms_after)
    assert (first.held_out, second.held_out) == (step.held_out_before, step.held_out_after)
    assert (first.delta_bic, second.delta_bic) == (None, step.delta_bic)


def test_what_is_no_effect_is_a_point_of_its_own(creeping: Diagnosis) -> None:
    (step,) = creeping.steps
    later = dataclasses.replace(
        step, name="drift", rms_before=0.8 * step.rms_after, rms_after=0.7 * step.rms_after
    )
    two = dataclasses.replace(creeping, steps=(step, later), refined=("bouc_wen.n",))
    labels = [point.label for point in two.ladder]
    assert labels == ["baseline", "+ creep", "n free", "+ drift", "n free"]
    none = dataclasses.replace(creeping, steps=(), top=creeping.foot)
    assert none.ladder == ()
    assert diagnosis_figures.ladder(none) is None


def test_long_names_of_a_ladder_do_not_overlap(creeping: Diagnosis) -> None:
    (step,) = creeping.steps
    names = ("sensor_nonlinearity", "charge_back_coupling", "interferometer_fringes")
    steps = [dataclasses.replace(step, name=name, rms_before=step.rms_after) for name in names]
    last = dataclasses.replace(steps[-1], rms_before=0.9 * step.rms_after)
    details = ("bouc_wen.n", "asymmetry.delta", "asymmetry.n", "hysteretic_force.n")
    many = dataclasses.replace(creeping, steps=(step, *steps[:-1], last), refined=details)
    drawn = diagnosis_figures.ladder(many)
    assert drawn is not None
    drawn.canvas.draw()
    (axis,) = drawn.axes
    labels = [label for label in axis.get_xticklabels() if label.get_text()]
    boxes = [label.get_window_extent() for label in labels]
    assert len(boxes) == 6
    assert all(a.x1 < b.x0 for a, b in itertools.pairwise(boxes))
    # Broken where a name may be, and whole where there is room.
    wrapped = diagnosis_figures._wrapped("+ sensor_nonlinearity, n free", 21)
    assert wrapped == "+ sensor_\nnonlinearity, n free"
    assert diagnosis_figures._wrapped("+ sensor_nonlinearity", 21) == "+ sensor_nonlinearity"


def test_the_ladder_is_drawn_down_to_the_noise(creeping: Diagnosis) -> None:
    drawn = diagnosis_figures.ladder(creeping)
    assert drawn is not None
    (axis,) = drawn.axes
    lines = {line.get_label(): np.asarray(line.get_ydata()) for line in axis.get_lines()}
    (step,) = creeping.steps
    nano = 1e9 * np.array([step.rms_before, step.rms_after])
    assert lines["fitted data"] == pytest.approx(nano)
    assert lines["noise floor, estimated"] == pytest.approx(1e9 * creeping.noise.rms)
    low, high = axis.get_ylim()
    assert low < 1e9 * creeping.noise.low < 1e9 * creeping.noise.high < high
    held = [step.held_out_before, step.held_out_after]
    assert lines["held-out data"] == pytest.approx(1e9 * np.array(held, dtype=float))


def test_suspects_are_bars_of_what_they_explain(creeping: Diagnosis) -> None:
    drawn = diagnosis_figures.suspects(creeping)
    assert drawn is not None
    left, right = drawn.axes
    widths = [patch.get_width() for patch in left.patches]
    assert widths == pytest.approx([100.0 * s.score for s in creeping.suspects[: len(widths)]])
    assert next(t.get_text() for t in left.get_yticklabels()) == "creep"
    seen = [patch.get_width() for patch in right.patches]
    assert seen == pytest.approx([100.0 * s.visibility for s in creeping.suspects[: len(seen)]])


def test_the_zoom_shows_where_the_error_is_largest() -> None:
    error = np.full(1000, 1e-9)
    error[700:720] = 1e-6
    part = figures.window(error)
    assert part.stop - part.start == 40
    assert part.start <= 700 < 720 <= part.stop
    assert figures.window(error[:7]) == slice(0, 7)


@pytest.mark.parametrize(
    ("share", "text"), [(1.0, "100 %"), (0.523, "52 %"), (0.0213, "2.1 %"), (0.0, "0 %")]
)
def test_percent(share: float, text: str) -> None:
    assert diagnosis_figures.percent(share) == text


def test_it_is_read_from_the_verdict_down(creeping: Diagnosis) -> None:
    blocks = chapter(creeping)
    titles = [b.text.partition(":")[0] for b in blocks if isinstance(b, Heading)]
    wanted = [
        f"Diagnosis of {creeping.fit.records[0].name}",
        "The ladder", "Measured and modelled", "Where it fails",
        "Which effect is missing", "What the final model's numbers are",
        "What this record cannot tell", "What to do next",
    ]  # fmt: skip
    assert [t for t in titles if t in wanted] == wanted
    lead = next(b for b in blocks if isinstance(b, Lead))
    assert lead.text == creeping.headline
    assert lead.good
    # The field's words stand beside ours.
    cells = [dict(b.columns) for b in blocks if isinstance(b, Table)]
    assert any("Kelvin-Voigt" in "".join(one.get("what it is", ())) for one in cells)
    figures = [b.figure for b in blocks if isinstance(b, Picture)]
    assert len(figures) >= 8
    assert all(isinstance(figure, Figure) for figure in figures)


def test_what_is_unexplained_is_said_and_not_named(creeping: Diagnosis) -> None:
    clue = "The residual follows the drive: it correlates with the drive's cube."
    left = dataclasses.replace(
        creeping, verdict="unexplained", structure=Structure(True, (clue,)), unexplained=None
    )
    blocks = chapter(left)
    lead = next(b for b in blocks if isinstance(b, Lead))
    assert not lead.good
    assert lead.text.startswith("Unexplained")
    titles = [b.text for b in blocks if isinstance(b, Heading)]
    assert "What no effect explains" in titles
    assert "What no effect explains" not in [
        b.text for b in chapter(creeping) if isinstance(b, Heading)
    ]


def test_a_correction_of_two_signals_is_drawn_against_the_one_it_is_a_function_of(
    creeping: Diagnosis,
) -> None:
    left = unexplained(planted("loop wave"), FLOOR)
    assert left is not None
    assert left.against == "v, times v'"
    made = diagnosis_figures.correction(dataclasses.replace(creeping, unexplained=left))
    assert made is not None
    assert made.axes[1].get_xlabel() == "v [V]"
    (points, _) = made.axes[1].get_lines()
    drive = planted("loop wave").records[0].drive
    assert np.ptp(points.get_xdata()) == pytest.approx(np.ptp(drive), rel=1e-6)


def test_other_laws_are_shown_where_they_were_compared(creeping: Diagnosis) -> None:
    title = "Other hysteresis laws"
    none = dataclasses.replace(creeping, rivals=())
    assert title not in [b.text for b in chapter(none) if isinstance(b, Heading)]
    play = Rival("prandtl_ishlinskii", 1e-8, 1.2e-8, 71.3, True, ("friction", "creep"))
    dahl = Rival("dahl", 2e-8, None, -11.0, False)
    blocks = chapter(dataclasses.replace(creeping, rivals=(play, dahl)))
    at = next(k for k, b in enumerate(blocks) if isinstance(b, Heading) and b.text == title)
    words, table = blocks[at + 1 : at + 3]
    assert isinstance(words, Points)
    assert words.sentences == (str(play),)
    assert isinstance(table, Table)
    assert dict(table.columns) == {
        "law": ("prandtl_ishlinskii", "dahl"),
        "rms": ("10 nm", "20 nm"),
        "held out": ("12 nm", ""),
        "BIC falls by": ("71", "-11"),
        "does without": ("friction, creep", ""),
        "better": ("yes", "no"),
    }


def test_a_page_of_the_thesis_loop(loop: Diagnosis, tmp_path: Path) -> None:
    page = write_report(tmp_path / "loop.html", loop)
    text = unescape(page.read_text(encoding="utf-8"))
    first = loop.steps[0]
    assert first.told != first.name
    # The form of the effect that was added stands beside its name.
    form = first.told.removesuffix(")")
    assert f"Missing: {form}; or " in text
    rivals = ", ".join(loop.steps[0].group[1:])
    assert f"{loop.steps[0].name} and {rivals} explain it equally well" in text
    # The drives that would split them are drawn.
    assert loop.experiments
    for experiment in loop.experiments:
        assert experiment.sentence in text
    for name in loop.final.names:
        assert f"<td>{name}</td>" in text
    assert "temperature was not looked at: it needs the recorded channel" in text
