"""The soonest stop along a path from any instant of a motion.

The nearest rest is sought to which a motion is found that keeps every limit
(`planner.interruption.ramp`). There is always one: the motion continues to a rest of its own.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from planner.certificate.certify import Certificate, certify, find_place
from planner.certificate.limit_use import use_at_knots
from planner.interruption.instant import (
    REST_SHARE,
    Instant,
    cut_motion,
    find_longest,
    find_near_rest,
    find_next_rest,
    find_piece,
    find_rest,
    find_rest_left,
    join_motions,
    look,
    shift_motion,
)
from planner.interruption.ramp import find_ramps
from planner.interruption.running import Running, find_running
from planner.interruption.section import ProvedMotion, Section, Whole, make_section, measure_way
from planner.limits import Limit
from planner.parallel import Progress, ignore_progress
from planner.path.actuation import MachinePath
from planner.shaping.keep_limits import refuse_unkept
from planner.shaping.shaped_motion import Copies, ShapedMotion, find_copies
from planner.shaping.shaped_proof import ShapedProof, prove_shaped
from planner.trajectory import Trajectory

# Share of a path's length below which copies along it count as at rest: rounding of places (10⁻¹⁶
# of the length) would be more than the 10⁻⁹ by which the ends of a motion may be off.
SAME_STOP = 1e-7
# Instants at which the motion is left and whose stops are compared: each costs as much as a stop.
MOST_COMPARED = 2
# Share of the largest s⃛ by which it steps where a motion may be left.
STEP_SHARE = 0.1
# Such steps tried at most.
MAX_LEAVES = 6


def hold(whole: Whole, at: float, during: Section | None = None) -> Section:
    """Compute the soonest stop along the path from an instant (s), on a whole tick of the clock.

    At a rest the stop is empty: a trajectory of zero length, without pulses except one that is due
    already. After the input shapers the axes may still move while the motion before the shapers
    rests: the stop then lasts until they rest too. Constant speeds that segments require are not
    kept.

    during: a section of the plan that runs instead, as the way on from an earlier stop; the instant
    counts from its start.

    Raises MotionError for an instant outside the motion.
    """
    running = find_running(whole, during)
    if not 0 <= at <= running.duration:
        name = "plan" if during is None else during.kind
        raise MotionError(
            f"hold at {at:g} s: the {name} lasts from 0 to {running.duration:.6f} s; give an instant of it"
        )
    t, sent = running.round_to_tick(at)
    return make_section(whole, "hold", _stop(whole, running, at, t), sent, t)


def _stop(whole: Whole, running: Running, at: float, t: float) -> ProvedMotion:
    """Compute the soonest stop from an instant (s), whose tick is at t (s)."""
    motion = running.trajectory
    copies = find_copies(whole.machine.axes)
    now = look(motion, running.since + t)
    rest = _find_rest_at(running, at) or find_near_rest(motion, now)
    if rest is None:
        stop = _solve_stop(whole, running, now)
        return stop if copies is None else _shape_stop(whole, running, now, stop, copies)
    if copies is not None:
        run_out = _run_out(whole, running, running.since + t, rest, copies)
        if run_out is not None:
            return run_out
    return _rest(whole, rest, t)


def _find_rest_at(running: Running, at: float) -> Instant | None:
    """Find the beginning of the rest at an instant (s) to a tick; None where the motion moves."""
    motion = running.trajectory
    tick = 1 / running.pulses.clock_hz
    time = running.since + at
    ending = running.duration - at < tick
    rest = find_rest(motion, look(motion, motion.duration if ending else time))
    if rest is not None:
        return rest
    rests = np.flatnonzero(motion.v <= REST_SHARE * motion.v.max())
    near = rests[np.abs(motion.knots[rests] - time) < tick]
    return find_rest(motion, look(motion, float(motion.knots[near[0]]))) if len(near) else None


def _rest(whole: Whole, rest: Instant, t: float) -> ProvedMotion:
    """Return an empty stop from an instant t (s) at a rest: motion and path have zero length."""
    number = int(np.clip(find_piece(whole.path, rest.s), 0, len(whole.path.pieces) - 1))
    piece = whole.path.pieces[number]
    start = piece.start + rest.s - float(whole.path.breaks[number])
    piece = replace(piece, length=0.0, turn=0.0, start=start, constant=False)
    stops = np.ones(2, int)
    dwells = np.zeros(2)
    path = MachinePath(
        whole.machine,
        [piece],
        stops,
        dwells,
        tool=whole.tool,
        near=rest.q,
        origin=(rest.s, t),
    )
    zero = np.zeros(1)
    motion = Trajectory(path, np.zeros(2), zero, zero, zero, zero, np.zeros(1, int))
    limits = whole.limits(path)
    return ProvedMotion(path, limits, motion, _certify_rest(motion, limits), rest.s)


def _certify_rest(motion: Trajectory, limits: Sequence[Limit]) -> Certificate:
    """Certify a motion at rest: it has one state, in which each limit has one value."""
    use = use_at_knots(motion, limits)
    worst = {name: float(values.max()) for name, values in use.items()}
    return Certificate(
        holds=all(value <= 1 for value in worst.values()),
        worst=worst,
        where={name: find_place(motion, limits, name, 0) for name in use},
        use={name: freeze_array(values) for name, values in use.items()},
        attained={name: freeze_array(values) for name, values in use.items()},
    )


def _shape_stop(
    whole: Whole,
    running: Running,
    now: Instant,
    stop: ProvedMotion,
    copies: Copies,
) -> ProvedMotion:
    """Prove a stop after shaping, with copies of the running motion that are still under way."""
    motion = running.trajectory
    earliest = look(motion, max(now.t - copies.length, 0.0))
    if earliest.t == now.t:  # the motion begins here: no copies are under way
        return replace(stop, shaped=_prove_shaped(stop.trajectory, copies, whole, stop.limits, 0.0))
    until = now.s + float(stop.path.breaks[-1])
    last_dwell = bool(stop.path.dwells[-1] > 0)
    path = _draw_from(whole, motion, earliest, until, last_dwell)
    first = find_piece(whole.path, earliest.s)
    here = find_piece(whole.path, now.s)
    before = shift_motion(cut_motion(motion, earliest, now), 0.0, -first)
    after = shift_motion(stop.trajectory, now.s - earliest.s, here - first)
    joined = join_motions(path, before, after)
    shaped = _prove_shaped(joined, copies, whole, whole.limits(path), float(before.knots[-1]))
    return replace(stop, shaped=shaped)


def _run_out(
    whole: Whole,
    running: Running,
    t: float,
    rest: Instant,
    copies: Copies,
) -> ProvedMotion | None:
    """Prove the copies of a motion at rest from t (s) on; None where they rest too."""
    motion = running.trajectory
    earliest = look(motion, max(t - copies.length, 0.0))
    begun = find_rest(motion, earliest)
    if begun is not None and begun.t == rest.t:
        return None
    if rest.s - earliest.s <= SAME_STOP * float(whole.path.breaks[-1]):
        return None
    path = _draw_from(whole, motion, earliest, rest.s, last_dwell=False)
    limits = whole.limits(path)
    before = shift_motion(
        cut_motion(motion, earliest, rest),
        0.0,
        -find_piece(whole.path, earliest.s),
    )
    before = replace(before, path=path)
    since = min(t, copies.length)  # a knot, or in the motion from its start on
    shaped = _prove_shaped(before, copies, whole, limits, since)

    zero = np.zeros(1)
    knots = np.array([0.0, shaped.duration])
    last = np.array([len(path.pieces) - 1])
    at_rest = Trajectory(path, knots, path.breaks[-1:], zero, zero, zero, last)
    return ProvedMotion(path, limits, at_rest, running.certificate, earliest.s, shaped)


def _prove_shaped(
    motion: Trajectory, copies: Copies, whole: Whole, limits: tuple[Limit, ...], since: float
) -> ShapedProof:
    """Prove a motion after shaping, from `since` (s) on.

    Convex limits are proved of the motion before shaping: shaping keeps them. Raises MotionError
    where the running motion and its stop together do not keep them.
    """
    certificate = certify(motion, [limit for limit in limits if limit.convex])
    if not certificate.holds:
        raise MotionError(
            f"the motion into the section is not proved; choose another instant:\n{certificate}"
        )
    shaped = ShapedMotion.of(motion, copies)
    return prove_shaped(shaped, motion, whole.machine.axes, limits, certificate, since=since)


def _draw_from(
    whole: Whole,
    motion: Trajectory,
    now: Instant,
    until: float,
    last_dwell: bool = True,
) -> MachinePath:
    """Return the path from an instant to a place (m), with the rest of a dwell at the instant."""
    left = find_rest_left(motion, now)
    return whole.draw(now, until, rests=left, last_dwell=last_dwell)


def _solve_stop(whole: Whole, running: Running, now: Instant) -> ProvedMotion:
    """Find the soonest stop before any shaping.

    The better of those from the first two instants at which the motion can be left: a rough search
    may miss the nearest place from one of them. If neither has one, the motion's own next rest.
    """
    motion = running.trajectory
    rest = find_next_rest(motion, now)
    stops: list[ProvedMotion] = []
    for leave in _find_leaves(motion, now, rest, whole.order):
        stop = _leave(whole, motion, now, leave, rest.s)
        if stop is not None:
            stops.append(stop)
        if len(stops) == MOST_COMPARED:
            break
    if stops:
        return min(stops, key=lambda stop: stop.trajectory.duration)

    path = _draw_from(whole, motion, now, rest.s)
    to_rest = cut_motion(motion, now, rest)
    to_rest = replace(to_rest, path=path, piece=to_rest.piece - to_rest.piece[0])
    limits = whole.limits(path)
    certificate = certify(to_rest, limits)
    if not certificate.holds:
        # by rounding alone: the motion is a part of the running one, which is proved
        certificate = running.certificate
    return ProvedMotion(path, limits, to_rest, certificate, now.s)


def _find_leaves(motion: Trajectory, now: Instant, rest: Instant, order: int) -> Iterator[Instant]:
    """Find the instants at which the motion may be left: at once, then where its s⃛ steps.

    Where the motion comes to its largest speed its jerk is all that the limits allow, exact to the
    last digit if it was found in closed form. Then a single motion leads on, and no solver finds
    it.
    """
    yield now
    if order == 2:
        return
    steps = np.abs(np.diff(motion.j)) > STEP_SHARE * np.abs(motion.j).max()
    times = motion.knots[1:-1]
    later = times[steps & (times > now.t) & (times < rest.t) & (motion.v[1:] > 0)]
    for t in later[:MAX_LEAVES].tolist():
        yield look(motion, t)


def _leave(
    whole: Whole,
    motion: Trajectory,
    now: Instant,
    leave: Instant,
    end: float,
) -> ProvedMotion | None:
    """Find the soonest stop before `end` (m) that follows the running motion until `leave`."""
    for ramp in find_ramps(whole, leave, end, _rest_anywhere, motion):
        stop = ramp if leave is now else _follow_first(whole, motion, now, leave, ramp)
        if stop.certificate.holds:
            return stop
    return None


def _rest_anywhere(place: float) -> tuple[float, float]:
    """Return ṡ and s̈ of a rest at any place."""
    return 0.0, 0.0


def _follow_first(
    whole: Whole,
    motion: Trajectory,
    now: Instant,
    leave: Instant,
    ramp: ProvedMotion,
) -> ProvedMotion:
    """Join the motion up to where it is left and a ramp from there, and prove both together."""
    until = leave.s + float(ramp.path.breaks[-1])
    path = whole.draw(now, until)
    first = find_piece(whole.path, now.s)
    here = find_piece(whole.path, leave.s)
    before = shift_motion(cut_motion(motion, now, leave), 0.0, -first)
    after = shift_motion(ramp.trajectory, leave.s - now.s, here - first)
    joined = join_motions(path, before, after)
    limits = whole.limits(path)
    return ProvedMotion(path, limits, joined, certify(joined, limits), now.s)


@dataclass(frozen=True, slots=True)
class Stops(Result):
    """The soonest stops along a plan's path from instants of several equal intervals of time.

    t         (N,) s
    place     (N,) m along the path, of the motion before any shapers
    time      (N,) s to rest; 0 where nothing moves
    distance  (N,) m to rest, as `Section.distance`
    refused   instants (s) from which no stop is proved, and why
    """

    name: str
    t: Array
    place: Array
    time: Array
    distance: Array
    refused: tuple[tuple[float, str], ...] = ()

    def tables(self) -> tuple[Table, ...]:
        """Return the longest and the median stop, and the instants that were refused."""
        longest = [f"{self.t[np.argmax(values)]:.4f} s" for values in (self.time, self.distance)]
        columns = (
            Column("what", ["time to rest", "distance to rest"]),
            Column(
                "median",
                [f"{np.median(self.time):.4f} s", f"{1e3 * np.median(self.distance):.3f} mm"],
            ),
            Column(
                "largest of them",
                [f"{self.time.max():.4f} s", f"{1e3 * self.distance.max():.3f} mm"],
            ),
            Column("at", longest),
        )
        instants = count_noun(len(self.t) + len(self.refused), "instant")
        title = f"stops of {self.name}, from {instants} where they are likely to be longest"
        table = Table(title, columns)
        if not self.refused:
            return (table,)
        times = [t for t, _ in self.refused]
        reasons = [reason for _, reason in self.refused]
        refused = Table(
            "instants from which no stop is proved",
            (Column("t", times, "s"), Column("reason", reasons)),
        )
        return table, refused

    def data(self) -> Table:
        """Return one row per stop."""
        columns = (
            Column("t", self.t, "s"),
            Column("s", self.place, "m"),
            Column("time to rest", self.time, "s"),
            Column("distance to rest", self.distance, "m"),
        )
        return Table(f"stops of {self.name}", columns)


def find_stops(whole: Whole, count: int, progress: Progress = ignore_progress) -> Stops:
    """Compute stops from instants of each of `count` equal intervals where they are likely longest.

    Raises MotionError for a count below 1, and the first refusal where every instant is refused.
    """
    if count < 1:
        raise MotionError(f"{count} stops: ask for 1 at least")
    running = find_running(whole)
    edges = np.linspace(0.0, whole.duration, count + 1)
    instants = find_longest(whole.trajectory, whole.machine.axes, edges).tolist()
    rows: list[tuple[float, float, float, float]] = []
    refused: list[tuple[float, MotionError]] = []
    for number, t in enumerate(instants, 1):
        try:
            stop = _stop(whole, running, t, t)
            if stop.shaped is not None:
                refuse_unkept(stop.limits, stop.shaped)
        except MotionError as error:
            refused.append((t, error))
        else:
            place = look(whole.trajectory, t).s
            rows.append((t, place, stop.duration, measure_way(stop.path, stop.shaped)))
        progress(number, len(instants))
    if not rows:
        raise refused[0][1]
    t_s, places, times, distances = np.array(rows).T
    reasons = tuple((t, str(error)) for t, error in refused)
    return Stops(whole.name, t_s, places, times, distances, reasons)
