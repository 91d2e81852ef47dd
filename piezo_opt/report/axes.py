"""The chapters of stages with several drives and axes."""

from __future__ import annotations

import numpy as np

from piezo_opt.linear_models import AxesFit, ResponseMatrix
from piezo_opt.report import axes_figures
from piezo_opt.report.chapters import chapter
from piezo_opt.report.page import Block, Heading, Lead, Listing, Picture, Table, Text
from piezo_opt.units import show


@chapter.register
def _matrix(response: ResponseMatrix) -> list[Block]:
    level = show(float(np.sqrt(np.mean(response.amplitude**2))), response.units[0])
    return [
        Heading(f"Frequency responses at {level} rms"),
        Listing(str(response)),
        Picture(
            axes_figures.matrix(response),
            "Best linear approximation. Lines: standard deviation of it, from noise alone and with "
            "the nonlinear distortion of the draws.",
        ),
    ]


@chapter.register
def _axes(found: AxesFit) -> list[Block]:
    model = found.model
    blocks: list[Block] = [
        Heading(
            f"{model.drives} drives, {model.axes} axes, {model.modes} modes, "
            f"{len(model.amplitudes)} "
            + ("amplitude" if len(model.amplitudes) == 1 else "amplitudes")
        )
    ]
    if found.errors and found.test is not None:
        label, best = found.errors[0]
        told = " / ".join(f"{100.0 * one.mean:.2f}" for one in best.levels)
        blocks += [
            Lead(f"Simulation error on held-out realisations, {label}: {told} %."),
            Table(_columns(found)),
            Text(
                "Error of an axis: sqrt(mean e²) / std(y) of each period, mean over periods, "
                "realisations and axes. No fit has seen these realisations.",
                quiet=True,
            ),
            Picture(
                axes_figures.errors(found.errors, found.responses),
                "Error by amplitude; dashed, the noise of a mean period.",
            ),
        ]
    blocks += [
        Heading("Model", 3),
        Listing(str(model)),
    ]
    if len(model.amplitudes) > 1:
        blocks.append(
            Picture(
                axes_figures.softening(model),
                "What depends on the amplitude: the strongest modes, and the effects in front of "
                "each axis, against the middle amplitude.",
            )
        )
    middle = found.responses[len(found.responses) // 2]
    blocks += [
        Heading("Frequency responses", 3),
        Listing("\n\n".join(map(str, found.responses))),
        Picture(
            axes_figures.matrix(middle, model),
            "Measured and modelled at the middle amplitude; deviations are of what is measured.",
        ),
    ]
    if found.test is not None and found.judged is not None:
        for level, response in zip(found.test.levels, found.responses, strict=True):
            told = show(float(np.sqrt(np.mean(response.amplitude**2))), response.units[0])
            blocks.append(
                Picture(
                    axes_figures.error_spectrum(found.judged, level, response),
                    f"Held-out realisations at {told}: where the error stands on the distortion, a "
                    "better linear model would change nothing.",
                )
            )
    return blocks


def _columns(found: AxesFit) -> tuple[tuple[str, tuple[str, ...]], ...]:
    levels = found.errors[0][1].levels
    unit = found.model.units[0]
    labels = tuple(label for label, _ in found.errors)
    columns = [("model, held-out error [%]", labels)]
    for k, level in enumerate(levels):
        name = show(float(np.sqrt(np.mean(level.amplitude**2))), unit)
        columns.append(
            (name, tuple(f"{100.0 * error.levels[k].mean:.2f}" for _, error in found.errors))
        )
    return tuple(columns)
