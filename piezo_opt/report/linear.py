"""The chapters of black-box linear models."""

from __future__ import annotations

from piezo_opt.linear_models import FrequencyResponse, OrderSearch, TransferFit
from piezo_opt.linear_models.telling import counted
from piezo_opt.linear_models.transfer import headline
from piezo_opt.report import figures, linear_figures
from piezo_opt.report.chapters import chapter, records_of
from piezo_opt.report.page import Block, Heading, Lead, Listing, Picture, Points, Table


def _units(fit: TransferFit) -> tuple[str, str]:
    record = fit.question.records.records[0]
    return record.drive_unit, record.position_unit


def _span(fit: TransferFit) -> tuple[float, float]:
    records = fit.question.records.records
    high = 0.5 / min(one.step for one in records)
    return max(1.0 / max(one.duration for one in records), 1e-4 * high), high


@chapter.register
def _transfer(fit: TransferFit) -> list[Block]:
    question, numbers = fit.question, headline(fit)
    stable = bool((fit.poles.real < 0.0).all())
    blocks: list[Block] = [
        Heading(
            f"Transfer function: {counted(question.poles, 'pole')}, "
            f"{counted(question.zeros, 'zero')}"
        ),
        Lead(
            f"Fit {numbers['fit']}, {numbers['rms']} rms. {fit.whiteness[0].sentence}",
            good=all(one.white for one in fit.whiteness),
        ),
        Listing(str(fit)),
        *records_of(question.records.records),
        Picture(
            linear_figures.reading([("model", fit.misfits[0])]),
            "The reading and, below, what the model leaves over.",
        ),
        Picture(
            linear_figures.poles_and_zeros(fit),
            "Poles and zeros with 95 % intervals; one as wide as its value is cut there.",
        ),
        Picture(
            linear_figures.bode([("model", fit.transfer)], _units(fit), _span(fit)),
            "Up to half the sampling rate.",
        ),
        Picture(figures.correlations(fit), "A good model leaves correlations within the band."),
    ]
    if stable and fit.dc_gain != 0.0:
        blocks.append(
            Picture(linear_figures.step([("model", fit.transfer)], _units(fit)), "From rest.")
        )
    if fit.remarks:
        blocks += [Heading("Remarks", 3), Points(fit.remarks)]
    return blocks


@chapter.register
def _orders(search: OrderSearch) -> list[Block]:
    rows = search.rows
    unit = rows[0].fit.question.records.records[0].position_unit
    best = search.best.question
    columns = [
        ("poles", tuple(str(r.fit.question.poles) for r in rows)),
        ("zeros", tuple(str(r.fit.question.zeros) for r in rows)),
        ("fit [%]", tuple(f"{r.fit.metrics.fit_percent:.2f}" for r in rows)),
        (f"MSE [{unit}²]", tuple(f"{r.fit.metrics.mse:.3g}" for r in rows)),
        (f"FPE [{unit}²]", tuple(f"{r.fit.metrics.fpe:.3g}" for r in rows)),
    ]
    if rows[0].test is not None:
        cells = tuple("" if r.test is None else f"{r.test.fit_percent:.2f}" for r in rows)
        columns.append(("test fit [%]", cells))
    judged = "on records not fitted to" if rows[0].test is not None else "by FPE"
    return [
        Heading("Orders"),
        Lead(
            f"{counted(best.poles, 'pole')} and {counted(best.zeros, 'zero')}: the smallest order "
            f"that predicts as well as the best one, judged {judged}."
        ),
        Table(tuple(columns)),
        Picture(linear_figures.orders(search), "Errors of the orders tried."),
        *chapter(search.best),
    ]


@chapter.register
def _response(response: FrequencyResponse) -> list[Block]:
    low, high = float(response.frequency[0]), float(response.frequency[-1])
    blocks: list[Block] = [
        Heading("Frequency response"),
        Listing(str(response)),
        Picture(
            linear_figures.bode([], response.units, (low, high), response),
            "Best linear approximation with noise and distortion.",
        ),
    ]
    free = linear_figures.free_lines(response)
    if free is not None:
        blocks.append(Picture(free, "Even and odd distortion beside the noise."))
    return blocks
