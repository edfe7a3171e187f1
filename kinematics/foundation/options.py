"""What is plugged in by name: classes that load when they are asked for, with options made from
text.

An option is a field of a frozen dataclass that says what it is about.

And arguments of a wrong kind, refused by name where a public function is called, not deep inside.
What a parameter or a field accepts is read from its annotation, its unit too; shapes and ranges are
refused by the functions themselves.
"""

import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import Field, field, fields
from functools import cache, wraps
from importlib import import_module
from inspect import Parameter, get_annotations, isclass, signature
from numbers import Integral, Real
from types import NoneType, SimpleNamespace, UnionType
from typing import (
    Annotated,
    Any,
    Literal,
    ParamSpec,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np

from kinematics.foundation.arrays import MAX_FLOAT
from kinematics.foundation.errors import MotionError, locate_errors
from kinematics.foundation.names import add_article, nearest, unknown_name
from kinematics.foundation.units import Unit, quantity

P = ParamSpec("P")
R = TypeVar("R")


def option(default: Any, about: str, unit: str = "", like: str | None = None) -> Any:
    """Make a field that the command line offers. about: its help

    unit  SI unit of a quantity, which is given as "10 ms"
    like  a usual quantity, for messages
    """
    return field(default=default, metadata={"help": about, "unit": unit, "like": like})


def options(kind: type[Any]) -> dict[str, Field[Any]]:
    """The fields made by `option`, by name."""
    return {field.name: field for field in fields(kind) if "help" in field.metadata}


def make_with(kind: type[R], what: str, given: Mapping[str, Any]) -> R:
    """Return an instance of a dataclass with the given fields.

    A quantity may also be a text with its unit, as on the command line: "0.05 mm".

    Raises MotionError for an unknown field, with the nearest name, and for a value of a wrong kind.
    """
    _refuse_unknown([each.name for each in fields(cast(Any, kind)) if each.init], what, given)
    accepted = _field_kinds(cast(Any, kind), ())
    offered = options(kind)
    values: dict[str, Any] = {}
    for name, value in given.items():
        unit = offered[name].metadata["unit"] if name in offered else ""
        if unit and isinstance(value, str):
            with locate_errors(f"{what}, option {name}"):
                value = quantity(value, unit)
        if name in accepted:
            _refuse_misfit(what, name, value, accepted[name][0])
        values[name] = value
    with locate_errors(what):
        return kind(**values)


def _refuse_unknown(known: Iterable[str], what: str, given: Iterable[str]) -> None:
    for name in given:
        if name not in known:
            offered = ", ".join(known) or "none"
            raise MotionError(
                f'{what} has no option "{name}"{nearest(name, known)}; its options: {offered}'
            )


def read_options(kind: type[Any], given: Mapping[str, str], what: str) -> dict[str, Any]:
    """Values from text: quantities with their unit, else numbers.

    Raises MotionError, which says what was asked of.

    Unknown names are refused with the nearest.
    """
    if not given:
        return {}
    known, hints, values = options(kind), get_type_hints(kind), {}
    _refuse_unknown(known, what, given)
    for name, text in given.items():
        unit = known[name].metadata["unit"]
        try:
            with locate_errors(f"{what}, option {name}"):
                values[name] = quantity(text, unit) if unit else hints[name](text)
        except ValueError:
            number = "a whole number" if hints[name] is int else "a number"
            raise MotionError(f'{what}, option {name}: "{text}" is not {number}') from None
    return values


def split_options(text: str, what: str) -> tuple[str, dict[str, str]]:
    """`name:option=value,option=value` as name and options.

    Raises MotionError for what is not written so.
    """
    name, colon, rest = text.partition(":")
    given: dict[str, str] = {}
    for part in rest.split(",") if colon else ():
        key, equals, value = part.partition("=")
        if not equals or key.strip() in given:
            raise MotionError(f'{what} "{text}": write {name}:OPTION=VALUE,OPTION=VALUE, each once')
        given[key.strip()] = value.strip()
    return name.strip(), given


def load_plugin(what: str, table: Mapping[str, str], name: str) -> Any:
    """The class of a name in a table of "module:class".

    Raises MotionError for an unknown one, with the nearest.
    """
    if name not in table:
        raise unknown_name(what, name, table)
    module, _, kind = table[name].partition(":")
    return getattr(import_module(module), kind)


_NUMBERS: dict[Any, tuple[type, str]] = {
    float: (Real, "a number"),
    int: (Integral, "a whole number"),
}
_ABSENT = object()
_PLAIN = {str: "a text", bool: "True or False", NoneType: "None", bytes: "bytes"}


def check_arguments(*but: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorator: arguments that their annotations do not allow are refused, except those of the
    parameters `but`.

    Raises MotionError, which names the function, the argument, what was given and what is expected.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        @cache
        def accepted() -> dict[str, tuple[Any, tuple[type, ...]]]:
            parameters = signature(function).parameters
            single = [
                name
                for name, one in parameters.items()
                if one.kind not in _SEVERAL and name not in but
            ]
            return _read_kinds(
                {name: parameters[name].annotation for name in single}, function.__module__
            )

        @wraps(function)
        def checked(*args: P.args, **kwargs: P.kwargs) -> R:
            given = (
                signature(function).bind(*args, **kwargs).arguments
            )  # TypeError for what has no such name, as ever
            for name, (kind, classes) in accepted().items():
                value = given.get(name, _ABSENT)
                if value is not _ABSENT and (
                    not isinstance(value, classes) or isinstance(value, bool)
                ):
                    _refuse_misfit(function.__name__, name, value, kind)
            return function(*args, **kwargs)

        return checked

    return decorate


_SEVERAL = (Parameter.VAR_KEYWORD, Parameter.VAR_POSITIONAL)


def check_fields(value: object, *but: str) -> None:
    """Refuse what the fields of a dataclass hold, but for the fields `but`, as `check_arguments`
    does arguments.
    """
    kind: Any = type(value)
    for name, (accepted, classes) in _field_kinds(kind, but).items():
        one = getattr(value, name)
        if (
            not isinstance(one, classes) or one is True or one is False
        ):  # programs have millions of these values
            _refuse_misfit(_split_name(kind.__name__), name, one, accepted)


@cache
def _field_kinds(kind: type[Any], but: tuple[str, ...]) -> dict[str, tuple[Any, tuple[type, ...]]]:
    found: dict[str, tuple[Any, tuple[type, ...]]] = {}
    for base in reversed(kind.__mro__):
        own = get_annotations(base)
        names = [each.name for each in fields(kind) if each.name in own and each.name not in but]
        found |= _read_kinds({name: own[name] for name in names}, base.__module__)
    return found


def _refuse_misfit(what: str, name: str, value: object, kind: Any) -> None:
    if fits(value, kind):
        return
    told = f'"{value}"' if isinstance(value, str) else f"{value!r:.60}"
    raise MotionError(
        f"{what}: {name} is {told}; expected {' or '.join(dict.fromkeys(_describe(kind)))}"
    )


def _read_kinds(
    annotations: Mapping[str, Any], module: str
) -> dict[str, tuple[Any, tuple[type, ...]]]:
    """By name, what is accepted, and the classes of it; without what anything may be."""
    found = {name: _resolve(kind, module) for name, kind in annotations.items()}
    return {name: (kind, _list_classes(kind)) for name, kind in found.items() if kind is not Any}


def _resolve(kind: Any, module: str) -> Any:
    """An annotation; Any where there is none, and for names that only type checkers load."""
    if isinstance(kind, str):
        try:
            alone = SimpleNamespace(
                __annotations__={"kind": kind}
            )  # one that is not known must not cost the others
            kind = get_type_hints(alone, vars(sys.modules[module]), include_extras=True)["kind"]
        except NameError:
            return Any
    return Any if kind is Parameter.empty else kind


def _list_classes(kind: Any) -> tuple[type, ...]:
    """Those of an annotation's kinds that `isinstance` tells at once."""
    parts = get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)
    plain = (get_args(part)[0] if get_origin(part) is Annotated else part for part in parts)
    classes = (part for part in plain if isclass(part) and get_origin(part) is None)
    return tuple(part for part in classes if not getattr(part, "_is_protocol", False))


def fits(value: object, kind: Any) -> bool:
    """Whether a value is of the kind that an annotation states; what cannot be told is taken to
    be.
    """
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return fits(value, parts[0])
    if isinstance(kind, TypeVar):
        return kind.__bound__ is None or fits(value, kind.__bound__)
    if origin in (Union, UnionType):
        return any(fits(value, part) for part in parts)
    if origin is Literal:
        return any(type(value) is type(part) and value == part for part in parts)
    if origin is Callable:
        return callable(value)
    if origin in (Sequence, Iterable) or _is_row_type(kind):
        return _is_row(value, origin) and all(fits(each, parts[0]) for each in _list_entries(value))
    if kind in _NUMBERS:
        is_number = isinstance(value, _NUMBERS[kind][0]) and not isinstance(value, bool | np.bool_)
        return is_number and (kind is int or not isinstance(value, int) or abs(value) <= MAX_FLOAT)
    if kind is bool:
        return isinstance(value, bool | np.bool_)
    if not isclass(kind):
        return True if origin is None or not isclass(origin) else isinstance(value, origin)
    if getattr(kind, "_is_protocol", False):
        return not isclass(value) and all(hasattr(value, name) for name in _list_attributes(kind))
    return isinstance(value, kind)


def _is_row_type(kind: Any) -> bool:
    """Whether it is the annotation of a tuple of any length."""
    return get_origin(kind) is tuple and get_args(kind)[1:] == (...,)


def _is_row(value: object, kind: Any) -> bool:
    if isinstance(value, np.ndarray):
        return value.ndim > 0 and kind is not tuple
    return isinstance(value, kind) and not isinstance(value, str | bytes | Mapping)


def _list_entries(value: Any) -> Sequence[Any]:
    """Those that can be looked at without using them up: of an array of numbers the first, since
    all are of a kind.
    """
    if isinstance(value, np.ndarray):
        return tuple(value if value.dtype.kind == "O" else value[:1])
    return value if isinstance(value, tuple | list) else ()


def _list_attributes(protocol: Any) -> tuple[str, ...]:
    names = {
        name for base in protocol.__mro__[:-1] for name in (*vars(base), *get_annotations(base))
    }
    return tuple(name for name in names if not name.startswith("_"))


def _describe(kind: Any) -> list[str]:
    """In words, what an annotation accepts."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Annotated:
        units = [each.unit for each in parts[1:] if isinstance(each, Unit)]
        return [" in ".join(_describe(parts[0]) + units)]
    if isinstance(kind, TypeVar):
        return _describe(kind.__bound__)
    if origin in (Union, UnionType):
        return [words for part in parts for words in _describe(part)]
    if origin is Literal:
        return [f'"{part}"' if isinstance(part, str) else str(part) for part in parts]
    if origin is Callable:
        return ["a function"]
    if origin in (Sequence, Iterable) or _is_row_type(kind):
        row = "a tuple" if origin is tuple else "a list"
        return [f"{row}, each entry {' or '.join(dict.fromkeys(_describe(parts[0])))}"]
    if kind in _NUMBERS:
        return [_NUMBERS[kind][1]]
    if kind in _PLAIN:
        return [_PLAIN[kind]]
    name = getattr(kind, "__name__", str(kind))
    if name in ("PathLike", "Path"):
        return ["a path"]
    return [add_article(_split_name(name))]


def _split_name(name: str) -> str:
    """The name of a class in words: "actuator need" of `ActuatorNeed`."""
    return " ".join(re.findall("[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+", name)).lower()
