"""Messages of a command besides its result: progress on stderr, as -q and -v request.

On a terminal there is a bar, elsewhere a line per step, with its progress after two, six, fourteen
seconds and then every ten. The output is plain with NO_COLOR or on a dumb terminal.
"""

import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from time import perf_counter
from typing import IO, TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from kinematics import Machine

# s between two lines of a long step: at first, and at most.
FIRST_PERIOD, REPORT_PERIOD = 2.0, 10.0
# s between two states of a bar.
REDRAW_PERIOD = 0.1
# Columns of a bar.
BAR_WIDTH = 20
# Number up to which progress shows counts. Of more, such as ticks or bytes, it shows the share.
MAX_COUNTED = 1000

QUIET, USUAL, VERBOSE = -1, 0, 1
_LEVEL = "pulsepath.progress"

# Functions of progress (done, total): one reports it, one describes it.
Report = Callable[[int, int], None]
Describe = Callable[[int, int], str]


@contextmanager
def step(title: str, describe: Describe | None = None) -> Iterator[Report]:
    """Announce a step, and yield the function that reports its progress.

    On a terminal or with -v the duration is shown at the end.

    describe: text for a state of progress; None: its share, or the counts if they are small
    """
    if level() == QUIET:
        yield _report_nothing
        return

    title = escape_text(title)
    styled = is_styled(sys.stderr)
    show = _draw_bar if styled else _print_lines
    begin = perf_counter()
    with show(title, describe or _format_progress) as report:
        yield report
    if styled or level() == VERBOSE:
        _print_line(f"{title}: {perf_counter() - begin:.1f} s")


@contextmanager
def _print_lines(title: str, describe: Describe) -> Iterator[Report]:
    """Print progress in lines, soon at first and then more rarely."""
    _print_line(f"{title} …")
    printed = perf_counter()
    period = FIRST_PERIOD

    def report(done: int, total: int) -> None:
        nonlocal printed, period
        now = perf_counter()
        if now - printed > min(period, REPORT_PERIOD):
            printed = now
            period *= 2
            _print_line(f"{title}: {describe(done, total)}")

    yield report


def _print_line(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


@contextmanager
def _draw_bar(title: str, describe: Describe) -> Iterator[Report]:
    """Draw a bar with a text. The bar moves to and fro until there is a report."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn
    from rich.table import Column

    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=BAR_WIDTH),
        TextColumn("{task.fields[state]}", markup=False, table_column=Column(overflow="fold")),
    )
    with Progress(*columns, console=Console(stderr=True, markup=False), transient=True) as progress:
        task = progress.add_task(title, total=None, state="")
        drawn = 0.0

        def report(done: int, total: int) -> None:
            nonlocal drawn
            now = perf_counter()
            if now - drawn > REDRAW_PERIOD or done == total:
                drawn = now
                progress.update(task, completed=done, total=total, state=describe(done, total))

        yield report


def _report_nothing(done: int, total: int) -> None:
    """Ignore progress, in quiet mode."""


def _format_progress(done: int, total: int) -> str:
    return f"{done} of {total}" if total <= MAX_COUNTED else f"{100 * done // total} %"


def options() -> list[click.Option]:
    """Return -q and -v, which every command takes, and the group of all before it."""
    return [
        _make_flag(QUIET, "-q", "--quiet", help="Print results and errors only."),
        _make_flag(
            VERBOSE,
            "-v",
            "--verbose",
            help="Also print details: all tables, solve rounds, methods, times.",
        ),
    ]


def _make_flag(level: int, *names: str, help: str) -> click.Option:
    def choose(context: click.Context, _: click.Parameter, given: bool) -> None:
        if not given:
            return
        if context.meta.setdefault(_LEVEL, level) != level:
            raise click.UsageError("--quiet and --verbose exclude each other: give one.", context)
        if level == QUIET:
            import logging

            logging.getLogger("pulsepath").setLevel(logging.ERROR)

    return click.Option(names, is_flag=True, expose_value=False, callback=choose, help=help)


def level() -> int:
    """Return QUIET, USUAL or VERBOSE, as the running command line states; USUAL without one."""
    context = click.get_current_context(silent=True)
    chosen: int = USUAL if context is None else context.meta.get(_LEVEL, USUAL)
    return chosen


def say(text: object, *, err: bool = False) -> None:
    """Print a text, whose names may come from files, with control characters escaped."""
    click.echo(escape_text(str(text)), err=err)


def note(text: str) -> None:
    """Print a line on stderr, except in quiet mode."""
    if level() > QUIET:
        say(text, err=True)


def note_doubts(machine: "Machine", name: str) -> None:
    """Show what in a machine's file is possible, but more likely a mistake."""
    from kinematics.analysis.doubts import find_doubts

    for doubt in find_doubts(machine):
        note(f"warning: {name}: {doubt}")


def detail(text: str) -> None:
    """Print a line on stderr in verbose mode."""
    if level() == VERBOSE:
        say(text, err=True)


def escape_text(text: str) -> str:
    """Return a text with all characters escaped that a terminal would obey."""
    from kinematics.files.plain_text import plain

    return plain(text)


def as_json(record: object) -> str:
    """Return indented JSON text with control characters escaped; ValueError: infinity or NaN."""
    import json

    from kinematics.files.plain_text import plain_json

    return plain_json(json.dumps(record, indent=2, ensure_ascii=False, allow_nan=False)) + "\n"


def is_styled(stream: IO[str]) -> bool:
    """Return whether a stream shows colours and lines that are drawn again [no-color.org]."""
    plain = os.environ.get("NO_COLOR") or os.environ.get("TERM") in ("dumb", "unknown")
    return stream.isatty() and not plain


# A table as text: title, columns (title, numeric, whole: never broken), rows of cells, notes.
Layout = dict[str, Any]
# Characters of a line if the output is no terminal and COLUMNS is not set.
WIDTH = 112
# Characters: of words that are never broken, between two columns, of both edges of a table.
LONG_WORD, COLUMN_GAP, EDGES = 14, 3, 2


def draw(layouts: Iterable[Layout]) -> None:
    """Print tables. Names in them come from files, so they are printed without markup.

    A table that is wider than the line continues below, with its first column repeated.
    """
    from rich.console import Console

    console = Console(
        width=_find_width(),
        markup=False,
        emoji=False,
        highlight=False,
        force_terminal=is_styled(sys.stdout),
    )
    with console.capture() as printed:
        for layout in layouts:
            # A title inside the table would be as narrow as the table.
            console.print(layout["title"], style="table.title")
            for table in _make_tables(layout, console.width):
                console.print(table)
            if layout["notes"]:
                # A path that is longer than the line stays whole, so that it can be copied.
                notes = "\n".join(layout["notes"])
                console.print(notes, style="table.caption", overflow="ignore", crop=False)
    click.echo("\n".join(line.rstrip() for line in printed.get().splitlines()))


def _make_tables(layout: Layout, room: int) -> Iterator[Any]:
    """Yield rich's tables for a layout: one, or several side by side if one would not fit."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    least, full = _find_widths(layout)
    for part in _split_columns(least, room):
        table = Table(box=SIMPLE_HEAD, pad_edge=False)
        widths = _share_room([least[k] for k in part], [full[k] for k in part], room)
        for k, width in zip(part, widths, strict=True):
            title, numeric, whole = layout["columns"][k]
            table.add_column(
                title,
                justify="right" if numeric else "left",
                no_wrap=whole,
                overflow="fold",
                width=width,
            )
        for row in layout["rows"]:
            table.add_row(*(row[k] for k in part))
        yield table


def _find_width() -> int | None:
    """Return the characters of a line: COLUMNS, if set; None: those of the terminal."""
    stated = os.environ.get("COLUMNS", "")
    if stated.isascii() and stated.isdigit() and int(stated) > 0:
        return int(stated)
    return None if sys.stdout.isatty() else WIDTH


def _find_widths(layout: Layout) -> tuple[list[int], list[int]]:
    """Return two widths of each column: the least, which breaks only long words, and the full."""
    least = []
    full = []
    for k, (title, numeric, whole) in enumerate(layout["columns"]):
        cells = [title, *(row[k] for row in layout["rows"])]
        words = cells if whole else [word for cell in cells for word in cell.split()]
        longest = max(map(len, words), default=0)
        least.append(longest if whole or numeric else min(longest, LONG_WORD))
        full.append(max(map(len, cells)))
    return least, full


def _share_room(least: Sequence[int], full: Sequence[int], room: int) -> list[int | None]:
    """Return widths between the least and the full ones; None if the least ones do not fit.

    The columns share the remaining room evenly, narrow ones first. rich alone would shrink all
    columns alike, and drop the last one if they still do not fit.
    """
    spare = room - _join_widths(least)
    if spare < 0:
        return [None] * len(least)
    widths: list[int | None] = [*least]
    needs = sorted((full[k] - least[k], k) for k in range(len(least)))
    for n, (need, k) in enumerate(needs):
        added = min(need, spare // (len(needs) - n))
        widths[k] = least[k] + added
        spare -= added
    return widths


def _join_widths(widths: Sequence[int]) -> int:
    return sum(widths) + COLUMN_GAP * (len(widths) - 1) + EDGES


def _split_columns(widths: Sequence[int], room: int) -> list[list[int]]:
    """Return the columns of each part of a table that fits the room; each has the first column."""
    if _join_widths(widths) <= room:
        return [list(range(len(widths)))]
    parts = [[0]]
    for k in range(1, len(widths)):
        longer = [*parts[-1], k]
        if len(longer) > 2 and _join_widths([widths[n] for n in longer]) > room:
            parts.append([0, k])
        else:
            parts[-1] = longer
    return parts
