"""What is plugged in by name: classes that load when they are asked for."""

from collections.abc import Mapping
from importlib import import_module
from typing import Any

from kinematics.errors import MotionError
from kinematics.registry import nearest


def plugged(what: str, table: Mapping[str, str], name: str) -> Any:
    """The class of a name in a table of "module:class". Raises MotionError for an unknown one, with the nearest."""
    if name not in table:
        raise MotionError(f'no {what} is called "{name}"{nearest(name, table)}; {what}s: {", ".join(table)}')
    module, _, kind = table[name].partition(":")
    return getattr(import_module(module), kind)
