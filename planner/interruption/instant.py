"""A motion along a plan's path and its state at an instant: where it rests, where it is by a place, parts of it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.machine.axis import Axis, directional_bounds
from kinematics.machine.machine import Machine
from planner.certificate.certify import Certificate
from planner.interruption.section import NONE_SENT, SAME_PLACE, Section, Sent, Whole, refuse_other
from planner.path.actuation import MachinePath
from planner.pulses import AxesMotion, PulseSchedule, find_rule
from planner.pulses.compensation.compensate import CompensatedMotion, counted_motion, find_plays
from planner.pulses.compensation.play import Play
from planner.pulses.generation.sent import find_sent
from planner.pulses.triggers import Triggered
from planner.trajectory import Trajectory

# Share of the largest ṡ up to which a motion rests at a knot, and up to which nothing moves.
REST_SHARE, RESTING_SHARE = 1e-12, 1e-6
# Share of a path's length that is too short a way to be a motion of its own.
RESTING_WAY = 1e-9
# Share of it that a motion goes on for behind a rest before another can be told from it: a millisecond or so.
BEGUN_WAY = 1e-8
# m/s² or rad/s², against divisions by 0.
TINY = 1e-300
# Ticks by which an instant may be off.
TICK_ROUNDING = 1e-3
# Halvings that find the instant of a place inside a time piece: to rounding.
HALVINGS = 60


@dataclass(frozen=True, slots=True)
class Running:
    """What the machine runs: a plan, or a section of it, with path lengths and pieces of the plan.

    since     s of the trajectory at which time begins: behind input shapers it holds what came before
    duration  s from there on, behind any shapers
    counted   what its pulses count; sent: before them
    fires     the triggers of the plan that were left before it, and when (s) it comes by each; None: not at all
    """

    trajectory: Trajectory
    certificate: Certificate
    pulses: PulseSchedule
    machine: Machine
    since: float
    duration: float
    counted: AxesMotion
    fires: tuple[tuple[Triggered, float | None], ...]
    sent: Sent = NONE_SENT

    def round_to_tick(self, at: float) -> tuple[float, Sent]:
        """The instant (s) of the whole tick, by the grain of the rule, next to one, and what was sent before it."""
        clock, rule = self.pulses.clock_hz, find_rule(self.pulses.rule)
        grain = 1 if rule.whole_reason else rule.grain(clock)  # rules of parts go on by their own clock
        tick = grain * min(round(at * clock / grain), int(self.duration * clock / grain))
        return tick / self.pulses.clock_hz, self.find_sent(tick)

    def find_sent(self, tick: int | None = None) -> Sent:
        """What was sent before a tick; None: all. Raises as `find_plays`."""
        clock = self.pulses.clock_hz
        plays: tuple[Play, ...] = ()
        tick = round(self.duration * clock) + 1 if tick is None else tick  # behind the last that there may be
        if isinstance(self.counted, CompensatedMotion):
            plays = find_plays(self.counted, self.machine.axes, min(tick / clock, self.counted.duration))
        left = tuple(event for event, t in self.fires if t is None or t * clock >= tick - TICK_ROUNDING)
        return Sent(find_sent(self.pulses, tick, self.sent.pulses), plays, left)


def find_running(whole: Whole, during: Section | None) -> Running:
    """The plan, or a section of it."""
    if during is not None:
        refuse_other(whole, during)
    if during is None:
        motion, machine = whole.trajectory, whole.machine
        counted = counted_motion(motion, machine.axes, machine.home_q)
        fires = tuple((event, _time(event)) for event in whole.triggers)
        return Running(motion, whole.certificate, whole.pulses, machine, 0.0, whole.duration, counted, fires)
    shaped = during.shaped
    base = during.trajectory if shaped is None else shaped.motion.base
    assert isinstance(base, Trajectory)  # motions of machines are
    path = base.path
    assert isinstance(path, MachinePath)
    begin = path.origin[0]
    piece = min(find_piece(whole.path, begin), len(whole.path.pieces) - 1)  # an empty stop may be at the end
    motion = replace(shift_motion(base, begin, piece), path=whole.path)
    since = 0.0 if shaped is None else shaped.since
    fires = tuple((event, _time(during.fire(event))) for event in during.sent.left)
    own = during.certificate, during.pulses, during.machine, since, during.duration, during.counted
    return Running(motion, *own, fires, during.sent)


def _time(event: Triggered | None) -> float | None:
    return None if event is None else event.time


@dataclass(frozen=True, slots=True)
class Instant:
    """The state of a motion in its midst: time and time piece, s and its rates, the coordinates."""

    t: float
    knot: int
    s: float
    v: float
    a: float
    q: Array


def look(motion: Trajectory, t: float) -> Instant:
    """The state at t (s); after the end it rests there."""
    t = min(t, motion.duration)
    state = motion.at(t)
    knot = int(motion.locate(np.array([t]))[0])
    return Instant(t, knot, float(state.along[0]), float(state.sd[0]), float(state.sdd[0]), state.q[0])


def find_passage(motion: Trajectory, place: float) -> Instant:
    """The instant at which it comes by a place (m); at a rest, its end."""
    near = place + SAME_PLACE * float(motion.path.breaks[-1])
    k = int(np.clip(np.searchsorted(motion.s, near, "right") - 1, 0, None))
    low, high = float(motion.knots[k]), float(motion.knots[k + 1])
    s, v, a, j = (float(each[k]) for each in (motion.s, motion.v, motion.a, motion.j))
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        h = middle - float(motion.knots[k])
        low, high = (middle, high) if s + h * (v + h * (a / 2 + h * j / 6)) < place else (low, middle)
    return replace(look(motion, low), s=place)


def find_longest(motion: Trajectory, axes: Sequence[Axis], edges: Array) -> Array:
    """Instants (s) between each two of the edges (N+1,) of time from which stops are likely to be longest, one or two.

    By what the axes need at least, T = max |q̇|/a, a the acceleration that an axis states, or the largest seen of it:
    those of the largest T and ṡ T; of many alike the first.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        turns = -motion.a / motion.j
    inside = (turns > 0) & (turns < np.diff(motion.knots))
    ends = edges[:-1], np.nextafter(edges[1:], 0.0)
    times = np.unique(np.concatenate([*ends, motion.knots, (motion.knots[:-1] + turns)[inside]]))
    state = motion.at(np.minimum(times, motion.duration))
    stated = np.array([min(directional_bounds(axis.max_acceleration)) for axis in axes])
    hardest = np.where(np.isinf(stated), np.abs(state.qdd).max(axis=0), stated)
    need = np.where(times < motion.duration, (np.abs(state.qd) / np.maximum(hardest, TINY)).max(axis=1), 0.0)
    whose = np.clip(np.searchsorted(edges, times, side="right") - 1, 0, len(edges) - 2)
    chosen = []
    for measure in (need, need * state.sd):
        order = np.lexsort((times, -measure, whose))
        chosen.append(times[order[np.searchsorted(whose[order], np.arange(len(edges) - 1))]])
    return np.unique(chosen)


def find_rest(motion: Trajectory, now: Instant) -> Instant | None:
    """Where a rest begins that the motion is in, or within rounding of; None where it moves."""
    most = motion.v.max()
    if now.v > RESTING_SHARE * most:
        return None
    still = (motion.v <= REST_SHARE * most) & (motion.a == 0) & (motion.j == 0)
    rests = np.flatnonzero(np.append(motion.v <= REST_SHARE * most, True))
    k = now.knot if still[now.knot] else int(rests[np.argmin(np.abs(motion.knots[rests] - now.t))])
    while k > 0 and still[k - 1]:
        k -= 1
    return look(motion, float(motion.knots[k]))


def find_near_rest(motion: Trajectory, now: Instant) -> Instant | None:
    """The next rest, if the way there is too short to be a motion of its own."""
    last = next_rest(motion, now)
    short = find_rest_place(motion, last) - now.s <= RESTING_WAY * float(motion.path.breaks[-1])
    return look(motion, float(motion.knots[last])) if short else None


def find_begun(motion: Trajectory, now: Instant) -> Instant | None:
    """Where a motion that has just left a rest can be told from others; None where it can already, or never."""
    rests = np.flatnonzero(motion.v[: now.knot + 1] <= REST_SHARE * motion.v.max())
    if now.v == 0 or len(rests) == 0:
        return None
    place = float(motion.s[rests[-1]]) + BEGUN_WAY * float(motion.path.breaks[-1])
    if now.s >= place or place >= find_rest_place(motion, next_rest(motion, now)):
        return None
    return find_passage(motion, place)


def find_rest_left(motion: Trajectory, now: Instant) -> float:
    """s for which it goes on resting from an instant on; 0 where it moves."""
    moves = np.flatnonzero((motion.v != 0) | (motion.a != 0) | (motion.j != 0))
    after = int(next((k for k in moves.tolist() if k >= now.knot), len(motion.s)))
    return float(motion.knots[after] - now.t) if after > now.knot else 0.0


def next_rest(motion: Trajectory, now: Instant) -> int:
    """The time piece before which the motion comes to rest next."""
    later = np.flatnonzero(motion.v[now.knot + 1 :] <= REST_SHARE * motion.v.max())
    return now.knot + 1 + int(later[0]) if len(later) else len(motion.s)


def find_rest_place(motion: Trajectory, last: int) -> float:
    """The place (m) at which it rests before time piece `last`."""
    return float(motion.s[last]) if last < len(motion.s) else look(motion, motion.duration).s


def cut_motion(motion: Trajectory, since: Instant, until: Instant | None, last: int = 0) -> Trajectory:
    """What it does from an instant to another, or to before time piece `last`: time and path length begin at 0."""
    if until is not None:  # a knot at which it is there begins nothing
        last = until.knot + (until.t > motion.knots[until.knot])
    knots = np.concatenate([[since.t], motion.knots[since.knot + 1 : last + 1]])
    if until is not None:
        knots[-1] = until.t
    within = slice(since.knot + 1, last)
    s, v, a = (
        np.append(here, each[within]) for here, each in ((since.s, motion.s), (since.v, motion.v), (since.a, motion.a))
    )
    here = slice(since.knot, last)
    return Trajectory(motion.path, knots - since.t, s - since.s, v, a, motion.j[here], motion.piece[here])


def slow_motion(motion: Trajectory, share: float, path: MachinePath) -> Trajectory:
    """At a share of its speed, along a path of the same pieces; rests last as long as before.

    ṡ goes with the share, s̈ with its square, s⃛ with its cube.
    """
    rests = (motion.v == 0) & (motion.a == 0) & (motion.j == 0)
    h = np.diff(motion.knots)
    knots = np.concatenate([[0.0], np.cumsum(np.where(rests, h, h / share))])
    v, a, j = share * motion.v, share**2 * motion.a, share**3 * motion.j
    return Trajectory(path, knots, motion.s, v, a, j, motion.piece)


def join_motions(path: MachinePath, before: Trajectory, after: Trajectory) -> Trajectory:
    """One after the other along a path from whose start both count path lengths and pieces."""
    knots = np.concatenate([before.knots, before.knots[-1] + after.knots[1:]])
    s, v, a, j, piece = (
        np.concatenate(both)
        for both in zip(*((one.s, one.v, one.a, one.j, one.piece) for one in (before, after)), strict=True)
    )
    return Trajectory(path, knots, s, v, a, j, piece)


def shift_motion(motion: Trajectory, way: float, pieces: int) -> Trajectory:
    """With path lengths (m) and pieces counted from so far before."""
    return replace(motion, s=motion.s + way, piece=np.maximum(motion.piece + pieces, 0))


def find_piece(path: MachinePath, place: float) -> int:
    """The piece of a path that begins at a place (m), or goes on there."""
    return int(np.searchsorted(path.breaks, place, "right")) - 1
