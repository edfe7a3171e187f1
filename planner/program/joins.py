"""A program with other joins: fitted within a tolerance, or with a stop at each."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

from planner.program.model import Dwell, Program, Segment, SegmentStream
from planner.program.modifiers import Fit, Stop


def fit_joins(program: Program, tolerance: float) -> Program:
    """The same program with its path fitted within a tolerance (m), whatever its joins say.

    Stops that a trigger marks stay: what it stands for, as a change of the tool, may need the rest.
    """
    behind = (*program.segments[1:], None)
    fitted = (
        part
        if isinstance(part, Dwell) or is_marked_stop(part, after)
        else replace(part, join=Fit(tolerance))
        for part, after in zip(program.segments, behind, strict=True)
    )
    return replace(program, segments=tuple(fitted))


def is_marked_stop(part: Segment, after: Segment | None) -> bool:
    """Whether a segment ends at rest and a trigger is there: at its end, or at the start of the one
    after it.
    """
    ends = [getattr(part, "trigger", None), getattr(after, "trigger", None)]
    marked = any(one is not None and one.at == at for one, at in zip(ends, (1.0, 0.0), strict=True))
    return marked and isinstance(getattr(part, "join", None), Stop)


def stop_at_joins(program: Program) -> Program:
    """The same program with a stop at every join, or every corner of a fit: what a control without
    blends would run.
    """
    stream = program.segments
    if isinstance(stream, SegmentStream):
        return replace(program, segments=replace(stream, read=partial(_stop_each, stream)))
    return replace(program, segments=tuple(_stop_each(stream)))


def _stop_each(segments: Sequence[Segment]) -> Iterator[Segment]:
    for part in segments:
        corner = (
            replace(part.join, stop=True)
            if not isinstance(part, Dwell) and isinstance(part.join, Fit)
            else Stop()
        )
        yield part if isinstance(part, Dwell) else replace(part, join=corner)
