"""The options of formats on the command line, made from the fields of the formats themselves."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import Field, dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args, get_origin, get_type_hints

import click

from planner import request
from pulsepath import known_names, registries
from pulsepath.docstrings import first_paragraph
from pulsepath.options import read_quantity
from pulsepath.registries import Option
from pulsepath.request_options import describe_option, find_flag

if TYPE_CHECKING:
    from pulsepath.inputs import Origin

# Types by the names that `registries` has for them.
TYPES = {"int": int, "float": float, "str": str, "bool": bool}


@dataclass(frozen=True, slots=True)
class Formats:
    """The formats of a command.

    what     name of their table in `registries.TABLES`
    listed   help by name, as in `registries`; formats that a program added describe themselves
    known    options by name, likewise
    find     function that returns the dataclass of a name
    offered  function that returns whether the command offers an added format
    """

    what: str
    listed: Mapping[str, str]
    known: Sequence[Option]
    find: Callable[[str], type[Any]]
    offered: Callable[[type[Any]], bool] = lambda kind: True

    def helps(self) -> dict[str, str]:
        """Return the help of each format that the command offers, by name."""
        added = {name: first_paragraph(kind) for name, kind in self._added()}
        return {**self.listed, **added}

    def names(self) -> list[str]:
        """Return the names of the formats that the command offers."""
        return [*self.helps()]

    def options(self) -> list[click.Parameter]:
        """Return one option per field name; its help lists the formats that have the field."""
        offered = self.helps()
        rows: dict[str, list[Option]] = {}
        added = (row for name, kind in self._added() for row in list_options(name, kind))
        for option, takes, formats, text in (*self.known, *added):
            names = ", ".join(name for name in formats.split() if name in offered)
            if names:
                rows.setdefault(option, []).append((option, takes, names, text))
        return [_make_option(option, several) for option, several in rows.items()]

    def suffixes(self) -> dict[str, str]:
        """Return the names of the import formats by the suffixes of the files that they read."""
        added = {suffix: name for name, kind in self._added() for suffix in kind.suffixes}
        return {**registries.SUFFIXES, **added}

    def help_text(self) -> str:
        """Return a line for each format: its name and its help."""
        helps = self.helps()
        width = max(map(len, helps))
        return "\n".join(f"  {name:<{width}}  {text}" for name, text in helps.items())

    def make(self, name: str, given: Mapping[str, Any]) -> Any:
        """Make the format of a name with the options that were given (None: not given).

        Raises MotionError for another format's option.
        """
        return self.find(name)(**self.options_of(name, given))

    def options_of(self, name: str, given: Mapping[str, Any]) -> dict[str, Any]:
        """Return the given options of a format, in SI units. Raises MotionError as `make`."""
        from kinematics.foundation.errors import MotionError

        fields = {field.name: (field, kind) for field, kind in _fields(self.find(name))}
        values = {key: value for key, value in given.items() if value is not None}
        for key in values.keys() - fields.keys():
            offered = ", ".join(map(find_flag, fields)) or "none"
            raise MotionError(
                f"format {name} has no option {find_flag(key)}; its options: {offered}",
            )
        for key, value in values.items():
            field, kind = fields[key]
            facts = field.metadata
            if facts["unit"]:
                values[key] = read_quantity(find_flag(key), value, facts["unit"], facts["like"])
            choices = get_args(kind) if get_origin(kind) is Literal else ()
            if choices and value not in choices:
                words = ", ".join(choices)
                flag = find_flag(key)
                raise MotionError(f'format {name}, option {flag}: "{value}" is none of {words}')
        return values

    def _added(self) -> Iterator[tuple[str, type[Any]]]:
        """Yield name and dataclass of each format that a program added."""
        for name in known_names.find_added(self.what):
            kind = self.find(name)
            if self.offered(kind):
                yield name, kind


def _load(module: str, name: str) -> Callable[..., Any]:
    """Return a function whose module loads when it is called."""
    return lambda *arguments: getattr(import_module(module), name)(*arguments)


_find_export = _load("planner.export.format", "find_format")
_find_import = _load("planner.sources.source", "find_source")
_takes_stop = _load("planner.export.format", "takes_stop")

EXPORTS = Formats("exports", registries.EXPORTS, registries.EXPORT_OPTIONS, _find_export)
IMPORTS = Formats("imports", registries.IMPORTS, registries.IMPORT_OPTIONS, _find_import)
FROM_REST = registries.FROM_REST.split()
MOVING = {name: text for name, text in registries.EXPORTS.items() if name not in FROM_REST}
STOPS = Formats("exports", MOVING, registries.EXPORT_OPTIONS, _find_export, _takes_stop)


def find_origin(program: str, given: Mapping[str, Any], fit: float | None) -> "Origin | None":
    """Find how to read a program that is a file of another format; None for other programs.

    given: options of formats, as the command line has them; fit: m, likewise.
    Raises MotionError for an option of another format.
    """
    from kinematics.foundation.errors import MotionError
    from pulsepath.inputs import Origin

    suffix = Path(program).suffix.lower()
    name = IMPORTS.suffixes().get(suffix)
    if name is not None:
        options = IMPORTS.options_of(name, given)
        return Origin(name, options if fit is None else {**options, "fit": fit}, suffix)
    for key in (key for key, value in given.items() if value is not None):
        flag = find_flag(key)
        raise MotionError(f"option {flag} is for files of other formats, which {program} is not")
    return None


def list_options(name: str, kind: type[Any]) -> list[Option]:
    """List the options of a format from the fields of its dataclass."""
    rows = []
    for field, hint in _fields(kind):
        rows.append((field.name, _find_type(field, hint), name, field.metadata["help"]))
    return rows


def _fields(kind: type[Any]) -> list[tuple[Field[Any], Any]]:
    """Return the options of a format with their types."""
    from kinematics.foundation.options import options

    hints = get_type_hints(kind)
    return [(field, hints[name]) for name, field in options(kind).items()]


def _find_type(field: Field[Any], hint: Any) -> str | tuple[str, ...]:
    """Return the type of an option as `registries` has it: "quantity", a type's name, or words."""
    if field.metadata["unit"]:
        return "quantity"
    if get_origin(hint) is not Literal:  # as float, or str | None
        hint = next((part for part in get_args(hint) if part is not type(None)), hint)
    return get_args(hint) if get_origin(hint) is Literal else str(hint.__name__)


def _make_option(name: str, rows: Sequence[Option]) -> click.Option:
    """Make the option of several formats. If they take different words, the format checks them."""
    takes = rows[0][1]
    help_text = " ".join(f"[{formats}] {text}." for _, _, formats, text in rows)[:-1]
    is_same = all(row[1] == takes for row in rows)
    facts = request.Option(
        help=help_text,
        metavar="QUANTITY" if takes == "quantity" else None,
        choices=takes if is_same and isinstance(takes, tuple) else (),
        opposite=f"no-{find_flag(name)[2:]}" if takes == "bool" else "",
    )
    kind = TYPES.get(takes, str) if isinstance(takes, str) else str
    words, settings = describe_option(name, kind, facts)
    return click.Option(words, **settings)
