"""What an operator says and what comes of it: registers follow every pulse, nothing moves that was
not asked for.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from controllers.console import (
    CONSOLE,
    Dispatcher,
    TextLine,
    advance_time,
    drop_remote,
    open_session,
    snapshot_session,
    take_line,
)
from controllers.console.interpret import describe_offer
from controllers.console.serve import WAITING
from kinematics import MotionError, load_machine
from planner import Program, Turn, plan
from tests.controllers.console.conftest import Talk

REMOTE = 1


def test_positions_count_by_the_motor_whichever_way_the_axis_is_wired(talk):
    console = talk()
    console.say("POS X CW 100 Z CW 20")
    console.wait()
    console.say("pos x ccw 40")
    assert console.wait() == ["DONE"]
    assert console.registers() == [60, 0, 20, 0]
    # the hexapod's legs are wired the other way: it extends as the count falls
    legs = talk("hexapod")
    legs.say("POS LEG1 CCW 1000 LEG4 CCW 7")
    assert legs.wait() == ["DONE"]
    assert legs.registers() == [-1000, 0, 0, -7, 0, 0]
    assert legs.desk.session.q()[0] - legs.desk.session.machine.home_q[0] == pytest.approx(
        1000 * 0.75e-6
    )


def test_a_jog_ends_by_stop_by_any_line_and_at_the_end_of_travel(talk):
    console = talk()
    console.say("JOG X CW")
    console.wait(10.0)
    # a tenth of 2400 steps/s, reached in 0.5 s at 480 steps/s²
    assert console.registers()[0] == pytest.approx(240 * 9.75, abs=1)
    console.say("STOP")
    assert console.wait() == [f"STOPPED X {240 * 10} Y 0 Z 0 R 0"]
    console.say("JOG X CCW")
    console.wait(1.0)
    assert console.say("POS Y CW 5") == []
    assert console.wait()[1:] == ["DONE"]
    assert console.registers()[1] == 5
    console.say("JOG X CCW")
    assert console.wait() == ["STOPPED X 0 Y 5 Z 0 R 0"]
    assert "further: end of travel" in console.say("JOG X CCW")[0]
    console.assert_true()


def test_an_axis_that_is_not_homed_goes_no_farther_than_its_travel_is_long(talk):
    console = talk(homed=False)
    assert "76800" in console.say("POS X CCW 76801")[0]
    assert console.desk.end is None
    console.say("POS X CCW 76800")
    assert console.wait() == ["DONE"]
    assert console.say("WHERE") == ["X ?-76800 Y ?0 Z ?0 R ?0 (?: not counted from home)"]
    # from either end of what it has been through, no farther than one travel in all
    assert "outside -76800 to 0" in console.say("POS X CW 76801")[0]
    assert console.say("HOME X") == [
        "HOME X: register 0; X at 0 mm of its travel, 0 to 1219.2 mm, steps 0 to 76800"
    ]
    assert "outside 0 to 76800" in console.say("POS X CCW 1")[0]


@pytest.mark.parametrize(
    "line",
    [
        "", "JOG", "JOG X", "JOG X UP", "JOG Q CW", "JOG X CW 3", "POS", "POS X", "POS X CW", "POS X CW -3",
        "POS X CW 1.5", "POS X CW 1000000000", "POS X CW ٣", "POS X CW 3 X CCW 2", "POS X CW 3 Y", "POS X CW 76801",
        "POS X CCW 1", "HOME", "HOME Q", "HOME X X", "MOVE", "MOVE 1 2", "MOVE 1 2 nan", "MOVE 1 2 1e3", "MOVE 1 2 -1",
        "MOVE 0 0 1 5 0 0", "STOP NOW", "WHERE X", "ACCEPT", "P X + 100", "X", "POS X CW 0x10",
        "POS R CW 134217728", "__import__('os')",
    ],
)  # fmt: skip
def test_what_is_not_wholly_understood_or_possible_is_told_and_does_nothing(talk, line):
    console = talk()
    before = console.desk
    (reply,) = console.say(line)
    assert reply.startswith("ERROR")
    assert reply.endswith("no motion")
    assert "\n" not in reply
    assert console.desk is before


@pytest.mark.parametrize(
    "line", ["POS X CW 100", "WHERE X", "p x + 100", "P X +100", "P X + 1 X + 2", "JOG X CW", "MAN"]
)
def test_the_remote_line_has_its_own_language(talk, line):
    console = talk(mode="REM")
    (reply,) = console.say(line, REMOTE)
    assert reply.startswith("ERROR")
    assert console.desk.end is None


def test_remote_commands_wait_for_one_another(talk):
    console = talk(mode="REM")
    assert console.say("P X + 100 Y + 40 Z + 80", REMOTE) == []
    assert console.say("P X - 50", REMOTE) == []
    assert console.say("P X - 51", REMOTE) == []
    assert console.say("WHERE", REMOTE) == ["X 0 Y 0 Z 0 R 0"]
    replies = console.wait()
    assert replies[:2] == ["DONE", "DONE"]
    assert replies[2].startswith("ERROR axis X to -1 steps")
    assert console.registers() == [50, 40, 80, 0]


def test_stop_drops_what_waits_and_tells_whom(talk):
    console = talk(mode="REM")
    console.say("P X + 5000", REMOTE)
    console.say("P X + 5000", REMOTE)
    console.wait(2.0)
    assert console.say("STOP") == ["ERROR dropped by STOP; no motion"]
    replies = console.wait()
    assert len(replies) == 2  # the remote line and the console
    # half a t² up and down again
    assert replies[0].startswith(f"STOPPED X {480 * 4} ")
    assert console.registers()[0] == 1920
    console.assert_true()


def test_lines_that_wait_are_bounded(talk):
    console = talk(mode="REM")
    console.say("P X + 100", REMOTE)
    for _ in range(WAITING):
        assert console.say("P X + 1", REMOTE) == []
    assert "wait already" in console.say("P X + 1", REMOTE)[0]
    assert console.wait() == ["DONE"] * (WAITING + 1)
    assert console.registers()[0] == 100 + WAITING


def test_modes_say_who_drives(talk):
    console = talk()
    assert "mode MAN" in console.say("P X + 100", REMOTE)[0]
    console.say("JOG X CW")
    assert "mode MAN" in console.say("P X + 100", REMOTE)[0]
    assert not console.desk.stopped  # the remote line does not end the operator's jog
    # but it may stop it
    assert console.say("STOP", REMOTE) == []
    assert console.wait() == ["STOPPED X 0 Y 0 Z 0 R 0"] * 2
    console.say("REM")
    assert "MAN returns to manual mode" in console.say("POS X CW 1")[0]
    console.say("P X + 500", REMOTE)
    console.say("P X + 500", REMOTE)
    assert console.say("MAN")[0] == "ERROR dropped by the console; no motion"
    assert console.wait() == ["DONE"]  # the motion under way goes on
    report = console.say("TEST")[0]
    assert (
        "X: 76800 steps of 1.5875e-05 m, 2400 steps/s at most after a ramp of 6000, 37.000 s: OK"
        in report
    )
    at = console.registers()
    assert console.say("POS X CW 48")[0] == "TEST 0.632 s; no motion"  # 2 √(48/480)
    assert console.say("HOME X AT 24 in")[0].startswith("TEST HOME X: register 0; X at 609.6 mm")
    assert console.registers() == at
    assert console.desk.end is None


def test_the_remote_line_needs_no_home_but_for_a_pose(talk):
    """[Sasidhar 1981, F.4]: REM, then P X + 100, and no word of home before it."""
    console = talk(homed=False)
    assert "X Y Z R not homed" in console.say("REM")[0]
    assert console.say("P X + 100 Y - 40 Z + 80", REMOTE) == []
    assert console.wait() == ["DONE"]
    assert console.registers() == [100, -40, 80, 0]
    assert "length of its travel (not homed)" in console.say("P X + 76701", REMOTE)[0]
    assert "not homed: a pose needs all axis positions" in console.say("MOVE 0 0 1", REMOTE)[0]


def test_a_client_that_vanishes_leaves_the_move_under_way(talk):
    console = talk(mode="REM")
    console.say("P X + 5000", REMOTE)
    console.say("P X + 5000", REMOTE)
    console.wait(1.0)
    console.desk = drop_remote(console.desk, REMOTE)
    assert console.wait() == []
    assert console.registers()[0] == 5000
    console.assert_true()


def test_registers_are_offered_and_not_assumed(talk):
    console = talk(homed=False)
    console.say("HOME X Y Z R")
    console.say("POS X CW 300 Y CW 20")
    console.wait()
    last = snapshot_session(console.desk.session, console.t)
    machine = load_machine("traverser")
    again = open_session(machine, last)
    assert again.unknown() == ("X", "Y", "Z", "R")
    assert again.registers(0.0).tolist() == [0] * 4
    assert describe_offer(again) == "last known position X 300 Y 20 Z 0 R 0: ACCEPT or HOME"
    # what was offered and not taken is offered the next time
    assert snapshot_session(again, 0.0) == last

    desk, replies = take_line(Dispatcher(again), CONSOLE, TextLine("ACCEPT"), 0.0)
    assert replies == ((CONSOLE, "ACCEPTED X 300 Y 20 Z 0 R 0"),)
    assert desk.session.unknown() == ()
    # an axis that has moved is no longer where it was
    desk, _ = take_line(Dispatcher(again), CONSOLE, TextLine("POS X CW 1"), 0.0)
    desk, _ = advance_time(desk, desk.end)
    desk, replies = take_line(desk, CONSOLE, TextLine("ACCEPT"), 1.0)
    assert "nothing to accept" in replies[0][1]


def test_an_axis_that_was_moving_is_not_offered(talk):
    console = talk()
    console.say("POS X CW 30000")
    console.wait(3.0)
    last = snapshot_session(console.desk.session, console.t)
    assert last.moving == {"X": True, "Y": False, "Z": False, "R": False}
    again = open_session(load_machine("traverser"), last)
    assert (
        describe_offer(again) == "last known position Y 0 Z 0 R 0: ACCEPT or HOME; X unknown: HOME"
    )
    desk, _ = take_line(Dispatcher(again), CONSOLE, TextLine("ACCEPT"), 0.0)
    assert desk.session.unknown() == ("X",)


def test_registers_of_another_machine_are_refused(talk):
    last = snapshot_session(talk("hexapod").desk.session, 0.0)
    with pytest.raises(MotionError, match="machine hexapod with axes LEG1"):
        open_session(load_machine("traverser"), last)


def test_the_hexapod_runs_lines_through_the_planner(talk):
    console = talk("hexapod")
    assert console.say("MOVE 0 0 25") == []
    end = console.desk.end
    console.wait(end / 2)
    console.assert_true()
    assert console.wait() == ["DONE"]
    # 25 mm up: all legs alike, wired so that they count down
    registers = console.registers()
    machine = console.desk.session.machine
    up = machine.home * type(machine.home).from_translation([0, 0, 0.025])
    wanted = -np.rint((machine.inverse(up) - machine.home_q) / 0.75e-6)
    assert registers == wanted.tolist()
    console.assert_true()
    assert console.say("MOVE 0 0 25") == [
        "DONE"
    ]  # half a pulse off at most: there is nothing to move
    (reply,) = console.say("MOVE 0 0 250")
    assert reply.startswith("ERROR travel")
    assert "leg" in reply
    assert console.registers() == registers
    remote = talk("hexapod", mode="REM")
    remote.say("MOVE 1 0 5 0.5 0 0", REMOTE)
    assert remote.wait() == ["DONE"]
    # half a pulse of a leg, 0.375 um, moves this platform by a few times as much
    assert remote.desk.session.pose().translation == pytest.approx([0.001, 0, 0.005], abs=2e-6)
    assert "not homed" in talk("hexapod", homed=False).say("MOVE 0 0 1")[0]


def test_a_pose_is_reached_in_synchronised_legs(talk):
    """[Sahbaz 2007, 5.2.3]: all legs start and end together, each its own share of the way at every
    instant.
    """
    console = talk("hexapod")
    assert console.say("PTP 4 -3 20 2 0 5") == []
    motion = console.desk.session.motion
    ways = np.abs(motion.counts(np.inf))
    assert ways.min() > 1000
    for share in (0.2, 0.5, 0.8):
        console.wait(share * motion.end - console.t)
        done = np.abs(motion.counts(console.t)) / ways
        assert np.ptp(done) < 1 / ways.min() + 1e-6  # to the pulse
        console.assert_true()
    assert console.wait() == ["DONE"]
    at = console.desk.session.pose()
    assert at.translation == pytest.approx([0.004, -0.003, 0.02], abs=2e-6)
    assert console.say("PTP 4 -3 20 2 0 5") == ["DONE"]  # it is there
    assert console.say("PTP 0 0 250")[0].startswith("ERROR travel")
    assert "PTP takes x y z" in console.say("PTP 1 2")[0]
    remote = talk("hexapod", mode="REM")
    remote.say("PTP 1 0 5", REMOTE)
    assert remote.wait() == ["DONE"]
    assert "not homed" in talk("hexapod", homed=False).say("PTP 0 0 1")[0]


def test_a_turn_in_place_is_one_and_said_twice_moves_once(talk):
    console = talk("hexapod")
    machine = console.desk.session.machine
    console.say("MOVE 3 2 20")
    console.wait()
    degrees = np.zeros(3)
    for words in ((5, 4, 3), (-5, 4, 3), (0, 0, 0)):
        was, degrees = degrees, np.array(words, float)
        assert console.say("MOVE 3 2 20 {} {} {}".format(*words)) == []
        motion = console.desk.session.motion
        # of the exact pose; from where the axes stand, half a pulse off, it takes as long to a few
        # pulses in thousands
        at = RigidTransform.from_components(
            [0.003, 0.002, 0.02], Rotation.from_euler("XYZ", was, degrees=True)
        )
        turn = Turn(Rotation.from_euler("XYZ", degrees, degrees=True))
        wanted = plan(Program((turn,), start=at), machine).trajectory.duration
        assert motion.end - motion.begun == pytest.approx(wanted, rel=2e-3)
        assert console.wait() == ["DONE"]
        registers = console.registers()
        assert console.say("MOVE 3 2 20 {} {} {}".format(*words)) == ["DONE"]
        assert console.desk.end is None
        assert console.registers() == registers
    # what was rounded has not added up: it stands where it stood
    assert console.desk.session.pose().translation == pytest.approx([0.003, 0.002, 0.02], abs=2e-6)
    console.assert_true()


def test_a_way_of_a_pulse_is_made_and_one_of_less_than_half_is_none(talk):
    console = talk()
    assert console.say("MOVE 0.007 0.007 0") == ["DONE"]  # of 15.875 um a pulse
    for words, x in (("MOVE 0.015875 0 0", 1), ("MOVE 0.028 0 0", 2), ("MOVE 0 0 0", 0)):
        assert console.say(words) == []
        assert console.wait() == ["DONE"]
        assert console.registers() == [x, 0, 0, 0]
    assert "holds ry" in console.say("MOVE 0 0 0 0 5 0")[0]


def test_help_says_that_a_stop_leaves_the_line(talk):
    assert "during a MOVE the tool leaves its line" in talk().say("HELP")[0]


def test_a_line_from_where_no_plan_can_begin_is_refused(talk):
    console = talk()
    console.say(
        "POS R CW 300"
    )  # three quarters of a turn, which a pose does not tell from a quarter back
    console.wait()
    (reply,) = console.say("MOVE 1 1 1")
    assert "the plan begins at counts [0, 0, 0, -100], the axes stand at [0, 0, 0, 300]" in reply
    assert console.desk.end is None


def test_single_legs_go_no_farther_than_the_joints_bear(talk):
    console = talk("hexapod")
    (reply,) = console.say("POS LEG1 CCW 60000")
    assert reply.startswith("ERROR on the path leg1")
    assert "tilt" in reply
    console.say("JOG LEG1 CCW")
    (reply,) = console.wait()
    session = console.desk.session
    # it stands well before the end of the leg's travel, and its joints are within their limits
    assert 0 < session.counts[0] < 60000
    assert session.machine.check(session.machine.home * session.pose()).ok
    console.assert_true()


def test_a_line_is_stopped_within_travel_and_registers_stay_true(talk):
    console = talk("hexapod")
    console.say("MOVE 4 0 30 0 3 0")
    console.wait(console.desk.end / 2)
    console.say("STOP")
    console.assert_true()
    console.wait(0.01)
    console.assert_true()
    (reply,) = console.wait()
    assert reply.startswith("STOPPED LEG1 -")
    console.assert_true()
    drives = console.desk.session.drives
    assert ((console.desk.session.counts > 0) & (console.desk.session.counts < drives.high)).all()
    # and from there it goes on
    assert console.say("MOVE 0 0 20") == []
    assert console.wait() == ["DONE"]
    console.assert_true()


LINES = st.one_of(
    st.builds(
        "POS {} {} {}".format,
        st.sampled_from("XYZR"),
        st.sampled_from(["CW", "CCW"]),
        st.integers(0, 20000),
    ),
    st.builds(
        "POS X {} {} Z {} {}".format, *[st.sampled_from(["CW", "CCW"]), st.integers(0, 9000)] * 2
    ),
    st.builds("JOG {} {}".format, st.sampled_from("XYZR"), st.sampled_from(["CW", "CCW"])),
    st.sampled_from(["STOP", "STOP", "WHERE", "TEST", "MAN", "REM"]),
)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.lists(st.tuples(LINES, st.floats(0, 8)), max_size=8))
def test_registers_are_home_and_the_pulses_fired_at_every_instant(said):
    console = Talk("traverser")
    for line, seconds in said:
        console.say(line)
        console.assert_true()
        console.wait(seconds)
        console.assert_true()
        counts = console.desk.session.counters(console.t)
        assert (
            (counts >= console.desk.session.drives.low)
            & (counts <= console.desk.session.drives.high)
        ).all()
    if console.desk.session.jogging:
        console.say("STOP")
    console.wait()
    console.assert_true()
