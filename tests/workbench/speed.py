"""How long a user waits: ``python tests/workbench/speed.py 100000`` measures it in a real browser.

Each figure is the time from what the user does to what is drawn. Nothing else should run meanwhile.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, final

import numpy as np

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
PATIENCE = 60_000
"""[ms] A machine that is busy may take so long."""

_ZOOM = """async (ends) => {
    const begin = performance.now();
    await look(ends);
    await new Promise(requestAnimationFrame);
    return performance.now() - begin;
}"""


@final
@dataclass(frozen=True)
class Waits:
    """Seconds that a user waits on a record of so many samples.

    Attributes:
        samples: of the record.
        first_s: from the command to the curve of the record.
        drawn_s: from the click to the first modelled curve.
        fit_s: from the click to the model that is solved.
        suspects_s: from then to the list of suspects.
        zoom_s: (N,) from a zoom to its picture.
    """

    samples: int
    first_s: float
    drawn_s: float
    fit_s: float
    suspects_s: float
    zoom_s: tuple[float, ...]

    def __str__(self) -> str:
        median, late = 1e3 * np.quantile(self.zoom_s, [0.5, 0.95])
        return (
            f"{self.samples} samples: record drawn after {self.first_s:.2f} s, a model "
            f"{self.drawn_s:.2f} s after the click, solved {self.fit_s:.2f} s after it, suspects "
            f"{self.suspects_s:.2f} s later; zoom {median:.0f} ms, 95 % within {late:.0f} ms"
        )


def record(file: Path, count: int) -> Path:
    """A growing triangle with gain, hysteresis, a lag of 20 ms and 5 nm of noise, at 10 kHz."""
    time_ = np.arange(count) / 1e4
    phase = (time_ * 10.0) % 1.0
    drive = (40.0 + 60.0 * np.arange(count) / count) * (1.0 - np.abs(2.0 * phase - 1.0))
    bend = 1e-10 * drive * (100.0 - drive) * np.where(phase < 0.5, -1.0, 1.0)
    reading = 1e-7 * drive + bend
    reading += 5e-9 * np.random.default_rng(1).standard_normal(count)
    table = np.column_stack([time_, drive, 1e6 * reading])
    np.savetxt(
        file, table, fmt="%.6g,%.7g,%.7g",
        header="time [s],voltage [V],displacement [um]", comments="",
    )  # fmt: skip
    return file


@contextmanager
def served(file: Path, folder: Path, before: Sequence[str] = ()) -> Iterator[str]:
    """A server in a process of its own, as a user starts it, and its address."""
    # What is installed has its bytecode; a tree in which none may be kept would compile it again.
    kept = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    command = [
        *before, sys.executable, "-m", "piezo_opt", "workbench", str(file), "--no-browser",
        "--session", str(folder / "session.json"),
    ]  # fmt: skip
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=kept) as server:
        assert server.stdout is not None
        try:
            found = re.search(r"http://127\.0\.0\.1:\d+/\S+", server.stdout.readline())
            assert found is not None
            yield found[0]
        finally:
            server.terminate()


def waits(count: int, zooms: int = 40) -> Waits:
    """Measure a record of so many samples; the browser runs already when the command is given."""
    from playwright.sync_api import sync_playwright

    with TemporaryDirectory() as name, sync_playwright() as playwright:
        folder = Path(name)
        file = record(folder / "record.csv", count)
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        page.set_default_timeout(10 * PATIENCE)
        for _ in range(2):  # the first one finds neither bytecode nor files in memory
            with TemporaryDirectory() as other, served(file, Path(other)) as address:
                page.goto(address)
                page.wait_for_selector("#overlay canvas")
        page.goto("about:blank")
        begin = time.perf_counter()
        with served(file, folder) as address:
            page.goto(address)
            page.wait_for_selector("#overlay canvas")
            first = time.perf_counter() - begin
            page.wait_for_selector("#fit:not([disabled])")
            begin = time.perf_counter()
            page.click("#fit")
            page.wait_for_selector("#residual canvas")
            drawn = time.perf_counter() - begin
            page.wait_for_selector("body[data-depth='0']")
            fit = time.perf_counter() - begin
            page.wait_for_selector("body[data-scored='yes']")
            suspects = time.perf_counter() - begin - fit
            page.wait_for_timeout(200)
            zoomed = _zoomed(page, zooms, (count - 1) / 1e4)
        browser.close()
    return Waits(count, first, drawn, fit, suspects, tuple(zoomed))


def _zoomed(page: Any, count: int, duration: float) -> list[float]:
    """Seconds of each zoom, to stretches of all lengths."""
    generator = np.random.default_rng(2)
    found = []
    for _ in range(count):
        width = duration * 10.0 ** generator.uniform(-2.0, 0.0)
        begin = generator.uniform(0.0, duration - width)
        found.append(1e-3 * float(page.evaluate(_ZOOM, [begin, begin + width])))
    return found


if __name__ == "__main__":
    for size in sys.argv[1:] or ["8000", "100000", "1000000"]:
        print(waits(int(size)), flush=True)
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}")
