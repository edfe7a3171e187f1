"""Synchronised moves: the thesis' own formulas, straight axes, certified limits, and the calls that
make them.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from controllers.card import PCI_8132, PCI_8164, TRMove, at_rest, play
from kinematics import MotionError, load_machine
from planner import (
    Arc,
    Dwell,
    Line,
    Program,
    Spline,
    Synchronised,
    Trigger,
    Turn,
    check,
    load_program,
    plan,
    synchronise,
)
from planner.certificate import prove_feasibility
from planner.export.format import ExportSource
from planner.export.formats.adlink import AdlinkCsv
from planner.export.formats.sahbaz import Sahbaz, read_moves
from planner.limits import limits_of
from planner.path.actuation import actuate
from planner.path.point_to_point import departures
from planner.program.program_writer import program_toml

MILLI = 1e-3


def turned(*degrees):
    return Rotation.from_euler("XYZ", degrees, degrees=True)


@pytest.fixture(scope="module")
def thesis(hexapod):
    """The hexapod as the thesis' program drives it: 3000 pulses/s, reached in 0.01 s."""
    slow = [
        replace(axis, max_speed=2.25e-3, max_acceleration=0.225, max_jerk=None)
        for axis in hexapod.axes
    ]
    return hexapod.driven_by(slow)


@pytest.fixture(scope="module")
def made(thesis):
    poses = [
        ((5, 0, 10), None),
        ((-2.5, 4.33013, 10), turned(1, -2, 3)),
        ((0, 0, 0), turned(0, 0, 0)),
    ]
    program = Program(tuple(Synchronised(np.array(to) * MILLI, rotate) for to, rotate in poses))
    return plan(program, thesis), poses


def test_the_thesis_formulas_hold(made, thesis):
    """td = max|pulses|/3000 + t1; leg k runs at |pulses_k|/(t1 + t2), t2 = td - 2 t1 [Sahbaz 2007,
    Appendix D].
    """
    whole, poses = made
    home, q, begin = thesis.home, thesis.home_q, 0.0
    for to, rotate in poses:
        there = RigidTransform.from_components(
            np.array(to) * MILLI, turned(0, 0, 0) if rotate is None else rotate
        )
        goal = thesis.inverse(home * there)
        pulses = np.abs(goal - q) / 0.75e-6
        td = pulses.max() / 3000 + 0.01
        top = (
            np.abs(whole.trajectory.at(np.linspace(begin + 0.02, begin + td - 0.02, 50)).qd)
            / 0.75e-6
        )
        assert top == pytest.approx(np.tile(pulses / (td - 0.01), (50, 1)), abs=0.01)
        begin, q = begin + td, goal
    assert whole.trajectory.duration == pytest.approx(begin, rel=1e-6)
    assert whole.certificate.holds
    assert max(whole.certificate.worst.values()) <= 1 + 1e-6


def test_all_axes_start_and_end_together_and_counts_are_exact(made):
    whole, _ = made
    state = whole.trajectory.at(np.linspace(0, whole.trajectory.duration / 4, 400))
    share = (state.q - state.q[0]) / np.ptp(state.q, axis=0)
    # in proportion: every leg has made the same share of its way, to a pulse in a million of it
    assert np.abs(np.abs(share) - np.abs(share[:, :1])).max() < 1e-9
    assert [axis.final for axis in whole.pulses.axes] == [0] * 6
    assert all(one.uneven < 1e-4 for one in whole.departures)


def test_the_departure_is_the_way_of_the_platform_off_its_chord(made, thesis):
    """By forward kinematics of straight lines of lengths, which shares nothing with the
    polynomial.
    """
    whole, poses = made
    ends = [thesis.home_q]
    at = [RigidTransform.identity()]
    for to, rotate in poses:
        at.append(RigidTransform.from_components(np.array(to) * MILLI, rotate or at[-1].rotation))
        ends.append(thesis.inverse(thesis.home * at[-1]))
    for n, found in enumerate(whole.departures):
        q = ends[n] + np.linspace(0, 1, 201)[:, None] * (ends[n + 1] - ends[n])
        pose = thesis.forward(q, thesis.home * at[n], certify=False).pose
        points = pose.translation
        way = points[-1] - points[0]
        off = np.linalg.norm(np.cross(points - points[0], way / np.linalg.norm(way)), axis=1)
        assert found.distance == pytest.approx(off.max(), rel=1e-3)
        assert found.where.segment == n + 1
    assert (
        max(one.distance for one in whole.departures) > 10e-6
    )  # and that is far more than a pulse


def test_the_calls_are_the_thesis_and_the_cards_end_where_the_plan_does(made, thesis, tmp_path):
    whole, _ = made
    source = ExportSource("three poses", thesis, whole.trajectory, whole.pulses)
    done = Sahbaz().write(source, tmp_path / "calls.bas")
    assert done.error < 1.0
    moves = read_moves(tmp_path / "calls.bas")
    assert len(moves) == 18
    # two axes of one card, four of the other, in the thesis' order; extension is sent as negative
    # counts
    assert [(move.function, move.axis) for move in moves[:6]] == [
        ("B_8132.StartTMove", 0), ("B_8132.StartTMove", 1), *(("B_8164.StartTRMove", k) for k in range(4))
    ]  # fmt: skip
    assert all(move.distance < 0 for move in moves[:6])
    for leg in range(6):
        own = moves[leg::6]
        card = PCI_8132 if leg < 2 else PCI_8164
        sent = (
            (m.time, TRMove(*(np.array([x]) for x in (m.distance, 0.0, m.speed)), m.ramp, m.ramp))
            for m in own
        )
        train = play(
            replace(card, speed_range=3010.0), at_rest([0]), sent, whole.trajectory.duration + 0.1
        ).train(0)
        assert train.count[-1] == 0
        assert train.ticks[-1] / card.clock_hz <= whole.trajectory.duration + 1e-3
        # every pulse that the virtual card fires is where the plan has the leg, to the pulse
        t = train.ticks / card.clock_hz
        wanted = -(whole.trajectory.at(t).q[:, leg] - thesis.home_q[leg]) / 0.75e-6
        assert np.abs(train.count - wanted).max() < 2.0
    assert AdlinkCsv(5e-3).write(source, tmp_path / "adlink.csv").error < 2.0


def test_what_no_trapezoid_can_do_is_refused(tmp_path, hexapod):
    half = Program(
        (Arc([0.005, 0, 0.02], [0, 0, 1], np.pi),),
        start=RigidTransform.from_translation([0, 0, 0.02]),
    )
    made = plan(half, hexapod, order=2)
    with pytest.raises(MotionError, match=r"turns back by .* --motion synchronised"):
        Sahbaz().write(
            ExportSource("circle", made.machine, made.trajectory, made.pulses),
            tmp_path / "calls.bas",
        )
    assert not (tmp_path / "calls.bas").exists()


@pytest.mark.parametrize(
    ("machine", "to", "rotate"),
    [
        ("hexapod", (4, -3, 20), turned(3, 2, -4)),
        ("tripod", (30, 20, -20), None),
        ("linkage", (20, 20, 0), None),
        ("traverser", (500, 400, 300), turned(0, 0, 170)),
        ("arm", (-100, 50, 50), None),
    ],
)
def test_on_every_machine_the_axes_go_straight(machine, to, rotate):
    driven = load_machine(machine)
    found = check(Program((Synchronised(np.array(to) * MILLI, rotate),)), driven)
    assert found.violations == ()
    (one,) = found.departures
    assert one.uneven < 1e-3
    assert (one.distance < 1e-9) == (machine == "traverser")  # whose slides are the axes of space


def test_a_tool_a_work_frame_and_repetitions_lead_where_they_say(hexapod):
    tool, work = (
        RigidTransform.from_translation([0, 0, 0.03]),
        RigidTransform.from_translation([0.001, 0, 0.005]),
    )
    moves = (
        Synchronised([0, 0, 0.04], turned(1, 0, 0)),
        Synchronised([0.002, 0, 0.035], turned(0, 0, 2)),
    )
    made = plan(Program(moves, tool=tool, work=work, repeat=2), hexapod)
    assert made.certificate.holds
    assert len(made.departures) == 4
    end = made.trajectory.at(made.trajectory.duration).pose[0] * tool
    wanted = (
        hexapod.home * work * RigidTransform.from_components([0.002, 0, 0.035], turned(0, 0, 2))
    )
    assert end.translation == pytest.approx(wanted.translation, abs=1e-12)


def test_limits_refuse_it_with_the_segment_and_an_end_out_of_reach(hexapod):
    path = actuate(Program((Synchronised([0, 0, 0.01]), Synchronised([0, 0, 0.06]))), hexapod)
    (violation, *_) = prove_feasibility(path, limits_of(path, hexapod.axes, 2)).violations
    assert "travel" in str(violation)
    assert "segment 2" in str(violation)
    with pytest.raises(MotionError, match="segment 1, synchronised: it ends where it starts"):
        actuate(Program((Synchronised([0, 0, 0]),)), hexapod)


def test_a_file_says_it_and_is_written_so(tmp_path):
    program = Program((Synchronised([0.001, 0.002, 0.003], turned(1, 2, 3), 0.02, acceleration=0.5),
                       Synchronised([0, 0, 0], trigger=Trigger("lamp", 0.5))))  # fmt: skip
    text = program_toml(program)
    (tmp_path / "moves.toml").write_text(text)
    again = load_program(tmp_path / "moves.toml")
    first = again.segments[0]
    assert (first.to, first.speed, first.acceleration) == (
        pytest.approx([0.001, 0.002, 0.003]),
        0.02,
        0.5,
    )
    assert first.rotate.approx_equal(turned(1, 2, 3), 1e-12)
    assert again.segments[1].trigger.name == "lamp"


def test_any_program_becomes_one_of_moves_to_its_poses(hexapod):
    program = Program(
        (
            Line([0, 0, 0.02], turned(2, 0, 0), 0.03),
            Arc([0.005, 0, 0.02], [0, 0, 1], 2 * np.pi),
            Dwell(0.1),
            Spline(np.array([[0.001, 0, 0.02], [0.002, 0.001, 0.022]])),
            Turn(turned(0, 1, 0)),
            Arc([0.002, 0.003, 0.022], [0, 0, 1], np.pi / 2, trigger=Trigger("lamp")),
        )
    )
    found, left_out = synchronise(program, hexapod)
    assert left_out == (2,)
    kinds = [type(part).__name__ for part in found.segments]
    assert kinds == ["Synchronised", "Dwell", *["Synchronised"] * 4]
    assert found.segments[0].speed == 0.03
    assert found.segments[-1].to == pytest.approx([0.004, 0.003, 0.022])
    assert found.segments[-1].trigger.name == "lamp"
    assert [part.rotate is not None for part in found.segments if isinstance(part, Synchronised)] == [
        True, False, False, True, False
    ]  # fmt: skip
    ends = [actuate(one, hexapod) for one in (program, found)]
    wanted, pose = (
        path.pose_numbers(path.breaks[-1:], np.array([len(path.pieces) - 1]))[0] for path in ends
    )
    assert pose == pytest.approx(wanted, abs=1e-12)
    assert departures(ends[0]) == ()
    with pytest.raises(MotionError, match="would not move at all"):
        synchronise(
            Program((program.segments[1],), start=RigidTransform.from_translation([0, 0, 0.02])),
            hexapod,
        )
    with pytest.raises(MotionError, match="no move passes its trigger lamp"):
        synchronise(Program((replace(program.segments[1], trigger=Trigger("lamp")),),
                            start=RigidTransform.from_translation([0, 0, 0.02])), hexapod)  # fmt: skip
