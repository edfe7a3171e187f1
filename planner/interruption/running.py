"""The motion that the machine runs, and the pulses sent before an instant."""

from dataclasses import dataclass, replace

from kinematics.machine.machine import Machine
from planner.certificate.certify import Certificate
from planner.interruption.instant import find_piece, shift_motion
from planner.interruption.section import NONE_SENT, Section, Sent, Whole, refuse_other
from planner.path.actuation import MachinePath
from planner.pulses import AxesMotion, PulseSchedule, find_rule
from planner.pulses.compensation.compensate import CompensatedMotion, counted_motion, find_plays
from planner.pulses.compensation.play import Play
from planner.pulses.generation.sent import find_sent
from planner.pulses.triggers import Triggered
from planner.trajectory import Trajectory

# Ticks by which an instant may be off.
TICK_ROUNDING = 1e-3


@dataclass(frozen=True, slots=True)
class Running:
    """The motion that the machine runs: a plan or one of its sections.

    trajectory  before any input shapers, with path lengths and pieces of the plan
    since       s of the trajectory at which time begins: a shaped section has a motion before it
    duration    s from there on, after shaping
    counted     motion that the pulses count
    passages    triggers not fired before, and when (s) the motion passes each; None: never
    sent        pulses and plays before it
    """

    trajectory: Trajectory
    certificate: Certificate
    pulses: PulseSchedule
    machine: Machine
    since: float
    duration: float
    counted: AxesMotion
    passages: tuple[tuple[Triggered, float | None], ...]
    sent: Sent = NONE_SENT

    def round_to_tick(self, at: float) -> tuple[float, Sent]:
        """Return the nearest instant (s) at which the rule can begin, and the state before it."""
        clock = self.pulses.clock_hz
        rule = find_rule(self.pulses.rule)
        # a section of a rule that needs the whole motion begins anew, by its own clock
        grain = 1 if rule.whole_reason else rule.grain(clock)
        nearest = round(at * clock / grain)
        last = int(self.duration * clock / grain)
        tick = grain * min(nearest, last)
        return tick / clock, self.find_sent(tick)

    def find_sent(self, tick: int | None = None) -> Sent:
        """Return the state before a tick; None: at the end. Raises as `find_plays`."""
        clock = self.pulses.clock_hz
        if tick is None:
            tick = round(self.duration * clock) + 1
        plays: tuple[Play, ...] = ()
        if isinstance(self.counted, CompensatedMotion):
            at = min(tick / clock, self.counted.duration)
            plays = find_plays(self.counted, self.machine.axes, at)
        first = tick - TICK_ROUNDING
        left = tuple(event for event, t in self.passages if t is None or t * clock >= first)
        return Sent(find_sent(self.pulses, tick, self.sent.pulses), plays, left)


def find_running(whole: Whole, section: Section | None = None) -> Running:
    """Return the motion of a plan, or of a section. Raises MotionError for another plan's."""
    return _run_plan(whole) if section is None else _run_section(whole, section)


def _run_plan(whole: Whole) -> Running:
    """Return the motion of a plan."""
    machine = whole.machine
    return Running(
        trajectory=whole.trajectory,
        certificate=whole.certificate,
        pulses=whole.pulses,
        machine=machine,
        since=0.0,
        duration=whole.duration,
        counted=counted_motion(whole.trajectory, machine.axes, machine.home_q),
        passages=tuple((event, event.time) for event in whole.triggers),
    )


def _run_section(whole: Whole, section: Section) -> Running:
    """Return the motion of a section, with path lengths and pieces of the plan."""
    refuse_other(whole, section)
    shaped = section.shaped
    base = section.trajectory if shaped is None else shaped.motion.base
    assert isinstance(base, Trajectory)  # motions of machines are
    assert isinstance(base.path, MachinePath)
    begin = base.path.origin[0]
    piece = min(
        find_piece(whole.path, begin),
        len(whole.path.pieces) - 1,
    )  # an empty stop may be at the end

    passages: list[tuple[Triggered, float | None]] = []
    for event in section.sent.left:
        fired = section.fire(event)
        passages.append((event, None if fired is None else fired.time))

    return Running(
        trajectory=replace(shift_motion(base, begin, piece), path=whole.path),
        certificate=section.certificate,
        pulses=section.pulses,
        machine=section.machine,
        since=0.0 if shaped is None else shaped.since,
        duration=section.duration,
        counted=section.counted,
        passages=tuple(passages),
        sent=section.sent,
    )
