"""A long record is searched where the base model errs most; the answer is that of all of it."""

from __future__ import annotations

import numpy as np
import pytest

from piezo_opt.diagnosis import sketch
from piezo_opt.diagnosis.diagnose import Stopped, diagnose
from problems import hidden_effect
from tests.diagnosis.plants import but


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is long is shorter."""
    monkeypatch.setattr(sketch, "LONG", 1500)


@pytest.mark.usefixtures("short")
def test_a_search_of_a_part_first_changes_the_way_and_not_the_answer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    record = hidden_effect.data()
    few = but("creep", "drift", "delay")
    said: list[str] = []
    found = diagnose(record, withhold=few, progress=said.append)
    monkeypatch.setattr(sketch, "LONG", len(record))
    whole = diagnose(record, withhold=few)
    assert [step.name for step in found.steps] == [step.name for step in whole.steps] == ["creep"]
    assert found.final.rms == pytest.approx(whole.final.rms, rel=1e-4)
    assert [s.name for s in found.suspects] == [s.name for s in whole.suspects]
    assert [s.p_value for s in found.suspects] == pytest.approx(
        [s.p_value for s in whole.suspects], rel=0.5
    )
    # A fifth of a fifth would be too short: one part is searched, and what it finds leaves noise.
    part = f"on {len(record) // 5} samples: "
    assert any(s.startswith(f"{part}with creep, it leaves") for s in said)
    on_all = [s for s in said if s.endswith("its neighbours") and not s.startswith(part)]
    assert len(on_all) == 1
    assert on_all[0].startswith("with creep")


@pytest.mark.usefixtures("short")
def test_an_interrupt_within_the_part_gives_the_base_model() -> None:
    def stop(sentence: str) -> None:
        if sentence.startswith("on "):
            raise KeyboardInterrupt

    found = diagnose(hidden_effect.data(), withhold=but("creep"), progress=stop)
    assert found.stopped is Stopped.USER
    assert (found.verdict, found.steps) == ("open", ())
    assert found.final.rms == found.fit.rms


def test_the_part_is_where_the_residual_is_largest() -> None:
    record = hidden_effect.data()
    residual = np.full(len(record), 1e-9)
    residual[3000:3300] = 5e-9
    part = sketch._worst(record, residual)
    assert len(part) == len(record) // 5
    assert part.time[0] <= record.time[3000]
    assert part.time[-1] >= record.time[3299]
