"""A section of a plan's path with a motion of its own: certified, with pulses that go on with those before it."""

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
from planner.interruption.instant import SAME_PLACE
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
    """A place (m) of a part of a path of that length; the end of a piece where that is nearer than rounding."""
    near = float(breaks[np.argmin(np.abs(breaks - place))])
    return near if abs(near - place) <= SAME_PLACE * length else place


@dataclass(frozen=True, slots=True)
class Whole:
    """What a section is one of: a plan's name, machine, path, motion, proof, pulses, order, tool, own limits, triggers.

    fastest: whether its motion is, and not one of a stated duration or with the least of another objective
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
        """s, behind any input shapers."""
        return self.trajectory.duration + shaper_length(self.machine.axes)

    def limits(self, path: MachinePath) -> tuple[Limit, ...]:
        """Those of a part of the path, with pulse rates that the plan's clock and rule can hold."""
        rule = find_rule(self.pulses.rule)
        paced = pace_axes(self.machine.axes, self.pulses.clock_hz, rule)
        return limits_of(path, paced, self.order, self.own_limits)

    def draw(
        self,
        since: float,
        until: float,
        speed: float = 0.0,
        acceleration: float = 0.0,
        time: float = 0.0,
        near: np.ndarray | None = None,
        ends: tuple[float, float] = (0.0, 0.0),
        rests: float | None = None,
        last_dwell: bool = True,
    ) -> MachinePath:
        """The path between two lengths of it, begun with ṡ and s̈ and ended with those of `ends`: no speed of it is to
        be constant.

        One that begins in motion is left at once where it ends; else it has the dwells that the program states there.
        rests: s of the first that are left; last_dwell: whether the last is one of it.
        """
        path, length = self.path, float(self.path.breaks[-1])
        until = snap(path.breaks, until, length)
        since = snap(path.breaks, since, length) if speed == 0 else since  # in motion it may be so near to a rest
        first = int(np.clip(np.searchsorted(path.breaks, since, "right") - 1, 0, len(path.pieces) - 1))
        last = int(np.clip(np.searchsorted(path.breaks, until, "left") - 1, first, len(path.pieces) - 1))
        pieces = [replace(piece, constant=False) for piece in path.pieces[first : last + 1]]
        stops, dwells = (
            np.array(path.joins[first : last + 2]),
            np.array(path.dwells[first : last + 2]),
        )
        after, before = path.breaks[last + 1] - until, since - path.breaks[first]
        if before > 0 or speed > 0:
            dwells[0] = 0.0
        elif rests is not None:
            dwells[0] = rests
        if after > 0 or speed > 0 or not last_dwell:
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
            end_speeds=(speed, ends[0]),
            end_accelerations=(acceleration, ends[1]),
            near=near,
            origin=(since, time),
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
    """Pulses (n,) that were sent before a section, and where its axes (n,) stand in their plays; empty: none.

    left: the triggers of the plan that were not fired
    """

    pulses: tuple[SentPulses, ...] = ()
    plays: tuple[Play, ...] = ()
    left: tuple[Triggered, ...] = ()

    @classmethod
    def before(cls, whole: Whole, since: float) -> "Sent":
        """Before a motion that begins at rest, at a place (m), with the whole of a dwell there."""
        rounding = SAME_PLACE * float(whole.path.breaks[-1])

        def is_left(event: Triggered) -> bool:
            way = event.where.s - since
            return since == 0 or way > rounding or (event.before is not None and way >= -rounding)

        return cls(left=tuple(filter(is_left, whole.triggers)))


NONE_SENT = Sent()


@dataclass(frozen=True, slots=True)
class Section(Result):
    """A motion along a section of a plan's path, whose pulses go on with those that were sent before it.

    what        it is, in a few words
    since       m of the plan's path, where it begins
    at          s of the motion that it goes on with, at which it begins; None where that is none
    plan        the motion of the plan that it is a section of
    sent        before it, where it goes on behind other pulses
    limits      those that are proved, without constant speeds that segments ask for
    shaped      behind input shapers, and its proof; trajectory and certificate are those before them
    """

    what: str
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
        """s, behind the shapers if there are any."""
        return self.trajectory.duration if self.shaped is None else self.shaped.duration

    @property
    def distance(self) -> float:
        """m along the path to rest; behind shapers as `measure_way` has it."""
        return measure_way(self.path, self.shaped)

    @property
    def triggers(self) -> tuple[Triggered, ...]:
        """Of the plan's triggers those that it comes by, with times and counts of its own."""
        return tuple(found for found in map(self.fire, self.sent.left) if found is not None)

    def fire(self, event: Triggered) -> Triggered | None:
        """A trigger of the plan, as it comes by it; None where it ends before."""
        motion = self.trajectory if self.shaped is None else self.shaped.motion.base
        assert isinstance(motion, Trajectory)  # motions of machines are
        assert isinstance(motion.path, MachinePath)
        whole = motion.path if self.plan is None else self.plan.path  # whose places these are, to its rounding
        along = max(event.where.s - motion.path.origin[0], 0.0)
        s = snap(motion.path.breaks, along, float(whole.breaks[-1]))
        if s > motion.path.breaks[-1]:
            return None
        last = event.where.s >= float(whole.breaks[-1])
        t, late = find_passing(motion, s, *find_delays(self.machine.axes), event.before, last=last)
        if t == np.inf:  # it rests there to its end
            return None
        passed = max(t + late - (0.0 if self.shaped is None else self.shaped.since), 0.0)
        return replace(event, where=replace(event.where, t=passed), counts=self.pulses.counts(passed)[0])

    @property
    def until(self) -> float:
        """m of the plan's path, where it ends, at rest."""
        return self.since + float(self.path.breaks[-1])

    @check_arguments()
    def export(self, format: str, path: str | PathLike[str], *, force: bool = False, **options: Any) -> Exported:
        """Write it in an export format, as `planner.Plan.export` writes a plan."""
        return write_export(self.export_source, format, path, force, options)

    @property
    def export_source(self) -> ExportSource:
        """The motion and the pulses for an export format."""
        return ExportSource(
            f"{self.name}-{self.what}",
            self.machine,
            self.trajectory,
            self.pulses,
            made=self.counted,
            since=self.at,
            sent=self.sent.pulses,
            triggers=self.triggers,
        )

    def tables(self) -> tuple[Table, ...]:
        """How long it takes and how far it goes; what is proved of it."""
        what = Column("what", ["duration", "distance along the path"])
        values = Column("value", [f"{self.duration:.6f} s", f"{1e3 * self.distance:.3f} mm"])
        begin = "" if self.at is None else f" from {self.at:.6f} s on"
        behind = () if self.shaped is None else self.shaped.tables()
        fired = trigger_tables(self.triggers, self.path.names)
        times = (
            () if self.at is None else ("below, certificates count t from the start of the plan; triggers from here",)
        )
        own = Table(f"{self.what} of {self.name}{begin}", (what, values), times)
        return (own, *self.certificate.tables(), *behind, *fired)


def measure_way(path: MachinePath, shaped: ShapedProof | None) -> float:
    """m along the path to its end; behind shapers from where the motion before them was their whole length earlier.

    All copies have passed that place, so each axis has at most the rest of its way before it.
    """
    if shaped is None:
        return float(path.breaks[-1])
    begin, end = shaped.motion.base.at(np.array([0.0, shaped.motion.base.duration])).s
    return float(end - begin)


def make_section(
    whole: Whole,
    what: str,
    proved: ProvedMotion,
    sent: Sent = NONE_SENT,
    at: float | None = None,
) -> Section:
    """Make a section with pulses that continue those sent before it.

    Raises MotionError where counts differ by more than pulses are moved, Infeasible for a limit that is not kept after
    shaping.
    """
    axes, home, pulses = whole.machine.axes, whole.machine.home_q, whole.pulses
    moves: AxesMotion = proved.trajectory
    standing = proved.duration == 0
    if standing:  # for one tick of the rule, in which a pulse that is due can fall
        tick = find_rule(pulses.rule).grain(pulses.clock_hz) / pulses.clock_hz
        moves = replace(proved.trajectory, knots=np.array([0.0, tick]))
        axes = tuple(replace(axis, shaper=None) for axis in axes)
    shaped = proved.shaped
    if shaped is not None:
        refuse_unkept(proved.limits, shaped)
        moves = shaped.motion
        if shaped.since > 0:
            moves = JoinedMotion.of(MotionSpan(moves, shaped.since, moves.duration))
        axes = tuple(replace(axis, shaper=None) for axis in axes)  # it is shaped
    counted = counted_motion(moves, axes, home, sent.plays)
    fire = partial(generate, counted, axes, home, pulses.clock_hz, pulses.rule)
    fired = replace(_fire_standing(fire, sent), duration=0.0) if standing else fire(sent=sent.pulses)
    return Section(
        what=what,
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


def _fire_standing(fire: Callable[..., PulseSchedule], sent: Sent) -> PulseSchedule:
    """Return the pulses of axes that stand: none, but for the last one of their way there if it has not been sent.

    A rule that lags by more is left where it is: the bound says by how much.
    """
    standing = fire()
    if not sent.pulses:
        return standing
    missing = [axis.start - one.count for axis, one in zip(standing.axes, sent.pulses, strict=True)]
    if max(map(abs, missing)) <= 1:
        return fire(sent=sent.pulses)
    axes = (
        replace(axis, start=one.count, bound=axis.bound + abs(pulses))
        for axis, one, pulses in zip(standing.axes, sent.pulses, missing, strict=True)
    )
    return replace(standing, axes=tuple(axes))


def refuse_other(whole: Whole, section: Section) -> None:
    """Raise MotionError for a section of another plan."""
    own, other = whole.trajectory, section.plan
    if other is own:
        return
    if other is None or not all(
        np.array_equal(getattr(own, name), getattr(other, name)) for name in ("knots", "s", "v", "a", "j")
    ):
        raise MotionError(
            f"the {section.what} of {section.name} is not of this plan: give a section that its own hold or resume made"
        )
