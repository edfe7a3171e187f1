"""The options of formats on the command line, made from the fields of the formats themselves."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import Field, dataclass
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

import click

from kinematics.foundation.errors import MotionError
from kinematics.foundation.options import options
from planner.export.format import FORMATS, find_format
from planner.sources.source import SOURCES, find_source, suffix_formats
from pulsepath.inputs import Origin
from pulsepath.options import read_quantity


@dataclass(frozen=True, slots=True)
class Formats:
    """The formats of a command: their names, and the frozen dataclass of each."""

    names: Iterable[str]
    find: Callable[[str], type[Any]]

    def options(self) -> list[click.Parameter]:
        """One option per field name; its help lists the formats that have the field and their descriptions."""
        known: dict[str, dict[str, list[str]]] = {}
        kinds: dict[str, list[Any]] = {}
        described: dict[str, click.Option] = {}
        for name in self.names:
            for field, kind in _fields(self.find(name)):
                known.setdefault(field.name, {}).setdefault(field.metadata["help"], []).append(name)
                kinds.setdefault(field.name, []).append(kind)
                described.setdefault(field.name, _option(field, kind))
        for name, option in described.items():
            option.help = " ".join(f"[{', '.join(formats)}] {told}." for told, formats in known[name].items())[:-1]
            if any(kind != kinds[name][0] for kind in kinds[name]) and isinstance(option.type, click.Choice):
                option.type = click.STRING  # what each takes is looked at when it is made
        return list(described.values())

    def make(self, name: str, given: Mapping[str, Any]) -> Any:
        """The format of a name with the options that were given (None: not given).

        Raises MotionError for another's.
        """
        return self.find(name)(**self.options_of(name, given))

    def options_of(self, name: str, given: Mapping[str, Any]) -> dict[str, Any]:
        """Those that were given of a format, in SI units."""
        format_ = self.find(name)
        own = {field.name: field for field, _ in _fields(format_)}
        kinds = {field.name: kind for field, kind in _fields(format_)}
        values = {key: value for key, value in given.items() if value is not None}
        for key in values.keys() - own.keys():
            offered = ", ".join(_flag(field) for field in own) or "none"
            raise MotionError(f"format {name} has no option {_flag(key)}; its options: {offered}")
        for key in values:
            unit = own[key].metadata["unit"]
            values[key] = read_quantity(_flag(key), values[key], unit) if unit else values[key]
            if get_origin(kinds[key]) is Literal and values[key] not in get_args(kinds[key]):
                choices = ", ".join(get_args(kinds[key]))
                raise MotionError(f'format {name}, option {_flag(key)}: "{values[key]}" is none of {choices}')
        return values

    def help_text(self) -> str:
        """A line for each format: its name and the first line of its docstring."""
        first = {name: (self.find(name).__doc__ or "").splitlines()[0] for name in self.names}
        return "\n".join(f"  {name:<{max(map(len, first))}}  {line}" for name, line in first.items())


EXPORTS = Formats(FORMATS, find_format)
IMPORTS = Formats(SOURCES, find_source)


def find_origin(program: str, given: Mapping[str, Any], fit: float | None) -> Origin | None:
    """How a program is read that is a file of another format; None: it is none.

    given: options of formats, as the command line has them; fit: m, likewise. Raises MotionError for those of another.
    """
    suffix = Path(program).suffix.lower()
    name = suffix_formats().get(suffix)
    if name is not None:
        options = IMPORTS.options_of(name, given)
        return Origin(name, options if fit is None else {**options, "fit": fit}, suffix)
    if told := [key for key, value in given.items() if value is not None]:
        raise MotionError(f"option {_flag(told[0])} is for files of other formats, which {program} is not")
    return None


def _fields(format_: type[Any]) -> list[tuple[Field[Any], Any]]:
    hints = get_type_hints(format_)
    return [(field, hints[name]) for name, field in options(format_).items()]


def _flag(name: str) -> str:
    return "--" + name.replace("_", "-")


def _option(field: Field[Any], kind: Any) -> click.Option:
    plain = [part for part in get_args(kind) if part is not type(None)] if get_origin(kind) is not Literal else [kind]
    kind = plain[0] if plain else kind
    told = field.metadata["help"]
    if field.metadata["unit"]:
        return click.Option([_flag(field.name)], metavar="QUANTITY", help=told)
    if kind is bool:
        return click.Option([f"{_flag(field.name)}/--no-{_flag(field.name)[2:]}"], default=None, help=told)
    if get_origin(kind) is Literal:
        return click.Option([_flag(field.name)], type=click.Choice(get_args(kind)), help=told)
    return click.Option([_flag(field.name)], type=kind, help=told)
