"""What is kept between processes: found again, never believed blindly, never in the way."""

from __future__ import annotations

from pathlib import Path

import pytest

from piezo_opt.keeping import cache_directory, kept


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
    taken = tmp_path / "a file"
    taken.touch()
    monkeypatch.setenv("PIEZO_OPT_CACHE", str(taken))
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
