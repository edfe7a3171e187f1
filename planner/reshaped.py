"""Programs with every coordinate scaled about the start or moved, or every angle scaled."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics.array import Array, frozen
from planner.program import Arc, Curve, Dwell, Line, Program, Segment, Spline, Synchronised, Turn


def scaled(program: Program, start: Array, share: float) -> Program:
    """Every coordinate p taken to start + share · (p − start); orientations as they are."""
    segments = tuple(_segment(segment, share, (1 - share) * start) for segment in program.segments)
    return replace(program, segments=segments)


def moved(program: Program, shift: Array) -> Program:
    """Every coordinate moved by (3,) m; the start too, where the program does not lead away from it itself."""
    begin = program.start
    if begin is not None and not leads_away(program):
        begin = RigidTransform.from_components(begin.translation + shift, begin.rotation)
    return replace(program, segments=tuple(_segment(segment, 1.0, shift) for segment in program.segments), start=begin)


def leads_away(program: Program) -> bool:
    """Whether the program goes from its start to a point that it states, by a line, a spline or a synchronised move."""
    first = next((segment for segment in program.segments if not isinstance(segment, Dwell | Turn)), None)
    return isinstance(first, Line | Spline | Synchronised)


def turns(program: Program) -> bool:
    """Whether any segment states an orientation or an angle; equations do not count."""
    return any(
        isinstance(part, Turn) or (isinstance(part, Line | Arc | Spline | Synchronised) and part.rotate is not None)
        for part in program.segments
    )


def unturned(program: Program, share: float) -> Program:
    """Every orientation taken to a share of its angle from the start's; equations keep theirs."""
    begin = Rotation.identity() if program.start is None else program.start.rotation

    def part(given: Rotation) -> Rotation:
        return begin * Rotation.from_rotvec(share * (begin.inv() * given).as_rotvec())

    segments: list[Segment] = []
    for segment in program.segments:
        match segment:
            case Turn(to=None):
                segments.append(replace(segment, angle=share * segment.angle))
            case Turn(to=Rotation() as given):
                segments.append(replace(segment, to=part(given)))
            case Line() | Arc() | Spline() | Synchronised() if segment.rotate is not None:
                segments.append(replace(segment, rotate=part(segment.rotate)))
            case _:
                segments.append(segment)
    return replace(program, segments=tuple(segments))


def _segment(segment: Segment, share: float, away: Array) -> Segment:
    """With every coordinate p taken to share · p + away."""
    match segment:
        case Line() | Synchronised():
            return replace(segment, to=frozen(share * np.asarray(segment.to) + away))
        case Arc():
            centre = frozen(share * np.asarray(segment.centre) + away)
            return replace(segment, centre=centre, rise=share * segment.rise)
        case Spline():
            return replace(segment, through=frozen(share * np.asarray(segment.through) + away))
        case Curve():
            length = share * segment.length
            texts = zip(segment.position, (away / length).tolist(), strict=True)
            x, y, z = (f"({text})+{offset!r}" if offset else text for text, offset in texts)
            return replace(segment, position=(x, y, z), length=length)
        case Turn() | Dwell():
            return segment
