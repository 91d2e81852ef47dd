"""A record that no page has seen: a Bouc-Wen loop with creep, made here, in microns."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest


@pytest.fixture(scope="session")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """400 samples of a triangle that grows: gain, hysteresis, 8 % creep and 5 nm of noise."""
    step = 0.05
    time = step * np.arange(400)
    phase = (time / 4.0) % 1.0
    drive = (0.4 + 0.03 * time) * 100.0 * (1.0 - np.abs(2.0 * phase - 1.0))
    hysteretic = creep = 0.0
    position = np.zeros(time.size)
    for k in range(1, time.size):
        parts = 20
        for _ in range(parts):
            move = (drive[k] - drive[k - 1]) / parts
            hysteretic += 3e-8 * move - 2e-2 * abs(move) * hysteretic
            creep += step / parts / 2.0 * (0.08 * 1e-7 * drive[k] - creep)
        position[k] = 1e-7 * drive[k] - hysteretic + creep
    position += 5e-9 * np.random.default_rng(4).standard_normal(time.size)
    file = tmp_path_factory.mktemp("records") / "loop.csv"
    rows = "".join(
        f"{t:.6g},{v:.9g},{1e6 * y:.9g}\n" for t, v, y in zip(time, drive, position, strict=True)
    )
    file.write_text("time [s],voltage [V],displacement [um]\n" + rows)
    return file
