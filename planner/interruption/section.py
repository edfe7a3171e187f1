"""A section of a plan's path with its own certified motion and pulses."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from os import PathLike
from typing import Any

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.options import check_arguments
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from kinematics.machine.machine import Machine
from kinematics.machine.pose import Pose
from planner.certificate.certify import Certificate
from planner.export.format import Exported, ExportSource, write_export
from planner.interruption.instant import SAME_PLACE, Instant
from planner.limits import Limit, OwnLimit, limits_of
from planner.path.actuation import MachinePath
from planner.pulses import AxesMotion, PulseSchedule, find_rule, generate, pace_axes
from planner.pulses.compensation.compensate import counted_motion
from planner.pulses.compensation.play import Play
from planner.pulses.generation.motion_parts import JoinedMotion, MotionSpan
from planner.pulses.generation.sent import SentPulses
from planner.pulses.triggers import Triggered, find_passing, trigger_tables
from planner.shaping.keep_limits import refuse_unkept
from planner.shaping.shaped_motion import find_delays, shaper_length
from planner.shaping.shaped_proof import ShapedProof
from planner.trajectory import Trajectory


def snap(breaks: Array, place: float, length: float) -> float:
    """Return the end of a path piece if a place (m) is there to rounding, else the place.

    length: of the whole path, whose rounding counts.
    """
    near = float(breaks[np.argmin(np.abs(breaks - place))])
    return near if abs(near - place) <= SAME_PLACE * length else place


@dataclass(frozen=True, slots=True)
class Whole:
    """The parts of a plan that its sections are made from.

    trajectory  before any input shapers
    fastest     True if the motion is the fastest, not one of a stated duration or another objective
    """

    name: str
    machine: Machine
    path: MachinePath
    trajectory: Trajectory
    certificate: Certificate
    pulses: PulseSchedule
    order: int
    tool: Pose | None
    own_limits: tuple[OwnLimit, ...] = ()
    fastest: bool = True
    triggers: tuple[Triggered, ...] = ()

    @property
    def duration(self) -> float:
        """Duration (s), after any input shaping."""
        return self.trajectory.duration + shaper_length(self.machine.axes)

    def limits(self, path: MachinePath) -> tuple[Limit, ...]:
        """Return the limits of a part of the path, with pulse rates of the plan's clock and
        rule.
        """
        rule = find_rule(self.pulses.rule)
        paced = pace_axes(self.machine.axes, self.pulses.clock_hz, rule)
        return limits_of(path, paced, self.order, self.own_limits)

    def draw(
        self,
        now: Instant,
        until: float,
        ends: tuple[float, float] = (0.0, 0.0),
        rests: float | None = None,
        last_dwell: bool = True,
    ) -> MachinePath:
        """Return the part of the path from the state at an instant to a place (m).

        A part that begins in motion has no dwells at its ends. One that begins at rest has those of
        the program. The part need not keep the constant speeds that segments require. Its
        certificate counts time from the instant.

        ends        ṡ and s̈ at the end
        rests       s for which the first dwell still lasts; None: its full time
        last_dwell  False leaves the last dwell out
        """
        path = self.path
        length = float(path.breaks[-1])
        until = snap(path.breaks, until, length)
        since = now.s
        if now.v == 0:  # a motion may begin nearer to a rest than rounding, and keeps its place
            since = snap(path.breaks, since, length)
        first = int(np.searchsorted(path.breaks, since, "right")) - 1
        first = int(np.clip(first, 0, len(path.pieces) - 1))
        last = int(np.searchsorted(path.breaks, until, "left")) - 1
        last = int(np.clip(last, first, len(path.pieces) - 1))

        pieces = [replace(piece, constant=False) for piece in path.pieces[first : last + 1]]
        stops = np.array(path.joins[first : last + 2])
        dwells = np.array(path.dwells[first : last + 2])
        before = since - path.breaks[first]
        after = path.breaks[last + 1] - until
        if before > 0 or now.v > 0:
            dwells[0] = 0.0
        elif rests is not None:
            dwells[0] = rests
        if after > 0 or now.v > 0 or not last_dwell:
            dwells[-1] = 0.0
        pieces[-1] = pieces[-1].trim(0.0, after)
        pieces[0] = pieces[0].trim(before, 0.0)
        stops[[0, -1]] = 1
        return MachinePath(
            self.machine,
            pieces,
            stops,
            dwells,
            tool=self.tool,
            end_speeds=(now.v, ends[0]),
            end_accelerations=(now.a, ends[1]),
            near=now.q,
            origin=(since, now.t),
        )


@dataclass(frozen=True, slots=True)
class ProvedMotion:
    """A motion along a part of a plan's path, with its limits and its proof.

    since   m of the plan's path, where it begins
    shaped  motion and proof after input shaping; None without shapers
    """

    path: MachinePath
    limits: tuple[Limit, ...]
    trajectory: Trajectory
    certificate: Certificate
    since: float
    shaped: ShapedProof | None = None

    @property
    def duration(self) -> float:
        """Duration (s), after shaping."""
        return self.trajectory.duration if self.shaped is None else self.shaped.duration


@dataclass(frozen=True, slots=True)
class Sent:
    """The state that a section begins with.

    pulses  count and last pulse of each axis (n,); empty: none were sent
    plays   position of each axis (n,) in its play
    left    triggers of the plan that were not fired yet
    """

    pulses: tuple[SentPulses, ...] = ()
    plays: tuple[Play, ...] = ()
    left: tuple[Triggered, ...] = ()

    @classmethod
    def before(cls, whole: Whole, since: float) -> "Sent":
        """Return the state before a motion from rest at a place (m), with the whole dwell there."""
        rounding = SAME_PLACE * float(whole.path.breaks[-1])

        def is_left(event: Triggered) -> bool:
            distance = event.where.s - since
            after_dwell = event.before is not None and distance >= -rounding
            return since == 0 or distance > rounding or after_dwell

        return cls(left=tuple(event for event in whole.triggers if is_left(event)))


NONE_SENT = Sent()


@dataclass(frozen=True, slots=True)
class Section(Result):
    """A motion along a section of a plan's path, whose pulses continue those sent before it.

    kind        "hold" or "resume"
    limits      limits that are proved: all but constant speeds that segments require
    trajectory  motion before any input shapers; certificate is its proof
    since       m of the plan's path at which it begins
    at          s of the motion before it at which it begins; None where it begins at rest
    shaped      motion after input shaping, and its proof; None without shapers
    plan        motion of the plan
    sent        pulses, plays and triggers before it
    """

    kind: str
    name: str
    machine: Machine = field(repr=False)
    path: MachinePath = field(repr=False)
    limits: tuple[Limit, ...] = field(repr=False)
    trajectory: Trajectory = field(repr=False)
    certificate: Certificate
    counted: AxesMotion = field(repr=False)
    pulses: PulseSchedule = field(repr=False)
    since: float
    at: float | None = None
    shaped: ShapedProof | None = field(default=None, repr=False)
    plan: Trajectory | None = field(default=None, repr=False)
    sent: Sent = field(default=NONE_SENT, repr=False)

    @property
    def duration(self) -> float:
        """Duration (s), after any input shaping."""
        return self.trajectory.duration if self.shaped is None else self.shaped.duration

    @property
    def distance(self) -> float:
        """Distance (m) along the path to rest; after shaping as in `measure_way`."""
        return measure_way(self.path, self.shaped)

    @property
    def triggers(self) -> tuple[Triggered, ...]:
        """Triggers of the plan that the section passes, at its own times and counts."""
        fired = (self.fire(event) for event in self.sent.left)
        return tuple(event for event in fired if event is not None)

    def fire(self, event: Triggered) -> Triggered | None:
        """Return a trigger of the plan at the section's time and counts; None: never passed."""
        motion = self.trajectory if self.shaped is None else self.shaped.motion.base
        assert isinstance(motion, Trajectory)  # motions of machines are
        assert isinstance(motion.path, MachinePath)
        whole = motion.path if self.plan is None else self.plan.path
        length = float(whole.breaks[-1])
        along = max(event.where.s - motion.path.origin[0], 0.0)
        s = snap(motion.path.breaks, along, length)
        if s > motion.path.breaks[-1]:
            return None
        delays = find_delays(self.machine.axes)
        t, late = find_passing(motion, s, *delays, event.before, last=event.where.s >= length)
        if t == np.inf:  # the section rests there to its end
            return None
        since = 0.0 if self.shaped is None else self.shaped.since
        passed = max(t + late - since, 0.0)
        where = replace(event.where, t=passed)
        return replace(event, where=where, counts=self.pulses.counts(passed)[0])

    @property
    def until(self) -> float:
        """Place (m of the plan's path) at which it ends, at rest."""
        return self.since + float(self.path.breaks[-1])

    @check_arguments()
    def export(
        self,
        format: str,
        path: str | PathLike[str],
        *,
        force: bool = False,
        **options: Any,
    ) -> Exported:
        """Write the section in an export format, as `planner.Plan.export` writes a plan."""
        return write_export(self.export_source, format, path, force, options)

    @property
    def export_source(self) -> ExportSource:
        """The motion and the pulses for an export format."""
        return ExportSource(
            f"{self.name}-{self.kind}",
            self.machine,
            self.trajectory,
            self.pulses,
            made=self.counted,
            since=self.at,
            sent=self.sent.pulses,
            triggers=self.triggers,
        )

    def tables(self) -> tuple[Table, ...]:
        """Return duration, distance and certificate."""
        values = [f"{self.duration:.6f} s", f"{1e3 * self.distance:.3f} mm"]
        columns = (
            Column("what", ["duration", "distance along the path"]),
            Column("value", values),
        )
        begin = "" if self.at is None else f" from {self.at:.6f} s on"
        notes: tuple[str, ...] = ()
        if self.at is not None:
            notes = ("below, certificates count t from the start of the plan; triggers from here",)
        table = Table(f"{self.kind} of {self.name}{begin}", columns, notes)
        shaped = () if self.shaped is None else self.shaped.tables()
        fired = trigger_tables(self.triggers, self.path.names)
        return (table, *self.certificate.tables(), *shaped, *fired)


def measure_way(path: MachinePath, shaped: ShapedProof | None) -> float:
    """Return the distance (m) along the path to its end.

    After shaping it counts from where the motion before the shapers was one shaper length earlier:
    every copy has passed that place.
    """
    if shaped is None:
        return float(path.breaks[-1])
    begin, end = shaped.motion.base.at(np.array([0.0, shaped.motion.base.duration])).s
    return float(end - begin)


def make_section(
    whole: Whole,
    kind: str,
    proved: ProvedMotion,
    sent: Sent = NONE_SENT,
    at: float | None = None,
) -> Section:
    """Make a section with pulses that continue those sent before it.

    Raises MotionError where counts differ by more than pulses are moved, Infeasible for a limit
    that is not kept after shaping.
    """
    axes = whole.machine.axes
    home = whole.machine.home_q
    pulses = whole.pulses
    moves: AxesMotion = proved.trajectory
    is_empty = proved.duration == 0
    if is_empty:  # it lasts one tick of the rule, in which a pulse that is due can fall
        tick = find_rule(pulses.rule).grain(pulses.clock_hz) / pulses.clock_hz
        moves = replace(proved.trajectory, knots=np.array([0.0, tick]))
        axes = tuple(replace(axis, shaper=None) for axis in axes)
    shaped = proved.shaped
    if shaped is not None:
        refuse_unkept(proved.limits, shaped)
        moves = shaped.motion
        if shaped.since > 0:
            moves = JoinedMotion.of(MotionSpan(moves, shaped.since, moves.duration))
        axes = tuple(replace(axis, shaper=None) for axis in axes)  # the motion is shaped already
    counted = counted_motion(moves, axes, home, sent.plays)
    fire = partial(generate, counted, axes, home, pulses.clock_hz, pulses.rule)
    fired = _fire_at_rest(fire, sent) if is_empty else fire(sent=sent.pulses)
    return Section(
        kind=kind,
        name=whole.name,
        machine=whole.machine,
        path=proved.path,
        limits=proved.limits,
        trajectory=proved.trajectory,
        certificate=proved.certificate,
        counted=counted,
        pulses=fired,
        since=proved.since,
        at=at,
        shaped=shaped,
        plan=whole.trajectory,
        sent=sent,
    )


def _fire_at_rest(fire: Callable[..., PulseSchedule], sent: Sent) -> PulseSchedule:
    """Return the pulses of axes at rest: none, except the last one of the way there if it is due.

    Counts of a rule that lags by more stay where they are: the bound says by how much.
    """
    at_rest = replace(fire(), duration=0.0)
    if not sent.pulses:
        return at_rest
    pairs = list(zip(at_rest.axes, sent.pulses, strict=True))
    if all(abs(axis.start - last.count) <= 1 for axis, last in pairs):
        return replace(fire(sent=sent.pulses), duration=0.0)
    axes = []
    for axis, last in pairs:
        bound = axis.bound + abs(axis.start - last.count)
        axes.append(replace(axis, start=last.count, bound=bound))
    return replace(at_rest, axes=tuple(axes))


def refuse_other(whole: Whole, section: Section) -> None:
    """Raise MotionError for a section of another plan."""
    plan = whole.trajectory
    other = section.plan
    if other is plan:
        return

    def is_equal(name: str) -> bool:
        return np.array_equal(getattr(plan, name), getattr(other, name))

    # a plan that was loaded twice has equal arrays
    if other is None or not all(map(is_equal, ("knots", "s", "v", "a", "j"))):
        raise MotionError(
            f"the {section.kind} of {section.name} is not of this plan: give a section that its own hold or resume made"
        )
