"""What a record shows about itself is found, and a remedy that is followed does no harm.

Each record is one plain record with one thing wrong. The plant is a Bouc-Wen loop written out here:
it shares nothing with the package.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from piezo_opt import datasets
from piezo_opt.effects.model import Model
from piezo_opt.effects.output.offset import Offset
from piezo_opt.effects.strain.bouc_wen import BoucWen
from piezo_opt.effects.strain.piezo_gain import PiezoGain
from piezo_opt.errors import InputError
from piezo_opt.identification import Identification, solve
from piezo_opt.measurement import Campaign, FloatArray, Measurement, Weight, check
from piezo_opt.readers import read, write

N = 3000
NOISE = 3e-9
MODEL: Model = PiezoGain() + BoucWen() + Offset()


def loop(u: FloatArray) -> FloatArray:
    """d u - h with h' = alpha u' - beta |u'| h - gamma u' |h|, in 10 steps a sample."""
    h, out = 0.0, np.empty_like(u)
    out[0] = 2e-7 * u[0]
    for k in range(1, u.size):
        step = (u[k] - u[k - 1]) / 10
        for _ in range(10):
            h += 6e-8 * step - 0.02 * abs(step) * h - 0.004 * step * abs(h)
        out[k] = 2e-7 * u[k] - h
    return out


T = np.arange(N) / 1000.0
U = 50 + 30 * np.sin(2 * np.pi * 2.1 * T) + 15 * np.sin(2 * np.pi * 5.3 * T)
Y = loop(U) + NOISE * np.random.default_rng(7).standard_normal(N)


def record(t: FloatArray = T, u: FloatArray = U, y: FloatArray = Y) -> Measurement:
    return Measurement(t, u, y, name="plain")


def with_readings(value: float, *where: slice) -> Measurement:
    y = Y.copy()
    for one in where:
        y[one] = value
    return record(y=y)


def left(records: Campaign) -> float:
    """Error of the true model [m]."""
    return solve(Identification(MODEL, records)).rms


def noisy_rail() -> Measurement:
    y = Y.copy()
    for k, n in ((900, 2), (1400, 6), (2333, 3)):
        y[k : k + n] = 4e-5 + NOISE * np.arange(n)
    return record(y=y)


def stopped() -> Measurement:
    """The sensor stops at a rising drive for 20 ms, and then goes on where it should be."""
    y = Y.copy()
    y[1012:1052] = y[1011]
    return record(y=y)


def twice() -> Measurement:
    u, y = U.copy(), Y.copy()
    u[1500:1756], y[1500:1756] = u[1244:1500], y[1244:1500]
    return record(u=u, y=y)


def broad() -> tuple[FloatArray, FloatArray]:
    """A drive that moves at 1 to 60 Hz, and the reading of it."""
    rng = np.random.default_rng(3)
    lines = np.arange(1, 60)
    phases = rng.uniform(0, 2 * np.pi, lines.size)
    u = 50 + 4 * np.sum(np.sin(2 * np.pi * np.outer(T, lines) + phases), axis=1)
    return u, loop(u) + NOISE * rng.standard_normal(N)


def early(samples: int) -> Measurement:
    u, y = broad()
    return record(T[:-samples], u[:-samples], y[samples:])


JITTER = 5e-5 * np.random.default_rng(1).uniform(-1, 1, N)
KINDS: dict[str, tuple[Callable[[], Measurement], Weight, tuple[str, ...]]] = {
    "overload": (
        lambda: with_readings(9.9e31, slice(700, 703), slice(1500, 1501)),
        Weight.MENDED,
        ("4 readings", "701 to 703", "1501 (1.5 s)"),
    ),
    "dropout": (
        lambda: with_readings(0.0, slice(1000, 1012)),
        Weight.MENDED,
        ("12 readings", "1001 to 1012 (1 s)"),
    ),
    "frozen": (stopped, Weight.MENDED, ("40 equal readings", "1013 to 1052")),
    "jitter": (lambda: record(t=T + JITTER), Weight.MENDED, ("28.93 us rms", "steps of 1 ms")),
    "jump": (lambda: record(y=Y + 4e-6 * (T >= 1.5)), Weight.REFUSED, ("1501 (1.5 s)", "4.")),
    "wrapped": (
        lambda: record(y=(Y - Y.min()) % 5e-6),
        Weight.REFUSED,
        ("by 5 um", "wraps"),
    ),
    "slow_drive": (
        lambda: record(u=U[(np.arange(N) // 10) * 10]),
        Weight.REFUSED,
        ("every 10 samples", "100 Hz"),
    ),
    "block_twice": (twice, Weight.REFUSED, ("256 samples", "1501 to 1756", "right after itself")),
    "computed": (lambda: record(y=2e-7 * U), Weight.REFUSED, ("the drive times 2e-07 m/V",)),
    "unit": (lambda: record(y=1e6 * Y), Weight.REFUSED, ("unit is wrong", "as um")),
    "drive_unit": (lambda: record(u=1e6 * U), Weight.REFUSED, ("no amplifier",)),
    "lead": (lambda: early(3), Weight.REFUSED, ("3 samples (3 ms) or more before",)),
    "butterfly": (
        lambda: record(u=U - 50, y=4e-6 * np.tanh((U - 50) / 20) ** 2 + 1e-3 * Y),
        Weight.REFUSED,
        ("even in the drive",),
    ),
    "quantised_drive": (
        lambda: record(u=0.5 * np.round(U / 0.5)), Weight.REMARK, ("steps of 500 mV",),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", KINDS)
def test_each_kind_is_found_alone(name: str) -> None:
    make, weight, words = KINDS[name]
    found = check(make())
    assert [one.name for _, one in found.findings] == [name]
    ((_, one),) = found.findings
    assert one.weight is weight
    for word in words:
        assert word in str(one), str(one)
    # An answer that a sentence offers exists.
    if weight is Weight.REFUSED:
        assert f"--accept {name}" in str(one)
        assert (f"--mend {name}" in str(one)) == (one.mend is not None)
        with pytest.raises(InputError, match=f"--accept {name}"):
            found.fit_for_use()
        (taken,) = check(make(), accept=[name]).fit_for_use()
        assert not any(f"({name})" in note for note in taken.notes)


@pytest.mark.parametrize(
    ("name", "most"),
    [
        ("overload", 1.02), ("dropout", 1.02), ("frozen", 1.02), ("jitter", 1.02), ("jump", 1.02),
        ("wrapped", 1.02), ("block_twice", 1.02), ("unit", 1.02), ("lead", 1.02),
        # A cubic between every tenth sample is all that such a log allows.
        ("slow_drive", 1.2),
    ],
)  # fmt: skip
def test_a_remedy_that_is_followed_does_no_harm(name: str, most: float) -> None:
    """The true model leaves of the mended record what it leaves of the plain one."""
    make, weight, _ = KINDS[name]
    plain = record() if name != "lead" else record(T, *broad())
    asked = [name] if weight is Weight.REFUSED else []
    mended = check(make(), mend=asked).fit_for_use()
    assert all(one.notes for one in mended)
    assert left(mended) < most * left(Campaign.of(plain))
    # What was wrong has an effect, or there would be nothing to mend.
    if name not in ("unit", "jitter"):
        worse = check(make(), accept=[name, "unit"]).fit_for_use()
        assert left(worse) > 1.2 * left(mended)
    assert name not in {one.name for r in mended for one in r.findings}


def test_nothing_is_found_where_nothing_is_wrong() -> None:
    assert check(record()).findings == ()
    assert check(record(T, *broad())).findings == ()


@pytest.mark.parametrize("name", datasets.names())
def test_no_record_that_comes_along_is_refused(name: str) -> None:
    assert check(datasets.load(name)).refused == ()


def test_a_lead_is_found_whatever_the_actuator_lags() -> None:
    """Mechanics that lag by two samples hide as many of those by which the reading comes first.

    A first-order lag of 2 ms, exact for a reading that is linear between samples.
    """
    lagged, decay = np.empty_like(Y), np.exp(-1 / 2.0)
    lagged[0] = Y[0]
    for k in range(1, N):
        slope = Y[k] - Y[k - 1]
        settled = Y[k] - 2.0 * slope
        lagged[k] = settled + (lagged[k - 1] - Y[k - 1] + 2.0 * slope) * decay

    def found(samples: int) -> list[str]:
        n = N - samples
        own = record(T[:n], U[:n], lagged[samples:])
        return [one.sentence for one in own.findings if one.name == "lead"]

    assert "comes 3 samples" in found(5)[0]
    assert "comes 18 samples" in found(20)[0]
    assert found(2) == found(0) == []


def test_a_noisy_rail_and_a_pulse_of_the_drive() -> None:
    assert [one.name for one in noisy_rail().findings] == ["dropout"]
    # Answers of a static actuator to pulses of one and three samples are no marks.
    u = U.copy()
    u[1000:1003] += 2000.0
    u[2000] += 2000.0
    pulsed = record(u=u, y=2e-7 * u + 0.02 * (Y - 2e-7 * U))
    assert {one.name for one in pulsed.findings} <= {"lone", "aliasing"}


def test_a_staircase_a_square_wave_and_a_backlash_are_left_alone() -> None:
    stairs = 20.0 * np.floor(T / 0.3)
    for u in (stairs, np.where((5 * T) % 1 < 0.5, 0.0, 60.0)):
        assert (
            record(u=u, y=loop(u) + NOISE * np.random.default_rng(0).normal(size=N)).findings == ()
        )
    play, out = U[0], np.empty(N)
    for k, value in enumerate(U):
        play = min(max(play, value - 8.0), value + 8.0)
        out[k] = 2e-7 * play
    assert record(y=out).findings == ()


def test_samples_taken_unevenly_keep_their_stamps() -> None:
    t = T + JITTER * 4
    u = np.interp(t, T, U)
    (said,) = record(t, u, np.interp(t, T, Y)).findings
    assert said.name == "jitter"
    assert said.weight is Weight.REMARK
    assert "taken unevenly" in said.sentence


def test_records_that_disagree_by_a_factor() -> None:
    other = record(y=10 * Y).rename("other")
    found = check([record(), other])
    assert [one.name for _, one in found.refused] == ["disagreement"]
    assert "other moves 10 times as far as plain" in str(found)
    assert check([record(), other], accept=["disagreement"]).refused == ()
    # Half the drive is half the reading, and another drive is no other gain.
    half = record(u=U / 2, y=loop(U / 2)).rename("half")
    slow = record(u=50 + 40 * np.sin(T), y=loop(50 + 40 * np.sin(T))).rename("slow")
    assert check([record(), half, slow]).findings == ()


def test_names_are_checked() -> None:
    with pytest.raises(InputError, match="no finding has that name"):
        check(record(), accept=["typo"])
    with pytest.raises(InputError, match="nothing of that kind to mend; found: nothing"):
        check(record(), mend=["wrapped"])
    with pytest.raises(InputError, match="both accepted and to be mended"):
        check(record(), accept=["wrapped"], mend=["wrapped"])


def test_a_mask_travels_with_the_record() -> None:
    (mended,) = check(KINDS["dropout"][0]()).records
    assert int(mended.left_out.sum()) == 12
    assert int(mended.counted.sum()) == N - 12
    assert int(mended.slice("0.5 s", "1.005 s").left_out.sum()) == 5
    assert int(mended.split("1.005 s")[1].left_out.sum()) == 12
    assert 6 <= int(mended.resample(rate="500 Hz").left_out.sum()) <= 7
    with pytest.raises(InputError, match="left_out is bool of shape"):
        record().with_(left_out=np.ones(5, dtype=bool))
    with pytest.raises(InputError, match="every reading is left out"):
        record().with_(left_out=np.ones(N, dtype=bool))


@pytest.mark.parametrize("suffix", [".csv", ".h5"])
def test_a_mask_goes_into_files_and_comes_back(tmp_path: Path, suffix: str) -> None:
    (mended,) = check(KINDS["dropout"][0]()).records
    write(mended, tmp_path / f"r{suffix}")
    again = read(tmp_path / f"r{suffix}")
    assert (again.left_out == mended.left_out).all()
    assert dict(again.channels) == {}


def test_the_picture_marks_the_place() -> None:
    lines = check(KINDS["dropout"][0]()).pictures(60).splitlines()
    (marks,) = [line for line in lines if set(line) == {" ", "^"}]
    assert marks.index("^") - 2 == 20


class TestTwoFlaws:
    """One flaw must not hide another."""

    def test_marks_and_lost_readings_on_a_drive_that_was_logged_slowly(self) -> None:
        held = U[(np.arange(U.size) // 10) * 10]
        marked, lost = Y.copy(), Y.copy()
        marked[[700, 701, 1500]] = 9.9e37
        lost[1000:1012] = 0.0
        for reading, name in ((marked, "overload"), (lost, "dropout")):
            found = check(Measurement(T, held, reading))
            assert {one.name for _, one in found.findings} == {"slow_drive", name}
            mended = check(Measurement(T, held, reading), mend=["slow_drive"]).fit_for_use()
            kept = mended.records[0]
            assert np.abs(kept.drive - U)[kept.counted].max() < 0.2
            assert not kept.counted[np.abs(reading - Y) > 1e-6].any()

    def test_a_jump_beside_readings_that_stand_alone(self) -> None:
        y = Y.copy()
        y[[500, 1300, 2200]] += 2e-6
        y[1500:] += 4e-6
        assert [one.name for _, one in check(Measurement(T, U, y)).refused] == ["jump"]

    def test_shifted_channels_in_two_records_of_one_file(self) -> None:
        y = Y.copy()
        y[1500:] += 4e-6
        found = check(Measurement(T[3:], U[:-3], y[3:]))
        assert [one.name for _, one in found.refused] == ["jump", "lead"]
        both = check(found.given, mend=["jump", "lead"]).fit_for_use()
        assert [len(one) for one in both] == [1497, 1497]
        assert both.records[0].drive == pytest.approx(U[3:1500])

    @pytest.mark.parametrize("samples", [3, 4, 8])
    def test_a_reading_that_trails_by_whole_samples_is_told(self, samples: int) -> None:
        late = Measurement(T[samples:], U[samples:], Y[:-samples])
        told = [one for _, one in check(late).findings]
        assert [one.name for one in told] == ["lag"]
        assert f"after {samples} samples" in told[0].sentence
