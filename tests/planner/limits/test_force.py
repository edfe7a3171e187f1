"""Forces that bind: analytic answers of one axis, independent dynamics along whole plans, what
cannot hold still.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import Body, Leg, Load, MotionError, Traverser, forces, load_machine, machine_names
from kinematics.machine.load import GRAVITY
from planner import Arc, Infeasible, Line, Program, Trajectory, check, classical, plan
from planner.certificate import Cells, bound_series, certify, enclose
from planner.limits import find_unkept_limits, limits_of
from planner.limits.force import Force, Holding, slowness
from planner.path.actuation import actuate
from tests.kinematics.bodies import PLATE, combine_bodies

G = -GRAVITY[2]
UP, DOWN = Program([Line([0, 0, 0.3])]), Program([Line([0, 0, -0.3])])
HEAVY = Body(60.0, [0.01, 0, 0.1], np.diag([1.0, 2.0, 1.5]))
TILTED = Program([Line([0.01, 0, 0.02], Rotation.from_euler("XYZ", [3, -4, 5], degrees=True))])


def with_axes(machine, load=None, **own):
    """The same machine whose axes state something else."""
    made = machine.carrying(machine.load if load is None else load)
    made.axes = tuple(replace(axis, **own) for axis in machine.axes)
    return made


def sampled(found):
    return found.trajectory.at(np.linspace(0, found.trajectory.duration, 2001))


@pytest.mark.parametrize(("program", "sign"), [(UP, 1), (DOWN, -1)], ids=["up", "down"])
def test_gravity_helps_one_way(slide, program, sign):
    """Speeding up takes (F ∓ mg)/m, stopping (F ± mg)/m: T = √(2 L (1/a + 1/b)), to one of 1000
    intervals: 1e-6.

    Solvers aim at 1 − 1e-6 of F, of which gravity takes its part: a changes by up to F/(F − mg) of
    that, 2.9e-6.
    """
    up, down = (30 - sign * 2 * G) / 2, (30 + sign * 2 * G) / 2
    found = plan(program, slide(2.0, max_force=30.0), order=2)
    assert found.certificate.holds
    assert found.trajectory.duration == pytest.approx(
        np.sqrt(2 * 0.3 * (1 / up + 1 / down)), rel=2.5e-6
    )
    state = found.trajectory.at(np.array([0.1, 0.9]) * found.trajectory.duration)
    assert sign * state.qdd[:, 2] == pytest.approx([up, -down], rel=4e-6)
    assert found.certificate.worst["holding force"] == pytest.approx(2 * G / 30, rel=1e-9)


def test_a_jerk_limit_rounds_the_corners(slide):
    """With J large, what the jerk adds falls with 1/J: it lies above, by 1.5 (a + b)/J of the
    corners at most.
    """
    up, down = (30 - 2 * G) / 2, (30 + 2 * G) / 2
    least = np.sqrt(2 * 0.3 * (1 / up + 1 / down))
    found = plan(UP, slide(2.0, max_force=30.0, max_jerk=1e4), order=3)
    assert found.certificate.holds
    assert least < found.trajectory.duration < least + 1.5 * (up + down) / 1e4


@pytest.mark.parametrize("sign", [1, -1], ids=["up", "down"])
def test_friction_holds_back_and_helps_to_stop(slide, bang_bang, sign):
    """v̇ = (±F − mg − c v)/m. Constant acceleration over 1000 intervals costs 5e-4 where the
    friction grows fastest.
    """
    c, top = 8.0, (30 - sign * 2 * G) / 8.0 * (1 - 1e-9)
    least = bang_bang(
        0.3,
        lambda v: (30 - sign * 2 * G - c * v) / 2,
        lambda v: (30 + sign * 2 * G + c * v) / 2,
        top,
    )
    program = UP if sign > 0 else DOWN
    for order, jerk in ((2, None), (3, 1e5)):
        found = plan(program, slide(2.0, max_force=30.0, friction=c, max_jerk=jerk), order=order)
        assert found.certificate.holds
        assert least * (1 - 1e-6) <= found.trajectory.duration <= least * (1 + 1.5e-3)


def test_a_long_way_is_run_at_the_speed_that_friction_leaves(slide):
    """Nothing else bounds the speed: c v = F − mg."""
    found = plan(Program([Line([0, 0, 3.0])]), slide(2.0, max_force=30.0, friction=20.0), order=2)
    terminal = (30 - 2 * G) / 20.0
    assert sampled(found).qd[:, 2].max() == pytest.approx(terminal, rel=1e-3)
    assert sampled(found).qd[:, 2].max() <= terminal * (1 + 1e-6)


@pytest.mark.parametrize(
    "legs", [(), (Leg(Body(2.0, [0, 0, 0.1]), Body(1.0, [0, 0, -0.1])),)], ids=["bare", "legs"]
)
@pytest.mark.parametrize("order", [2, 3])
def test_a_heavy_platform_takes_longer_and_its_forces_are_proved(hexapod, order, legs):
    """Against `forces` (twists, closed loops in pinocchio) at 2001 instants; accelerations ten
    times the preset's.
    """
    if legs:
        pytest.importorskip("pinocchio")
    quick = {"max_speed": 0.2, "max_acceleration": 2.25, "max_jerk": 400.0}
    light = with_axes(hexapod, **quick)
    heavy = with_axes(hexapod, Load(HEAVY, legs), friction=30.0, reflected=1.0, **quick)
    found = plan(TILTED, heavy, order=order)
    assert found.trajectory.duration > 1.02 * plan(TILTED, light, order=order).trajectory.duration
    assert found.certificate.holds
    use = forces(heavy, sampled(found)).use.max()
    assert found.certificate.worst["force"] <= 1 + 1e-6
    assert 0.999 < use <= found.certificate.worst["force"] * (1 + 1e-9)
    assert found.certificate.worst["force"] <= found.certificate.attained["force"].max() + 1e-6


def test_an_arm_keeps_its_torques():
    pytest.importorskip("pinocchio")
    arm = with_axes(load_machine("arm"), max_force=9.0)
    home = arm.home.translation
    program = Program([Line(home + np.array([-0.1, 0.05, 0.1]))], frame="base")
    found = plan(program, arm, order=2)
    assert found.certificate.holds
    free = plan(program, load_machine("arm"), order=2)
    assert free.trajectory.duration < found.trajectory.duration
    use = forces(arm, sampled(found)).use.max()
    assert 0.99 < use <= found.certificate.worst["force"] * (1 + 1e-9)


@pytest.mark.parametrize("name", ["hexapod", "tripod", "linkage", "traverser", "arm"])
def test_every_value_lies_in_the_enclosure_of_its_cell(name):
    """Series against `forces`, anywhere inside cells of a motion that is no answer to anything."""
    if name == "arm":
        pytest.importorskip("pinocchio")
    wrench = [3.0, -2.0, 5.0, 0.1, 0.2, -0.3]
    legs = (Leg(Body(0.4, [0, 0, 0.1]), Body(0.2, [0, 0, -0.1])),) if name == "hexapod" else ()
    machine = with_axes(
        load_machine(name), Load(HEAVY, legs, wrench=wrench), friction=2.0, reflected=0.3
    )
    turn = [0, 0, 0.02] if name in ("hexapod", "tripod") else [0.03, 0.02, 0.0]
    start = machine.home.translation
    held = [Line(start + turn), Arc(start + turn + [0.01, 0, 0], [0, 0, 1], 1.0)]
    path = actuate(Program(held, frame="base"), machine)
    rng = np.random.default_rng(4)
    piece = rng.integers(0, 2, 40)
    s = path.breaks[piece] + rng.uniform(0, 0.9, 40) * np.diff(path.breaks)[piece]
    v, a, j = rng.uniform(0, 0.02, 40), rng.normal(0, 0.05, 40), rng.normal(0, 0.2, 40)
    walk = Trajectory(path, 0.01 * np.arange(41.0), s, v, a, j, piece)
    cells = Cells(np.arange(40), np.zeros(40), np.full(40, 0.01))
    for limit in (Force(machine, path), Holding(machine)):
        low, high = bound_series(limit.value(enclose(walk, cells, 6)), 40)
        assert np.isfinite(low).all()
        for share in (0.0, 0.3, 1.0):
            state = walk.within(cells.k, share * cells.hi)
            value = limit.value(state)
            slack = 1e-9 * np.abs(value).max()
            assert (low - slack <= value).all()
            assert (value <= high + slack).all()
            if isinstance(limit, Force):
                assert (
                    np.abs(forces(machine, state).force - value).max() < 1e-9 * np.abs(value).max()
                )


def test_a_machine_that_cannot_hold_itself_is_told_so_first(hexapod, limit_search):
    """The weight of 140 kg: the worst leg, the place, the force there by `forces`, and the
    limit.
    """
    limit_search(0.0)
    heavy = hexapod.carrying(Load(Body(140.0, [0.05, 0, 0.1])))
    with pytest.raises(Infeasible, match="the machine cannot hold itself still there") as refusal:
        plan(TILTED, heavy, order=2)
    told = refusal.value
    assert (told.kind, told.limit, told.unit) == ("holding force", 220.0, "N")
    path = actuate(TILTED, heavy)
    at = Trajectory(path, np.array([0.0, 1.0]), *np.zeros((4, 1)), np.zeros(1, int))
    at = replace(at, s=np.array([told.place.s]))
    leg = [axis.name for axis in heavy.axes].index(told.axis)
    assert told.value == pytest.approx(abs(forces(heavy, at.at(0.0)).force[0, leg]), rel=1e-9)


def test_a_slide_s_weight_is_told_to_its_last_gram(slide):
    """30 N hold 30/g kg: a thousandth more is refused, a thousandth less moves."""
    for share in (0.999, 1.001):
        machine = slide(share * 30 / G, max_force=30.0)
        if share > 1:
            with pytest.raises(
                Infeasible,
                match=r"Z, s = .*cannot hold itself still there: reduce its load by 0\.03 N",
            ):
                plan(UP, machine, order=2)
        else:
            assert plan(UP, machine, order=2).certificate.holds


def test_a_level_slide_holds_what_an_upright_one_cannot(slide):
    """The same machine on a base that lies on its side."""
    upright = slide(10.0, max_force=30.0)
    with pytest.raises(Infeasible):
        plan(UP, upright, order=2)
    level = upright.carrying(Load(upright.load.platform, gravity=[0, -G, 0]))
    assert plan(UP, level, order=2).trajectory.duration == pytest.approx(
        2 * np.sqrt(0.3 * 10 / 30), rel=1e-6
    )


@pytest.mark.parametrize(
    ("use", "held", "power"), [(1.3, 0.0, 2), (40.0, 0.5, 2), (1 + 1e-6, 0.99, 1), (0.7, 0.4, 1)]
)
def test_slowed_so_much_a_motion_keeps_the_limit(use, held, power):
    k = slowness(use, held, power)
    assert held + (use - held) / k**power <= 1 + 1e-12
    assert k >= 1


def test_a_motion_slowed_keeps_its_forces(hexapod):
    """A motion far too fast, slowed by what its limit says: proved to keep it."""
    heavy = with_axes(hexapod, Load(HEAVY), friction=30.0)
    path = actuate(TILTED, heavy)
    limit = Force(heavy, path)
    length = float(path.breaks[-1])

    def hop(time):
        """From rest to rest with one acceleration up and down."""
        a = length / (time / 2) ** 2
        knots, s = np.array([0.0, time / 2, time]), np.array([0.0, length / 2])
        return Trajectory(
            path,
            knots,
            s,
            np.array([0.0, a * time / 2]),
            np.array([a, -a]),
            np.zeros(2),
            np.zeros(2, int),
        )

    fast = certify(hop(0.02), [limit]).worst["force"]
    assert fast > 2
    slowed = certify(hop(0.02 * limit.slowness(fast)), [limit]).worst["force"]
    assert limit.holding_share < slowed <= 1 + 1e-6


def test_what_is_stated_but_cannot_be_kept(hexapod):
    assert find_unkept_limits(hexapod) == ("max_force",)
    loaded = hexapod.carrying(Load(HEAVY))
    assert find_unkept_limits(loaded) == ()
    path = actuate(TILTED, hexapod)
    assert not {"force", "holding force"} & {
        limit.name for limit in limits_of(path, hexapod.axes, 2)
    }
    path = actuate(TILTED, loaded)
    assert {"force", "holding force"} <= {limit.name for limit in limits_of(path, loaded.axes, 2)}


@pytest.mark.parametrize("name", machine_names())
def test_every_bundled_machine_keeps_what_it_states(name):
    if name == "arm":
        pytest.importorskip("pinocchio")
    assert find_unkept_limits(load_machine(name)) == ()


def test_forces_alone_bound_a_motion(slide):
    """No speed, no acceleration is stated; without masses nothing is bounded, and that is said."""
    bare = slide(0.0, max_force=30.0)
    with pytest.raises(MotionError, match="the motion is unbounded"):
        plan(
            UP,
            Traverser(axes=[replace(a, max_acceleration=None) for a in bare.axes], home=bare.home),
            order=2,
        )
    axes = [replace(axis, max_acceleration=None, reflected=2.0) for axis in bare.axes]
    alone = Traverser(axes=axes, home=RigidTransform.identity())
    assert plan(UP, alone, order=2).trajectory.duration == pytest.approx(
        2 * np.sqrt(0.3 * 2 / 30), rel=1e-6
    )


def test_the_classical_trapezoid_pays_for_friction_too(slide):
    """Up: m V²/2d + c V = F − mg at the end of the ramp; the best d by trying all, to the grid of
    3000: 1e-4.
    """
    found = classical(plan(UP, slide(2.0, max_force=30.0, friction=8.0), order=2))
    d = np.linspace(1e-3, 0.15, 100_001)
    v = (-8 + np.sqrt(64 + 4 * (30 - 2 * G) / d)) / (2 / d)
    assert found.certificate.holds
    assert found.duration == pytest.approx(((0.3 + 2 * d) / v).min(), rel=1e-4)


@pytest.mark.parametrize("order", [2, 3])
def test_rows_that_cannot_bind_cost_no_time(laden, order):
    """The plate's weight uses 3 % of the actuators: the same motion to the last digit, its forces
    proved all the same.

    With forces that its motions use more than half of, the rows are there, and the proof holds.
    """
    kept, bare = (
        plan(TILTED, laden, order=order),
        plan(TILTED, with_axes(laden, Load()), order=order),
    )
    assert kept.trajectory.duration == bare.trajectory.duration
    assert "force" not in bare.certificate.worst
    use = forces(laden, sampled(kept)).use.max()
    assert use <= kept.certificate.worst["force"] <= use + 1e-3 < 0.05
    weak = plan(
        TILTED,
        with_axes(laden, max_force=1.02 * 220 * kept.certificate.worst["holding force"]),
        order=order,
    )
    assert weak.certificate.holds
    assert weak.trajectory.duration > kept.trajectory.duration


def test_the_preset_weighs_what_its_comments_say(laden):
    """The plate, and six screws and joints as points in the joint centres; to the digits of the
    file.
    """
    points = [Body(0.041 + 0.060, centre) for centre in laden.platform]
    whole = combine_bodies(PLATE, *points)
    assert laden.load.platform.mass == pytest.approx(whole.mass, abs=5e-4)
    assert laden.load.platform.centre == pytest.approx(whole.centre, abs=5e-6)
    assert laden.load.platform.inertia == pytest.approx(whole.inertia, abs=5e-6)


@pytest.mark.parametrize(("newtons", "holds"), [(222.0, False), (223.0, True)])
def test_a_traverser_s_vertical_slide_has_to_hold_its_weight(newtons, holds):
    """50 lb on X, which is vertical: 222.4 N [Sasidhar 1981]; the other slides need next to
    nothing.
    """
    machine = load_machine("traverser").carrying(Load(Body(50 * 0.45359237)))
    machine = machine.driven_by([replace(axis, max_force=newtons) for axis in machine.axes])
    standing = check(Program([Line([0.1, 0.1, 0.1])]), machine)
    assert bool(standing.violations) != holds
    if not holds:
        assert "X" in str(standing.violations[0])
    else:
        assert standing.largest["holding force"][0] == pytest.approx(222.411 / newtons, rel=1e-5)
