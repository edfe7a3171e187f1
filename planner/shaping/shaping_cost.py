"""What input shapers cost: their length, and the time that limits take of which less is planned
with before them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from kinematics.foundation.facts import Fact
from kinematics.foundation.names import count_noun
from kinematics.foundation.table import Column, Table
from kinematics.foundation.units import floor_percent
from planner.limits.lowered import Shares
from planner.path.actuation import ActuatorPath
from planner.place import Place

SHOWN_STRETCHES = 20
"""Lowered stretches of the path that a table shows, those lowered most."""
COST_DECIMALS = 2
"""Of ms."""


def _describe_covered(share: float) -> str:
    """Two digits of a share of the path, and all of 100."""
    return f"{100 * share:.0f} %" if share >= 0.1 else f"{100 * share:.2g} %"


@dataclass(frozen=True, slots=True)
class LoweredStretch:
    """A stretch of the path on which less of a limit is planned with, so that all of it is kept
    behind the shapers.

    share           of the limit, the least on the stretch
    since, until    its ends;  lowest: where the share is
    """

    limit: Annotated[str, Fact("limit")]
    share: Annotated[float, Fact("share")]
    since: Annotated[Place, Fact("from")]
    until: Annotated[Place, Fact("to")]
    lowest: Place


@dataclass(frozen=True, slots=True)
class ShapingCost:
    """What input shapers cost a motion.

    length       s, by which the shapers are longer than nothing
    unlowered    s, of the motion before the shapers with all of the limits: what the machine takes
                 without shapers
    lowering     s, by which it takes longer as less of the limits is planned with
    path_length  m
    lowered      by limit the shares that were planned with, of those that were lowered
    everywhere   whether they were lowered all along the path, as lowering them in places was not
                 enough
    stretches    where, in the order of the path
    """

    length: float
    unlowered: float
    lowering: float
    path_length: float
    lowered: Mapping[str, Shares] = field(default_factory=dict, repr=False)
    everywhere: bool = False
    stretches: tuple[LoweredStretch, ...] = field(default=(), repr=False)

    @property
    def total(self) -> float:
        """s, by which the machine takes longer than without shapers."""
        return self.length + self.lowering

    def describe(self) -> str:
        """The time in a line, and of what it is."""
        total, length = (round(1e3 * each, COST_DECIMALS) for each in (self.total, self.length))
        told = f"{total:.{COST_DECIMALS}f} ms more than without them"
        if not self.lowered:
            return f"{told}: their length; no limit had to be lowered"
        # the rest of what is shown, so that the parts add up
        rest = total - length
        return f"{told}: {length:.{COST_DECIMALS}f} ms their length, {rest:.{COST_DECIMALS}f} ms lowered limits"

    def describe_lowered(self) -> str:
        """Each limit that was lowered: to what share, and where."""
        told = []
        for name, shares in self.lowered.items():
            least = f"{name} to {floor_percent(shares.least)} %"
            if self.everywhere:
                told.append(f"{least} along the whole path")
                continue
            own = [each for each in self.stretches if each.limit == name]
            worst = min(own, key=lambda each: each.share)
            at = (
                f"segment {worst.lowest.segment}"
                if worst.lowest.segment is not None
                else f"{worst.lowest.s:.6g} m"
            )
            covered = f"{_describe_covered(shares.lowered_length / self.path_length)} of the path"
            more = (
                "" if len(own) == 1 else f", by less in {count_noun(len(own) - 1, 'other place')}"
            )
            told.append(
                f"{least} near {at}{more} ({covered} in all)"
                if more
                else f"{least} near {at} ({covered})"
            )
        return "; ".join(told)

    def tables(self) -> tuple[Table, ...]:
        """The lowered stretches, those lowered most if there are many."""
        shown = sorted(
            sorted(self.stretches, key=lambda each: each.share)[:SHOWN_STRETCHES],
            key=lambda one: one.since.s,
        )
        if not shown:
            return ()
        left = len(self.stretches) - len(shown)
        columns = (
            Column("limit", [each.limit for each in shown]),
            Column(
                "lowered to", [float(floor_percent(each.share)) for each in shown], "%", form=".2f"
            ),
            Column("from segment", [each.since.segment for each in shown]),
            Column("to segment", [each.until.segment for each in shown]),
            Column("from", [each.since.s for each in shown], "m", "human", ".3f"),
            Column("to", [each.until.s for each in shown], "m", "human", ".3f"),
        )
        notes = (f"{left} more, lowered less",) if left else ()
        return (
            Table(
                "limits lowered before the shapers, so that all of them are kept behind",
                columns,
                notes,
            ),
        )


def find_stretches(path: ActuatorPath, lowered: Mapping[str, Shares]) -> tuple[LoweredStretch, ...]:
    """Where limits are lowered: what hangs together is one stretch."""
    found = []
    for name, shares in lowered.items():
        low = np.concatenate([[False], shares.values < 1, [False]])
        begins, stops = np.flatnonzero(low[1:] & ~low[:-1]), np.flatnonzero(low[:-1] & ~low[1:])
        for begin, stop in zip(begins.tolist(), stops.tolist(), strict=True):
            least = begin + int(shares.values[begin:stop].argmin())
            at = (
                shares.ends[begin],
                shares.ends[stop],
                (shares.ends[least] + shares.ends[least + 1]) / 2,
            )
            since, until, lowest = (_find_place(path, float(s)) for s in at)
            found.append(LoweredStretch(name, float(shares.values[least]), since, until, lowest))
    return tuple(sorted(found, key=lambda each: each.since.s))


def _find_place(path: ActuatorPath, s: float) -> Place:
    piece = int(np.clip(np.searchsorted(path.breaks, s, side="right") - 1, 0, len(path.breaks) - 2))
    return path.place(s, piece)
