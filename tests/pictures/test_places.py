"""Pictures of where a residual lives carry what the comparison found."""

from __future__ import annotations

import numpy as np
import pytest

from piezo_opt.comparison.misfit import Misfit
from piezo_opt.comparison.where import Where, where
from piezo_opt.errors import InputError
from piezo_opt.measurement import Measurement
from piezo_opt.pictures import Picture, Style, plain
from piezo_opt.pictures.places import BANDS, picture, pictures


def misfit(count: int) -> Misfit:
    """A residual that is a tone of 40 nm at 50 Hz and white noise, of a triangle."""
    time = np.arange(count) / 1000.0
    drive = 50.0 * (1.0 - np.abs((time / 0.4) % 2.0 - 1.0))
    error = 4e-8 * np.sqrt(2.0) * np.sin(2.0 * np.pi * 50.0 * time)
    error += 1e-9 * np.random.default_rng(1).standard_normal(count)
    record = Measurement(time, drive, 1e-7 * drive + error)
    return Misfit(record, 1e-7 * drive)


def seen(count: int) -> tuple[Where, dict[str, Picture]]:
    left = misfit(count)
    found = where(left)
    return found, pictures([("model", left, found)])


@pytest.mark.parametrize("count", [4000, 200_000])
def test_a_tone_stands_in_the_spectrum_whatever_is_thinned(count: int) -> None:
    found, made = seen(count)
    above, below = picture(made, "frequency").panels
    reading, left = above.traces
    assert reading.x is left.x
    assert left.x.size <= max(BANDS, found.by_frequency.frequency.size if count < 5000 else BANDS)
    assert np.all(np.diff(left.x) > 0)
    top = int(np.argmax(left.y))
    assert left.x[top] == pytest.approx(50.0, rel=0.02)
    assert left.y[top] > 20.0 * np.median(left.y)
    assert below.traces[0].x.size <= 4000
    assert float(np.nanmax(below.traces[0].y)) == np.nanmax(found.by_frequency.coherence)
    assert below.level is not None
    assert below.level[0] == found.by_frequency.band


def test_a_band_holds_the_mean_power_of_its_lines() -> None:
    found, made = seen(200_000)
    lines = found.by_frequency
    shown = picture(made, "frequency").panels[0]
    edges = np.geomspace(lines.frequency[0], lines.frequency[-1], BANDS + 1)
    last = lines.frequency >= edges[-2]
    expected = np.sqrt(np.mean(lines.error[last]))
    factor = {"nm/√Hz": 1e9, "pm/√Hz": 1e12, "µm/√Hz": 1e6}[shown.up.unit]
    assert shown.traces[1].y[-1] == pytest.approx(factor * expected, rel=1e-12)


def test_means_by_branch_are_those_of_the_comparison() -> None:
    found, made = seen(4000)
    shown = picture(made, "branch")
    assert shown.beside
    for panel, mean in zip(
        shown.panels, (found.by_branch.loading_mean, found.by_branch.unloading_mean), strict=True
    ):
        cloud, line = panel.traces
        assert (cloud.style, line.style) == (Style.CLOUD, Style.MARKED)
        assert line.y == pytest.approx(1e9 * mean)
        edges = found.by_branch.edges
        assert line.x[0] == 0.5 * (edges[0] + edges[1])
        assert cloud.y.size + 5 >= 4000 / 2
        assert float(np.max(np.abs(cloud.y))) > 40.0


def test_a_page_gets_one_abscissa_only_where_it_rises_and_all_share_it() -> None:
    _, made = seen(4000)
    told = {name: plain(one)["panels"][0] for name, one in made.items()}
    assert told["branch"]["x"] is None
    assert told["branch"]["traces"][1]["x"].size == told["branch"]["traces"][1]["y"].size
    assert told["time"]["x"].size == told["time"]["traces"][0]["y"].size
    assert told["time"]["traces"][0]["x"] is None


def test_a_view_that_is_not_there_is_refused() -> None:
    _, made = seen(4000)
    with pytest.raises(InputError, match="no picture by 'colour': there is branch, frequency"):
        picture(made, "colour")
