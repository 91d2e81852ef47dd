"""A fit comes back from its file as it was, and can be asked again."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.identification.storage import load_fit, save_fit
from tests.identification.truth import MOVING, STILL, TRUTH, loops, record

TIME, DRIVE = loops(200)
NOISE = 3e-9
ONE = record(STILL, TRUTH, TIME, DRIVE, noise=NOISE, name="one")
TWO = record(STILL, TRUTH, TIME, 0.8 * DRIVE, noise=NOISE, seed=1, name="two")


@pytest.fixture(scope="module")
def fit() -> po.Fit:
    """A fit whose question uses every choice there is."""
    question = po.Identification(
        STILL, [ONE, TWO.slice(0.5, None)], values={"bouc_wen.beta": 0.04},
        fixed={"bouc_wen.h_s": 2e-6, "offset.y0[1]": TRUTH["offset.y0"]}, free=("bouc_wen.n",),
        bounds={"bouc_wen.gamma": (-0.1, 0.1)}, priors={"piezo_gain.d": po.Prior(1.2e-7, 1e-8)},
        per_record=("bouc_wen.alpha",), loss=po.Loss(po.Shape.HUBER, 5 * NOISE), noise=NOISE,
        weights=(1.0, 2.0), start=po.Start.FREE,
    )  # fmt: skip
    return po.solve(question, starts=2, seed=1)


@pytest.fixture(scope="module")
def path(fit: po.Fit, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("fits") / "fit.h5"
    save_fit(fit, file)
    return file


def test_the_answer_comes_back_bit_by_bit(fit: po.Fit, path: Path) -> None:
    back = load_fit(path)
    assert dict(back.values) == dict(fit.values)
    assert back.names == fit.names
    np.testing.assert_array_equal(back.covariance, fit.covariance)
    np.testing.assert_array_equal(back.trace.values, fit.trace.values)
    np.testing.assert_array_equal(back.trace.rms, fit.trace.rms)
    np.testing.assert_array_equal(back.readings[0], fit.readings[0])
    np.testing.assert_array_equal(back.readings[1], fit.readings[1])
    assert back.rms == fit.rms
    assert back.outcome == fit.outcome
    assert back.evaluations == fit.evaluations
    assert back.accuracy == fit.accuracy
    assert back.blind == fit.blind
    assert back.remarks == fit.remarks
    assert back.starts == fit.starts
    assert back.to_dict() == fit.to_dict()
    assert str(back) == str(fit)
    assert back.interval("bouc_wen.beta") == fit.interval("bouc_wen.beta")


def test_a_fit_comes_back_on_the_scheme_that_it_was_made_with(tmp_path: Path) -> None:
    given = record(MOVING, TRUTH, TIME, DRIVE, noise=NOISE)
    question = po.Identification(MOVING, given)
    coarse = po.SingleShooting(refine=False)
    compared = po.solve(question, start=TRUTH, transcription=coarse)
    assert compared.accuracy[0].substeps.exact
    save_fit(compared, tmp_path / "fit.h5")
    back = load_fit(tmp_path / "fit.h5")
    assert back.accuracy == compared.accuracy
    # And what it predicts is simulated with it, too.
    again, own = back.predict(given), compared.readings[0]
    np.testing.assert_allclose(again, own, rtol=0, atol=1e-4 * np.ptp(own))
    # Files of before tell of no scheme: there was one.
    with h5py.File(tmp_path / "fit.h5", "r+") as file:
        told = json.loads(file["fit/result"][()].tobytes())
        told["accuracy"] = [row[:5] for row in told["accuracy"]]
        del file["fit/result"]
        file["fit/result"] = np.frombuffer(json.dumps(told).encode(), dtype=np.uint8)
    before = load_fit(tmp_path / "fit.h5").accuracy[0].substeps
    assert before == replace(compared.accuracy[0].substeps, exact=False)


def test_the_question_comes_back(fit: po.Fit, path: Path) -> None:
    asked, was = load_fit(path).question, fit.question
    for name in (
        "values", "fixed", "free", "bounds", "priors", "per_record", "start", "loss", "noise",
        "weights",
    ):  # fmt: skip
        assert getattr(asked, name) == getattr(was, name), name
    assert asked.model == was.model
    for one, two in zip(asked.campaign.records, was.campaign.records, strict=True):
        assert one.name == two.name
        np.testing.assert_array_equal(one.time, two.time)
        np.testing.assert_array_equal(one.position, two.position)


def test_the_same_question_gives_the_same_answer(fit: po.Fit, path: Path) -> None:
    back = load_fit(path)
    assert po.solve(back.question, starts=2, seed=1).rms == fit.rms
    resumed = po.solve(back.question, start=back)
    assert resumed.rms == pytest.approx(fit.rms, rel=1e-6)


def test_the_records_alone_can_be_read(path: Path) -> None:
    assert [r.name for r in po.read_campaign(path).records] == ["one", "two"]


def test_a_bound_stays_without_interval(tmp_path: Path) -> None:
    held = po.solve(po.Identification(STILL, ONE, bounds={"bouc_wen.beta": (0.0, 0.03)}))
    save_fit(held, tmp_path / "held.h5")
    back = load_fit(tmp_path / "held.h5")
    assert back.at_bound == ("bouc_wen.beta",)
    np.testing.assert_array_equal(back.covariance, held.covariance)
    assert np.isnan(back.std["bouc_wen.beta"])


def test_nothing_is_overwritten_unasked(fit: po.Fit, tmp_path: Path) -> None:
    target = tmp_path / "fit.h5"
    target.write_bytes(b"precious")
    with pytest.raises(po.InputError, match=r"fit\.h5"):
        save_fit(fit, target)
    assert target.read_bytes() == b"precious"
    save_fit(fit, target, overwrite=True)
    assert load_fit(target).rms == fit.rms
    assert list(tmp_path.iterdir()) == [target]


def test_a_file_of_records_is_no_fit(tmp_path: Path) -> None:
    po.write(po.Campaign((ONE, TWO)), tmp_path / "records.h5")
    with pytest.raises(po.InputError, match="holds records but no fit"):
        load_fit(tmp_path / "records.h5")


@pytest.mark.parametrize("content", [b"", b"no file of ours"])
def test_another_file_is_refused(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "fit.h5").write_bytes(content)
    with pytest.raises(po.InputError, match=r"fit\.h5"):
        load_fit(tmp_path / "fit.h5")


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(po.InputError, match="no such file"):
        load_fit(tmp_path / "fit.h5")


@pytest.mark.parametrize("name", ["question", "result"])
@pytest.mark.parametrize("text", [b"{", b"{}", b"[]", b"\xff"])
def test_a_broken_sentence_is_refused(name: str, text: bytes, path: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken.h5"
    broken.write_bytes(path.read_bytes())
    with h5py.File(broken, "a") as file:
        del file["fit"][name]
        file["fit"][name] = np.frombuffer(text, dtype=np.uint8)
    with pytest.raises(po.InputError, match=r"broken\.h5: the fit in this file cannot be read"):
        load_fit(broken)


@pytest.mark.parametrize(
    "name", ["question", "result", "covariance", "reading_0001", "trace_values", "trace_rms"]
)
def test_a_missing_part_is_named(name: str, path: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken.h5"
    broken.write_bytes(path.read_bytes())
    with h5py.File(broken, "a") as file:
        del file["fit"][name]
    with pytest.raises(po.InputError, match=rf"broken\.h5: the fit .* cannot be read .*{name}"):
        load_fit(broken)


def test_many_starts_fit_into_the_file(fit: po.Fit, tmp_path: Path) -> None:
    many = replace(fit, starts=fit.starts * 300)
    save_fit(many, tmp_path / "many.h5")
    assert load_fit(tmp_path / "many.h5").starts == many.starts


def test_a_truncated_file_is_refused(path: Path, tmp_path: Path) -> None:
    short = tmp_path / "short.h5"
    short.write_bytes(path.read_bytes()[:-2000])
    with pytest.raises(po.InputError, match=r"short\.h5"):
        load_fit(short)


def test_a_fit_of_an_own_effect_is_read_with_its_model(fit: po.Fit, path: Path) -> None:
    back = load_fit(path, model=STILL)
    assert back.model is STILL
    assert dict(back.values) == dict(fit.values)
    assert replace(back, question=fit.question).rms == fit.rms
