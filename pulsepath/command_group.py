"""The group of commands: common options, error handling and exit codes.

A command takes the options of its formats too, which load only when needed.
"""

import os
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from io import StringIO, TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NoReturn

import click

from pulsepath import progress
from pulsepath.process import intent
from pulsepath.process.ending import get_signal_code, raise_on_signal, set_exit_code
from pulsepath.process.error_record import error_json
from pulsepath.process.exits import BAD_INPUT, INTERRUPTED, JSON, TRACEBACK, describe_error
from pulsepath.progress import say

if TYPE_CHECKING:
    from pulsepath.format_options import Formats

OTHER_FORMAT = "pulsepath.other_format"


class Commands(click.Group):
    """Commands with -q and -v, whose errors become exit codes. Usage errors of click exit with 2.

    sections: the commands under each title of the list; commands that are added later come last
    """

    def __init__(
        self,
        *args: Any,
        sections: Mapping[str, Sequence[click.Command]] | None = None,
        **kwargs: Any,
    ) -> None:
        super().__init__(*args, **kwargs)
        self.params.extend(progress.options())
        self.sections = dict(sections or {})
        for commands in self.sections.values():
            for command in commands:
                self.add_command(command)

    def add_command(self, cmd: click.Command, name: str | None = None) -> None:
        if not isinstance(cmd, Commands):
            cmd.params.extend(progress.options())
        super().add_command(cmd, name)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        listed = [command for commands in self.sections.values() for command in commands]
        sorted_commands = [self.commands[name] for name in self.list_commands(ctx)]
        others = [command for command in sorted_commands if command not in listed]
        sections = {**self.sections, "Others" if listed else "Commands": others}
        width = max(map(len, self.commands), default=0)
        room = formatter.width - 6 - width
        for title, commands in sections.items():
            if commands:
                rows = [
                    (f"{command.name:<{width}}", command.get_short_help_str(room))
                    for command in commands
                ]
                with formatter.section(title):
                    formatter.write_dl(rows)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        ctx.meta[JSON] = ctx.meta.get(JSON, False) or "--json" in args
        try:
            return super().parse_args(ctx, args)
        except OSError as error:  # --version and --help are printed here
            try:
                _end_with_error(ctx, error)
            finally:
                _flush_streams()

    def invoke(self, ctx: click.Context) -> Any:
        if ctx.parent is not None:  # a group within the group
            return super().invoke(ctx)
        intent.writes()  # no file yet
        _replace_unprintable()
        try:
            with raise_on_signal():
                result = super().invoke(ctx)
                sys.stdout.flush()
                return result
        except click.exceptions.Exit:
            raise
        except click.ClickException as error:
            _end_if_interrupted(ctx)
            shown = StringIO()
            error.show(shown)
            _report(ctx, error, error.exit_code, shown.getvalue().rstrip("\n"))
        except KeyboardInterrupt:
            _end_interrupted(ctx, get_signal_code() or INTERRUPTED)
        except Exception as error:  # every kind of failure ends here
            _end_if_interrupted(ctx)
            _end_with_error(ctx, error)
        finally:
            _flush_streams()


def _end_if_interrupted(ctx: click.Context) -> None:
    """End a command in which a library made another error of a signal."""
    code = get_signal_code()
    if code is not None:
        _end_interrupted(ctx, code)


def _end_interrupted(ctx: click.Context, code: int) -> NoReturn:
    """End a command that a signal interrupted, with a message on the files that are written."""
    message = intent.describe_interruption()
    set_exit_code(code)
    _say_error(message)
    ctx.exit(code)


def _end_with_error(ctx: click.Context, error: Exception) -> NoReturn:
    """End a command that failed, with its message and exit code."""
    if isinstance(error, BrokenPipeError):  # the reader of a pipe wants no more
        ctx.exit(0)
    if os.environ.get(TRACEBACK) == "1":
        raise error
    if isinstance(error, OSError) and _is_of_output(error):
        _end_unwritten(ctx, error)
    _report(ctx, error, *describe_error(error))


def _report(ctx: click.Context, error: Exception, code: int, message: str) -> NoReturn:
    """Print an error on stderr, with --json on stdout too, and exit."""
    _say_error(message)
    if ctx.meta[JSON]:
        try:
            click.echo(error_json(error, code), nl=False)
        except BrokenPipeError:
            pass
        except OSError as failure:
            _end_unwritten(ctx, failure)
    ctx.exit(code)


def _end_unwritten(ctx: click.Context, error: OSError) -> NoReturn:
    """End a command whose output could not be written: its reader does not get the result."""
    _say_error(f"error: standard output: {error.strerror}")
    ctx.exit(BAD_INPUT)


def _say_error(message: str) -> None:
    """Print a message on stderr, if that can be written: the exit code says the same."""
    with suppress(OSError):
        say(message, err=True)


def _is_of_output(error: OSError) -> bool:
    """Return whether an error came from standard output: click's, rich's or the last flush."""
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    if trace is None:
        return False
    frame = trace.tb_frame
    if frame.f_globals.get("__name__") == "rich.console":
        return not frame.f_locals["self"].stderr
    return frame.f_code in (click.echo.__code__, Commands.invoke.__code__)


def _flush_streams() -> None:
    """Write buffered output, or drop it without a reader, so that the interpreter ends well."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _replace_unprintable() -> None:
    """Let ≤ and µ not end a command on a terminal without such letters."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")


# Options of import formats that have other names in commands that plan.
CLASHES = {"order": "import_order", "rule": "import_rule"}
# Options that such commands have themselves.
OWN = ("machine", "fit")


class ProgramCommand(click.Command):
    """A command whose program may be a file of another format.

    The keyword `given` has the options of that format.
    Only an argument with such a suffix loads them.
    """

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        words = [word for word in args if not word.startswith("-")]
        ctx.meta[OTHER_FORMAT] = any(Path(word).suffix not in ("", ".toml") for word in words)
        return super().parse_args(ctx, args)

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        params = super().get_params(ctx)
        if ctx.resilient_parsing or not ctx.meta.get(OTHER_FORMAT):
            return params
        from pulsepath.format_options import IMPORTS

        options = [option for option in IMPORTS.options() if option.name not in OWN]
        for option in options:
            if option.name in CLASHES:
                option.name = CLASHES[option.name]
                option.opts = ["--" + option.name.replace("_", "-")]
        return _insert_options(params, options)

    def invoke(self, ctx: click.Context) -> Any:
        stated = {parameter.name for parameter in self.params}
        names = {new: old for old, new in CLASHES.items()}
        options = {name: ctx.params.pop(name) for name in [*ctx.params] if name not in stated}
        ctx.params["given"] = {names.get(name, name): value for name, value in options.items()}
        return super().invoke(ctx)

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        formatter.write_paragraph()
        formatter.write_text(
            "PROGRAM may be any file that `pulsepath import` reads, with the options of import "
            "(its --order and --rule are called --import-order and --import-rule here)."
        )


class FormatCommand(click.Command):
    """A command with the options of all its formats: `pulsepath.format_options` has them."""

    formats: ClassVar[Literal["EXPORTS", "IMPORTS", "STOPS"]]

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        params = super().get_params(ctx)
        if ctx.resilient_parsing:  # a shell completes, and must not wait for all formats to load
            return params
        return _insert_options(params, self._load_formats().options())

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        formatter.write_paragraph()
        formatter.write(f"Formats:\n{self._load_formats().help_text()}\n")

    def _load_formats(self) -> "Formats":
        from pulsepath import format_options

        formats: Formats = getattr(format_options, self.formats)
        return formats


def _insert_options(
    params: list[click.Parameter],
    more: Sequence[click.Parameter],
) -> list[click.Parameter]:
    """Return the options of a command with more of them. --help stays last."""
    return [*params[:-1], *more, params[-1]]
