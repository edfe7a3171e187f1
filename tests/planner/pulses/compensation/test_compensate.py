"""Compensation: behind a simulated screw and its play, the axis is where the motion says, as far as
it is stated.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics import Axis, MotionError, Traverser, load_machine
from planner import Dwell, Infeasible, Line, Program, plan
from planner.export.format import ExportSource
from planner.export.formats.g93 import InverseTime
from planner.pulses import check, generate
from planner.pulses.compensation import compensate
from planner.pulses.compensation.compensate import compensate_motion
from tests.planner.motions import PULSE, example, in_pulses, one_axis, through

TABLE = ((0.0, 0.0), (1e-4, 3e-6), (2e-4, -2e-6), (4e-4, 1e-6))


def axis_position(u, backlash):
    """Behind play: the axis stays until the motor pushes it, from either side; it began pushed
    towards greater q.
    """
    axis = np.empty_like(u)
    at = u[0]
    for i, motor in enumerate(u):
        at = min(max(at, motor), motor + backlash)
        axis[i] = at
    return axis


def behind(counted, home, axis):
    """Where a counted position leaves the axis: through the play, and through a screw linear
    between its points.
    """
    u = counted - home
    if "backlash" in axis.compensate:
        u = axis_position(u, axis.backlash)
    if "lead" in axis.compensate:
        u = u + np.interp(u, *np.array(axis.lead_error).T)
    return home + u


def axes(motion, kinds, backlash=5e-6):
    n = motion.at(np.zeros(1)).q.shape[1]
    common = {
        "pulse": PULSE,
        "max_speed": 0.05,
        "max_acceleration": 5.0,
        "backlash": backlash,
        "lead_error": TABLE,
    }
    return [Axis(f"leg{k}", compensate=kinds, **common) for k in range(n)]


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 1000), st.sampled_from([("lead",), ("backlash",), ("lead", "backlash")]))
def test_behind_screw_and_play_the_axis_is_where_it_should_be(seed, kinds):
    motion = example(seed)
    home = motion.at(np.zeros(1)).q[0] - 1e-4
    driven = axes(motion, kinds)
    made = compensate_motion(motion, driven, home)
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
    made = compensate_motion(motion, axes(motion, ("lead", "backlash")), home)
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
    made = compensate_motion(motion, driven, home)
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
    motion = through(
        np.array([[0.0], [3e-4], [3e-4], [0.0]]), np.zeros((4, 1)), np.array([0.0, 0.1, 0.2, 0.3])
    )
    (axis,) = axes(motion, ("backlash",))
    made = compensate_motion(motion, [axis], np.zeros(1))
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
    assert compensate_motion(motion, [axis], np.zeros(1)).costs[0].crossings == 0


def zigzag(*ways, time=0.1, rest=0.0):
    """One axis from rest to rest at constant accelerations ±a (a quarter of the way each is
    a·time²/16), rests between.

    At every turn without a rest its acceleration is the largest that it has.
    """
    pieces, knots, at = [], [0.0], 0.0
    for way in ways:
        if rest and pieces:
            pieces.append([0.0, 0.0, at])
            knots.append(knots[-1] + rest)
        half, a = time / 2, 4 * way / time**2
        pieces += [[a / 2, 0.0, at], [-a / 2, a * half, at + way / 2]]
        knots += [knots[-1] + half, knots[-1] + time]
        at += way
    return one_axis(pieces, knots)


def most(made, t, name):
    return abs(getattr(made.at(t), name)).max()


def crossing(made, n=2001):
    """Instants during which the play is crossed, and those just beside the knots there."""
    start, time, _ = made.steps[0].T
    inside = made.knots[(made.knots >= start[0]) & (made.knots <= start[-1] + time[-1])]
    t = (start[:, None] + time[:, None] * np.linspace(0, 1, n)).ravel()
    return np.concatenate([t, np.nextafter(inside, 0), inside])


def test_at_rest_motor_and_screw_take_the_play_up_as_fast_as_the_limits_let_them():
    """10 b/√3 T² = a, 15 b/8 T = v, 60 b/T³ = j: the smooth step alone, at whichever takes
    longest.
    """
    motion = zigzag(1e-3, -1e-3, rest=0.1)
    for limits, time in (
        ({"max_acceleration": 1.0}, np.sqrt(10 / np.sqrt(3) * 5e-6)),
        ({"max_acceleration": (2.0, 1.0)}, np.sqrt(10 / np.sqrt(3) * 5e-6)),
        (
            {"max_acceleration": 1.0, "take_up_acceleration": 4.0},
            np.sqrt(10 / np.sqrt(3) * 5e-6) / 2,
        ),
        ({"max_speed": 5e-4}, 15 / 8 * 5e-6 / 5e-4),
        ({"max_acceleration": 1.0, "max_jerk": 2.0}, np.cbrt(60 * 5e-6 / 2.0)),
    ):
        axis = Axis("x", pulse=PULSE, backlash=5e-6, compensate=("backlash",), **limits)
        made = compensate_motion(motion, [axis], np.zeros(1))
        assert made.steps[0][0].tolist() == pytest.approx([0.2 - time, time, -5e-6], rel=1e-9)
        assert made.costs[0].off < 1e-12
        assert made.costs[0].max_speed == limits.get("max_speed")
        assert made.costs[0].jerk == pytest.approx(60 * 5e-6 / time**3)


def test_where_there_is_no_rest_jerk_is_told_and_costs_no_time():
    """∛(60 b/j) = 42 ms would leave the axis off by 0.4 m/s² · (42 ms)²/8 = 89 µm, for 5 µm of
    play.
    """
    motion = zigzag(1e-3, -1e-3)
    axis = Axis(
        "x",
        pulse=PULSE,
        max_acceleration=0.8,
        max_jerk=4.0,
        backlash=5e-6,
        compensate=("backlash",),
    )
    (cost,) = compensate_motion(motion, [axis], np.zeros(1)).costs
    (same,) = compensate_motion(motion, [replace(axis, max_jerk=None)], np.zeros(1)).costs
    assert cost == same
    assert cost.jerk > 4.0


def test_a_motion_at_its_limit_while_it_turns_leaves_no_room_and_is_refused():
    motion = zigzag(1e-3, -1e-3)  # at 0.4 m/s² throughout
    axis = Axis("x", pulse=PULSE, max_acceleration=0.4, backlash=5e-6, compensate=("backlash",))
    with pytest.raises(
        Infeasible, match=r"x, s = .*, t = 0\.\d+ s; .* 5 µm of play where x turns: let it rest"
    ) as no:
        generate(motion, [axis], [0.0])
    told = no.value
    assert (told.kind, told.axis, told.limit, told.unit) == (
        "acceleration with play taken up",
        "x",
        0.4,
        "m/s^2",
    )
    assert abs(told.place.t - 0.1) < 0.02
    assert 0.4 < told.value < 0.8
    # what the remedy says: a rest of that time, or a motor that does more with no load on it
    rest = float(told.remedy.partition("rest there for ")[2].split()[0])
    assert (
        generate(zigzag(1e-3, -1e-3, rest=rest * 1.001), [axis], [0.0]).compensations[0].off < 1e-9
    )
    assert "state a take_up_acceleration" in told.remedy
    lighter = replace(axis, take_up_acceleration=1.2)
    (cost,) = generate(motion, [lighter], [0.0]).compensations
    assert cost.acceleration == pytest.approx(1.2, rel=0.2)
    assert cost.acceleration <= cost.max_acceleration == 1.2
    made = compensate_motion(motion, [lighter], np.zeros(1))
    assert most(made, crossing(made), "qdd") == pytest.approx(cost.acceleration, rel=1e-3)


def test_where_a_motion_turns_gently_the_take_up_is_made_longer():
    """Alone it would take √(10 b/√3 a); with the motion's own 0.4 m/s² it has what is left."""
    motion = zigzag(1e-3, -1e-3)
    axis = Axis("x", pulse=PULSE, max_acceleration=0.8, backlash=5e-6, compensate=("backlash",))
    made = compensate_motion(motion, [axis], np.zeros(1))
    time, cost = made.steps[0][0, 1], made.costs[0]
    exactly = np.sqrt(10 / np.sqrt(3) * 5e-6 / (0.8 - 0.4))
    assert exactly <= time <= 1.1 * exactly
    assert cost.off == pytest.approx(0.4 * (time / 2) ** 2 / 2, rel=1e-6)
    assert cost.off < axis.backlash


def test_a_speed_beyond_the_limit_is_refused_too():
    """An axis that runs at its limit and turns within the time that the play takes."""
    motion = zigzag(4e-5, -4e-5, 4e-5, time=4e-3)  # up to 20 mm/s
    axis = Axis("x", pulse=PULSE, max_speed=8e-3, backlash=3e-5, compensate=("backlash",))
    with pytest.raises(Infeasible, match="speed with play taken up") as no:
        compensate_motion(motion, [axis], np.zeros(1))
    assert no.value.limit == 8e-3
    assert "take_up_acceleration" not in no.value.remedy


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 10_000),
    st.floats(0.02, 0.3),
    st.floats(0.3, 30.0),
    st.sampled_from([2e-6, 2e-5]),
)
def test_motion_and_take_up_together_keep_the_limits_or_are_refused(
    seed, speed, acceleration, backlash
):
    motion = example(seed)
    home = motion.at(np.zeros(1)).q[0]
    limits = {"max_speed": speed, "max_acceleration": (acceleration, 2 * acceleration)}
    driven = [
        Axis(f"leg{k}", pulse=PULSE, backlash=backlash, compensate=("backlash",), **limits)
        for k in range(3)
    ]
    try:
        made = compensate_motion(motion, driven, home)
    except Infeasible:
        # twice the motion's own acceleration a on top of it is enough: b 10/√3 T² = 2 a is off by a
        # T²/8 = 0.36 b
        assert acceleration < 3 * abs(motion.at(np.linspace(0, motion.duration, 2001)).qdd).max()
        return
    for k, (steps, cost) in enumerate(zip(made.steps, made.costs, strict=True)):
        t = (steps[:, :1] + steps[:, 1:2] * np.linspace(0, 1, 501)).ravel()
        state = made.at(t)
        # between the places that were looked at, 1/64 of a step apart, a parabola's top is higher
        # by (π/128)²/2 at most
        assert abs(state.qd[:, k]).max() <= speed * (1 + 1e-3)
        assert (-acceleration * (1 + 1e-3) <= state.qdd[:, k]).all()
        assert (state.qdd[:, k] <= 2 * acceleration * (1 + 1e-3)).all()
        q = motion.at(t).q[:, k].reshape(len(steps), -1)
        assert np.ptp(q, axis=1).max() <= cost.off * (1 + 1e-12)


def test_a_rest_that_rounding_moves_is_a_rest():
    """A dwell whose two ends differ in the last digits."""
    motion = zigzag(1e-3, -1e-3, rest=0.1)
    rough = one_axis(
        [[0, 5e-3, 0.2], [0, 1e-15, 0.2005], [0, -5e-3, 0.2005 + 1e-16]], [0, 0.1, 0.2, 0.3]
    )
    axis = Axis("x", pulse=PULSE, max_acceleration=0.4, backlash=5e-6, compensate=("backlash",))
    for each in (motion, rough):
        assert compensate_motion(each, [axis], np.zeros(1)).steps[0][0, :2].sum() == pytest.approx(
            0.2, abs=1e-9
        )


def test_a_run_back_that_turns_nothing_is_told():
    motion = zigzag(1e-4, -0.4 * PULSE, 1e-4, -0.2 * PULSE)
    (axis,) = axes(motion, ("backlash",))
    (cost,) = compensate_motion(motion, [axis], np.zeros(1)).costs
    assert cost.crossings == 0
    assert cost.unturned == pytest.approx(0.4 * PULSE, rel=1e-6)
    (turned,) = compensate_motion(zigzag(1e-4, -0.6 * PULSE, 1e-4), [axis], np.zeros(1)).costs
    assert (turned.crossings, turned.unturned) == (2, 0.0)


def test_nothing_to_compensate_is_the_motion_itself():
    motion = example(0)
    assert compensate_motion(motion, axes(motion, ()), np.zeros(3)) is None
    plain = generate(motion, axes(motion, ()), np.zeros(3))
    none = generate(motion, axes(motion, ("backlash",), backlash=0.0), np.zeros(3))
    assert all((a.ticks == b.ticks).all() for a, b in zip(plain.axes, none.axes, strict=True))


def test_a_screw_that_runs_back_is_refused():
    motion, home = in_pulses([1.0, 0.0])
    axis = Axis("x", pulse=PULSE, lead_error=((0, 0), (1e-6, -2e-6)))
    assert generate(motion, [axis], home).total
    with pytest.raises(MotionError, match="axis x: its lead error falls"):
        replace(axis, compensate=("lead",))


def test_a_kind_of_compensation_that_there_is_not_is_refused():
    with pytest.raises(MotionError, match="'screw' is none of lead, backlash"):
        Axis("x", compensate=("screw",))


def test_a_steady_motion_over_a_corner_of_the_table_is_met_on_both_sides():
    """A knot lies on a point of the table only to rounding: the time says on which side of it a
    state is.
    """
    for speed in np.linspace(1e-3, 2e-3, 25):
        motion = through(
            np.array([[0.0], [speed * 0.3]]), np.full((2, 1), speed), np.array([0.0, 0.3])
        )
        (axis,) = axes(motion, ("lead",))
        assert generate(motion, [axis], [0.0]).total > 0


SHORT = ((-0.2, 2e-3), (0.2, -2e-3))
"""A screw that runs short by 1 %: its motor makes 1 % more pulses than the axis' way."""


def test_more_pulses_than_the_axis_takes_are_refused():
    motion = through(np.array([[0.0], [3e-4]]), np.full((2, 1), 1e-3), np.array([0.0, 0.3]))
    axis = Axis("x", pulse=PULSE, lead_error=SHORT, compensate=("lead",))
    rate = 1e-3 / PULSE
    generate(motion, [replace(axis, max_pulse_rate=1.011 * rate)], [0.0])
    with pytest.raises(Infeasible, match="with lead made up for") as no:
        generate(motion, [replace(axis, max_pulse_rate=rate)], [0.0])
    assert no.value.value == pytest.approx(rate / 0.99, rel=1e-3)


@pytest.mark.parametrize(
    "limit", [{"max_pulse_rate": 5e3}, {"max_speed": 0.05}, {"max_speed": (0.05, 0.2)}]
)
def test_limits_of_speed_and_rate_are_the_motor_s_behind_its_screw(limit):
    """Planned to 1 % below them, and its motor at them: nothing is refused, and the certificate
    says 1.
    """
    stated = {"pulse": 1e-5, "travel": (-1.0, 1.0), "max_speed": 0.2, "max_acceleration": 0.5}
    axes = [Axis(name, **stated) for name in "XYZ"]
    axes[0] = replace(axes[0], lead_error=SHORT, compensate=("lead",), **limit)
    rotary = Axis(
        "R", kind="rotary", pulse=1e-4, travel=(-4.0, 4.0), max_speed=1.0, max_acceleration=2.0
    )
    machine = Traverser(axes=[*axes, rotary], home=load_machine("traverser").home)
    planned = plan(Program((Line([-0.06, 0, 0]), Line([0.06, 0, 0]), Line([-0.06, 0, 0]))), machine)
    t = np.linspace(0, planned.trajectory.duration, 4001)
    axis, motor = (abs(each.at(t).qd[:, 0]).max() for each in (planned.trajectory, planned.counted))
    most = min(0.05, *np.atleast_1d(limit.get("max_speed", 0.05)))
    back = planned.counted.at(t).qd[:, 0].min()
    assert -back == pytest.approx(most, rel=1e-6)
    assert motor == pytest.approx(axis / 0.99, rel=1e-6)
    name = "pulse rate" if "max_pulse_rate" in limit else "speed"
    assert planned.certificate.worst[name] == pytest.approx(1.0, abs=1e-6)
    assert check(planned.pulses, planned.counted, machine.axes, machine.home_q).holds


def test_the_play_is_crossed_no_faster_than_the_pulses_may():
    """15/8 · 5 µm in the time that 1000 pulses a second leave, at rest."""
    motion = zigzag(1e-4, -1e-4, rest=0.1)
    axis = Axis("x", pulse=PULSE, max_pulse_rate=4e3, backlash=5e-6, compensate=("backlash",))
    schedule = generate(motion, [axis], [0.0])
    assert schedule.compensations[0].speed == pytest.approx(4e3 * PULSE)
    assert schedule.smallest_interval >= 10_000_000 // 4000


def test_what_a_refusal_of_the_take_up_advises_is_enough_and_hardly_more():
    """The rest as it is printed, the acceleration as it is printed; and a thousandth less is
    not.
    """
    axis = Axis("x", pulse=PULSE, max_acceleration=0.4, backlash=1.03e-5, compensate=("backlash",))
    with pytest.raises(Infeasible) as no:
        generate(zigzag(1e-3, -1e-3), [axis], [0.0])
    rest = float(no.value.remedy.partition("rest there for ")[2].split()[0])
    assert generate(zigzag(1e-3, -1e-3, rest=rest), [axis], [0.0]).total
    with pytest.raises(Infeasible):
        generate(zigzag(1e-3, -1e-3, rest=rest * (1 - 2e-3)), [axis], [0.0])
    enough = float(no.value.remedy.partition("take_up_acceleration of ")[2].split()[0])
    assert generate(zigzag(1e-3, -1e-3), [replace(axis, take_up_acceleration=enough)], [0.0]).total
    with pytest.raises(Infeasible):
        generate(
            zigzag(1e-3, -1e-3), [replace(axis, take_up_acceleration=enough * (1 - 1e-3))], [0.0]
        )


def test_a_first_move_against_the_side_that_was_homed_is_told_both_cures():
    motion = zigzag(-1e-3)
    axis = Axis("x", pulse=PULSE, max_acceleration=0.4, backlash=5e-6, compensate=("backlash",))
    with pytest.raises(
        Infeasible, match=r'before x first moves: .* with a dwell of .* s, state pushed = "-" if'
    ) as no:
        generate(motion, [axis], [0.0])
    dwell = float(no.value.remedy.partition("dwell of ")[2].split()[0])
    waits = one_axis(
        [[0.0, 0.0, 0.0], [-0.2, 0.0, 0.0], [0.2, -0.02, -5e-4]],
        [0, dwell, dwell + 0.05, dwell + 0.1],
    )
    assert generate(waits, [axis], [0.0]).compensations[0].crossings == 1
    pushed = generate(motion, [replace(axis, pushed="-")], [0.0])
    assert pushed.compensations[0].crossings == 0
    assert pushed.axes[0].final == round(-1e-3 / PULSE)
    up = generate(
        zigzag(1e-3, rest=0.1), [replace(axis, pushed="-", take_up_acceleration=4.0)], [0.0]
    )
    assert up.axes[0].final == round((1e-3 + 5e-6) / PULSE)


def test_compensation_is_made_once(monkeypatch, tmp_path):
    """By a plan, however often its pulses, its check and its path ask for it; by a source of
    exports once more.
    """
    made = []
    monkeypatch.setattr(
        compensate,
        "compensate_motion",
        lambda *of, true=compensate_motion: made.append(of) or true(*of),
    )
    stated = {
        "pulse": 1e-5,
        "travel": (-1.0, 1.0),
        "max_speed": 0.2,
        "max_acceleration": 0.5,
        "backlash": 1e-5,
    }
    axes = [Axis(name, compensate=("backlash",), **stated) for name in "XYZ"]
    rotary = Axis(
        "R", kind="rotary", pulse=1e-4, travel=(-4.0, 4.0), max_speed=1.0, max_acceleration=2.0
    )
    machine = Traverser(axes=[*axes, rotary], home=load_machine("traverser").home)
    planned = plan(Program((Line([0.02, 0.01, 0]), Dwell(0.1), Line([0, 0, 0]))), machine)
    assert check(planned.pulses, planned.counted, machine.axes, machine.home_q).holds
    assert planned.realised(stride=100)["x"].share <= 1 + 1e-3
    assert len(made) == 1
    InverseTime().write(
        ExportSource("once", machine, planned.trajectory, planned.pulses), tmp_path / "once.ngc"
    )
    assert len(made) == 2
