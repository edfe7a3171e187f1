"""Options of the command line, made from the fields of requests, and requests made from options."""

from collections.abc import Callable, Mapping
from dataclasses import Field, fields
from math import isfinite
from typing import Any, TypeVar, get_args

import click

from planner.request import Option, find_options
from pulsepath import known_names
from pulsepath.options import Frequency, read_percent, read_quantity

Request = TypeVar("Request")
Command = Callable[..., Any]


def request_options(*kinds: type[Any]) -> Callable[[Command], Command]:
    """Return a decorator that gives a command the options of requests.

    Every option defaults to None, because the request states the default.
    """

    def decorate(command: Command) -> Command:
        each_field = [each for kind in kinds for each in fields(kind) if each.metadata]
        for each in reversed(each_field):  # click lists the last decorator first
            command = _make_option(each)(command)
        return command

    return decorate


def _make_option(each: Field[Any]) -> Callable[[Command], Command]:
    """Return the decorator of a field's option."""
    facts: Option = each.metadata["option"]
    flag = find_flag(each.name)
    names = flag
    settings: dict[str, Any] = {"default": None, "help": _describe(each, facts)}
    if _takes(each, bool):
        names = f"{flag}/--{facts.opposite}" if facts.opposite else flag
        settings["is_flag"] = True
    else:
        settings |= {"type": _find_type(each, facts), "metavar": facts.metavar}
    if facts.names:
        list_names = getattr(known_names, facts.names)
        settings["shell_complete"] = known_names.make_completer(list_names, files=facts.files)
    return click.option(names, each.name, **settings)


def _describe(each: Field[Any], facts: Option) -> str:
    """Return the help of an option with its default."""
    if each.default is None or each.default is False:
        return facts.help
    default = find_flag(each.name) if each.default is True else each.default
    return f"{facts.help} Default: {default}."


def _find_type(each: Field[Any], facts: Option) -> click.ParamType[Any]:
    """Return the type of the text of an option. Quantities and shares are read later."""
    if facts.choices:
        return click.Choice([str(choice) for choice in facts.choices])
    if facts.unit == "Hz":
        return Frequency()
    if _takes(each, int):
        bounds = facts.least, facts.most
        least, most = (int(bound) if isfinite(bound) else None for bound in bounds)
        return click.IntRange(least, most)
    return click.STRING


def _takes(each: Field[Any], kind: type) -> bool:
    """Return whether a field takes values of a kind."""
    return each.type is kind or kind in get_args(each.type)


def find_flag(name: str) -> str:
    """Return the option of a field, as --clock-hz."""
    return "--" + name.replace("_", "-")


def read_request(kind: type[Request], options: Mapping[str, Any]) -> Request:
    """Make a request of the options that were given; others belong to other requests.

    Raises BadValue for a quantity that cannot be read, and click's UsageError for an option whose
    other option is missing.
    """
    names = [each.name for each in fields(kind)]  # type: ignore[arg-type]  # a dataclass
    values = {name: options[name] for name in names if options.get(name) is not None}
    for name, facts in find_options(kind).items():
        if name not in values:
            continue
        if facts.needs and facts.needs not in values:
            message = f"{find_flag(name)} needs {find_flag(facts.needs)}."
            raise click.UsageError(message, click.get_current_context())
        values[name] = _read(name, values[name], facts)
    return kind(**values)


def _read(name: str, value: Any, facts: Option) -> Any:
    """Return the value of a field in SI units."""
    if facts.choices:
        return type(facts.choices[0])(value)
    if facts.unit == "%":
        return read_percent(find_flag(name), value)
    if facts.unit and isinstance(value, str):
        return read_quantity(find_flag(name), value, facts.unit, above=facts.above, like=facts.like)
    return value


def list_options(options: Mapping[str, Any], *kinds: type[Any]) -> dict[str, int | str]:
    """Return the options of requests as they are written, without dashes, with their defaults.

    True: an option without a value. Those are left out unless they were given.
    """
    written: dict[str, int | str] = {}
    for each in (each for kind in kinds for each in fields(kind) if each.metadata):
        facts: Option = each.metadata["option"]
        value: Any = options.get(each.name)
        name = find_flag(each.name)[2:]
        default: Any = each.default
        if _takes(each, bool):
            word = name if value else facts.opposite
            if value is not None and word:
                written[word] = True
        elif value is not None:
            written[name] = value
        elif default is not None and not facts.needs:
            written[name] = default
    return written
