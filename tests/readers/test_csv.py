"""Text tables: what is read, and the sentence for everything that is not."""

import contextlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from piezo_opt import files
from piezo_opt.errors import InputError
from piezo_opt.measurement import Between, Measurement
from piezo_opt.readers import read, read_campaign, write

ROWS = 20
HEADER = "time [s],voltage [V],displacement [um]"

Make = Callable[..., Path]


def rows(separator: str = ",", count: int = ROWS) -> list[str]:
    return [separator.join((f"{i / 10:.1f}", f"{5 * i}", f"{i * 0.7:.3f}")) for i in range(count)]


@pytest.fixture
def make(tmp_path: Path) -> Make:
    def text(*lines: str, name: str = "loop.csv") -> Path:
        file = tmp_path / name
        file.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return file

    return text


def check_loop(record: Measurement) -> None:
    np.testing.assert_allclose(record.time, np.arange(ROWS) / 10, rtol=1e-14)
    np.testing.assert_array_equal(record.drive, 5.0 * np.arange(ROWS))
    np.testing.assert_allclose(record.position, 0.7e-6 * np.arange(ROWS), rtol=1e-12)


class TestReading:
    @pytest.mark.parametrize("separator", [",", ";", "\t", " ", ", ", "   "])
    def test_separators(self, make: Make, separator: str) -> None:
        header = separator.join(("time [s]", "voltage [V]", "displacement [um]"))
        record = read(make(header, *rows(separator)))
        check_loop(record)
        assert record.name == "loop"
        assert (record.drive_unit, record.position_unit) == ("V", "m")

    def test_bars_and_names_that_go_on_in_the_next_line(self, make: Make) -> None:
        check_loop(read(make("time [s]|voltage [V]|displacement [um]", *rows("|"))))
        check_loop(read(make('"time\n[s]","voltage\n[V]","displacement\n[um]"', *rows())))

    def test_a_remark_behind_a_row_is_none_of_its_cells(self, make: Make) -> None:
        data = rows()
        check_loop(read(make(HEADER, *data[:5], data[5] + "  # here it was touched", *data[6:])))

    def test_thousands_of_columns(self, make: Make) -> None:
        more = ["1"] * 3000
        heads = [f"c{k} [V]" for k in range(3000)]
        file = make(",".join([HEADER, *heads]), *(",".join([row, *more]) for row in rows()))
        check_loop(read(file, drive="voltage"))

    @pytest.mark.parametrize("suffix", ["txt", "tsv", "dat", "CSV"])
    def test_suffixes(self, make: Make, suffix: str) -> None:
        check_loop(read(make(HEADER, *rows(), name=f"loop.{suffix}")))

    def test_comments_blank_lines_and_a_byte_order_mark(self, make: Make) -> None:
        data = rows()
        file = make("\ufeff# measured", "", HEADER, *data[:5], "# a break", "", *data[5:])
        check_loop(read(file))

    def test_windows_line_ends(self, tmp_path: Path) -> None:
        file = tmp_path / "loop.csv"
        file.write_bytes("\r\n".join([HEADER, *rows()]).encode())
        check_loop(read(file))

    def test_a_header_behind_a_comment_sign(self, make: Make) -> None:
        check_loop(read(make("# " + HEADER, *rows())))

    def test_units_are_converted_and_others_become_channels(self, make: Make) -> None:
        lines = [f"{i},{i * 0.7},{i},{20 + i},{i}" for i in range(ROWS)]
        record = read(make("t [ms],y [nm],u [kV],body temperature [degC],index", *lines))
        assert record.step == pytest.approx(1e-3)
        assert record.drive[3] == pytest.approx(3000.0)
        assert record.position[3] == pytest.approx(2.1e-9)
        assert set(record.channels) == {"body temperature"}
        assert record.channels["body temperature"][0] == pytest.approx(293.15)
        assert record.channel_units["body temperature"] == "K"

    def test_the_better_name_wins_among_equal_units(self, make: Make) -> None:
        lines = [f"{i},{i * 0.7},{2 * i},{3 * i}" for i in range(ROWS)]
        record = read(make("t [s],y [um],monitor [V],voltage [V]", *lines))
        assert record.drive[1] == 3.0
        assert record.channels["monitor"][1] == 2.0

    def test_columns_named_by_the_user(self, make: Make) -> None:
        lines = [f"{i},{2 * i},{3 * i},{4 * i}" for i in range(ROWS)]
        file = make("t [s],ch1 [V],ch2 [V],force [mN]", *lines)
        record = read(file, drive="force", position="ch2 [V]")
        assert (record.drive_unit, record.position_unit) == ("N", "V")
        assert record.drive[1] == pytest.approx(4e-3)
        assert record.position[1] == 3.0
        assert set(record.channels) == {"ch1"}

    def test_units_said_by_the_user(self, make: Make) -> None:
        file = make("a,b,c", *rows())
        check_loop(read(file, time="a [s]", drive="b [V]", position="c [um]"))

    def test_what_the_user_says_about_the_record(self, make: Make) -> None:
        record = read(make(HEADER, *rows()), between=Between.HELD, startup="400 ms")
        assert record.between is Between.HELD
        assert record.counted.sum() == ROWS - 4
        lines = [f"{i / 10},{i % 5},{i % 5}" for i in range(ROWS)]
        assert read(make(HEADER, *lines), period="0.5 s").periods == 4


class TestRefusing:
    def refused(self, file: Path, *says: str, **said: Any) -> None:
        with pytest.raises(InputError) as caught:
            read(file, **said)
        sentence = str(caught.value)
        assert str(file) in sentence
        assert "\n" not in sentence
        for piece in says:
            assert piece in sentence, sentence

    def test_what_is_not_a_file(self, tmp_path: Path) -> None:
        self.refused(tmp_path / "no.csv", "no such file")
        self.refused(tmp_path, "is a directory")
        odd = tmp_path / "loop.xlsx"
        odd.write_text("x")
        self.refused(odd, "nothing reads .xlsx")
        os.mkfifo(tmp_path / "pipe.csv")
        self.refused(tmp_path / "pipe.csv", "not an ordinary file")
        with pytest.raises(InputError, match="no such file"):
            read("bad\0name.csv")

    def test_a_file_that_may_not_be_read(self, make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
        file = make(HEADER, *rows())

        def forbidden(*_: Any, **__: Any) -> None:
            raise PermissionError(13, "Permission denied")

        monkeypatch.setattr(Path, "open", forbidden)
        self.refused(file, "may not be read", "permissions")

    @pytest.mark.parametrize(
        ("content", "says"),
        [
            (b"", "is empty"),
            (b"\n\n# nothing\n", "has no rows"),
            (HEADER.encode(), "header without rows"),
            (b"\x89HDF\r\n\x1a\n\0\0\0\0", "is binary"),
            (HEADER.encode() + b"\n0,1,2\n\xff\xfe,1,2\n", "row 3, column 'time [s]': 'ÿþ'"),
            ("time [s];Spannung [V]\n1;2 \xb5".encode("latin-1"), "no column is the drive"),
            (b"\xff\xfe\x00\xd8" + b"a" * 40, "neither UTF-8, UTF-16 nor Latin-1"),
        ],
    )
    def test_what_is_not_a_table(self, tmp_path: Path, content: bytes, says: str) -> None:
        file = tmp_path / "loop.csv"
        file.write_bytes(content)
        self.refused(file, says)

    def test_headers(self, make: Make) -> None:
        self.refused(make(*rows()), "row 1 has numbers where the header should be")
        told = "'time' and 'voltage' and 'displacement' have no unit"
        self.refused(make("time,voltage,displacement", *rows()), told, "time [s]")
        self.refused(
            make("time [s],voltage [furlong/fortnite],x [um]", *rows()),
            "'voltage [furlong/fortnite]'",
            "unknown unit",
        )
        self.refused(make("time [s],voltage [],x [um]", *rows()), "unit is missing")
        self.refused(
            make("time [s],voltage [V],displacement [V]", *rows()),
            "'displacement [V]' is no position",
        )
        self.refused(make("time [s],a [V],b [V]", *rows()), "more than one", "'a [V]', 'b [V]'")
        twins = make("time [s],u [V],u [V],y [um]", *[row + ",1" for row in rows()])
        self.refused(twins, "choose with drive='2' or drive='3'")
        self.refused(make("time [s],voltage [V],x [%]", *rows()), "'x [%]'")
        self.refused(
            make(HEADER, *[row.replace(",", ",0x", 1) for row in rows()]),
            "'voltage [V]' holds no numbers ('0x95')",
        )
        self.refused(
            make("time [s],a [m],b [m]", *rows()), "no column is the drive", "'a [m]', 'b [m]'"
        )

    def test_names_that_are_not_there_or_wrong(self, make: Make) -> None:
        file = make(HEADER, *rows())
        self.refused(file, "no column 'u'", "'voltage [V]'", drive="u")
        self.refused(file, "its own unit, not [mV]", drive="voltage [mV]")
        self.refused(file, "is no time", time="voltage")
        self.refused(file, "cannot serve twice", position="voltage")
        self.refused(file, "holds one record", record="a")
        twin = make("time [s],u [V],u [V],y [m]", *[f"{i},{i},{i},{i}" for i in range(ROWS)])
        self.refused(twin, "2 columns 'u'", drive="u")
        self.refused(make("t [s],a,y [um]", *rows()), "'a' has no unit", "a [V]", drive="a")

    @pytest.mark.parametrize(
        ("row", "says"),
        [
            ("0.55,abc,1", "row 8, column 'voltage [V]': 'abc' is not a number"),
            ("0.55,,1", "row 8, column 'voltage [V]': is empty"),
            ("0.55,2", "row 8 has 2 cells but the header has 3"),
            ("0.55,2,3,4", "row 8 has 4 cells but the header has 3"),
            ("0.55,nan,1", "row 8, column 'voltage [V]': nan is no reading"),
            ("0.55,1,inf", "row 8, column 'displacement [um]': inf is no reading"),
            ("0.5,1,1", "row 9, column 'time [s]': the time 0.5 repeats that of row 8"),
            ("0.2,1,1", "row 8, column 'time [s]': the time 0.2 is before that of row 7"),
            ("0.55,1_0,1", "'1_0' is not a number"),
            ("0.55,0x10,1", "'0x10' is not a number"),
            ("0.55,1,1.#INF", "row 8, column 'displacement [um]': '1.#INF' is not a number"),
        ],
    )
    def test_a_bad_row_is_called_by_its_line_in_the_file(
        self, make: Make, row: str, says: str
    ) -> None:
        data = rows()
        # Lines: comment, header, five rows, the bad row (8), the rest.
        self.refused(make("# measured", HEADER, *data[:5], row, *data[5:]), says)

    def test_decimal_commas(self, make: Make) -> None:
        header = HEADER.replace(",", ";")
        data = [row.replace(",", ";").replace(".", ",") for row in rows()]
        record = read(make(header, *data))
        check_loop(record)
        assert record.notes == ("Decimals are written with a comma.",)

    def test_every_row_wider_than_the_header(self, make: Make) -> None:
        self.refused(make(HEADER, *[row + ",1" for row in rows()]), "row 2 has 4 cells")

    def test_what_the_record_itself_refuses(self, make: Make) -> None:
        self.refused(make(HEADER, *rows(count=5)), "5 samples, too few")
        small = [f"{i},{i},{i}e-310" for i in range(ROWS)]
        self.refused(make(HEADER, *small), "position stays below 1.9e-315: check its unit")
        flat = [f"{i},3,{i}" for i in range(ROWS)]
        self.refused(make(HEADER, *flat), "drive is constant at 3")
        stuck = [f"{i},{i},{min(i, 9)}" for i in range(ROWS)]
        file = make(HEADER, *stuck)
        self.refused(file, "saturated")
        assert read(file, allow_saturated=True).position.max() == pytest.approx(9e-6)

    def test_huge_files(self, make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
        file = make(HEADER, *rows())
        with file.open("r+b") as content:
            content.truncate(files.LARGEST_FILE + 1)  # sparse: no disk is used
        self.refused(file, "2.0 GiB", "slices")
        monkeypatch.setattr("piezo_opt.readers.csv.MOST_ROWS", 10)
        monkeypatch.setattr(files, "MOST_ROWS", 10)
        self.refused(make(HEADER, *rows()), "more than 10 samples", "slices")


class TestWriting:
    def record(self) -> Measurement:
        time = np.arange(40) / 30
        rng = np.random.default_rng(0)
        return Measurement(
            time,
            rng.normal(size=40),
            1e-6 * rng.normal(size=40),
            channels={"temperature": 293 + time},
            channel_units={"temperature": "K"},
            name="run: 7",
            drive_unit="N",
            between=Between.HELD,
            startup=0.1,
            source="bench, left",
        )

    def test_a_written_record_reads_back_the_same(self, tmp_path: Path) -> None:
        record = self.record()
        write(record, tmp_path / "a.csv")
        back = read(tmp_path / "a.csv")
        for name in ("time", "drive", "position"):
            np.testing.assert_array_equal(getattr(back, name), getattr(record, name))
        np.testing.assert_array_equal(back.channels["temperature"], record.channels["temperature"])
        for name in ("name", "drive_unit", "position_unit", "between", "startup", "source"):
            assert getattr(back, name) == getattr(record, name)
        assert read_campaign(tmp_path / "a.csv").names == ("run: 7",)

    def test_an_existing_file_is_not_overwritten_unless_asked(self, tmp_path: Path) -> None:
        file = tmp_path / "a.csv"
        file.write_text("precious")
        with pytest.raises(InputError, match=r"exists already.*overwrite=True"):
            write(self.record(), file)
        assert file.read_text() == "precious"
        write(self.record(), file, overwrite=True)
        assert len(read(file)) == 40

    def test_a_failure_leaves_the_old_file_and_nothing_else(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        file = tmp_path / "a.csv"
        file.write_text("precious")

        def full(*_: Any) -> None:
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(Path, "replace", full)
        with pytest.raises(InputError, match="the disk is full"):
            write(self.record(), file, overwrite=True)
        assert file.read_text() == "precious"
        assert [one.name for one in tmp_path.iterdir()] == ["a.csv"]

    def test_a_file_made_meanwhile_by_another_process_is_kept(self, tmp_path: Path) -> None:
        file = tmp_path / "a.csv"

        def both() -> None:
            with files.replacing(file, overwrite=False) as temporary:
                temporary.write_text("ours")
                file.write_text("theirs")

        with pytest.raises(InputError, match="exists already"):
            both()
        assert file.read_text() == "theirs"
        assert [one.name for one in tmp_path.iterdir()] == ["a.csv"]

    def test_where_and_what_cannot_be_written(self, tmp_path: Path) -> None:
        record = self.record()
        for target, says in (
            (tmp_path / "no" / "a.csv", "there is no folder"),
            (tmp_path, "written as .csv"),
            (tmp_path / "a.xlsx", "written as .csv"),
        ):
            with pytest.raises(InputError, match=says):
                write(record, target)
        with pytest.raises(InputError, match=r"write \.h5"):
            write([record, record.rename("other")], tmp_path / "a.csv")
        with pytest.raises(InputError, match="rename"):
            write(record.rename("two\nlines"), tmp_path / "a.csv")
        odd = record.with_(channels={"a,b": record.time})
        with pytest.raises(InputError, match="rename"):
            write(odd, tmp_path / "a.csv")
        assert list(tmp_path.iterdir()) == []


def only_input_errors(file: Path, content: bytes) -> None:
    file.write_bytes(content)
    with contextlib.suppress(InputError):
        assert len(read(file)) >= 8


@settings(max_examples=150, deadline=None)
@given(content=st.binary(max_size=400) | st.text(max_size=200).map(lambda text: text.encode()))
def test_garbage_is_only_ever_an_input_error(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    folder = tmp_path_factory.getbasetemp()
    only_input_errors(folder / "garbage.csv", content)


CELL = st.sampled_from(
    ["0", "1", "-2.5", "1e400", "nan", "inf", "", "x", "1,5", "#", '"', "0x1", "1 2", "[V]", "١"]
) | st.integers(-9, 99).map(str)


@settings(max_examples=150, deadline=None)
@given(
    header=st.sampled_from(
        [HEADER, "t [s] u [V] y [m]", "t [s];u [V];y [m]", "a,b,c", "t [s],u [V],y [m],"]
    ),
    table=st.lists(st.lists(CELL, min_size=2, max_size=4), max_size=14),
    separator=st.sampled_from([",", ";", " "]),
    signature=st.sampled_from(["", "# piezo_opt record\n# period: x\n", "# piezo_opt record\n"]),
)
def test_near_tables_are_only_ever_read_or_input_errors(
    tmp_path_factory: pytest.TempPathFactory,
    header: str,
    table: list[list[str]],
    separator: str,
    signature: str,
) -> None:
    lines = [header, *(separator.join(row) for row in table)]
    file = tmp_path_factory.getbasetemp() / "near.csv"
    only_input_errors(file, (signature + "\n".join(lines)).encode())
