"""Composed models against a compiler's program and against C written by hand, in the same run."""

from __future__ import annotations

import json
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from piezo_opt.benchmark import speed
from piezo_opt.benchmark.speed import HAND, MODELS, SCHEMA, Speed, measure
from piezo_opt.cli.app import app
from piezo_opt.errors import PiezoOptError
from piezo_opt.simulation.compiler import find_compiler
from piezo_opt.simulation.library import MACHINE

pytestmark = pytest.mark.skipif(
    find_compiler() is None or not MACHINE, reason="compares compiled code: no cc"
)


@pytest.fixture(scope="module")
def found() -> Speed:
    return measure(4000, 9, (2000, 16_000), library=False)


def test_composed_models_are_as_fast_as_programs_of_their_own(found: Speed) -> None:
    """The claim is 1.5; another process may take the processor in the middle of a repetition."""
    assert [p.directions for p in found.whole] == [0, 4, 0, 6, 0, 8, 0, 10, 0, 13]
    for pair in (*found.whole, *found.hand):
        assert 0.2 < pair.ratio < 2.2, pair
    assert np.median([pair.ratio for pair in found.whole]) < 1.5


def test_readings_and_derivatives_are_those_of_the_judges(found: Speed) -> None:
    assert 0.0 < found.disagreement <= 1e-12
    record = speed._record(500)
    for model in (*MODELS, HAND):
        ours, judge = (speed._engine(model, record, speed._free(model), w) for w in (False, True))
        assert speed._difference(ours()[1], judge()[1]) < 1e-10


def test_time_is_linear_in_samples_and_a_model_begins_soon(found: Speed) -> None:
    short, long = found.lengths.values()
    assert 0.2 < long / short < 4.0
    assert all(0.1 < ms < 60.0 for ms in found.first_ms.values())
    assert found.fit_ms > 0.0
    assert found.fit_simulations > 20.0
    assert found.peak_mb > 50.0


def test_the_shares_of_a_fit_are_those_of_its_parts(found: Speed) -> None:
    """The loop runs at least as often as there are simulations with derivatives in a search."""
    assert 0.1 < found.fit_core < 0.8
    assert 0.02 < found.fit_algebra < 0.5
    assert found.fit_core + found.fit_algebra < 1.0
    begun = []

    def part() -> None:
        begun.append(True)
        time.sleep(0.02)

    places = SimpleNamespace(part=part)
    with speed._watched((places, "part")) as spent:
        places.part()
        part()  # not by its place
    assert 0.02 <= spent[0] < 0.04 * 10
    assert places.part is part
    assert len(begun) == 2


def test_a_loop_that_computes_something_else_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    known = speed.load

    def wrong(text: str) -> object:
        return known(text.replace("2.0 * (h2 + h3)", "2.1 * (h2 + h3)"))

    monkeypatch.setattr(speed, "load", wrong)
    monkeypatch.setattr(speed, "MODELS", MODELS[:1])
    with pytest.raises(PiezoOptError, match="differ"):
        measure(500, 1, (), library=False)


def test_the_command_prints_and_writes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(speed, "MODELS", MODELS[:1])
    out = tmp_path / "speed.json"
    words = [
        "bench",
        "speed",
        "--samples",
        "500",
        "--repetitions",
        "1",
        "--no-library",
        "--no-alternatives",
        "--no-scaling",
    ]
    done = CliRunner().invoke(app, [*words, "--json", str(out)])
    assert done.exit_code == 0, done.output
    told = json.loads(out.read_text())
    assert told["schema"] == SCHEMA
    for pair in (*told["whole"], *told["hand"]):
        assert pair["ratio"] == pytest.approx(pair["ours"] / pair["judge"])
        assert f"{pair['ratio']:.2f}" in done.output
    assert told["library"] is None
