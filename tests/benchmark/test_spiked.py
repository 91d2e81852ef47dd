"""Effects added to measured records: as large as asked, found, and told from what was there."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from piezo_opt.benchmark import plants, spiked
from piezo_opt.benchmark.hidden import measurement
from piezo_opt.benchmark.spiked import SPIKES, Spiked, SpikedTable
from piezo_opt.cli import app
from piezo_opt.diagnosis import diagnose
from piezo_opt.errors import InputError
from piezo_opt.measurement import Measurement
from tests.diagnosis.plants import but


@pytest.fixture(scope="module")
def record() -> Measurement:
    """A record with noise and nothing hidden, in the place of a measured one."""
    return measurement(plants.make((), 0, samples=500)[0], "stage")


@pytest.mark.parametrize("name", SPIKES)
def test_what_is_added_is_as_large_as_asked_beyond_gain_offset_and_shift(
    record: Measurement, name: str
) -> None:
    wanted = 2e-3 * float(np.ptp(record.position))
    reading = spiked._sized(record, name, wanted)
    assert spiked._beyond(record, reading) == pytest.approx(wanted, rel=1e-3)
    slope = np.gradient(record.position, record.time)
    imitated = 1.2 * record.position + 3e-7 + 1e-4 * slope
    # What a gain, an offset and a shift in time would give besides counts for nothing.
    assert spiked._beyond(record, imitated) < 1e-9 * np.ptp(record.position)
    _, add = SPIKES[name]
    np.testing.assert_allclose(add(record, 0.0), record.position, rtol=0, atol=1e-15)


def test_mains_that_were_added_are_named_and_nothing_else(
    record: Measurement, monkeypatch: pytest.MonkeyPatch
) -> None:
    few = but("mains_pickup", "creep", "drift", "sensor_nonlinearity")  # for speed
    monkeypatch.setattr(spiked, "diagnose", partial(diagnose, withhold=few))
    table = spiked.spiked([record], ["mains_pickup"], threads=1)
    (row,) = table.rows
    assert (row.before, row.after, row.surplus) == ((), ("mains_pickup",), ())
    assert row.over == pytest.approx(5.0, rel=1e-3)
    assert row.verdict == "missing"
    assert table.found == (1, 1)
    assert "named 1 of 1" in str(table)
    assert json.loads(json.dumps(table.to_dict()))["rows"][0]["found"] is True


def test_names_that_were_there_before_are_no_surplus() -> None:
    row = Spiked(
        "r", "backlash", 1e-9, 5.0, ("creep",), ("creep", "friction", "drift"),
        (("creep",), ("friction", "dead_zone"), ("drift",)), "missing", 1e-9,
    )  # fmt: skip
    assert row.found
    assert row.surplus == ("drift",)
    assert SpikedTable((row,)).found == (1, 1)


def test_what_cannot_be_added_is_said_in_a_sentence(record: Measurement, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="'creep' cannot be added: there are mains_pickup"):
        spiked.spiked([record], ["creep"])
    with pytest.raises(InputError, match="size=-1"):
        spiked.spiked([record], size=-1.0)
    with pytest.raises(InputError, match=r"sensor_nonlinearity cannot be made .* large"):
        spiked._sized(record, "sensor_nonlinearity", 1e-5)
    refused = CliRunner().invoke(app, ["bench", "spiked", str(tmp_path / "none.csv")])
    assert refused.exit_code == 2
    assert len(refused.stderr.splitlines()) == 1
