"""An input shaper as C, what :meth:`piezo_opt.control.Shaper.shaped` does sample by sample."""

from __future__ import annotations

from typing import Final

from piezo_opt.control import Shaper
from piezo_opt.export.c.printer import Precision
from piezo_opt.export.laws import written
from piezo_opt.export.laws.written import Written

_BODY: Final = """\
#define LENGTH {length}
#define TAPS {taps}

void {n}_init({n} *c)
{{
    int i;
    for (i = 0; i < LENGTH; ++i) c->past[i] = {zero};
    c->at = c->begun = c->status = 0;
}}

{real} {n}_act({n} *c, {real} command)
{{
    static const int later[TAPS] = {{{later}}}; /* samples */
    static const {real} weight[TAPS] = {{{weight}}};
    {real} shaped = {zero};
    int i;
    c->status = 0;
    if (!{n}_is_number(command)) {{
        c->status = {n}_MISSED;
        command = c->past[c->at];
    }}
    if (!c->begun) {{
        /* Before the first sample the command was what it is. */
        for (i = 0; i < LENGTH; ++i) c->past[i] = command;
        c->begun = 1;
    }}
    c->at = c->at + 1 < LENGTH ? c->at + 1 : 0;
    c->past[c->at] = command;
    for (i = 0; i < TAPS; ++i) {{
        const int from = c->at - later[i];
        shaped += weight[i] * c->past[from < 0 ? from + LENGTH : from];
    }}
    return shaped;
}}
"""


def shaper(law: Shaper, name: str, precision: Precision, period: float) -> Written:
    """Header and source of a shaper.

    Args:
        law: its impulses.
        name: prefix of every symbol.
        precision: type of the numbers.
        period: of the sampling [s]; an impulse between two samples is shared by them.
    """
    later, weights = law.taps(period)
    title = f"the input shaper {law.name}, which leaves a resonance at rest."
    about = "\n".join(
        f"   {a:.6g} of the command {t:.6g} s later"
        for a, t in zip(law.amplitudes, law.times, strict=True)
    )
    words = {
        "n": name, "real": precision.name, "zero": precision.number(0.0),
        "length": str(int(later[-1]) + 1), "taps": str(later.size),
        "later": ", ".join(str(int(k)) for k in later),
        "weight": ", ".join(precision.number(float(w)) for w in weights),
    }  # fmt: skip
    past = f"    {precision.name} past[{words['length']}];"
    fields = f"{past:<34} /* commands of the last samples */\n"
    fields += "    int at;                        /* where the last one stands */\n"
    fields += "    int begun;                     /* whether there was a sample */\n"
    header, source = written.framed(
        name, precision, title, about, period, fields,
        "The command, shaped; a drive or a position, as it is given.",
        f"{precision.name} command", _BODY.format(**words),
    )  # fmt: skip
    return Written(
        title, header, source, ("command",), f"{name}_act(&one, ({precision.name})row[0])", "shaped"
    )
