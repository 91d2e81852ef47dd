"""Tracks of films whose answer is known: places, sigmas, instants, gaps, files and refusals."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.benchmark.filmed import Scene, film
from piezo_opt.benchmark.tracking import KINDS, Kind, calibration, jumps
from piezo_opt.measurement import FloatArray
from piezo_opt.readers import read_drive
from piezo_opt.report.video import overlay
from piezo_opt.video.again import moved
from piezo_opt.video.box import MARGIN, Box
from piezo_opt.video.frames import Video
from piezo_opt.video.judging import judged
from piezo_opt.video.learning import learnt
from piezo_opt.video.pattern import Pattern
from piezo_opt.video.sighting import Area, sighted, sightings

SMALL = Scene(shape=(80, 100), half=18.0, seed=2)
BOX = "35,25,30,30"
SCALE = 0.1725e-6


def kind(name: str) -> Kind:
    return next(one for one in KINDS if one.name == name)


def shown(
    x: Sequence[float] | FloatArray, y: float | FloatArray = 40.0, noise: float = 1.0
) -> list[FloatArray]:
    rng = np.random.default_rng(7)
    heights = np.broadcast_to(y, len(x))
    return [
        SMALL.picture(float(a), float(b)) + rng.normal(0.0, noise, SMALL.shape)
        for a, b in zip(x, heights, strict=True)
    ]


@pytest.fixture(scope="module")
def swing(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, FloatArray, FloatArray]:
    """A film with instants of its own: the tip swings, and is gone in frames 20 to 23."""
    rng = np.random.default_rng(3)
    time = np.cumsum(rng.uniform(0.02, 0.06, 48))
    x = 50.0 + 6.3 * np.sin(2.0 * np.pi * (time - time[0]) / 0.9)
    pictures = shown(x)
    for k in range(20, 24):
        pictures[k] = SMALL.picture(-300.0, 0.0)
    path = tmp_path_factory.mktemp("films") / "swing.mkv"
    film(path, pictures, time.tolist())
    return path, time, x


def test_without_losses_places_and_their_sigma_are_true() -> None:
    (row,) = calibration((kind("no losses, noise 2"),), seeds=1, motions=("walk",))
    assert row.valid == 1.0
    assert row.rms < 0.01
    assert 0.9 <= row.inside <= 0.99
    assert row.locking < 0.005


def test_compressed_by_moving_blocks_the_place_is_still_good() -> None:
    (row,) = calibration((kind("H.264, crf 20, fast"),), seeds=1, motions=("walk", "slow"))
    assert row.valid == 1.0
    assert row.rms < 0.05
    assert 0.9 <= row.inside <= 0.99


def test_what_the_codec_did_is_measured_on_the_film_made_again(tmp_path: Path) -> None:
    """B frames of HEVC are mostly the frames around them: their errors are told as larger."""
    x = 50.0 + np.random.default_rng(0).normal(0.0, 0.35, 60).cumsum()
    path, one = tmp_path / "walk.mp4", kind("HEVC, crf 22")
    film(
        path, shown(x, noise=2.0), np.arange(60) / 25.0, codec=one.codec, options=dict(one.options)
    )
    options = {"scale": "1 um/px", "reference": "5,40", "box": BOX, "search": 15.0}
    found = po.track(path, **options)  # type: ignore[arg-type]
    kinds = np.array([frame.kind for frame in Video.of(path).frames()])
    error = found.distance * 1e6 - x
    error -= np.nanmedian(error)
    sigma = found.sigma * 1e6
    assert np.mean(np.abs(error) < 2.0 * sigma) >= 0.85
    assert np.median(sigma[kinds == "B"]) > 1.5 * np.median(sigma[kinds == "P"])
    assert np.std(error[kinds == "B"]) > 1.5 * np.std(error[kinds == "P"])
    assert any("as the same film shows that was made again" in note for note in found.notes)
    # Without what is common to all blocks the sigma would be several times too small.
    assert np.median(sigma) > 3.0 * np.sqrt(np.median(_blocks_alone(path, options)))
    few = po.track(path, **options, sure=0.05)  # type: ignore[arg-type]
    assert 0 < np.count_nonzero(few.valid) < 40
    assert set(kinds[few.valid]) <= {"I", "P"}
    assert np.nanmax(few.sigma) <= 0.05e-6


def _blocks_alone(path: Path, options: dict[str, object]) -> FloatArray:
    """Variances of places [px^2] as the blocks of each frame disagree."""
    frames = list(Video.of(path).frames())
    box = Box.of(str(options["box"]))
    area = Area(box, 15.0)
    pattern = learnt(frames[:32], box, area)
    told = judged([sightings(one.image, pattern, area) for one in frames], pattern)
    return np.asarray(told.covariance[:, 0, 0])


def test_a_feature_is_moved_by_what_was_asked() -> None:
    """All of the box, by a fraction of a pixel, and nothing far from it."""
    scene = SMALL.picture(50.0, 40.0)
    rows, columns = slice(25 - MARGIN, 55 + MARGIN), slice(35 - MARGIN, 65 + MARGIN)
    pattern = Pattern(scene[rows, columns])
    at, by = np.array([49.5, 39.5]), np.array([0.37, -0.81])
    made = moved(scene, at, by, (30, 30))
    seen = sighted(made, pattern, at)
    assert seen is not None
    assert np.abs(seen.place - at - by).max() < 0.002
    assert np.array_equal(made[:3], scene[:3])
    assert np.array_equal(made[:, :14], scene[:, :14])


def test_a_codec_that_cannot_be_made_again_is_trusted_to_half_pixels(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    path, one = tmp_path / "film.mp4", kind("H.264, crf 20, fast")
    film(path, shown(np.linspace(46, 54, 12)), np.arange(12) / 25.0, codec=one.codec)
    monkeypatch.setattr("piezo_opt.video.again._BY_CODEC", {})
    found = po.track(path, scale="1 um/px", reference="5,40", box=BOX)
    assert np.nanmin(found.sigma) * 1e6 == pytest.approx(0.5 / np.sqrt(12.0), rel=0.05)
    assert any("could not be measured" in note for note in found.notes)


def test_the_grid_of_motion_vectors_is_read_from_the_file(tmp_path: Path) -> None:
    pictures = shown(np.linspace(45.0, 55.0, 10))
    grids = []
    for number, name in enumerate(("H.264, crf 20", "H.264, crf 20, fast", "motion JPEG, q 3")):
        one, path = kind(name), tmp_path / f"{number}.mkv"
        film(path, pictures, np.arange(10) / 25.0, codec=one.codec, options=dict(one.options))
        coding = Video.of(path).coding
        grids.append(None if coding is None else (coding.codec, coding.grid))
    # The fastest preset looks for whole pixels only; frames of motion JPEG stand by themselves.
    assert grids == [("h264", 0.25), ("h264", 1.0), None]


def test_no_jump_is_believed_and_wrong() -> None:
    told = jumps(80, seed=3)
    assert told.wrong == 0
    assert told.worst < 0.5
    assert told.believed >= 0.95 * told.visible
    assert told.lost >= 0.8 * (told.frames - told.visible)


def test_sigma_is_the_bound_for_the_noise_there_is() -> None:
    picture = SMALL.picture(50.0, 40.0)
    rows, columns = slice(25 - MARGIN, 55 + MARGIN), slice(35 - MARGIN, 65 + MARGIN)
    pattern = Pattern(picture[rows, columns])
    rng = np.random.default_rng(0)
    shift = np.array([0.37, -0.21])
    window = SMALL.picture(50.37, 39.79)[25:55, 35:65]
    found = [
        pattern.register(0.8 * window + 9.0 + rng.normal(0, 3.0, (30, 30))) for _ in range(150)
    ]
    errors = np.array([one.shift - shift for one in found if one is not None])
    said = np.mean([np.diag(one.white) for one in found if one is not None], axis=0)
    assert np.sqrt(said) == pytest.approx(errors.std(axis=0), rel=0.15)
    assert np.abs(errors.mean(axis=0)).max() < 0.004
    assert np.mean([o.unevenness for o in found if o is not None]) == pytest.approx(1.0, abs=0.1)


def test_instants_are_the_files_and_lost_frames_are_gaps(
    swing: tuple[Path, FloatArray, FloatArray], tmp_path: Path
) -> None:
    path, time, x = swing
    found = po.track(path, scale="0.1725 um/px", reference="5,40", box=BOX)
    assert np.abs(found.time - time).max() <= 1e-3
    assert np.flatnonzero(~found.valid).tolist() == [20, 21, 22, 23]
    moved = (found.distance - found.distance[0]) / SCALE - (x - x[0])
    assert np.nanmax(np.abs(moved)) < 0.05
    drive = tmp_path / "volts.csv"
    volts = 60.0 + 60.0 * np.sin(2.0 * np.pi * np.arange(300) * 0.01 / 0.9)
    drive.write_text(
        "time [s],voltage [V]\n"
        + "".join(f"{0.01 * k},{v}\n" for k, v in enumerate(volts.tolist()))
    )
    record = found.record(read_drive(drive), delay=float(found.time[0]))
    assert np.flatnonzero(record.left_out).tolist() == [20, 21, 22, 23]
    assert np.corrcoef(record.drive, record.position)[0, 1] > 0.999
    for name in ("record.csv", "record.h5"):
        po.write(record, tmp_path / name)
        again = po.read(tmp_path / name)
        assert np.array_equal(again.position, record.position)
        assert np.array_equal(again.left_out, record.left_out)
        assert again.channel_units["sigma"] == "m"
    alone = tmp_path / "alone.csv"
    found.write(alone)
    rows = np.loadtxt(alone, delimiter=",", skiprows=1)
    assert rows[:, 1] == pytest.approx(found.distance[found.valid])
    assert np.diff(rows[:, 0]).max() > 3.0 * np.median(np.diff(rows[:, 0]))


def test_a_feature_is_chosen_on_what_moves(swing: tuple[Path, FloatArray, FloatArray]) -> None:
    path, _, x = swing
    found = po.track(path, scale=SCALE, reference=(5.0, 40.0))
    middle = np.array(found.box.centre)
    assert np.abs(middle - [50.0, 40.0]).max() < SMALL.half
    assert "The feature was chosen" in found.notes[0]
    moved = found.place[:, 0] - found.place[0, 0] - (x - x[0])
    assert np.nanmax(np.abs(moved)) < 0.1


def test_whole_pixels_give_the_staircase_of_the_thesis(tmp_path: Path) -> None:
    path = tmp_path / "ramp.mkv"
    volts = np.concatenate([np.linspace(0, 120, 36), np.linspace(120, 0, 36)])
    film(path, shown(50.0 + 0.06 * volts), (np.arange(72) / 25.0).tolist())
    options = {"scale": "0.1725um/px", "reference": "4.5,39.5", "box": BOX, "search": 12.0}
    drive = _volts(tmp_path, volts)
    coarse = po.track(path, **options, whole_pixels=True).record(drive)  # type: ignore[arg-type]
    fine = po.track(path, **options).record(drive)  # type: ignore[arg-type]
    assert coarse.resolution == pytest.approx(SCALE, rel=1e-3)
    line = 0.06 * SCALE * fine.drive
    errors = [one.position - one.position.mean() - (line - line.mean()) for one in (coarse, fine)]
    assert np.std(errors[0]) > 20.0 * np.std(errors[1])


def _volts(folder: Path, volts: FloatArray) -> po.readers.DriveSignal:
    path = folder / "volts.csv"
    rows = (f"{k / 25.0},{v}\n" for k, v in enumerate(volts.tolist()))
    path.write_text("time [s],voltage [V]\n" + "".join(rows))
    return read_drive(path)


def test_the_camera_may_say_its_own_rate(swing: tuple[Path, FloatArray, FloatArray]) -> None:
    path, _, _ = swing
    found = po.track(path, scale=SCALE, reference="5,40", box=BOX, search=12.0, rate="1 kHz")
    assert found.time[-1] == pytest.approx(0.047)


def test_the_picture_shows_box_reference_and_gaps(
    swing: tuple[Path, FloatArray, FloatArray], tmp_path: Path
) -> None:
    path, _, _ = swing
    made = overlay(po.track(path, scale=SCALE, reference="-15,40", box=BOX, search=12.0))
    above, below = made.axes
    assert above.get_xlim()[0] < -15.0
    assert below.get_ylabel() == "distance [µm]"
    labels = [text.get_text() for text in below.get_legend().get_texts()]
    assert labels == ["two sigma", "distance from the reference", "lost"]
    made.savefig(tmp_path / "overlay.png")


def edge(level: float = 40.0) -> FloatArray:
    across = np.arange(100.0)[None, :] * np.ones((80, 1))
    return np.asarray(100.0 + level * np.tanh((across - 50.0) / 2.0))


@pytest.mark.parametrize(
    ("pictures", "box", "says"),
    [
        (shown([50.0] * 9), "0,25,30,30", "reaches to the border"),
        (shown([50.0] * 9), "35,25,5,30", "smaller than 12 pixels"),
        ([np.full((80, 100), 90.0)] * 9, BOX, "is flat"),
        ([edge()] * 9, BOX, "straight edge"),
        (shown([50.0] * 4), BOX, "has 4 frames"),
        (shown([50.0] * 10 + [-300.0] * 0)[:7] + [edge(1.0)] * 30, BOX, "lost in all but 7 of 37"),
        ([np.tile(shown([18.0], 18.0, 0.0)[0][:40, :40], (2, 2))] * 9, "5,5,26,26", "two places"),
    ],
)  # fmt: skip
def test_what_cannot_be_followed_is_refused(
    pictures: list[FloatArray], box: str, says: str, tmp_path: Path
) -> None:
    path = tmp_path / "film.mkv"
    film(path, pictures, (np.arange(len(pictures)) / 25.0).tolist())
    with pytest.raises(po.InputError, match=says):
        po.track(path, scale="0.1725 um/px", reference="5,40", box=box)


def test_files_and_options_that_are_none_are_refused(
    swing: tuple[Path, FloatArray, FloatArray], tmp_path: Path
) -> None:
    path, _, _ = swing
    text, empty, cut = tmp_path / "text.mp4", tmp_path / "empty.mp4", tmp_path / "cut.mkv"
    text.write_text("no video at all\n" * 50)
    empty.write_bytes(b"")
    cut.write_bytes(path.read_bytes()[:300])
    told = {"scale": "0.1725um/px", "reference": "5,40", "box": BOX}
    for file, changed, says in (
        (tmp_path / "none.mp4", {}, "there is no such file"),
        (text, {}, "is not a video that can be read"),
        (empty, {}, "is empty"),
        (cut, {}, "is not a video that can be read"),
        (path, {"scale": "0.17 V/px"}, "is not a quantity in m"),
        (path, {"scale": "0.17 um/s"}, "no length of a pixel"),
        (path, {"scale": "-1 um/px"}, "give a positive length"),
        (path, {"reference": "5"}, "give 2 numbers"),
        (path, {"reference": "1e5,3"}, "is far from the picture"),
        (path, {"search": -3.0}, "give a positive distance"),
        (path, {"rate": "0 Hz"}, "give a positive one"),
        (path, {"sure": 0.3}, "give a sigma above 0, up to 0.25"),
    ):
        with pytest.raises(po.InputError, match=says):
            po.track(file, **{**told, **changed})  # type: ignore[arg-type]


def test_light_that_is_cut_off_says_no_more() -> None:
    """Bright spots beyond the brightest level in a third of the frames: places and sigma hold."""
    (row,) = calibration(
        (kind("no losses, noise 2, light drifts by 40 %"),), seeds=1, motions=("walk",)
    )
    assert row.valid == 1.0
    assert row.rms < 0.01
    assert 0.9 <= row.inside <= 0.99
