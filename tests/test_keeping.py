"""What is kept between processes: found again, never believed blindly, never in the way."""

from __future__ import annotations

import os
from pathlib import Path
from time import time

import pytest

from piezo_opt.errors import InputError
from piezo_opt.keeping import cache_directory, kept, own_directory, prune, used
from piezo_opt.simulation.compiler import load


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache directory of the test's own."""
    directory = tmp_path / "cache"
    monkeypatch.setenv("PIEZO_OPT_CACHE", str(directory))
    return directory


class Maker:
    """Makes numbers, and counts how many."""

    def __init__(self) -> None:
        self.made = 0

    def asked(self, origin: str, kind: str = "squares") -> int:
        def make() -> int:
            self.made += 1
            return int(origin) ** 2

        return kept(kind, origin, make, str, int)


def files(cache: Path) -> list[Path]:
    return sorted(file for file in cache.rglob("*") if file.is_file())


def test_a_thing_is_made_once_and_another_one_again(cache: Path) -> None:
    maker = Maker()
    assert [maker.asked(origin) for origin in ("3", "3", "4", "3", "4")] == [9, 9, 16, 9, 16]
    assert maker.made == 2
    assert Maker().asked("3") == 9
    assert maker.asked("3", kind="others") == 9
    assert maker.made == 3
    assert len(files(cache)) == 3


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_what_was_cut_off_or_changed_is_made_again(cache: Path, share: float) -> None:
    maker = Maker()
    maker.asked("12345")
    (file,) = files(cache)
    whole = file.read_bytes()
    for spoilt in (whole[: int(share * len(whole))], whole[:-1] + b"7", b"\xff" + whole[1:]):
        made = maker.made
        file.write_bytes(spoilt)
        assert maker.asked("12345") == 12345**2
        assert maker.made == made + 1
        assert file.read_bytes() == whole


def test_where_nothing_can_be_written_nothing_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PIEZO_OPT_CACHE", str(tmp_path / ("long" * 100)))  # no file system has it
    maker = Maker()
    assert [maker.asked("5"), maker.asked("5")] == [25, 25]
    assert maker.made == 2


def test_what_could_not_be_made_leaves_nothing(cache: Path) -> None:
    with pytest.raises(ValueError, match="not a number"):
        Maker().asked("not a number")
    assert not files(cache)


def test_the_cache_is_where_the_user_says(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("PIEZO_OPT_CACHE", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_directory() == tmp_path / "piezo_opt"
    monkeypatch.setenv("PIEZO_OPT_CACHE", str(tmp_path / "other"))
    assert cache_directory() == tmp_path / "other"
    monkeypatch.delenv("PIEZO_OPT_CACHE")
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_directory() == tmp_path / ".cache" / "piezo_opt"


def test_the_directory_is_the_user_s_alone(cache: Path) -> None:
    Maker().asked("3")
    assert cache.stat().st_mode & 0o777 == 0o700
    cache.chmod(0o777)
    with pytest.raises(InputError, match="Others can write to the cache"):
        Maker().asked("4")
    cache.chmod(0o770)
    with pytest.raises(InputError, match="Others can write"):
        load("double po_run(double x) { return x; }")
    assert len(files(cache)) == 1


def test_a_directory_that_others_can_enter_is_closed_and_what_they_could_write_goes(
    cache: Path,
) -> None:
    maker = Maker()
    maker.asked("3", kind="mine")
    maker.asked("3", kind="open")
    for name, mode in (("mine", 0o755), ("open", 0o777)):
        (cache / name).chmod(mode)
    link = cache / "link"
    link.symlink_to(cache / "mine")
    cache.chmod(0o755)
    assert own_directory() == cache
    assert cache.stat().st_mode & 0o777 == 0o700
    assert (cache / "mine").is_dir()
    assert not (cache / "open").exists()
    made = maker.made
    assert maker.asked("3", kind="mine") == 9
    assert maker.made == made
    assert maker.asked("3", kind="open") == 9
    assert maker.made == made + 1


@pytest.mark.parametrize("below", ["", "folder"])
def test_a_cache_that_is_a_file_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, below: str
) -> None:
    (tmp_path / "file").write_text("kept")
    monkeypatch.setenv("PIEZO_OPT_CACHE", str(tmp_path / "file" / below))
    with pytest.raises(InputError, match="is no directory: set PIEZO_OPT_CACHE"):
        own_directory()
    assert (tmp_path / "file").read_text() == "kept"


def test_a_directory_of_somebody_else_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PIEZO_OPT_CACHE", str(tmp_path))
    own = os.getuid()
    monkeypatch.setattr(os, "getuid", lambda: own + 1)
    with pytest.raises(InputError, match="belongs to another user"):
        Maker().asked("3")


def test_what_is_old_too_much_or_half_made_goes_once_a_day(cache: Path) -> None:
    def file(name: str, days: float, size: int = 1000) -> Path:
        path = cache / name / "x.so"
        path.parent.mkdir(parents=True)
        path.write_bytes(b"x" * size)
        for one in (path, path.parent):
            os.utime(one, (time() - 86400.0 * days,) * 2)
        return path

    old, new, middle = file("a", 61.0), file("b", 1.0), file("c", 30.0)
    killed, building = file(".build_k", 2.0), file(".build_b", 0.0)
    prune(cache, most_bytes=2500)
    assert [p.exists() for p in (old, new, middle, killed, building)] == [
        False, True, True, False, True,
    ]  # fmt: skip
    # Not again on the same day, and then what was used longest ago.
    prune(cache, most_bytes=1500)
    assert middle.exists()
    os.utime(cache / ".pruned", (time() - 86401.0,) * 2)
    used(middle)
    used(middle.parent)
    prune(cache, most_bytes=1500)
    assert (new.exists(), middle.exists()) == (False, True)
