"""The hidden-effect bench: it judges as it says, it can be resumed, and it can fail."""

from __future__ import annotations

import dataclasses
import json
import math
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from piezo_opt.benchmark import hidden, plants
from piezo_opt.benchmark.hidden import HiddenTable, Judged, hidden_bench, measurement
from piezo_opt.benchmark.plants import CLASSES
from piezo_opt.benchmark.refit_everything import refit_everything
from piezo_opt.diagnosis import Stopped
from piezo_opt.effects import BoucWen, Offset, PiezoGain
from piezo_opt.effects.catalogue import CATALOGUE
from piezo_opt.errors import InputError
from piezo_opt.identification import Identification, solve


def said(*effects: str, steps: tuple[str, ...] = (), verdict: str = "missing") -> Judged:
    """A record with these effects hidden, and an answer that takes each step for itself."""
    return Judged(
        "+".join(effects) or "none",
        effects,
        0,
        verdict=verdict,
        steps=steps,
        groups=tuple((step,) for step in steps),
        final=1.0,
        held_out=1.02,
    )


@pytest.mark.parametrize(
    ("row", "right"),
    [
        (said("creep", steps=("creep",)), True),
        (said("creep", steps=("drift",)), False),
        (said("creep", steps=("creep", "drift")), False),
        (said("creep", verdict="complete"), False),
        (said("delay", steps=("sensor_lag",)), True),
        (said("delay", steps=("slew_limit",)), False),
        (said(verdict="complete"), True),
        (said(verdict="unexplained"), False),
        (said(steps=("creep",)), False),
        (said("creep", "delay", steps=("amplifier_lag", "creep")), True),
        (said("creep", "delay", steps=("creep",)), False),
        (said("creep", "delay", steps=("creep", "delay", "drift")), False),
        (said("stick_events", verdict="unexplained"), True),
        (said("stick_events", steps=("friction",), verdict="unexplained"), True),
        (said("stick_events", steps=("friction",)), False),
        (dataclasses.replace(said(verdict="complete"), error="broken"), False),
    ],
)
def test_right_is_what_is_asked(row: Judged, right: bool) -> None:
    assert row.right is right


def test_the_group_counts_where_the_member_is_wrong() -> None:
    row = dataclasses.replace(said("drift", steps=("creep",)), groups=(("creep", "drift"),))
    assert row.group_right
    assert not row.member_right
    assert not said("drift", steps=("creep",)).group_right
    # A lag named for a delay is right: so is its group.
    assert said("delay", steps=("sensor_lag",)).group_right


def test_shares_and_confusion_count_what_was_said() -> None:
    table = HiddenTable(
        "standard",
        (
            said("creep", steps=("creep",)),
            said("creep", steps=("drift",)),
            dataclasses.replace(said("creep", steps=("creep",)), error="Traceback\nKeyError: 1"),
            said(verdict="complete"),
            said("stick_events", steps=("friction",)),
        ),
    )
    assert table.confusion == {
        "creep": {"creep": 1, "drift": 1, "failed": 1},
        "none": {"complete": 1},
        "stick_events": {"friction": 1},
    }
    # What failed counts against it everywhere.
    assert table.shares["one hidden: its group first"] == (1, 3)
    assert table.shares["one hidden: no second accepted"] == (2, 3)
    assert table.shares["nothing hidden: complete"] == (1, 1)
    assert table.shares["outside: no effect completes it"] == (0, 1)
    assert not any(name.startswith("two") for name in table.shares)
    assert table.over_noise == (1.0, 1.02)
    text = str(table)
    assert "failed: creep, seed 0: KeyError: 1" in text
    assert "33.3 %  (1 of 3)" in text


def test_p_values_of_records_that_hide_nothing_are_counted_below_each_level() -> None:
    rows = tuple(Judged("none", (), k, p_value=p) for k, p in enumerate((0.2, 0.03, 0.004, 1.0)))
    shares = HiddenTable("standard", (*rows, Judged("none", (), 4))).shares
    assert shares["nothing hidden: least p below 0.05"] == (2, 5)
    assert shares["nothing hidden: least p below 0.01"] == (1, 5)


@pytest.fixture(scope="module")
def small() -> HiddenTable:
    """One record each of four classes, a seventh as long as usual."""
    classes = ["none", "sensor_nonlinearity", "mains_pickup", "stick_events"]
    return hidden_bench(classes, 1, samples=1200)


def test_a_small_bench_is_right(small: HiddenTable) -> None:
    assert [row.label for row in small.rows] == [
        "none", "sensor_nonlinearity", "mains_pickup", "stick_events",
    ]  # fmt: skip
    assert [row.error for row in small.rows] == [""] * 4
    assert [row.right for row in small.rows] == [True] * 4
    fitted, held_out = small.over_noise
    assert 0.95 < fitted < 1.1
    assert 0.95 < held_out < 1.1
    for row in small.rows[1:]:
        assert row.baseline > 2.5, f"{row.label}: nothing to find"


def test_it_is_seeded_and_resumes_from_its_log(tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    counts: list[tuple[int, int]] = []
    first = hidden_bench(["none"], 1, samples=1000, log=log)
    with log.open("a") as file:
        file.write('{"label": "none", "eff')  # a run that was killed while it wrote
    with ThreadPoolExecutor(1) as pool:
        second = hidden_bench(
            ["none"], 2, samples=1000, log=log, executor=pool,
            progress=lambda done, of: counts.append((done, of)),
        )  # fmt: skip
    # The first record is not done again: not even its times have changed.
    assert second.rows[0] == first.rows[0]
    assert counts == [(2, 2)]
    assert [row.seed for row in second.rows] == [0, 1]
    third = hidden_bench(["none"], 1, samples=1000, log=log)
    assert third.rows == first.rows
    again = hidden_bench(["none"], 1, samples=1000)
    assert again.rows[0].final == pytest.approx(first.rows[0].final, rel=1e-9)
    with pytest.raises(InputError, match="no log of this bench"):
        hidden_bench(["none"], 1, level="hard", samples=1000, log=log)
    data = json.loads(json.dumps(second.to_dict()))
    assert data["records"] == 2
    assert data["rows"][1]["right"] is second.rows[1].right


def test_a_record_that_breaks_is_counted_and_does_not_end_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def breaks(*_: object, **__: object) -> None:
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr(hidden, "diagnose", breaks)
    table = hidden_bench(["none"], 2, samples=1000)
    assert len(table.rows) == 2
    assert table.shares["nothing hidden: complete"] == (0, 2)
    assert table.to_dict()["failed"] == 2
    assert "SVD did not converge" in str(table)

    def stopped(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(hidden, "diagnose", stopped)
    with pytest.raises(KeyboardInterrupt):
        hidden_bench(["none"], 1, samples=1000)


def test_an_unfinished_diagnosis_ends_the_bench_and_is_not_counted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(hidden, "diagnose", lambda *_, **__: SimpleNamespace(stopped=Stopped.USER))
    with pytest.raises(KeyboardInterrupt):
        hidden_bench(["none"], 2, samples=600)


def test_group_sizes_and_the_plainest_search_are_counted() -> None:
    wide = dataclasses.replace(
        said("drift", steps=("creep",)), groups=(("creep", "drift", "offset"),), plainest="creep"
    )
    lag = dataclasses.replace(said("delay", steps=("delay",)), plainest="sensor_lag")
    nothing = dataclasses.replace(said(verdict="complete"), plainest="creep")
    unasked = said("creep", steps=("creep",))
    table = HiddenTable("standard", (wide, lag, nothing, unasked))
    assert table.group_size == pytest.approx(5.0 / 3.0)
    assert table.shares["one hidden: refits alone name the member"] == (1, 2)
    assert table.shares["nothing hidden: refits alone say so"] == (0, 1)
    assert "holds 1.67 names" in str(table)
    assert not any("refits" in name for name in HiddenTable("hard", (unasked,)).shares)


def test_a_blind_table_tells_only_totals() -> None:
    rows = (
        said("creep", steps=("creep",)),
        dataclasses.replace(said("friction"), error="Traceback\nKeyError: 1"),
        said("random_sticking", verdict="unexplained"),
    )
    table = HiddenTable("standard", rows, "foreign", blind=True)
    data = table.to_dict()
    assert data["shares"]["one hidden: its group first"] == {"held": 1, "of": 2}
    assert data["shares"]["outside: no effect completes it"] == {"held": 1, "of": 1}
    assert data["failed"] == 1
    for told in (str(table), json.dumps(data)):
        for word in ("creep", "friction", "sticking", "KeyError", "seed"):
            assert word not in told
    assert "friction" in str(dataclasses.replace(table, blind=False))


def test_foreign_plants_are_diagnosed_alone_half_of_the_time(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    asked: list[bool] = []

    def breaks(*_: object, test: object, **__: object) -> None:
        asked.append(test is None)
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr(hidden, "diagnose", breaks)
    table = hidden_bench(["none"], 4, samples=600, family="foreign")
    assert sorted(asked) == [False, False, True, True]
    assert table.family == "foreign"
    log = tmp_path / "log.jsonl"
    hidden_bench(["none"], 1, samples=600, family="foreign", log=log)
    with pytest.raises(InputError, match="no log of this bench"):
        hidden_bench(["none"], 1, samples=600, log=log)
    asked.clear()
    hidden_bench(["none"], 2, samples=600)
    assert asked == [False, False]


def test_the_plainest_search_names_what_the_criterion_prefers() -> None:
    train, _ = plants.make(("mains_pickup",), 0, samples=2000)
    fit = solve(Identification(PiezoGain() + BoucWen() + Offset(), measurement(train, "train")))
    all_but = tuple(name for name in CATALOGUE if name not in ("mains_pickup", "drift"))
    assert refit_everything(fit, withhold=all_but) == "mains_pickup"
    assert refit_everything(fit, withhold=tuple(CATALOGUE)) == ""


def test_without_its_row_of_the_catalogue_an_effect_stays_unexplained() -> None:
    classes = ["none", "friction", "stick_events"]
    found = hidden_bench(classes, 1, samples=1100, leave_out=True, max_time=math.inf)
    (row,) = found.rows
    assert (row.label, row.sort, row.verdict, row.error) == (
        "friction", "left out", "unexplained", "",
    )  # fmt: skip
    assert "friction" not in row.steps
    assert row.baseline > 2.5, "nothing to find"
    assert found.shares["left out: unexplained"] == (1, 1)
    assert hidden._rows("delay") == hidden.POOLED
    assert hidden._rows("backlash") == {"dead_zone"}


def test_pairs_differ_from_seed_to_seed_and_do_not_count_as_one() -> None:
    pairs = [next(hidden._pairs(seed)) for seed in range(40)]
    assert len(set(pairs)) > 30
    for first, second in pairs:
        assert first in CLASSES
        assert second in CLASSES
        assert not {first, second} <= hidden.POOLED
    assert next(hidden._pairs(3)) == pairs[3]


def test_foreign_pairs_do_not_count_as_one() -> None:
    pairs = [pair for seed in range(10) for pair in hidden._pairs(seed, "foreign")]
    assert len(pairs) > 300
    assert not any({first, second} <= hidden.POOLED for first, second in pairs)
    assert not any({first, second} == {"dead_zone", "backlash"} for first, second in pairs)


def test_a_blind_run_refuses_to_tell_of_a_class(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="name 8 or more"):
        hidden_bench(["none", "creep"], 1, family="foreign", blind=True)
    with pytest.raises(InputError, match="leave out the log"):
        hidden_bench(None, 1, family="foreign", blind=True, log=tmp_path / "log.jsonl")
    assert not list(tmp_path.iterdir())
    with pytest.raises(InputError, match="no class 'encoder_lines'"):
        hidden_bench(["encoder_lines"], 1)


def test_bad_questions_are_refused() -> None:
    with pytest.raises(InputError, match="no class 'crepe'"):
        hidden_bench(["creep+crepe"], 1)
    with pytest.raises(InputError, match="at least one"):
        hidden_bench(["none"], 0)
    with pytest.raises(InputError, match="at least one"):
        hidden_bench([], 1)


@pytest.mark.parametrize(
    ("hidden", "row"),
    [
        ("backlash", "dead_zone"),
        ("sensor_curvature", "sensor_nonlinearity"),
        ("thermal_expansion", "temperature"),
    ],
)
def test_a_form_is_right_by_the_name_of_its_row(hidden: str, row: str) -> None:
    told = Judged(hidden, (hidden,), 1, steps=(row,), groups=((row,),), verdict="missing")
    assert told.group_right
    assert told.right
    assert not Judged(hidden, (hidden,), 1, steps=("creep",), groups=(("creep",),)).group_right
