"""Every limit of the registry: what the solvers are told is what the certificate measures."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import Axis, Body, Hexapod, Load, MotionError
from planner import Arc, Line, Program, Trajectory, Turn
from planner.limits import Term, limits_of
from planner.limits.axis import Acceleration, Jerk, PulseRate, Speed
from planner.limits.force import Force, Holding, TorqueSpeed
from planner.limits.geometric import Clearance, Room, Tilt, Travel
from planner.limits.registry import AXIS_LIMITS, MACHINE_LIMITS, tabulate_axis_bounds
from planner.limits.resonance import Resonance
from planner.limits.tool import (
    FACETS,
    AngularSpeed,
    ToolAcceleration,
    ToolJerk,
    ToolLimit,
    ToolSpeed,
    _sphere_normals,
)
from planner.path.actuation import actuate, make_points
from planner.path.polynomial import PolynomialPath
from planner.pulses import pace_axes
from planner.timing import pose_problem

COUNT = 400


@dataclass(frozen=True)
class Case:
    """A limit in the zoo: its value at full use (N, m) on pieces (N,).

    row: what the rows' sum must be, of the value; None for a geometric limit, which has no rows
    loss: how much more of their bound the rows may use than the value does of its own
    """

    full: Callable[[object, np.ndarray], np.ndarray]
    row: Callable[[np.ndarray], np.ndarray] | None = None
    loss: float = 0.0


def bounds(limit, piece):
    return np.broadcast_to(limit.bounds, (len(piece), len(limit.bounds)))


def squares(limit, piece):
    return limit.caps[piece][:, None] ** 2


ZOO = {
    Speed: Case(bounds, row=lambda value: value),
    Acceleration: Case(bounds, row=lambda value: value),
    PulseRate: Case(bounds, row=lambda value: value),
    Resonance: Case(bounds, row=lambda value: value),
    Jerk: Case(bounds, row=lambda value: value),
    Travel: Case(lambda limit, piece: -bounds(limit, piece)),
    Room: Case(bounds),
    Tilt: Case(lambda limit, piece: np.cos(bounds(limit, piece))),
    Clearance: Case(bounds),
    ToolSpeed: Case(squares, row=np.sqrt),
    AngularSpeed: Case(squares, row=np.sqrt),
    # a polygon inscribed in a circle: of the facets, the nearest uses at most so much more
    ToolAcceleration: Case(squares, row=np.sqrt, loss=1 / np.cos(np.pi / 2 / FACETS) - 1),
    # likewise a polyhedron inscribed in a ball, where the path leaves its plane
    ToolJerk: Case(squares, row=np.sqrt, loss=1 / _sphere_normals()[1] - 1),
    Holding: Case(bounds),
    Force: Case(bounds, row=lambda value: value),
    TorqueSpeed: Case(bounds, row=lambda value: value),
}
# Only the lines that a speed lies on count: see test_torque_speed.
BY_LINES = {TorqueSpeed}
# What holds the machine still does not fall when it slows: see test_force.
STAYS = {Force, TorqueSpeed}


def test_every_limit_is_in_the_zoo():
    assert set(ZOO) == set(AXIS_LIMITS) | set(MACHINE_LIMITS)


@pytest.fixture(scope="module")
def machine(hexapod):
    """The preset with everything that an axis may state, and something to carry."""
    curve = ((0.0, 220.0), (0.01, 200.0), (0.02, 120.0), (0.04, 100.0))
    own = {"max_pulse_rate": 2e4, "friction": 50.0, "reflected": 0.5, "torque_speed": curve}
    made = Hexapod(
        hexapod.base,
        hexapod.platform,
        axes=[replace(axis, **own) for axis in hexapod.axes],
        home=hexapod.home,
        max_tilt=np.deg2rad(35),
        leg_radius=hexapod.bodies.leg_radius,
        base_disc=hexapod.bodies.base_disc,
        platform_disc=hexapod.bodies.platform_disc,
        load=Load(Body(20.0, [0.01, 0, 0.05], np.diag([0.1, 0.2, 0.15]))),
    )
    made.room = ((-0.02, 0.03), (-0.04, 0.02), (0.2, 0.4))
    return made


@pytest.fixture(scope="module")
def path(machine):
    program = Program(
        [
            Line(
                [0.01, 0, 0.02],
                Rotation.from_euler("XYZ", [3, -4, 5], degrees=True),
                speed=0.03,
                angular_speed=0.2,
            ),
            Arc([0, 0, 0.02], [0, 0, 1], -8.0, speed=0.015, acceleration=0.02),
            Turn(Rotation.identity()),
        ],
        start=RigidTransform.from_components([0, 0, 0.025], Rotation.identity()),
        acceleration=0.03,
        angular_speed=0.1,
        max_tool_jerk=2.0,
    )
    return actuate(program, machine)


@pytest.fixture(scope="module")
def limits(path, machine):
    axes = [replace(axis, resonance=((0.006, 0.008),)) for axis in machine.axes]
    return {type(limit): limit for limit in limits_of(path, axes, 3)}


@pytest.fixture(scope="module", params=list(ZOO), ids=lambda kind: kind.__name__)
def limit(request, limits):
    return limits[request.param]


@pytest.fixture(
    scope="module", params=[kind for kind in ZOO if ZOO[kind].row], ids=lambda kind: kind.__name__
)
def timing_limit(request, limits):
    return limits[request.param]


@pytest.fixture(
    scope="module",
    params=[kind for kind in ZOO if kind not in BY_LINES],
    ids=lambda kind: kind.__name__,
)
def even_limit(request, limits):
    return limits[request.param]


@pytest.fixture(
    scope="module",
    params=[kind for kind in ZOO if ZOO[kind].row and kind not in STAYS],
    ids=lambda kind: kind.__name__,
)
def falling_limit(request, limits):
    return limits[request.param]


@dataclass(frozen=True)
class Moving:
    """A random motion: unconnected instants anywhere on the path, k times slower."""

    trajectory: Trajectory
    v: np.ndarray
    a: np.ndarray
    j: np.ndarray

    @property
    def state(self):
        return self.trajectory.at(self.trajectory.knots[:-1])

    def slowed(self, k):
        return moving(
            self.trajectory.path,
            self.trajectory.s,
            self.trajectory.piece,
            self.v / k,
            self.a / k**2,
            self.j / k**3,
        )


def moving(path, s, piece, v, a, j):
    return Moving(Trajectory(path, np.arange(len(s) + 1.0), s, v, a, j, piece), v, a, j)


@pytest.fixture(scope="module")
def motion(path):
    rng = np.random.default_rng(11)
    piece = rng.integers(0, 3, COUNT)
    s = path.breaks[piece] + rng.random(COUNT) * np.diff(path.breaks)[piece]
    return moving(
        path,
        s,
        piece,
        rng.uniform(0, 0.1, COUNT),
        rng.normal(0, 1, COUNT),
        rng.normal(0, 20, COUNT),
    )


def term_values(motion):
    v, a, j = motion.v, motion.a, motion.j
    return {
        Term.ONE: v**0, Term.SD: v, Term.SD2: v**2, Term.SD3: v**3, Term.SDD: a, Term.SDSDD: v * a, Term.SDDD: j,
    }  # fmt: skip


def row_sum(limit, motion):
    """Σ coefficient · term (N, m), and the rows' bound."""
    trajectory = motion.trajectory
    rows = limit.rows(make_points(trajectory.path, trajectory.s, trajectory.piece))
    assert set(rows.coefficients) == limit.terms
    values = term_values(motion)
    return sum(
        rows.coefficients[term] * values[term][:, None] for term in rows.coefficients
    ), rows.bound


def test_rows_sum_to_the_value_that_the_certificate_bounds(timing_limit, motion):
    total, bound = row_sum(timing_limit, motion)
    value = timing_limit.value(motion.state)
    expected = ZOO[type(timing_limit)].row(value)
    loss = ZOO[type(timing_limit)].loss
    turning = motion.trajectory.piece == 2
    if timing_limit.name.startswith("tool "):  # on a turn it stands, and has no cap
        assert (value[turning] == 0).all()
        assert np.isinf(bound[turning]).all()
    if not loss:
        assert np.abs(total - expected).max() <= 1e-13 * np.abs(expected).max()
    # and both are shares of the same bound
    use = timing_limit.use(value, value, motion.trajectory.piece)
    share = np.abs(total) / bound
    if isinstance(timing_limit, ToolLimit):
        share = share.max(1, keepdims=True)
    counts = use > 0 if type(timing_limit) in BY_LINES else np.ones(use.shape, bool)
    assert counts.any(0).all()
    expected = np.clip(share, use, use * (1 + loss))
    assert share[counts] == pytest.approx(expected[counts], rel=1e-9, abs=1e-12)


def test_use_is_one_exactly_at_the_bound(even_limit):
    limit, piece = even_limit, np.array([0, 1])
    full = ZOO[type(limit)].full(limit, piece)
    assert (
        np.abs(limit.use(full, full, piece) - 1).max() <= 2**-51
    )  # a root or an arc cosine may round
    for share in (0.5, 0.999, 1.001, 1.4):
        part = full * share
        if isinstance(limit, Tilt):
            part = np.cos(limit.bounds * share) + 0 * full
        elif isinstance(limit, Clearance):
            part = full / share
        use = limit.use(part, part, piece)
        assert use == pytest.approx(
            np.sqrt(share) if isinstance(limit, ToolLimit) else share, rel=1e-12
        )


def test_use_of_a_range_is_its_worst_value_s(even_limit, motion):
    limit = even_limit
    value = limit.value(motion.state)
    piece = motion.trajectory.piece
    low, high = np.minimum(value, value[::-1]), np.maximum(value, value[::-1])
    both = limit.use(low, high, piece)
    inside = [limit.use(x, x, piece) for x in (low, high, 0.3 * low + 0.7 * high)]
    assert both == pytest.approx(np.maximum(*inside[:2]), rel=1e-15)
    assert (both >= inside[2] * (1 - 1e-15)).all()


@pytest.mark.parametrize("excess", [1.0, 1 + 1e-6, 1.3, 40.0])
def test_slowness_brings_a_motion_to_the_limit(falling_limit, motion, excess):
    """Slowed k times, each term falls by its own power of k; a motion that used `excess` then uses
    1.
    """

    def used(motion):
        value = falling_limit.value(motion.state)
        return falling_limit.use(value, value, motion.trajectory.piece).max()

    power = min(term.per_time for term in falling_limit.terms)
    quick = motion.slowed((used(motion) / excess) ** (1 / power))
    assert used(quick) == pytest.approx(excess, rel=1e-12)
    k = falling_limit.slowness(used(quick))
    assert used(quick.slowed(k)) == pytest.approx(1.0, rel=1e-12)


def test_scaled_bounds_are_used_by_as_much_less(limit, motion):
    """In the certificate and in the rows; a curve's line, a band and what no timing changes are not
    scaled.
    """
    if limit.geometric or isinstance(limit, (TorqueSpeed, Resonance)):
        with pytest.raises(MotionError, match=limit.name):
            limit.scale(2.0, 0)
        return
    value, piece = limit.value(motion.state), motion.trajectory.piece
    before, of_rows = limit.use(value, value, piece), row_sum(limit, motion)[1]
    for channel in (None, 0):
        twice = limit.scale(2.0, channel)
        factor = np.ones(before.shape[1])
        factor[channel if channel is not None else slice(None)] = 2.0
        assert twice.use(value, value, piece) == pytest.approx(before / factor, rel=1e-14)
        rows = row_sum(twice, motion)[1]
        assert rows == pytest.approx(
            of_rows * (2.0 if isinstance(limit, ToolLimit) else factor), rel=1e-14
        )
    assert limit.use(value, value, piece) == pytest.approx(before, rel=0)


def test_slowness_is_one_where_a_limit_is_kept(limit):
    assert limit.slowness(0.0) == limit.slowness(0.7) == limit.slowness(1.0) == 1.0


def test_geometric_limits_put_no_rows(limits, path, motion):
    geometric = {kind for kind, limit in limits.items() if limit.geometric}
    assert geometric == {kind for kind, case in ZOO.items() if case.row is None}
    for kind in geometric:
        with pytest.raises(MotionError, match=f"{limits[kind].name} is geometric"):
            limits[kind].rows(make_points(path, path.breaks[:1], np.zeros(1, int)))
        assert limits[kind].slowness(7.0) == 1.0
    problem = pose_problem(
        path, list(limits.values()), np.linspace(0, path.breaks[1], 11), np.zeros(10, int)
    )
    timed = {limit.name for limit in limits.values() if not limit.geometric}
    assert {block.name for block in problem.blocks} == timed - {
        "force"
    }  # which nothing here can use half of


def test_channels_bounds_and_units_belong_together(limit, motion):
    assert (
        len(limit.channels)
        == len(limit.bounds)
        == len(limit.units)
        == limit.value(motion.state).shape[1]
    )
    for channel, (unit, scale) in enumerate(limit.units):
        said, allowed = limit.report_value(
            float(ZOO[type(limit)].full(limit, np.zeros(1, int))[0, channel]), channel, 0
        )
        expected = {"deg": 180 / np.pi, "mm": 1e3, "1": 1.0, "N": 1.0}
        assert scale == expected[unit.split("/")[0]]
        assert said == pytest.approx(allowed, rel=1e-12, abs=1e-12)


def test_travel_is_told_as_the_stroke_from_home(limits, hexapod):
    travel = limits[Travel]
    q = hexapod.home_q + 0.06
    assert travel.report_value(float((q - travel.middle)[2]), 2, 0) == pytest.approx(
        (0.06, 0.0508), rel=1e-12
    )
    q = hexapod.home_q - 0.004
    assert travel.report_value(float((q - travel.middle)[2]), 2, 0) == pytest.approx(
        (-0.004, 0.0), abs=1e-15
    )


def test_tilt_is_the_angle_of_leg_and_rest_axis(limits, motion, hexapod):
    """Against angles from joint positions: between leg and base z, and between leg and platform
    z.
    """
    pose = motion.state.pose
    rotation = pose.rotation.as_matrix()
    legs = (
        pose.translation[:, None]
        + np.einsum("nij,kj->nki", rotation, hexapod.platform)
        - hexapod.base
    )
    along = np.stack(
        [np.broadcast_to([0.0, 0, 1], (COUNT, 3)), rotation[:, :, 2]], 1
    )  # base, platform
    crossed = np.linalg.norm(np.cross(along[:, :, None], legs[:, None]), axis=3)
    angle = np.arctan2(crossed, np.einsum("nej,nkj->nek", along, legs)).reshape(COUNT, 12)
    value = limits[Tilt].value(motion.state)
    assert limits[Tilt].use(value, value, motion.trajectory.piece) * np.deg2rad(
        35
    ) == pytest.approx(angle, abs=1e-12)


def test_an_axis_without_a_limit_is_free(path, hexapod):
    free = [replace(axis, max_speed=None, travel=(-np.inf, np.inf)) for axis in hexapod.axes[:5]]
    found = {limit.name: limit for limit in limits_of(path, [*free, hexapod.axes[5]], 3)}
    speed = found["speed"]
    value = np.full((1, 6), 0.01)
    assert speed.use(value, value, np.zeros(1, int))[0].tolist() == [0, 0, 0, 0, 0, 0.5]
    problem = pose_problem(path, [speed], np.linspace(0, path.breaks[1], 11), np.zeros(10, int))
    assert problem.blocks[0].start[Term.SD].shape == (10, 1)


def test_unlimited_travel_is_no_travel_used():
    axes = [Axis("x"), Axis("y", travel=(-1.0, 3.0))]
    travel = Travel(axes, np.array([0.5, 0.5]))
    assert travel.middle.tolist() == [0.0, 1.5]
    value = np.array([[1e6, 2.0]])
    assert travel.use(value, value, np.zeros(1, int)).tolist() == [[0.0, 1.0]]


def test_limits_that_bind_nothing_are_left_out():
    path = PolynomialPath([0.0, 1.0], np.array([[[1.0]], [[0.0]]]), ["x"])
    assert limits_of(path, [Axis("x")], 3) == ()
    assert [limit.name for limit in limits_of(path, [Axis("x", max_jerk=1.0)], 3)] == ["jerk"]
    assert limits_of(path, [Axis("x", max_jerk=1.0)], 2) == ()


def test_tool_and_turning_are_what_poses_do(limits, path):
    """Against differences of poses along a motion: ‖ṗ‖, ‖p̈‖ and the angle between neighbouring
    orientations.
    """
    t, v, a, h = np.linspace(0.1, 0.9, 9), 0.011, 0.004, 1e-4
    for piece in range(3):
        run = moving(
            path, path.breaks[[piece]], np.array([piece]), np.array([v]), np.array([a]), np.zeros(1)
        ).trajectory
        before, now, after = (run.at(t + shift) for shift in (-h, 0.0, h))
        rate = np.linalg.norm(after.pose.translation - before.pose.translation, axis=1) / (2 * h)
        second = after.pose.translation - 2 * now.pose.translation + before.pose.translation
        turned = (before.pose.rotation.inv() * after.pose.rotation).magnitude() / (2 * h)
        for kind, expected in (
            (ToolSpeed, rate),
            (ToolAcceleration, np.linalg.norm(second, axis=1) / h**2),
        ):
            assert np.sqrt(limits[kind].value(now)[:, 0]) == pytest.approx(
                expected, rel=1e-5, abs=1e-7
            )
        assert np.sqrt(limits[AngularSpeed].value(now)[:, 0]) == pytest.approx(
            turned, rel=1e-5, abs=1e-7
        )


def test_a_tool_speed_is_a_limit_only_where_a_program_caps_it(hexapod):
    free = actuate(Program([Line([0, 0, 0.01])]), hexapod)
    assert "tool speed" not in {limit.name for limit in limits_of(free, hexapod.axes, 2)}
    capped = actuate(Program([Line([0, 0, 0.01]), Line([0, 0, 0.02], speed=0.007)]), hexapod)
    tool = next(limit for limit in limits_of(capped, hexapod.axes, 2) if limit.name == "tool speed")
    assert tool.caps.tolist() == [np.inf, 0.007]
    fast = np.full((2, 1), 0.014**2)
    assert tool.use(fast, fast, np.array([0, 1])).ravel() == pytest.approx([0, 2], rel=1e-12)


def test_what_each_axis_may_do_is_the_least_of_what_bounds_it():
    """A drive of 3.8 µs a pulse takes one each 4 µs on a clock of 1 MHz: 250 000 pulses of 1 µm are
    0.25 m/s.
    """
    path = PolynomialPath([0.0, 1.0], np.ones((2, 1, 4)), ["a", "b", "c", "d"])
    axes = [
        Axis("a", max_speed=0.3, max_pulse_rate=1 / 3.8e-6, max_acceleration=2.0, max_jerk=9.0),
        Axis("b", max_speed=0.2, max_pulse_rate=1 / 3.8e-6, max_acceleration=2.0, max_jerk=9.0),
        Axis("c", kind="rotary", max_speed=(1.0, 3.0), resonance=((2.0, 4.0),)),
        Axis("d", kind="rotary", max_speed=(1.0, 3.0), resonance=((2.0, 4.0),)),
    ]
    table = tabulate_axis_bounds(axes, limits_of(path, pace_axes(axes, 1_000_000), 2), 2)
    paced = "250000 pulses/s of 1 µm, of 263158 stated: pulses are whole ticks apart"
    assert [row[:2] for row in table.cells()] == [
        ["a", "speed"],
        ["", "acceleration"],
        ["b", "speed"],
        ["", "acceleration"],
        ["c, d", "speed towards smaller positions"],
        ["", "speed towards greater positions"],
        ["", "acceleration"],
    ]
    assert table.columns[2].raw == pytest.approx([0.25, 2.0, 0.2, 2.0, 1.0, 2.0, np.inf])
    band = "start of its resonance band"
    stated = [paced, "max_acceleration", "max_speed", "max_acceleration", "max_speed", band, ""]
    assert table.columns[3].raw == stated


@pytest.mark.parametrize("kind", ["linear", "rotary"])
def test_units_follow_the_axis(kind):
    axes = [Axis("a", kind=kind, max_speed=1.0, max_acceleration=1.0, max_jerk=1.0)]
    path = PolynomialPath([0.0, 1.0], np.array([[[1.0]], [[0.0]]]), ["a"])
    unit = "mm" if kind == "linear" else "deg"
    told = {limit.name: limit.units[0][0] for limit in limits_of(path, axes, 3)}
    assert told == {"speed": f"{unit}/s", "acceleration": f"{unit}/s²", "jerk": f"{unit}/s³"}
