"""The smallest correction: exact answers, planted forces found, silence on noise, linear cost."""

from __future__ import annotations

import importlib
import threading
import time
from contextlib import suppress
from typing import Any

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.diagnosis import Force, Quantity, forces, unexplained
from piezo_opt.diagnosis.entering import Entering, _channels, _probe, pieces
from piezo_opt.diagnosis.noise import structure
from piezo_opt.effects import AmplifierLag, BoucWen, Delay, Offset, PiezoGain
from piezo_opt.effects.base import Place
from piezo_opt.identification.unknowns import theta_of, unknowns
from piezo_opt.simulation import Simulator
from tests.diagnosis.planted import FLOOR, entering, planted, swept
from tests.diagnosis.plants import MOVING, NOISE, STILL, TRUTH, clock, fitted, measured

module = importlib.import_module("piezo_opt.diagnosis.forces")
SHORT = clock(400, 2000.0)
COARSE = po.SingleShooting(refine=False)


def by_place(found: tuple[Force, ...]) -> dict[Place, Force]:
    return {force.place: force for force in found}


def initial_of(fit: po.Fit, record: po.Measurement) -> po.Initial:
    periodic = fit.question.start_of(record) is po.Start.PERIODIC
    return po.Initial.PERIODIC if periodic else po.Initial.REST


def simulated(chain: Entering, place: Place, w: np.ndarray) -> np.ndarray:
    """The answer to w from the compiled core's own sensitivities."""
    fit, parts = chain.fit, []
    unknown = unknowns(fit.question, fit.values)
    theta = theta_of(unknown, fit.values)
    falling, rising = _channels(place)
    for index, own in enumerate(chain.split(w)):
        record = fit.records[index]
        values = {
            **unknown.of_record(index, theta),
            "correction.at_start": 0.0,
            "correction.at_end": 0.0,
        }
        simulator = Simulator(
            fit.model + _probe(place),
            record.with_(channels={falling: own, rising: 0.0 * own}),
            values,
            directions=("correction.at_start",),
            initial=initial_of(fit, record),
            runtime=fit.question.free,
            substeps=fit.accuracy[index].substeps,
        )
        parts.append(simulator.with_sensitivities(values)[1][record.counted, 0])
    return np.concatenate(parts)


def cases() -> dict[str, po.Fit]:
    plain = measured(MOVING, SHORT, swept(SHORT))
    late = plain.with_(startup=0.02)
    held = plain.with_(between=po.Between.HELD)
    uneven = np.sort(np.random.default_rng(3).choice(SHORT, 300, replace=False))
    lagging = {**TRUTH, "amplifier_lag.share": 0.5, "amplifier_lag.tau": 2e-3}
    return {
        "plain": fitted(MOVING, plain),
        "startup": fitted(MOVING, late),
        "held": fitted(MOVING, held),
        "quasi-static": fitted(STILL, measured(STILL, SHORT, swept(SHORT))),
        "uneven": fitted(MOVING, measured(MOVING, uneven, swept(uneven))),
        "two records": po.solve(
            po.Identification(MOVING, [plain.rename("a"), late.rename("b")]), start=TRUTH
        ),
        "line": po.solve(po.Identification(AmplifierLag() + MOVING, plain), start=lagging),
        "compared": po.solve(
            po.Identification(AmplifierLag() + MOVING, held), start=lagging, transcription=COARSE
        ),
    }


CASES = ("plain", "startup", "held", "quasi-static", "uneven", "two records", "line", "compared")


@pytest.mark.parametrize("name", CASES)
def test_answers_are_those_of_the_compiled_core_and_their_transpose(name: str) -> None:
    chain = Entering(cases()[name])
    # A model that is only compared moves what is linear by its exponential.
    assert chain.fit.accuracy[0].substeps.exact == (name == "compared")
    random = np.random.default_rng(0)
    n = sum(chain.lengths)
    w = np.cumsum(random.normal(size=n))
    # Nothing before the start is moved by a correction: it begins at 0 in every record.
    w = np.concatenate([part - part[0] for part in chain.split(w)])
    rows = random.normal(size=chain.residual.size)
    for place in chain.places:
        answer = chain.answers(place, w[:, None])[:, 0]
        expected = simulated(chain, place, w)
        assert np.abs(expected).max() > 0.0
        np.testing.assert_allclose(answer, expected, atol=1e-9 * np.abs(expected).max())
        back = chain.back(place, rows)
        assert rows @ answer == pytest.approx(back @ w, rel=1e-9)


def test_a_delayed_chain_answers_later() -> None:
    record = measured(MOVING, SHORT, swept(SHORT), (Delay(), {"T": 4e-3}))
    fit = po.solve(po.Identification(Delay() + MOVING, record), start={**TRUTH, "delay.T": 4e-3})
    chain = Entering(fit)
    w = np.interp(SHORT, [0.0, 0.1, 0.105, 0.11, 0.2], [0.0, 0.0, 1.0, 0.0, 0.0])
    answer = chain.answers(Place.STRAIN, w[:, None])[:, 0]
    drive, delayed = (
        Entering(fitted(MOVING, measured(MOVING, SHORT, swept(SHORT)))), chain.fit.values["delay.T"]
    )  # fmt: skip
    prompt = drive.answers(Place.STRAIN, w[:, None])[:, 0]
    # A correction lives on the chain's own clock, so that it enters beside what it corrects.
    assert delayed == pytest.approx(4e-3, rel=0.1)
    assert np.argmax(np.abs(answer)) - np.argmax(np.abs(prompt)) in (0, 1)


def test_a_periodic_start_that_follows_is_left_free() -> None:
    t = clock(800, 2000.0)
    wave = 30.0 - 30.0 * np.cos(2.0 * np.pi * 10.0 * t)
    record = measured(MOVING, t, wave).with_(period=0.1, startup=0.1)
    chain = Entering(fitted(MOVING, record))
    assert initial_of(chain.fit, chain.fit.records[0]) is po.Initial.PERIODIC
    w = np.sin(2.0 * np.pi * 20.0 * t)
    for place in (Place.STRAIN, Place.MOTION):
        expected = chain.project(simulated(chain, place, w))
        answer = chain.project(chain.answers(place, w[:, None])[:, 0])
        np.testing.assert_allclose(answer, expected, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("name", "place", "against", "least"),
    [
        ("drag", Place.MOTION, "x'", True),
        ("drive wave", Place.STRAIN, "v", True),
        ("input wave", Place.INPUT, "v", False),
        # A loop forgets, so that to correct its rate always costs more than to correct its sum.
        ("loop wave", Place.LOOP, "v, times v'", False),
    ],
)
def test_a_planted_force_is_found(name: str, place: Place, against: str, least: bool) -> None:
    fit = planted(name)
    assert fit.rms > 1.3 * NOISE
    found = forces(fit, FLOOR, entering=entering(name))
    best = found[0]
    assert best.place is place
    assert str(best.against[0]) == against
    assert best.described > 0.9
    # It brings the residual to the noise, and not below: the discrepancy principle.
    assert best.rms_after == pytest.approx(NOISE, rel=1e-6)
    # Every place could explain it; this one, or its twin, needs the least.
    assert (best.relative < 1.05 * min(f.relative for f in found)) is least


def test_two_places_are_asked_at_a_time_and_answer_as_one_after_the_other(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fit, chain = planted("drag"), entering("drag")
    alone = forces(fit, FLOOR, entering=chain)
    both = threading.Barrier(2)
    plain = module._smallest

    def met(*given: Any) -> Any:
        with suppress(threading.BrokenBarrierError):
            both.wait(10.0)
            seen.append(threading.get_ident())
        return plain(*given)

    seen: list[int] = []
    monkeypatch.setattr(module, "_smallest", met)
    found = forces(fit, FLOOR, entering=chain, threads=2)
    assert len(set(seen)) == 2
    assert [f.place for f in found] == [f.place for f in alone]
    for one, other in zip(found, alone, strict=True):
        assert one.against == other.against
        assert one.rms == other.rms


def test_the_correction_does_what_the_planted_force_does() -> None:
    chain = entering("drag")
    (force,) = forces(planted("drag"), FLOOR, places=[Place.MOTION], entering=chain)
    rate = force.signals[Quantity.VELOCITY][0]
    planted_force = -2e4 * np.abs(rate) * rate
    true, found = (
        chain.project(chain.answers(Place.MOTION, w[:, None])[:, 0])
        for w in (planted_force, force.correction[0])
    )
    # It also follows a little of the noise, which is nearly as large as what it explains.
    assert np.corrcoef(found, true)[0, 1] > 0.93
    # The smallest correction is smaller than the truth, which had no reason to be small.
    assert 0.8 < float(found @ true) / float(true @ true) < 1.0
    assert force.rms < float(np.sqrt(np.mean(planted_force**2)))


def test_what_is_noise_needs_no_correction() -> None:
    fit = planted("noise")
    for force in forces(fit, FLOOR, entering=entering("noise")):
        assert force.rms == force.share == force.described == 0.0
    assert unexplained(fit, FLOOR) is None


def test_an_input_that_nobody_recorded_is_a_function_of_nothing() -> None:
    t = clock(4000, 2000.0)
    random = np.random.default_rng(5)
    unseen = np.convolve(random.normal(size=t.size), np.hanning(40), "same")
    unseen *= 4.0 * NOISE / float(np.std(unseen))
    noise = unseen + NOISE * random.normal(size=t.size)
    fit = fitted(MOVING, measured(MOVING, t, swept(t), noise=noise))
    left = unexplained(fit, FLOOR)
    assert left is not None
    assert left.against is None
    assert left.formula is None
    assert left.share < 0.2
    assert "not recorded" in str(left)


def test_a_single_event_is_a_function_of_nothing() -> None:
    """Stretches without it do not predict it, whatever signal happened to be special then."""
    t = clock(4000, 2000.0)
    event = 60.0 * NOISE * np.exp(-(((t - 1.13) / 0.01) ** 2))
    noise = event + NOISE * np.random.default_rng(7).normal(size=t.size)
    left = unexplained(fitted(MOVING, measured(MOVING, t, swept(t), noise=noise)), FLOOR)
    assert left is not None
    assert left.against is None


def test_what_repeats_with_the_position_is_a_wave_of_the_output() -> None:
    """Fringes are too fine for a function with a few knots; their period is found first."""
    t = clock(4000, 2000.0)
    clean = measured(MOVING, t, swept(t), noise=np.zeros(t.size))
    period = float(np.ptp(clean.position)) / 21.3
    fringes = 5.0 * NOISE * np.cos(2.0 * np.pi * clean.position / period)
    noise = NOISE * np.random.default_rng(8).normal(size=t.size)
    fit = fitted(MOVING, clean.with_(position=clean.position + fringes + noise))
    said = structure(fit, FLOOR)
    assert any("repeats with the position" in clue for clue in said.clues)
    left = unexplained(fit, FLOOR)
    assert left is not None
    assert left.place is Place.OUTPUT
    assert left.against == "x"
    assert left.share > 0.95
    assert left.formula is not None
    waves = {f for term in left.formula.terms for f in term.factors}
    assert {wave.quantity for wave in waves} == {Quantity.POSITION}
    assert [2.0 * np.pi * w.scale for w in waves] == pytest.approx(len(waves) * [period], rel=0.1)
    richer = po.solve(fit.question.with_model(fit.model + left.formula.as_effect()), start=fit)
    assert fit.rms > 3.5 * NOISE
    assert richer.rms < 1.1 * NOISE


def test_strain_and_motion_are_told_to_be_twins() -> None:
    left = unexplained(planted("drag"), FLOOR)
    assert left is not None
    # Behind one resonance a force is omega^2 times a strain: no record can split them.
    assert set(left.places) >= {Place.MOTION, Place.STRAIN}
    assert Place.OUTPUT not in left.places
    found = by_place(left.forces)
    omega = planted("drag").values["second_order.omega"]
    ratio = found[Place.MOTION].rms / found[Place.STRAIN].rms
    assert ratio == pytest.approx(omega**2, rel=1e-3)


def test_a_place_that_explains_less_is_no_twin() -> None:
    """A ripple of the input goes through the loop and a ripple of the strain does not."""
    left = unexplained(planted("input wave"), FLOOR)
    assert left is not None
    assert left.places == (Place.INPUT,)
    strain = by_place(left.forces)[Place.STRAIN]
    assert 0.9 < strain.described < left.share


def test_a_place_that_the_model_lacks_is_refused() -> None:
    fit = fitted(STILL, measured(STILL, SHORT, swept(SHORT)))
    with pytest.raises(po.InputError, match="no motion balance that a correction could enter"):
        forces(fit, FLOOR, places=[Place.MOTION])
    loopless = po.solve(po.Identification(PiezoGain() + Offset(), fit.records[0]))
    assert Place.LOOP not in Entering(loopless).places
    assert Place.LOOP in Entering(po.solve(fit.question)).places
    assert BoucWen().name in fit.model


def test_hats_of_a_signal_sum_to_one() -> None:
    signal = np.random.default_rng(1).gamma(1.0, size=500)
    hats = pieces(signal)
    np.testing.assert_allclose(hats.sum(axis=1), 1.0)
    assert (hats.max(axis=0) > 0.0).all()


def test_cost_is_linear_in_the_samples() -> None:
    def spent(samples: int) -> float:
        fit = planted("drag", samples)
        forces(fit, FLOOR)  # builds the functions
        begin = time.process_time()
        forces(fit, FLOOR)
        return time.process_time() - begin

    # Sixteen times the samples: a quadratic method would take 256 times as long.
    assert spent(32_000) < 64.0 * spent(2_000)
