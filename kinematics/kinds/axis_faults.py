"""What is wrong with the tables of axes of a machine file, beyond what each of them may hold."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from kinematics.files.toml_document import Key
from kinematics.foundation.errors import BadValue, MotionError
from kinematics.foundation.names import closest, nearest
from kinematics.foundation.units import describe_value
from kinematics.kinds.axis_keys import TRAVEL_KEYS


def find_pulse_faults(
    names: Sequence[str], turning: Sequence[str], data: Mapping[str, Any]
) -> Iterator[tuple[Key, str]]:
    """A table that states both a pulse and the drive that makes it, or neither where an axis has
    none of its own.

    names, turning  of all axes, and of those that [rotary] is for, if the file has it; of no names
                    nothing is known
    """
    tables = data.get("axis", ())
    own: list[Any] = [*tables] if isinstance(tables, tuple) else []
    stating = [
        each.get("name")
        for each in own
        if isinstance(each, dict) and {"pulse", "drive"} & each.keys()
    ]
    for name in ("axes", "rotary"):
        table = data.get(name)
        given = _find_pulses(table)
        if len(given) == 2:
            yield (name, "drive"), EXCLUDING
        rotary = turning if "rotary" in data else ()
        whose = [each for each in names if (each in rotary) == (name == "rotary")]
        if not given and not (whose and all(each in stating for each in whose)):
            yield (name, "pulse"), 'missing: write e.g. "0.75 um", or a drive with its steps'
    for n, table in enumerate(own):
        if len(_find_pulses(table)) == 2:
            yield ("axis", n, "drive"), EXCLUDING


def find_travel_faults(names: Sequence[str], data: Mapping[str, Any]) -> Iterator[tuple[Key, str]]:
    """Yield the faults of legs: tables that state travel and leg_length, and legs for which none
    states either.
    """
    tables = data.get("axis", ())
    single: list[Any] = [*tables] if isinstance(tables, tuple) else []
    common = data.get("axes")
    stating = [
        table.get("name")
        for table in single
        if isinstance(table, dict) and TRAVEL_KEYS & table.keys()
    ]
    if (
        isinstance(common, dict)
        and not TRAVEL_KEYS & common.keys()
        and not set(names) <= set(stating)
    ):
        remedy = (
            'write e.g. ["0 mm", "50 mm"], counted from home, or leg_length = ["250 mm", "300 mm"]'
        )
        yield ("axes", "travel"), f"missing: {remedy}"
    places: list[tuple[Key, Any]] = [
        (("axes",), common),
        *((("axis", n), table) for n, table in enumerate(single)),
    ]
    for place, table in places:
        if isinstance(table, dict) and table.keys() >= TRAVEL_KEYS:
            yield (*place, "leg_length"), "travel and leg_length exclude each other: give one"


EXCLUDING = "pulse and drive exclude each other: give one"


def _find_pulses(table: Any) -> set[str]:
    """Which of both a table states; of what is no table nothing is known."""
    return {"pulse", "drive"} & table.keys() if isinstance(table, dict) else {"pulse"}


def find_wiring_faults(
    names: Sequence[str], data: Mapping[str, Any]
) -> Iterator[tuple[Key, MotionError]]:
    """Every key of [wiring] that is none of the axes' names; of no names nothing is known."""
    wiring = data.get("wiring")
    for name in wiring if isinstance(wiring, dict) and names else ():
        if name not in names:
            known = ", ".join(names)
            told = f"{describe_value(name)} is no axis{nearest(name, names)}; axes: {known}"
            yield ("wiring", name), BadValue(told, allowed=known, nearest=closest(name, names))


def find_repeated_names(data: Mapping[str, Any], array: str = "axis") -> Iterator[tuple[Key, str]]:
    """Every [[axis]] table (or of another array) after the first of its name."""
    seen = set()
    tables = data.get(array, ())
    for n, table in enumerate(tables if isinstance(tables, tuple) else ()):
        name = table.get("name") if isinstance(table, dict) else None
        if isinstance(name, str) and name in seen:
            yield (array, n, "name"), f"{describe_value(name)} has an [[{array}]] table already"
        seen.add(name if isinstance(name, str) else None)
