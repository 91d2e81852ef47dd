"""The README begins with what the package draws."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
from matplotlib.image import imread

ROOT = Path(__file__).resolve().parents[2]


def test_the_first_picture_is_what_the_demo_fits(tmp_path: Path) -> None:
    file = ROOT / "docs" / "first_picture.py"
    specification = importlib.util.spec_from_file_location("first_picture", file)
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    rms = module.draw(tmp_path / "again.png")
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert f"{1e9 * rms:.0f} nm rms" in readme
    assert "docs/first_picture.png" in readme
    kept, drawn = imread(module.PICTURE), imread(tmp_path / "again.png")
    assert kept.shape == drawn.shape
    # Fonts may differ a little between machines; another curve would differ in far more.
    assert np.mean(np.abs(kept - drawn)) < 0.01
