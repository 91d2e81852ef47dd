"""Text in the forms in which instruments write it: the right numbers, and what was concluded."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from piezo_opt.errors import InputError
from piezo_opt.readers import read, read_campaign
from piezo_opt.units import quantity
from tests.readers.forms import HEADER, STEP, T, U, Y, check, put, rows


def refused(file: Path, *says: str, **said: Any) -> None:
    with pytest.raises(InputError) as caught:
        read(file, **said)
    sentence = str(caught.value)
    assert str(file) in sentence
    assert "\n" not in sentence
    for piece in says:
        assert piece in sentence, sentence


def numbered(head: str, tail: str = "") -> str:
    return head + "".join(
        f"{k},{u:.9g},{y:.9g}{tail}\n" for k, (u, y) in enumerate(zip(U, Y, strict=True))
    )


def celled(form: str) -> str:
    return "".join(form.format(t, u, y) for t, u, y in zip(T, U, Y, strict=True))


FORMS = {
    "brackets": (HEADER + "\n" + rows(), None),
    "parentheses": ("Time (s),Voltage (V),Displacement (um)\n" + rows(), "'Voltage' in V"),
    "slash": ("time / s;voltage / V;stroke / µm\n" + rows(";"), "'stroke' in µm"),
    "comma": ('"time, s";"voltage, V";"stroke, um"\n' + rows(";"), "'stroke' in um"),
    "quoted": ('"time, s","voltage, V","stroke, um"\n' + rows(), "'stroke' in um"),
    "underscore": ("time_s,voltage_V,displacement_um\n" + rows(), "'displacement' in um"),
    "units below": ("time,voltage,displacement\ns,V,um\n" + rows(), "units are those of row 2"),
    "units in brackets below": ("a;b;c\n[s];[V];[um]\n" + rows(";"), "units are those of row 2"),
    "oscilloscope": ("Time,Channel A,Channel B\n(s),(V),(um)\n\n" + rows(), "row 2"),
    "preamble": (
        "Model,S1\nSample interval,1.0E-03,s\n\nSource,CH1,CH2\nSecond,Volt,um\n" + rows(),
        "2 lines above the table were skipped",
    ),
    "long preamble": (
        "".join(f"Setting {k}: {k * 7}\n" for k in range(90)) + HEADER + "\n" + rows(),
        "90 lines above the table were skipped",
    ),
    "start and increment": (
        numbered("X,CH1,CH2,Start,Increment\nSequence,Volt,um,0.0E+00,1.0E-03\n", ",,"),
        "made from 'Increment': 0.001 s",
    ),
    "start and increment in the first row": (
        numbered("X,CH1 (V),CH2 (um),Start,Increment\n", ",,").replace(",,\n", ",0,0.001\n", 1),
        "made from 'Increment': 0.001 s",
    ),
    "rate above the table": (
        numbered("Sampling rate: 1 kHz\nindex,drive (V),travel (um)\n"),
        "made from 'Sampling rate': 0.001 s",
    ),
    "interval above the table": (
        numbered("Sample interval [ms],1.0\nindex,drive (V),travel (um)\n"),
        "made from 'Sample interval': 0.001 s",
    ),
    "trailing comma": (HEADER + ",\n" + rows(tail=","), None),
    "trailing commas in the rows only": (HEADER + "\n" + rows(tail=",,"), None),
    "decimal comma": (HEADER.replace(",", ";") + "\n" + rows(";", ","), "with a comma"),
    "decimal comma and tabs": (HEADER.replace(",", "\t") + "\n" + rows("\t", ","), "with a comma"),
    "decimal comma and blanks": (HEADER.replace(",", " ") + "\n" + rows("  ", ","), "with a comma"),
    "decimal comma in quotes": (
        HEADER + "\n" + '"' + rows('","', ",", '"').replace("\n", '\n"')[:-1],
        "with a comma",
    ),
    "windows": ((HEADER + "\n" + rows()).replace("\n", "\r\n"), None),
    "old mac": ((HEADER + "\n" + rows()).replace("\n", "\r"), None),
    "comment of matlab": ("% " + HEADER + "\n" + rows(), None),
    "comment of numpy": ("# t [s] u [V] y [um]\n" + rows(" "), None),
    "text beside": (
        HEADER + ",state\n" + rows(tail=",ok"),
        "Column 'state' holds text and was left out",
    ),
    "units in the cells": (
        "time,voltage,displacement\n" + celled("{:.9g} s,{:.9g} V,{:.9g} um\n"),
        "The cells of column 'displacement' carry their units; it was read in m.",
    ),
    "units in the cells behind decimal commas": (
        "time;voltage;displacement\n" + celled("{:.9g}s;{:.9g}V;{:.9g}µm\n").replace(".", ","),
        "'voltage' carry their units",
    ),
    "units in the cells between blanks": (
        "time voltage displacement\n" + celled("{:.9g}s {:.9g}V {:.9g}um\n"),
        "'time' carry their units",
    ),
    "a unit of its own in every cell": (
        "time,voltage,displacement\n"
        + "".join(
            f"{1e3 * t:.9g} ms,{u:.9g} V," + (f"{1e3 * y:.9g} nm\n" if k % 2 else f"{y:.9g} um\n")
            for k, (t, u, y) in enumerate(zip(T, U, Y, strict=True))
        ),
        "'displacement' carry their units",
    ),
    "braces": ("time {s},voltage {V},stroke {um}\n" + rows(), "'stroke' in um"),
    "angles": ("time <s>,voltage <V>,stroke <um>\n" + rows(), "'stroke' in um"),
    "units in front": ("[s] time,[V] voltage,[um] stroke\n" + rows(), None),
    "single quotes": ("'time [s]','voltage [V]','stroke [um]'\n" + rows(), None),
    "names behind commas over semicolons": (HEADER + "\n" + rows(";"), None),
    "dashes below": (HEADER + "\n---,---,---\n" + rows(), None),
    "dashes below units": ("a,b,c\ns,V,um\n===,===,===\n" + rows(), "units are those of row 2"),
    "exponents of Fortran": (
        HEADER + "\n" + celled("{:.9e},{:.9e},{:.9e}\n").replace("e", "D"),
        None,
    ),
    "row names of R": (
        '"time [s]" "voltage [V]" "stroke [um]"\n'
        + "".join(
            f'"{k + 1}" {t:.9g} {u:.9g} {y:.9g}\n'
            for k, (t, u, y) in enumerate(zip(T, U, Y, strict=True))
        ),
        None,
    ),
    "the clock beside every channel": (
        "time [s],voltage [V],time [s],displacement [um]\n"
        + "".join(f"{t:.9g},{u:.9g},{t:.9g},{y:.9g}\n" for t, u, y in zip(T, U, Y, strict=True)),
        None,
    ),
    "an end of file of old systems": (HEADER + "\n" + rows() + "\x1a", None),
    "room that was reserved": (HEADER + "\n" + rows() + "\0" * 700, "ends with zeros"),
    "words": (
        "Zeit,Spannung,Weg\nSekunden,Volt,Mikrometer\n".replace("Mikro", "micro") + rows(),
        "2",
    ),
}


@pytest.mark.parametrize("form", FORMS)
def test_a_form_holds_the_right_numbers(tmp_path: Path, form: str) -> None:
    text, note = FORMS[form]
    record = read(put(tmp_path, "a.csv", text))
    check(record)
    if note is None:
        assert record.notes == ()
    else:
        assert any(note in said for said in record.notes), record.notes
    assert record.remarks[: len(record.notes)] == record.notes


@pytest.mark.parametrize(
    ("encoding", "note"),
    [
        ("utf-8", ()),
        ("utf-8-sig", ()),
        ("utf-16", ("The text is in UTF-16.",)),
        ("utf-16-le", ("The text is in UTF-16-LE.",)),
        ("utf-16-be", ("The text is in UTF-16-BE.",)),
        ("utf-32", ("The text is in UTF-32.",)),
        ("latin-1", ("The text is not in UTF-8 and was read as Latin-1.",)),
    ],
)
def test_encodings(tmp_path: Path, encoding: str, note: tuple[str, ...]) -> None:
    text = HEADER.replace("um", "\u00b5m") + "\n" + rows()
    record = read(put(tmp_path, "a.csv", text, encoding))
    check(record)
    assert record.notes == note


@pytest.mark.parametrize(
    "instant",
    [
        "2020-01-01T00:00:{:06.3f}",
        "2020-01-01 11:22:{:06.3f}",
        "2020-01-01T11:22:{:06.3f}Z",
        "2020-01-01T11:22:{:06.3f}+01:00",
        "2020/01/01 11:22:{:06.3f}",
        "31.12.2020 11:22:{:06.3f}",
        "23:59:{:06.3f}",
        "11:59:{:06.3f} PM",
        "12/31/2020 11:22:{:06.3f}",
        "31/12/2020 11:22:{:06.3f}",
        "07/07/2020 11:22:{:06.3f}",
        "22:{:06.3f}",
        "36:15:{:06.3f}",
    ],
)
def test_clock_times(tmp_path: Path, instant: str) -> None:
    lines = "".join(
        f"{instant.format(t)},{u:.9g},{y:.9g}\n" for t, u, y in zip(T, U, Y, strict=True)
    )
    record = read(put(tmp_path, "a.csv", "time,voltage [V],displacement [um]\n" + lines))
    check(record)
    assert "clock times" in record.notes[-1]


def test_a_clock_goes_on_over_midnight(tmp_path: Path) -> None:
    seconds = 86399.5 + T
    for dated in (False, True):
        lines = ""
        for s, u, y in zip(seconds, U, Y, strict=True):
            day, left = divmod(s, 86400.0)
            clock = f"{int(left // 3600):02}:{int(left % 3600 // 60):02}:{left % 60:06.3f}"
            lines += f"{f'2020-02-{28 + int(day)} ' if dated else ''}{clock},{u:.9g},{y:.9g}\n"
        check(read(put(tmp_path, "a.csv", "time,voltage [V],displacement [um]\n" + lines)))


def test_milliseconds_behind_a_colon(tmp_path: Path) -> None:
    lines = "".join(
        f"10:00:00:{k:03d},{u:.9g},{y:.9g}\n" for k, (u, y) in enumerate(zip(U, Y, strict=True))
    )
    check(read(put(tmp_path, "a.csv", "time,voltage [V],displacement [um]\n" + lines)))


@pytest.mark.parametrize(
    ("instant", "says"),
    [
        ("2020-02-30 10:00:{:06.3f}", "'2020-02-30 10:00:00.000' is not a time"),
        ("13/13/2020 10:00:{:06.3f}", "'13/13/2020 10:00:00.000' is not a time"),
        ("2020-01-01 25:00:{:06.3f}", "is not a time"),
    ],
)
def test_instants_that_no_calendar_has(tmp_path: Path, instant: str, says: str) -> None:
    lines = celled(instant + ",{:.9g},{:.9g}\n")
    refused(put(tmp_path, "a.csv", "time,voltage [V],displacement [um]\n" + lines), "row 2", says)


def test_a_date_that_may_be_two_is_read_within_one_day_only(tmp_path: Path) -> None:
    head = "time,voltage [V],displacement [um]\n"
    lines = celled("01/02/2020 10:00:{:06.3f},{:.9g},{:.9g}\n")
    later = lines.replace("01/02/2020", "02/02/2020")
    refused(put(tmp_path, "a.csv", head + lines + later), "row 1002", "is not a time")
    later = lines.replace("01/02/2020", "01/13/2020").replace("10:00:", "11:00:")
    lines = lines.replace("01/02/2020", "01/12/2020")
    # The second day says that the month comes first.
    record = read(put(tmp_path, "b.csv", head + lines + later))
    assert record.time[1000] == pytest.approx(25 * 3600.0)


@pytest.mark.parametrize(("unit", "first"), [("s", 1.6e9), ("ms", 1.6e12), ("d", 44197.5)])
def test_a_clock_of_another_age_is_counted_from_its_first_instant(
    tmp_path: Path, unit: str, first: float
) -> None:
    step = STEP / quantity(f"1 {unit}", "s")
    lines = "".join(
        f"{first + k * step:.12f},{u:.9g},{y:.9g}\n"
        for k, (u, y) in enumerate(zip(U, Y, strict=True))
    )
    record = read(put(tmp_path, "a.csv", f"time [{unit}],voltage [V],displacement [um]\n" + lines))
    np.testing.assert_allclose(record.time, T, atol=2e-6)
    assert "counted from its first value" in record.notes[0]


def test_another_clock_is_told(tmp_path: Path) -> None:
    lines = "".join(
        f"{t:.9g},{u:.9g},{t + 5e-4:.9g},{y:.9g}\n" for t, u, y in zip(T, U, Y, strict=True)
    )
    file = put(tmp_path, "a.csv", "t1 [s],voltage [V],t2 [s],displacement [um]\n" + lines)
    refused(file, "time='t1 [s]' or time='t2 [s]'")
    record = read(file, time="t1")
    assert record.notes == (
        "Column 't2 [s]' is a clock as well, off by up to 500 us from 't1 [s]', which was taken "
        "for all signals.",
    )


@pytest.mark.parametrize("blank", ["\u00a0", "\u202f", "'", "\u2019"])
def test_digits_in_groups_and_a_minus_that_is_no_hyphen(tmp_path: Path, blank: str) -> None:
    lines = "".join(
        f"{t:.3f};{1000 + u:,.6f};{-y:.9f}\n".replace(",", blank).replace(".", ",")
        for t, u, y in zip(T, U, Y, strict=True)
    ).replace("-", "\u2212")
    record = read(put(tmp_path, "a.csv", HEADER.replace(",", ";") + "\n" + lines))
    np.testing.assert_allclose(record.drive, 1000 + U, rtol=1e-9)
    np.testing.assert_allclose(record.position, -1e-6 * Y, rtol=1e-6, atol=1e-12)


class TestUnitsInCells:
    HEAD = "time,voltage,displacement\n"

    def test_another_kind_of_unit_is_refused_by_row(self, tmp_path: Path) -> None:
        lines = celled("{:.9g} s,{:.9g} V,{:.9g} um\n")
        kind = "is not a number with a unit of the same kind as above"
        for cell in ("3 A", "3", "V", "3 furlongs"):
            text = self.HEAD + lines + f"1.5 s,{cell},3 um\n"
            refused(put(tmp_path, "a.csv", text), "row 1002, column 'voltage'", kind, repr(cell))

    def test_a_header_of_another_kind_is_refused(self, tmp_path: Path) -> None:
        text = "time,voltage,displacement [V]\n" + celled("{:.9g} s,{:.9g} V,{:.9g} um\n")
        refused(put(tmp_path, "a.csv", text), "'displacement' is headed [V]", "'")


class TestAsking:
    def test_commas_of_decimals_or_thousands(self, tmp_path: Path) -> None:
        lines = "".join(f"{t:.3f};{1 + k % 7},{k % 7}50;{k % 9}.5\n" for k, t in enumerate(T))
        lines = lines.replace(".", "\0").replace("\0", ",")
        text = "time [s];voltage [V];displacement [um]\n"
        # 1,450 is one and a half or a thousand and a half where nothing else says which.
        whole = "".join(f"{k + 1},000;{1 + k % 7},{k % 7}50;{k % 9 + 1},500\n" for k in range(99))
        file = put(tmp_path, "a.csv", text + whole)
        refused(file, "row 2", "'1,000' is 1.000 with a comma for decimals and 1000", "decimal='.'")
        assert read(file, decimal=",").drive[1] == pytest.approx(2.15)
        thousands = read(file, decimal=".")
        assert thousands.drive[1] == pytest.approx(2150.0)
        assert "Commas were read as signs of thousands." in thousands.notes
        # A zero before the comma is no group of digits.
        assert read(put(tmp_path, "b.csv", text + lines)).drive[1] == pytest.approx(2.15)

    def test_no_clock(self, tmp_path: Path) -> None:
        lines = "".join(f"{u:.9g},{y:.9g}\n" for u, y in zip(U, Y, strict=True))
        file = put(tmp_path, "a.csv", "voltage [V],displacement [um]\n" + lines)
        refused(file, "no column is the time", "rate='1 kHz'")
        check(read(file, rate="1 kHz"))
        check(read(file, rate=1000))
        assert read(file, rate="1 kHz").notes == (
            "The clock is even, at the 1000 Hz that were given.",
        )

    def test_no_header(self, tmp_path: Path) -> None:
        file = put(tmp_path, "a.csv", rows())
        refused(file, "row 1 has numbers", "drive='2 [V]'")
        check(read(file, time="1 [s]", drive="2 [V]", position="3 [um]"))
        check(read(file, rate="1 kHz", drive="2 [V]", position="3 [um]"))

    def test_columns_by_number_beside_names(self, tmp_path: Path) -> None:
        file = put(tmp_path, "a.csv", "time [s],in [V],monitor [V],out [um]\n" + "".join(
            f"{t:.9g},{u:.9g},{u + 1:.9g},{y:.9g}\n" for t, u, y in zip(T, U, Y, strict=True)
        ))  # fmt: skip
        refused(file, "drive='in [V]' or drive='monitor [V]'")
        check(read(file, drive="2"))
        assert read(file, drive="3").drive[0] == U[0] + 1
        refused(file, "no column '7'", drive="7")

    def test_a_clock_with_too_few_digits(self, tmp_path: Path) -> None:
        lines = "".join(f"{t:.2f},{u:.9g},{y:.9g}\n" for t, u, y in zip(T, U, Y, strict=True))
        file = put(tmp_path, "a.csv", HEADER + "\n" + lines)
        refused(file, "too few digits", "rate='1 kHz'", "rate='even'")
        check(read(file, rate="1 kHz"))
        even = read(file, rate="even")
        assert even.step == pytest.approx(STEP, rel=2e-3)
        assert even.uniform

    def test_a_clock_that_restarts(self, tmp_path: Path) -> None:
        file = put(tmp_path, "a.csv", HEADER + "\n" + rows() + rows())
        refused(file, "row 1002", "begins anew there, so these are 2 records", "record='all'")
        for one in (read(file, record="2"), *read_campaign(file, trim="0.1 s:")):
            assert "row 1002: the file was read as 2 records." in one.notes[0]
        check(read(file, record="2"))
        assert read_campaign(file).names == ("a 1", "a 2")
        assert [len(one) for one in read_campaign(file, trim="0.1 s:")] == [900, 900]
        assert len(read(file, rate="1 kHz")) == 2000
        refused(file, "numbered from 1", "'3'", record="3")

    def test_rows_in_a_wrong_order_are_no_records(self, tmp_path: Path) -> None:
        lines = rows().splitlines(keepends=True)
        file = put(tmp_path, "a.csv", HEADER + "\n" + "".join([*lines[500:], *lines[600:900]]))
        refused(file, "put the rows in the order of time")
        # Two rows before the fall are no run.
        file = put(tmp_path, "b.csv", HEADER + "\n" + "".join([*lines[5:7], *lines]))
        refused(file, "put the rows in the order of time")

    @pytest.mark.parametrize(
        ("bad", "says"),
        [
            ("0.5005,1;2,3", "'1;2' is not a number"),
            ("0.5005,1", "row 502 has 2 cells but the header has 3"),
            ("0.5005,1,2,3", "row 502 has 4 cells but the header has 3"),
        ],
    )
    def test_a_bad_row_far_below(self, tmp_path: Path, bad: str, says: str) -> None:
        lines = rows().splitlines()
        lines.insert(500, bad)
        refused(put(tmp_path, "a.csv", "\n".join([HEADER, *lines])), says)
        spoiled = "\n".join([HEADER + ",note", *[f"{one},x" for one in lines]])
        refused(put(tmp_path, "b.csv", spoiled), "row 502")

    def test_a_decimal_comma_in_one_row_of_many(self, tmp_path: Path) -> None:
        lines = rows(";").splitlines()
        lines[500] = lines[500].replace(".", ",")
        text = "\n".join([HEADER.replace(",", ";"), *lines])
        refused(put(tmp_path, "a.csv", text), "row 502", "write decimals with a point")


class TestWhatIsWrong:
    def test_a_header_that_comes_again(self, tmp_path: Path) -> None:
        text = HEADER + "\n" + rows()
        refused(put(tmp_path, "a.csv", text + text), "row 1002 is a header again")
        refused(put(tmp_path, "b.csv", text + "\ufeff" + text), "row 1002 is a header again")

    def test_words_below_the_table(self, tmp_path: Path) -> None:
        text = HEADER + "\n" + rows() + "\nEnd of file\n"
        refused(put(tmp_path, "a.csv", text), "row 1003 has 1 cell ", "no row of numbers: remove")

    def test_a_header_with_too_few_names(self, tmp_path: Path) -> None:
        text = HEADER + "\n" + rows(tail=",1.5")
        refused(put(tmp_path, "a.csv", text), "row 2 has 4 cells", "give every column one name")

    def test_a_signal_that_was_sampled_more_slowly(self, tmp_path: Path) -> None:
        lines = "".join(
            f"{t:.9g},{u:.9g},{'' if k % 4 else f'{y:.9g}'}\n"
            for k, (t, u, y) in enumerate(zip(T, U, Y, strict=True))
        )
        refused(
            put(tmp_path, "a.csv", HEADER + "\n" + lines), "'displacement [um]' has empty cells"
        )

    @pytest.mark.parametrize(
        ("said", "says"),
        [
            ({"rate": "1"}, "rate='1' has no unit"),
            ({"gain": "1 V"}, "gain='1 V' is not a plain number"),
            ({"scale": "um"}, "scale='um' does not start with a number"),
            ({"scale": "2 foo"}, "scale='2 foo': unknown unit 'foo'"),
            ({"trim": "2 s:3"}, "trim='3' has no unit"),
            ({"drive": " "}, "drive is an empty text"),
        ],
    )
    def test_the_option_is_named(self, tmp_path: Path, said: dict[str, Any], says: str) -> None:
        with pytest.raises(InputError, match=says):
            read(put(tmp_path, "a.csv", HEADER + "\n" + rows()), **said)


class TestTreating:
    def test_trim(self, tmp_path: Path) -> None:
        file = put(tmp_path, "a.csv", HEADER + "\n" + rows())
        part = read(file, trim="0.2 s:0.7 s")
        np.testing.assert_allclose(part.time, T[200:700], atol=1e-12)
        np.testing.assert_array_equal(part.drive, U[200:700])
        assert part.notes == ("Samples 201 to 700 of 1000 were kept.",)
        assert len(read(file, trim="900 ms:")) == 100
        assert len(read(file, trim=":0.3 s")) == 300
        for wrong, says in (
            ("0.2 s", "no stretch"),
            (":", "no stretch"),
            ("5 s:6 s", "runs from 0 s to 0.999 s"),
            ("0.7 s:0.2 s", "ends before it begins"),
            ("0.2:0.7", "has no unit"),
        ):
            with pytest.raises(InputError, match=says):
                read(file, trim=wrong)

    def test_what_is_cut_away_may_be_broken_and_rows_keep_their_names(self, tmp_path: Path) -> None:
        lines = rows().splitlines()
        lines[3] = "0.003,nan,0"
        lines[900] = "0.9,inf,0"
        file = put(tmp_path, "a.csv", "\n".join([HEADER, *lines]))
        assert len(read(file, trim="0.1 s:0.8 s")) == 700
        refused(file, "row 902", trim="0.1 s:")

    def test_every(self, tmp_path: Path) -> None:
        """A tone above the new Nyquist frequency is gone, not folded back; what is slow stays."""
        fast = Y + 0.5 * np.sin(2 * np.pi * 410.0 * T)
        lines = "".join(f"{t:.9g},{u:.9g},{y:.9g}\n" for t, u, y in zip(T, U, fast, strict=True))
        record = read(put(tmp_path, "a.csv", HEADER + "\n" + lines), every=5)
        assert record.step == pytest.approx(5e-3)
        middle = slice(20, -20)
        np.testing.assert_allclose(record.position[middle], 1e-6 * Y[::5][middle], atol=5e-8)
        assert "Every 5th sample was kept, after a low-pass filter at 80 Hz" in record.notes[-1]

    def test_gain_and_scale(self, tmp_path: Path) -> None:
        text = "time [s],command [V],sensor [V]\n" + "".join(
            f"{t:.9g},{u / 15:.12g},{y / 2.5:.12g}\n" for t, u, y in zip(T, U, Y, strict=True)
        )
        file = put(tmp_path, "a.csv", text)
        record = read(file, gain=15, scale="2.5 um/V", position="sensor")
        check(record)
        assert record.notes == (
            "The drive was multiplied by 15, the gain of the amplifier.",
            "The reading was multiplied by 2.5 um/V.",
        )
        check(read(file, gain="15 V/V", scale="2500 nm/V"))
        wrong: dict[str, Any] = {"gain": 0, "scale": "um", "every": 0, "rate": "-1 Hz"}
        for name, value in wrong.items():
            with pytest.raises(InputError, match=name if name != "scale" else "number"):
                read(file, **{name: value})
