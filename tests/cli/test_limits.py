"""Ctrl-C and a limit of time give the best so far, with every file, in the commands that search."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

import piezo_opt as po
from piezo_opt.cli import app
from piezo_opt.cli.declare import Exit
from piezo_opt.cli.limiting import leave_early, limit_of, limited
from piezo_opt.effects import Delay, PiezoGain, SensorLag
from piezo_opt.errors import InputError
from piezo_opt.signals import best_between, best_for
from tests.control.test_optimal_feedforward import PERIOD, SAW, STAGE, TIGHT, VALUES
from tests.linear_models.plants import held, second_order, steps


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(one) for one in arguments])


def after(count: int) -> Callable[[str], None]:
    """Progress at whose so-manieth sentence somebody presses Ctrl-C."""
    told: list[str] = []

    def tell(sentence: str) -> None:
        told.append(sentence)
        if len(told) == count:
            raise KeyboardInterrupt

    return tell


@pytest.fixture(scope="module")
def fits() -> dict[str, po.Fit]:
    """A lag and a delay, fitted to a record with a delay."""
    time = np.arange(400) / 400.0
    late = 50.0 - 50.0 * np.cos(4.0 * np.pi * (time - 0.01))
    noise = 2e-8 * np.random.default_rng(0).normal(size=time.size)
    drive = 50.0 - 50.0 * np.cos(4.0 * np.pi * time)
    record = po.Measurement(time, drive, 1e-7 * late + noise)
    models = {"lag": PiezoGain() + SensorLag(), "delay": PiezoGain() + Delay()}
    return {
        name: po.solve(po.Identification(model, record, start=po.Start.REST))
        for name, model in models.items()
    }


def test_a_search_for_drives_keeps_its_best(fits: dict[str, po.Fit]) -> None:
    whole = best_for(fits["delay"], evaluations=20)
    assert not whole.interrupted
    early = best_for(fits["delay"], evaluations=20, progress=after(30))
    assert early.interrupted
    assert early.evaluations == 30
    assert "ended early" in early.sentence
    assert early.to_dict()["interrupted"]
    assert early.drive.values.shape == whole.drive.values.shape
    between = best_between(fits, evaluations=8, progress=after(25))
    assert between.interrupted
    assert "ended early" in str(between)
    with pytest.raises(KeyboardInterrupt):
        best_for(fits["delay"], evaluations=20, progress=after(1))


def test_orders_that_were_finished_are_told() -> None:
    record = held(second_order(), steps(1, 400), 2e-8)
    found = po.search_orders(record, poles=(1, 2, 3), progress=after(3))
    assert found.interrupted
    # A held drive lets the reading follow within the sample: one pole with no zero, and with one.
    assert [(r.fit.question.poles, r.fit.question.zeros) for r in found.rows] == [(1, 0), (1, 1)]
    assert "Ended early" in str(found)
    assert found.to_dict()["interrupted"]
    with pytest.raises(KeyboardInterrupt):
        po.search_orders(record, progress=after(1))


def test_designs_that_were_interrupted_hold_what_they_had() -> None:
    asked: dict[str, Any] = {"period": PERIOD, "values": VALUES, "limits": TIGHT}
    whole = po.control.optimal_feedforward(STAGE, SAW, **asked)
    early = po.control.optimal_feedforward(STAGE, SAW, **asked, progress=after(1))
    assert early.interrupted
    assert not early.converged
    assert early.iterations == 1
    assert whole.rms < early.rms < float(np.ptp(SAW))
    pid = po.tune_pid(STAGE, SAW, **asked, progress=after(2))
    assert pid.interrupted
    assert not pid.converged
    assert "the best so far" in str(pid)
    mpc = po.tune_mpc(STAGE, SAW, **asked, noise=5e-9, progress=after(3))
    assert mpc.interrupted
    assert len(mpc.horizons) == 2
    assert "ended early" in str(mpc)
    assert json.loads(json.dumps(mpc.to_dict()))["interrupted"]


def test_the_commands_write_what_there_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    record = tmp_path / "steps.csv"
    po.write(held(second_order(), steps(1, 400), 2e-8), record)
    order = po.search_orders

    def stopped(*given: Any, **said: Any) -> Any:
        return order(*given, **{**said, "progress": after(3)})

    monkeypatch.setattr("piezo_opt.cli.linear.search_orders", stopped)
    out, page = tmp_path / "orders.json", tmp_path / "orders.html"
    done = run("linear", record, "--json", out, "--report", page)
    assert done.exit_code == 130, done.output
    assert "Ended early" in done.stdout
    assert json.loads(out.read_text())["interrupted"]
    assert page.is_file()
    for command in (("linear", record), ("signal", "best", record), ("axes", "fit", record)):
        refused = run(*command, "--max-time", "0 s")
        assert (refused.exit_code, refused.stdout) == (2, "")
        assert "no limit" in refused.stderr
    soon = run("linear", record, "--max-time", "1 us")
    assert soon.exit_code == 2
    assert "1 us were over before there was a result" in soon.stderr


def test_a_limit_is_no_interrupt() -> None:
    leave_early(True, limit_of("1 us"))
    leave_early(False, limit_of(None))
    with pytest.raises(Exit) as left:
        leave_early(True, limit_of(None))
    assert left.value.exit_code == 130
    with pytest.raises(KeyboardInterrupt), limited(limit_of(None)):
        raise KeyboardInterrupt
    with pytest.raises(InputError, match="over before"), limited(limit_of("1 us")):
        raise AssertionError("nothing is begun after the limit")
