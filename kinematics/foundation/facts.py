"""Facts of results: each field states once how a record names it, and how a table shows it.

A field of a dataclass states it in its type: `deviation: Annotated[float, Fact("deviation_m")]`.
"""

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, is_dataclass
from functools import cache
from typing import Any, cast, get_type_hints

from kinematics.files.plain_text import finite_or_none
from kinematics.foundation.table import Column, Scale, Table


@dataclass(frozen=True, slots=True)
class Fact:
    """How a field appears outside its result.

    key     name in a record, with the unit if that is not plain
    title   heading of the column in a table; "": no column
    unit, scale, form  as of a `Column`
    null    value that a record shows as null, besides NaN and infinity
    """

    key: str
    title: str = ""
    unit: str = ""
    scale: Scale = ""
    form: str = ".6g"
    null: object = None


def record(result: Any) -> Any:
    """Return a result as plain data for JSON: its facts by key, in the order of its fields.

    A class with a method `record` is recorded by that.
    """
    if hasattr(result, "record"):
        return result.record()
    if isinstance(result, list | tuple):
        return [record(each) for each in result]
    if not is_dataclass(result):
        return finite_or_none(result) if isinstance(result, float) else result
    facts = _find_facts(cast(Hashable, type(result)))
    values = {fact: getattr(result, name) for name, fact in facts.items()}
    return {
        fact.key: None if value == fact.null else record(value) for fact, value in values.items()
    }


def record_fields(result: object, *names: str) -> dict[str, Any] | None:
    """Return some attributes of a result by their names, as plain data. None: no result."""
    if result is None:
        return None
    return {name: record(getattr(result, name)) for name in names}


def tabulate(title: str, results: Sequence[Any], *more: Column) -> tuple[Table, ...]:
    """Return the table of results of one type, a row each, with more columns; none without
    results.
    """
    if not results:
        return ()
    return (Table(title, (*_list_columns(results), *more)),)


def _list_columns(results: Sequence[Any]) -> Iterator[Column]:
    """Yield a column for each fact with a title.

    A class with a method `columns` has columns of its own.
    """
    for name, fact in _find_facts(cast(Hashable, type(results[0]))).items():
        values = [getattr(result, name) for result in results]
        if hasattr(values[0], "columns"):
            yield from values[0].columns(values)
        elif fact.title:
            yield Column(fact.title, values, fact.unit, fact.scale, fact.form)


@cache
def _find_facts(kind: Hashable) -> dict[str, Fact]:
    """Return the facts of a dataclass by the names of their fields."""
    hints = get_type_hints(cast(Any, kind), include_extras=True)
    stated = {name: getattr(hint, "__metadata__", ()) for name, hint in hints.items()}
    return {
        name: each for name, extras in stated.items() for each in extras if isinstance(each, Fact)
    }
