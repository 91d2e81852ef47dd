"""Transfer functions by output error: known poles, intervals that hold, and what is refused."""

from __future__ import annotations

import control
import numpy as np
import pytest

from piezo_opt.datasets import load
from piezo_opt.errors import InputError
from piezo_opt.identification import Start
from piezo_opt.linear_models import Detrend, LinearQuestion, fit_transfer, judge, search_orders
from piezo_opt.linear_models.cascade import Cascade
from piezo_opt.linear_models.responses import Prepared, Scale, solved
from piezo_opt.linear_models.transfer import half_width
from piezo_opt.measurement import Between, Measurement
from tests.linear_models.plants import STEP, held, second_order, steps, straight, third_order


def relative(found: np.ndarray, known: np.ndarray) -> float:
    """Largest relative distance of roots in order."""
    a, b = np.sort_complex(found), np.sort_complex(known)
    return float(np.max(np.abs(a - b) / np.abs(b)))


@pytest.mark.parametrize("zeros", [1, 2])
def test_without_noise_poles_and_zeros_are_found_to_a_millionth(zeros: int) -> None:
    system = third_order()
    if zeros == 2:
        system = system * control.tf([1.0 / 400.0, 1.0], [1.0])
    fit = fit_transfer(held(system, steps(1, 800)), 3, zeros)
    assert relative(fit.poles, system.poles()) < 1e-6
    assert relative(fit.zeros, system.zeros()) < 1e-6
    assert fit.dc_gain == pytest.approx(float(system.dcgain()), rel=1e-6)
    assert isinstance(fit.transfer, control.TransferFunction)
    assert float(np.real(fit.transfer(0.0))) == pytest.approx(fit.dc_gain, rel=1e-9)


def test_an_uneven_clock_is_stepped_exactly() -> None:
    chance = np.random.default_rng(3)
    time = np.cumsum(STEP * chance.uniform(0.4, 1.6, 500))
    time[300:] += 0.1  # a gap
    record = straight(third_order(), time, 50.0 * chance.random(500))
    assert not record.uniform
    fit = fit_transfer(record, 3, 1)
    assert relative(fit.poles, third_order().poles()) < 1e-6


def test_the_wrong_hold_is_a_wrong_model() -> None:
    record = held(second_order(), steps(2, 600))
    right = fit_transfer(record, 2, 1)
    wrong = fit_transfer(record.with_(between=Between.LINEAR), 2, 1)
    assert right.metrics.rms < 1e-12
    assert wrong.metrics.rms > 1e-9
    assert "held between samples" in str(right)
    assert "straight between samples" in str(wrong)


def test_derivatives_are_exact() -> None:
    record = held(third_order(), steps(4, 300), noise=1e-7)
    for start in (Start.FREE, Start.REST):
        for detrend in Detrend:
            question = LinearQuestion(record, 3, 2, start=start, detrend=detrend)
            ready = (Prepared.of(record, question, Scale.of(question)),)
            chain = Cascade((2, 1), np.array([200.0, 120.0]), True)
            p = np.array([0.1, -1.5, 0.2])
            here = solved(ready, chain, p, question)
            for k in range(3):
                moved = [p + s * 1e-6 * np.eye(3)[k] for s in (1.0, -1.0)]
                costs = [solved(ready, chain, q, question).cost for q in moved]
                slope = (costs[0] - costs[1]) / 2e-6
                assert -2.0 * here.slope[:, k] @ here.residual == pytest.approx(slope, rel=1e-5)


def test_intervals_hold_the_truth() -> None:
    """95 % intervals over 40 records of four numbers each; the docs have 200."""
    system, inside = second_order(), []
    pole = next(p for p in system.poles() if p.imag > 0)
    for seed in range(40):
        fit = fit_transfer(held(system, steps(seed, 200), 1e-7, seed), 2, 1)
        wide = half_width(fit)
        k = int(np.argmax(fit.poles.imag))
        inside.append(
            [
                abs(fit.poles[k].real - pole.real) < wide * fit.pole_sigma[k, 0],
                abs(fit.poles[k].imag - pole.imag) < wide * fit.pole_sigma[k, 1],
                abs(fit.dc_gain - system.dcgain()) < wide * fit.dc_gain_sigma,
                abs(fit.zeros[0].real - system.zeros()[0].real) < wide * fit.zero_sigma[0, 0],
            ]
        )
    share = np.mean(inside)
    assert 0.90 <= share <= 0.99
    assert np.mean(inside, axis=0).min() >= 0.85


def test_the_start_is_estimated_or_at_rest() -> None:
    record = held(second_order(), np.concatenate([np.zeros(40), steps(6, 500)]))
    late = record.slice(0.3)  # begins in the middle of a vibration
    free = fit_transfer(late, 2, 1)
    assert relative(free.poles, second_order().poles()) < 1e-6
    assert fit_transfer(late, 2, 1, start=Start.REST).metrics.rms > 100.0 * free.metrics.rms
    assert fit_transfer(record, 2, 1, start=Start.REST).metrics.rms < 1e-12


def test_a_drift_is_taken_out_only_when_asked() -> None:
    clean = held(second_order(), steps(8, 500))
    record = clean.with_(position=clean.position + 2e-6 * clean.time)
    assert fit_transfer(record, 2, 1, detrend=Detrend.LINE).metrics.rms < 1e-12
    assert fit_transfer(record, 2, 1).metrics.rms > 1e-8


def test_stable_by_choice() -> None:
    omega = 60.0
    growing = control.tf([80e-9 * omega**2], [1.0, -0.4, omega**2])
    record = held(growing, steps(9, 700))
    free = fit_transfer(record, 2, 0, stable=False)
    assert relative(free.poles, growing.poles()) < 1e-6
    assert any("unstable" in sentence for sentence in free.remarks)
    assert np.all(fit_transfer(record, 2, 0).poles.real < 0.0)


def test_several_records_share_one_system() -> None:
    system = third_order()
    first = held(system, steps(1, 300)).rename("a")
    second = held(system, steps(2, 260)).slice(0.1).rename("b")
    second = second.with_(position=second.position + 1e-6)
    fit = fit_transfer([first, second], 3, 1)
    assert relative(fit.poles, system.poles()) < 1e-6
    assert len(fit.misfits) == 2


def test_the_search_finds_the_order_on_data_that_it_has_not_seen() -> None:
    system = third_order()
    train = held(system, steps(1, 700), 2e-8, 1)
    test = held(system, steps(2, 700), 2e-8, 2)
    search = search_orders(train, test=test, poles=range(1, 5), zeros=range(3))
    assert (search.best.question.poles, search.best.question.zeros) == (3, 1)
    assert search.best.whiteness[0].white
    assert "*" in str(search)
    by_order = {
        (row.fit.question.poles, row.fit.question.zeros): row.fit.metrics.rms for row in search.rows
    }
    assert by_order[3, 1] < 0.1 * by_order[2, 1]


def test_a_prediction_estimates_start_and_offset_alone() -> None:
    system = second_order()
    fit = fit_transfer(held(system, steps(1, 400)), 2, 1)
    other = held(system, steps(5, 500)).slice(0.2)
    (mine,) = fit.on(other.with_(position=other.position - 7e-6))
    (theirs,) = judge(fit.transfer, other)
    assert mine.rms < 1e-12
    assert theirs.rms < 1e-12
    assert judge(2.0 * fit.transfer, other)[0].rms > 1e-8


def test_what_sampling_cannot_show_is_said() -> None:
    fit = fit_transfer(load("thesis/hysteresis"), 4, 1)
    assert any("above half the sampling rate" in sentence for sentence in fit.remarks)
    assert fit.metrics.fit_percent > 97.0


def test_a_resonance_above_half_the_sampling_rate_has_an_equal_below_it() -> None:
    omega = 2.0 * np.pi * 180.0
    fast = control.tf([80e-9 * omega**2], [1.0, 0.2 * omega, omega**2])
    record = held(fast, steps(3, 2400, hold=20), 1e-9)
    record = Measurement(
        time=record.time[::4],
        drive=record.drive[::4],
        position=record.position[::4],
        between=Between.HELD,
    )
    alias = fit_transfer(record, 2, 1)
    (true,) = judge(fast, record)
    assert alias.poles.imag.max() < np.pi / record.step
    assert alias.metrics.rms == pytest.approx(true.rms, rel=0.02)


@pytest.mark.parametrize(
    ("poles", "zeros", "words"),
    [
        (0, None, "at least one pole"),
        (2, 3, "follow the rate"),
        (60, 20, "unknowns"),
    ],
)
def test_orders_that_make_no_sense_are_refused(poles: int, zeros: int | None, words: str) -> None:
    record = held(second_order(), steps(1, 100))
    with pytest.raises(InputError, match=words):
        fit_transfer(record, poles, zeros)
