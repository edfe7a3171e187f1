"""The kinds of TOML files, by keys that only one of them has: so that one given for another is called what it is."""

from collections.abc import Mapping
from typing import Any

OWN = {
    "machine file": ("kind", "geometry", "axes", "wiring", "rotary"),
    "program": ("segment",),
    "rig": ("servo", "stepper", "task", "card", "host"),
    "measurement file": ("pose", "rotation", "initial", "noise"),
}
"""At the top level."""
_GIVEN = {
    "machine file": "by --machine, or where a MACHINE is asked for",
    "program": "where a PROGRAM is asked for",
    "rig": "to compare",
    "measurement file": "to calibrate, after its MACHINE",
}


def mistaken(data: Mapping[str, Any], wanted: str) -> str:
    """What to say of data that has no key of the kind wanted and some of just one other; else empty."""
    found = {what: present for what, keys in OWN.items() if (present := [key for key in keys if key in data])}
    if wanted not in OWN or wanted in found or len(found) != 1:
        return ""
    ((what, keys),) = found.items()
    return f"this is a {what}, by its {', '.join(keys)}, and a {wanted} is asked for here: give it {_GIVEN[what]}"
