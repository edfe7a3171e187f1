"""The group of commands: common options, error handling and exit codes.

A command whose formats have options of their own takes these too; the formats load only when needed.
"""

import os
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from io import StringIO
from pathlib import Path
from typing import Any, ClassVar, Literal, NoReturn

import click

from pulsepath import progress
from pulsepath.process import intent
from pulsepath.process.ending import EndSignal, raise_on_signal, set_exit_code
from pulsepath.process.exits import BAD_INPUT, INTERRUPTED, JSON, TRACEBACK, describe_error, error_json
from pulsepath.progress import say

OTHERS_TITLE, OTHER_FORMAT = "Others", "pulsepath.other_format"


class Commands(click.Group):
    """Commands with -q and -v, whose errors become exit codes. Usage errors of click exit with 2.

    sections  titles in the list of commands, and the names under each; other commands come last
    """

    def __init__(self, *args: Any, sections: Mapping[str, Sequence[str]] | None = None, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.sections = dict(sections or {})
        self.params.extend(progress.options())

    def add_command(self, cmd: click.Command, name: str | None = None) -> None:
        if not isinstance(cmd, Commands):
            cmd.params.extend(progress.options())
        super().add_command(cmd, name)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        listed = {name for names in self.sections.values() for name in names}
        others = [name for name in self.list_commands(ctx) if name not in listed]
        sections = {**self.sections, OTHERS_TITLE if self.sections else "Commands": others}
        width = max(map(len, self.commands), default=0)
        for title, names in sections.items():
            known = {name: self.commands[name] for name in names if name in self.commands}
            if known:
                with formatter.section(title):
                    short = formatter.width - 6 - width
                    formatter.write_dl([(f"{n:<{width}}", cmd.get_short_help_str(short)) for n, cmd in known.items()])

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        ctx.meta[JSON] = ctx.meta.get(JSON, False) or "--json" in args
        try:
            return super().parse_args(ctx, args)
        except OSError as error:  # of --version and --help, which are printed here
            try:
                _end_with_error(ctx, error)
            finally:
                _drop_unwritable()

    def invoke(self, ctx: click.Context) -> Any:
        if ctx.parent is not None:  # of a group within the group
            return super().invoke(ctx)
        intent.writes()  # nothing yet
        _replace_unprintable()
        try:
            with raise_on_signal():
                result = super().invoke(ctx)
                sys.stdout.flush()
                return result
        except click.exceptions.Exit:
            raise
        except click.ClickException as error:
            shown = StringIO()
            error.show(shown)
            _report(ctx, error, error.exit_code, shown.getvalue().rstrip("\n"))
        except KeyboardInterrupt as end:
            code = end.code if isinstance(end, EndSignal) else INTERRUPTED
            message = intent.describe_interruption()
            set_exit_code(code)
            _say_error(message)
            ctx.exit(code)
        except Exception as error:  # every kind of failure ends here
            _end_with_error(ctx, error)
        finally:
            _drop_unwritable()


def _end_with_error(ctx: click.Context, error: Exception) -> NoReturn:
    """End a command that failed, with its message and exit code."""
    if isinstance(error, BrokenPipeError):  # the reader has seen enough
        ctx.exit(0)
    if os.environ.get(TRACEBACK) == "1":
        raise error
    if isinstance(error, OSError) and _is_of_output(error):
        _end_unwritten(ctx, error)
    _report(ctx, error, *describe_error(error))


def _report(ctx: click.Context, error: Exception, code: int, message: str) -> NoReturn:
    """Print an error on stderr, where JSON is asked for on stdout too, and exit."""
    unwritten = None
    if ctx.meta[JSON]:
        try:
            click.echo(error_json(error, code), nl=False)
        except BrokenPipeError:
            pass
        except OSError as failure:
            unwritten = failure
    _say_error(message)
    if unwritten is not None:
        _end_unwritten(ctx, unwritten)
    ctx.exit(code)


def _end_unwritten(ctx: click.Context, error: OSError) -> NoReturn:
    """End a command whose output could not be written: whatever it has done, who reads that does not get it."""
    _say_error(f"error: standard output: {error.strerror}")
    ctx.exit(BAD_INPUT)


def _say_error(message: str) -> None:
    """Print a message on stderr, if that takes it: the exit code says the same."""
    with suppress(OSError):
        say(message, err=True)


def _is_of_output(error: OSError) -> bool:
    """Return whether an error came from writing to standard output, by click, by rich or when flushing at the end."""
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    if trace is None:
        return False
    frame = trace.tb_frame
    if frame.f_globals.get("__name__") == "rich.console":
        return not frame.f_locals["self"].stderr
    return frame.f_code in (click.echo.__code__, Commands.invoke.__code__)


def _drop_unwritable() -> None:
    """Discard buffered output for a reader that has gone, so that the interpreter can end without an error."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _replace_unprintable() -> None:
    """≤ and µ must not end a command on a terminal that has no such letters."""
    for stream in (sys.stdout, sys.stderr):
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is not None:
            reconfigure(errors="replace")


CLASHES = {"order": "import_order", "rule": "import_rule"}
"""Options of formats that programs come in, which commands that plan have others of: there they are called so."""
OWN = ("machine", "fit")
"""Options that such commands have themselves."""


class ProgramCommand(click.Command):
    """A command whose program may be a file of another format: then it takes that format's options too.

    They stand in the keyword `given`. Only an argument with such a suffix loads them.
    """

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        ctx.meta[OTHER_FORMAT] = any(Path(word).suffix not in ("", ".toml") for word in args if word[:1] != "-")
        return super().parse_args(ctx, args)

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        own = super().get_params(ctx)
        if ctx.resilient_parsing or not ctx.meta.get(OTHER_FORMAT):
            return own
        from pulsepath.format_options import IMPORTS

        more = [option for option in IMPORTS.options() if option.name not in OWN]
        for option in more:
            if option.name in CLASHES:
                option.name = CLASHES[option.name]
                option.opts = ["--" + option.name.replace("_", "-")]
        return [*own[:-1], *more, *own[-1:]]

    def invoke(self, ctx: click.Context) -> Any:
        names = {parameter.name for parameter in self.params}
        other = {name: ctx.params.pop(name) for name in [*ctx.params] if name not in names}
        back = {new: old for old, new in CLASHES.items()}
        ctx.params["given"] = {back.get(name, name): value for name, value in other.items()}
        return super().invoke(ctx)

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        formatter.write_paragraph()
        formatter.write_text(
            "PROGRAM may be any file that `pulsepath import` reads, with the options of import (its --order and --rule "
            "are called --import-order and --import-rule here)."
        )


class FormatCommand(click.Command):
    """Such a command. `formats` names them in pulsepath.format_options."""

    formats: ClassVar[Literal["EXPORTS", "IMPORTS", "STOPS"]]

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        if ctx.resilient_parsing:  # while a shell completes, which must not wait for all formats to load
            return super().get_params(ctx)
        from pulsepath import format_options

        own = getattr(format_options, self.formats).options()
        return [*super().get_params(ctx)[:-1], *own, *super().get_params(ctx)[-1:]]  # --help stays last

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        from pulsepath import format_options

        formatter.write_paragraph()
        formatter.write("Formats:\n" + getattr(format_options, self.formats).help_text() + "\n")
