"""How well places are tracked, and whether their sigma is true: films whose answer is known."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, final

import numpy as np

from piezo_opt.benchmark.filmed import Scene, Speckles, film, lit
from piezo_opt.measurement import FloatArray
from piezo_opt.video import Track, track

_FRAMES: Final = 120
_HALF: Final = 24


@final
@dataclass(frozen=True)
class Kind:
    """A kind of film: how it is coded, its noise [levels], how its light drifts, and the largest
    sigma [px] of a frame that counts."""

    name: str
    codec: str = "ffv1"
    options: tuple[tuple[str, str], ...] = ()
    noise: float = 2.0
    drift: float = 0.1
    suffix: str = ".mkv"
    sure: float = 0.25


_QUIET: Final = ("x265-params", "log-level=none")
KINDS: Final = (
    Kind("no losses, noise 1", noise=1.0),
    Kind("no losses, noise 2", noise=2.0),
    Kind("no losses, noise 5", noise=5.0),
    Kind("no losses, noise 2, light drifts by 40 %", drift=0.4),
    Kind("motion JPEG, q 3", "mjpeg", (("qscale", "3"), ("qmin", "3"), ("qmax", "3"))),
    Kind("H.264, crf 16", "libx264", (("crf", "16"),), suffix=".mp4"),
    Kind("H.264, crf 18", "libx264", (("crf", "18"),), suffix=".mp4"),
    Kind("H.264, crf 20", "libx264", (("crf", "20"),), suffix=".mp4"),
    Kind("H.264, crf 23", "libx264", (("crf", "23"),), suffix=".mp4"),
    Kind("H.264, crf 20, fast", "libx264", (("crf", "20"), ("preset", "ultrafast")), suffix=".mp4"),
    Kind("MPEG-4, 3 Mb/s", "mpeg4", (("b", "3M"),)),
    Kind("VP9, crf 24", "libvpx-vp9", (("crf", "24"), ("b", "0"))),
    *(
        Kind(f"HEVC, crf {crf}", "libx265", (("crf", crf), _QUIET), suffix=".mp4")
        for crf in ("18", "22", "26")
    ),
    Kind(
        "HEVC, crf 22, no B frames", "libx265", (("crf", "22"), ("bf", "0"), _QUIET), suffix=".mp4"
    ),
    Kind(
        "HEVC, crf 26, sigma up to 0.05", "libx265", (("crf", "26"), _QUIET), suffix=".mp4",
        sure=0.05,
    ),
)  # fmt: skip
"""From the best to the worst of each codec."""
MOTIONS: Final = ("walk", "sine", "slow")


@final
@dataclass(frozen=True)
class Row:
    """What was measured on films of one kind.

    Attributes:
        kind: which.
        frames: how many.
        valid: share that was believed.
        rms: of the error of the distance, beyond a constant [px].
        worst: largest error [px].
        inside: share of errors inside two sigma.
        locking: rms of what the error follows the place within a pixel with: the first harmonic of
            the fractional place, beyond what chance gives [px].
    """

    kind: str
    frames: int
    valid: float
    rms: float
    worst: float
    inside: float
    locking: float


def calibration(
    kinds: tuple[Kind, ...] = KINDS,
    *,
    seeds: int = 2,
    first_seed: int = 0,
    motions: tuple[str, ...] = MOTIONS,
    progress: Callable[[str], None] | None = None,
) -> tuple[Row, ...]:
    """Errors and their sigma on films of each kind: random walks, sines and slow motions.

    Args:
        kinds: of films.
        seeds: films of each motion.
        first_seed: where they begin.
        motions: of them ``"walk"``, ``"sine"``, ``"slow"``.
        progress: told where it is.
    """
    rows = []
    for kind in kinds:
        if progress is not None:
            progress(kind.name)
        parts = [
            _one(kind, motion, seed)
            for motion in motions
            for seed in range(first_seed, first_seed + seeds)
        ]
        error = np.concatenate([e for e, _, _ in parts])
        sigma = np.concatenate([s for _, s, _ in parts])
        place = np.concatenate([p for _, _, p in parts])
        seen = np.isfinite(error)
        error, sigma, place = error[seen], sigma[seen], place[seen]
        rows.append(
            Row(
                kind.name, int(seen.size), float(seen.mean()),
                float(np.sqrt(np.mean(error**2))), float(np.abs(error).max()),
                float(np.mean(np.abs(error) < 2.0 * sigma)), _locking(error, place),
            )
        )  # fmt: skip
    return tuple(rows)


@final
@dataclass(frozen=True)
class Jumps:
    """What became of frames in which the tip jumped anywhere.

    Attributes:
        frames: how many.
        visible: in which the tip was whole, uncovered and alone.
        believed: of the visible ones.
        lost: of the others.
        wrong: believed, and off by more than half a pixel.
        worst: largest error of those believed [px].
        rms: of those believed [px].
    """

    frames: int
    visible: int
    believed: int
    lost: int
    wrong: int
    worst: float
    rms: float

    def __str__(self) -> str:
        return (
            f"{self.frames} frames of jumps: {self.visible} show the tip plainly, of which "
            f"{self.believed} are believed; {self.lost} of the {self.frames - self.visible} others "
            f"are lost. Believed and off by more than half a pixel: {self.wrong} (largest error "
            f"{self.worst:.3f} px)."
        )


def jumps(
    count: int = 1000, *, seed: int = 0, progress: Callable[[str], None] | None = None
) -> Jumps:
    """Frames in which the tip is anywhere: in the picture, half out of it, smeared by its motion,
    half covered, gone, beside a double that lacks a third of it, in other light, or in much noise.

    Args:
        count: frames.
        seed: of everything.
        progress: told where it is.
    """
    scene = Scene(half=_HALF, seed=seed)
    rng = np.random.default_rng([seed, 9])
    told = list(_jumping(scene, count, rng))
    pictures = [one for one, _, _ in told]
    truth = np.array([at for _, at, _ in told])
    visible = np.array([seen for _, _, seen in told])
    found = _tracked(
        pictures, Kind("jumps"), _box(scene), tell=progress, times=np.arange(len(told)) / 25.0
    )
    beside = np.array(found.box.centre) - truth[0]
    error = np.linalg.norm(found.place - truth - beside, axis=1)
    believed = found.valid
    return Jumps(
        frames=len(told),
        visible=int(visible.sum()),
        believed=int((believed & visible).sum()),
        lost=int((~believed & ~visible).sum()),
        wrong=int((error[believed] > 0.5).sum()),
        worst=float(error[believed].max()),
        rms=float(np.sqrt(np.mean(error[believed & visible] ** 2))),
    )


def _jumping(
    scene: Scene, count: int, rng: np.random.Generator
) -> Iterator[tuple[FloatArray, tuple[float, float], bool]]:
    """Pictures, the tip's place, and whether it is there to be seen."""
    height, width = scene.shape
    middle = (0.5 * width, 0.5 * height)
    half = scene.half
    for number in range(count):
        noise = rng.normal(0.0, 2.0, scene.shape)
        x = rng.uniform(half + 2.0, width - half - 3.0)
        y = rng.uniform(half + 2.0, height - half - 3.0)
        what = rng.integers(0, 10) if number >= 16 else 0
        if number == 0:
            x, y = middle
        picture, seen = scene.picture(x, y), True
        if what == 1:  # partly or wholly out of the picture
            x, y = x + rng.choice([-1.0, 1.0]) * width * 0.5, y + rng.uniform(-0.5, 0.5) * height
            picture = scene.picture(x, y)
            out = (x - half, width - 1 - x - half, y - half, height - 1 - y - half)
            seen = min(out) > 0.0
        elif what == 2:  # smeared: the shutter was open while it moved
            way = rng.uniform(-8.0, 8.0, 2)
            parts = np.linspace(-0.5, 0.5, 17)
            picture = np.mean(
                [scene.picture(x + p * way[0], y + p * way[1]) for p in parts], axis=0
            )
            seen = bool(np.abs(way).max() < 1.0)
        elif what == 3:  # something before it
            picture, seen = picture.copy(), False
            at = int(x + rng.uniform(-half, half)), int(y + rng.uniform(-half, half))
            size = rng.integers(8, 40, 2)
            part = (
                slice(max(0, at[1] - int(size[1])), at[1] + int(size[1])),
                slice(max(0, at[0] - int(size[0])), at[0] + int(size[0])),
            )
            picture[part] = rng.uniform(40.0, 200.0)
        elif what == 4:  # gone
            x, y, seen = -500.0, -500.0, False
            picture = scene.picture(x, y)
        elif what == 5:  # a double of which a third is something else; the tip may be gone
            gone, seen = bool(rng.integers(0, 2)), False
            beside = rng.uniform(half, width - half), rng.uniform(half, height - half)
            double = scene.picture(*beside)
            other = Speckles.scattered(60, (-half, -half), (half, -half / 3.0), rng)
            double = double + other.seen(scene.shape, beside, scene.blur)
            cover = np.abs(double - scene.picture(-500.0, -500.0)) > 0.0
            picture = np.where(cover, double, scene.picture(-500.0, -500.0) if gone else picture)
            if gone:
                x, y = -500.0, -500.0
        elif what == 6:  # other light
            picture = lit(picture, rng.uniform(0.7, 1.3), rng.uniform(-30.0, 30.0))
        elif what == 7:  # a burst of noise
            noise = noise * rng.uniform(1.0, 15.0)
            seen = False
        yield picture + noise, (float(x), float(y)), seen


def _one(kind: Kind, motion: str, seed: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Error [px], sigma [px] and the place across [px] of each frame of a film."""
    scene = Scene(half=_HALF, seed=seed)
    rng = np.random.default_rng([seed, 5, len(motion)])
    x, y = moved(motion, _FRAMES, rng)
    x, y = 0.5 * scene.shape[1] + x - x[0], 0.5 * scene.shape[0] + y - y[0]
    pictures = [
        lit(
            scene.picture(a, b), 1.0 + kind.drift * np.sin(k / 20.0),
            75.0 * kind.drift * np.sin(k / 30.0),
        ) + rng.normal(0.0, kind.noise, scene.shape)
        for k, (a, b) in enumerate(zip(x.tolist(), y.tolist(), strict=True))
    ]  # fmt: skip
    found = _tracked(pictures, kind, _box(scene), times=np.arange(_FRAMES) / 25.0)
    # The box's middle is a point of the tip, not its own middle.
    beside = np.array(found.box.centre) - [x[0], y[0]]
    away = np.column_stack([x, y]) + beside - np.array(found.reference)
    truth = np.linalg.norm(away, axis=1)
    error = found.distance / found.scale - truth
    return error - np.nanmedian(error), found.sigma / found.scale, x


def moved(motion: str, count: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """x and y (count,) [px] of a motion."""
    k = np.arange(count)
    if motion == "walk":
        steps = rng.normal(0.0, [0.35, 0.25], (count, 2)).cumsum(axis=0)
        return np.clip(steps[:, 0], -30, 30), np.clip(steps[:, 1], -20, 20)
    if motion == "sine":
        return 12.0 * np.sin(k / 6.0), 4.0 * np.sin(k / 9.0)
    return 3.0 * np.sin(k / 40.0), 2.0 * np.cos(k / 50.0)


def _box(scene: Scene) -> str:
    side = round(2 * scene.half) - 6
    corner = [round(0.5 * s - 0.5 * side) for s in (scene.shape[1], scene.shape[0])]
    return f"{corner[0]},{corner[1]},{side},{side}"


def _tracked(
    pictures: list[FloatArray], kind: Kind, box: str, *, times: FloatArray, **options: Any
) -> Track:
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"film{kind.suffix}"
        film(path, pictures, times.tolist(), codec=kind.codec, options=dict(kind.options))
        return track(
            path, scale="1 um/px", reference="-40,70", box=box, sure=kind.sure,
            progress=options.get("tell"),
        )  # fmt: skip


def _locking(error: FloatArray, place: FloatArray) -> float:
    """rms [px] of the part of errors that repeats with the pixel, less what chance gives.

    Errors of n frames are fitted by a and b of a cos(2 pi x) + b sin(2 pi x); independent errors of
    variance s^2 would give (a^2 + b^2) / 2 = 2 s^2 / n.
    """
    turns = 2.0 * np.pi * place
    waves = np.column_stack([np.cos(turns), np.sin(turns), np.ones(place.size)])
    fitted, *_ = np.linalg.lstsq(waves, error, rcond=None)
    power = 0.5 * float(fitted[0] ** 2 + fitted[1] ** 2)
    chance = 2.0 * float(np.var(error - waves @ fitted)) / error.size
    return float(np.sqrt(max(0.0, power - chance)))
