"""What rounding leaves of a zero, taken away: -0 and 4.3e-16 m are 0 in a program that was read from elsewhere."""

from dataclasses import replace

import numpy as np

from kinematics.array import Array
from planner.program import Arc, Line, Program, Segment, Spline

LEAST = 1e-15
"""m, and share of a unit vector: no machine tells it from 0."""
_POINTS: dict[type, tuple[str, ...]] = {Line: ("to",), Arc: ("centre", "normal"), Spline: ("through",)}


def tidy(program: Program) -> Program:
    """The same program, its coordinates below LEAST and its negative zeros made 0."""
    held = [(k, getattr(part, name)) for k, part in enumerate(program.segments) for name in _POINTS.get(type(part), ())]
    if not held:
        return program
    flat = np.concatenate([values.ravel() for _, values in held])
    owner = np.repeat([k for k, _ in held], [values.size for _, values in held])
    changed = set(owner[(abs(flat) < LEAST) & ((flat != 0) | np.signbit(flat))].tolist())
    changed |= {k for k, part in enumerate(program.segments) if isinstance(part, Arc) and 0 < abs(part.rise) < LEAST}
    if not changed:
        return program
    segments = tuple(_tidied(part) if k in changed else part for k, part in enumerate(program.segments))
    return replace(program, segments=segments)


def _tidied(part: Segment) -> Segment:
    changes: dict[str, Array | float] = {name: _zeroed(getattr(part, name)) for name in _POINTS[type(part)]}
    if isinstance(part, Arc) and abs(part.rise) < LEAST:
        changes["rise"] = 0.0
    return replace(part, **changes)  # type: ignore[arg-type]


def _zeroed(values: Array) -> Array:
    return np.where(abs(values) < LEAST, 0.0, values)
