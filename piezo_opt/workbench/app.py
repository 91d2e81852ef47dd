"""The server: its addresses, thin over the bench."""

from __future__ import annotations

import asyncio
import io
import json
import math
import re
import tempfile
import zipfile
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp

from piezo_opt.errors import InputError, PiezoOptError
from piezo_opt.files import LARGEST_FILE
from piezo_opt.pictures import Axis, Panel, Picture, Tone, Trace, plain
from piezo_opt.pictures.places import picture
from piezo_opt.pictures.records import Seen, loop, over_time
from piezo_opt.pictures.thinning import MOST_POINTS, envelope, stretches, window
from piezo_opt.workbench.answers import Drive, Signals
from piezo_opt.workbench.bench import Bench
from piezo_opt.workbench.edits import edit_from_dict
from piezo_opt.workbench.guard import Guard
from piezo_opt.workbench.load import Load, Source
from piezo_opt.workbench.worker import Kind

_ASSETS: Final = {
    "": ("index.html", "text/html"),
    "workbench.js": ("workbench.js", "text/javascript"),
    "pictures.js": ("pictures.js", "text/javascript"),
    "workbench.css": ("workbench.css", "text/css"),
    "uplot.js": ("uplot/uPlot.iife.min.js", "text/javascript"),
    "uplot.css": ("uplot/uPlot.min.css", "text/css"),
}
_FEWEST: Final = 200
"""Points of a trace at least: as a picture is laid out, its width may not be known yet."""
_LONGEST: Final = 1 << 20
"""[bytes] of what a click may send."""


def application(bench: Bench, token: str, port: int) -> ASGIApp:
    """The guarded server of one bench."""

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        bench.open()
        try:
            yield
        finally:
            bench.close()

    async def asset(request: Request) -> Response:
        known = _ASSETS.get(request.path_params.get("name", ""))
        if known is None:
            return JSONResponse({"sentence": "There is no such file."}, 404)
        data = files("piezo_opt.workbench").joinpath("assets", *known[0].split("/")).read_bytes()
        return Response(data, media_type=known[1])

    async def events(_: Request) -> Response:
        async def stream() -> AsyncIterator[str]:
            async for name, data in bench.events():
                yield f"event: {name}\ndata: {_json(data)}\n\n"

        return StreamingResponse(stream(), media_type="text/event-stream")

    async def state(_: Request) -> Response:
        return Response(_json(bench.state()), media_type="application/json")

    async def do(request: Request) -> Response:
        said = json.loads(await _body(request, _LONGEST) or b"null")
        if not isinstance(said, Mapping):
            raise InputError("A click sends what is to be done, as an object.")
        if "version" in said and said["version"] != bench.version and said.get("do") != "cancel":
            sentence = "The session has changed meanwhile: look, and click again."
            return JSONResponse({"sentence": sentence}, 409)
        _do(bench, said)
        return JSONResponse({"version": bench.version})

    async def upload(request: Request) -> Response:
        name = re.sub(r"[^\w.+-]+", "_", request.query_params.get("name", "")).lstrip("._")[-100:]
        folder = bench.file.with_suffix(".files")
        target = await _received(request, folder, name or "record.csv")
        bench.load(Load((Source(str(target)),)))
        return JSONResponse({"version": bench.version})

    async def view(request: Request) -> Response:
        return Response(_view(bench, request.query_params), media_type="application/json")

    async def brushed(request: Request) -> Response:
        return Response(_brushed(bench, request.query_params), media_type="application/json")

    async def place(request: Request) -> Response:
        return Response(_place(bench, request.query_params), media_type="application/json")

    async def drive(request: Request) -> Response:
        one = _drive(bench, request.query_params.get("number", ""))
        time, (thin,) = envelope(one.time, [one.drive])
        trace = Trace("", time, thin, Tone.BLUE)
        shown = Picture((Panel("", Axis("time", "s"), Axis("drive", one.unit), (trace,)),))
        return Response(_json(plain(shown)), media_type="application/json")

    async def download(request: Request) -> Response:
        return await _download(bench, request.path_params["what"])

    return Guard(
        Starlette(
            routes=[
                Route("/", asset),
                Route("/assets/{name}", asset),
                Route("/events", events),
                Route("/state", state),
                Route("/view", _told(view)),
                Route("/brushed", _told(brushed)),
                Route("/place", _told(place)),
                Route("/drive", _told(drive)),
                Route("/do", _told(do), methods=["POST"]),
                Route("/upload", _told(upload), methods=["POST"]),
                Route("/download/{what}", _told(download)),
            ],
            lifespan=lifespan,
        ),
        token,
        port,
    )


def _told(
    answer: Callable[[Request], Awaitable[Response]],
) -> Callable[[Request], Awaitable[Response]]:
    """What a user did wrong is one sentence."""

    async def told(request: Request) -> Response:
        try:
            return await answer(request)
        except PiezoOptError as error:
            return JSONResponse({"sentence": " ".join(str(error).split())}, 400)
        except (ValueError, RecursionError) as error:
            return JSONResponse({"sentence": f"What the page sent makes no sense: {error}"}, 400)
        except ClientDisconnect:
            return Response(status_code=400)

    return told


def _do(bench: Bench, said: Mapping[str, Any]) -> None:
    match said.get("do"):
        case "load":
            bench.load(Load.from_dict(said.get("load", {})))
        case "fit":
            bench.fit()
        case "undo":
            bench.undo()
        case "redo":
            bench.redo()
        case "find":
            bench.search()
        case "next":
            bench.next()
        case "cancel":
            bench.cancel()
        case _:
            bench.edit(edit_from_dict(said))


async def _body(request: Request, most: int) -> bytes:
    parts: list[bytes] = []
    size = 0
    async for part in request.stream():
        size += len(part)
        if size > most:
            raise InputError(f"More than {most} bytes were sent: that is no click.")
        parts.append(part)
    return b"".join(parts)


async def _received(request: Request, folder: Path, name: str) -> Path:
    """A dropped file, kept beside the session under a name of its own."""
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        stem, suffix = Path(name).stem, Path(name).suffix
        number, target = 1, folder / name
        while target.exists():
            number += 1
            target = folder / f"{stem}-{number}{suffix}"
        size = 0
        with target.open("xb") as file:
            try:
                async for part in request.stream():
                    size += len(part)
                    if size > LARGEST_FILE:
                        raise InputError(f"{name}: is larger than {LARGEST_FILE} bytes: cut it")
                    file.write(part)
            except BaseException:
                target.unlink(missing_ok=True)
                raise
    except OSError as error:
        raise InputError(f"{name}: cannot be kept in {folder}: {error.strerror}") from error
    return target


def _drive(bench: Bench, number: str) -> Drive:
    drives = () if bench.plan is None else bench.plan.drives
    if not number.isdecimal() or int(number) >= len(drives):
        raise InputError(f"There is no drive number {number}.")
    return drives[int(number)]


def _signals(bench: Bench, asked: Mapping[str, str]) -> tuple[int, Signals]:
    """The record that is asked for: its number, and time, drive and position."""
    if bench.looked is None:
        raise InputError("There is no record yet.")
    index = int(asked.get("record", "0"))
    if not 0 <= index < len(bench.looked.signals):
        raise InputError(f"There is no record number {index}.")
    return index, bench.looked.signals[index]


def _brushed(bench: Bench, asked: Mapping[str, str]) -> str:
    """When a record was inside a rectangle of the plane of drive and position."""
    _, (time, drive, position) = _signals(bench, asked)
    left, right, low, high = (float(asked.get(k, "nan")) for k in ("left", "right", "low", "high"))
    if not (left <= right and low <= high):
        raise InputError("A rectangle in the plane has left <= right [V] and low <= high [m].")
    inside = (drive >= left) & (drive <= right) & (position >= low) & (position <= high)
    return _json({"stretches": stretches(time, inside), "samples": int(inside.sum())})


def _view(bench: Bench, asked: Mapping[str, str]) -> str:
    """Pictures of one record between two instants, thinned for a screen."""
    index, (time, drive, position) = _signals(bench, asked)
    begin, end = (float(asked[k]) if k in asked else None for k in ("begin", "end"))
    if any(v is not None and not math.isfinite(v) for v in (begin, end)):
        raise InputError("A stretch of time has two ends, in seconds.")
    assert bench.looked is not None
    units = bench.looked.told["records"][index]["units"]
    fit, score = bench.fits.get(bench.shown), bench.scores.get(bench.shown)
    # Of a model that is being solved the last iterate is drawn, which no suspect was scored at.
    readings = bench.drawn or (() if fit is None else fit.readings)
    name = "" if bench.drawn else asked.get("suspect", "")
    scored = score is not None and name in score.curves
    points = asked.get("points", "")
    most = min(max(int(points), _FEWEST), MOST_POINTS) if points.isdecimal() else MOST_POINTS
    part = window(time, begin, end)
    seen: slice | NDArray[np.intp] = part
    if bench.drawn is None and part.stop - part.start > time.size // 10:
        kept = bench.looked.kept[index] if fit is None else fit.kept[index]
        if score is not None and scored:
            kept = np.union1d(kept, score.kept[name][index])
        seen = kept[slice(*np.searchsorted(kept, [part.start, part.stop]))]
    shown = Seen(
        time[seen], drive[seen], position[seen], bench.looked.counted[index][seen],
        units["drive"], units["position"],
        [("modelled", readings[index][seen])] if readings else [],
        (f"what {name} would explain of it", score.curves[name][index][seen])
        if score is not None and scored else None,
    )  # fmt: skip
    return _json(
        {
            "time": plain(over_time(shown, "", most)),
            "plane": plain(loop(shown, most)),
            "samples": int(part.stop - part.start),
        }
    )


def _place(bench: Bench, asked: Mapping[str, str]) -> str:
    """Where the residual of one record lives, in one of the views."""
    judged = bench.judged.get(bench.shown)
    if judged is None:
        raise InputError("There is no fit yet, or it is not judged yet: fit the model first.")
    index = asked.get("record", "0")
    if not index.isdecimal() or int(index) >= len(judged.places):
        raise InputError(f"There is no record number {index}.")
    views = judged.places[int(index)]
    return _json({"views": list(views), **plain(picture(views, asked.get("by", "branch")))})


async def _download(bench: Bench, what: str) -> Response:
    now = bench.settled
    if numbered := re.fullmatch(r"drive-(\d{1,4})\.csv", what):
        one = _drive(bench, numbered[1])
        return _file(one.csv, f"{one.name}.csv", "text/csv")
    if what == "script.py":
        return _file(bench.session.script, what, "text/x-python")
    if what == "session.json":
        return _file(json.dumps(bench.session.to_dict(), indent=1), what, "application/json")
    if what not in ("fit.json", "model.toml", "report.html", "actuator.zip"):
        return JSONResponse({"sentence": "There is no such file."}, 404)
    if now is None:
        raise InputError("There is no fit yet: fit the model first.")
    if what == "fit.json":
        return _file(json.dumps(now.told["json"], indent=2), what, "application/json")
    if what == "model.toml":
        return _file(now.told["toml"], what, "application/toml")
    with tempfile.TemporaryDirectory() as folder:
        if what == "report.html":
            target = Path(folder) / what
            await bench.made(Kind.REPORT, target)
            return _file(target.read_bytes(), what, "text/html")
        target = Path(folder) / "actuator"
        await bench.made(Kind.C, target)
        return _file(await asyncio.to_thread(_zipped, target), what, "application/zip")


def _zipped(folder: Path) -> bytes:
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(folder.rglob("*")):
            archive.write(file, file.relative_to(folder.parent))
    return data.getvalue()


def _file(data: str | bytes, name: str, kind: str) -> Response:
    headers = {"content-disposition": f'attachment; filename="{name}"'}
    return Response(data, media_type=kind, headers=headers)


def _json(data: Any) -> str:
    """JSON without NaN or infinity: what is not known is null."""
    return json.dumps(_plain(data), allow_nan=False, separators=(",", ":"))


def _plain(data: Any) -> Any:
    if isinstance(data, np.ndarray):
        numbers = data.tolist()
        if np.isfinite(data).all():
            return numbers
        return [x if math.isfinite(x) else None for x in numbers]
    if isinstance(data, Mapping):
        return {key: _plain(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_plain(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data
