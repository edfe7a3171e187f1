"""Programs with all coordinates scaled or moved, or all angles scaled."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics.foundation.arrays import Array, freeze_array
from planner.program.model import (
    Arc,
    Curve,
    Dwell,
    Line,
    Program,
    Segment,
    Spline,
    Synchronised,
    Turn,
)


def scale_program(program: Program, start: Array, share: float) -> Program:
    """Return the program with every coordinate p at start + share · (p − start), and orientations
    unchanged.
    """
    offset = (1 - share) * start
    return replace(
        program,
        segments=tuple(_map_segment(segment, share, offset) for segment in program.segments),
    )


def rescale_program(program: Program, factor: float) -> Program:
    """Return the program in another unit of length: every coordinate times `factor`, and those of a
    stated start too.
    """
    start = program.start
    if start is not None:
        start = RigidTransform.from_components(factor * start.translation, start.rotation)
    return replace(scale_program(program, np.zeros(3), factor), start=start)


def shift_program(program: Program, shift: Array) -> Program:
    """Return the program moved by shift (3,) m. A start that is not stated stays where it is."""
    start = program.start
    if start is not None:
        start = RigidTransform.from_components(start.translation + shift, start.rotation)
    segments = tuple(_map_segment(segment, 1.0, shift) for segment in program.segments)
    return replace(program, segments=segments, start=start)


def scale_rotations(program: Program, share: float) -> Program:
    """Return the program with every orientation at a share of its angle from the start's; equations
    keep theirs.
    """
    start = Rotation.identity() if program.start is None else program.start.rotation

    def scale(rotation: Rotation) -> Rotation:
        return start * Rotation.from_rotvec(share * (start.inv() * rotation).as_rotvec())

    segments: list[Segment] = []
    for segment in program.segments:
        match segment:
            case Turn(to=None):
                segments.append(replace(segment, angle=share * segment.angle))
            case Turn(to=Rotation() as rotation):
                segments.append(replace(segment, to=scale(rotation)))
            case Line() | Arc() | Spline() | Synchronised() if segment.rotate is not None:
                segments.append(replace(segment, rotate=scale(segment.rotate)))
            case _:
                segments.append(segment)
    return replace(program, segments=tuple(segments))


def states_destination(program: Program) -> bool:
    """Return whether the program leads from its start to a stated point, by a line, a spline or a
    synchronised move.
    """
    first = next(
        (segment for segment in program.segments if not isinstance(segment, Dwell | Turn)),
        None,
    )
    return isinstance(first, Line | Spline | Synchronised)


def states_rotation(program: Program) -> bool:
    """Return whether any segment states an orientation or an angle; equations do not count."""
    return any(
        isinstance(part, Turn)
        or (isinstance(part, Line | Arc | Spline | Synchronised) and part.rotate is not None)
        for part in program.segments
    )


def _map_segment(segment: Segment, share: float, offset: Array) -> Segment:
    """Return the segment with every coordinate p at share · p + offset."""
    match segment:
        case Line() | Synchronised():
            return replace(segment, to=freeze_array(share * np.asarray(segment.to) + offset))
        case Arc():
            centre = freeze_array(share * np.asarray(segment.centre) + offset)
            return replace(segment, centre=centre, rise=share * segment.rise)
        case Spline():
            return replace(
                segment,
                through=freeze_array(share * np.asarray(segment.through) + offset),
            )
        case Curve():
            length = share * segment.length
            texts = zip(segment.position, (offset / length).tolist(), strict=True)
            x, y, z = (f"({text})+{each!r}" if each else text for text, each in texts)
            return replace(segment, position=(x, y, z), length=length)
        case Turn() | Dwell():
            return segment
