"""The shipped records are the ones their datasheets describe."""

import hashlib
from pathlib import Path

import numpy as np
import pytest

from piezo_opt import datasets
from piezo_opt.errors import InputError
from piezo_opt.measurement import Between

DATA = Path(__file__).parents[1] / "data"
FOLDERS = ("thesis", "flexure-stage", "cubespec-fsm")


@pytest.mark.parametrize("folder", FOLDERS)
def test_checksums_cover_every_file(folder: str) -> None:
    lines = (DATA / folder / "SHA256SUMS").read_text(encoding="utf-8").split("\n")
    sums = {line.split()[1]: line.split()[0] for line in lines if line}
    files = {file.name for file in (DATA / folder).iterdir()} - {"SHA256SUMS"}
    assert set(sums) == files
    assert "README.md" in files
    for name, digest in sums.items():
        assert hashlib.sha256((DATA / folder / name).read_bytes()).hexdigest() == digest, name


def test_the_data_stay_small() -> None:
    assert sum(file.stat().st_size for file in DATA.glob("*/*")) < 15e6


def test_every_folder_has_its_checksums() -> None:
    assert {folder.name for folder in DATA.iterdir() if folder.is_dir()} == set(FOLDERS)


def test_the_thesis_loop() -> None:
    record = datasets.load("thesis/hysteresis")
    np.testing.assert_array_equal(record.time, np.arange(51.0))
    np.testing.assert_array_equal(record.drive, np.r_[0:126:5, 120:-1:-5])
    assert record.position[25] == pytest.approx(14.664e-6)
    assert record.position[-1] == pytest.approx(2.296e-6)
    # The area between the loop and the straight line to its tip is 67.0 um s (thesis: 67.73).
    line = record.drive * record.position[25] / record.drive[25]
    assert np.trapezoid(np.abs(record.position - line), record.time) == pytest.approx(
        67.0e-6, rel=0.01
    )


def test_the_thesis_vibration_keeps_its_gaps() -> None:
    record = datasets.load("thesis/vibration")
    assert len(record) == 150
    assert len(record.gaps) == 9
    assert record.between is Between.HELD
    # The square wave has one phase through all the gaps.
    high = np.floor(record.time * 2 + 1e-9) % 2 == 1
    np.testing.assert_array_equal(record.drive, np.where(high, 63.05, 0.063))


def test_the_thesis_finite_elements_are_a_line() -> None:
    record = datasets.load("thesis/fe")
    assert len(record) == 41
    assert record.step == pytest.approx(0.1)
    np.testing.assert_allclose(record.position, record.drive * 4.33728e-7 / 150, atol=1e-12)


def test_the_flexure_stage() -> None:
    record = datasets.load("flexure-stage")
    assert len(record) == 8027
    assert record.rate == pytest.approx(200.0)
    np.testing.assert_allclose(record.drive, 1.8 + 1.8 * np.sin(2 * np.pi * record.time), atol=1e-6)
    assert record.position[0] == pytest.approx(-123.059139e-6)
    assert record.position[-1] == pytest.approx(-82.099966e-6)
    assert np.polyfit(record.drive, record.position, 1)[0] == pytest.approx(12.4e-6, rel=0.01)


class TestSteeringMirror:
    def test_raw_records(self) -> None:
        campaign = datasets.load_campaign("cubespec-fsm", level="200mV", single_input=False)
        assert campaign.names == tuple(f"200mV-{one}" for one in range(1, 7))
        record = campaign.records[0]
        assert (len(record), record.periods) == (16384, 2)
        assert record.between is Between.BANDLIMITED
        assert record.period == 1.28
        assert record.drive.std() == pytest.approx(0.198, rel=0.005)
        assert set(record.channels) == {"voltage_2", "voltage_3"}
        assert record.noise_from_periods() < 0.02 * record.position.std()

    def test_levels_and_channels_differ(self) -> None:
        first = datasets.load_campaign("cubespec-fsm", level="100mV", single_input=False)
        third = datasets.load_campaign(
            "cubespec-fsm", level="100mV", drive=3, displacement=2, single_input=False
        )
        np.testing.assert_array_equal(
            first.records[0].channels["voltage_3"], third.records[0].drive
        )
        assert first.records[0].drive.std() == pytest.approx(0.099, rel=0.005)

    def test_one_input_explains_what_is_left(self) -> None:
        """The best linear answer to voltage 1 leaves 8.2 % of the separated reading."""
        for single_input, low, high in ((True, 0.075, 0.09), (False, 0.85, 0.95)):
            campaign = datasets.load_campaign(
                "cubespec-fsm", level="100mV", single_input=single_input
            )
            lines = slice(1, 3839)
            drive = np.stack([np.fft.rfft(r.drive[:8192])[lines] for r in campaign])
            reading = np.stack(
                [np.fft.rfft(r.repeated_periods().mean(axis=0))[lines] for r in campaign]
            )
            gain = (drive.conj() * reading).sum(0) / (np.abs(drive) ** 2).sum(0)
            left = np.linalg.norm(reading - gain * drive) / np.linalg.norm(reading)
            assert low < left < high

    def test_unknown_choices_say_what_there_is(self) -> None:
        with pytest.raises(InputError, match="100mV, 200mV, 300mV"):
            datasets.load_campaign("cubespec-fsm", level="50mV")
        with pytest.raises(InputError, match="1 to 3"):
            datasets.load_campaign("cubespec-fsm", level="100mV", drive=4)
        with pytest.raises(InputError, match="cubespec-fsm"):
            datasets.load_campaign("cubespec", level="100mV")


def test_unknown_names_say_what_there_is() -> None:
    with pytest.raises(InputError, match="thesis/hysteresis, thesis/vibration"):
        datasets.load("thesis/loop")
    with pytest.raises(InputError, match="load_campaign"):
        datasets.load("cubespec-fsm")
    for name in ("thesis/loop.csv", "../pyproject.toml", "", "/etc/passwd"):
        with pytest.raises(InputError, match=r"no data file.*thesis/hysteresis\.csv"):
            datasets.path(name)


def test_an_installed_package_has_the_thesis_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "piezo_opt"
    (package / "_data" / "thesis").mkdir(parents=True)
    shipped = package / "_data" / "thesis" / "hysteresis.csv"
    shipped.write_bytes((DATA / "thesis" / "hysteresis.csv").read_bytes())
    # Somebody else's folder of that name beside the installed package is not ours.
    (tmp_path / "data" / "flexure-stage").mkdir(parents=True)
    (tmp_path / "data" / "flexure-stage" / "record.h5").write_bytes(b"not ours")
    monkeypatch.setattr(datasets, "_PACKAGE", package)
    assert datasets.path("thesis/hysteresis.csv") == shipped
    assert len(datasets.load("thesis/hysteresis")) == 51
    with pytest.raises(InputError, match=r"not part of the installed package.*clone"):
        datasets.load("flexure-stage")
