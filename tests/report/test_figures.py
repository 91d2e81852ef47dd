"""Pictures show the data asked for, with units on their axes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib import rcParams
from matplotlib.figure import Figure

from piezo_opt import demo
from piezo_opt.comparison import Entry, Misfit, compare
from piezo_opt.identification import Fit, StartResult, solve
from piezo_opt.measurement import Measurement
from piezo_opt.pictures.picture import prefixed
from piezo_opt.report import figures
from piezo_opt.report.style import thinned
from piezo_opt.simulation import INITIAL


@pytest.fixture(scope="module")
def fit() -> Fit:
    return solve(demo.question())


@pytest.fixture(scope="module")
def long(fit: Fit) -> Entry:
    """A long record on which the measurement lags 50 nm behind every step, for 50 ms."""
    time = np.arange(40_000) / 1000.0
    drive = 60.0 * (np.floor(time / 0.5) % 2.0) * (1.0 + np.floor(time / 20.0))
    noise = 1e-8 * np.random.default_rng(0).normal(size=time.size)
    late = 5e-8 * np.sign(np.sin(2 * np.pi * time)) * np.exp(-(time % 0.5) / 0.05)
    model = 1e-7 * drive
    record = Measurement(
        time=time, drive=drive, position=model + noise + late, startup=1.0, allow_saturated=True
    )
    return Entry("model", fit, (Misfit(record, model),), held_out=True)


def labels(figure: Figure) -> list[str]:
    return [text for axis in figure.axes for text in (axis.get_xlabel(), axis.get_ylabel())]


def test_loop(fit: Fit) -> None:
    figure = figures.loop(compare(fit).entries)
    assert labels(figure) == ["drive [V]", "displacement [µm]"]
    measured, modelled = figure.axes[0].lines
    assert measured.get_xydata() == pytest.approx(
        np.column_stack([fit.records[0].drive, 1e6 * fit.records[0].position])
    )
    assert modelled.get_ydata() == pytest.approx(1e6 * fit.readings[0])


def test_over_time_has_the_error_below(fit: Fit) -> None:
    figure = figures.over_time(compare(fit).entries)
    above, below = figure.axes
    assert above.get_ylabel() == "displacement [µm]"
    assert " ".join(below.get_ylabel().split()).endswith("model [nm]")
    assert below.get_xlabel() == "time [s]"
    assert below.lines[0].get_ydata() == pytest.approx(1e9 * fit.residual())


def test_long_records_are_thinned_without_losing_a_peak(long: Entry) -> None:
    figure = figures.over_time([long])
    drawn = np.asarray(figure.axes[1].lines[0].get_ydata(), dtype=float)
    error = 1e9 * long.misfits[0].error
    assert drawn.size <= 4000 < error.size
    assert (np.nanmin(drawn), np.nanmax(drawn)) == (
        pytest.approx(error.min()),
        pytest.approx(error.max()),
    )
    time, values = thinned(np.arange(9000.0), np.sin(np.arange(9000.0)))
    assert np.sin(time) == pytest.approx(values)


def test_by_branch_shares_its_scale(long: Entry) -> None:
    figure = figures.by_branch([long])
    loading, unloading = figure.axes
    assert loading.get_ylim() == unloading.get_ylim()
    assert loading.get_title(loc="left").startswith("Loading")
    assert loading.get_ylabel().endswith("model [nm]")


def test_spectrum_with_coherence(long: Entry, fit: Fit) -> None:
    figure = figures.spectrum([long])
    assert figure is not None
    assert [" ".join(label.split()) for label in labels(figure)] == [
        "",
        "density [nm/√Hz]",
        "frequency [Hz]",
        "coherence of error and drive",
    ]
    assert figures.spectrum(compare(fit).entries) is None


def test_after_steps_is_in_log_time(long: Entry) -> None:
    figure = figures.after_events([long])
    assert figure is not None
    (axis,) = figure.axes
    assert axis.get_xscale() == "log"
    assert "After steps" in axis.get_title(loc="left")
    assert axis.get_xlabel().endswith("[s]")
    values = np.asarray(axis.lines[0].get_ydata(), dtype=float)
    assert values[0] == pytest.approx(-50.0, abs=8.0)
    assert abs(values[-1]) < 5.0


def test_by_amplitude_only_where_there_are_several(long: Entry, fit: Fit) -> None:
    assert figures.by_amplitude([long]) is not None
    assert figures.by_amplitude(compare(fit).entries) is None


def test_correlations_show_the_band(long: Entry) -> None:
    figure = figures.correlations(long)
    noise = long.whiteness[0]
    assert [axis.get_xlabel().split(" [")[1] for axis in figure.axes] == ["samples]"] * 2
    for axis in figure.axes:
        box = axis.patches[0].get_extents().transformed(axis.transData.inverted())
        assert (box.y0, box.y1) == (pytest.approx(-noise.band), pytest.approx(noise.band))


def test_trajectories_have_a_panel_for_each_unknown(fit: Fit) -> None:
    figure = figures.trajectories(fit)
    assert figure is not None
    shown = [axis for axis in figure.axes if axis.get_visible()]
    assert len(shown) == len(fit.names) + 1
    titles = [axis.get_title(loc="left") or axis.get_title() for axis in shown]
    assert titles[0] == "piezo_gain.d [nm/V]"
    assert titles[-1] == "rms error [nm]"
    assert shown[0].lines[0].get_ydata()[-1] == pytest.approx(1e9 * fit.values["piezo_gain.d"])


def test_long_names_stay_in_the_picture(fit: Fit) -> None:
    """What moves has the longest: states at the start, with a unit that takes three characters."""
    names = (f"{INITIAL}second_order.w",) * 3
    trace = replace(fit.trace, names=names, values=fit.trace.values[:, :3])
    figure = figures.trajectories(replace(fit, trace=trace))
    assert figure is not None
    figure.draw_without_rendering()
    for axis in figure.axes[:3]:
        title = " ".join(axis.get_title(loc="left").split())
        assert title.startswith("second_order.w at start [")
        for text in (axis.title, axis._left_title):
            assert text.get_window_extent().x1 <= figure.bbox.x1


def test_estimates_are_relative(fit: Fit) -> None:
    figure = figures.estimates(fit)
    assert figure is not None
    (axis,) = figure.axes
    assert axis.get_xlabel() == "deviation from the estimate [%]"
    low, high = fit.interval("piezo_gain.d")
    half = 50.0 * (high - low) / fit.values["piezo_gain.d"]
    assert axis.lines[0].get_xdata() == pytest.approx([-half, half])


def test_multi_start_counts_the_same_optimum(fit: Fit) -> None:
    assert figures.multi_start(fit) is None
    starts = tuple(
        StartResult(k, rms, "converged", {}, 10) for k, rms in enumerate((1e-7, 1.00001e-7, 3e-7))
    )
    figure = figures.multi_start(replace(fit, starts=starts))
    assert figure is not None
    legend = figure.axes[0].get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == [
        "same optimum: 2 of 3",
        "elsewhere",
    ]


def test_no_state_is_left_behind(fit: Fit) -> None:
    before = dict(rcParams)
    figures.loop(compare(fit).entries)
    assert dict(rcParams) == before


def test_prefixes() -> None:
    assert prefixed("m", np.array([2e-6])) == (pytest.approx(1e6), "µm")
    assert prefixed("m/V", np.array([2e-7])) == (pytest.approx(1e9), "nm/V")
    assert prefixed("V", np.array([0.5])) == (1.0, "V")
    assert prefixed("1/V", np.array([2e-3])) == (1.0, "1/V")
    assert prefixed("m", np.zeros(2)) == (1.0, "m")
