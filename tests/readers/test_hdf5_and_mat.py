"""HDF5 without loss, MATLAB files of both kinds, and damaged ones of either."""

import contextlib
from pathlib import Path
from typing import Any, ClassVar

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from scipy import io, sparse

from piezo_opt import files
from piezo_opt.errors import InputError
from piezo_opt.measurement import Between, Campaign, Measurement
from piezo_opt.readers import read, read_campaign, write

T = np.arange(200) / 100
U = 50 * np.sin(2 * np.pi * T)
Y = 8 * np.sin(2 * np.pi * T - 0.1)


def record(**changes: Any) -> Measurement:
    fields: dict[str, Any] = {
        "time": T,
        "drive": U,
        "position": Y * 1e-6,
        "channels": {"temperature": 293 + T, "a/b [µ]": T},
        "channel_units": {"temperature": "K"},
        "name": "run 1/2 – größer",
        "between": Between.BANDLIMITED,
        "period": 1.0,
        "startup": 0.1,
        "source": "bench\nleft",
        "allow_saturated": True,
    }
    return Measurement(**(fields | changes))


def assert_same(one: Measurement, other: Measurement) -> None:
    for name in ("time", "drive", "position"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert list(one.channels) == list(other.channels)
    for name, values in one.channels.items():
        np.testing.assert_array_equal(values, other.channels[name])
    assert dict(one.channel_units) == dict(other.channel_units)
    for name in ("name", "drive_unit", "position_unit", "between", "period", "startup"):
        assert getattr(one, name) == getattr(other, name)
    assert one.source == other.source
    assert one.allow_saturated == other.allow_saturated


class TestHdf5:
    @pytest.mark.parametrize("suffix", ["h5", "hdf5"])
    def test_round_trip_keeps_every_bit_and_word(self, tmp_path: Path, suffix: str) -> None:
        file = tmp_path / f"a.{suffix}"
        write(record(), file)
        assert_same(read(file), record())

    def test_round_trip_of_no_period_and_odd_units(self, tmp_path: Path) -> None:
        other = record(period=None, drive_unit="N", position_unit="rad", channels={})
        write(other, tmp_path / "a.h5")
        assert_same(read(tmp_path / "a.h5"), other)

    @settings(max_examples=20, deadline=None)
    @given(
        values=arrays.arrays(np.float64, 12, elements=st.floats(-1e90, 1e90), unique=True),
        name=st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0")),
    )
    def test_round_trip_of_any_numbers_and_name(
        self, tmp_path_factory: pytest.TempPathFactory, values: np.ndarray, name: str
    ) -> None:
        one = Measurement(np.arange(12) / 7, values, values[::-1], name=name, allow_saturated=True)
        file = tmp_path_factory.getbasetemp() / "any.h5"
        write(one, file, overwrite=True)
        assert_same(read(file), one)

    def test_a_long_source_and_an_empty_name(self, tmp_path: Path) -> None:
        one = record(source="é" * 70_000, name="")
        write(one, tmp_path / "a.h5")
        assert_same(read(tmp_path / "a.h5"), one)

    def test_several_records(self, tmp_path: Path) -> None:
        campaign = Campaign.of([record(name=name) for name in ("b", "a", "c")])
        write(campaign, tmp_path / "all.h5")
        back = read_campaign(tmp_path / "all.h5")
        assert back.names == ("b", "a", "c")
        assert_same(read(tmp_path / "all.h5", record="a"), campaign["a"])
        with pytest.raises(InputError, match=r"holds 3 records.*b, a, c"):
            read(tmp_path / "all.h5")
        with pytest.raises(InputError, match="no record 'd'"):
            read(tmp_path / "all.h5", record="d")

    def test_the_caller_may_say_more(self, tmp_path: Path) -> None:
        write(record(), tmp_path / "a.h5")
        changed = read(tmp_path / "a.h5", between=Between.LINEAR, startup="0.5 s", period="2 s")
        assert (changed.between, changed.startup, changed.period) == (Between.LINEAR, 0.5, 2.0)
        with pytest.raises(InputError, match="columns are time, drive and position already"):
            read(tmp_path / "a.h5", drive="u [V]")

    def test_a_foreign_file_with_units(self, tmp_path: Path) -> None:
        with h5py.File(tmp_path / "a.h5", "w") as content:
            for name, values, unit in (("t", T, "s"), ("run/u", U, "V"), ("run/y", Y, "um")):
                content[name] = values
                content[name].attrs["units"] = unit
            content["note"] = "text"
        with pytest.raises(InputError, match="'t"):
            read(tmp_path / "a.h5", drive="u")
        one = read(tmp_path / "a.h5")
        np.testing.assert_allclose(one.position, Y * 1e-6, rtol=1e-12)

    def test_an_existing_file_is_not_overwritten(self, tmp_path: Path) -> None:
        write(record(), tmp_path / "a.h5")
        before = (tmp_path / "a.h5").read_bytes()
        with pytest.raises(InputError, match="exists already"):
            write(record(name="other"), tmp_path / "a.h5")
        assert (tmp_path / "a.h5").read_bytes() == before
        assert [one.name for one in tmp_path.iterdir()] == ["a.h5"]

    def test_text_that_cannot_be_stored(self, tmp_path: Path) -> None:
        for text in ("a\0b", "\ud800"):
            with pytest.raises(InputError, match="cannot be stored"):
                write(record(source=text), tmp_path / "a.h5")

    @pytest.mark.parametrize("part", [0.0, 0.01, 0.3, 0.7, 0.95])
    def test_cut_short(self, tmp_path: Path, part: float) -> None:
        write(record(), tmp_path / "a.h5")
        whole = (tmp_path / "a.h5").read_bytes()
        (tmp_path / "a.h5").write_bytes(whole[: max(4, int(part * len(whole)))])
        with pytest.raises(InputError, match=r"a\.h5: is not a whole HDF5 file.*again"):
            read(tmp_path / "a.h5")

    def test_a_flipped_bit_in_the_data_is_noticed(self, tmp_path: Path) -> None:
        noise = np.random.default_rng(0).normal(size=5000)
        write(Measurement(np.arange(5000.0), noise, noise), tmp_path / "a.h5")
        content = bytearray((tmp_path / "a.h5").read_bytes())
        with h5py.File(tmp_path / "a.h5") as stored:
            chunk = stored["record_0000/drive"].id.get_chunk_info(0)
        content[chunk.byte_offset + chunk.size // 2] ^= 1
        (tmp_path / "a.h5").write_bytes(content)
        with pytest.raises(InputError, match="not a whole HDF5 file"):
            read(tmp_path / "a.h5")

    @pytest.mark.parametrize(
        ("spoil", "says"),
        [
            (lambda f: f.attrs.__setitem__("version", 99), "layout version 99"),
            (lambda f: f["record_0000"].__delitem__("drive"), "no signal 'drive'"),
            (lambda f: f["record_0000"].attrs.__delitem__("between"), "lacks 'between'"),
            (lambda f: f["record_0000"].attrs.__setitem__("between", "x"), "'x'"),
            (lambda f: f["record_0000/drive"].attrs.__delitem__("unit"), "unit is missing"),
            (lambda f: f["record_0000/drive"].attrs.__setitem__("unit", "mV"), "'mV' is none"),
            (lambda f: f.__setitem__("record_0001", 3.0), "is not a record"),
            (lambda f: f.__delitem__("record_0000"), "at least one record"),
        ],
    )
    def test_a_broken_layout_is_named(self, tmp_path: Path, spoil: Any, says: str) -> None:
        write(record(), tmp_path / "a.h5")
        with h5py.File(tmp_path / "a.h5", "r+") as content:
            spoil(content)
        with pytest.raises(InputError, match=says) as caught:
            read(tmp_path / "a.h5")
        assert "a.h5" in str(caught.value)

    def test_arrays_of_several_drives_are_pointed_to_the_command_for_them(
        self, tmp_path: Path
    ) -> None:
        with h5py.File(tmp_path / "a.h5", "w") as content:
            content["100mV/voltage"] = np.zeros((16, 3, 2, 2))
        np.save(tmp_path / "u_a.npy", np.zeros((16, 3, 2, 2)))
        for name in ("a.h5", "u_a.npy"):
            with pytest.raises(InputError, match="piezo-opt axes fit"):
                read(tmp_path / name)

    def test_too_many_samples_are_refused_before_they_are_read(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        write(record(), tmp_path / "a.h5")
        monkeypatch.setattr(files, "MOST_ROWS", 100)
        with pytest.raises(InputError, match="more than 100 samples"):
            read(tmp_path / "a.h5")


class TestMatlab:
    SAID: ClassVar = {"time": "t [s]", "drive": "u [V]", "position": "y [um]"}

    def check(self, one: Measurement) -> None:
        np.testing.assert_allclose(one.time, T, rtol=1e-14)
        np.testing.assert_array_equal(one.drive, U)
        np.testing.assert_allclose(one.position, Y * 1e-6, rtol=1e-12)

    def test_version_5(self, tmp_path: Path) -> None:
        io.savemat(tmp_path / "a.mat", {"t": T, "u": U[:, None], "y": Y[None, :], "Fs": 100.0})
        self.check(read(tmp_path / "a.mat", **self.SAID))

    def test_version_5_with_units_beside(self, tmp_path: Path) -> None:
        variables = {"t": T, "u": U, "y": Y, "t_unit": "s", "u_unit": "V", "y_unit": "um"}
        io.savemat(tmp_path / "a.mat", variables)
        self.check(read(tmp_path / "a.mat"))

    def test_version_5_structures(self, tmp_path: Path) -> None:
        io.savemat(tmp_path / "a.mat", {"run": {"t": T, "u": U, "y": Y}}, do_compression=True)
        said = {"time": "run.t [s]", "drive": "run.u [V]", "position": "run.y [um]"}
        self.check(read(tmp_path / "a.mat", **said))

    def test_version_73(self, tmp_path: Path) -> None:
        with h5py.File(tmp_path / "a.mat", "w", userblock_size=512) as content:
            for name, values in (("t", T), ("u", U), ("y", Y)):
                content[name] = values[None, :]
        self.check(read(tmp_path / "a.mat", **self.SAID))

    def test_missing_units_and_names(self, tmp_path: Path) -> None:
        io.savemat(tmp_path / "a.mat", {"t": T, "u": U, "y": Y, "note": "x"})
        with pytest.raises(InputError, match=r"'t' and 'u' and 'y' have no unit.*time='t \[s\]'"):
            read(tmp_path / "a.mat")
        with pytest.raises(InputError, match="no column 'x': the columns are 't', 'u', 'y'"):
            read(tmp_path / "a.mat", **(self.SAID | {"drive": "x"}))

    def test_lengths_and_bad_numbers(self, tmp_path: Path) -> None:
        io.savemat(tmp_path / "a.mat", {"t": T, "u": U[:-1], "y": Y})
        with pytest.raises(InputError, match=r"'u \[V\]' has 199 samples but the clock 200"):
            read(tmp_path / "a.mat", **self.SAID)
        spoiled = np.where(np.arange(200) == 4, np.nan, Y)
        io.savemat(tmp_path / "a.mat", {"t": T, "u": U, "y": spoiled})
        with pytest.raises(InputError, match=r"element 5, column 'y \[um\]': nan"):
            read(tmp_path / "a.mat", **self.SAID)

    def test_too_many_samples_are_refused_before_they_are_read(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        io.savemat(tmp_path / "a.mat", {"t": T, "u": U, "y": Y}, do_compression=True)
        monkeypatch.setattr(files, "MOST_ROWS", 100)
        with pytest.raises(InputError, match="more than 100 samples"):
            read(tmp_path / "a.mat", **self.SAID)

    def test_a_damaged_type_number_is_noticed_before_compiled_code_uses_it(
        self, tmp_path: Path
    ) -> None:
        io.savemat(tmp_path / "a.mat", {"t": T, "u": U, "y": Y})
        content = bytearray((tmp_path / "a.mat").read_bytes())
        # The numbers of t stand last in the first variable; their type is 9 (double).
        place = content.index(T.tobytes()) - 8
        assert content[place] == 9
        content[place] = 200
        (tmp_path / "a.mat").write_bytes(content)
        with pytest.raises(InputError, match="unknown data type 200"):
            read(tmp_path / "a.mat", **self.SAID)

    def test_other_variables_beside_the_signals(self, tmp_path: Path) -> None:
        others = {"z": 1j * T, "s": sparse.eye_array(3), "c": np.array([T, "a"], dtype=object)}
        io.savemat(tmp_path / "a.mat", {"t": T, "u": U, "y": Y, **others, "r": {"a": {"b": []}}})
        self.check(read(tmp_path / "a.mat", **self.SAID))

    def test_version_4_is_refused(self, tmp_path: Path) -> None:
        io.savemat(tmp_path / "a.mat", {"t": T, "u": U, "y": Y}, format="4")
        with pytest.raises(InputError, match=r"version 5 or 7\.3: save the signals again"):
            read(tmp_path / "a.mat", **self.SAID)

    @pytest.mark.parametrize("part", [0.1, 0.5, 0.9])
    @pytest.mark.parametrize("compressed", [False, True])
    def test_cut_short(self, tmp_path: Path, part: float, compressed: bool) -> None:
        io.savemat(tmp_path / "a.mat", {"t": T, "u": U, "y": Y}, do_compression=compressed)
        whole = (tmp_path / "a.mat").read_bytes()
        (tmp_path / "a.mat").write_bytes(whole[: int(part * len(whole))])
        with pytest.raises(InputError, match=r"a\.mat: "):
            read(tmp_path / "a.mat", **self.SAID)


@pytest.fixture(scope="module")
def samples(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("samples")
    write(record(), folder / "a.h5")
    io.savemat(folder / "a.mat", {"t": T, "u": U, "y": Y})
    return {file.suffix: file.read_bytes() for file in folder.iterdir()}


@pytest.mark.parametrize("suffix", [".h5", ".mat"])
@settings(max_examples=80, deadline=None)
@given(content=st.binary(min_size=0, max_size=300))
def test_garbage_is_only_ever_an_input_error(
    tmp_path_factory: pytest.TempPathFactory, suffix: str, content: bytes
) -> None:
    file = tmp_path_factory.getbasetemp() / f"garbage{suffix}"
    file.write_bytes(content)
    with pytest.raises(InputError):
        read(file)


@pytest.mark.parametrize("suffix", [".h5", ".mat"])
@settings(max_examples=80, deadline=None)
@given(where=st.floats(0, 1, exclude_max=True), value=st.integers(0, 255), cut=st.booleans())
def test_damaged_files_are_read_or_input_errors(
    tmp_path_factory: pytest.TempPathFactory,
    samples: dict[str, bytes],
    suffix: str,
    where: float,
    value: int,
    cut: bool,
) -> None:
    content = bytearray(samples[suffix])
    place = int(where * len(content))
    content[place] = value
    file = tmp_path_factory.getbasetemp() / f"damaged{suffix}"
    file.write_bytes(content[: place + 1] if cut else content)
    said = TestMatlab.SAID if suffix == ".mat" else {}
    with contextlib.suppress(InputError):
        assert len(read(file, **said)) >= 8
