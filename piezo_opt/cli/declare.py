"""How commands are declared: annotations say what options and arguments are, click parses them.

    def fit(
        records: Annotated[list[Path], Argument(help="Record files.")],
        every: Annotated[int, Option(min=1, metavar="N", help="Keep every N-th.")] = 1,
    ) -> None:
        \"\"\"Fit a model.\"\"\"

An argument's name is the option's, ``--every``; a ``bool`` has ``--browser/--no-browser`` unless
it is named. What may be missing has a default; ``list`` is given several times, ``tuple`` takes so
many words, an ``Enum`` is one of its values.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from types import NoneType, UnionType
from typing import (
    Annotated,
    Any,
    Final,
    TypeVar,
    Union,
    final,
    get_args,
    get_origin,
    get_type_hints,
)

import click

_Command = TypeVar("_Command", bound=Callable[..., None])

echo: Final = click.echo
Exit: Final = click.exceptions.Exit


@final
class Option:
    """What is said by name.

    Args:
        names: as they are written, ``"-q", "--quiet"``; by default the argument's own.
        help: a sentence.
        metavar: what the help shows in the place of a value.
        min, max: bounds of a number.
    """

    def __init__(
        self,
        *names: str,
        help: str = "",
        metavar: str | None = None,
        min: float | None = None,
        max: float | None = None,
    ) -> None:
        self.names, self.help, self.metavar = names, help, metavar
        self.min, self.max = min, max


@final
@dataclass(frozen=True)
class Argument:
    """What is said by its place."""

    help: str = ""
    metavar: str | None = None


@final
class Commands(click.Group):
    """Commands below a name of their own, each declared by a function."""

    def __init__(self, name: str, help: str) -> None:
        super().__init__(name, help=help, no_args_is_help=True)

    def command(self, *_: Any, **__: Any) -> Callable[[_Command], _Command]:  # type: ignore[override]
        """Takes a function in as a command of its name, and leaves it as it is."""

        def taken(function: _Command) -> _Command:
            self.add_command(command(function))
            return function

        return taken

    def list_commands(self, _: click.Context) -> list[str]:
        """In the order in which they were declared."""
        return list(self.commands)


@final
class _Documented(click.Command):
    """A command whose help explains its arguments, too."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Arguments, then options."""
        told = [
            (one.make_metavar(ctx), f"{one.said}{'  [required]' if one.required else ''}")
            for one in self.get_params(ctx)
            if isinstance(one, _Placed)
        ]
        if told:
            with formatter.section("Arguments"):
                formatter.write_dl(told)
        options = [one for one in self.get_params(ctx) if isinstance(one, click.Option)]
        with formatter.section("Options"):
            formatter.write_dl([row for one in options if (row := one.get_help_record(ctx))])


@final
class _Placed(click.Argument):
    """An argument with a sentence."""

    def __init__(self, name: str, said: str, **more: Any) -> None:
        super().__init__([name], **more)
        self.said = said


@final
class _OneOf(click.Choice[str]):
    """A member of an enumeration, by its value."""

    def __init__(self, kind: type[Enum]) -> None:
        super().__init__([str(one.value) for one in kind])
        self._kind = kind

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The member; what is none is refused."""
        if isinstance(value, self._kind):
            return value
        return self._kind(super().convert(value, param, ctx))


def command(function: Callable[..., None], name: str | None = None) -> click.Command:
    """The command that a function declares."""
    hints = get_type_hints(function, include_extras=True)
    parameters = inspect.signature(function).parameters.values()
    several = {one.name for one in parameters if get_origin(_kind(hints[one.name])) is list}

    def called(**given: Any) -> None:
        for one in several:
            given[one] = list(given[one] or ()) or None
        function(**given)

    return _Documented(
        name or function.__name__.replace("_", "-"),
        callback=called,
        help=inspect.getdoc(function),
        params=[_parameter(one, hints[one.name]) for one in parameters],
    )


def _parameter(one: inspect.Parameter, hint: Any) -> click.Parameter:
    """An option or argument of click."""
    said = next((a for a in get_args(hint)[1:] if isinstance(a, Option | Argument)), Option())
    kind, required = _kind(hint), one.default is inspect.Parameter.empty
    many: dict[str, Any] = {}
    if get_origin(kind) is list:
        (kind,) = get_args(kind)
        many = {"nargs": -1} if isinstance(said, Argument) else {"multiple": True}
    elif get_origin(kind) is tuple:
        many = {"nargs": len(get_args(kind))}
        kind = get_args(kind)[0]
    if not required:
        many["default"] = one.default.value if isinstance(one.default, Enum) else one.default
    if isinstance(said, Argument):
        return _Placed(
            one.name, said.help, type=_type(kind), required=required, metavar=said.metavar, **many
        )
    dashed = one.name.replace("_", "-")
    usual = f"--{dashed}/--no-{dashed}" if kind is bool else f"--{dashed}"
    return click.Option(
        [one.name, *(said.names or (usual,))],
        type=None if kind is bool else _type(kind, said.min, said.max),
        is_flag=kind is bool, required=required, help=said.help, show_default=True,
        metavar=said.metavar or ("N" if kind in (int, float) else None), **many,
    )  # fmt: skip


def _kind(hint: Any) -> Any:
    """The type that is meant, without what is said of it and without None."""
    if get_origin(hint) is Annotated:
        hint = get_args(hint)[0]
    if get_origin(hint) in (Union, UnionType):
        (hint,) = (one for one in get_args(hint) if one is not NoneType)
    return hint


def _type(kind: Any, least: float | None = None, most: float | None = None) -> click.ParamType[Any]:
    if kind is Path:
        return click.Path(path_type=Path)
    if issubclass(kind, Enum):
        return _OneOf(kind)
    if kind in (int, float):
        ranged: Any = click.IntRange if kind is int else click.FloatRange
        bounded = least is not None or most is not None
        plain = type(click.INT if kind is int else click.FLOAT)
        number: click.ParamType[Any] = ranged(least, most) if bounded else plain()
        number.name = "whole number" if kind is int else "number"
        return number
    return click.STRING
