"""What a command declares is what it takes, and what its help says."""

from enum import Enum
from pathlib import Path
from typing import Annotated

import pytest
from click.testing import CliRunner

from piezo_opt.cli.declare import Argument, Commands, Option, command, echo


class Way(Enum):
    """Ways to travel."""

    ON_FOOT = "on-foot"
    BY_SEA = "by-sea"


def travel(
    places: Annotated[list[Path], Argument(help="Where to go.")],
    way: Annotated[Way, Option(help="How.")] = Way.ON_FOOT,
    other: Annotated[Way | None, Option(help="How else.")] = None,
    days: Annotated[int, Option(min=1, max=9, help="How long.")] = 2,
    pace: Annotated[float | None, Option("--pace", min=0.5, metavar="KM/H")] = None,
    with_: Annotated[list[str] | None, Option("--with", help="Whom.")] = None,
    between: Annotated[tuple[str, str] | None, Option(metavar="LOW HIGH")] = None,
    back: Annotated[bool, Option(help="And back.")] = True,
    quiet: Annotated[bool, Option("--quiet", "-q")] = False,
) -> None:
    """Go somewhere."""
    echo(f"{places} {way} {other} {days} {pace} {with_} {between} {back} {quiet}")


def run(*words: str) -> tuple[int, str]:
    done = CliRunner().invoke(command(travel), words)
    return done.exit_code, " ".join(done.output.split())


def test_what_is_not_said_is_the_default() -> None:
    assert run("a", "b") == (
        0,
        f"{[Path('a'), Path('b')]} Way.ON_FOOT None 2 None None None True False",
    )


def test_everything_that_is_said_arrives_in_its_type() -> None:
    said = "a --way by-sea --other on-foot --days 9 --pace 4.5 --with x --with y --no-back -q"
    assert run(*said.split(), "--between", "0 V", "9 V") == (
        0, f"{[Path('a')]} Way.BY_SEA Way.ON_FOOT 9 4.5 ['x', 'y'] ('0 V', '9 V') False True",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("said", "sentence"),
    [
        ("", "Missing argument 'PLACES...'"),
        ("a --days 0", "0 is not in the range 1<=x<=9"),
        ("a --days two", "'two' is not a valid whole number"),
        ("a --pace fast", "'fast' is not a valid number"),
        ("a --way flying", "'flying' is not one of 'on-foot', 'by-sea'"),
        ("a --between 1", "Option '--between' requires 2 arguments"),
        ("a --dayz 3", "No such option"),
    ],
)
def test_what_makes_no_sense_is_refused_by_name(said: str, sentence: str) -> None:
    code, told = run(*said.split())
    assert code == 2
    assert sentence in told


def test_the_help_explains_arguments_and_options() -> None:
    code, told = run("--help")
    assert code == 0
    for part in (
        "Usage: travel [OPTIONS] PLACES...", "Go somewhere.", "PLACES... Where to go. [required]",
        "--way [on-foot|by-sea] How. [default: on-foot]",
        "--days N How long. [default: 2; 1<=x<=9]",
        "--back / --no-back And back. [default: back]", "-q, --quiet", "--between LOW HIGH",
    ):  # fmt: skip
        assert part in told


def test_a_group_lists_its_commands_in_their_order_and_leaves_functions_as_they_are() -> None:
    group = Commands("front", "What there is.")
    assert group.command()(travel) is travel

    @group.command()
    def rest_a_while() -> None:
        """Stay."""

    told = CliRunner().invoke(group, ["--help"]).output
    assert told.index("travel ") < told.index("rest-a-while ")
    assert CliRunner().invoke(group, ["rest-a-while"]).exit_code == 0
