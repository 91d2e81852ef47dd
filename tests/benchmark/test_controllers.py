"""What controllers cost and find: every way solves the same program, and the command says so."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner

from piezo_opt.benchmark.controllers import ControlBench, control_bench
from piezo_opt.benchmark.controllers.draws import DESIGNS, Draw, Draws, draws
from piezo_opt.benchmark.controllers.iterations import STAGES, Iterations, Timed, iterations
from piezo_opt.benchmark.controllers.starts import Start, Starts, starts
from piezo_opt.cli import app
from piezo_opt.errors import InputError


def test_every_way_solves_the_same_program_and_the_iteration_soonest() -> None:
    """On the actuator without a loop the program is convex: there is one solution."""
    pytest.importorskip("do_mpc", exc_type=ImportError)
    found = iterations(20, stages=STAGES[1:])
    assert found.skipped == ""
    ways = [r.way for r in found.rows]
    assert ways == ["real-time iteration", "two of them", "15 of them", "IPOPT", "FATROP", "do-mpc"]
    for row in found.rows:
        assert row.failed == 0.0
        assert row.cost == pytest.approx(1.0, rel=0.02)
        assert 0 < row.iterating <= row.samples == 20
    own, fatrop, toolkit = (found.row("without", w) for w in (ways[0], "FATROP", "do-mpc"))
    assert own.slower == 1.0
    assert fatrop.slower > 10.0
    assert toolkit.slower > 20.0
    assert "times as long" in str(found)


def test_a_gradient_reaches_the_simplex_with_a_tenth_of_its_simulations() -> None:
    found = starts(1)
    (row,) = found.rows
    assert row.good
    assert row.cost <= row.simplex
    assert "1 of 1 starts" in str(found)


def test_a_robust_design_is_judged_on_draws_that_it_has_not_seen() -> None:
    found = draws(1000, designs=DESIGNS[1:2])
    (row,) = found.rows
    # Shares near 0.2 of two times 1000 draws differ by 1.8 points in the root of mean squares.
    assert row.found == pytest.approx(row.predicted, abs=0.055)
    assert 0.02 < row.predicted < 0.6
    assert "Largest difference" in str(found)


def made() -> ControlBench:
    timed = [
        Timed(a, w, 100, 80, t, 1.5 * t, 0.0, 1.0, 0.0, t / 1e-4)
        for a in ("with a loop", "without")
        for w, t in (("real-time iteration", 1e-4), ("FATROP", 1e-2))
    ]
    searches = [Start(k, 6.7e-8, 6.7e-8 * (1 + k), 30 + k, 400 + k, 9) for k in range(3)]
    robust = Draws((Draw(1.6, 0.02, 8, 0.03, 0.04),), 20)
    return ControlBench(Iterations(tuple(timed), ""), Starts(tuple(searches)), robust)


def test_a_start_counts_where_the_price_is_a_tenth() -> None:
    assert Start(0, 1.0, 1.0, 50, 400, 40).good
    assert not Start(0, 1.0, 1.0, 50, 400, 41).good
    assert not Start(0, 1.0, 1.0, 50, 400, -1).good


def test_the_command_says_it_writes_it_and_draws_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    asked: list[tuple[int, ...]] = []

    def benched(*numbers: int, progress: Callable[[str], None]) -> ControlBench:
        progress("nothing")
        asked.append(numbers)
        return made()

    monkeypatch.setattr("piezo_opt.benchmark.controllers.control_bench", benched)
    out, picture = tmp_path / "control.json", tmp_path / "control.png"
    done = CliRunner().invoke(
        app, ["bench", "control", "--starts", "3", "--json", str(out), "--picture", str(picture)]
    )
    assert done.exit_code == 0, done.output
    assert asked == [(3000, 3, 2000)]
    assert "Largest difference: 1.0 points." in done.stdout
    assert "3 of 3 starts" in done.stdout
    data = json.loads(out.read_text())
    assert data["schema"] == "piezo_opt/control_bench/1"
    assert len(data["iterations"]["rows"]) == 4
    assert picture.stat().st_size > 1000


def test_too_few_are_refused() -> None:
    with pytest.raises(InputError, match="at least 20 samples"):
        control_bench(5)
