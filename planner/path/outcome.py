"""What became of a program's joins: blends, and curves that were fitted; as values, and as
tables.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from kinematics.foundation.facts import Fact, tabulate
from kinematics.foundation.names import count_noun
from kinematics.foundation.table import Column, Table
from planner.path.shape import Fitted
from planner.place import Place

# Stops at blends up to which each is described with its reason.
MOST_REASONS = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Blended:
    """What a join that asks for a blend became.

    segment     number of the one before it; the blend leads to the next that moves
    tolerance   m, and angle (rad): what it may leave the unblended path by
    deviation   m, and turned (rad): by how much it does, at most (see planner.path.join_and_blend)
    reach       m of each segment that it takes the place of
    half_of     the segments of which it takes half, or all that can be had, though the tolerance
                would allow more
    stop        why the motion rests there instead, or ""
    fitted      whether it is a corner that a fit kept: what it leaves is proved then
    s           m of the path, in its middle
    """

    segment: Annotated[int, Fact("segment", "after segment")]
    tolerance: Annotated[float, Fact("tolerance_m", "tolerance", "m", "micro", ".4g")]
    deviation: Annotated[float, Fact("deviation_m", "deviation", "m", "micro", ".4g")] = 0.0
    angle: Annotated[float, Fact("tolerance_rad")]
    turned: Annotated[float, Fact("deviation_rad", "angle", "rad", "micro", ".4g")] = 0.0
    reach: Annotated[float, Fact("reach_m", "reach", "m", "human", ".4g")] = 0.0
    half_of: Annotated[tuple[int, ...], Fact("half_of_segments")] = ()
    stop: Annotated[str, Fact("stop", null="")] = ""
    fitted: bool = False
    s: float = 0.0

    @property
    def tolerance_use(self) -> float:
        """The share of the tolerance that it uses."""
        return max(self.deviation / self.tolerance, self.turned / self.angle)


def blend_tables(blends: Sequence[Blended]) -> tuple[Table, ...]:
    """Return a table of the deviation of each blend from its corner and of its limit, if there are
    any.
    """
    return tabulate("blends", blends, Column("note", [_note(blend) for blend in blends]))


def describe_blends(blends: Sequence[Blended]) -> str:
    """Return the number of blends, and of those replaced by stops, a few with reasons; "" without
    blends.
    """
    if not blends:
        return ""
    stops = [f"after segment {blend.segment}: {blend.stop}" for blend in blends if blend.stop]
    text = f"{len(stops)} of them replaced by stops" if stops else "all passed without a stop"
    reasons = f" ({'; '.join(stops)})" if 0 < len(stops) <= MOST_REASONS else ""
    return f"{len(blends)}, {text}{reasons}"


def _note(blend: Blended) -> str:
    if blend.stop:
        return f"stops: {blend.stop}"
    return f"half of segment {' and '.join(map(str, blend.half_of))}" if blend.half_of else ""


@dataclass(frozen=True, slots=True)
class FitSummary:
    """What fitting did to a path: pieces that curves took the place of, and theirs; corners that
    stay.

    tolerance, deviation  m, the widest and the largest that is proved, corners included; turned:
                          rad
    rounded, stopped      corners at which the motion passes, and at which it rests
    deviates_at           where the deviation is the largest: in the middle of a corner, or of the
                          part of a curve
    """

    curves: Annotated[int, Fact("curves", "curves")]
    before: Annotated[int, Fact("pieces_before", "pieces before")]
    after: Annotated[int, Fact("pieces_after", "pieces after")]
    tolerance: Annotated[float, Fact("tolerance_m", "tolerance", "m", "micro", ".4g")]
    deviation: Annotated[float, Fact("deviation_m", "deviation", "m", "micro", ".4g")]
    turned: Annotated[float, Fact("deviation_rad", "angle", "rad", "micro", ".4g")]
    deviates_at: Annotated[Place, Fact("deviates_at")]
    rounded: Annotated[int, Fact("corners_rounded", "corners rounded")]
    stopped: Annotated[int, Fact("corners_stopped", "corners with a stop")]

    def describe(self) -> str:
        """How near to the program it is, where it is farthest from it, and what became of its
        corners.
        """
        at = self.deviates_at
        corners = f"{count_noun(self.rounded, 'corner')} rounded, {self.stopped} with a stop"
        near = f"within {1e6 * self.deviation:.4g} µm of the program (proved; tolerance {1e6 * self.tolerance:.4g} µm)"
        worst = f"farthest at {1e3 * at.s:.3f} mm, segment {at.segment}"
        curves = count_noun(self.curves, "curve")
        made = (
            f"{count_noun(self.before, 'piece')} became {self.after} in {curves}, "
            if self.before
            else ""
        )
        return f"{made}{near}, {worst}; {corners}"


def summarise_fits(fits: Sequence[Fitted], blends: Sequence[Blended]) -> FitSummary | None:
    """Of a path's curves, and of the corners between them; None where nothing was fitted."""
    corners = [blend for blend in blends if blend.fitted]
    every: list[Fitted | Blended] = [*fits, *corners]
    if not every:
        return None
    worst = max(every, key=lambda one: one.deviation)
    return FitSummary(
        curves=len(fits),
        before=sum(one.before for one in fits),
        after=sum(one.after for one in fits),
        tolerance=max(one.tolerance for one in every),
        deviation=worst.deviation,
        turned=max(one.turned for one in every),
        rounded=sum(not corner.stop for corner in corners),
        stopped=sum(bool(corner.stop) for corner in corners),
        deviates_at=Place(worst.s, worst.segment),
    )


def merge_fits(one: FitSummary | None, other: FitSummary | None) -> FitSummary | None:
    """Of two parts of a path, what fitting did to both."""
    if one is None or other is None:
        return other if one is None else one
    return FitSummary(
        curves=one.curves + other.curves,
        before=one.before + other.before,
        after=one.after + other.after,
        tolerance=max(one.tolerance, other.tolerance),
        deviation=max(one.deviation, other.deviation),
        turned=max(one.turned, other.turned),
        rounded=one.rounded + other.rounded,
        stopped=one.stopped + other.stopped,
        deviates_at=max(one, other, key=lambda each: each.deviation).deviates_at,
    )


def fit_tables(fit: FitSummary | None) -> tuple[Table, ...]:
    """Return a table of the fit, if anything was fitted."""
    return tabulate("fit", [] if fit is None else [fit])
