"""Proof that a motion after input shaping respects every limit, and how far it is from the path.

Limits of one coordinate's value or rate, the same all along (`Limit.convex`): a weighed mean of
motions that keep one keeps it, so the proof of the motion before shaping holds. Every other
limit is bounded over cells of time from the axes' copies and from the pose that the axes reach
(`planner.shaping.shaped_enclosure`). Caps of a segment's tool hold while all copies are on that
segment; while some are on the next, the larger cap of the two does: there the tool rounds the
corner between them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil

import numpy as np

from kinematics.analysis.residual_vibration import find_residuals, tabulate_residuals
from kinematics.foundation.arrays import Array, freeze_fields, largest_in_rows
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from kinematics.machine.axis import Axis
from planner.certificate.cells import Cells, Values, refine
from planner.certificate.certify import Certificate
from planner.certificate.limit_use import LIMIT_ROUNDING, round_reached_use, tabulate_uses
from planner.limits.limit import Limit
from planner.limits.resonance import Resonance
from planner.path.actuation import ActuatorPath, MachinePath
from planner.place import Place
from planner.shaping.shaped_enclosure import ShapedEnclosure, enclose_shaped
from planner.shaping.shaped_motion import ShapedMotion
from planner.shaping.shaping_cost import ShapingCost
from planner.trajectory import Trajectory

OVER = 1e-3
"""How far beyond a limit a bound may stay that slowing down mends: what is planned anew keeps that
much away.
"""
CLOSE, LEAST_CONTOUR = 1.05, 1e-7
"""Times what was met of the distance from the path that its bound may be, and m below which it is
not made closer.
"""
LONGEST_CELL, SHORTEST_CELL = 4e-3, 1e-4
"""s: cells of time that are looked at first, and below which none is cut."""
MOST_CUT = 200_000
"""Largest number of cells into which others are split."""


@dataclass(frozen=True, slots=True)
class ShapedProof(Result):
    """A motion after its axes' shapers, and its proof.

    motion         q_s(t) = Σ Aᵢ q(t − tᵢ)
    worst, where   per limit, the proven bound of value/limit over continuous time, and its place
    convex         names of the limits that follow from those of the motion that is shaped
    deviation      m: of the tool from its place on the path `delay` earlier, also along the path;
                   a proven bound
    contour        m: of the tool from the path, wherever on it; a proven bound, at most `deviation`
    turn           rad: of the platform likewise
    axis_deviation (n,) m or rad: of each axis likewise: ½ Σ Aᵢ (tᵢ − t̄)² · sup |q̈|, or tighter
    since          s of the motion, from which on all this is proved
    excess         per limit that is exceeded, and that timing changes: of N cells of time, from
                   where to where on the path (m) the copies are, and the bound of value/limit there
                   (3, N)
    cost           of the shapers, where the motion was planned behind them
    """

    motion: ShapedMotion = field(repr=False)
    axes: tuple[Axis, ...] = field(repr=False)
    worst: Mapping[str, float]
    where: Mapping[str, Place]
    convex: tuple[str, ...]
    deviation: float
    contour: float
    turn: float
    deviates_at: Place
    contour_at: Place
    axis_deviation: Array
    since: float = 0.0
    excess: Mapping[str, Array] = field(default_factory=dict, repr=False)
    cost: ShapingCost | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        freeze_fields(self, "axis_deviation")

    @property
    def holds(self) -> bool:
        """Whether every limit is kept."""
        return all(use <= 1 for use in self.worst.values())

    @property
    def duration(self) -> float:
        """s, from `since` to rest."""
        return self.motion.duration - self.since

    @property
    def delay(self) -> float:
        """s, by which the shaped motion is behind the one that is shaped."""
        return self.motion.copies.centre

    def describe(self) -> str:
        """Deviation and proof in a line."""
        proved = (
            f"{count_noun(len(self.worst), 'limit')} proved"
            if self.holds
            else "LIMITS ARE NOT KEPT"
        )
        return f"{self.describe_deviation()}, {proved}"

    def describe_deviation(self) -> str:
        """How far the tool is from the path and from its place on it, rounded up."""
        off, away = (ceil(1e9 * each) / 1e3 for each in (self.contour, self.deviation))
        return f"the tool off the path by at most {off:.3f} µm, off its place on it, delayed, by at most {away:.3f} µm"

    def tables(self) -> tuple[Table, ...]:
        """The shaper of each axis and how far it moves the axis; the limits after shaping."""
        names, units = [axis.name for axis in self.axes], [axis.unit for axis in self.axes]
        shapers = [str(axis.shaper or "none") for axis in self.axes]
        title = (
            f"behind its input shapers the motion lasts {self.duration:.6f} s, is {1e3 * self.delay:.3f} ms "
            f"late; {self.describe_deviation()}, proved"
        )
        columns = (
            Column("axis", names),
            Column("shaper", shapers),
            Column("axis off by at most", self.axis_deviation, units, "micro", ".3f", up=True),
        )
        head = "the certificate holds" if self.holds else "THE CERTIFICATE DOES NOT HOLD"
        return (
            Table(title, columns),
            tabulate_residuals(find_residuals(self.axes)),
            *(() if self.cost is None else self.cost.tables()),
            tabulate_uses(f"{head} behind the shapers: value/limit", self.worst, self.where),
        )


def refuse_unshaped(limits: Sequence[Limit], path: ActuatorPath) -> None:
    """Raise MotionError for limits that cannot be proved after input shaping."""
    for limit in limits:
        if isinstance(limit, Resonance) and limit.bands:
            axis = limit.channels[limit.bands[0].axis]
            raise MotionError(
                f"axis {axis}: resonance_time cannot be proved behind an input shaper: the axis stays in a band "
                "longer; remove resonance_time, which keeps the axis below its first band, or the shaper"
            )
    for piece in range(len(path.breaks) - 1):
        if path.constant(piece) is not None:
            raise MotionError(
                f"segment {path.segment(piece)}: a constant tool speed cannot be held behind an input shaper, which "
                "spreads every change of speed; remove speed_constant, or the shapers from the machine's file"
            ).in_segment(path.segment(piece))


def prove_shaped(
    motion: ShapedMotion,
    trajectory: Trajectory,
    axes: Sequence[Axis],
    limits: Sequence[Limit],
    certificate: Certificate,
    since: float = 0.0,
) -> ShapedProof:
    """Prove that a trajectory after input shaping respects its limits, and bound its deviations.

    certificate  of the trajectory itself, of its convex limits at least
    since        s of the shaped motion, from which on it is looked at: the whole of the interval
                 that it is in
    Raises MotionError where the pose that the axes reach is not proved to be near the path, and as
    `refuse_unshaped`.
    """
    refuse_unshaped(limits, trajectory.path)
    convex = [limit for limit in limits if limit.convex]
    others = [limit for limit in limits if not limit.convex]
    worst = {limit.name: certificate.worst[limit.name] for limit in convex}
    where = {limit.name: certificate.where[limit.name] for limit in convex}
    search = _CellSearch(motion, trajectory, others, since, advise_shapers(axes))
    search.run()
    for n, limit in enumerate(others):
        worst[limit.name] = float(search.bound[n])
        where[limit.name] = search.place(search.at[n], limit.channels[search.channel[n]])
    return ShapedProof(
        motion,
        tuple(axes),
        worst,
        where,
        tuple(limit.name for limit in convex),
        search.away.value,
        search.off.value,
        search.turned,
        search.place(search.away.at),
        search.place(search.off.at),
        search.axes,
        since,
        search.excess,
    )


def describe_exceeded(path: MachinePath, proof: ShapedProof) -> str:
    """Return the message where a blend or fit tolerance is not proved after shaping; else ""."""
    left = [(blend.tolerance, blend.deviation) for blend in path.blends if not blend.stop]
    left += [] if path.fit is None else [(path.fit.tolerance, path.fit.deviation)]
    over = [both for both in left if both[1] + proof.contour > both[0]]
    if not over:
        return ""
    tolerance, deviation = max(over, key=lambda both: both[1] - both[0])
    # it is of no use where the shapers alone take the tool farther than the tolerance
    smaller = "ask for a smaller tolerance than you need, " if proof.contour < tolerance else ""
    return (
        f"the blend or fit tolerance of {1e6 * tolerance:g} µm is not proved behind the input shapers: they take "
        f"the tool up to {1e6 * proof.contour:.3f} µm off the path (at {proof.contour_at}), which "
        f"itself uses {1e6 * deviation:.3f} µm; {smaller}"
        f"lower max_acceleration or the speed there, or {advise_shapers(proof.axes)}"
    )


def advise_shapers(axes: Sequence[Axis]) -> str:
    """Return the remedy for shapers that take the tool too far: shorter ones do so less."""
    parts = [part for axis in axes if axis.shaper is not None for part in axis.shaper.parts]
    longer = sorted({part.kind for part in parts if part.kind != "zv"})
    if longer:
        return f"use the shorter shaper zv instead of {', '.join(longer)}"
    return "stiffen the machine (zv is the shortest kind of shaper already; a higher frequency shortens it)"


@dataclass(frozen=True, slots=True)
class _Largest:
    """The largest value over cells, and the instant (s) in the middle of its cell; 0 at 0 without
    any.
    """

    value: float
    at: float

    @staticmethod
    def of(values: Array, middle: Array) -> "_Largest":
        first = int(values.argmax())
        return (
            _Largest(float(values[first]), float(middle[first]))
            if values[first] > 0
            else _Largest(0.0, 0.0)
        )


@dataclass
class _CellSearch:
    """Largest bounds over cells of time, of each limit and of the deviations. Cells are split where
    bounds are loose.
    """

    motion: ShapedMotion
    trajectory: Trajectory
    limits: Sequence[Limit]
    since: float
    advice: str
    bound: Array = field(init=False)
    at: Array = field(init=False)
    channel: np.ndarray = field(init=False)
    away: _Largest = field(init=False)
    off: _Largest = field(init=False)
    turned: float = field(init=False)
    axes: Array = field(init=False)
    excess: dict[str, Array] = field(init=False)

    def run(self) -> None:
        """Bound all cells and fill the results."""
        self.largest_sample = 0.0
        self.split = 0
        cells = self._cut_intervals()
        cells, values = refine(cells, self._bound, self._find_loose)
        uses, channels, away, off, turned, axes = values
        begin = self.motion.knots[cells.k] + cells.lo
        end = self.motion.knots[cells.k] + cells.hi
        middle = (begin + end) / 2
        self._refuse_lost(away, middle)
        first = uses.argmax(1)
        rows = np.arange(len(self.limits))
        self.bound = round_reached_use(uses[rows, first])
        self.at = np.where(self.bound > 0, middle[first], 0.0)
        self.channel = channels[rows, first]
        self.away = _Largest.of(away, middle)
        self.off = _Largest.of(off, middle)
        self.turned = float(turned.max())
        self.axes = axes.max(1)
        self.excess = {}
        for limit, use in zip(self.limits, uses, strict=True):
            above = round_reached_use(use) > 1
            if above.any() and not limit.geometric:
                self.excess[limit.name] = self._find_excess(begin[above], end[above], use[above])

    def _cut_intervals(self) -> Cells:
        """Return the intervals between knots from `since` on, in cells of LONGEST_CELL at most."""
        lengths = np.diff(self.motion.knots)
        needed = self.motion.knots[1:] > self.since
        needed[-1] = True
        parts = np.maximum(np.ceil(lengths / LONGEST_CELL), 1).astype(int) * needed
        k = np.repeat(np.arange(len(lengths)), parts)
        share = (lengths / np.maximum(parts, 1))[k]
        nth = np.arange(len(k)) - np.repeat(np.cumsum(parts) - parts, parts)
        return Cells(k, share * nth, share * (nth + 1))

    def _find_loose(self, cells: Cells, values: Values) -> tuple[np.ndarray, int]:
        uses, _, away, off, *_ = values
        allowed = np.array(
            [[1 + (LIMIT_ROUNDING if limit.geometric else OVER)] for limit in self.limits]
        )
        loose = (uses > allowed.reshape(-1, 1)).any(0) | ~np.isfinite(away)
        loose |= off > max(CLOSE * self.largest_sample, LEAST_CONTOUR)
        loose &= (cells.lengths > SHORTEST_CELL) & (self.split <= MOST_CUT)
        self.split += 2 * int(loose.sum())
        return loose, 2

    def _bound(self, cells: Cells) -> Values:
        """Return bounds of the uses and their channels (limits, N), of the three deviations (N,)
        and of the axes (n, N).
        """
        enclosure = enclose_shaped(self.motion, self.trajectory, cells)
        uses, channels = np.zeros((2, len(self.limits), len(cells.k)))
        for n, limit in enumerate(self.limits):
            uses[n], channels[n] = _bound_use(limit, enclosure)
        away, turned = enclosure.away()
        off, least = enclosure.contour()
        self.largest_sample = max(self.largest_sample, float(np.minimum(least, away).max()))
        moved = np.maximum(*np.abs(enclosure.bound(enclosure.apart))).T
        return (
            np.where(np.isnan(uses), np.inf, uses),
            channels.astype(int),
            away,
            np.minimum(off, away),
            turned,
            moved,
        )

    def _refuse_lost(self, away: Array, middle: Array) -> None:
        """Raise MotionError where the pose that the axes reach is not proved to be near the
        path.
        """
        lost = ~np.isfinite(away)
        if lost.any():
            place = self.place(float(middle[int(np.argmax(lost))]))
            raise MotionError(
                f"behind its input shapers the machine is not proved to stay near the path at {place}: it is "
                "too near to a singularity there, or the shapers are too long; keep away from it, or "
                f"{self.advice}"
            ).in_segment(place.segment)

    def _find_excess(self, begin: Array, end: Array, use: Array) -> Array:
        """Return where on the path the copies are while a limit is exceeded, from and to, and its
        use (3, N).
        """
        copies = self.motion.copies
        span = begin - copies.delays[-1], end - copies.delays[0]
        first, last = (
            self.trajectory.at(np.clip(t, 0.0, self.trajectory.duration)).s for t in span
        )
        return np.stack([first, last, use])

    def place(self, t: float, axis: str = "") -> Place:
        """Return where the path is `centre` before t; its time is that of the shaped motion."""
        state = self.trajectory.at(
            np.clip(t - self.motion.copies.centre, 0.0, self.trajectory.duration)
        )
        path = self.trajectory.path
        assert isinstance(path, MachinePath)
        return path.place(float(state.s[0]), int(state.piece[0]), float(t), axis)


def _bound_use(limit: Limit, enclosure: ShapedEnclosure) -> tuple[Array, np.ndarray]:
    """Return the share (N,) of a limit that is used, and the channel. Of caps on several segments
    the largest counts.
    """
    low, high = enclosure.bound(limit.value(enclosure))
    uses = [limit.use(low, high, piece) for piece in enclosure.pieces]
    use = np.min([largest_in_rows(each) for each in uses], axis=0)
    return np.asarray(use), np.min(uses, axis=0).argmax(1)
