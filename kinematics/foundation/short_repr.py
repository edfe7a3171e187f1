"""What a notebook or a debugger shows of a value in at most three lines: its name, and its fields
that are stated.
"""

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, fields, is_dataclass
from typing import Any

WIDTH, MAX_LINES = 110, 3
"""Characters of a line, and lines."""
MAX_ITEMS, MAX_TEXT = 6, 60
"""Numbers of an array, or entries of a sequence, that are shown one by one; characters of a
text.
"""


def short_repr(value: Any) -> str:
    """Class and fields of a dataclass: those at their default and those that ask for it
    (repr=False) are left out.
    """
    own = fields(value) if is_dataclass(value) else ()
    told = [
        f"{field.name}={_show(getattr(value, field.name))}"
        for field in own
        if _is_told(value, field)
    ]
    return fit_lines(f"{type(value).__name__}({', '.join(told)})")


def fit_lines(text: str) -> str:
    """A text broken at blanks into at most three lines, the end of a longer one left out."""
    lines = [""]
    for word in text.split():
        if len(lines[-1]) + len(word) >= WIDTH and lines[-1]:
            lines.append("   ")
        lines[-1] = f"{lines[-1]} {word}" if lines[-1] else word[:WIDTH]
    return "\n".join(lines) if len(lines) <= MAX_LINES else "\n".join([*lines[:MAX_LINES]]) + " …"


def _is_told(value: Any, field: "Field[Any]") -> bool:
    if not field.repr:
        return False
    import numpy as np

    own = getattr(value, field.name)
    default = field.default_factory() if field.default_factory is not MISSING else field.default
    if default is MISSING:
        return True
    try:
        return not bool(np.all(own == default))
    except (TypeError, ValueError):  # of two that cannot be told apart so
        return own is not default


def _show(value: Any) -> str:
    import numpy as np
    from scipy.spatial.transform import RigidTransform, Rotation

    match value:
        case np.ndarray() if value.size > MAX_ITEMS or value.ndim > 1:
            return f"array {value.shape}".replace(",)", ")")
        case np.ndarray():
            return str([_plain(each) for each in value.tolist()]) if value.ndim else f"{value:.6g}"
        case np.bool_():
            return str(bool(value))
        case float() | np.floating():
            return f"{value:.6g}"
        case str():
            return repr(value if len(value) <= MAX_TEXT else f"{value[:MAX_TEXT]}…")
        case RigidTransform() if value.single:
            angles = value.rotation.as_euler("XYZ", suppress_warnings=True)
            return str([_plain(each) for each in [*value.translation.tolist(), *angles.tolist()]])
        case Rotation() if value.single:
            return str(
                [_plain(each) for each in value.as_euler("XYZ", suppress_warnings=True).tolist()]
            )
        case RigidTransform() | Rotation():
            return f"{len(value)} {'poses' if isinstance(value, RigidTransform) else 'rotations'}"
        case Mapping():
            return f"{len(value)} entries"
        case Sequence() if len(value) > MAX_ITEMS or not all(map(_is_plain, value)):
            kinds = {type(each).__name__ for each in value[:MAX_ITEMS]} if len(value) else set()
            return f"{len(value)} {kinds.pop() if len(kinds) == 1 else 'entries'}"
        case Sequence():
            return "(" + ", ".join(map(_show, value)) + ")"
    if is_dataclass(value) or hasattr(value, "tables"):
        name = getattr(value, "name", "")
        return f"<{type(value).__name__}{' ' if name else ''}{name}>"
    told = repr(value)
    return told if len(told) <= MAX_TEXT else f"<{type(value).__name__}>"


def _plain(value: Any) -> Any:
    return float(f"{value:.6g}") + 0.0 if isinstance(value, float) else value


def _is_plain(value: Any) -> bool:
    return isinstance(value, (str, int, float)) or (
        isinstance(value, tuple)
        and len(value) <= 2
        and all(isinstance(each, (int, float)) for each in value)
    )
