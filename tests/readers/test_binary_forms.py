"""The same record from MATLAB, Simulink, HDF5, netCDF, LabVIEW, Parquet and frames."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from nptdms import ChannelObject, TdmsWriter
from pyarrow import parquet
from scipy import io

from piezo_opt.errors import InputError
from piezo_opt.readers import extras, read
from tests.readers.forms import STEP, T, U, Y, check, put, rows

NAMED = {"drive": "voltage [V]", "position": "displacement [um]"}
SIGNALS = (("voltage", U), ("displacement", Y))


def structure(text: bool = True) -> dict[str, Any]:
    """What a scope of Simulink leaves."""
    signals = [{"values": v[:, None], "label": name if text else ""} for name, v in SIGNALS]
    return {"time": T[:, None], "signals": signals}


class TestMatlab:
    def test_simulink_structure_with_time(self, tmp_path: Path) -> None:
        io.savemat(tmp_path / "a.mat", {"ScopeData": structure()})
        record = read(tmp_path / "a.mat", **NAMED)
        check(record)
        assert record.notes == ("'ScopeData' was logged by Simulink: its time is in s.",)
        both = r"'voltage' and 'displacement' have no unit.*drive='voltage \[V\]' position="
        with pytest.raises(InputError, match=both):
            read(tmp_path / "a.mat")

    def test_simulink_signals_without_labels_and_of_several_columns(self, tmp_path: Path) -> None:
        io.savemat(tmp_path / "a.mat", {"out": structure(text=False)})
        said = {"drive": "out.signals(1) [V]", "position": "out.signals(2) [um]"}
        check(read(tmp_path / "a.mat", **said))
        both = {"values": np.column_stack([U, Y]), "label": "both"}
        io.savemat(tmp_path / "a.mat", {"out": {"time": T, "signals": both}})
        check(read(tmp_path / "a.mat", drive="both(:,1) [V]", position="both(:,2) [um]"))
        # Logged three-dimensional, with the time last.
        deep = {"values": np.column_stack([U, Y]).T.reshape(2, 1, -1), "label": "deep"}
        io.savemat(tmp_path / "a.mat", {"out": {"time": T, "signals": deep}})
        check(read(tmp_path / "a.mat", drive="2 [V]", position="3 [um]"))

    def test_time_series_as_structures(self, tmp_path: Path) -> None:
        series = {
            name: {
                "Time": 1e3 * T,
                "Data": values,
                "TimeInfo": {"Units": "milliseconds"},
                "DataInfo": {"Units": unit},
                "Name": name,
            }
            for (name, values), unit in zip(SIGNALS, ("V", "um"), strict=True)
        }
        io.savemat(tmp_path / "a.mat", series)
        record = read(tmp_path / "a.mat")
        check(record)
        assert "time series: its time is in ms" in record.notes[0]

    @pytest.mark.parametrize("upright", [True, False])
    def test_a_matrix_whose_first_signal_is_the_time(self, tmp_path: Path, upright: bool) -> None:
        log = np.vstack([T, U, Y])
        io.savemat(tmp_path / "a.mat", {"log": log.T if upright else log})
        record = read(tmp_path / "a.mat", drive="2 [V]", position="3 [um]")
        check(record)
        called = "log(:,{}) [{}]" if upright else "log({},:) [{}]"
        check(
            read(tmp_path / "a.mat", drive=called.format(2, "V"), position=called.format(3, "um"))
        )
        assert "increases evenly and was taken as the time in s" in record.notes[0]
        with pytest.raises(InputError, match="the columns are 'log"):
            read(tmp_path / "a.mat")

    def test_matrices_of_which_none_is_a_clock(self, tmp_path: Path) -> None:
        io.savemat(tmp_path / "a.mat", {"log": np.vstack([U, Y]), "gain": 3.0})
        with pytest.raises(InputError, match="no column is the time"):
            read(tmp_path / "a.mat", drive="1 [V]", position="2 [um]")
        check(read(tmp_path / "a.mat", drive="1 [V]", position="2 [um]", rate="1 kHz"))

    def test_version_73_with_structures_cells_and_references(self, tmp_path: Path) -> None:
        """As MATLAB writes it: columns together, arrays of structures as references."""
        with h5py.File(tmp_path / "a.mat", "w", userblock_size=512) as content:
            kept = content.create_group("#refs#")
            group = content.create_group("ScopeData")
            group.attrs["MATLAB_class"] = np.bytes_("struct")
            group["time"] = T[None, :]
            signals = group.create_group("signals")
            for field in ("values", "label"):
                at = signals.create_dataset(field, (2, 1), dtype=h5py.ref_dtype)
                for k, (name, values) in enumerate(SIGNALS):
                    own = kept.create_dataset(
                        f"{field}{k}",
                        data=values[None, :]
                        if field == "values"
                        else np.array([[ord(c)] for c in name], dtype="u2"),
                    )
                    own.attrs["MATLAB_class"] = np.bytes_("double" if field == "values" else "char")
                    at[k, 0] = own.ref
        with (tmp_path / "a.mat").open("r+b") as raw:
            raw.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
        check(read(tmp_path / "a.mat", **NAMED))

    def test_version_73_matrix(self, tmp_path: Path) -> None:
        with h5py.File(tmp_path / "a.mat", "w", userblock_size=512) as content:
            content["log"] = np.column_stack([T, U, Y])  # MATLAB's 3 x N
        check(read(tmp_path / "a.mat", drive="log(2,:) [V]", position="log(3,:) [um]"))

    def test_objects_are_named_with_what_to_do(self, tmp_path: Path) -> None:
        with h5py.File(tmp_path / "a.mat", "w", userblock_size=512) as content:
            content["ts"] = np.arange(6, dtype="u4")
            content["ts"].attrs["MATLAB_object_decode"] = np.int32(3)
            content.create_group("#subsystem#")
        with pytest.raises(InputError, match=r"'ts' is an object.*t = x\.Time; y = x\.Data"):
            read(tmp_path / "a.mat")
        # Version 5: flags of class 17, a name and two words, instead of a shape.
        io.savemat(tmp_path / "b.mat", {"t": T, "u": U, "y": Y})
        plain = (tmp_path / "b.mat").read_bytes()

        def element(kind: int, body: bytes) -> bytes:
            head = np.array([kind, len(body)], dtype="<u4").tobytes()
            return head + body + b"\0" * (-len(body) % 8)

        flags = element(6, np.array([17, 0], dtype="<u4").tobytes())
        inner = flags + element(1, b"series") + element(1, b"MCOS") + element(1, b"timeseries")
        whole = plain[:128] + element(14, inner) + plain[128:]
        (tmp_path / "b.mat").write_bytes(whole)
        said = {"time": "t [s]", "drive": "u [V]", "position": "y [um]"}
        record = read(tmp_path / "b.mat", **said)
        check(record)
        assert record.notes == ("'series': an object is left out, only MATLAB unfolds it.",)
        (tmp_path / "b.mat").write_bytes(plain[:128] + element(14, inner))
        with pytest.raises(InputError, match="'series' is an object"):
            read(tmp_path / "b.mat")


class TestHdf5:
    def test_packed_numbers_are_unpacked(self, tmp_path: Path) -> None:
        with h5py.File(tmp_path / "a.h5", "w") as content:
            for name, unit, values in (("time", "s", T), ("voltage", "V", U), ("y", "um", Y)):
                scale, offset = (
                    (STEP, 0.0) if name == "time" else (np.ptp(values) / 6e4, values.mean())
                )
                packed = content.create_dataset(
                    name, data=np.round((values - offset) / scale).astype("i2")
                )
                packed.attrs.update(units=unit, scale_factor=scale, add_offset=offset)
        record = read(tmp_path / "a.h5")
        np.testing.assert_allclose(record.time, T, atol=1e-9)
        np.testing.assert_allclose(record.drive, U, atol=np.ptp(U) / 6e4)
        np.testing.assert_allclose(record.position, 1e-6 * Y, atol=1e-6 * np.ptp(Y) / 6e4)
        assert "'voltage' was unpacked with scale_factor" in " ".join(record.notes)

    @pytest.mark.parametrize("mark", ["_FillValue", "missing_value"])
    def test_missing_values_are_left_out_and_said(self, tmp_path: Path, mark: str) -> None:
        with h5py.File(tmp_path / "a.h5", "w") as content:
            for name, unit, values in (
                ("time", "seconds since 2020-01-01", T),
                ("voltage", "V", U),
                ("y", "um", Y),
            ):
                spoiled = values.astype("f4") if name == "y" else values
                if name == "y":
                    spoiled[100:103] = -9999.0
                content[name] = spoiled
                content[name].attrs["units"] = unit
            content["y"].attrs[mark] = np.float32(-9999.0)
            content["y"].attrs["scale_factor"] = 2.0
        record = read(tmp_path / "a.h5")
        assert len(record) == len(T) - 3
        assert record.position.min() > 0.0
        np.testing.assert_allclose(record.position[:100], 2e-6 * Y[:100], rtol=1e-6)
        assert any("samples are marked as missing in the file" in note for note in record.notes)
        assert any("index 100" in note for note in record.notes)

    def test_a_rate_in_an_attribute_a_matrix_and_a_table(self, tmp_path: Path) -> None:
        with h5py.File(tmp_path / "a.h5", "w") as content:
            content.attrs["sample_rate"] = 1000.0
            content["daq/data"] = np.column_stack([U, Y])
        check(read(tmp_path / "a.h5", drive="1 [V]", position="daq/data(:,2) [um]"))
        table = np.zeros(len(T), dtype=[("t", "f8"), ("u", "f8"), ("y", "f4"), ("note", "S3")])
        table["t"], table["u"], table["y"] = T, U, Y
        with h5py.File(tmp_path / "b.h5", "w") as content:
            content["log"] = table
        said = {"time": "log.t [s]", "drive": "log.u [V]", "position": "log.y [um]"}
        np.testing.assert_array_equal(read(tmp_path / "b.h5", **said).drive, U)

    def test_nanoseconds_of_an_epoch_lose_no_digit(self, tmp_path: Path) -> None:
        with h5py.File(tmp_path / "a.h5", "w") as content:
            clock = 1_700_000_000_000_000_123 + np.round(1e9 * T).astype(np.int64)
            for name, unit, values in (
                ("time", "nanoseconds since 1970-01-01", clock), ("voltage", "V", U), ("y", "um", Y)
            ):  # fmt: skip
                content[name] = values
                content[name].attrs["units"] = unit
        record = read(tmp_path / "a.h5")
        np.testing.assert_allclose(record.time, T, atol=1e-9)
        assert "'time' is counted from its first instant." in record.notes

    def test_what_holds_no_numbers_is_named(self, tmp_path: Path) -> None:
        with h5py.File(tmp_path / "a.h5", "w") as content:
            content["time [s]"], content["voltage [V]"] = T, U
            content["y [um]"] = np.array([f"{y:.3f}" for y in Y], dtype="S8")
        with pytest.raises(InputError, match=r"'y \[um\]' holds no numbers"):
            read(tmp_path / "a.h5")

    @pytest.mark.parametrize("factor", ["large", [1.0, 2.0]])
    def test_an_attribute_that_is_no_number(
        self, tmp_path: Path, factor: str | list[float]
    ) -> None:
        with h5py.File(tmp_path / "a.h5", "w") as content:
            content["u"] = U
            content["u"].attrs.update(units="V", scale_factor=factor)
        with pytest.raises(InputError, match="'u' has a scale_factor that is no number"):
            read(tmp_path / "a.h5")


class TestNetcdf:
    def test_classic(self, tmp_path: Path) -> None:
        with io.netcdf_file(tmp_path / "a.nc", "w") as content:
            content.createDimension("n", len(T))
            for name, unit, values in (("time", "s", T), ("voltage", "V", U), ("y", "um", 2 * Y)):
                variable = content.createVariable(name, "d", ("n",))
                variable[:] = values
                variable.units = unit
            content.variables["y"].scale_factor = 0.5
        check(read(tmp_path / "a.nc"))

    def test_version_4_is_hdf5(self, tmp_path: Path) -> None:
        with h5py.File(tmp_path / "a.nc", "w") as content:
            for name, unit, values in (("time", "s", T), ("voltage", "V", U), ("y", "um", Y)):
                content[name] = values
                content[name].attrs["units"] = np.bytes_(unit)
        check(read(tmp_path / "a.nc"))

    def test_damaged(self, tmp_path: Path) -> None:
        (tmp_path / "a.nc").write_bytes(b"CDF\x01" + bytes(40))
        with pytest.raises(InputError, match=r"a\.nc: "):
            read(tmp_path / "a.nc")


LVM = (
    "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDecimal_Separator\t{sign}\n"
    "X_Columns\t{columns}\n***End_of_Header***\t\n\t\nChannels\t2\nY_Unit_Label\tV\tum\n"
    "X_Dimension\tTime\tTime\nX0\t0.0E+0\t0.0E+0\nDelta_X\t1.0E-3\t1.0E-3\n"
    "***End_of_Header***\t\t\t\n{names}\tComment\n"
)


class TestLabview:
    @pytest.mark.parametrize("sign", [".", ","])
    def test_one_column_of_time(self, tmp_path: Path, sign: str) -> None:
        head = LVM.format(sign=sign, columns="One", names="X_Value\tvoltage\tdisplacement")
        record = read(put(tmp_path, "a.lvm", head + rows("\t", sign)))
        check(record)
        assert "LabVIEW headers" in record.notes[0]

    def test_no_column_of_time(self, tmp_path: Path) -> None:
        head = LVM.format(sign=".", columns="No", names="X_Value\tvoltage\tdisplacement")
        lines = "".join(f"\t{u:.9g}\t{y:.9g}\n" for u, y in zip(U, Y, strict=True))
        record = read(put(tmp_path, "a.lvm", head + lines))
        check(record)
        assert "made from 'Delta_X': 0.001 s" in record.notes[-1]

    def test_a_column_of_time_for_each(self, tmp_path: Path) -> None:
        head = LVM.format(
            sign=".", columns="Multi", names="X_Value\tvoltage\tX_Value\tdisplacement"
        )
        lines = "".join(
            f"{t:.9g}\t{u:.9g}\t{t:.9g}\t{y:.9g}\n" for t, u, y in zip(T, U, Y, strict=True)
        )
        check(read(put(tmp_path, "a.lvm", head + lines)))

    def test_segments_whose_clock_goes_on(self, tmp_path: Path) -> None:
        head = LVM.format(sign=".", columns="One", names="X_Value\tvoltage\tdisplacement")
        lines = rows("\t").splitlines(keepends=True)
        second = head[head.index("Channels") :]
        text = head + "".join(lines[:400]) + "\n" + second + "".join(lines[400:])
        check(read(put(tmp_path, "a.lvm", text)))

    def test_what_is_wrong_is_said_by_row(self, tmp_path: Path) -> None:
        head = LVM.format(sign=".", columns="One", names="X_Value\tvoltage\tdisplacement")
        broken = head + rows("\t").replace("0.1\t", "x\t", 1)
        with pytest.raises(InputError, match=r"row \d+ is not one number for each of X_Value"):
            read(put(tmp_path, "a.lvm", broken))
        with pytest.raises(InputError, match="does not begin with 'LabVIEW Measurement'"):
            read(put(tmp_path, "b.lvm", "nothing\n"))

    def test_tdms(self, tmp_path: Path) -> None:
        clock = {"wf_increment": STEP, "wf_start_offset": 0.0}
        with TdmsWriter(tmp_path / "a.tdms") as writer:
            writer.write_segment(
                [
                    ChannelObject("log", name, values, {"unit_string": unit, **clock})
                    for (name, values), unit in zip(SIGNALS, ("V", "um"), strict=True)
                ]
            )
        record = read(tmp_path / "a.tdms")
        check(record)
        assert "made from 'wf_increment': 0.001 s" in record.notes[-1]
        content = bytearray((tmp_path / "a.tdms").read_bytes())
        (tmp_path / "a.tdms").write_bytes(content[: len(content) // 3])
        with pytest.raises(InputError, match=r"a\.tdms: "):
            read(tmp_path / "a.tdms")

    def test_a_tdms_that_is_cut_short_says_so(self, tmp_path: Path) -> None:
        with TdmsWriter(tmp_path / "a.tdms") as writer:
            for part in (slice(0, 100), slice(100, 200)):
                channels = [
                    ChannelObject("log", name, values[part], {"unit_string": unit})
                    for (name, values), unit in zip(SIGNALS, ("V", "um"), strict=True)
                ]
                writer.write_segment(channels)
        whole = (tmp_path / "a.tdms").read_bytes()
        assert not any("shorter" in note for note in read(tmp_path / "a.tdms", rate="1 kHz").notes)
        # Of the second block's 100 drives and 100 readings all drives and 37 readings are left.
        (tmp_path / "a.tdms").write_bytes(whole[: -63 * 8])
        cut = read(tmp_path / "a.tdms", rate="1 kHz")
        assert len(cut) == 137
        assert any("shorter than what was measured" in note for note in cut.notes)

    def test_a_missing_library_is_named(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def missing(name: str) -> None:
            raise ImportError(name)

        monkeypatch.setattr(extras, "import_module", missing)
        (tmp_path / "a.tdms").write_bytes(b"x")
        with pytest.raises(InputError, match=r"TDMS files need nptdms.*piezo_opt\[tdms\]"):
            read(tmp_path / "a.tdms")
        (tmp_path / "a.parquet").write_bytes(b"x")
        with pytest.raises(InputError, match=r"Parquet files need pyarrow.*piezo_opt\[parquet\]"):
            read(tmp_path / "a.parquet")


class TestFrames:
    COLUMNS: dict[str, Any] = {"time [s]": T, "voltage [V]": U, "displacement [um]": Y}  # noqa: RUF012

    def test_parquet(self, tmp_path: Path) -> None:
        parquet.write_table(pa.table(self.COLUMNS), tmp_path / "a.parquet")
        check(read(tmp_path / "a.parquet"))
        stamps = np.datetime64("2020-01-01T00:00:00", "us") + (1e6 * T).astype("timedelta64[us]")
        fields = [
            pa.field("when", pa.timestamp("us")),
            pa.field("u", pa.float64(), metadata={"unit": "V"}),
            pa.field("y", pa.float64(), metadata={"unit": "um"}),
            pa.field("note", pa.string()),
        ]
        table = pa.table([stamps, U, Y, ["ok"] * len(T)], schema=pa.schema(fields))
        parquet.write_table(table, tmp_path / "b.parquet")
        record = read(tmp_path / "b.parquet")
        check(record)
        assert "Column 'note' holds no numbers and was left out." in record.notes
        (tmp_path / "c.parquet").write_bytes((tmp_path / "b.parquet").read_bytes()[:2000])
        with pytest.raises(InputError, match="not a whole Parquet file"):
            read(tmp_path / "c.parquet")

    def test_a_frame_of_pandas(self) -> None:
        check(read(pd.DataFrame(self.COLUMNS)))
        beside = pd.DataFrame({"u": U, "y": Y, "note": "ok"})
        check(read(beside, drive="u [V]", position="y [um]", rate="1 kHz"))
        beside.index = pd.to_timedelta(T, unit="s")
        check(read(beside, drive="u [V]", position="y [um]"))
        beside.index = pd.Timestamp("2020-01-01") + pd.to_timedelta(T, unit="s")
        check(read(beside, drive="u [V]", position="y [um]"))
        named = pd.DataFrame({"u [V]": U, "y [um]": Y}, index=pd.Index(T, name="t [s]"))
        check(read(named))
        spoiled = pd.DataFrame(self.COLUMNS)
        spoiled.loc[7, "voltage [V]"] = np.nan
        with pytest.raises(InputError, match=r"frame: row 7, column 'voltage \[V\]': nan"):
            read(spoiled)


@pytest.mark.parametrize(
    ("name", "value"), [("fs", 1000.0), ("Fs", 1000), ("dt", 1e-3), ("Ts", 1e-3)]
)
def test_a_number_in_a_matlab_file_is_the_clock(tmp_path: Path, name: str, value: float) -> None:
    io.savemat(tmp_path / "a.mat", {name: value, "u": U, "y": Y})
    record = read(tmp_path / "a.mat", drive="u [V]", position="y [um]")
    check(record)
    assert f"made from {name!r}: 0.001 s" in record.notes[-1]
    with h5py.File(tmp_path / "a.h5", "w") as content:
        content[name], content["u [V]"], content["y [um]"] = value, U, Y
    check(read(tmp_path / "a.h5"))


def test_a_complex_signal_is_named_and_not_taken(tmp_path: Path) -> None:
    io.savemat(tmp_path / "a.mat", {"t": T, "u": U + 1j, "y": Y})
    with pytest.raises(InputError, match="'u' holds no numbers"):
        read(tmp_path / "a.mat", time="t [s]", drive="u [V]", position="y [um]")


def test_an_index_of_instants_with_a_time_zone_and_one_of_decimals() -> None:
    signals = {"voltage [V]": U, "displacement [um]": Y}
    zoned = pd.date_range("2020-03-29 01:59:59.5", periods=len(T), freq="ms", tz="Europe/Berlin")
    check(read(pd.DataFrame(signals, index=zoned)))
    stamped = pd.DataFrame({"time": zoned, **signals})
    check(read(stamped))
    check(read(pd.DataFrame(signals, index=T), time="index [s]"))
