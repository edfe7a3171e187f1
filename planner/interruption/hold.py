"""The soonest stop along a path from any instant of a motion.

The nearest rest is sought to which a motion is found that keeps every limit (`planner.interruption.ramp`). There is
always one: the motion goes on to a rest of its own.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from planner.certificate.certify import Certificate, certify, find_place, use_at_knots
from planner.interruption.instant import (
    REST_SHARE,
    Instant,
    Running,
    cut_motion,
    find_longest,
    find_near_rest,
    find_piece,
    find_rest,
    find_rest_left,
    find_rest_place,
    find_running,
    join_motions,
    look,
    next_rest,
    shift_motion,
)
from planner.interruption.ramp import Proved, find_ramps, rest_anywhere
from planner.interruption.section import Section, Whole, make_section, measure_way
from planner.limits import Limit
from planner.parallel import Progress, ignore_progress
from planner.path.actuation import MachinePath
from planner.shaping.keep_limits import refuse_unkept
from planner.shaping.shaped_motion import Copies, ShapedMotion, find_copies
from planner.shaping.shaped_proof import ShapedProof, prove_shaped
from planner.trajectory import Trajectory

# Share of a path's length up to which what copies still move along is none: of less, the rounding of places (10⁻¹⁶ of
# the length) is more than ends may be apart (10⁻⁹).
SAME_STOP = 1e-7
# Instants at which the motion is left whose stops are compared: each takes as long to try.
MOST_COMPARED = 2


def hold(whole: Whole, at: float, during: Section | None = None) -> Section:
    """Compute the soonest stop along the path from an instant (s) of a plan, on a whole tick of its clock.

    during: a section of the plan that runs instead, from whose start on the instant counts.

    At a rest the stop is empty: a trajectory of zero length, without pulses except one that is due already. After the
    input shapers the axes may still move while the motion before the shapers rests: the stop then lasts until they
    rest too. Constant speeds that segments require are not kept. Raises MotionError for an instant outside the motion.
    """
    running = find_running(whole, during)
    refuse_instant("hold", at, running, during)
    t, sent = running.round_to_tick(at)
    stop = _stop(whole, running, at, t)
    return make_section(whole, "hold", *stop[:5], sent, t, stop.shaped)


def refuse_instant(what: str, at: float, running: Running, during: Section | None) -> None:
    """Raise MotionError for an instant that is none of the plan's, or the section's that runs."""
    if not 0 <= at <= running.duration:
        of = "plan" if during is None else during.what
        raise MotionError(
            f"{what} at {at:g} s: the {of} lasts from 0 to {running.duration:.6f} s; give an instant of it"
        )


def _stop(whole: Whole, running: Running, at: float, t: float) -> Proved:
    """The soonest stop from an instant (s), whose tick is at t (s)."""
    motion, copies = running.trajectory, find_copies(whole.machine.axes)
    now = look(motion, running.since + t)
    rest = _find_rest_at(running, at) or find_near_rest(motion, now)
    if rest is None:
        stop = _solve_stop(whole, running, now)
        return stop if copies is None else shape_section(whole, running, now, stop, copies)
    run_out = None if copies is None else _run_out(whole, running, running.since + t, rest, copies)
    return run_out or _stand(whole, rest, t)


def _find_rest_at(running: Running, at: float) -> Instant | None:
    """Where a rest begins that the motion is in at an instant (s), or less than a tick from it; None where it moves."""
    motion = running.trajectory
    tick = 1 / running.pulses.clock_hz
    time = running.since + at
    ending = running.duration - at < tick
    now = look(motion, motion.duration if ending else time)
    rest = find_rest(motion, now)
    if rest is not None:
        return rest
    still = np.flatnonzero(motion.v <= REST_SHARE * motion.v.max())
    near = still[np.abs(motion.knots[still] - time) < tick]
    return find_rest(motion, look(motion, float(motion.knots[near[0]]))) if len(near) else None


def _stand(whole: Whole, rest: Instant, t: float) -> Proved:
    """An empty stop from an instant t (s) at a rest: a motion of zero length along a path of zero length."""
    begun = int(np.clip(find_piece(whole.path, rest.s), 0, len(whole.path.pieces) - 1))
    piece = whole.path.pieces[begun]
    start = piece.start + rest.s - float(whole.path.breaks[begun])
    piece = replace(piece, length=0.0, turn=0.0, start=start, constant=False)
    ends = np.ones(2, int), np.zeros(2)
    path = MachinePath(whole.machine, [piece], *ends, tool=whole.tool, near=rest.q, origin=(rest.s, t))
    zero = np.zeros(1)
    motion = Trajectory(path, np.zeros(2), zero, zero, zero, zero, np.zeros(1, int))
    limits = whole.limits(path)
    return Proved(path, limits, motion, _certify_standing(motion, limits), rest.s)


def _certify_standing(motion: Trajectory, limits: Sequence[Limit]) -> Certificate:
    """Certify a motion at rest: it has one state, in which each limit has one value."""
    use = use_at_knots(motion, limits)
    return Certificate(
        holds=all(float(values.max()) <= 1 for values in use.values()),
        worst={name: float(values.max()) for name, values in use.items()},
        where={name: find_place(motion, limits, name, 0) for name in use},
        use={name: freeze_array(values) for name, values in use.items()},
        attained={name: freeze_array(values) for name, values in use.items()},
    )


def shape_section(whole: Whole, running: Running, now: Instant, made: Proved, copies: Copies) -> Proved:
    """A motion and what is proved of it behind shapers, of which copies are still on the one that runs."""
    motion = running.trajectory
    behind = look(motion, max(now.t - copies.length, 0.0))
    if behind.t == now.t:  # nothing came before it: no copies are under way
        return made._replace(shaped=_prove_section(made.trajectory, copies, whole, made.limits, 0.0))
    until, last = now.s + float(made.path.breaks[-1]), bool(made.path.dwells[-1] > 0)
    path = _draw_from(whole, motion, behind, until, last)
    first, here = find_piece(whole.path, behind.s), find_piece(whole.path, now.s)
    before = shift_motion(cut_motion(motion, behind, now), 0.0, -first)
    joined = join_motions(path, before, shift_motion(made.trajectory, now.s - behind.s, here - first))
    return made._replace(shaped=_prove_section(joined, copies, whole, whole.limits(path), float(before.knots[-1])))


def _run_out(whole: Whole, running: Running, t: float, rest: Instant, copies: Copies) -> Proved | None:
    """What copies still do from t on of a motion that rests already; None where they rest too."""
    motion = running.trajectory
    behind = look(motion, max(t - copies.length, 0.0))
    begun = find_rest(motion, behind)
    if begun is not None and begun.t == rest.t:
        return None
    if rest.s - behind.s <= SAME_STOP * float(whole.path.breaks[-1]):
        return None
    path = _draw_from(whole, motion, behind, rest.s, last_dwell=False)
    limits = whole.limits(path)
    before = shift_motion(cut_motion(motion, behind, rest), 0.0, -find_piece(whole.path, behind.s))
    before = replace(before, path=path)
    since = min(t, copies.length)  # which is a knot, or in the motion from its start on
    proof = _prove_section(before, copies, whole, limits, since)
    still = np.zeros(1)
    end, piece = path.breaks[-1:], np.array([len(path.pieces) - 1])
    rests = Trajectory(path, np.array([0.0, proof.duration]), end, still, still, still, piece)
    return Proved(path, limits, rests, running.certificate, behind.s, proof)


def _prove_section(
    moves: Trajectory, copies: Copies, whole: Whole, limits: tuple[Limit, ...], since: float
) -> ShapedProof:
    """Of the motion that copies are under way with, to its rest: what shaping keeps is proved of that alone, and whole.

    Raises MotionError where what runs and what follows do not make one motion that keeps it.
    """
    certificate = certify(moves, [limit for limit in limits if limit.convex])
    if not certificate.holds:
        raise MotionError(f"the motion into the section is not proved; choose another instant:\n{certificate}")
    return prove_shaped(ShapedMotion.of(moves, copies), moves, whole.machine.axes, limits, certificate, since=since)


def _draw_from(whole: Whole, motion: Trajectory, now: Instant, until: float, last_dwell: bool = True) -> MachinePath:
    left = find_rest_left(motion, now)
    return whole.draw(now.s, until, now.v, now.a, now.t, now.q, rests=left, last_dwell=last_dwell)


def _solve_stop(whole: Whole, running: Running, now: Instant) -> Proved:
    """Find the soonest stop before any shapers.

    The better of those from the first two instants at which the motion can be left: a rough search
    may miss the nearest place from one of them. If neither has one, the motion's own next rest.
    """
    motion = running.trajectory
    last = next_rest(motion, now)
    end = find_rest_place(motion, last)
    stops: list[Proved] = []
    for ways in find_ramps(whole, motion, now, end, rest_anywhere):
        stops += islice((way for way in ways if way.certificate.holds), 1)
        if len(stops) == MOST_COMPARED:
            break
    if stops:
        return min(stops, key=lambda stop: stop.trajectory.duration)
    ahead = _draw_from(whole, motion, now, end)
    own = cut_motion(motion, now, None, last)
    own = replace(own, path=ahead, piece=own.piece - own.piece[0])
    limits = whole.limits(ahead)
    proof = certify(own, limits)  # which names places of its own; what runs is proved with it anyhow
    return Proved(ahead, limits, own, proof if proof.holds else running.certificate, now.s)


@dataclass(frozen=True, slots=True)
class Stops(Result):
    """The soonest stop along a plan's path from one or two instants of each of some stretches of time, each proved.

    t (N,) s; place (N,) m along the path, of the motion before any shapers; time (N,) s to rest and distance (N,) m to
    it, as those of a `Section`; 0 where nothing moves
    refused: instants (s) from which no stop is proved, and why
    """

    name: str
    t: Array
    place: Array
    time: Array
    distance: Array
    refused: tuple[tuple[float, str], ...] = ()

    def tables(self) -> tuple[Table, ...]:
        """The longest, and what holds of half of them; those that are refused."""
        columns = (
            Column("what", ["time to rest", "distance to rest"]),
            Column("median", [f"{np.median(self.time):.4f} s", f"{1e3 * np.median(self.distance):.3f} mm"]),
            Column("largest of them", [f"{self.time.max():.4f} s", f"{1e3 * self.distance.max():.3f} mm"]),
            Column("at", [f"{self.t[np.argmax(each)]:.4f} s" for each in (self.time, self.distance)]),
        )
        instants = count_noun(len(self.t) + len(self.refused), "instant")
        title = f"stops of {self.name}, from {instants} where they are likely to be longest"
        at, why = zip(*self.refused, strict=True) if self.refused else ((), ())
        refused = Table("instants from which no stop is proved", (Column("t", at, "s"), Column("reason", why)))
        return (Table(title, columns), *((refused,) if self.refused else ()))

    def data(self) -> Table:
        """Each of them."""
        columns = (
            Column("t", self.t, "s"),
            Column("s", self.place, "m"),
            Column("time to rest", self.time, "s"),
            Column("distance to rest", self.distance, "m"),
        )
        return Table(f"stops of {self.name}", columns)


def find_stops(whole: Whole, count: int, progress: Progress = ignore_progress) -> Stops:
    """From one or two instants of each of `count` equal stretches of time, where stops are likely to be longest.

    Raises the first refusal where there is no other row.
    """
    if count < 1:
        raise MotionError(f"{count} stops: ask for 1 at least")
    running, found = find_running(whole, None), []
    refused: list[tuple[float, MotionError]] = []
    instants = find_longest(whole.trajectory, whole.machine.axes, np.linspace(0.0, whole.duration, count + 1)).tolist()
    for n, t in enumerate(instants):
        place = look(whole.trajectory, t).s
        try:
            stop = _stop(whole, running, t, t)
            if stop.shaped is not None:
                refuse_unkept(stop.limits, stop.shaped)
        except MotionError as error:
            refused.append((t, error))
        else:
            found.append((t, place, stop.duration, measure_way(stop.path, stop.shaped)))
        progress(n + 1, len(instants))
    if not found:
        raise refused[0][1]
    t_s, places, times, distances = np.array(found).T
    return Stops(whole.name, t_s, places, times, distances, tuple((t, str(error)) for t, error in refused))
