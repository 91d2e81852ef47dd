"""Calls that make no sense are one sentence each, at the call."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt import demo, effects
from piezo_opt.stopping import TimeLimit

PID = po.control.PID(1.0, 1.0, 1.0)
FILE = Path(__file__).parents[2] / "data" / "thesis" / "hysteresis.csv"


@pytest.fixture(scope="module")
def fit() -> po.Fit:
    return po.solve(demo.question())


CALLS: dict[str, tuple[Callable[[Any], object], str]] = {
    "rate": (lambda _: po.read(FILE, rate=True), "True is no number and no text"),
    "trim": (lambda _: po.read(FILE, trim=5), "trim is 5: give a text"),  # type: ignore[arg-type]
    "column": (lambda _: po.read(FILE, drive=["u"]), r"drive is \['u'\]: give a text"),  # type: ignore[arg-type]
    "no file": (lambda _: po.read(None), "The file is None: give its path"),
    "arrays": (
        lambda _: po.read(np.zeros((9, 3))),
        "The file is array.*: give its path",
    ),
    "findings": (lambda f: po.check(f.records, accept=None), "accept is None"),  # type: ignore[arg-type]
    "grid": (lambda f: f.records[0].resample(rate="1 THz"), "choose a longer step"),
    "one bound": (lambda f: _asked(f, bounds={"bouc_wen.n": (1,)}), "give .low, high"),
    "no bounds": (lambda f: _asked(f, bounds={"bouc_wen.n": 3}), "give .low, high"),
    "no question": (lambda f: po.solve(f.records[0]), "The question is .*: give Identification"),
    "class": (lambda f: po.solve(f.question, solver=po.NelderMead), "such as NelderMead.."),
    "way": (lambda f: po.solve(f.question, transcription="x"), "such as MultipleShooting"),  # type: ignore[arg-type]
    "start": (lambda f: po.solve(f.question, start={"typo": 1.0}), "no parameter 'typo'"),
    "no start": (lambda f: po.solve(f.question, start=3), "start is 3: give a fit"),  # type: ignore[arg-type]
    "no starts": (lambda f: po.solve(f.question, starts=0), "starts is 0: give a whole number"),
    "half": (lambda f: po.solve(f.question, starts=2.5), "starts is 2.5"),  # type: ignore[arg-type]
    "seed": (lambda f: po.solve(f.question, starts=2, seed=-1), "seed is -1"),
    "silent": (lambda f: po.solve(f.question, progress=5), "progress is 5"),  # type: ignore[arg-type]
    "soon": (lambda _: TimeLimit("soon"), "no limit: give a positive time"),  # type: ignore[arg-type]
    "steps": (lambda _: po.LevenbergMarquardt(iterations=-1), "iterations is -1"),
    "close": (lambda _: po.LevenbergMarquardt(tolerance=float("nan")), "tolerance is nan"),
    "record": (lambda f: po.compare(f.records[0]), "compare: fit 1 is .*: give what solve returns"),
    "letters": (lambda f: po.compare(f, names="a"), "names is the text 'a': give a tuple"),
    "effort": (lambda f: po.diagnose(f, effort="garbage"), "give Effort.QUICK"),  # type: ignore[arg-type]
    "word": (lambda f: po.diagnose(f, candidates=["creep"]), "A candidate is 'creep'"),  # type: ignore[list-item]
    "one": (lambda f: po.diagnose(f, candidates=effects.Creep()), "candidates is Creep"),  # type: ignore[arg-type]
    "withheld": (lambda f: po.diagnose(f, withhold="creep"), "withhold is the text 'creep'"),
    "threads": (lambda f: po.diagnose(f, threads=0), "threads is 0"),
    "test": (lambda f: po.diagnose(f, test=3), "test is 3: give a record"),  # type: ignore[arg-type]
    "drive": (lambda f: po.simulate(f.model, 3), "The record is 3: give what read returns"),  # type: ignore[arg-type]
    "rest": (lambda f: po.simulate(f.model, f.records[0], initial="x"), "give Initial.REST"),  # type: ignore[arg-type]
    "share": (lambda f: po.simulate(f.model, f.records[0], tolerance=-1.0), "tolerance is -1"),
    "ladder": (lambda f: po.diagnose(f, ladder="no"), "ladder is 'no': give True or False"),  # type: ignore[arg-type]
    "unit": (
        lambda f: po.simulate(f.model, f.records[0], {"piezo_gain.d": "1 V"}),
        "'1 V' is not a quantity in m/V",
    ),
    "limits": (lambda _: po.signals.within(None, None), "drive is None: give a drive"),  # type: ignore[arg-type]
    "profile": (lambda f: po.profile_likelihood(f, names="a.b"), "names is the text 'a.b'"),
    "title": (lambda f: po.write_report("x.html", f, title=5), "title is 5: give a text"),  # type: ignore[arg-type]
    "values": (lambda _: po.Values({"a": "x"}), "Value of 'a' is 'x'"),  # type: ignore[dict-item]
    "no fit": (lambda _: po.save_fit(None, "x.h5"), "The fit is None"),  # type: ignore[arg-type]
    "poles": (lambda f: po.fit_transfer(f.records[0], poles=1.5), "poles is 1.5"),  # type: ignore[arg-type]
    "plus": (lambda f: f.model + effects.Creep, r"Creep is a class: write Creep\(\)"),
    "sum": (lambda f: f.model + 3, "3 is no effect"),
    "name": (lambda f: f.records[0].rename(None), "name is None: give a text"),  # type: ignore[arg-type]
    "note": (lambda f: f.records[0].with_(notes=(1,)), "A note is 1: give a sentence"),
    "notes": (lambda f: f.records[0].with_(notes=None), "notes is None"),
    "stuck": (lambda f: f.records[0].with_(allow_saturated="no"), "give True or False"),
    "begins": (
        lambda f: f.records[0].with_(startup=None),
        "hysteresis: startup: None is no number",
    ),
    "repeats": (lambda f: f.records[0].with_(period=[1.0]), "period: .* is no number"),
    "truth": (lambda f: f.records[0].with_(period=True), "period: True is no number"),
    "letters of records": (lambda _: po.Campaign("ab"), "'a' is no record"),  # type: ignore[arg-type]
    "campaign": (lambda _: po.read_campaign(None), "The file is None"),  # type: ignore[arg-type]
    "nowhere": (lambda f: po.write(f.records[0], None), "The file is None"),  # type: ignore[arg-type]
    "no question's fit": (lambda _: po.load_fit(None), "The file is None"),  # type: ignore[arg-type]
    "list": (lambda _: po.Model([effects.PiezoGain()]), "A model is a sum"),  # type: ignore[arg-type]
    "fixed": (
        lambda f: _asked(f, fixed="bouc_wen.n"),
        "fixed is 'bouc_wen.n': give numbers by name",
    ),
    "prior": (
        lambda f: _asked(f, priors={"bouc_wen.beta": 3}, noise=1e-8),
        "prior of 'bouc_wen.beta' is 3",
    ),
    "mean": (lambda _: po.Prior("1", "2"), "Prior.1, 2.: the mean must be finite"),  # type: ignore[arg-type]
    "noise": (lambda f: _asked(f, noise=True), "noise is True; give a positive"),
    "noise in volts": (lambda f: _asked(f, noise="5 V"), "'5 V' is not a quantity in m"),
    "true value": (lambda f: _asked(f, values={"piezo_gain.d": True}), "give a finite number"),
    "beyond": (
        lambda f: po.solve(f.question, start={"bouc_wen.beta": -1e9}),
        "start: 'bouc_wen.beta' is -1e.09 1/V, beyond its bound",
    ),
    "helpers": (
        lambda f: po.solve(f.question, starts=2, executor=2),  # type: ignore[arg-type]
        "executor is 2: give one of concurrent",
    ),
    "solver's name": (lambda f: po.solve(f.question, solver="lm"), "give one that is made"),
    "replicates": (lambda f: po.bootstrap(f, 20.5), "replicates is 20.5"),  # type: ignore[arg-type]
    "replicates' seed": (lambda f: po.bootstrap(f, 20, seed=-1), "seed is -1"),
    "other units": (
        lambda f: po.compare(f, on=f.records[0].with_(position_unit="rad")),
        "hysteresis has position_unit rad and the fit was made in m",
    ),
    "orders": (lambda f: po.search_orders(f.records[0], poles="12"), "poles is the text '12'"),  # type: ignore[arg-type]
    "drives": (lambda f: po.signals.best_for(f, evaluations=-1), "evaluations is -1"),
    "meant": (lambda f: po.signals.best_for(f, "bouc_wen.beta"), "parameters is the text"),
    "plant": (lambda _: po.tune_pid(None, [0.0, 1e-6]), "The plant is None"),  # type: ignore[arg-type]
    "numbers": (lambda _: po.Values([1, 2]), "give numbers by name"),  # type: ignore[arg-type]
    "reference": (lambda f: po.tune_pid(f, "x"), "reference is the text 'x'"),
    "no reference": (lambda f: po.tune_pid(f, []), "give at least two finite values"),
    "late": (lambda f: po.tune_pid(f, [0.0, 1e-6], delay=-1), "delay is -1"),
    "very robust": (lambda f: po.tune_pid(f, [0.0, 1e-6], peak=0.5), "peak is 0.5"),
    "range": (
        lambda f: po.tune_pid(f, [0.0, 1e-6], limits=(0, 9)),
        "limits is .0, 9.: give Limits",
    ),  # type: ignore[arg-type]
    "volts": (lambda _: po.control.Limits("0 V", "9 V"), "low is '0 V': give a number"),  # type: ignore[arg-type]
    "gains": (lambda _: po.control.PID("a", 1.0, 1.0), "kp is 'a': give a number"),  # type: ignore[arg-type]
    "ahead": (lambda f: po.tune_mpc(f, [0.0, 1e-6], horizon=2.5), "horizon is 2.5"),  # type: ignore[arg-type]
    "a plant": (
        lambda _: po.control.close_loop(
            None, po.control.PID(1.0, 1.0, 1.0), [0.0, 1e-6], period=1.0
        ),  # type: ignore[arg-type]
        "The plant is None: give ModelPlant",
    ),
    "a controller": (
        lambda f: po.control.close_loop(po.control.ModelPlant(f), None, [0.0, 1e-6], period=1.0),  # type: ignore[arg-type]
        "The controller is None",
    ),
    "mode": (lambda _: po.control.zv("a", 0.1), "omega is 'a'"),  # type: ignore[arg-type]
    "low": (lambda _: po.signals.square("0 V", 5.0, 1.0, rate=99.0), "low is '0 V'"),  # type: ignore[arg-type]
    "levels": (lambda _: po.signals.staircase("abc", 1.0, rate=9.0), "levels is the text"),  # type: ignore[arg-type]
    "lines": (
        lambda _: po.signals.multisine(0.0, 5.0, 1.0, 9.0, 1.0, rate=99.0, lines="x"),  # type: ignore[arg-type]
        "lines is 'x': give Lines.FULL",
    ),
    "axes": (lambda _: po.read_axes(None), "The file is None"),  # type: ignore[arg-type]
    "no axes": (lambda _: po.response_matrix(None), "A record is None"),  # type: ignore[arg-type]
    "ceramic": (lambda _: po.physics.material(None), "The material is None"),  # type: ignore[arg-type]
    "expected": (lambda f: po.priors_from(3, f.model), "expected is 3"),  # type: ignore[arg-type]
    "source": (lambda _: po.export_c(None, "x"), "The source is None"),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("name", CALLS)
def test_a_call_that_makes_no_sense_is_one_sentence(
    name: str, fit: po.Fit, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    call, says = CALLS[name]
    with pytest.raises(po.PiezoOptError, match=says) as told:
        call(fit)
    assert len(str(told.value).splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def _asked(fit: po.Fit, **said: Any) -> po.Identification:
    return po.Identification(fit.model, fit.records, **said)
