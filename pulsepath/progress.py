"""Messages of a command besides its result: progress on stderr, as -q and -v request.

On a terminal there is a bar, elsewhere a line per step, with its progress after two, six, fourteen
seconds and then every ten. The output is plain with NO_COLOR or on a dumb terminal.
"""

import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from time import perf_counter
from typing import IO, Any

import click

FIRST_PERIOD, REPORT_PERIOD = 2.0, 10.0
"""s between two lines of a long step, where they are not drawn over each other: at first, and at most."""
REDRAW_PERIOD, BAR_WIDTH = 0.1, 20
"""s between two that are; and columns of the bar before them."""
MAX_COUNTED = 1000
"""Number of things up to which progress shows counts; of more, as ticks or bytes, it shows the share."""


@contextmanager
def step(what: str, describe: Callable[[int, int], str] | None = None) -> Iterator[Callable[[int, int], None]]:
    """Announce a step. Yields a function that reports progress (done, total).

    On a terminal or with -v the duration is shown at the end.

    describe: text for a state of progress; None: its share, or the counts if they are small
    """
    begin, what, describe = perf_counter(), escape_text(what), describe or _format_progress
    if level() == QUIET:
        yield _report_nothing
        return
    if is_styled(sys.stderr):
        with _draw_bar(what, describe) as draw_progress:
            yield draw_progress
    else:
        print(f"{what} …", file=sys.stderr, flush=True)
        told, period = begin, FIRST_PERIOD

        def tell(done: int, of: int) -> None:
            nonlocal told, period
            if perf_counter() - told > min(period, REPORT_PERIOD):
                told, period = perf_counter(), 2 * period
                print(f"{what}: {describe(done, of)}", file=sys.stderr, flush=True)

        yield tell
        if level() < VERBOSE:
            return
    print(f"{what}: {perf_counter() - begin:.1f} s", file=sys.stderr, flush=True)


@contextmanager
def _draw_bar(what: str, describe: Callable[[int, int], str]) -> Iterator[Callable[[int, int], None]]:
    """A bar on a terminal, which moves to and fro until there is a report; the report follows the bar."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn
    from rich.table import Column

    folded = Column(overflow="fold")
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=BAR_WIDTH),
        TextColumn("{task.fields[told]}", markup=False, table_column=folded),
    )
    with Progress(*columns, console=Console(stderr=True, markup=False), transient=True) as progress:
        task, told = progress.add_task(what, total=None, told=""), 0.0

        def tell(done: int, of: int) -> None:
            nonlocal told
            if perf_counter() - told > REDRAW_PERIOD or done == of:
                told = perf_counter()
                progress.update(task, completed=done, total=of, told=describe(done, of))

        yield tell


def _report_nothing(done: int, of: int) -> None:
    """Ignore progress, in quiet mode."""


def _format_progress(done: int, of: int) -> str:
    return f"{done} of {of}" if of <= MAX_COUNTED else f"{100 * done // of} %"


QUIET, USUAL, VERBOSE = -1, 0, 1
_LEVEL = "pulsepath.progress"


def options() -> list[click.Option]:
    """-q and -v, which every command takes, and the group of all before it."""

    def flag(level: int, *names: str, told: str) -> click.Option:
        def choose(context: click.Context, _: click.Parameter, given: bool) -> None:
            if given and context.meta.setdefault(_LEVEL, level) != level:
                raise click.UsageError("--quiet and --verbose exclude each other: give one.", context)
            if given and level == QUIET:
                import logging

                logging.getLogger("pulsepath").setLevel(logging.ERROR)

        return click.Option(names, is_flag=True, expose_value=False, callback=choose, help=told)

    return [
        flag(QUIET, "-q", "--quiet", told="Print results and errors only."),
        flag(VERBOSE, "-v", "--verbose", told="Also print details: all tables, solve rounds, methods, times."),
    ]


def level() -> int:
    """QUIET, USUAL or VERBOSE, as the command line that runs has it; USUAL where none does."""
    context = click.get_current_context(silent=True)
    chosen: int = USUAL if context is None else context.meta.get(_LEVEL, USUAL)
    return chosen


def say(text: object, *, err: bool = False) -> None:
    """Escape control characters of a text, whose names come from files."""
    click.echo(escape_text(str(text)), err=err)


def escape_text(text: str) -> str:
    """Return a text with all escaped that a terminal would obey."""
    from kinematics.files.plain_text import plain

    return plain(text)


def as_json(record: object) -> str:
    """JSON text, indented, with all escaped that a terminal would obey; refuses numbers that JSON does not have."""
    import json

    from kinematics.files.plain_text import plain_json

    return plain_json(json.dumps(record, indent=2, ensure_ascii=False, allow_nan=False)) + "\n"


def note(text: str) -> None:
    """A line on stderr, unless all is to be quiet."""
    if level() > QUIET:
        say(text, err=True)


def detail(text: str) -> None:
    """A line on stderr where more is asked for."""
    if level() >= VERBOSE:
        say(text, err=True)


Layout = dict[str, Any]
"""A table as text: its title, columns (title, numeric, whole: never broken over lines), rows of cells, and notes."""
WIDTH = 112
"""Characters of a line where the output is no terminal and COLUMNS is not set."""
LONG_WORD, COLUMN_GAP, EDGES = 14, 3, 2
"""Characters up to which a word is not broken; those between two columns; those of both edges of a table."""


def draw(layouts: Iterable[Layout]) -> None:
    """Print tables. Names in them come from files, so nothing is taken for markup.

    A table that is wider than the line continues below, with its first column repeated, so that no number is broken.
    """
    from rich.box import SIMPLE_HEAD
    from rich.console import Console, JustifyMethod
    from rich.table import Table

    console = Console(
        width=_find_width(),
        markup=False,
        emoji=False,
        highlight=False,
        force_terminal=is_styled(sys.stdout),
    )
    with console.capture() as printed:
        for layout in layouts:
            widths, full = _find_widths(layout)
            console.print(layout["title"], style="table.title")  # rich's own title would be as narrow as the table
            for part in _split_columns(widths, console.width):
                drawn = Table(box=SIMPLE_HEAD, pad_edge=False)
                shares = _share_room([widths[k] for k in part], [full[k] for k in part], console.width)
                for k, width in zip(part, shares, strict=True):
                    title, numeric, whole = layout["columns"][k]
                    justify: JustifyMethod = "right" if numeric else "left"
                    drawn.add_column(title, justify=justify, no_wrap=whole, overflow="fold", width=width)
                for row in layout["rows"]:
                    drawn.add_row(*(row[k] for k in part))
                console.print(drawn)
            if layout["notes"]:
                # a path that is longer than the line stays whole, so that it can be copied
                console.print(
                    "\n".join(layout["notes"]),
                    style="table.caption",
                    overflow="ignore",
                    crop=False,
                )
    click.echo("\n".join(line.rstrip() for line in printed.get().splitlines()))


def _find_width() -> int | None:
    """Return the characters of a line: COLUMNS if it is set, as other programs take it; None: as the terminal has."""
    stated = os.environ.get("COLUMNS", "")
    if stated.isascii() and stated.isdigit() and int(stated) > 0:
        return int(stated)
    return None if sys.stdout.isatty() else WIDTH


def _find_widths(layout: Layout) -> tuple[list[int], list[int]]:
    """Return two widths of each column: one that breaks no number and no word but long ones of texts, and the full."""
    rows = [[title for title, _, _ in layout["columns"]], *layout["rows"]]
    least, full = [], []
    for k, (_, numeric, whole) in enumerate(layout["columns"]):
        cells = [row[k] for row in rows]
        words = cells if whole else [word for cell in cells for word in cell.split()]
        longest = max(map(len, words), default=0)
        least.append(longest if whole or numeric else min(longest, LONG_WORD))
        full.append(max(map(len, cells), default=0))
    return least, full


def _share_room(least: Sequence[int], full: Sequence[int], room: int) -> list[int | None]:
    """Return the width of each column, between its least and its full one; None if the least ones do not fit.

    The rest of the room is shared evenly, by the columns that need little first. (rich alone would take from all
    columns alike, and drop the last one where their least widths then do not fit.)
    """
    spare = room - _join_widths(least)
    if spare < 0:
        return [None] * len(least)
    widths = [*least]
    needs = sorted(range(len(least)), key=lambda k: full[k] - least[k])
    for done, k in enumerate(needs):
        given = min(full[k] - least[k], spare // (len(needs) - done))
        widths[k] += given
        spare -= given
    return [*widths]


def _join_widths(widths: Sequence[int]) -> int:
    return sum(widths) + COLUMN_GAP * (len(widths) - 1) + EDGES


def _split_columns(widths: Sequence[int], room: int) -> list[list[int]]:
    """Return the columns of each part of a table that fits into the room; every part begins with the first column."""
    if _join_widths(widths) <= room:
        return [list(range(len(widths)))]
    parts = [[0]]
    for k in range(1, len(widths)):
        part = parts[-1]
        if len(part) > 1 and _join_widths([widths[n] for n in [*part, k]]) > room:
            part = [0]
            parts.append(part)
        part.append(k)
    return parts


def is_styled(stream: IO[str]) -> bool:
    """Return whether a stream shows colours and lines that are drawn again [no-color.org]."""
    return stream.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") not in ("dumb", "unknown")
