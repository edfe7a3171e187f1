"""Constant speeds joined without stops: where the ramps lie, how long it takes, and what is said if
it cannot be.
"""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import Traverser, load_machine
from planner import Arc, Blend, Infeasible, Line, Program, Spline, Through, Trajectory, plan
from planner.certificate import CONSTANT_SPEED, SPEED_TOLERANCE, certify
from planner.limits import limits_of
from planner.path.actuation import MachinePath, actuate
from planner.timing import ConstantSpeed, Run, Task

V, A, J = 0.1, 0.5, 10.0
START = RigidTransform.from_components([0, 0, 0.03], Rotation.identity())


def table_of(**own):
    """Straight axes with no couplings: every answer has a closed form."""
    bundled = load_machine("traverser")
    stated = {"max_speed": V, "max_acceleration": A, "max_jerk": J, "max_pulse_rate": None} | own
    return Traverser(axes=[replace(axis, **stated) for axis in bundled.axes], home=bundled.home)


@pytest.fixture(scope="module")
def table():
    return table_of()


def to(x, speed=None, join=None):
    """A line along X to x, at a constant speed if one is given."""
    return Line([x, 0, 0], speed=speed, speed_constant=speed is not None, join=join or Through())


def ramp(low, high, order):
    """Time and way of the shortest ramp of one axis; at order 3 A is reached from a change of A²/J
    on.
    """
    change = high - low
    time = (
        change / A
        if order == 2
        else change / A + A / J
        if change >= A**2 / J
        else 2 * np.sqrt(change / J)
    )
    return time, (low + high) / 2 * time


def ends(stretch):
    return stretch.since.s, stretch.until.s


def by_differences(made, stretch, h=2e-4, count=801):
    """Speed of the tool by five-point differences of its positions: h⁴ (κv)⁴/30, under 1e-10 here,
    and rounding/h.
    """
    t = np.linspace(stretch.since.t + 3 * h, stretch.until.t - 3 * h, count)
    p = [made.trajectory.at(t + k * h).pose.translation for k in (-2, -1, 1, 2)]
    return np.linalg.norm((p[0] - 8 * p[1] + 8 * p[2] - p[3]) / (12 * h), axis=1)


@pytest.mark.parametrize("order", [2, 3])
def test_a_free_neighbour_takes_the_ramp(table, order):
    """The segment has its speed from its first place to its last; what lies before is as fast as
    can be.
    """
    made = plan(Program((to(0.03), to(0.06, 0.02), to(0.09))), table, order=order)
    (stretch,) = made.constant_speeds
    assert ends(stretch) == pytest.approx((0.03, 0.06), abs=1e-15)
    (up, way_up), (down, way_down) = ramp(0, V, order), ramp(0.02, V, order)
    passage = up + down + (0.03 - way_up - way_down) / V
    assert made.trajectory.duration == pytest.approx(2 * passage + 0.03 / 0.02, rel=1e-9)


@pytest.mark.parametrize("order", [2, 3])
def test_between_two_speeds_the_ramp_lies_in_the_faster(table, order):
    """The slower speed is the other segment's cap as well."""
    made = plan(Program((to(0.02, 0.02), to(0.06, 0.04), to(0.08, 0.03))), table, order=order)
    slow, fast, last = made.constant_speeds
    assert [each.speed for each in (slow, fast, last)] == [0.02, 0.04, 0.03]
    ramps = [
        ramp(0, 0.02, order),
        ramp(0.02, 0.04, order),
        ramp(0.03, 0.04, order),
        ramp(0, 0.03, order),
    ]
    assert ends(slow) == pytest.approx((ramps[0][1], 0.02), abs=1e-10)
    assert ends(fast) == pytest.approx((0.02 + ramps[1][1], 0.06 - ramps[2][1]), abs=1e-10)
    assert ends(last) == pytest.approx((0.06, 0.08 - ramps[3][1]), abs=1e-10)
    at_speed = sum(
        (end - start) / each.speed for each in (slow, fast, last) for start, end in [ends(each)]
    )
    assert made.trajectory.duration == pytest.approx(
        at_speed + sum(time for time, _ in ramps), rel=1e-9
    )


def test_a_slower_cap_leaves_the_ramp_in_the_segment_itself(table):
    made = plan(
        Program((Line([0.02, 0, 0], speed=0.01, join=Through()), to(0.06, 0.02))), table, order=2
    )
    (stretch,) = made.constant_speeds
    assert stretch.since.s == pytest.approx(0.02 + (0.02**2 - 0.01**2) / (2 * A), abs=1e-10)


def test_the_same_speed_goes_on_from_segment_to_segment(table):
    made = plan(Program((to(0.02, 0.02), to(0.06, 0.02))), table, order=3)
    (stretch,) = made.constant_speeds
    assert (stretch.since.segment, stretch.until.segment) == (1, 2)
    way = ramp(0, 0.02, 3)[1]
    assert ends(stretch) == pytest.approx((way, 0.06 - way), abs=1e-10)


@pytest.mark.parametrize(
    ("segments", "at", "reached"),
    [
        ((to(0.0003), to(0.06, 0.02)), (0.0003, 1, "to"), np.sqrt(2 * A * 0.0003)),
        ((to(0.03, 0.02), to(0.0303)), (0.03, 2, "from"), np.sqrt(2 * A * 0.0003)),
        (
            (to(0.03, 0.02), to(0.0303), to(0.06, 0.05)),
            (0.0303, 2, "to"),
            np.sqrt(0.02**2 + 2 * A * 0.0003),
        ),
        ((to(0.03, 0.03), to(0.0303, 0.04)), (0.03, 2, "from"), np.sqrt(2 * A * 0.0003)),
    ],
)
def test_a_neighbour_too_short_for_the_ramp_is_named(table, segments, at, reached):
    with pytest.raises(Infeasible, match='write join = "stop" between the two') as refusal:
        plan(Program(segments), table, order=2)
    no = refusal.value
    assert (no.kind, no.place.s, no.place.segment) == (
        "constant speed",
        pytest.approx(at[0]),
        at[1],
    )
    assert f"the ramp {at[2]} the constant speed" in str(no)
    assert no.limit / 1e3 == pytest.approx(reached, rel=1e-6)


def test_a_ramp_that_cannot_be_tightened_says_where_it_lies(table):
    """A closed form between two given speeds has nothing to give; what exceeds nothing is left
    alone.
    """
    path = actuate(Program((to(0.03), to(0.06, 0.02))), table)
    limits = limits_of(path, table.axes, 2)
    goal = ConstantSpeed()
    task = Task(path, limits, Run(0, 1), 2)
    made = goal.solve(task)
    count, first = len(made.profile.h), len(made.parts[0].profile.h)
    assert goal.tighten(task, made, {"speed": np.full(count, 0.9)}).parts == made.parts
    use = np.where(np.arange(count) < first, 1.1, 0.9)
    stopped = goal.tighten(task, made, {"speed": use})
    assert re.search(
        r'the ramp from s = 0 mm, segment 1: no motion.*join = "stop"', str(stopped.refusal)
    )


SAID = {"speed": 0.005, "speed_constant": True}
CURVE = Spline([[0.01, 0.005, 0.03], [0.02, 0, 0.032]], **SAID)
CORNER = (Line([0.006, 0, 0.03], **SAID, join=Blend(3e-4)), Line([0.006, 0.006, 0.03], **SAID))
MIXED = (
    Line([0.006, 0, 0.03], join=Blend(3e-4)),
    replace(CURVE, through=CURVE.through + np.array([0, 0.006, 0])),
)


@pytest.mark.parametrize(
    ("order", "segments"), [(2, (CURVE,)), (3, (CURVE,)), (2, CORNER), (3, CORNER), (2, MIXED)],
    ids=["spline 2", "spline 3", "corner 2", "corner 3", "mixed 2"],
)  # fmt: skip
def test_the_tool_of_a_hexapod_is_at_its_speed(hexapod, order, segments):
    made = plan(Program(segments, start=START), hexapod, order=order)
    (stretch,) = made.constant_speeds
    assert made.certificate.holds
    assert np.abs(by_differences(made, stretch) / SAID["speed"] - 1).max() < 1e-8
    assert (
        np.abs(
            np.linalg.norm(made.trajectory.at(stretch.since.t).tool_velocity) / SAID["speed"] - 1
        )
        < SPEED_TOLERANCE
    )
    met = np.linalg.norm(
        made.trajectory.at(np.linspace(stretch.since.t, stretch.until.t, 2001)[:-1]).tool_velocity,
        2,
        1,
    )
    assert np.abs(met / SAID["speed"] - 1).max() <= stretch.deviation < SPEED_TOLERANCE
    assert made.certificate.worst[CONSTANT_SPEED] == pytest.approx(
        stretch.deviation / SPEED_TOLERANCE
    )
    first = made.path.breaks[next(k for k, piece in enumerate(made.path.pieces) if piece.constant)]
    assert stretch.since.s - first < 2e-4  # v²/2A is 0.06 mm
    assert made.path.breaks[-1] - stretch.until.s < 2e-4


def test_a_speed_that_is_claimed_but_not_had_is_found_out(hexapod):
    """A spline at constant ṡ, which is the tool's speed to 2 % only: it is off by what its own
    derivative says.
    """
    drawn = actuate(Program([replace(CURVE, speed_constant=False)], start=START), hexapod)
    pieces = [replace(piece, constant=True) for piece in drawn.pieces]
    path = MachinePath(hexapod, pieces, np.array([1, 0, 1]), np.zeros(3))
    path.end_speeds = 0.005, 0.005
    s = np.concatenate([np.linspace(*path.breaks[k : k + 2], 41)[:-1] for k in range(2)])
    nothing = np.zeros(80)
    knots = np.append(s, path.breaks[-1]) / 0.005
    claimed = Trajectory(path, knots, s, nothing + 0.005, nothing, nothing, np.repeat([0, 1], 40))
    certificate = certify(claimed, limits_of(path, hexapod.axes, 2))
    dense = np.concatenate(
        [piece.derivatives(np.linspace(0, piece.length, 4001))[1][:, :3] for piece in pieces]
    )
    off = np.abs(np.linalg.norm(dense, axis=1) - 1).max()
    assert off > 1e-3
    assert not certificate.holds
    assert certificate.worst[CONSTANT_SPEED] * SPEED_TOLERANCE == pytest.approx(
        off, rel=1e-3
    )  # cells are not cut once it is clear
    assert certificate.worst[CONSTANT_SPEED] * SPEED_TOLERANCE >= off


BAND = (0.018, 0.022)


def test_a_constant_speed_in_a_resonance_band_is_refused_by_name():
    """X states no time to cross it: from rest it stays below the band's lower edge."""
    machine = table_of(resonance=(BAND,))
    with pytest.raises(
        Infeasible, match=r"resonance band from 18 to 22 mm/s without a crossing time"
    ) as refusal:
        plan(Program((to(0.05, 0.02),)), machine, order=2)
    no = refusal.value
    assert (no.kind, no.axis, no.place.segment) == ("resonance", "X", 1)
    assert (no.value, no.limit) == pytest.approx((20, 18))
    assert plan(Program((to(0.05, 0.0179),)), machine, order=2).constant_speeds


@pytest.mark.parametrize("order", [2, 3])
def test_a_constant_speed_too_long_in_a_band_names_what_would_do(order):
    """On an arc the axes are in the band where |cos| or |sin| of the angle is; above √2 of its edge
    none stays long.
    """
    machine = table_of(resonance=(BAND,), resonance_time=0.1)
    start = RigidTransform.from_components([0.03, 0.01, 0], Rotation.identity())
    arc = Arc([0.03, 0.03, 0], [0, 0, 1], np.pi / 2, speed=0.02, speed_constant=True)
    with pytest.raises(
        Infeasible, match=r"resonance band of 18 to 22 mm/s for longer than the 0.1 s"
    ) as refusal:
        plan(Program((arc,), start=start), machine, order=order)
    no = refusal.value
    assert (no.kind, no.limit) == ("resonance", pytest.approx(18))
    assert no.axis in ("X", "Y")
    assert plan(
        Program((replace(arc, speed=0.017),), start=start), machine, order=order
    ).constant_speeds
    straight = to(0.05, 0.03)
    assert plan(Program((straight,)), machine, order=order).constant_speeds  # crossed by the ramps


BENT = Spline(
    [[0.0, 0.008, 0.027], [-0.005, 0, 0.025]],
    Rotation.from_euler("xyz", [[1, 0, 1], [0, 0, 0]], degrees=True),
    join=Blend(1e-5),
)


def test_a_refused_constant_speed_is_told_with_one_that_holds(hexapod):
    """After a small blend, whose jerk the speed must bear from the segment's first place on: one
    refusal does.
    """
    start = RigidTransform.from_components([0.01, 0.005, 0.028], Rotation.identity())

    def asked(speed):
        return Program((BENT, Line([0, 0, 0.025], speed=speed, speed_constant=True)), start=start)

    with pytest.raises(Infeasible, match="was found to hold") as refusal:
        plan(asked(0.006), hexapod, order=3)
    found = float(re.search(r"([\d.]+) mm/s was found to hold", str(refusal.value))[1]) / 1e3
    assert plan(asked(0.999 * found), hexapod, order=3).certificate.holds


@pytest.mark.parametrize("order", [2, 3])
def test_a_passage_too_short_tells_a_speed_that_it_reaches(table, order):
    """Over L from rest: √(2 A L), and (J L²)^⅓ at order 3, where a ramp by v takes 2 √(v/J) at v/2
    on average.
    """
    length = 3e-4
    reached = np.sqrt(2 * A * length) if order == 2 else np.cbrt(J * length**2)
    with pytest.raises(
        Infeasible, match=r"segment 1, joined to it without a stop.*was found to hold"
    ) as refusal:
        plan(Program((to(length), to(0.06, 0.05))), table, order=order)
    assert refusal.value.limit / 1e3 == pytest.approx(reached, rel=1e-6)
    found = float(re.search(r"([\d.]+) mm/s was found to hold", str(refusal.value))[1]) / 1e3
    assert 0.999 * reached <= found <= reached
    assert plan(
        Program((to(length), to(0.06, 0.999 * found))), table, order=order
    ).certificate.holds
    with pytest.raises(Infeasible):
        plan(Program((to(length), to(0.06, 1.01 * found))), table, order=order)
