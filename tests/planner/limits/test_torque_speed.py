"""A motor's falling curve: as lines, as a limit, and as what a plan keeps."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import Axis, Body, Load, MotionError, Traverser, forces
from kinematics.machine.load import GRAVITY
from planner import Infeasible, Line, Program, classical, plan
from planner.limits.force import PullOutCurve, TorqueSpeed
from planner.path.actuation import actuate

G = -GRAVITY[2]
CONCAVE = ((0.0, 40.0), (0.5, 35.0), (1.0, 25.0))
MIXED = ((0.0, 40.0), (0.2, 40.0), (0.5, 30.0), (1.0, 26.0), (2.0, 25.0))
CONVEX = ((0.1, 60.0), (0.3, 40.0), (1.0, 27.0), (3.0, 20.1))
TO_NOTHING = ((0.0, 60.0), (0.5, 45.0), (1.0, 0.0))
CURVES = {"concave": CONCAVE, "mixed": MIXED, "convex": CONVEX, "to nothing": TO_NOTHING}


def given_at(points, v):
    """The force of a curve at speeds v: the least of what it shows at lower ones."""
    speeds, force = np.array(points).T
    dense = np.union1d(np.linspace(0, speeds[-1], 20_001), speeds)
    lowest = np.minimum.accumulate(np.interp(dense, speeds, force))
    return np.where(v <= speeds[-1], np.interp(v, dense, lowest), 0.0)


points = st.lists(
    st.tuples(st.floats(0.05, 1.0), st.floats(0.0, 50.0)),
    min_size=2,
    max_size=6,
    unique_by=lambda p: round(p[0], 3),
).map(
    lambda steps: tuple(
        zip(np.cumsum([s for s, _ in steps]), [50.0, *[f for _, f in steps[1:]]], strict=True)
    )
)


@given(points)
@settings(max_examples=40, deadline=None)
def test_lines_are_the_curve(points):
    curve = PullOutCurve.from_axis(Axis("z", torque_speed=points))
    assert (curve.slope >= 0).all()
    assert curve.ends[0] == 0
    for i, (start, end) in enumerate(zip(curve.ends[:-1], curve.ends[1:], strict=True)):
        v = np.linspace(start, end, 7)
        # the reference's grid of 1/20 000 of the curve is off by its slope times that
        assert curve.force[i] - curve.slope[i] * v == pytest.approx(given_at(points, v), abs=0.2)
    assert given_at(points, curve.fastest + 1e-3) <= 0.1 or curve.fastest == points[-1][0]


def shown(curve, v):
    """The force at speeds v, each on its own line."""
    line = np.clip(np.searchsorted(curve.ends, v, side="right") - 1, 0, len(curve.slope) - 1)
    return curve.force[line] - curve.slope[line] * v


@given(points, st.floats(0, 1))
@settings(max_examples=40, deadline=None)
def test_lines_near_a_speed_are_a_floor_that_touches_the_curve_there(points, share):
    """The least of them is nowhere above the curve, and on it at the speed itself."""
    curve = PullOutCurve.from_axis(Axis("z", torque_speed=points))
    low, high = curve.line_ranges()
    here = share * curve.fastest
    speaks = (low <= here) & (here < high)
    v = np.sort(np.append(np.linspace(0, curve.fastest, 301), curve.ends))
    floor = (curve.force - curve.slope * v[:, None])[:, speaks].min(1)
    assert (floor <= shown(curve, v) + 1e-9).all()
    assert (curve.force - curve.slope * here)[speaks].min() == pytest.approx(
        float(shown(curve, here)), abs=1e-9
    )


@given(points)
@settings(max_examples=40, deadline=None)
def test_the_hull_is_the_least_concave_curve_above(points):
    """Above the curve, concave, and each of its corners is on the curve: one lower would not be
    above.
    """
    curve = PullOutCurve.from_axis(Axis("z", torque_speed=points))
    hull = curve.hull()
    assert (np.diff(hull.slope) > 0).all()
    assert (hull.ends[0], hull.fastest, hull.holding_force) == (
        0,
        curve.fastest,
        pytest.approx(curve.holding_force),
    )
    v = np.union1d(curve.ends, np.linspace(0, curve.fastest, 101))
    above, below = shown(hull, v), shown(curve, v)
    assert (above >= below - 1e-9).all()
    assert np.isin(hull.ends, curve.ends).all()
    corners = np.isin(v, hull.ends)
    assert above[corners] == pytest.approx(below[corners], abs=1e-9)


def test_a_concave_curve_is_all_its_lines_everywhere():
    low, high = PullOutCurve.from_axis(Axis("z", torque_speed=CONCAVE)).line_ranges()
    assert (low == 0).all()
    assert np.isinf(high).all()


@pytest.mark.parametrize(
    ("name", "sign", "order"),
    [*((name, sign, 2) for name in CURVES for sign in (1, -1)), ("mixed", 1, 3)],
)
def test_one_slide_takes_the_least_time(slide, bang_bang, name, sign, order):
    """v̇ = (±F(v) − mg)/m by quadrature.

    1000 intervals cost 1e-3 where the curve is steepest; a jerk of 1e5 as much.
    """
    speeds, force = np.array(CURVES[name]).T
    # where the curve ends in nothing, the speed at which it just bears the weight is approached,
    # never reached
    top = speeds[-1] if force[-1] > 2 * G else np.interp(-2 * G, -force, speeds) * (1 - 1e-9)

    def rate(way):
        return lambda v: (np.interp(v, speeds, force) - way * sign * 2 * G) / 2

    least = bang_bang(0.3, rate(1), rate(-1), top)
    machine = slide(2.0, torque_speed=CURVES[name], max_jerk=1e5 if order == 3 else None)
    found = plan(Program([Line([0, 0, sign * 0.3])]), machine, order=order)
    assert found.certificate.holds
    assert least * (1 - 2e-5) <= found.trajectory.duration <= least * (1 + 3e-3)
    # the estimate takes the least concave curve above: none is lost where the curve is concave
    # itself
    assert (
        (0.7 if name in ("mixed", "convex") else 1 - 1e-4) * least
        <= found.lower_estimate
        <= least * (1 + 1e-5)
    )
    state = found.trajectory.at(np.linspace(0, found.trajectory.duration, 4001))
    push, speed = np.abs(2 * (state.qdd[:, 2] + G)), np.abs(state.qd[:, 2])
    assert (push <= np.interp(speed * (1 - 1e-6), speeds, force) * (1 + 1e-6) + 1e-4).all()
    assert speed.max() <= speeds[-1] * (1 + 1e-6)


def test_six_motors_each_keep_their_curve(hexapod):
    """Forces by the twist formulation, the curve by interpolation; slower than the same machine
    without curves.
    """
    curve = ((0.0, 220.0), (0.01, 200.0), (0.03, 120.0), (0.06, 100.0), (0.1, 95.0))
    quick = {"max_speed": 0.2, "max_acceleration": 2.25, "max_jerk": 400.0}
    turned = Program([Line([0.01, 0, 0.02], Rotation.from_euler("XYZ", [3, -4, 5], degrees=True))])
    load, durations = Load(Body(40.0, [0.01, 0, 0.1], np.diag([1.0, 2.0, 1.5]))), []
    for own in ({}, {"torque_speed": curve}):
        machine = hexapod.carrying(load)
        machine.axes = tuple(replace(axis, **quick, **own) for axis in hexapod.axes)
        found = plan(turned, machine, order=2)
        assert found.certificate.holds
        durations.append(found.trajectory.duration)
    assert durations[1] > 1.02 * durations[0]
    state = found.trajectory.at(np.linspace(0, found.trajectory.duration, 2001))
    speeds, force = np.array(curve).T
    share = np.abs(forces(machine, state).force) / np.interp(np.abs(state.qd), speeds, force)
    assert 0.99 < share.max() <= 1 + 1e-5


@pytest.fixture(scope="module")
def limit():
    """One slide's, in the middle of its travel; rising levels are read as falling: 40 N to 0.2 m/s,
    then to 20 N.
    """
    axes = [
        Axis("X"),
        Axis("Y"),
        Axis("Z", torque_speed=((0.0, 40.0), (0.2, 45.0), (0.4, 20.0))),
        Axis("R", "rotary"),
    ]
    machine = Traverser(axes=axes, home=RigidTransform.identity(), load=Load(Body(1.0)))
    return TorqueSpeed(machine, actuate(Program([Line([0, 0, 0.1])]), machine))


def values(limit, speed, force):
    return force * limit.pull + speed * limit.drop


def test_a_scaled_curve_is_used_by_twice_the_speed_and_force_as_it_was_before(limit):
    twice = limit.scale(2.0)
    for speed in (-0.3, 0.0, 0.1, 0.25, 0.39, 0.5):
        v = np.array([values(limit, speed, force) for force in (-25.0, 0.0, 12.0, 39.0, 50.0)])
        assert twice.use(2 * v, 2 * v, np.zeros(5, int)) == pytest.approx(
            limit.use(v, v, np.zeros(5, int)), rel=1e-14
        )
    lone = values(limit, 0.3, 36.0)[None]  # above the curve, and under the one of twice
    assert (
        limit.use(lone, lone, np.zeros(1, int)).max()
        > 1
        > twice.use(lone, lone, np.zeros(1, int)).max()
    )


def test_the_share_is_one_on_the_curve_and_tells_how_far_it_is(limit):
    """Speed and force together, k times as large, use k times as much; at rest that is the force's
    share alone.
    """
    piece = np.zeros(1, int)
    for speed, force in (
        (0.0, 40.0),
        (0.1, -40.0),
        (-0.24, 40.0),
        (0.3, 32.5),
        (-0.4, -20.0),
        (0.4, 3.0),
    ):
        for k in (1.0, 1 + 1e-6):
            value = values(limit, k * speed, k * force)[None]
            assert limit.use(value, value, piece).max() == pytest.approx(k, rel=1e-12)
    still = values(limit, 0.0, 10.0)[None]
    assert limit.use(still, still, piece).max() == pytest.approx(0.25, rel=1e-12)


@given(
    st.floats(-0.5, 0.5),
    st.floats(0, 0.2),
    st.floats(-60, 60),
    st.floats(0, 20),
    st.lists(st.floats(0, 1)),
)
@settings(max_examples=60, deadline=None)
def test_the_use_of_a_range_is_that_of_all_in_it(limit, speed, wide, force, high, shares):
    corners = [values(limit, speed + a * wide, force + b * high) for a in (0, 1) for b in (0, 1)]
    low, most = np.min(corners, 0)[None], np.max(corners, 0)[None]
    piece = np.zeros(1, int)
    bound = limit.use(low, most, piece).max()
    for share in (0.0, 1.0, *shares):
        value = values(limit, speed + share * wide, force + (1 - share) * high)[None]
        assert limit.use(value, value, piece).max() <= bound * (1 + 1e-12)


def test_what_has_no_bound_uses_without_bound(limit):
    """The speed itself, or a line that counts at it: at 0.3 m/s the falling one."""
    for lost in (0, *np.flatnonzero((limit.low < 0.3) & (limit.high > 0.3) & (limit.pull > 0))):
        low, high = (values(limit, 0.3, 1.0)[None].copy() for _ in range(2))
        low[0, lost] = high[0, lost] = np.nan
        assert not limit.use(low, high, np.zeros(1, int)).max() < np.inf
        high[0, lost], low[0, lost] = np.inf, -np.inf
        assert limit.use(low, high, np.zeros(1, int)).max() == np.inf


def test_a_motor_that_gives_less_than_the_weight_at_rest_is_told_first(slide):
    with pytest.raises(
        Infeasible, match=r"holding force .* is beyond 19 N .*cannot hold itself still there"
    ):
        plan(
            Program([Line([0, 0, 0.1])]),
            slide(2.0, max_force=30.0, torque_speed=((0.1, 19.0), (1.0, 5.0))),
        )


def test_a_motor_without_force_is_refused():
    with pytest.raises(MotionError, match="axis z: torque_speed gives no force at rest"):
        PullOutCurve.from_axis(Axis("z", torque_speed=((0.0, 0.0), (1.0, 0.0))))


@pytest.mark.parametrize("name", ["mixed", "convex"])
def test_the_classical_trapezoid_uses_the_curve_up(slide, name):
    """It is slower than the plan, and its ramps reach the curve."""
    found = plan(Program([Line([0, 0, 0.3])]), slide(2.0, torque_speed=CURVES[name]), order=2)
    trapezoid = classical(found)
    assert trapezoid.duration > found.trajectory.duration
    assert 0.99 < trapezoid.certificate.worst["torque-speed"] <= 1 + 1e-6
