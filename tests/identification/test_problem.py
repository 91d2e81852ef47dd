"""A question is refused at birth by name and with the remedy; and it travels to other models."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.effects import Creep, Offset, PiezoGain
from piezo_opt.identification.problem import plain
from tests.identification.truth import STILL, TRUTH, loops

TIME, DRIVE = loops(40)
RECORD = po.Measurement(TIME, DRIVE, 1e-7 * DRIVE, name="bench")


@pytest.mark.parametrize(
    ("choices", "kind", "words"),
    [
        ({"values": {"bouc_wen.alfa": 1.0}}, po.ModelError, ("bouc_wen.alfa", "bouc_wen.alpha")),
        ({"fixed": {"creep.c": 0.1}}, po.ModelError, ("fixed", "creep.c", "piezo_gain.d")),
        ({"free": ("bouc_wen.m",)}, po.ModelError, ("free", "bouc_wen.m", "bouc_wen.n")),
        ({"bounds": {"d": (0, 1)}}, po.ModelError, ("bounds", "'d'", "piezo_gain.d")),
        ({"priors": {"d": po.Prior(0, 1)}}, po.ModelError, ("priors", "piezo_gain.d")),
        ({"per_record": ("gain",)}, po.ModelError, ("per_record", "gain", "piezo_gain.d")),
        ({"bounds": {"piezo_gain.d": (2e-7, 1e-7)}}, po.InputError, ("2e-07", "(low, high)")),
        ({"bounds": {"piezo_gain.d": (1.0, 1.0)}}, po.InputError, ("piezo_gain.d", "not below")),
        ({"bounds": {"piezo_gain.d": (0.0, np.nan)}}, po.InputError, ("piezo_gain.d", "nan")),
        ({"priors": {"piezo_gain.d": po.Prior(1e-7, 1e-9)}}, po.InputError, ("noise=", "metres")),
        ({"noise": 0.0}, po.InputError, ("noise is 0.0", "positive")),
        ({"noise": float("nan")}, po.InputError, ("noise is nan",)),
        ({"weights": (1.0, 1.0)}, po.InputError, ("one positive number", "each of the 1")),
        ({"weights": (0.0,)}, po.InputError, ("weights (0.0,)",)),
        ({"weights": (float("nan"),)}, po.InputError, ("weights (nan,)",)),
        ({"start": po.Start.PERIODIC}, po.InputError, ("bench", "period=")),
        ({"values": {"piezo_gain.d": "0.1 um"}}, po.InputError, ("m/V",)),
        ({"values": {"piezo_gain.d": float("inf")}}, po.InputError, ("piezo_gain.d", "finite")),
        ({"values": {"initial.bouc_wen.k": 1e-7}}, po.ModelError, ("initial.bouc_wen.h",)),
        ({"bounds": {"initial.creep.z[0]": (-1, 1)}}, po.ModelError, ("bounds", "initial.creep")),
        ({"start": "garbage"}, po.InputError, ("start is 'garbage'", "Start.REST")),
        ({"loss": "huber"}, po.InputError, ("loss is 'huber'", "scale=3e-8")),
        ({"free": "bouc_wen.n"}, po.InputError, ("free is the text 'bouc_wen.n'", "a tuple")),
        ({"values": {"piezo_gain.d": 1j}}, po.InputError, ("piezo_gain.d", "1j", "finite number")),
        ({"values": {"piezo_gain.d": 1e9}}, po.InputError, ("1e+09 m/V", "bound 0.001 m/V")),
        ({"fixed": {"bouc_wen.n": -2.0}}, po.InputError, ("fixed", "-2 1", "bound")),
        ({"values": {"piezo_gain.d": 3e-7}, "bounds": {"piezo_gain.d": (0.0, 2e-7)}},
         po.InputError, ("3e-07 m/V", "bound 2e-07 m/V", "widen the bounds")),
    ],
)  # fmt: skip
def test_a_senseless_question_is_refused_by_name(
    choices: dict[str, Any], kind: type[Exception], words: tuple[str, ...]
) -> None:
    with pytest.raises(kind) as refusal:
        po.Identification(STILL, RECORD, **choices)
    for word in words:
        assert word in str(refusal.value)


def test_a_model_is_no_text() -> None:
    with pytest.raises(po.ModelError, match=r"'bouc_wen' is no model.*PiezoGain\(\)"):
        po.Identification("bouc_wen", RECORD)  # type: ignore[arg-type]


@pytest.mark.parametrize("scale", [0.0, -1e-9, 1j, "30 nm", None, True])
def test_a_loss_with_a_scale_that_is_none_is_refused(scale: Any) -> None:
    with pytest.raises(po.InputError, match="positive length in metres"):
        po.Loss(po.Shape.HUBER, scale)


def test_a_robust_loss_needs_a_scale_and_a_shape_that_exists() -> None:
    """With a scale of a metre a robust loss of nanometres would be least squares."""
    with pytest.raises(po.InputError, match=r"huber has no scale.*three times the noise"):
        po.Loss(po.Shape.HUBER)
    with pytest.raises(po.InputError, match=r"'nonsense': give Shape.SQUARE, .*Shape.CAUCHY"):
        po.Loss("nonsense")  # type: ignore[arg-type]
    assert po.Loss("huber", 3e-8) == po.Loss(po.Shape.HUBER, 3e-8)  # type: ignore[arg-type]
    assert po.Loss() == po.Loss(po.Shape.SQUARE, 1.0)


@pytest.mark.parametrize(
    ("choices", "words"),
    [
        ({"fixed": {"offset.y0[1]": 0.0}}, ("fixed: 'offset.y0[1]'", "one record, number 0")),
        ({"values": {"initial.creep.z[7]": 0.0}}, ("initial.creep.z[7]", "elements from 0 to")),
        ({"bounds": {"initial.bouc_wen.h[2]": (0.0, 1.0)}}, ("bounds", "number 0")),
    ],
)  # fmt: skip
def test_numbers_of_records_that_do_not_exist_are_refused(
    choices: dict[str, Any], words: tuple[str, ...]
) -> None:
    with pytest.raises(po.InputError) as refusal:
        po.solve(po.Identification(STILL + Creep(), RECORD, **choices))
    for word in words:
        assert word in str(refusal.value)


def test_start_values_of_another_fit_are_moved_into_the_bounds() -> None:
    question = po.Identification(STILL, RECORD, bounds={"piezo_gain.d": (0.0, 2e-7)})
    moved = question.starting_at({"piezo_gain.d": 3e-7, "creep.c": 1.0, "offset.y0[4]": 1e-6})
    assert moved.given() == {"piezo_gain.d": 2e-7}
    # A stroke that falls as the drive rises has its bounds mirrored.
    assert question.starting_at({"piezo_gain.d": -1e-7}).given() == {"piezo_gain.d": -1e-7}
    assert po.Identification(STILL, RECORD, values={"piezo_gain.d": -1e-7}).given()


@pytest.mark.parametrize(("mean", "std"), [(1.0, 0.0), (1.0, -1.0), (np.nan, 1.0), (1.0, np.inf)])
def test_a_prior_without_a_width_is_refused(mean: float, std: float) -> None:
    with pytest.raises(po.InputError, match="finite and the standard deviation a positive"):
        po.Prior(mean, std)


def test_text_carries_its_unit() -> None:
    question = po.Identification(
        STILL, RECORD,
        values={"piezo_gain.d": "0.12 um/V", "initial.bouc_wen.h": "-30 nm"},
        fixed={"offset.y0": "20 nm"},
    )  # fmt: skip
    assert question.given() == pytest.approx({"piezo_gain.d": 1.2e-7, "initial.bouc_wen.h": -3e-8})
    assert question.fixed == pytest.approx({"offset.y0": 2e-8})


def test_another_model_keeps_what_fits_it() -> None:
    wide = STILL + Creep()
    question = po.Identification(
        wide, RECORD,
        values={"creep.tau": 2.0, "piezo_gain.d": 1e-7,
                "initial.creep.z[0]": 1e-8, "initial.bouc_wen.h": 1e-8},
        fixed={"creep.c": 0.01, "bouc_wen.gamma": 0.0}, free=("bouc_wen.n",),
        bounds={"creep.tau": (1.0, 3.0), "offset.y0": (0.0, 1e-6)},
        priors={"creep.tau": po.Prior(2.0, 1.0), "piezo_gain.d": po.Prior(1e-7, 1e-8)},
        noise=1e-9, per_record=("creep.c", "piezo_gain.d"),
    )  # fmt: skip
    narrow = question.with_model(PiezoGain() + Offset())
    assert narrow.values == {"piezo_gain.d": 1e-7}
    assert narrow.fixed == {}
    assert narrow.free == ()
    assert set(narrow.bounds) == {"offset.y0"}
    assert set(narrow.priors) == {"piezo_gain.d"}
    assert narrow.per_record == ("piezo_gain.d",)
    assert narrow.noise == 1e-9
    assert question.with_model(wide).values == question.values


def test_starting_at_takes_the_names_it_knows_and_keeps_the_rest() -> None:
    question = po.Identification(STILL, RECORD, values={"bouc_wen.beta": 0.1, "piezo_gain.d": 1e-7})
    moved = question.starting_at({**TRUTH, "creep.c": 0.01, "initial.bouc_wen.h": 1e-8})
    assert moved.given() == {**TRUTH, "initial.bouc_wen.h": 1e-8}
    assert question.given() == {"bouc_wen.beta": 0.1, "piezo_gain.d": 1e-7}


def test_what_is_known_of_the_start_follows_from_the_record() -> None:
    assert po.Identification(STILL, RECORD).start_of(RECORD) is po.Start.FREE
    time = np.arange(80) / 100.0
    drive = 30.0 - 30.0 * np.cos(2 * np.pi * time / 0.4)
    steady = po.Measurement(time, drive, 1e-7 * drive, period=0.4)
    assert po.Identification(STILL, steady).start_of(steady) is po.Start.PERIODIC
    virgin = po.Identification(STILL, steady, start=po.Start.REST)
    assert virgin.start_of(steady) is po.Start.REST


def test_other_records_drop_the_weights_of_the_old_ones() -> None:
    question = po.Identification(
        STILL, [RECORD, RECORD.rename("two")], weights=(1.0, 4.0), noise=1e-9
    )
    other = question.with_records(RECORD)
    assert other.weights == ()
    assert len(other.campaign.records) == 1
    assert other.noise == 1e-9


def test_only_a_parameter_carries_a_record_number() -> None:
    assert plain("offset.y0[12]") == "offset.y0"
    assert plain("offset.y0") == "offset.y0"
    assert plain("initial.creep.z[1]") == "initial.creep.z[1]"
