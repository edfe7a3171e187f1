"""Motions that keep every limit, and are not the one that the path asks for: none is certified."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import PPoly

from kinematics import Axis
from planner import Line, Program, Trajectory, time_optimal
from planner.certificate import certify
from planner.limits import limits_of
from planner.limits.axis import Acceleration, Jerk, Speed
from planner.path.actuation import actuate
from planner.path.polynomial import PolynomialPath
from planner.timing import certified_solve

NUMBERS = ("s", "v", "a", "j", "piece")


def rebuilt(motion, lengths, chosen=slice(None), **changed):
    """The time pieces chosen, with such lengths and with numbers changed before."""
    numbers = [changed.get(name, getattr(motion, name))[chosen] for name in NUMBERS]
    return Trajectory(motion.path, np.append(0.0, np.cumsum(lengths[chosen])), *numbers)


def faults(motion, limits):
    found = certify(motion, limits)
    assert not found.holds
    return {name for name, worst in found.worst.items() if not np.isfinite(worst)}


def bounded(order, jerk=2.0):
    axes = [Axis("x")]
    kinds = (Speed, 2.0), (Acceleration, 2.0), (Jerk, jerk)
    return [kind(axes, np.array([bound])) for kind, bound in kinds[:order]]


def polynomial(*coefficients):
    """A path of one axis over [0, 1]."""
    return PolynomialPath([0.0, 1.0], np.array(coefficients, float)[:, None, None], ["x"])


@pytest.mark.parametrize("order", [2, 3])
def test_turns_may_not_be_left_out(planned, order):
    """Where q comes back to where it was, standing still keeps all limits and jumps nowhere."""
    plan = planned("circle", order)
    motion, limits = plan.trajectory, plan.limits
    path, lengths = motion.path, np.diff(motion.knots)
    ends = [
        path.derivatives(path.breaks[[k, k + 1]], np.array([k, k]), 0)[0]
        for k in range(len(path.breaks) - 1)
    ]
    turns = [k for k, (first, last) in enumerate(ends) if np.abs(first - last).max() < 1e-9]
    assert len(turns) == 2
    kept, changed = (
        np.ones(len(motion.s), bool),
        {name: getattr(motion, name).copy() for name in NUMBERS},
    )
    for turn in turns:
        own = np.flatnonzero(motion.piece == turn)
        kept[own[1:-1]] = False
        for k, place in ((own[0], path.breaks[turn]), (own[-1], path.breaks[turn + 1])):
            changed["s"][k], lengths[k] = place, 1e-3
            for name in "vaj":
                changed[name][k] = 0.0
    short = rebuilt(motion, lengths, kept, **changed)
    assert short.duration < 0.6 * motion.duration
    assert faults(short, limits) == {"place left out"}


def test_a_dwell_may_not_be_left_out(planned):
    plan = planned("circle", 2)
    motion, lengths = plan.trajectory, np.diff(plan.trajectory.knots)
    rest = (motion.v == 0) & (motion.a == 0) & (motion.j == 0)
    assert rest.any()
    assert faults(rebuilt(motion, lengths, ~rest), plan.limits) == {"dwell left out"}
    assert faults(rebuilt(motion, np.where(rest, 0.9 * lengths, lengths)), plan.limits) == {
        "dwell left out"
    }
    assert certify(rebuilt(motion, np.where(rest, 2 * lengths, lengths)), plan.limits).holds


def test_a_constant_speed_may_not_be_left_out(hexapod):
    path = actuate(Program([Line([0.01, 0, 0.02], speed=0.005, speed_constant=True)]), hexapod)
    limits = limits_of(path, hexapod.axes, 2)
    motion = certified_solve(path, limits, 2).trajectory
    slow = Trajectory(
        path,
        1.5 * motion.knots,
        motion.s,
        motion.v / 1.5,
        motion.a / 1.5**2,
        motion.j,
        motion.piece,
    )
    assert faults(slow, limits) == {"constant speed left out"}
    at_it = np.flatnonzero(np.isfinite(motion.constant_speeds))
    almost = motion.v.copy()
    almost[at_it[len(at_it) // 2]] *= 1 + 1e-15
    again = Trajectory(path, motion.knots, motion.s, almost, motion.a, motion.j, motion.piece)
    assert faults(again, limits) == {"constant speed left out"}


@pytest.mark.parametrize("order", [2, 3])
def test_places_within_a_piece_may_not_be_left_out(order):
    path = polynomial(4.0, -4.0, 0.0)  # out and back
    hop = Trajectory(
        path, np.arange(3.0), np.array([0.0, 1.0]), *np.zeros((3, 2)), np.zeros(2, int)
    )
    assert faults(hop, bounded(order)) == {"place left out"}
    still = Trajectory(path, np.array([0.0, 1.0]), *np.zeros((4, 1)), np.zeros(1, int))
    assert "end off the path's" in faults(still, bounded(order))


@pytest.mark.parametrize("order", [2, 3])
@pytest.mark.parametrize("large", [1e20, 1e100])
def test_what_takes_no_time_excuses_nothing(order, large):
    """Time pieces of no length say nothing of any instant, however fast they claim to be."""
    path, nothing = polynomial(1.0, 0.0), np.zeros(5)
    knots, s = np.array([0.0, 1.0, 1.0, 1.0, 1.0, 2.0]), np.array([0.0, 0.0, 0.5, 1.0, 1.0])
    fast = np.array([0.0, large, large, large, 0.0])
    for v, a, j in ((fast, fast, fast), (nothing, fast, fast), (nothing, nothing, fast)):
        found = faults(Trajectory(path, knots, s, v, a, j, np.zeros(5, int)), bounded(order))
        assert found == {"position jump", "place left out"}


def test_acceleration_may_not_jump_by_pieces_that_take_no_time():
    """Bang-bang, under a jerk limit, with a jerk of 1e30 for no time at all."""
    path = polynomial(1.0, 0.0)
    knots, large = np.array([0.0, 0.0, 1.0, 1.0, 2.0, 2.0]), 1e30
    s, v = np.array([0.0, 0.0, 0.5, 0.5, 1.0]), np.array([0.0, 0.0, 1.0, 1.0, 0.0])
    a, j = np.array([0.0, 1.0, 1.0, -1.0, -1.0]), np.array([large, 0.0, -large, 0.0, large])
    assert faults(Trajectory(path, knots, s, v, a, j, np.zeros(5, int)), bounded(3)) == {
        "acceleration jump"
    }


def test_time_may_not_run_backwards():
    found = time_optimal(PPoly([[1.0], [0.0]], [0.0, 1.0]), max_speed=2.0, max_acceleration=2.0)
    motion, limits = found.trajectory, bounded(2)
    assert certify(motion, limits).holds
    for knots in (motion.knots - 1.0, motion.knots[::-1], np.append(motion.knots[:-1], np.nan)):
        assert "time out of order" in faults(replace(motion, knots=knots), limits)
    back = motion.knots.copy()
    back[len(back) // 2] = back[len(back) // 2 - 1] - 1e-3
    assert "time out of order" in faults(replace(motion, knots=back), limits)


def test_a_motion_with_pieces_that_rounding_made_of_no_length_holds():
    """As those of a ramp that is brief beside the time of day."""
    found = time_optimal(PPoly([[1.0], [0.0]], [0.0, 1.0]), max_speed=2.0, max_acceleration=2.0)
    motion = found.trajectory
    twice = np.sort(np.append(np.arange(len(motion.s)), len(motion.s) // 2))
    lengths = np.where(np.diff(twice, append=-1) == 0, 0.0, np.diff(motion.knots)[twice])
    numbers = (getattr(motion, name)[twice] for name in NUMBERS)
    again = Trajectory(motion.path, np.append(0.0, np.cumsum(lengths)), *numbers)
    assert np.any(np.diff(again.knots) == 0)
    assert certify(again, bounded(2)).holds


@pytest.mark.parametrize("exponent", [-280, -160, -100, 0, 100, 160, 200])
def test_peaks_are_bounded_at_every_scale(exponent):
    """A speed that peaks between two instants by 2e-6 above its limit: squares of its numbers are
    no numbers.
    """
    unit = 10.0**exponent
    path = PolynomialPath(
        [0.0, 1.0], unit * np.array([[[-0.25]], [[0.0]], [[0.5]], [[0.0]], [[0.0]]]), ["x"]
    )
    axes, motion = (
        [Axis("x")],
        Trajectory(path, np.array([0.0, 1.0]), *np.array([[0.0], [1.0], [0.0], [0.0]]), [0]),
    )
    peak = unit * 2 / np.sqrt(27) / (1 + 2e-6)
    limits = [Speed(axes, np.array([peak])), Jerk(axes, np.array([1e3 * unit]))]
    assert certify(motion, limits).worst["speed"] == pytest.approx(1 + 2e-6, abs=1e-7)
