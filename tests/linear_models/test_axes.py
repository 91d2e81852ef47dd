"""Several drives and axes: known stages come back, and errors are those of unseen records."""

from __future__ import annotations

import json
from pathlib import Path

import control
import numpy as np
import pytest
from click.testing import CliRunner, Result

import piezo_opt as po
from piezo_opt.cli import app
from piezo_opt.datasets import path
from piezo_opt.errors import InputError
from piezo_opt.linear_models import ModalModel, fit_modes, response_matrix
from piezo_opt.measurement import AxesCampaign, AxesRecord
from tests.linear_models import stages
from tests.linear_models.stages import campaign, realisation


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["axes", *[str(one) for one in arguments]])


def test_a_response_matrix_is_found_line_by_line() -> None:
    found = response_matrix(campaign(3))
    truth = stages.response(found.frequency)
    assert np.abs(found.response - truth).max() < 1e-10 * np.abs(truth).max()
    assert found.shares()[0].max() < 1e-10
    assert found.amplitude == pytest.approx([1.0, 1.0])


def test_noise_and_distortion_are_told_apart() -> None:
    noisy = response_matrix(campaign(6, noise=2e-9))
    error = np.abs(noisy.response - stages.response(noisy.frequency))
    rms = np.sqrt(np.mean(error**2))
    assert rms == pytest.approx(np.sqrt(np.mean(noisy.noise**2)), rel=0.1)
    assert rms == pytest.approx(np.sqrt(np.mean(noisy.total**2)), rel=0.1)
    # White noise of N samples and P periods: lines of variance 4 sigma^2 / (N P).
    expected = 2e-9 * np.sqrt(4.0 / (stages.SAMPLES * 2))
    assert np.sqrt(np.mean(noisy.noise_of_reading**2)) == pytest.approx(expected, rel=0.1)
    bent = response_matrix(campaign(6, noise=2e-9, cube=2e-3))
    assert bent.shares()[0].min() > 5.0 * bent.shares()[1].max()
    assert noisy.shares()[0].max() < 2.0 * noisy.shares()[1].max()


def test_known_poles_delay_and_shapes_come_back() -> None:
    model = fit_modes(campaign(3), 3, real=1).model
    assert model.frequencies[0] == pytest.approx(stages.HERTZ, rel=1e-6)
    assert model.damping[0] == pytest.approx(stages.ZETA, rel=1e-6)
    assert model.rates == pytest.approx([stages.RATE_OF_CREEP], rel=1e-5)
    frequency = np.linspace(0.0, 900.0, 1001)
    truth = stages.response(frequency)
    assert np.abs(model.response(frequency) - truth).max() < 1e-9 * np.abs(truth).max()
    # A delay and a velocity of every mode are nearly the same, so either is known less well.
    assert model.delay == pytest.approx(stages.DELAY, rel=2e-3)
    assert model.residues[1:-1:2] == pytest.approx(stages.SHAPES, rel=1e-4)
    assert str(model).count("\n") == 4


def test_what_depends_on_amplitude_is_tabled() -> None:
    weak = campaign(3, amplitude=1.0)
    strong = campaign(3, amplitude=2.0, softer=0.01, gain=1.1, lag=2e-5)
    # The middle of two is the stronger one: gains are relative to it.
    model = fit_modes(AxesCampaign((*weak.records, *strong.records)), 3, real=1).model
    assert model.amplitudes == pytest.approx([1.0, 2.0])
    assert model.frequencies[0] == pytest.approx(stages.HERTZ, rel=1e-5)
    assert model.frequencies[1] == pytest.approx(0.99 * stages.HERTZ, rel=1e-5)
    assert model.gains[0] == pytest.approx([1.0, 1.0 / 1.1], rel=1e-5)
    assert model.lags == pytest.approx(np.array([[0.0, -2e-5], [0.0, 0.0]]), abs=3e-7)
    between = realisation(9, amplitude=1.5, softer=0.005, gain=1.05, lag=1e-5)
    error = po.axes_error(model, between).levels[0]
    assert error.mean < 5e-3  # straight lines between the amplitudes
    pooled = fit_modes((*weak, *strong), 3, real=1, pooled=True).model
    assert po.axes_error(pooled, between).levels[0].mean > 5.0 * error.mean


def test_errors_are_those_of_the_stated_norm() -> None:
    model = fit_modes(campaign(3), 3, real=1).model
    record = realisation(5, noise=3e-9)
    level = po.axes_error(model, record).levels[0]
    y = record.positions.reshape(2, stages.SAMPLES, 2)
    each = np.mean(3e-9 / y.std(axis=1), axis=0)
    assert level.axes == pytest.approx(each, rel=0.03)
    assert level.mean == pytest.approx(float(each.mean()), rel=0.03)
    assert level.total == pytest.approx(
        3e-9 * np.sqrt(2 / y.var(axis=1).mean(axis=0).sum()), rel=0.03
    )


def test_a_record_from_rest_is_simulated() -> None:
    model = fit_modes(campaign(3), 3, real=1).model
    fine = 40
    t = np.arange(600 * fine) / (fine * stages.RATE)
    pulse = np.where(t < 0.1, np.sin(np.pi * t / 0.1) ** 4, 0.0)
    drives = np.stack([pulse, -0.5 * pulse], axis=1)
    s = control.tf("s")
    total = np.zeros((t.size, 2))
    for a, d in np.ndindex(2, 2):
        plant = stages.CREEP[a, d] * stages.RATE_OF_CREEP / (s + stages.RATE_OF_CREEP)
        for hertz, zeta, shape in zip(stages.HERTZ, stages.ZETA, stages.SHAPES, strict=True):
            w = 2.0 * np.pi * hertz
            plant = plant + shape[a, d] * w**2 / (s**2 + 2 * zeta * w * s + w**2)
        late = np.interp(t - stages.DELAY, t, drives[:, d], left=0.0)
        total[:, a] += control.forced_response(plant, t, late).outputs
    record = AxesRecord(drives[::fine], total[::fine], stages.RATE, name="pulse")
    assert po.axes_error(model, record).levels[0].mean < 1e-4


def test_a_model_survives_its_file(tmp_path: Path) -> None:
    model = fit_modes(campaign(3), 3, real=1).model
    file = tmp_path / "model.json"
    file.write_text(json.dumps(model.to_dict()))
    again = po.read_axes_model(file)
    assert again.simulate(realisation(4)) == pytest.approx(
        model.simulate(realisation(4)), rel=1e-12
    )


@pytest.fixture
def mirror() -> AxesCampaign:
    """The fine steering mirror to 1100 Hz at two amplitudes: a third of its lines and modes."""
    kept = 2816

    def thinned(signal: np.ndarray) -> np.ndarray:
        lines = np.fft.rfft(signal.reshape(2, 8192, 3), axis=1)[:, : kept // 2 + 1]
        lines[:, -1] = 0.0
        return np.fft.irfft(lines * (kept / 8192), n=kept, axis=1).reshape(-1, 3)

    return AxesCampaign(
        tuple(
            AxesRecord(thinned(one.drives), thinned(one.positions), 2200.0, kept, one.name)
            for one in po.read_axes(path("cubespec-fsm/train.h5"))
            if not one.name.startswith("200")
        )
    )


def test_the_mirror_below_1100_hz(mirror: AxesCampaign) -> None:
    found = po.identify_axes(mirror, 5, real=1, held_out=2)
    errors = dict(found.errors)
    one = [level.mean for level in errors["one model, amplitude-dependent"].levels]
    each = [level.mean for level in errors["linear, one for each amplitude"].levels]
    pooled = [level.mean for level in errors["linear, one for all amplitudes"].levels]
    # Distortion and noise alone are 4.9 and 3.5 %; a linear model for both is far worse.
    assert max(one) < 0.055
    assert max(each) < 0.055
    assert min(pooled) > 0.10
    names = {record.name for record in found.test or ()}
    assert names == {"100mV 5", "100mV 6", "300mV 5", "300mV 6"}
    # Every strong mode softens with the amplitude.
    strong = np.argsort(found.model.strength)[-4:]
    assert np.all(found.model.frequencies[1, strong] < found.model.frequencies[0, strong])
    assert "no fit has seen" in str(found)


def test_the_commands(tmp_path: Path) -> None:
    for what, amplitude, softer in (("weak", 1.0, 0.0), ("strong", 2.0, 0.01)):
        several = campaign(4, amplitude=amplitude, softer=softer, noise=1e-9)
        for letter, signals in (
            ("u", [one.drives for one in several]), ("y", [one.positions for one in several])
        ):  # fmt: skip
            array = np.stack([one.reshape(2, stages.SAMPLES, 2) for one in signals])
            np.save(tmp_path / f"{letter}_{what}.npy", array.transpose(2, 3, 0, 1))
    model, page = tmp_path / "model.json", tmp_path / "page.html"
    done = run(
        "fit", tmp_path, "--rate", "2 kHz", "--modes", "2-4", "--real", 1, "--held-out", 1,
        "--no-compare", "--json", model, "--report", page,
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    told = json.loads(model.read_text())
    assert told["schema"] == "piezo_opt.axes/1"
    assert [row["modes"] for row in told["search"]] == [2, 3, 4]
    assert len(told["model"]["frequencies"][0]) == 3
    assert told["errors"][0]["levels"][0]["mean"] < 0.02
    assert page.read_text().count("<svg") >= 5
    done = run(
        "simulate", model, tmp_path / "u_weak.npy", tmp_path / "y_weak.npy", "--rate", "2 kHz",
        "--json", tmp_path / "error.json", "--out", tmp_path / "y.npz",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    error = json.loads((tmp_path / "error.json").read_text())
    assert error["levels"][0]["records"] == ["weak 1", "weak 2", "weak 3", "weak 4"]
    assert error["levels"][0]["mean"] < 0.02
    with np.load(tmp_path / "y.npz") as arrays:
        assert arrays["weak 3"].shape == (2 * stages.SAMPLES, 2)
    done = run(
        "response", tmp_path / "u_weak.npy", "--rate", "2 kHz", "--json", tmp_path / "r.json"
    )
    assert done.exit_code == 0, done.output
    assert "2 drives" in done.stdout
    (tmp_path / "other.json").write_text('{"schema": "piezo_opt.fit/1"}')
    for arguments, words in (
        (("fit", tmp_path / "u_weak.npy"), "no sampling rate"),
        (("fit", tmp_path / "u_none.npy", "--rate", "2 kHz"), "no such file"),
        (("fit", tmp_path, "--rate", "2 kHz", "--held-out", 4), "cannot be held out"),
        (("fit", tmp_path, "--rate", "2 kHz", "--held-out", 3), "tell 2 drives apart"),
        (("fit", tmp_path, "--rate", "2 kHz", "--modes", "300"), "fewer modes"),
        (("fit", tmp_path, "--rate", "2 kHz", "--held-out", 0, "--modes", "2-3"), "none are held"),
        (("simulate", page, tmp_path, "--rate", "2 kHz"), "is no JSON"),
        (("simulate", tmp_path / "other.json", tmp_path, "--rate", "2 kHz"), "no modal model"),
        (("simulate", model, path("cubespec-fsm/train.h5")), "3 drives"),
        (("simulate", model, tmp_path, "--rate", "2 kHz", "--out", tmp_path / "y.csv"), ".npz"),
    ):
        failed = run(*arguments)
        assert failed.exit_code == 2, (arguments, failed.output)
        assert len(failed.stderr.strip().splitlines()) == 1
        assert words in failed.stderr


def test_drives_that_move_together_are_refused() -> None:
    with pytest.raises(InputError, match="cannot be told apart"):
        response_matrix([realisation(k, together=True) for k in range(3)])


def test_a_table_is_a_record(tmp_path: Path) -> None:
    record = realisation(1)
    rows = np.column_stack(
        [np.arange(len(record)) / stages.RATE, record.drives, 1e6 * record.positions]
    )
    file = tmp_path / "stage.csv"
    np.savetxt(file, rows, delimiter=",", header="t [s],u1 [V],u2 [V],y1 [um],y2 [um]", comments="")
    (found,) = po.read_axes(file, period="1 s")
    assert found.period == stages.SAMPLES
    assert found.drives == pytest.approx(record.drives)
    assert found.positions == pytest.approx(record.positions)
    assert found.rate == pytest.approx(stages.RATE)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"rate": 0.0}, "sampling rate"),
        ({"period": 5}, "period of 5 samples"),
        ({"positions": np.zeros((10, 2))}, "same number"),
        ({"drives": np.full((4000, 2), np.nan)}, "channel 1, sample 1"),
    ],
)
def test_a_wrong_record_is_refused(changes: dict[str, object], words: str) -> None:
    whole = realisation(1)
    given = {"drives": whole.drives, "positions": whole.positions, "rate": whole.rate} | changes
    with pytest.raises(InputError, match=words):
        AxesRecord(**given)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("said", "modes", "label", "levels"),
    [
        ("search: 3 modes, iteration 1", (2, 3), "linear, one for each amplitude", 1),
        ("amplitude-dependent: 3 modes, iteration 2", 3, "one model, amplitude-dependent", 2),
        ("all records: 3 modes, iteration 1,", 3, "one model, amplitude-dependent", 2),
        ("each amplitude: 3 modes, iteration 1,", 3, "one model, amplitude-dependent", 2),
    ],
)
def test_ctrl_c_gives_the_best_so_far(
    said: str, modes: int | tuple[int, ...], label: str, levels: int
) -> None:
    def impatient(sentence: str) -> None:
        if said in sentence:
            raise KeyboardInterrupt

    records = (*campaign(4, noise=1e-9), *campaign(4, amplitude=2.0, noise=1e-9, softer=0.01))
    found = po.identify_axes(records, modes, real=1, held_out=1, progress=impatient)
    assert found.interrupted
    ((told, error),) = found.errors
    assert told == label
    assert len(error.levels) == levels
    assert max(one.mean for one in error.levels) < 0.5
    assert str(found).endswith("Interrupted: this is the best so far.")


def test_only_a_whole_model_is_one() -> None:
    data = fit_modes(campaign(3), 2, real=1).model.to_dict()
    for changed, words in (
        ({"damping": [[-0.1, 0.1]]}, "decays"),
        ({"lags": [[0.0]]}, "lags"),
        ({"schema": "piezo_opt.fit/1"}, "no modal model"),
    ):
        with pytest.raises(InputError, match=words):
            ModalModel.from_dict(data | changed)
