"""What a diagnosis is worth: the plant in the loop, one plant through the whole study, medians."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import piezo_opt as po
from piezo_opt.benchmark.plants.driven import Driven, rig
from piezo_opt.cli import app
from piezo_opt.errors import InputError
from piezo_opt.report.worth import worths
from piezo_opt.studies.worth import Judged, Tracked, Worth
from piezo_opt.studies.worth.study import HIGH, LOW, Median, references_of


@pytest.mark.parametrize("seed", [0, 1, 5])
def test_a_plant_that_is_driven_a_period_at_a_time_is_the_plant_of_the_bench(seed: int) -> None:
    one = rig(seed, 1000)
    drive, reading, clean = one.record(1000)
    plant = Driven(one)
    stepped = [plant.begin(0.0), *(plant.advance(u, 1.0 / one.rate) for u in drive[:-1].tolist())]
    assert stepped == pytest.approx(clean, rel=0.0, abs=1e-13 * float(np.ptp(clean)))
    assert np.std(reading - clean) == pytest.approx(one.noise, rel=0.1)
    with pytest.raises(ValueError, match="is sampled every"):
        plant.advance(1.0, 2.0 / one.rate)


def test_a_plant_rests_where_it_begins() -> None:
    one = rig(3, 1000)
    plant = Driven(one)
    drive = 0.5 * one.scale.high
    first = plant.begin(drive)
    assert first > 0.0
    later = [plant.advance(drive, 1.0 / one.rate) for _ in range(200)]
    assert later == pytest.approx([first] * 200, rel=1e-12)


def test_references_begin_at_rest_and_stay_within_their_ends() -> None:
    one = rig(2, 1000)
    stroke = one.scale.gain * one.scale.high
    for name, reference in references_of(one).items():
        assert reference[0] == 0.0
        assert reference.max() == pytest.approx(HIGH * stroke, rel=0.02)
        assert reference[reference.size // 4 :].min() >= LOW * stroke * (1.0 - 1e-9)
        most = float(np.abs(np.diff(reference)).max()) * one.rate
        assert most < (20.0 if name == "triangle" else 50.0) * stroke


def test_on_one_plant_the_diagnosis_is_worth_what_the_study_says() -> None:
    """The whole way on one plant of the twenty, with the controllers that take no search."""
    found = po.study_worth(
        1,
        1,
        controllers=("PID", "LQR", "inverse", "feedforward"),
        references=("triangle",),
        samples=1000,
    )
    (plant,) = found.plants
    assert plant.error == ""
    assert {"creep", "second_mode"} <= set(plant.steps)
    assert plant.left["undiagnosed"] > 3.0
    assert plant.left["diagnosed"] < 1.1
    assert found.ratio(
        "triangle", ("PID", "diagnosed"), ("feedforward", "diagnosed")
    ).value > 5.0  # fmt: skip
    assert found.ratio(
        "triangle", ("feedforward", "undiagnosed"), ("feedforward", "diagnosed")
    ).value > 2.0  # fmt: skip
    # State feedback on seven creep elements and two modes, in the states that matter.
    for model in ("undiagnosed", "diagnosed", "truth"):
        (error,) = found.errors("triangle", "LQR", model)
        assert error < found.errors("triangle", "PID", model)[0] / 3.0
    assert np.isnan(found.errors("triangle", "inverse", "diagnosed")).all()
    assert np.isnan(found.errors("staircase", "PID", "truth")).all()
    told = str(found)
    assert "1 of 1 plants" in told
    assert "feedforward, undiagnosed over diagnosed" in told
    data = json.loads(json.dumps(found.to_dict()))
    assert data["schema"] == "piezo_opt/worth/1"
    assert not data["interrupted"]


def made(ratios: list[float]) -> Worth:
    """Plants whose PID on the diagnosed model errs these many times as much as their MPC."""
    return Worth(
        tuple(
            Judged(
                k, rows=(
                    Tracked("triangle", "PID", "diagnosed", 0.01 * r),
                    Tracked("triangle", "MPC", "diagnosed", 0.01),
                    Tracked("triangle", "MPC", "undiagnosed", why="none"),
                )
            )
            for k, r in enumerate(ratios)
        ),
        len(ratios) + 1,
    )  # fmt: skip


def test_ratios_are_taken_plant_by_plant_and_intervals_are_of_order_statistics() -> None:
    found = made([float(r) for r in range(1, 21)]).ratio(
        "triangle", ("PID", "diagnosed"), ("MPC", "diagnosed")
    )
    # Of 20 the 6th and the 15th: 1 - 2 P(Bin(20, 1/2) <= 5) = 0.9586.
    assert (found.value, found.low, found.high, found.count) == pytest.approx((10.5, 6, 15, 20))
    few = Median.of([1.0, 2.0, float("nan")])
    assert (few.value, few.count) == (1.5, 2)
    assert np.isnan(few.low)
    assert few.told() == "1.5"


def test_what_was_not_finished_or_designed_is_said() -> None:
    found = made([5.0, 6.0])
    assert "2 of 3 plants" in str(found)
    assert "no design: MPC on undiagnosed: none" in str(found)
    assert found.to_dict()["interrupted"]
    figure = worths(found.points())
    assert [one.get_title(loc="left") for one in figure.axes] == [
        "Triangle: a point is a plant, a line the median"
    ]


def test_an_interrupt_keeps_the_plants_that_were_finished(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def judged(_: object, seed: int) -> Judged:
        if seed == 2:
            raise KeyboardInterrupt
        return made([3.0]).plants[0]

    monkeypatch.setattr("piezo_opt.studies.worth.study._judged", judged)
    out, picture = tmp_path / "worth.json", tmp_path / "worth.png"
    done = CliRunner().invoke(
        app, ["study", "worth", "--plants", "4", "--json", str(out), "--picture", str(picture)]
    )
    assert done.exit_code == 0, done.output
    assert "2 of 4 plants" in done.stdout
    assert json.loads(out.read_text())["interrupted"]
    assert picture.stat().st_size > 1000


def test_names_that_there_are_not_are_refused() -> None:
    with pytest.raises(InputError, match="There is no 'LQG': there are PID, LQR"):
        po.study_worth(1, controllers=("LQG",))
    with pytest.raises(InputError, match="at least 1 plant"):
        po.study_worth(0)
