"""Fitted transfer functions and order searches as a page of text."""

from __future__ import annotations

import numpy as np

from piezo_opt.linear_models.cascade import ComplexArray
from piezo_opt.linear_models.fitting import OrderSearch
from piezo_opt.linear_models.transfer import TransferFit, half_width, headline
from piezo_opt.measurement import FloatArray
from piezo_opt.units import show


def told(fit: TransferFit) -> str:
    """The model, its errors, its poles and zeros with 95 % intervals, and what to doubt."""
    record = fit.question.records.records[0]
    drive = {"held": "held between samples", "linear": "straight between samples",
             "bandlimited": "band-limited"}[record.between.value]  # fmt: skip
    lines = [
        f"{counted(fit.question.poles, 'pole')}, {counted(fit.question.zeros, 'zero')}; the drive "
        f"is taken as {drive}, "
        f"the start {'estimated' if fit.question.start.value == 'free' else 'at rest'}.",
        "",
        f"  G(s) = ({_written(fit.numerator)})",
        f"         / ({_written(fit.denominator)})   [{record.position_unit}/{record.drive_unit}]",
        "",
        "  " + ", ".join(f"{name} {text}" for name, text in headline(fit).items() if text),
        f"  {fit.whiteness[0].sentence}",
        "",
    ]
    wide = half_width(fit)
    lines += _roots("pole", fit.poles, fit.pole_sigma, wide)
    lines += _roots("zero", fit.zeros, fit.zero_sigma, wide)
    gain = f"{record.position_unit}/{record.drive_unit}"
    lines.append(
        f"  gain at rest  {show(fit.dc_gain, gain)} ± {show(wide * fit.dc_gain_sigma, gain)}"
    )
    lines += [f"\n! {sentence}" for sentence in fit.remarks]
    return "\n".join(lines)


def counted(number: int, word: str) -> str:
    """``"1 zero"``, ``"2 zeros"``."""
    return f"{number} {word}{'' if number == 1 else 's'}"


def _roots(word: str, roots: ComplexArray, sigma: FloatArray, wide: float) -> list[str]:
    lines = []
    for root, spread in zip(roots, sigma, strict=True):
        if root.imag < 0.0:
            continue
        if root.imag == 0.0:
            lines.append(f"  {word}  {root.real:.5g} ± {wide * spread[0]:.2g} 1/s")
            continue
        size = abs(root)
        lines.append(
            f"  {word}s {root.real:.5g} ± {wide * spread[0]:.2g}"
            f" ± j ({root.imag:.5g} ± {wide * spread[1]:.2g}) 1/s"
            f"   ({show(size / (2.0 * np.pi), 'Hz')}, damping {-root.real / size:.3g})"
        )
    return lines


def _written(falling: FloatArray) -> str:
    """``s^2 + 3.2 s + 64.5``."""
    degree = falling.size - 1
    text = ""
    for k, value in enumerate(falling):
        power = degree - k
        symbol = "" if power == 0 else "s" if power == 1 else f"s^{power}"
        number = "" if value == 1.0 and symbol else f"{abs(value):.5g}"
        joined = " ".join(piece for piece in (number, symbol) if piece)
        sign = "-" if value < 0.0 else "+"
        text += f" {sign} {joined}" if text else f"{'-' if value < 0.0 else ''}{joined}"
    return text


def order_table(search: OrderSearch) -> str:
    """One row for each order, the chosen one marked."""
    unit = search.rows[0].fit.question.records.records[0].position_unit
    header = ["", "poles", "zeros", "fit %", f"MSE [{unit}^2]", f"FPE [{unit}^2]", "test fit %"]
    chosen = search.chosen
    lines = [header]
    for row in search.rows:
        own = row.fit.metrics
        lines.append(
            [
                "*" if row is chosen else "",
                str(row.fit.question.poles),
                str(row.fit.question.zeros),
                f"{own.fit_percent:.2f}",
                f"{own.mse:.3g}",
                "" if own.fpe is None else f"{own.fpe:.3g}",
                "" if row.test is None else f"{row.test.fit_percent:.2f}",
            ]
        )
    widths = [max(len(line[k]) for line in lines) for k in range(len(header))]
    table = "\n".join(
        "  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in lines
    )
    return f"{table}\nEnded early: these orders were finished." if search.interrupted else table
