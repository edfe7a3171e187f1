"""The letters by which controllers know their axes."""

from typing import Any

from kinematics.axis import Axis
from kinematics.errors import MotionError
from planner.export.format import option

USUAL = "XYZABCUVW"
LONGEST = 200  # characters of a comment: G-code lines have 255 at most
ALPHABET = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"


def letters_option() -> Any:
    return option(
        None, f"letters of the axes, in the machine's order. Default: their names where letters, else {USUAL}"
    )


def assign(axes: tuple[Axis, ...], given: str | None, allowed: str, format_: str) -> str:
    """A letter for each axis: those given, or the axes' own names where all are allowed letters, else the usual ones.

    Raises MotionError where there are more axes than letters, or those given are not one allowed letter per axis.
    """
    if len(axes) > len(allowed):
        raise MotionError(
            f"axis {axes[len(allowed)].name}: {len(axes)} axes, but {format_} has at most {len(allowed)}, {allowed}; "
            "choose another format"
        )
    if given is not None:
        chosen = given.upper()
        if len(chosen) != len(axes) or len(set(chosen)) != len(chosen) or not set(chosen) <= set(allowed):
            raise MotionError(f"letters {given}: {format_} needs {len(axes)} different ones of {allowed}")
        return chosen
    names = "".join(axis.name.upper() for axis in axes if len(axis.name) == 1)
    own = len(names) == len(axes) == len(set(names)) and set(names) <= set(allowed)
    usual = USUAL if len(axes) <= len(USUAL) else USUAL + "".join(sorted(set(allowed) - set(USUAL)))
    return names if own else usual[: len(axes)]


def told(axes: tuple[Axis, ...], letters: str) -> str:
    """Which letter is which axis, for the notes."""
    return ", ".join(f"{letter} = {axis.name}" for letter, axis in zip(letters, axes, strict=True))


def plain(text: str) -> str:
    """The text as one line of printable ASCII, for comments; what is not shows as ?, and what is too long is cut."""
    return "".join(char if " " <= char <= "~" else "?" for char in text[:LONGEST])
