"""Writes one page per effect while the documentation is built, from what its class declares.

The pages cannot fall behind the code: name, place, equation, parameters, options and references
are read from the catalogue, and a new effect has its page without a line here.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Iterator
from dataclasses import fields

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

from piezo_opt.effects.base import Effect, Parameter, Place
from piezo_opt.effects.catalogue import CATALOGUE

FOLDER = "effects"


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put the pages into the navigation, under the section that holds their index."""
    index = f"{FOLDER}/index.md"
    for entry in config.nav or []:
        for section in entry.values():
            if isinstance(section, list) and index in section:
                section[:] = [index, *({name: f"{FOLDER}/{name}.md"} for name in CATALOGUE)]
                return config
    raise ValueError(f"mkdocs.yml: no section of nav holds {index}; add one.")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the index and the pages to the files of the site."""
    pages = {"index": index(), **{name: page(kind()) for name, kind in CATALOGUE.items()}}
    for name, content in pages.items():
        files.append(File.generated(config, f"{FOLDER}/{name}.md", content=content))
    return files


def index() -> str:
    """The catalogue as tables, one for each place of the chain."""
    effects = [kind() for kind in CATALOGUE.values()]
    lines = [
        "# Effects",
        "",
        "What can be in a model of a piezoelectric actuator, in the order of the chain. An",
        "optional effect has one *gate*: the parameter at whose null value it vanishes.",
        "These pages are generated from the classes.",
        "",
    ]
    for place in Place:
        members = [effect for effect in effects if effect.place is place]
        if members:
            lines += [f"## {place.value.capitalize()} [{place.unit}]", "", _acts(place), ""]
            lines += _table(
                ("effect", "what it is", "gate"),
                ((f"[`{e.name}`]({e.name}.md)", e.summary, _gate(e)) for e in members),
            )
    return "\n".join(lines)


def page(effect: Effect) -> str:
    """Everything an effect declares, as one page."""
    kind = type(effect)
    lines = [
        f"# {effect.name}",
        "",
        effect.summary,
        "",
        "```python",
        f"from piezo_opt.effects import {kind.__name__}",
        "```",
        "",
        f"Acts on the **{effect.place.value}** [{effect.place.unit}]. {_acts(effect.place)}",
        "",
        _about_gate(effect),
        "",
    ]
    if effect.requires:
        lines += [f"Needs {' and '.join(_need(need) for need in effect.requires)}.", ""]
    lines += ["## Equation", "", *_body(kind), ""]
    lines += ["## Parameters", ""]
    lines += [f"Their full names begin with the effect's: `{effect.name}.…`.", ""]
    lines += _table(
        ("name", "unit", "meaning", "nominal", "bounds", "typical", ""),
        (
            (
                f"`{name}`",
                f"`{p.unit}`",
                p.meaning,
                f"{p.nominal:g}",
                _range(p.bounds),
                _range(p.typical) if p.typical else "",
                ", ".join(_marks(p)),
            )
            for name, p in effect.parameters.items()
        ),
    )
    if effect.declared_states:
        lines += ["## States", ""]
        lines += _table(
            ("name", "unit", "meaning", "elements"),
            (
                (f"`{name}`", f"`{s.unit}`", s.meaning, f"{effect.states[name]}")
                for name, s in effect.declared_states.items()
            ),
        )
    if fields(kind):  # type: ignore[arg-type]
        lines += ["## Options", ""]
        lines += _table(
            ("name", "default"),
            ((f"`{name}`", f"`{value!r}`") for name, value in effect.options.items()),
        )
    lines += [f"Source: `{kind.__module__.replace('.', '/')}.py`", ""]
    return "\n".join(lines)


def _body(kind: type[Effect]) -> Iterator[str]:
    """The docstring without its first line: the equation as code, then the text."""
    for line in (inspect.getdoc(kind) or "").splitlines()[1:]:
        if line.startswith("References:"):
            yield from ("## References", "")
            line = line.removeprefix("References:").strip()
        # Markdown would read the bars and stars of running text as marks of its own.
        yield line if line.startswith("    ") else line.replace("*", r"\*").replace("_", r"\_")


def _acts(place: Place) -> str:
    if place.is_line:
        return "Effects on a line act one after another, in the order written."
    return "Contributions to a balance add; their order does not matter."


def _gate(effect: Effect) -> str:
    return f"`{effect.gate}`" if effect.gate else "structural"


def _about_gate(effect: Effect) -> str:
    if effect.gate is None:
        return "Structural: part of the base model, without a gate."
    null = effect.parameters[effect.gate].null
    return f"It vanishes at `{effect.name}.{effect.gate}` = {null:g}: its gate."


def _need(need: str) -> str:
    if need.startswith("channel:"):
        return f"a recorded channel `{need.removeprefix('channel:')}`"
    return {
        "loop": "a hysteresis loop in the model",
        "hysteresis": "a hysteresis law",
        "motion": "mechanics in the model",
    }[need]


def _marks(parameter: Parameter) -> Iterator[str]:
    if parameter.null is not None:
        yield "gate"
    if parameter.fixed:
        yield "kept fixed unless freed"
    if parameter.per_record:
        yield "one value per record"


def _range(bounds: tuple[float, float]) -> str:
    return " .. ".join(
        "∞" if b == math.inf else "-∞" if b == -math.inf else f"{b:g}" for b in bounds
    )


def _table(head: tuple[str, ...], rows: Iterator[tuple[str, ...]]) -> list[str]:
    cells = [head, ("---",) * len(head)]
    cells += [tuple(cell.replace("|", r"\|") for cell in row) for row in rows]
    return [*(f"| {' | '.join(row)} |" for row in cells), ""]
