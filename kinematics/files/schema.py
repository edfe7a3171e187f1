"""Schemas of files: typed tables, and every fault of a document in one pass, in words that bring
the remedy.

A file's schema is a `TableSchema` whose fields say what they accept and mean, so that it reads like
the file:

    class Leg(TableSchema):
        travel: tuple[Length, Length] = key("from home", '["0 mm", "50 mm"]')
        max_speed: Annotated[float, Unit("m/s", above=0)] | None = key("unlimited if not stated",
        '"20 mm/s"', None)

A file of one kind that is given for another is called what it is: each kind has keys that no other
has.
"""

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar, get_args, get_origin

from pydantic import (
    AfterValidator,
    AllowInfNan,
    BaseModel,
    ConfigDict,
    ModelWrapValidatorHandler,
    ValidationError,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, InitErrorDetails

from kinematics.files.keys import Chosen, key, remedy_of
from kinematics.files.toml_document import Document, Key
from kinematics.foundation.arrays import LEAST_POSITIVE
from kinematics.foundation.errors import BadValue, Fault, FileError, MotionError, validation_error
from kinematics.foundation.names import add_article, closest, count_noun, nearest
from kinematics.foundation.units import Unit, describe_value, everyday_unit, unit_value

KIND_KEYS = {
    "machine file": ("kind", "geometry", "axes", "wiring", "rotary"),
    "program": ("segment",),
    "rig": ("servo", "stepper", "task", "card", "host"),
    "measurement file": ("pose", "rotation", "initial", "noise"),
}
"""At the top level."""
_INPUT_HINTS = {
    "machine file": "by --machine, or where a MACHINE is asked for",
    "program": "where a PROGRAM is asked for",
    "rig": "to compare",
    "measurement file": "to calibrate, after its MACHINE",
}


def describe_wrong_kind(data: Mapping[str, Any], wanted: str) -> str:
    """What to say of data that has no key of the kind wanted and some of just one other; else
    empty.
    """
    found = {
        what: present
        for what, keys in KIND_KEYS.items()
        if (present := [key for key in keys if key in data])
    }
    if wanted not in KIND_KEYS or wanted in found or len(found) != 1:
        return ""
    ((what, keys),) = found.items()
    asked = f"{add_article(wanted)} is asked for here: give it {_INPUT_HINTS[what]}"
    return f"this is {add_article(what)}, by its {', '.join(keys)}, and {asked}"


class TableSchema(BaseModel):
    """A table of a file: every key known and of its exact type, else a fault that names the nearest
    or the remedy.
    """

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, defer_build=True)

    @model_validator(mode="wrap")
    @classmethod
    def _explain(cls, data: object, handler: ModelWrapValidatorHandler[Self]) -> Self:
        try:
            return handler(data)
        except ValidationError as error:
            explained = [cls._explain_error(e) for e in _join_missing(error.errors())]
            raise ValidationError.from_exception_data(cls.__name__, explained) from None

    @classmethod
    def _explain_error(cls, error: ErrorDetails) -> InitErrorDetails:
        """The error in words that only its own table can find, since only it knows its keys; outer
        tables keep them.
        """
        keys = {field.alias or name: field for name, field in cls.model_fields.items()}
        last, value = str(error["loc"][-1]) if error["loc"] else "", error["input"]
        told = BadValue("")
        match error["type"]:
            case "explained":
                told = BadValue(**error["ctx"])
            case "fault":
                told = BadValue(**error["ctx"])
                if not isinstance(value, dict) and describe_value(value) not in str(told):
                    told = BadValue(
                        f"{describe_value(value)}: {told}",
                        allowed=told.allowed,
                        nearest=told.nearest,
                    )
            case "extra_forbidden":
                message = f"{_UNKNOWN}{nearest(last, keys)}; valid keys: {', '.join(keys)}"
                told = BadValue(message, allowed=", ".join(keys), nearest=closest(last, keys))
            case "missing" if last in keys:
                example = remedy_of(keys[last]) or _example(
                    last, keys[last].annotation, keys[last].metadata
                )
                told = BadValue(": ".join(filter(None, ["missing", example])), allowed=example)
            case "too_short" | "too_long" as kind:
                count = error["ctx"]["min_length" if kind == "too_short" else "max_length"]
                message = f"{describe_value(value)} has {count_noun(len(value), 'entry')} instead of {count}"
                told = BadValue(
                    f"{message}{_show(keys, error['loc'])}", allowed=count_noun(count, "entry")
                )
            case "literal_error":
                expected = error["ctx"]["expected"].replace("'", '"')
                choices = re.findall('"(.*?)"', expected)
                message = f"{describe_value(value)} is not {expected}{nearest(str(value), choices)}"
                if expected == "1" and isinstance(value, int) and value > 1:
                    message = f"{value} is newer than this version of pulsepath, which reads schema = 1: update it"
                told = BadValue(message, allowed=expected, nearest=closest(str(value), choices))
            case "tuple_type" if (
                isinstance(value, dict) and last in keys and (example := _number_array(keys[last]))
            ):
                told = BadValue(f"is a table, and an array is asked for: write {last} = {example}")
            case "tuple_type" if isinstance(value, dict):
                told = BadValue(
                    f"is one table, and an array of them is asked for: write [[{last}]]"
                )
            case "model_type" | "tuple_type" as kind:
                what = "a table" if kind == "model_type" else "an array"
                told = BadValue(f"{describe_value(value)} is not {what}{_show(keys, error['loc'])}")
            case kind if kind in _BOUNDS:
                allowed = f"{_BOUNDS[kind]} {next(iter(error['ctx'].values())):g}"
                told = BadValue(f"{describe_value(value)} must be {allowed}", allowed=allowed)
            case kind if kind in _TYPES:
                message = (
                    f"{describe_value(value)} is not {_TYPES[kind]}{_show(keys, error['loc'])}"
                )
                told = BadValue(message, allowed=_TYPES[kind])
            case _:
                told = BadValue(
                    f"{describe_value(value)}: {error['msg'][0].lower()}{error['msg'][1:]}"
                )
        return {"type": validation_error(told, "explained"), "loc": error["loc"], "input": value}


def _join_missing(errors: Sequence[ErrorDetails]) -> Iterator[ErrorDetails]:
    """The errors, with one of an array that is too short, not one of each entry that it lacks."""
    lacks = [
        e["type"] == "missing" and bool(e["loc"]) and isinstance(e["loc"][-1], int) for e in errors
    ]
    most = {
        e["loc"][:-1]: int(e["loc"][-1]) + 1
        for e, lacking in zip(errors, lacks, strict=True)
        if lacking
    }
    for error, lacking in zip(errors, lacks, strict=True):
        if not lacking:
            yield error
        elif (count := most.pop(error["loc"][:-1], None)) is not None:
            yield {
                **error,
                "type": "too_short",
                "loc": error["loc"][:-1],
                "ctx": {"min_length": count},
            }


def _show(keys: Mapping[str, FieldInfo], loc: Key) -> str:
    """What the key's declaration says of how it may look, to go behind what is wrong with it;
    empty: nothing.
    """
    field = keys.get(str(loc[0])) if loc else None
    if field is None:
        return ""
    example = str((field.examples or [""])[0])
    if len(loc) > 1 and example:  # an entry of the value
        return f": as in {loc[0]} = {example}"
    remedy = remedy_of(field) or (example and f"write e.g. {example}")
    return remedy and f": {remedy}"


def _number_array(field: FieldInfo) -> str:
    """The array that its declaration shows, if it is one of numbers or texts, not of tables."""
    example = str((field.examples or [""])[0])
    return example if example.startswith("[") and "{" not in example else ""


_UNKNOWN = "unknown key"
_BOUNDS = {
    "greater_than": "above",
    "greater_than_equal": "at least",
    "less_than": "below",
    "less_than_equal": "at most",
}
_TYPES = {
    "int_type": "a whole number",
    "float_type": "a number",
    "finite_number": "a finite number",
    "bool_type": "true or false",
    "string_type": 'a text in quotes, as "a"',
}


class File(TableSchema):
    """What every file says first.

    what    what the file is, as `KIND_KEYS` has it
    places  table in which a key belongs that may be looked for elsewhere, by the key
    """

    what: ClassVar[str] = ""
    places: ClassVar[Mapping[str, str]] = {}
    version: Literal[1] = key(
        "version of the file format", alias="schema", remedy="write schema = 1"
    )


def is_name(name: str) -> bool:
    """Return whether a machine or a program may be called so."""
    fits = 0 < len(name) <= MAX_NAME_LENGTH and name.strip(" .") != ""
    return fits and name.isprintable() and not set(name) & set("/\\")


def _check_name(name: str) -> str:
    if not is_name(name):
        raise validation_error(
            f"{describe_value(name)} is not a name: give 1 to {MAX_NAME_LENGTH} characters without / and \\"
        )
    return name


MAX_NAME_LENGTH = 100
Name = Annotated[str, AfterValidator(_check_name)]
NAME = key("name in reports and records; that of the file if not stated", '"mine"', None)
"""Name of the machine or the program that a file describes."""

Model = TypeVar("Model", bound=File)
Rule = Callable[[dict[str, Any]], Iterable[tuple[Key, str | MotionError]]]


def build(
    document: Document, model: type[Model], *rules: Rule, plain: Mapping[str, float] | None = None
) -> Model:
    """The document as a model; raises FileError with every fault, in the order of the lines.

    rules  find what no single value shows, in the raw data: (key, message) of each fault
    plain  SI value of a number without unit, by the name that `Unit.plain` gives (nothing: such
           numbers are faults)
    """
    refuse_wrong_kind(document, model.what)
    faults = [
        document.fault(key, message) for rule in rules for key, message in rule(document.data)
    ]
    try:
        made = model.model_validate(document.data, context=plain)
    except ValidationError as error:
        for fault in error.errors():
            place = fault["loc"]
            hinted = _hint_place(place, BadValue(**fault["ctx"]), model)
            faults.append(document.fault(place, hinted))
    if faults:
        raise FileError(document.file, sorted(faults, key=lambda fault: fault.line or 0))
    return made


def _hint_place(key: Key, error: BadValue, model: type[File]) -> BadValue:
    """Return the error of an unknown key with the place where it belongs, others unchanged."""
    if not str(error).startswith(_UNKNOWN):
        return error
    top = {field.alias or name for name, field in model.model_fields.items()}
    table = model.places.get(str(key[-1]))
    # entries of an array are such tables themselves
    inside = len(key) > 1 and isinstance(key[-2], int)
    if table is not None and not inside:
        message = f"{_UNKNOWN} here: it belongs in a line of its own under {table}"
    elif len(key) > 1 and key[-1] in top:
        belongs = "it belongs at the top of the file, above the first [table]"
        message = f"{_UNKNOWN} in this table: {belongs}"
    else:
        return error
    return BadValue(message, allowed=error.allowed, nearest=error.nearest)


def refuse_wrong_kind(document: Document, what: str) -> None:
    """Raise FileError for a file that is of another kind by its keys."""
    if told := describe_wrong_kind(document.data, what):
        raise FileError(document.file, [Fault("", told, 1)])


def _example(key: str, annotation: Any, metadata: Iterable[Any]) -> str:
    """What a missing value may look like, from its type; empty where that does not say."""
    for part in metadata:
        if isinstance(part, Unit):
            return part.example
    entries = [get_args(entry)[1:] for entry in get_args(annotation)]
    units = [part for entry in entries for part in entry if isinstance(part, Unit)]
    if get_origin(annotation) is tuple and len(units) == len(entries) > 0:
        plain = [unit.plain and not unit.unit_written for unit in units]
        texts = [describe_value(unit.like or f"20 {everyday_unit(unit.unit)}") for unit in units]
        likely = ("0" if bare else text for bare, text in zip(plain, texts, strict=True))
        return f"write e.g. [{', '.join(likely)}]"
    if get_origin(annotation) is Literal:
        return f"write {' or '.join(map(describe_value, get_args(annotation)))}"
    if annotation is str:
        return 'write a text in quotes, as "a"'
    return f"add the table [{key}]" if any(tables_in(annotation)) else ""


def tables_in(kind: Any) -> Iterator[type[TableSchema]]:
    """The schemas that an annotation names."""
    if isinstance(kind, type) and issubclass(kind, TableSchema):
        yield kind
    for part in get_args(kind):
        yield from tables_in(part)


def require_nonzero(value: Any) -> Any:
    """Validator of a number or a vector."""
    if not any(
        abs(part) >= LEAST_POSITIVE for part in (value if isinstance(value, tuple) else (value,))
    ):
        raise validation_error(
            f"must not be zero{': write e.g. [1, 0, 0]' if isinstance(value, tuple) else ''}"
        )
    return value


Number = Annotated[float, AllowInfNan(False)]
Direction = Annotated[tuple[Number, Number, Number], AfterValidator(require_nonzero)]


def unit_validator(unit: str) -> AfterValidator:
    """Validator of the name of a unit of the dimension of `unit`."""

    def check(name: str) -> str:
        try:
            unit_value(name, unit)
        except MotionError as error:
            raise validation_error(error) from None
        return name

    return AfterValidator(check)


def read_declared_units(data: Mapping[str, Any], units: Mapping[str, str]) -> dict[str, float]:
    """SI value of one plain number, per declaration in `units`; 1 for a faulty one, which is a
    fault of its own.
    """
    values = {}
    for name in units.keys() & data.keys():
        try:
            values[name] = unit_value(data[name], units[name])
        except MotionError:
            values[name] = 1.0
    return values


def one_of_tables(*tables: type[TableSchema]) -> Chosen:
    """Annotation of a table that is exactly one of the given: the one whose own keys (in no other)
    are present.
    """
    counts = Counter(key for table in tables for key in table.model_fields)
    own = {table: [key for key in table.model_fields if counts[key] == 1] for table in tables}

    def pick(value: Any) -> type[TableSchema]:
        given = (
            list(value) if isinstance(value, dict) else own[tables[0]]
        )  # what is no table fits none, and is told so
        present = {
            table: found
            for table, keys in own.items()
            if (found := [key for key in given if key in keys])
        }
        if len(present) == 1:
            return next(iter(present))
        asked = " or ".join(", ".join(keys) for keys in own.values())
        if present:
            clash = " and ".join(", ".join(keys) for keys in present.values())
            raise validation_error(f"{clash} exclude each other: give {asked}")
        unknown = [key for key in given if key not in counts][:1]
        odd = "".join(
            f"; unknown key {describe_value(key)}{nearest(key, counts)}" for key in unknown
        )
        near = "".join(closest(key, counts) for key in unknown)
        raise validation_error(
            BadValue(f"incomplete: give {asked}{odd}", allowed=asked, nearest=near)
        )

    return Chosen(pick)
