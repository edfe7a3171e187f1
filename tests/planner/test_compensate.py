"""Compensation: behind a simulated screw and its play, the axis is where the motion says, as far as it is stated."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics.axis import Axis
from kinematics.errors import MotionError
from planner.place import Infeasible
from planner.pulses import check, generate
from planner.pulses.compensate import compensated
from tests.planner.motions import PULSE, example, in_pulses, through

TABLE = ((0.0, 0.0), (1e-4, 3e-6), (2e-4, -2e-6), (4e-4, 1e-6))


def axis_position(u, backlash):
    """Behind play: the axis stays until the motor pushes it, from either side; it began pushed towards greater q."""
    axis = np.empty_like(u)
    at = u[0]
    for i, motor in enumerate(u):
        at = min(max(at, motor), motor + backlash)
        axis[i] = at
    return axis


def behind(counted, home, axis):
    """Where a counted position leaves the axis: through the play, and through a screw linear between its points."""
    u = counted - home
    if "backlash" in axis.compensate:
        u = axis_position(u, axis.backlash)
    if "lead" in axis.compensate:
        u = u + np.interp(u, *np.array(axis.lead_error).T)
    return home + u


def axes(motion, kinds, backlash=5e-6):
    n = motion.at(np.zeros(1)).q.shape[1]
    common = {"pulse": PULSE, "max_speed": 0.05, "max_acceleration": 5.0, "backlash": backlash, "lead_error": TABLE}
    return [Axis(f"leg{k}", compensate=kinds, **common) for k in range(n)]


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 1000), st.sampled_from([("lead",), ("backlash",), ("lead", "backlash")]))
def test_behind_screw_and_play_the_axis_is_where_it_should_be(seed, kinds):
    motion = example(seed)
    home = motion.at(np.zeros(1)).q[0] - 1e-4
    driven = axes(motion, kinds)
    made = compensated(motion, driven, home)
    t = np.linspace(0, motion.duration, 20_001)
    counted, wanted = made.at(t).q, motion.at(t).q
    for k, axis in enumerate(driven):
        off = abs(behind(counted[:, k], home[k], axis) - wanted[:, k]).max()
        assert off <= made.costs[k].off * 1.01 + 1e-12
        assert made.costs[k].off < axis.backlash
        if kinds == ("lead",):
            assert off < 1e-12


def test_derivatives_are_those_of_what_is_counted():
    motion = example(3)
    home = motion.at(np.zeros(1)).q[0] - 1e-4
    made = compensated(motion, axes(motion, ("lead", "backlash")), home)
    for lo, hi in zip(made.knots[:-1], made.knots[1:], strict=True):
        if hi - lo < 1e-5:
            continue
        t = lo + (hi - lo) * np.linspace(0.1, 0.9, 401)
        state = made.at(t)
        for value, rate in ((state.q, state.qd), (state.qd, state.qdd), (state.qdd, state.qddd)):
            slope = np.gradient(value, t, axis=0)[1:-1]
            assert slope == pytest.approx(rate[1:-1], abs=1e-3 * abs(rate).max() + 1e-9)


def test_its_pulses_hold_against_it_and_leave_the_real_axis_within_what_is_stated():
    motion = example(1)
    home = motion.at(np.zeros(1)).q[0] - 1e-4
    driven = axes(motion, ("lead", "backlash"))
    schedule = generate(motion, driven, home)
    made = compensated(motion, driven, home)
    assert check(schedule, made, driven, home).holds
    assert not check(schedule, motion, driven, home).holds
    t = np.linspace(0, motion.duration, 20_001)
    counts, wanted = schedule.counts(t), motion.at(t).q
    for k, (axis, cost) in enumerate(zip(driven, schedule.compensations, strict=True)):
        off = abs(behind(home[k] + counts[:, k] * PULSE, home[k], axis) - wanted[:, k]).max()
        assert off <= cost.off + 0.52 * PULSE  # the screw's slope is up to 5 % here
        assert cost.crossings > 0


def test_while_the_axis_rests_the_play_costs_nothing():
    """Up, a rest of 0.1 s, and down."""
    motion = through(np.array([[0.0], [3e-4], [3e-4], [0.0]]), np.zeros((4, 1)), np.array([0.0, 0.1, 0.2, 0.3]))
    (axis,) = axes(motion, ("backlash",))
    made = compensated(motion, [axis], np.zeros(1))
    assert made.costs[0].crossings == 1
    assert made.costs[0].off < 1e-15
    assert made.at(np.array([0.3])).q[0, 0] == pytest.approx(-axis.backlash, abs=1e-15)


def test_a_first_move_towards_smaller_positions_crosses_the_play_too():
    motion = through(np.array([[0.0], [-3e-4]]), np.zeros((2, 1)), np.array([0.0, 0.1]))
    (axis,) = axes(motion, ("backlash",))
    schedule = generate(motion, [axis], [0.0])
    assert schedule.axes[0].final == round((-3e-4 - axis.backlash) / PULSE)


def test_trembling_by_less_than_half_a_pulse_is_no_reversal():
    t = np.linspace(0, 1, 41)
    q, v = 2e-5 * t + 0.2 * PULSE * np.sin(200 * t), 2e-5 + 40 * PULSE * np.cos(200 * t)
    motion = through(q[:, None], v[:, None], t)
    assert (v < 0).any()
    (axis,) = axes(motion, ("backlash",))
    assert compensated(motion, [axis], np.zeros(1)).costs[0].crossings == 0


def test_nothing_to_compensate_is_the_motion_itself():
    motion = example(0)
    assert compensated(motion, axes(motion, ()), np.zeros(3)) is None
    plain = generate(motion, axes(motion, ()), np.zeros(3))
    none = generate(motion, axes(motion, ("backlash",), backlash=0.0), np.zeros(3))
    assert all((a.ticks == b.ticks).all() for a, b in zip(plain.axes, none.axes, strict=True))


def test_a_screw_that_runs_back_is_refused():
    motion, home = in_pulses([1.0, 0.0])
    axis = Axis("x", pulse=PULSE, lead_error=((0, 0), (1e-6, -2e-6)), compensate=("lead",))
    with pytest.raises(MotionError, match="axis x: its lead error falls"):
        generate(motion, [axis], home)


def test_a_kind_of_compensation_that_there_is_not_is_refused():
    with pytest.raises(MotionError, match="'screw' is none of lead, backlash"):
        Axis("x", compensate=("screw",))


def test_a_steady_motion_over_a_corner_of_the_table_is_met_on_both_sides():
    """A knot lies on a point of the table only to rounding: the time says on which side of it a state is."""
    for speed in np.linspace(1e-3, 2e-3, 25):
        motion = through(np.array([[0.0], [speed * 0.3]]), np.full((2, 1), speed), np.array([0.0, 0.3]))
        (axis,) = axes(motion, ("lead",))
        assert generate(motion, [axis], [0.0]).total > 0


def test_more_pulses_than_the_axis_takes_are_refused():
    """A screw that runs short by 1 % asks for 1 % more pulses than the motion itself."""
    motion = through(np.array([[0.0], [3e-4]]), np.full((2, 1), 1e-3), np.array([0.0, 0.3]))
    axis = Axis("x", pulse=PULSE, lead_error=((0.0, 0.0), (1e-3, -1e-5)), compensate=("lead",))
    rate = 1e-3 / PULSE
    generate(motion, [replace(axis, max_pulse_rate=1.011 * rate)], [0.0])
    with pytest.raises(Infeasible, match="with lead made up for") as no:
        generate(motion, [replace(axis, max_pulse_rate=rate)], [0.0])
    assert no.value.value == pytest.approx(rate / 0.99, rel=1e-3)
