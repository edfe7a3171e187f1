"""What is proved of shaped motions, against samples of what the axes reach: limits, rates of the
pose, deviations.
"""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from benchmarks.evidence.flexible_load import FlexibleLoad
from kinematics import load_machine
from kinematics.foundation.errors import MotionError
from kinematics.machine.load import Body, Load
from kinematics.machine.shaper import Shaper
from planner import Arc, Dwell, Infeasible, Line, Program, Trigger, load_program, plan
from planner.certificate import Cells, bound_series
from planner.limits import limits_of
from planner.path.actuation import actuate
from planner.shaping import shaped_proof
from planner.shaping.keep_limits import solve_shaped
from planner.shaping.shaped_enclosure import enclose_shaped
from planner.shaping.shaped_motion import reached_poses
from planner.timing import certified_solve

KINDS = {
    "hexapod": ("blended", Shaper("zv", 35.0, 0.05)),
    "tripod": ("tripod-circle", Shaper("zvd", 35.0, 0.05)),
    "linkage": ("linkage-line", Shaper("mzv", 30.0)),
    "arm": ("arm-line", Shaper("ei", 25.0, 0.1)),
    "traverser": ("traverser-scan", Shaper("zv", 10.0)),
}


@cache
def solve(name, order=None, shaper=None):
    program, given = KINDS[name]
    machine = load_machine(name)
    machine = machine.driven_by([replace(axis, shaper=shaper or given) for axis in machine.axes])
    path = actuate(load_program(program), machine)
    order = order or (3 if machine.axes[0].max_jerk else 2)
    limits = limits_of(path, machine.axes, order)
    solution, _, proof, _ = solve_shaped(
        lambda kept: certified_solve(path, kept, order), path, limits, machine.axes
    )
    return machine, limits, solution.trajectory, proof


def sample(machine, trajectory, proof, t):
    """Positions (N, 3) of the platform and of the path `delay` before, and its rotations, at t
    (N,).
    """
    shaped = proof.motion
    poses = reached_poses(trajectory, shaped, t, shaped.at(t).q)
    about = trajectory.at(np.clip(t - proof.delay, 0.0, trajectory.duration)).pose
    return poses, about


def measure_contour(trajectory, places):
    """(N,) m from places (N, 3) to the strokes beside the nearest of many points of the path."""
    points = trajectory.at(np.linspace(0, trajectory.duration, 100_001)).pose.translation
    nearest = np.clip(cKDTree(points).query(places)[1], 1, len(points) - 2)
    found = []
    for first, last in (
        (points[nearest - 1], points[nearest]),
        (points[nearest], points[nearest + 1]),
    ):
        way = last - first
        share = ((places - first) * way).sum(1) / np.maximum((way**2).sum(1), 1e-30)
        found.append(np.linalg.norm(places - first - np.clip(share, 0, 1)[:, None] * way, axis=1))
    return np.minimum(*found)


@pytest.fixture(scope="module", params=sorted(KINDS))
def solved(request):
    return solve(request.param)


def test_every_limit_is_kept_behind_the_shapers(solved):
    machine, limits, _, proof = solved
    assert proof.holds
    assert set(proof.worst) == {limit.name for limit in limits}
    shaped = proof.motion
    t = np.linspace(0, shaped.duration, 20_001)
    state, axes = shaped.at(t), machine.axes
    for values, name in (
        (state.qd, "max_speed"),
        (state.qdd, "max_acceleration"),
        (state.qddd, "max_jerk"),
    ):
        bounds = [getattr(axis, name) for axis in axes]
        if None not in bounds and not (
            name == "max_jerk" and len(limits) and "jerk" not in proof.worst
        ):
            assert (np.abs(values).max(0) <= np.array(bounds) * (1 + 1e-9)).all(), name
    lo, hi = np.array([axis.travel for axis in axes]).T
    assert (
        (state.q - machine.home_q >= lo - 1e-12) & (state.q - machine.home_q <= hi + 1e-12)
    ).all()


def test_the_deviation_holds_and_is_close(solved):
    machine, _, trajectory, proof = solved
    t = np.linspace(0, proof.motion.duration, 6_001)
    poses, about = sample(machine, trajectory, proof, t)
    away = np.linalg.norm(poses.translation - about.translation, axis=1).max()
    turned = (poses.rotation * about.rotation.inv()).magnitude().max()
    assert away <= proof.deviation <= 1.3 * away
    off = measure_contour(trajectory, poses.translation).max()
    assert off - 1e-10 <= proof.contour <= min(1.06 * off + 1e-7, proof.deviation)
    assert turned <= proof.turn + 1e-12
    moved = np.abs(
        proof.motion.at(t).q - trajectory.at(np.clip(t - proof.delay, 0, trajectory.duration)).q
    ).max(0)
    copies = proof.motion.copies
    spread = ((copies.delays - copies.centre) ** 2) @ copies.weights
    most = np.abs(trajectory.at(np.linspace(0, trajectory.duration, 20_001)).qdd).max(0)
    assert (moved <= proof.axis_deviation + 1e-15).all()
    assert (proof.axis_deviation <= 0.5 * spread * most * 1.01 + 1e-12).all()


def test_rates_of_the_pose_are_enclosed(solved):
    """Against central differences of the poses that forward kinematics finds."""
    machine, _, trajectory, proof = solved
    shaped = proof.motion
    cells = np.flatnonzero(np.diff(shaped.knots) > 1e-3)
    cells = cells[:: max(1, len(cells) // 40)]
    begin = 0.4 * np.diff(shaped.knots)[cells]
    found = enclose_shaped(shaped, trajectory, Cells(cells, begin, begin + 4e-4))
    middle, h = shaped.knots[cells] + begin + 2e-4, 1e-4
    x = [
        np.concatenate([p.translation, p.rotation.as_matrix().reshape(-1, 9)], 1)
        for p in (sample(machine, trajectory, proof, middle + d)[0] for d in (-h, 0, h))
    ]
    first, second = (x[2] - x[0]) / (2 * h), (x[2] - 2 * x[1] + x[0]) / h**2
    for times, wanted, tolerance in ((0, x[1], 1e-9), (1, first, 2e-4), (2, second, 5e-2)):
        low, high = bound_series(found.pose_rate(times), len(cells))
        size = max(1e-3, np.abs(wanted).max())
        assert ((wanted >= low - tolerance * size) & (wanted <= high + tolerance * size)).all(), (
            times
        )
        assert np.isfinite(high).all()


def test_tilt_tool_speed_and_force_are_bounded():
    """The hexapod's by its own inverse maps, at what its legs reach."""
    machine, limits, trajectory, proof = solve("hexapod")
    shaped, h = proof.motion, 1e-5
    t = np.linspace(0.01, shaped.duration - 0.01, 2001)
    poses = [sample(machine, trajectory, proof, t + d)[0] for d in (-h, h)]
    speed = np.linalg.norm(poses[1].translation - poses[0].translation, axis=1) / (2 * h)
    caps = next(limit for limit in limits if limit.name == "tool speed").caps
    on = [np.clip(t - delay, 0, trajectory.duration) for delay in shaped.copies.delays]
    use = (speed / np.max([caps[trajectory.at(own).piece] for own in on], axis=0)).max()
    assert 0.99 < use <= proof.worst["tool speed"] <= 1
    margins = machine.check(poses[0])
    assert 0.9 * proof.worst["tilt"] < margins.tilt.max() <= proof.worst["tilt"]
    assert {"tool speed", "tilt", "clearance", "force", "holding force"} <= set(proof.worst) - set(
        proof.convex
    )


def test_axes_with_shapers_of_their_own_stay_together():
    """Different shapers, one centroid: what is left of second order is bounded as well."""
    machine = load_machine("tripod")
    own = [Shaper("zv", 20.0), None, Shaper("ei", 45.0, 0.1)]
    machine = machine.driven_by(
        [replace(a, shaper=s) for a, s in zip(machine.axes, own, strict=True)]
    )
    path = actuate(load_program("tripod-circle"), machine)
    limits = limits_of(path, machine.axes, 2)
    solution, _, proof, _ = solve_shaped(
        lambda kept: certified_solve(path, kept, 2), path, limits, machine.axes
    )
    t = np.linspace(0, proof.motion.duration, 6_001)
    poses, about = sample(machine, solution.trajectory, proof, t)
    away = np.linalg.norm(poses.translation - about.translation, axis=1).max()
    assert proof.holds
    assert away <= proof.deviation <= 1.3 * away


def test_modes_along_x_and_y_of_a_corexy_are_both_still_and_its_limits_kept():
    """By a convolution of its own: each belt with both trains of impulses, the screw late by their
    centroid.
    """
    machine = load_machine("corexy")
    modes = {(1, 0, 0): Shaper("zv", 35.0, 0.05), (0, 1, 0): Shaper("mzv", 22.0, 0.1)}
    for direction, shaper in modes.items():
        machine = machine.shape_along(direction, shaper)
    made = plan(Program((Line([0.03, 0.01, 0.002]), Line([0.0, 0.05, 0.01]))), machine)
    base, shaped = made.trajectory, made.shaped.motion
    assert made.shaped.holds
    assert made.shaped.where["room"].axis in ("x", "y", "z")
    assert made.order == 3
    step, end = 1e-4, shaped.duration
    t = np.arange(0.0, end + 2 * step, step)
    rows = np.zeros((4, len(t), 3))
    trains = [list(zip(*shaper.impulses, strict=True)) for shaper in modes.values()]
    late = sum(shaper.delay for shaper in modes.values())
    copies = [(a * b, s + r, (0, 1)) for a, s in trains[0] for b, r in trains[1]] + [
        (1.0, late, (2,))
    ]
    for weight, time, axes in copies:
        state = base.at(np.clip(t - time, 0, base.duration))
        inside = ((t >= time) & (t <= time + base.duration))[:, None]
        for row, values in zip(
            rows, (state.q, state.qd * inside, state.qdd * inside, state.qddd * inside), strict=True
        ):
            row[:, axes] += weight * values[:, axes]
    assert np.allclose(rows[0], shaped.at(t).q, rtol=0, atol=1e-12)
    for values, bound in zip(rows[1:], (0.3, 3.0, 100.0), strict=True):
        assert np.abs(values).max() <= bound * (1 + 1e-9)
    assert np.abs(rows[3]).max() > 40  # m/s³: the belts are made to work
    planned = base.at(np.clip(t, 0, base.duration)).q
    for (x, y, _), shaper in modes.items():
        load = FlexibleLoad(shaper.frequency, shaper.damping)
        left, bare = (
            load.residual((q[:, 0] + (x - y) * q[:, 1]) / 2, step, after)
            for q, after in ((rows[0], end), (planned, base.duration))
        )
        assert left <= 1e-3 * bare, shaper
        assert bare > 1e-7  # m: there was something to be still of
    # all axes are late alike, so that the tool leaves the path by what is of second order alone
    tool = np.stack(
        [(rows[0][:, 0] + rows[0][:, 1]) / 2, (rows[0][:, 0] - rows[0][:, 1]) / 2, rows[0][:, 2]], 1
    )
    about = base.at(np.clip(t - late, 0, base.duration)).pose.translation
    away = np.linalg.norm(tool - about, axis=1).max()
    assert made.shaped.delay == pytest.approx(late, abs=1e-15)
    assert away <= made.shaped.deviation <= 1.3 * away


def test_what_cannot_be_proved_is_refused_by_name():
    machine = load_machine("hexapod")
    shaped = [replace(axis, shaper=Shaper("zv", 35.0)) for axis in machine.axes]
    banded = [replace(axis, resonance=((0.004, 0.005),), resonance_time=0.02) for axis in shaped]
    program = load_program("bare-circle")
    with pytest.raises(MotionError, match="resonance_time cannot be proved behind an input shaper"):
        plan(program, machine.driven_by(banded))
    constant = replace(
        program,
        segments=tuple(replace(s, speed=0.005, speed_constant=True) for s in program.segments[:1]),
    )
    with pytest.raises(MotionError, match="constant tool speed"):
        plan(constant, machine.driven_by(shaped))


def test_a_limit_that_only_shaping_breaks_is_told():
    """A shaper of four seconds leads the tripod so far from a corner that no proof reaches its
    pose.
    """
    machine = load_machine("tripod")
    machine = machine.driven_by([replace(axis, shaper=Shaper("zvd", 0.5)) for axis in machine.axes])
    program = Program((Line([0, 0, -0.02]), Line([0.01, 0, -0.02])))
    unproved = "behind its input shapers the machine is not proved to stay near the path"
    with pytest.raises(MotionError, match=unproved):
        plan(program, machine, order=2)


@cache
def gantry(kind=None):
    """A traverser whose x may have a slow shaper."""
    machine = load_machine("traverser")
    own = {
        "travel": (-0.005, 0.2),
        "pulse": 5e-6,
        "max_speed": 0.2,
        "max_acceleration": 3.0,
        "max_pulse_rate": None,
    }
    axes = [
        replace(axis, **own, max_jerk=None) if axis.kind == "linear" else axis
        for axis in machine.axes
    ]
    axes = [replace(axes[0], shaper=Shaper("zv", 5.0, 0.05) if kind else None), *axes[1:]]
    return machine.driven_by(axes)


@pytest.mark.parametrize("gap", [None, 0.05])
def test_a_bound_is_of_the_limits_themselves_where_less_of_them_had_to_be_kept(gap):
    """A capped circle is solved again with less of the cap: without shapers it is faster, no bound
    above that.
    """
    line, arc = Line([0.02, 0.05, 0]), Arc([0.05, 0.05, 0], [0, 0, 1], 2 * np.pi, speed=0.19)
    bare, made = (
        plan(Program((line, arc)), gantry()),
        plan(Program((line, arc)), gantry("zv"), gap=gap),
    )
    assert "tool speed" in made.shaped.cost.lowered
    assert made.lower_bound <= bare.trajectory.duration < made.trajectory.duration
    assert made.lower_estimate <= bare.trajectory.duration * (1 + 1e-9)


def test_a_torque_speed_curve_that_shaping_breaks_is_kept_by_planning_again():
    """Means of quick and strong moments lie beyond a curve that bends inwards; by f = m q̈ of a
    copy-wise sum.
    """
    curve, machine = ((0.0, 4.0), (0.03, 2.0), (0.3, 1.5)), gantry("zv")
    axes = [replace(machine.axes[0], torque_speed=curve, max_acceleration=10.0), *machine.axes[1:]]
    machine = machine.driven_by(axes).carrying(Load(Body(1.0), gravity=[0, 0, -9.80665]))
    made = plan(Program((Line([0.1, 0.05, 0]),)), machine)
    assert made.shaped.cost.lowered["torque-speed"].least < 0.97  # less of it in places, so that
    assert 0.99 < made.shaped.worst["torque-speed"] <= 1  # all of it
    t = np.linspace(0, made.shaped.motion.duration, 100_001)
    qd, qdd = np.zeros((2, len(t)))
    for weight, time in zip(*machine.axes[0].shaper.impulses, strict=True):
        inside = (t > time) & (t < time + made.trajectory.duration)
        state = made.trajectory.at(np.clip(t - time, 0, made.trajectory.duration))
        qd, qdd = qd + weight * inside * state.qd[:, 0], qdd + weight * inside * state.qdd[:, 0]
    share = np.abs(qdd) / np.interp(np.abs(qd), *np.array(curve).T)
    assert 0.9 < share.max() <= 1 + 1e-9


def test_triggers_at_rests_come_when_all_copies_have_arrived():
    program = Program(
        (
            Line([0.02, 0.01, 0], trigger=Trigger("shot")),
            Dwell(0.5),
            Line([0, 0, 0], trigger=Trigger("end")),
        )
    )
    shot, end = plan(program, gantry("zv")).triggers
    assert shot.counts[0] == 4000
    assert end.counts[0] == 0


def test_a_stated_duration_is_that_of_the_shaped_motion():
    program = Program((Line([0.02, 0.01, 0]),), duration=2.0)
    made = plan(program, gantry("zv"))
    assert made.pulses.duration == pytest.approx(2.0, abs=1e-6)
    with pytest.raises(MotionError, match="the input shapers alone take"):
        plan(replace(program, duration=0.01), gantry("zv"))


def test_bounds_at_the_pose_that_is_reached_are_close():
    """Those of clearance and tilt, a fifth of a millimetre off the path: no more than 0.1 % above
    what is seen.
    """
    machine = load_machine("hexapod")
    machine = machine.driven_by(
        [replace(axis, shaper=Shaper("zvd", 20.0)) for axis in machine.axes]
    )
    made = plan(load_program("blended"), machine, order=2)
    t = np.linspace(0, made.shaped.motion.duration, 6_001)
    poses, about = sample(machine, made.trajectory, made.shaped, t)
    assert np.linalg.norm(poses.translation - about.translation, axis=1).max() > 150e-6
    margins = machine.check(poses)
    for kind in ("clearance", "tilt"):
        chosen = [k for k, name in enumerate(margins.names) if name.endswith(kind)]
        use = margins.uses[:, chosen].max()
        assert use <= made.shaped.worst[kind] <= 1.001 * use, kind


@pytest.mark.parametrize("order", [2, 3])
def test_a_motion_along_a_wall_of_its_room_is_proved(order, tmp_path, monkeypatch):
    """The belts are linear, so the pose that they reach is on the path's side of the wall, exactly.

    However long the motion is: cells that are near the wall are cut beside more that are at rest
    than cuts are allowed.
    """
    monkeypatch.setattr(shaped_proof, "MOST_CUT", 2000)
    text = (Path(__file__).parents[3] / "kinematics" / "presets" / "corexy.toml").read_text(
        encoding="utf-8"
    )
    (tmp_path / "wall.toml").write_text(
        text.replace('x = ["-60 mm"', 'x = ["0 mm"'), encoding="utf-8"
    )
    machine = load_machine(tmp_path / "wall.toml")
    machine = machine.driven_by(
        [replace(axis, shaper=Shaper("zv", 35.0, 0.05)) for axis in machine.axes]
    )
    there = [Line(np.array(to)) for to in ([0, 0.02, 0], [0.03, 0.02, 0], [0, 0, 0])]
    made = plan(Program((*there, Dwell(12.0))), machine, order=order)
    assert made.shaped.worst["room"] == 1.0
    t = np.linspace(0, made.shaped.motion.duration, 20_001)
    x = made.shaped.motion.at(t).q[:, :2].mean(1)  # belts count x + y and x − y
    assert x.min() >= -1e-15
    outside = Program((Line(np.array([-1e-6, 0.02, 0])),))
    with pytest.raises(Infeasible, match="room"):
        plan(outside, machine, order=order)
