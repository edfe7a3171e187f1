"""How much a command says beside its result, and in what dress: --quiet, --verbose, NO_COLOR, a dumb terminal."""

import os
from typing import IO

import click

from pulsepath.alone import load_alone

QUIET, USUAL, VERBOSE = -1, 0, 1
_LEVEL = "pulsepath.talk"


def options() -> list[click.Option]:
    """-q and -v, which every command takes, and the group of all before it."""

    def flag(level: int, *names: str, told: str) -> click.Option:
        def choose(context: click.Context, _: click.Parameter, given: bool) -> None:
            if given and context.meta.setdefault(_LEVEL, level) != level:
                raise click.UsageError("--quiet and --verbose exclude each other: give one.", context)

        return click.Option(names, is_flag=True, expose_value=False, callback=choose, help=told)

    return [
        flag(QUIET, "-q", "--quiet", told="No progress and no notes: results and errors alone."),
        flag(VERBOSE, "-v", "--verbose", told="Also how it was found: rounds, methods, times."),
    ]


def level() -> int:
    """QUIET, USUAL or VERBOSE, as the command line that runs has it; USUAL where none does."""
    context = click.get_current_context(silent=True)
    chosen: int = USUAL if context is None else context.meta.get(_LEVEL, USUAL)
    return chosen


def say(text: object, *, err: bool = False) -> None:
    """A line, or more of them, with all escaped that a terminal would obey: names in it come from files."""
    click.echo(plain(str(text)), err=err)


def plain(text: str) -> str:
    """As kinematics.plain_text has it, which would load all of kinematics here."""
    escaped: str = load_alone("plain_text").plain(text)
    return escaped


def note(text: str) -> None:
    """A line on stderr, unless all is to be quiet."""
    if level() > QUIET:
        say(text, err=True)


def detail(text: str) -> None:
    """A line on stderr where more is asked for."""
    if level() >= VERBOSE:
        say(text, err=True)


def dressed(stream: IO[str]) -> bool:
    """Whether a stream shows colours, and lines drawn over each other [no-color.org]."""
    return stream.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") not in ("dumb", "unknown")
