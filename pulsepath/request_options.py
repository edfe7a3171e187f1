"""Options of the command line, made from the fields of requests, and requests made from options."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, Field, fields
from functools import wraps
from math import isfinite
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin

import click

from planner.request import Option, find_options
from pulsepath import known_names
from pulsepath.options import Frequency, read_percent, read_quantity

Request = TypeVar("Request")
Command = Callable[..., Any]


def with_request(kind: type[Any]) -> Callable[[Command], Command]:
    """Return a decorator that gives a command the options of a request.

    The command is called with the request. Options and arguments that are no fields of the request
    follow by name.
    """
    names = {each.name for each in fields(kind)}

    def decorate(function: Command) -> Command:
        @wraps(function)
        def command(**options: Any) -> Any:
            others = {name: value for name, value in options.items() if name not in names}
            return function(read_request(kind, options), **others)

        return request_options(kind)(command)

    return decorate


def request_options(*kinds: type[Any]) -> Callable[[Command], Command]:
    """Return a decorator that gives a command the options of several requests, as text.

    Every option defaults to None, because the request states the default.
    """

    def decorate(command: Command) -> Command:
        each_field = [each for kind in kinds for each in fields(kind) if each.metadata]
        for each in reversed(each_field):  # click lists the last decorator first
            facts: Option = each.metadata["option"]
            words, settings = describe_option(each.name, each.type, facts)
            if each.default is MISSING:
                settings["required"] = True
                del settings["default"]  # even None would be a default
            settings["help"] += _describe_default(each)
            command = click.option(*words, **settings)(command)
        return command

    return decorate


def describe_option(name: str, kind: Any, facts: Option) -> tuple[Sequence[str], dict[str, Any]]:
    """Return the names of an option, and its settings, as `click.Option` takes them.

    kind: annotation of the field
    """
    flag = find_flag(name, facts)
    settings: dict[str, Any] = {"default": None, "help": facts.help}
    if _takes(kind, bool):
        flag = f"{flag}/--{facts.opposite}" if facts.opposite else flag
        settings["is_flag"] = True
    else:
        settings |= {
            "type": _find_type(kind, facts),
            "metavar": facts.metavar,
            "multiple": get_origin(kind) is tuple,
        }
    if facts.names:
        list_names = getattr(known_names, facts.names)
        settings["shell_complete"] = known_names.make_completer(list_names, files=facts.files)
    return (flag, name), settings


def _describe_default(each: Field[Any]) -> str:
    """Return the sentence about a default that the help of a field lacks."""
    default: Any = each.default
    if default is MISSING or default in (None, False, ()):
        return ""
    if default is True:
        default = find_flag(each.name)
    if isinstance(default, tuple):
        default = ", ".join(default)
    return f" Default: {default}."


def _find_type(kind: Any, facts: Option) -> click.ParamType[Any]:
    """Return the type of the text of an option. Quantities and shares are read later."""
    if facts.choices:
        return click.Choice([str(choice) for choice in facts.choices])
    if facts.unit == "Hz":
        return Frequency()
    if _takes(kind, Path):
        return click.Path(path_type=Path)
    if facts.unit:
        return click.STRING
    bounds = facts.least, facts.most
    if _takes(kind, int):
        least, most = (int(bound) if isfinite(bound) else None for bound in bounds)
        return click.INT if least is most is None else click.IntRange(least, most)
    if _takes(kind, float):
        if isfinite(facts.above):
            return click.FloatRange(facts.above, min_open=True)
        return click.FLOAT
    return click.STRING


def _takes(annotation: Any, kind: type) -> bool:
    """Return whether a field takes values of a kind, or several of them."""
    return annotation is kind or kind in get_args(annotation)


def find_flag(name: str, facts: Option | None = None) -> str:
    """Return the option of a field, as --clock-hz."""
    if facts is not None and facts.flag:
        return facts.flag
    return "--" + name.replace("_", "-")


def read_request(kind: type[Request], options: Mapping[str, Any]) -> Request:
    """Make a request of the options that were given; others belong to other requests.

    Raises BadValue for a quantity that cannot be read, and click's UsageError for an option whose
    other option is missing.
    """
    names = [each.name for each in fields(kind)]  # type: ignore[arg-type]  # a dataclass
    # Of an option that may be repeated, click gives an empty tuple if it was not given.
    values = {name: options[name] for name in names if options.get(name) not in (None, ())}
    for name, facts in find_options(kind).items():
        if name not in values:
            continue
        if facts.needs and facts.needs not in values:
            message = f"{find_flag(name, facts)} needs {find_flag(facts.needs)}."
            raise click.UsageError(message, click.get_current_context())
        values[name] = _read(name, values[name], facts)
    return kind(**values)


def _read(name: str, value: Any, facts: Option) -> Any:
    """Return the value of a field in SI units."""
    flag = find_flag(name, facts)
    if facts.choices:
        return type(facts.choices[0])(value)
    if facts.unit == "%":
        return read_percent(flag, value)
    if facts.unit and isinstance(value, str):
        return read_quantity(
            flag,
            value,
            facts.unit,
            facts.like,
            above=facts.above,
            least=facts.least,
        )
    return value


def list_options(options: Mapping[str, Any], *kinds: type[Any]) -> dict[str, int | str]:
    """Return the options of requests as they are written, without dashes, with their defaults.

    True: an option without a value. Those are left out unless they were given.
    """
    written: dict[str, int | str] = {}
    for each in (each for kind in kinds for each in fields(kind) if each.metadata):
        facts: Option = each.metadata["option"]
        value: Any = options.get(each.name)
        name = find_flag(each.name, facts)[2:]
        default: Any = each.default
        if _takes(each.type, bool):
            word = name if value else facts.opposite
            if value is not None and word:
                written[word] = True
        elif value is not None:
            written[name] = value
        elif default is not None and not facts.needs:
            written[name] = default
    return written
