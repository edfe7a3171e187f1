"""The main job on the hexapod: durations, limits and pulses by arithmetic of the tests' own, and
refusals.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import Hexapod, MotionError
from planner import Arc, Dwell, Infeasible, Line, Program, Turn, check, load_program, plan
from planner.pulses import check as check_pulses

SPEED, ACCELERATION, JERK = 0.02, 0.225, 4.0  # of the preset hexapod: m/s, m/s², m/s³
STROKE, TILT, PULSE = 0.0508, np.deg2rad(35), 0.75e-6
SHORT = Program([Line([0, 0, 0.002])])
BOTH = [(name, order) for name in ("bare-circle", "circle") for order in (2, 3)]


@pytest.fixture(scope="module", params=BOTH, ids=lambda case: f"{case[0]}-{case[1]}")
def planned_case(request, planned):
    return planned(*request.param)


def instants(trajectory, count, seed=0):
    return np.sort(np.random.default_rng(seed).uniform(0, trajectory.duration, count))


def poses(trajectory, t):
    """Positions (N, 3) and rotation matrices (N, 3, 3)."""
    pose = trajectory.at(t).pose
    return pose.translation, pose.rotation.as_matrix()


def own_machine(hexapod, axes=None, max_tilt=TILT):
    return Hexapod(
        hexapod.base,
        hexapod.platform,
        axes=axes or hexapod.axes,
        home=hexapod.home,
        max_tilt=max_tilt,
        name="own",
    )


@pytest.mark.parametrize(("order", "least", "most"), [(2, 1.2035, 1.2046), (3, 1.2610, 1.2618)])
def test_the_bare_circle_takes_as_long_as_independent_solves_say(planned, order, least, most):
    """toppra at 4000 points: 1.2040 s; jerk-limited solves on graded grids: 1.2615 to 1.2617 s.
    Faster is a fault.
    """
    assert least <= planned("bare-circle", order).trajectory.duration <= most


def test_certificates_hold(planned_case):
    certificate = planned_case.certificate
    assert certificate.holds
    assert (
        {"speed", "acceleration", "travel", "tilt"}
        <= set(certificate.worst)
        == set(certificate.where)
    )
    assert ("jerk" in certificate.worst) == (planned_case.order == 3)
    assert max(certificate.worst.values()) <= 1 + 1e-6
    # a time-optimal motion uses what it may
    assert certificate.worst["speed"] > 0.999
    assert certificate.worst["acceleration"] > 0.999


def test_lengths_are_those_of_the_pose(planned_case, own_lengths):
    """1e-15 m is four roundings of a leg's length, at 20 000 instants."""
    trajectory = planned_case.trajectory
    state = trajectory.at(instants(trajectory, 20_000))
    pose = state.pose
    assert np.abs(state.q - own_lengths(pose.translation, pose.rotation.as_matrix())).max() < 1e-15


def test_limits_hold_in_lengths_recomputed_and_differenced(planned_case, own_lengths):
    """Central differences of lengths at 40 000 instants of the bare circle; only poses are asked
    of the package.

    A k-th difference over steps h is a weighted mean of the k-th derivative: within a limit where
    that is, without an error of truncation. Rounding adds 2ᵏ · 2e-16 m / hᵏ: below 2e-7 of each
    limit with the steps chosen.
    """
    trajectory = planned_case.trajectory
    t = instants(trajectory, 40_000 if planned_case.program.name == "bare-circle" else 20_000)

    def lengths(shift):
        return own_lengths(*poses(trajectory, t + shift))

    h = 2e-5
    speed = np.abs(lengths(h / 2) - lengths(-h / 2)).max() / h
    assert 0.999 < speed / SPEED <= 1 + 1e-6 + 2e-7
    h = 3e-4
    acceleration = np.abs(lengths(h) - 2 * lengths(0.0) + lengths(-h)).max() / h**2
    assert 0.98 < acceleration / ACCELERATION <= 1 + 1e-6 + 2e-7
    if planned_case.order == 3:
        h = 2e-3
        jerk = (
            np.abs(
                lengths(1.5 * h) - 3 * lengths(h / 2) + 3 * lengths(-h / 2) - lengths(-1.5 * h)
            ).max()
            / h**3
        )
        assert 0.9 < jerk / JERK <= 1 + 1e-6 + 2e-7


def test_travel_tilt_and_tool_speed_hold_too(planned_case, own_legs):
    trajectory = planned_case.trajectory
    t = instants(trajectory, 20_000)
    position, rotation = poses(trajectory, t)
    legs = own_legs(position, rotation)
    lengths = np.linalg.norm(legs, axis=2)
    stroke = lengths - np.linalg.norm(
        own_legs(np.array([[0, 0, 0.2336362]]), np.eye(3)[None]), axis=2
    )
    used = np.abs(stroke - STROKE / 2).max() / (STROKE / 2)
    # 1e-6 above what is proved, and what lies between samples 0.6 ms apart
    assert planned_case.certificate.worst["travel"] == pytest.approx(used, abs=2e-6)
    up = np.stack([np.broadcast_to([0, 0, 1.0], position.shape), rotation[:, :, 2]], 1)
    tilt = np.arccos(np.einsum("nej,nkj->nek", up, legs) / lengths[:, None]).max()
    assert tilt <= TILT
    assert planned_case.certificate.worst["tilt"] == pytest.approx(tilt / TILT, abs=2e-6)
    if "tool speed" in planned_case.certificate.worst:
        h = 1e-5
        speed = (
            np.linalg.norm(
                poses(trajectory, t + h / 2)[0] - poses(trajectory, t - h / 2)[0], axis=1
            )
            / h
        )
        segment = np.array(
            [planned_case.path.segment(int(piece)) for piece in trajectory.at(t).piece]
        )
        capped = speed[segment == 3] / 0.03  # the preset's only cap, of its flat circle
        assert 0.999 < capped.max() <= 1 + 1e-6 + 1e-8


def test_derivatives_belong_to_their_positions(planned_case):
    """q̇, q̈ and q⃛ by Simpson's rule over each time piece give back what lies at its ends: q, q̇
    and q̈.
    """
    trajectory = planned_case.trajectory
    h = np.diff(trajectory.knots)
    k = np.arange(len(h))
    start, middle, end = (trajectory.within(k, h * share) for share in (0.0, 0.5, 1.0))
    for value, rate in (("q", "qd"), ("qd", "qdd"), ("qdd", "qddd")):
        change = (
            (getattr(start, rate) + 4 * getattr(middle, rate) + getattr(end, rate)) * h[:, None] / 6
        )
        error = np.abs(getattr(end, value) - getattr(start, value) - change).max()
        # Simpson's rule is exact for cubics: what a piece of a millisecond adds beyond is far below
        # a millionth
        assert error < 1e-6 * np.ptp(getattr(start, value))


def test_the_motion_rests_before_and_after(planned_case):
    trajectory = planned_case.trajectory
    state = trajectory.at(np.array([-1.0, 0.0, trajectory.duration, trajectory.duration + 1.0]))
    assert (state.q[0] == state.q[1]).all()
    assert (state.q[2] == state.q[3]).all()
    for rate in (state.qd, state.qdd, state.qddd):
        assert (rate[[0, 3]] == 0).all()
    assert np.abs(state.qd[[1, 2]]).max() < 1e-9 * SPEED
    if planned_case.order == 3:
        assert np.abs(state.qdd[[1, 2]]).max() < 1e-9 * ACCELERATION


def test_pulses_follow_the_motion(planned_case, own_lengths):
    """|count·pulse − (q − home)| ≤ ½ pulse + one tick's travel at 20 000 random instants; the
    checker agrees.
    """
    trajectory, pulses = planned_case.trajectory, planned_case.pulses
    t = instants(trajectory, 20_000, seed=1)
    home = own_lengths(np.array([[0, 0, 0.2336362]]), np.eye(3)[None])
    offset = own_lengths(*poses(trajectory, t)) - home
    error = np.abs(pulses.counts(t) * PULSE - offset)
    assert (error <= PULSE / 2 + SPEED / pulses.clock_hz).all()
    assert error.max() > 0.49 * PULSE  # it is a rounding, and no finer
    last = own_lengths(*poses(trajectory, np.array([trajectory.duration]))) - home
    assert (pulses.counts(trajectory.duration) == np.round(last / PULSE)).all()
    verdict = check_pulses(pulses, trajectory)
    assert verdict.holds
    assert verdict.final_error <= 0.5


def test_a_dwell_is_a_rest_of_its_length(hexapod):
    moves = [Line([0, 0, 0.002]), Line([0, 0, 0.004])]
    first, both = (
        plan(Program(part), hexapod, order=2).trajectory.duration for part in (moves[:1], moves)
    )
    rested = plan(
        Program([Dwell(0.1), moves[0], Dwell(0.25), moves[1], Dwell(0.5)]), hexapod, order=2
    ).trajectory
    assert rested.duration == pytest.approx(both + 0.85, rel=1e-12)
    for start, length, height in (
        (0.0, 0.1, 0.0),
        (0.1 + first, 0.25, 2.0),
        (rested.duration - 0.5, 0.5, 4.0),
    ):
        state = rested.at(start + length * np.linspace(0.001, 0.999, 5))
        assert (state.qd == 0).all()
        assert (state.qdd == 0).all()
        assert (state.pose.translation - hexapod.home.translation)[:, 2] * 1e3 == pytest.approx(
            [height] * 5, abs=1e-9
        )


def test_order_is_three_where_the_machine_states_jerk(hexapod):
    free = own_machine(hexapod, [replace(axis, max_jerk=None) for axis in hexapod.axes])
    assert plan(SHORT, free).order == 2
    one = own_machine(hexapod, [*free.axes[:5], hexapod.axes[5]])
    found = plan(SHORT, one)
    assert found.order == 3
    assert found.certificate.holds
    assert plan(SHORT, one, order=2).order == 2


def test_limits_of_each_axis_are_its_own(hexapod):
    """Leg 3 at half speed: on the way straight up, where all legs move alike, the whole takes as
    long as it needs.
    """
    slow = [
        replace(axis, max_speed=SPEED / 2) if axis.name == "leg3" else axis for axis in hexapod.axes
    ]
    up = Program([Line([0, 0, 0.03])])
    found, reference = (
        plan(up, own_machine(hexapod, axes), order=2) for axes in (slow, hexapod.axes)
    )
    assert found.certificate.where["speed"].axis == "leg3"
    all_slow = plan(
        up, own_machine(hexapod, [replace(axis, max_speed=SPEED / 2) for axis in slow]), order=2
    )
    assert found.trajectory.duration == pytest.approx(all_slow.trajectory.duration, rel=1e-9)
    assert found.trajectory.duration > 1.5 * reference.trajectory.duration


def strokes(own_lengths, position, rotation=None):
    """Leg lengths beyond home's (N, 6), m, at places (N, 3) relative to home."""
    at = np.array([0, 0, 0.2336362]) + np.atleast_2d(position)
    turned = np.repeat((np.eye(3) if rotation is None else rotation.as_matrix())[None], len(at), 0)
    return own_lengths(at, turned) - own_lengths(np.array([[0, 0, 0.2336362]]), np.eye(3)[None])


@pytest.mark.parametrize(
    ("to", "rotate", "limit"),
    [
        ([0, 0, 0.06], None, STROKE),
        ([0.005, 0.0, 0.005], Rotation.from_euler("XYZ", [0, 20, 0], degrees=True), 0.0),
    ],
)
def test_travel_beyond_its_end_is_refused(hexapod, own_lengths, to, rotate, limit, limit_search):
    limit_search(0.0)
    with pytest.raises(Infeasible) as refusal:
        plan(Program([Line([0, 0, 0.01]), Dwell(0.1), Line(to, rotate)]), hexapod)
    error, stroke = refusal.value, strokes(own_lengths, to, rotate)[0]
    worst = int(np.argmax(np.abs(stroke - STROKE / 2)))
    assert (error.kind, error.unit, error.axis) == ("travel", "mm", error.place.axis)
    assert stroke[int(error.axis[-1]) - 1] == pytest.approx(
        stroke[worst], abs=1e-12
    )  # legs may be used alike
    assert error.value == pytest.approx(stroke[worst] * 1e3, abs=1e-9)
    assert error.limit == pytest.approx(limit * 1e3, abs=1e-9)
    assert error.place.segment == 3
    # worst at the end of the way
    assert error.place.s == pytest.approx(
        0.01 + np.linalg.norm(np.subtract(to, [0, 0, 0.01])), abs=1e-12
    )
    for phrase in (
        "travel",
        error.axis,
        "segment 3",
        "mm",
        "slowing down cannot fix",
        "move the path",
    ):
        assert phrase in str(error)


def test_tilt_beyond_its_limit_is_refused(hexapod, own_legs, limit_search):
    limit_search(0.0)
    limit = np.deg2rad(15)
    machine = own_machine(hexapod, max_tilt=limit)
    program = Program([Line([0, 0, 0.025]), Line([0.025, 0, 0.025])])
    with pytest.raises(Infeasible) as refusal:
        plan(program, machine)
    error = refusal.value
    assert str(check(program, machine).violations[0]) == str(error)
    legs = own_legs(np.array([[0.025, 0, 0.2586362]]), np.eye(3)[None])[0]
    tilt = np.rad2deg(np.arccos(legs[:, 2] / np.linalg.norm(legs, axis=1)))
    assert (error.kind, error.unit) == ("tilt", "deg")
    assert error.axis in {
        f"leg{1 + leg} {end} joint" for leg in range(6) for end in ("base", "platform")
    }
    assert error.value == pytest.approx(tilt.max(), abs=1e-9)
    assert tilt[int(error.axis[3]) - 1] == pytest.approx(tilt.max(), abs=1e-9)
    assert error.limit == pytest.approx(15.0)
    assert error.place.segment == 2
    assert f"{error.value - 15:.4g} deg less" in str(error)


def test_travel_exceeded_between_the_points_looked_at_is_refused_all_the_same(hexapod, own_lengths):
    """Twenty turns in one arc: evenly spaced points see few places of the circle; the proof sees
    the rest.
    """
    start = RigidTransform.from_components(
        [0.015 * np.cos(0.1), 0.015 * np.sin(0.1), 0.025], Rotation.identity()
    )
    program = Program([Arc([0, 0, 0.025], [0, 0, 1], 40 * np.pi)], start=start)

    def highest(points):
        phi = 0.1 + np.linspace(0, 2 * np.pi, points)
        at = np.stack([0.015 * np.cos(phi), 0.015 * np.sin(phi), np.full(points, 0.025)], 1)
        return strokes(own_lengths, at).max()

    end = highest(11) + 1e-9
    assert highest(10_001) > end + 1e-5
    machine = own_machine(hexapod, [replace(axis, travel=(0.0, end)) for axis in hexapod.axes])
    assert check(program, machine).violations
    with pytest.raises(Infeasible) as refusal:
        plan(program, machine, order=2)
    assert refusal.value.kind == "travel"
    assert refusal.value.place.segment == 1
    # said as everywhere: the stroke from home, and the end of travel
    assert refusal.value.limit == pytest.approx(end * 1e3, abs=1e-6)
    assert refusal.value.value == pytest.approx(highest(10_001) * 1e3, abs=1e-4)


def test_check_lists_everything_the_worst_first(hexapod):
    program = Program([Line([0, 0, 0.055]), Line([0, 0, 0.07]), Line([0, 0, 0.02])])
    found = check(program, hexapod).violations
    assert {error.place.segment for error in found} == {1, 2, 3}
    assert len(found) == 18  # every leg, in every segment
    excess = [abs(error.value - STROKE / 2 * 1e3) for error in found]
    assert np.diff(excess).max() <= 1e-9  # legs that are alike are told in some order
    assert check(Program([Line([0, 0, 0.02])]), hexapod).violations == ()


def test_a_program_may_start_anywhere_and_end_elsewhere(hexapod):
    start = RigidTransform.from_components(
        [0.003, -0.004, 0.02], Rotation.from_euler("XYZ", [2, 3, 4], degrees=True)
    )
    found = plan(
        Program([Turn(Rotation.identity()), Line([0, 0, 0.021])], start=start), hexapod, order=2
    )
    state = found.trajectory.at(np.array([0.0, found.trajectory.duration]))
    ends = (
        hexapod.inverse(hexapod.home * start),
        hexapod.inverse(RigidTransform.from_translation([0, 0, 0.2546362])),
    )
    assert np.abs(state.q - ends).max() < 1e-12
    counts = found.pulses.counts(np.array([0.0, found.trajectory.duration]))
    assert (counts == np.round((np.array(ends) - hexapod.home_q) / PULSE)).all()


@pytest.mark.parametrize("order", [0, 1, 4, 2.5, "3", True])
def test_unknown_orders_are_refused(hexapod, order):
    with pytest.raises(
        MotionError, match=r"order .* is not known; 2 limits|order is .*; expected a whole"
    ):
        plan(SHORT, hexapod, order=order)


@pytest.mark.parametrize("clock_hz", [0, -5, 1.5, float("nan"), float("inf")])
def test_bad_clocks_are_refused(hexapod, clock_hz):
    with pytest.raises(MotionError, match="clock_hz"):
        plan(SHORT, hexapod, clock_hz=clock_hz)


def test_a_clock_too_slow_for_the_motion_is_refused(hexapod):
    """20 mm/s in pulses of 0.75 µm are 26 667 pulses per second."""
    with pytest.raises(Infeasible, match="pulse rate"):
        plan(SHORT, hexapod, order=2, clock_hz=1000)
    assert plan(SHORT, hexapod, order=2, clock_hz=1_000_000).pulses.clock_hz == 1_000_000


def test_a_gap_that_is_asked_for_is_proved_by_finer_bounds_and_grids(hexapod):
    circle = load_program("bare-circle")
    plain, near = plan(circle, hexapod, order=2), plan(circle, hexapod, order=2, gap=1.9e-4)
    assert plain.gap > 1.9e-4 >= near.gap
    assert near.certificate.holds
    assert near.lower_bound <= near.trajectory.duration < plain.trajectory.duration
    rough = plan(circle, hexapod, order=2, gap=1e-9, effort=0)
    assert rough.gap > 1e-9
    assert rough.trajectory.duration == plain.trajectory.duration


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"gap": 0.0}, "positive share"),
        ({"gap": 0.1, "effort": -1}, "0 rounds or more"),
        ({"effort": -1}, "0 rounds or more"),
        ({"effort": float("nan")}, "whole number"),
        ({"effort": True}, "whole number"),
        ({"gap": 0.1, "duration": 9.0}, "omit it"),
        ({"gap": 0.1, "objective": "time + heat"}, "omit it"),
    ],
)
def test_a_gap_that_says_nothing_is_refused(hexapod, given, words):
    with pytest.raises(MotionError, match=words):
        plan(load_program("bare-circle"), hexapod, **given)


def test_a_motion_is_at_most_so_long_that_instants_tell_ticks_apart(hexapod):
    """Up to 2^28 s neighbouring instants are 2^-25 s apart, 0.3 ticks of 10 MHz; beyond it 0.6,
    more than a half.
    """
    line, longest = Program((Line(np.array([0.0, 0, 1e-4])),), frame="home"), 2.0**28
    found = plan(line, hexapod, order=2, duration=longest)
    assert found.trajectory.duration == pytest.approx(longest, rel=1e-12)
    assert check_pulses(found.pulses, found.counted).holds
    with pytest.raises(
        Infeasible,
        match=r"duration 268435457 s is beyond 268435456 s.*a clock of 8388608 Hz or less",
    ):
        plan(line, hexapod, order=2, duration=longest + 1)
    wait = Program((*line.segments, Dwell(longest)), frame="home")
    with pytest.raises(Infeasible, match="no longer motion has its instants within half a tick"):
        plan(wait, hexapod, order=2)
