"""The options of formats on the command line, made from the fields of the formats themselves."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import Field, dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args, get_origin, get_type_hints

import click

from pulsepath import known_names
from pulsepath.options import read_quantity

if TYPE_CHECKING:
    from pulsepath.inputs import Origin

USUAL = re.compile(r'as "([^"]+)"|Default:? (\d[\d.]* [a-z/]+)')
"""A usual value of an option that is a quantity, in its help."""
TYPES = {"int": click.INT, "float": click.FLOAT, "str": click.STRING}
"""Of options, as they are kept on disk."""


@dataclass(frozen=True, slots=True)
class Formats:
    """The formats of a command: what they are called together, the table of names, how each dataclass is found.

    fits    which of them the command offers
    Their options, first lines and suffixes are kept on disk (`known_names.recall`), so that neither --help nor the
    suffix of a file loads them all.
    """

    what: str
    table: str
    find: Callable[[str], type[Any]]
    fits: Callable[[type[Any]], bool] = lambda kind: True

    def names(self) -> list[str]:
        """Of those that the command offers."""
        return [*self._recall()["first"]]

    def options(self) -> list[click.Parameter]:
        """One option per field name; its help lists the formats that have the field and their descriptions."""
        return [_make_option(**told) for told in self._recall()["options"]]

    def suffixes(self) -> dict[str, str]:
        """The names of the formats by the suffixes of the files that they read."""
        return dict(self._recall()["suffixes"])

    def _recall(self) -> dict[str, Any]:
        found: dict[str, Any] = known_names.recall(self.what, self._describe)
        return found

    def _describe(self) -> dict[str, Any]:
        """The options of all formats, the first line of each format's docstring, and suffixes, as data for JSON."""
        known: dict[str, dict[str, list[str]]] = {}
        kinds: dict[str, list[Any]] = {}
        options: dict[str, dict[str, Any]] = {}
        first: dict[str, str] = {}
        suffixes: dict[str, str] = {}
        for name in getattr(import_module(known_names.TABLES[self.what]), self.table):
            if not self.fits(self.find(name)):
                continue
            first[name] = (self.find(name).__doc__ or "").splitlines()[0]
            suffixes |= dict.fromkeys(getattr(self.find(name), "suffixes", ()), name)
            for field, kind in _fields(self.find(name)):
                known.setdefault(field.name, {}).setdefault(field.metadata["help"], []).append(name)
                kinds.setdefault(field.name, []).append(kind)
                options.setdefault(field.name, _describe_option(field, kind))
        for name, option in options.items():
            option["told"] = " ".join(f"[{', '.join(formats)}] {told}." for told, formats in known[name].items())[:-1]
            if any(kind != kinds[name][0] for kind in kinds[name]):
                option["choices"] = ()  # what each takes is looked at when it is made
        return {"options": [*options.values()], "first": first, "suffixes": suffixes}

    def make(self, name: str, given: Mapping[str, Any]) -> Any:
        """The format of a name with the options that were given (None: not given).

        Raises MotionError for another's.
        """
        return self.find(name)(**self.options_of(name, given))

    def options_of(self, name: str, given: Mapping[str, Any]) -> dict[str, Any]:
        """Those that were given of a format, in SI units."""
        from kinematics.foundation.errors import MotionError

        format_ = self.find(name)
        own = {field.name: field for field, _ in _fields(format_)}
        kinds = {field.name: kind for field, kind in _fields(format_)}
        values = {key: value for key, value in given.items() if value is not None}
        for key in values.keys() - own.keys():
            offered = ", ".join(_flag(field) for field in own) or "none"
            raise MotionError(f"format {name} has no option {_flag(key)}; its options: {offered}")
        for key in values:
            unit = own[key].metadata["unit"]
            if unit:
                usual = USUAL.search(own[key].metadata["help"])
                like = None if usual is None else usual[1] or usual[2]
                values[key] = read_quantity(_flag(key), values[key], unit, like=like)
            if get_origin(kinds[key]) is Literal and values[key] not in get_args(kinds[key]):
                choices = ", ".join(get_args(kinds[key]))
                raise MotionError(f'format {name}, option {_flag(key)}: "{values[key]}" is none of {choices}')
        return values

    def help_text(self) -> str:
        """A line for each format: its name and the first line of its docstring."""
        first = self._recall()["first"]
        return "\n".join(f"  {name:<{max(map(len, first))}}  {line}" for name, line in first.items())


def _find_export(name: str) -> type[Any]:
    from planner.export.format import find_format

    return find_format(name)


def _find_import(name: str) -> type[Any]:
    from planner.sources.source import find_source

    return find_source(name)


def _takes_stop(kind: type[Any]) -> bool:
    from planner.export.format import takes_stop

    return takes_stop(kind)


EXPORTS = Formats("exports", "FORMATS", _find_export)
STOPS = Formats("stops", "FORMATS", _find_export, _takes_stop)
IMPORTS = Formats("imports", "SOURCES", _find_import)


def find_origin(program: str, given: Mapping[str, Any], fit: float | None) -> "Origin | None":
    """How a program is read that is a file of another format; None: it is none.

    given: options of formats, as the command line has them; fit: m, likewise. Raises MotionError for those of another.
    """
    from kinematics.foundation.errors import MotionError
    from pulsepath.inputs import Origin

    suffix = Path(program).suffix.lower()
    name = IMPORTS.suffixes().get(suffix)
    if name is not None:
        options = IMPORTS.options_of(name, given)
        return Origin(name, options if fit is None else {**options, "fit": fit}, suffix)
    if told := [key for key, value in given.items() if value is not None]:
        raise MotionError(f"option {_flag(told[0])} is for files of other formats, which {program} is not")
    return None


def _fields(format_: type[Any]) -> list[tuple[Field[Any], Any]]:
    from kinematics.foundation.options import options

    hints = get_type_hints(format_)
    return [(field, hints[name]) for name, field in options(format_).items()]


def _flag(name: str) -> str:
    return "--" + name.replace("_", "-")


def _describe_option(field: Field[Any], kind: Any) -> dict[str, Any]:
    """The keywords of `_make_option` but for what is told, as data for JSON."""
    plain = [part for part in get_args(kind) if part is not type(None)] if get_origin(kind) is not Literal else [kind]
    kind = plain[0] if plain else kind
    chosen = get_origin(kind) is Literal and not field.metadata["unit"]
    taken = "quantity" if field.metadata["unit"] else "str" if chosen else kind.__name__
    return {"name": field.name, "kind": taken, "choices": get_args(kind) if chosen else ()}


def _make_option(name: str, kind: str, choices: Sequence[str], told: str) -> click.Option:
    if kind == "quantity":
        return click.Option([_flag(name)], metavar="QUANTITY", help=told)
    if kind == "bool":
        return click.Option([f"{_flag(name)}/--no-{_flag(name)[2:]}"], default=None, help=told)
    return click.Option([_flag(name)], type=click.Choice(choices) if choices else TYPES[kind], help=told)
