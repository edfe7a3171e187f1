"""Paths that a pose alone does not tell: turns that add up, elbows that stay, and the main job on
every machine.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinematics import OutOfReach, load_machine
from planner import Arc, Line, Program, Turn, plan
from planner.path.actuation import actuate
from planner.pulses import check

INCH = 0.0254


def drawn(machine, *segments):
    return actuate(Program(segments=segments, start=None, machine=None, name="drawn"), machine)


def along(path, points=101):
    """q (P·points, n) over the whole path."""
    s = np.linspace(path.breaks[:-1], path.breaks[1:], points)
    piece = np.broadcast_to(np.arange(len(path.breaks) - 1), s.shape)
    return path.derivatives(s.T.ravel(), piece.T.ravel())[0]


def turned(degrees):
    return Rotation.from_euler("Z", degrees, degrees=True)


def test_turns_add_up():
    """Four turns of 170° the same way end at 680°, and back by the shorter way each at 0°."""
    traverser = load_machine("traverser")
    path = drawn(traverser, *(Turn(to=turned(170 * k)) for k in (1, 2, 3, 4, 3, 2, 1, 0)))
    q = along(path)
    assert np.rad2deg(q[:, 3].max()) == pytest.approx(680, abs=1e-9)
    assert q[-1, 3] == pytest.approx(0, abs=1e-12)
    assert np.abs(np.diff(q, axis=0)).max() < np.deg2rad(2)


def round_the_column(arm, angle, off=0.0):
    """An arc about the arm's upright axis, or one beside it, in the frame of the home pose."""
    centre = arm.home.inv().apply([off, 0, arm.home.translation[2]])
    return Arc(centre=centre, normal=arm.home.rotation.inv().apply([0, 0, 1]), angle=angle)


@pytest.mark.parametrize("turns", [-3.25, 0.5, 7.0])
def test_an_arc_about_the_yaw_axis_turns_the_yaw_as_often(turns):
    """The arm's tool goes round its column: the piece is cut, the yaw goes on, and nothing jumps or
    stops between.
    """
    arm = load_machine("arm")
    path = drawn(arm, round_the_column(arm, 2 * np.pi * turns))
    q = along(path)
    assert q[-1, 0] - q[0, 0] == pytest.approx(2 * np.pi * turns, abs=1e-9)
    assert np.abs(q[:, 1:] - arm.home_q[1:]).max() < 1e-9
    assert np.abs(np.diff(q[:, 0])).max() < 0.1
    assert path.stops(3).nonzero()[0].tolist() == [0, len(path.pieces)]
    assert len(path.pieces) >= abs(turns)
    assert {path.segment(k) for k in range(len(path.pieces))} == {1}


def test_derivatives_and_bounds_agree_across_the_cuts():
    arm = load_machine("arm")
    path = drawn(arm, round_the_column(arm, 14.0, off=0.02))
    inner = np.arange(1, len(path.pieces))
    left, right = (
        path.derivatives(path.breaks[inner], inner - 1),
        path.derivatives(path.breaks[inner], inner),
    )
    for before, after in zip(left, right, strict=True):
        assert np.abs(before - after).max() <= 1e-9 * np.abs(before).max()


def test_the_elbow_stays():
    arm = load_machine("arm")
    path = drawn(arm, Line(to=[-0.1, 0.1, 0.1]), Line(to=[-0.1, -0.2, 0.0]), Line(to=[0, 0, 0]))
    assert (along(path)[:, 2] < 0).all()


PROGRAMS = {
    "tripod": [Line(to=[0.02, -0.01, 0.01]), Arc(centre=[0.01, -0.01, 0.01], normal=[0, 0, 1], angle=7.0)],
    "hexapod-initial": [Line(to=[0.01, 0.005, -0.01], rotate=Rotation.from_rotvec([0.05, 0, 0.02]))],
    "linkage": [Line(to=[0.05, -0.02, 0]), Arc(centre=[0.03, -0.02, 0], normal=[0, 0, 1], angle=7.0)],
    "arm": [Line(to=[-0.05, 0.1, 0.05]), Arc(centre=[-0.05, 0.05, 0.05], normal=[1, 0, 0], angle=-7.0)],
    "traverser": [
        Line(to=[2 * INCH, 2 * INCH, 2 * INCH]),
        Turn(to=turned(170)),
        Arc(centre=[2 * INCH, 2 * INCH, 2.5 * INCH], normal=[1, 0, 0], angle=7.0, rotate=turned(340)),
    ],
}  # fmt: skip


@pytest.mark.parametrize("name", PROGRAMS)
def test_the_main_job(name):
    """Planned, proved, pulsed and checked; forward kinematics of q is the pose, orientation that
    follows included.
    """
    machine = load_machine(name)
    done = plan(
        Program(segments=tuple(PROGRAMS[name]), start=None, machine=None, name=name), machine
    )
    assert done.certificate.holds
    assert check(done.pulses, done.trajectory).holds
    state = done.trajectory.at(np.linspace(0, done.trajectory.duration, 200))
    for limit in done.limits:
        value = limit.value(state)
        assert (
            limit.use(value, value, state.piece).max() <= done.certificate.worst[limit.name] + 1e-12
        )
    assert max(done.certificate.worst.values()) > 0.999
    found = machine.forward(state.q, near=machine.home)
    assert found.certified.all()
    assert np.abs(found.pose.as_matrix() - state.pose.as_matrix()).max() < 1e-9


@pytest.mark.parametrize(
    ("name", "segment", "phrase"),
    [
        (
            "traverser",
            Turn(to=Rotation.from_euler("X", 10, degrees=True)),
            r"traverser holds rx.*segment 1.*x, y, z, rz",
        ),
        ("linkage", Line(to=[0.01, 0, 0.01]), r"linkage holds z.*segment 1"),
        (
            "linkage",
            Arc(centre=[0.01, 0, 0], normal=[0, 1, 0], angle=2 * np.pi),
            r"linkage holds z.*segment 1",
        ),
    ],
)
def test_a_path_off_the_machine_s_freedom_is_refused(name, segment, phrase):
    """A full circle comes back to its plane: what lies between its ends is looked at."""
    with pytest.raises(OutOfReach, match=phrase):
        drawn(load_machine(name), segment)
