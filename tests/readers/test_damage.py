"""Whatever is in a file, reading it ends in a record or in one sentence: text, trees, damage."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from nptdms import ChannelObject, TdmsWriter
from scipy import io

from piezo_opt.errors import InputError
from piezo_opt.readers import read, write
from piezo_opt.readers.probe import survives
from tests.readers.damage import damaged
from tests.readers.forms import HEADER, STEP, T, U, Y, put, rows
from tests.readers.test_binary_forms import LVM
from tests.readers.test_forms import FORMS

SHARED = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
SAID: dict[str, Any] = {"drive": "2 [V]", "position": "3 [um]", "rate": "1 kHz"}


def only_a_sentence(given_: Any, **said: Any) -> None:
    """A record of finite numbers, or an `InputError` of one line."""
    refused: InputError | None = None
    try:
        record = read(given_, **said)
        assert np.all(np.isfinite(record.position))
        assert all(isinstance(note, str) for note in record.notes)
    except InputError as error:
        refused = error
    assert "\n" not in str(refused)
    assert len(str(refused)) < 1200


CELLS = st.sampled_from(
    [
        *("", "x", "nan", "1,5", "1.234,5", "1,234", "12:00:01", "2020-01-01", "25:61:61"),
        *("1e999", '"', "#", "%", "[V]", "(s)", "V", "s", "um", "\u0661", "1 2", "-", "Start"),
        *("1;2", "\0", "\u00b5"),
    ]
) | st.floats(width=32).map(lambda v: f"{v:.6g}")
SEPARATORS = st.sampled_from([",", ";", "\t", " ", ", ", ",,"])


@SHARED
@given(
    head=st.lists(st.lists(CELLS, max_size=5), max_size=4),
    table=st.lists(st.lists(CELLS, min_size=1, max_size=5), max_size=12),
    separator=SEPARATORS,
    end=st.sampled_from(["\n", "\r\n", "\r", "\n\n"]),
    encoding=st.sampled_from(["utf-8", "utf-16", "utf-16-le", "utf-32", "cp1252"]),
    said=st.sampled_from([{}, SAID, {"decimal": ","}, {"decimal": "."}, {"rate": "even"}]),
)
def test_tables_of_anything(
    tmp_path_factory: pytest.TempPathFactory,
    head: list[list[str]],
    table: list[list[str]],
    separator: str,
    end: str,
    encoding: str,
    said: dict[str, Any],
) -> None:
    text = end.join(separator.join(row) for row in [*head, *table])
    file = tmp_path_factory.getbasetemp() / "any.csv"
    file.write_bytes(text.encode(encoding, errors="replace"))
    only_a_sentence(file, **said)


@SHARED
@given(
    form=st.sampled_from(sorted(FORMS)),
    place=st.floats(0, 1, exclude_max=True),
    piece=st.text(max_size=4) | CELLS,
    cut=st.booleans(),
)
def test_good_tables_with_one_wound(
    tmp_path_factory: pytest.TempPathFactory, form: str, place: float, piece: str, cut: bool
) -> None:
    lines = FORMS[form][0].splitlines(keepends=True)[:140]
    text = "".join(lines)
    at = int(place * len(text))
    wounded = text[:at] + piece + ("" if cut else text[at + 1 :])
    file = tmp_path_factory.getbasetemp() / "wounded.csv"
    file.write_bytes(wounded.encode("utf-8", errors="replace"))
    only_a_sentence(file)


@SHARED
@given(content=st.binary(max_size=300))
@pytest.mark.parametrize("suffix", [".csv", ".mat", ".h5", ".nc", ".lvm", ".tdms", ".parquet"])
def test_bytes_of_anything(
    tmp_path_factory: pytest.TempPathFactory, suffix: str, content: bytes
) -> None:
    file = tmp_path_factory.getbasetemp() / f"bytes{suffix}"
    file.write_bytes(content)
    only_a_sentence(file)


# Short ones: the library that draws trees prints them.
t_, u_, y_ = T[:60], U[:60], Y[:60]
ARRAYS = dict(
    enumerate(
        [
            *(
                t_,
                u_,
                y_,
                T[:7],
                np.zeros(0),
                np.zeros((3, 0)),
                np.float64(3.0),
                np.ones((2, 3, 4)),
            ),
            *(np.vstack([t_, u_, y_]), np.column_stack([t_, u_]), t_.astype("f4")),
            *((1e3 * t_).astype("i2"), u_ > 50, u_ * 1j, np.full(50, np.nan), np.full(50, np.inf)),
            np.array([7], dtype="u1"),
        ]
    )
)
NUMBERS = st.sampled_from(sorted(ARRAYS)).map(ARRAYS.__getitem__)
NAMES = st.sampled_from(["t", "u", "y", "time", "signals", "values", "label", "Time", "Data", "x1"])
LEAVES = NUMBERS | st.sampled_from(["", "V", "um", "text", "\u00b5m"])


def trees(leaves: st.SearchStrategy[Any], **more: Any) -> st.SearchStrategy[dict[str, Any]]:
    inner = st.recursive(
        leaves,
        lambda kids: st.dictionaries(NAMES, kids, max_size=4) | more.get("lists", st.nothing()),
        max_leaves=8,
    )
    return st.dictionaries(NAMES, inner, min_size=1, max_size=5)


@SHARED
@given(tree=trees(LEAVES), said=st.sampled_from([{}, SAID]), packed=st.booleans())
def test_trees_of_matlab(
    tmp_path_factory: pytest.TempPathFactory,
    tree: dict[str, Any],
    said: dict[str, Any],
    packed: bool,
) -> None:
    file = tmp_path_factory.getbasetemp() / "tree.mat"
    io.savemat(file, tree, do_compression=packed)
    only_a_sentence(file, **said)


ATTRIBUTES = st.dictionaries(
    st.sampled_from(
        [
            *("units", "unit", "scale_factor", "add_offset", "_FillValue", "missing_value", "dt"),
            *("MATLAB_class", "MATLAB_empty", "MATLAB_object_decode", "sample_rate"),
        ]
    ),
    st.sampled_from(
        ["V", "s", "um", "furlong", "", 0.0, 2.0, -1, np.nan, np.inf, b"V", b"\xff", "char"]
    )
    | st.just(np.array([1.0, 2.0]))
    | st.just(np.array(["V"], dtype="S1")),
    max_size=3,
)


@SHARED
@given(
    tree=trees(st.tuples(LEAVES, ATTRIBUTES)),
    suffix=st.sampled_from([".h5", ".mat", ".nc"]),
    said=st.sampled_from([{}, SAID]),
)
def test_trees_of_hdf5(
    tmp_path_factory: pytest.TempPathFactory,
    tree: dict[str, Any],
    suffix: str,
    said: dict[str, Any],
) -> None:
    def grow(group: Any, branch: dict[str, Any]) -> None:
        for name, value in branch.items():
            if isinstance(value, dict):
                grow(group.create_group(name), value)
            else:
                group[name] = value[0]
                group[name].attrs.update(value[1])

    file = tmp_path_factory.getbasetemp() / f"tree{suffix}"
    with h5py.File(file, "w", libver=("v110", "v110")) as content:
        grow(content, tree)
    with pytest.MonkeyPatch.context() as patch:
        # The file is whole, and a second process would take half a second for each.
        patch.setattr("piezo_opt.readers.hdf5.survives", lambda _: True)
        only_a_sentence(file, **said)


def test_references_in_a_circle(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.mat", "w", libver=("v110", "v110")) as content:
        group = content.create_group("s")
        field = group.create_dataset("f", (2,), dtype=h5py.ref_dtype)
        field[0], field[1] = group.ref, field.ref
        content["s/again"] = h5py.SoftLink("/s")
        content["gone"] = h5py.SoftLink("/nowhere")
        content["away"] = h5py.ExternalLink("/etc/passwd", "/")
    only_a_sentence(tmp_path / "a.mat")
    (tmp_path / "a.mat").rename(tmp_path / "a.h5")
    only_a_sentence(tmp_path / "a.h5")


FRAMED: dict[str, Any] = {
    **{"t": T, "u": U, "y": Y, "a": ["a"] * len(T), "n": [None] * len(T)},
    "b": [1, "b"] * (len(T) // 2),
}


@SHARED
@given(
    columns=st.dictionaries(
        st.sampled_from(
            ["time [s]", "voltage [V]", "displacement [um]", "x", "", "a [b]", "t (ms)"]
        ),
        st.sampled_from([T, U, Y, ["a"] * len(T), [None] * len(T), [1, "b"] * (len(T) // 2)]),
        max_size=5,
    )
)
def test_frames_of_anything(columns: dict[str, Any]) -> None:
    only_a_sentence(pd.DataFrame(columns))


def _samples(folder: Path) -> dict[str, tuple[Path, dict[str, Any]]]:
    """A good file of each binary kind, and what is said about it."""
    good = read(put(folder, "good.csv", HEADER + "\n" + rows()))
    write(good, folder / "own.h5")
    for name, version in (("old.h5", "earliest"), ("new.h5", "v110"), ("four.nc", "earliest")):
        with h5py.File(folder / name, "w", libver=(version, "v110")) as content:
            for own, unit, values in (("time", "s", T), ("run/voltage", "V", U), ("y", "um", Y)):
                content.create_dataset(own, data=values[:120], chunks=(40,), compression="gzip")
                content[own].attrs.update(units=unit, scale_factor=1.0)
    with h5py.File(folder / "v73.mat", "w", userblock_size=512) as content:
        for own, values in (("t", T), ("u", U), ("y", Y)):
            content[own] = values[None, :120]
    log = {"time": T[:120], "signals": [{"values": v[:120], "label": "x"} for v in (U, Y)]}
    io.savemat(folder / "five.mat", {"log": log})
    io.savemat(folder / "packed.mat", {"log": log, "m": np.vstack([T, U])}, do_compression=True)
    with io.netcdf_file(folder / "classic.nc", "w") as content:
        content.createDimension("n", 120)
        for own, values in (("time", T), ("voltage", U), ("y", Y)):
            content.createVariable(own, "d", ("n",))[:] = values[:120]
    channels = [
        ChannelObject("log", own, values[:120], {"unit_string": unit, "wf_increment": STEP})
        for own, values, unit in (("u", U, "V"), ("y", Y, "um"))
    ]
    with TdmsWriter(folder / "log.tdms") as writer:
        writer.write_segment(channels)
    frame = pd.DataFrame({"time [s]": T[:120], "voltage [V]": U[:120], "y [um]": Y[:120]})
    frame.to_parquet(folder / "log.parquet")
    head = LVM.format(sign=".", columns="One", names="X_Value\tvoltage\tdisplacement")
    put(folder, "log.lvm", head + "".join(rows("\t").splitlines(keepends=True)[:120]))
    files = [one for one in folder.iterdir() if one.name != "good.csv"]
    return {one.name: (one, SAID if one.suffix == ".mat" else {}) for one in files}


_READ_ALL = """
import json, os, sys
from piezo_opt.errors import InputError
from piezo_opt.readers import read
for line in sys.stdin:
    file, said = json.loads(line)
    began = sum(os.times()[:4])
    try:
        read(file, **said)
        told = "read"
    except InputError as error:
        told = "refused" if chr(10) not in str(error) else "two lines"
    except BaseException as error:
        told = f"{type(error).__name__}: {error}"
    print(json.dumps([file, told, sum(os.times()[:4]) - began]), flush=True)
"""


def _content(folder: Path) -> dict[Path, bytes | None]:
    """Every file below a folder with what is in it; None for folders."""
    return {one: one.read_bytes() if one.is_file() else None for one in folder.rglob("*")}


def test_damaged_copies_of_good_files(tmp_path: Path) -> None:
    """Read in a process of its own, so that a crash of a C library fails this test alone.

    Nothing is written: not to the files, beside them, where the process runs, or for a while.
    HDF5 files from elsewhere cost a process each and get fewer copies.
    """
    generator = np.random.default_rng(20)
    (tmp_path / "good").mkdir()
    work = []
    for name, (file, said) in _samples(tmp_path / "good").items():
        content = file.read_bytes()
        dear = name in ("old.h5", "new.h5", "four.nc", "v73.mat")
        for copy in range(3 if dear else 24):
            wounded = tmp_path / f"{file.stem}_{copy}{file.suffix}"
            wounded.write_bytes(damaged(content, generator))
            work.append(json.dumps([str(wounded), said]))
    (tmp_path / "here").mkdir()
    (tmp_path / "for_a_while").mkdir()
    before = _content(tmp_path)
    done = subprocess.run(
        [sys.executable, "-c", _READ_ALL],
        input="\n".join(work),
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
        cwd=tmp_path / "here",
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join(sys.path),
            "TMPDIR": str(tmp_path / "for_a_while"),
        },
    )
    assert _content(tmp_path) == before
    told = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(told) == len(work), f"the process ended at {work[len(told)]}: {done.stderr[-500:]}"
    assert [one for one in told if one[1] not in ("read", "refused")] == []
    # Of processors, the trying process' included: a loaded machine takes longer.
    assert max(seconds for _, _, seconds in told) < 10.0
    assert sum(what == "refused" for _, what, _ in told) > 0.3 * len(told)


class TestProbe:
    def test_what_hangs_or_crashes_is_refused(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        with h5py.File(tmp_path / "a.h5", "w") as content:
            content["time"] = T
        assert survives(tmp_path / "a.h5")
        monkeypatch.setattr("piezo_opt.readers.probe._READ_ALL", "import os; os.abort()")
        assert not survives(tmp_path / "a.h5")
        with pytest.raises(InputError, match=r"not a whole HDF5 file.*does not get to its end"):
            read(tmp_path / "a.h5")
        monkeypatch.setattr("piezo_opt.readers.probe._READ_ALL", "import time; time.sleep(60)")
        monkeypatch.setattr("piezo_opt.readers.probe._PATIENCE_S", 0.2)
        assert not survives(tmp_path / "a.h5")

    def test_only_files_from_elsewhere_are_tried(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr("piezo_opt.readers.probe._READ_ALL", "raise SystemExit(1)")
        write(read(put(tmp_path, "a.csv", HEADER + "\n" + rows())), tmp_path / "a.h5")
        assert len(read(tmp_path / "a.h5")) == len(T)
        assert survives(put(tmp_path, "b.h5", "nothing" * 200))
        for version in ("earliest", "v110"):
            for block in (0, 512, 8192):
                file = tmp_path / "c.h5"
                with h5py.File(file, "w", libver=(version, "v110"), userblock_size=block) as made:
                    made["time"] = T
                    made.attrs["units"] = "piezo"
                assert not survives(file)


def test_text_of_any_length_that_lies_in_a_loop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A heap of texts has no checksum, and an object in it of no length keeps the library busy."""
    monkeypatch.setattr("piezo_opt.readers.probe._PATIENCE_S", 1.5)
    with h5py.File(tmp_path / "a.h5", "w", libver=("v110", "v110")) as content:
        content["time"] = T
        content["time"].attrs["units"] = "s"
    whole = (tmp_path / "a.h5").read_bytes()
    size = whole.index(b"GCOL") + 24
    (tmp_path / "a.h5").write_bytes(whole[:size] + bytes(8) + whole[size + 8 :])
    with pytest.raises(InputError, match="does not get to its end"):
        read(tmp_path / "a.h5")
