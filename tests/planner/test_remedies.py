"""Refusals say what to change and by how much: each number applied makes the plan feasible, and a
little less does not.

Of dwells, unloaded accelerations, periods, resonances and durations the tests are beside those of
what refuses: test_compensate, test_generate_spacing, test_firing_rules, test_stated_duration.
"""

import pickle
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import Axis, Hexapod, Load, MotionError, OutOfReach, load_machine
from kinematics.machine.axis import StepTiming
from planner import Arc, Curve, Infeasible, Line, Program, Spline, Turn, check, plan
from planner.pulses import generate
from tests.planner.motions import one_axis

HIGH = Program([Line([0, 0, 0.025]), Line([0, 0, 0.06])])
WIDE = Program(
    [
        Line([0, 0, 0.02]),
        Line([0.1, 0, 0.02]),
        Arc([0, 0, 0.02], [0, 0, 1], 1.0),
        Spline([[0, 0.01, 0.03]]),
    ]
)
LOW = Program([Line([0.002, 0, -0.004]), Line([0.004, 0, -0.002])])
TIPPED = Program([Line([0, 0, 0.025]), Turn(Rotation.from_euler("x", 30, degrees=True))])
SHAKEN = Program(
    [Line([0, 0, 0.02]), Curve(("0.01*sin(t)", "0", "0.02 + 0.02*t"), 0.0, 2.5, length=1.0)]
)


PROGRAMS = {"high": HIGH, "wide": WIDE, "curve": SHAKEN, "low": LOW}


@pytest.fixture(autouse=True)
def patient(limit_search):
    """What is found must not depend on what else the computer does."""
    limit_search(600.0)


def number(pattern, no):
    found = re.search(pattern, str(no))
    assert found, str(no)
    return found[1]


def refused(program, machine):
    """What a check says of it first."""
    try:
        (no, *_) = check(program, machine).violations
    except OutOfReach as lost:
        return lost
    return no


@pytest.fixture(scope="module")
def refusal(hexapod):
    """A program's name -> what a check says of it first, with a remedy that is sought once."""
    return cache(lambda name: refused(PROGRAMS[name], hexapod))


def test_a_plan_says_what_a_check_says(hexapod, refusal):
    with pytest.raises(Infeasible) as planned:
        plan(HIGH, hexapod, order=2)
    assert str(planned.value) == str(refusal("high"))
    assert str(pickle.loads(pickle.dumps(planned.value))) == str(planned.value)


def fits(program, machine):
    try:
        return not check(program, machine).violations
    except MotionError:
        return False


def scaled(program, share):
    """About the home pose, which is where these programs begin: what a user does is to multiply the
    coordinates.
    """

    def part(segment):
        match segment:
            case Line():
                return replace(segment, to=share * np.asarray(segment.to))
            case Arc():
                return replace(segment, centre=share * np.asarray(segment.centre))
            case Spline():
                return replace(segment, through=share * np.asarray(segment.through))
            case Curve():
                return replace(segment, length=share * segment.length)
            case _:
                return segment

    return replace(program, segments=tuple(map(part, program.segments)))


@pytest.mark.parametrize("name", ["high", "wide", "curve"])
def test_the_scale_of_a_path_beyond_its_travel(hexapod, refusal, name):
    program = PROGRAMS[name]
    share = float(number(r"scaled to <= (\S+) % about its start", refusal(name))) / 100
    assert 0.05 < share < 1
    assert fits(scaled(program, share), hexapod)
    assert not fits(scaled(program, share + 0.003), hexapod)


@pytest.mark.parametrize(("name", "axis", "sign"), [("high", 2, -1), ("low", 2, 1)])
def test_the_move_of_a_path_beyond_its_travel(hexapod, refusal, name, axis, sign):
    program = PROGRAMS[name]
    told = number(r"moved by >= (\S+ mm along \S+)", refusal(name))
    size = float(told.split()[0]) / 1e3
    assert told.endswith(f"{'+' if sign > 0 else '-'}{'xyz'[axis]}")

    def moved(by):
        shift = sign * by * np.eye(3)[axis]
        return replace(
            program, segments=tuple(replace(part, to=part.to + shift) for part in program.segments)
        )

    assert fits(moved(size), hexapod)
    assert not fits(moved(0.985 * size), hexapod)


def test_a_path_that_starts_beyond_moves_start_and_all(hexapod):
    """An arc begins where the path stands, so what is moved is the start that the program
    states.
    """
    start = RigidTransform.from_translation([0.0, 0.0, 0.06])
    program = Program([Arc([0.005, 0, 0.06], [0, 0, 1], 1.0)], start=start)
    no = refused(program, hexapod)
    assert "scaled" not in str(no)
    size = float(number(r"moved by >= (\S+) mm along -z", no)) / 1e3
    assert fits(
        Program([Arc([0.005, 0, 0.06 - size], [0, 0, 1], 1.0)], start=moved_by(start, -size)),
        hexapod,
    )
    less = 0.98 * size
    assert not fits(
        Program([Arc([0.005, 0, 0.06 - less], [0, 0, 1], 1.0)], start=moved_by(start, -less)),
        hexapod,
    )


def moved_by(pose, up):
    return RigidTransform.from_components(pose.translation + np.array([0, 0, up]), pose.rotation)


def loose(hexapod, **more):
    axes = [replace(axis, travel=(-0.1, 0.2)) for axis in hexapod.axes]
    return Hexapod(hexapod.base, hexapod.platform, axes=axes, home=hexapod.home, **more)


@pytest.mark.parametrize("kind", ["tilt", "clearance"])
def test_the_angle_of_a_path_that_tips_or_twists_too_far(hexapod, kind):
    if kind == "tilt":
        machine, vector = loose(hexapod, max_tilt=np.deg2rad(25)), np.array([0.7, 0.0, 0.0])
    else:
        machine, vector = (
            loose(hexapod, leg_radius=0.0304),
            np.deg2rad(80) * np.array([0.05, 0.1, 1.0]),
        )
    lift = Line([0, 0, 0.03])
    no = refused(Program([lift, Turn(Rotation.from_rotvec(vector))]), machine)
    assert no.kind == kind
    share = float(number(r"with its angles scaled to <= (\S+) %", no)) / 100
    assert fits(Program([lift, Turn(Rotation.from_rotvec(share * vector))]), machine)
    assert not fits(Program([lift, Turn(Rotation.from_rotvec((share + 0.01) * vector))]), machine)


@pytest.mark.parametrize(
    ("name", "to", "what"),
    [("arm", [0.3, 0, 0], "no actuator coordinates reach"), ("linkage", [0, -0.45, 0], "singular")],
)
def test_the_scale_of_a_path_out_of_reach_or_through_a_singular_pose(name, to, what):
    machine = load_machine(name)
    no = refused(Program([Line(to)]), machine)
    assert isinstance(no, OutOfReach)
    assert what in str(no)
    share = float(number(r"scaled to <= (\S+) %", no)) / 100
    assert fits(Program([Line(share * np.array(to))]), machine)
    assert not fits(Program([Line((share + 0.003) * np.array(to))]), machine)


def test_where_nothing_helps_that_is_said(hexapod):
    """Of a machine whose bodies may touch: their distances take most of the time of a search."""
    machine = Hexapod(hexapod.base, hexapod.platform, axes=hexapod.axes, home=hexapod.home)
    across = [Line([0, 0, 0.02]), Line([0.9, 0, 0.02]), Line([-0.9, 0, 0.02])]
    no = refused(Program(across), machine)
    told = (
        "no scale about its start down to 5 % and no move of up to 102.4 mm along an axis was found"
    )
    assert told in str(no)


def test_the_force_that_holds_it(hexapod):
    from kinematics import Body

    heavy = hexapod.carrying(Load(Body(140.0, [0.05, 0, 0.1])))
    no = refused(Program([Line([0.005, 0, 0.02])]), heavy)
    assert no.kind == "holding force"
    over = float(number(r"reduce its load by (\S+) N, or increase its max_force by as much", no))
    for factor, holds in ((1.001, True), (0.99, False)):
        axes = [replace(axis, max_force=axis.max_force + factor * over) for axis in hexapod.axes]
        stronger = Hexapod(
            hexapod.base, hexapod.platform, axes=axes, home=hexapod.home, max_tilt=np.deg2rad(35)
        )
        assert (
            fits(
                Program([Line([0.005, 0, 0.02])]),
                stronger.carrying(Load(Body(140.0, [0.05, 0, 0.1]))),
            )
            == holds
        )


def test_the_constant_speed_that_holds(hexapod):
    def circling(speed):
        arc = Arc([0, 0, 0.025], [0, 0, 1], 2.0, speed=speed, speed_constant=True)
        return plan(Program([Line([0.015, 0, 0.025]), arc]), hexapod, order=2)

    with pytest.raises(Infeasible) as no:
        circling(0.1)
    speed = float(number(r"(\S+) mm/s was found to hold", no.value)) / 1e3
    possible = float(number(r"there it could be (\S+) mm/s|below (\S+) mm/s", no.value)) / 1e3
    assert circling(speed).certificate.holds
    assert speed < possible
    with pytest.raises(Infeasible):
        circling(1.001 * possible)


@pytest.mark.parametrize("end", ["start_speed", "end_speed"])
def test_the_speed_at_an_end(hexapod, end):
    def moving(speed):
        start = RigidTransform.from_translation([0, 0, 0.02])
        return plan(
            Program([Line([0.002, 0, 0.02])], start=start, **{end: speed}), hexapod, order=2
        )

    with pytest.raises(Infeasible) as no:
        moving(0.2)
    largest = float(number(r"(\S+) mm/s is the largest that the limits allow", no.value)) / 1e3
    assert moving(0.999 * largest).certificate.holds
    with pytest.raises(Infeasible):
        moving(1.001 * largest)


def steps(rate):
    """One axis that makes `rate` pulses a second for a second."""
    return one_axis([[rate * 1e-6, 0.0]], [0, 1.0])


def test_the_clock_that_is_fast_enough():
    axis, motion = Axis("x", pulse=1e-6), steps(123_456.0)
    with pytest.raises(Infeasible) as no:
        generate(motion, [axis], [0.0], 100_000)
    clock = int(number(r"a clock above (\d+) Hz", no.value))
    assert generate(motion, [axis], [0.0], clock + 1).total
    with pytest.raises(Infeasible):
        generate(motion, [axis], [0.0], int(0.99 * clock))


def test_the_pulse_that_a_drive_can_take():
    motion = steps(1e4)
    axis = Axis("x", pulse=1e-6, timing=StepTiming(60e-6, 60e-6, 0, 0))
    with pytest.raises(Infeasible) as no:
        generate(motion, [axis], [0.0])
    longer = float(number(r"use a pulse (\S+) times as long", no.value))
    assert longer == pytest.approx(1.2, abs=2e-3)
    assert generate(motion, [replace(axis, pulse=1e-6 * longer)], [0.0]).total
    share = float(number(r"slow the motion there to (\S+) % or less", no.value)) / 100
    assert generate(steps(1e4 * share), [axis], [0.0]).total
    with pytest.raises(Infeasible):
        generate(steps(1e4 * share * 1.01), [axis], [0.0])


def test_the_rate_of_bursts_that_an_axis_takes():
    motion, axis = steps(20.0), Axis("x", pulse=1e-6, max_pulse_rate=2400.0)
    with pytest.raises(Infeasible) as no:
        generate(motion, [axis], [0.0], rule="dda:rate=100kHz")
    rate = number(r"send the pulses of a count at (\S+) 1/s or less", no.value)
    generate(motion, [axis], [0.0], rule=f"dda:rate={rate} 1/s,spacing=0.1s,pulses_per_count=10")


def test_a_start_out_of_reach_is_named(hexapod):
    """A start in a shifted work frame, with a tool, is as far out of reach as the same start
    without.
    """
    program = Program([Line([0, 0, 0.205])], start=RigidTransform.from_translation([0, 0, 0.2]))
    expected = number(
        r"the start of the program already exceeds a limit \((.*)\): change start",
        refused(program, hexapod),
    )
    assert re.fullmatch(r"leg\d travel: [3-9]\d\d\.\d% of its limit", expected)
    up = RigidTransform.from_translation([0, 0, 0.05])
    shifted = refused(replace(program, tool=up, work=up), hexapod)
    assert number(r"exceeds a limit \((.*)\): change start", shifted) == expected
    near = Program([Line([0, 0, 0.205])], start=RigidTransform.from_translation([0, 0, 0.02]))
    assert "change start" not in str(refused(near, hexapod))


def test_a_machine_beyond_a_limit_at_home_is_told_so(hexapod):
    axes = [replace(axis, travel=(0.005, 0.03)) for axis in hexapod.axes]
    short = Hexapod(hexapod.base, hexapod.platform, axes=axes, home=hexapod.home)
    told = str(refused(Program([Line([0, 0, 0.06])]), short))
    assert "already exceeds a limit at home (leg" in told
    assert "travel: 140.0% of its limit" in told  # 17.5 mm from the middle of a range of 25 mm


@pytest.mark.parametrize(
    ("machine", "segment", "name"),
    [
        ("tripod", Turn(Rotation.from_euler("y", 5, degrees=True)), "ry"),
        ("linkage", Line([0, 0.01, 0.01]), "z"),
    ],
)
def test_a_component_that_the_machine_does_not_move_is_to_be_left_as_it_is(machine, segment, name):
    told = str(refused(Program([segment]), load_machine(machine)))
    assert told.endswith(f"only; leave {name} as it is at home")


POLAR = """
schema = 1
kind = "equations"
[geometry]
moves = ["x", "y"]
joints = ["r", "theta"]
rotary = ["theta"]
constants = { R0 = "200 mm" }
coordinates = ["hypot(x + R0, y)", "atan2(y, x + R0)"]
home = { to = ["0 mm", "0 mm", "0 mm"] }
[axes]
travel = ["-195 mm", "120 mm"]
pulse = "5 um"
max_speed = "300 mm/s"
max_acceleration = "3 m/s^2"
[rotary]
travel = ["-170 deg", "170 deg"]
pulse = "0.005 deg"
max_speed = "90 deg/s"
max_acceleration = "900 deg/s^2"
"""


@pytest.mark.parametrize("radius", [0.0, 1e-3])
def test_the_move_of_a_path_past_a_pole_takes_its_start_along(tmp_path, radius):
    """A line past the pole has to keep r >= 5 mm: at r = 0 all else is singular, too."""
    (tmp_path / "polar.toml").write_text(POLAR)
    machine = load_machine(tmp_path / "polar.toml")

    def line(by):
        x = radius - 0.2 + by
        return Program(
            [Line([x, 0.03, 0.0])], start=RigidTransform.from_translation([x, -0.03, 0.0])
        )

    size = float(number(r"moved by >= (\S+) mm along \+x", refused(line(0.0), machine))) / 1e3
    assert size == pytest.approx(5e-3 - radius, rel=0.02)
    assert fits(line(size), machine)
    assert not fits(line(0.97 * size), machine)


FIVE_BAR = """
schema = 1
kind = "equations"
[geometry]
moves = ["x", "y"]
joints = ["left", "right"]
rotary = ["left", "right"]
coordinates = "atan2(-y, x - foot) + sign*acos((r2 + crank**2 - rod**2)/(2*crank*sqrt(r2)))"
constants = { foot = ["-30 mm", "30 mm"], sign = [1, -1], crank = "60 mm", rod = "80 mm" }
home = { to = ["0 mm", "-90 mm", "0 mm"] }
[geometry.definitions]
r2 = "(x - foot)**2 + y**2"
[rotary]
travel = ["-170 deg", "170 deg"]
pulse = "0.01 deg"
max_speed = "200 deg/s"
max_acceleration = "2000 deg/s^2"
"""
# m above home where both rods are in one line: the elbows are 80 mm off the middle, so 50 mm
# outside their feet
SINGULAR = 0.09 - np.sqrt(0.06**2 - 0.05**2)


@pytest.fixture
def five_bar(tmp_path):
    (tmp_path / "fivebar.toml").write_text(FIVE_BAR)
    return load_machine(tmp_path / "fivebar.toml")


def test_the_scale_of_a_path_that_ends_beyond_a_singular_pose(five_bar):
    no = refused(Program([Line([0, 0.06, 0])]), five_bar)
    assert "singular" in str(no)
    share = float(number(r"scaled to <= (\S+) %", no)) / 100
    assert share == pytest.approx(SINGULAR / 0.06, abs=3e-3)
    assert share < SINGULAR / 0.06
    assert fits(Program([Line([0, share * 0.06, 0])]), five_bar)


def test_a_path_that_ends_just_before_a_singular_pose_is_warned_of(five_bar):
    near = check(Program([Line([0, SINGULAR - 1e-4, 0])]), five_bar)
    assert not near.violations
    assert near.conditioning.place.s == pytest.approx(SINGULAR - 1e-4)
    (warning,) = near.warnings
    assert "near a singular pose at s = 56.73 mm, segment 1" in warning
    pose = five_bar.home * RigidTransform.from_translation([0, SINGULAR - 1e-4, 0])
    assert near.conditioning.value == pytest.approx(five_bar.check(pose).conditioning[0], rel=1e-6)
    assert not check(Program([Line([0, 0.03, 0])]), five_bar).warnings
    assert (
        plan(Program([Line([0, SINGULAR - 1e-4, 0])]), five_bar).conditioning == near.conditioning
    )


def test_a_path_out_of_reach_names_the_axes(five_bar):
    program = Program([Line([0, -0.15, 0])])
    assert "there is no position of left, right; bring it nearer to home" in str(
        refused(program, five_bar)
    )


@pytest.mark.parametrize(
    ("factor", "remedy"),
    [
        (
            25.4,
            'divided by 25.4, the path fits: if it is in mm but read as inches, state length = "mm"',
        ),
        (1000, 'divided by 1000, the path fits: if it is in mm but read as m, state length = "mm"'),
        (
            1 / 25.4,
            'multiplied by 25.4, the path fits: if the program is in inches, state length = "in"',
        ),
        (1e-3, 'multiplied by 1000, the path fits: if the program is in m, state length = "m"'),
    ],
)
@pytest.mark.filterwarnings("error")
def test_a_mistaken_unit_is_suspected(hexapod, factor, remedy):
    """Coordinates in the base frame do not fit in any other unit; those from home fit in a smaller
    one.

    Of a machine whose bodies may touch, as above.
    """
    hexapod = Hexapod(hexapod.base, hexapod.platform, axes=hexapod.axes, home=hexapod.home)
    frame = "base" if factor < 1 else "home"
    home = hexapod.home.translation if frame == "base" else np.zeros(3)
    meant = np.array([0.01, 0.01, 0.03]) + home
    assert fits(Program([Line(meant)], frame=frame), hexapod)
    mistaken = refused(Program([Line(factor * meant)], frame=frame), hexapod)
    assert str(mistaken).endswith(f"with every coordinate {remedy}")


def test_no_unit_is_suspected_of_a_path_that_a_scale_fits(hexapod, refusal):
    """A path that is a few times too large, and one that fits in no unit."""
    low = refused(Program([Line([0, 0, -0.05])]), hexapod)
    for each in (refusal("high"), refusal("wide"), low):
        assert "every coordinate" not in str(each)
