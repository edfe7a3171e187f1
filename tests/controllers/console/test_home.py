"""HOME zeroes a register at any place of the travel, and what an axis may do stays counted from its
switch.
"""

import json
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controllers.console import (
    CONSOLE,
    Dispatcher,
    TextLine,
    open_session,
    snapshot_session,
    take_line,
)
from controllers.console.grammar import MisreadLine, parse_operator_line, remote
from kinematics import load_machine
from pulsepath.output import register_file
from tests.controllers.console.conftest import Talk

REMOTE = 1


def test_home_in_mid_range_keeps_the_window_of_the_true_slide(talk):
    console = talk(homed=False)
    (reply,) = console.say("HOME X AT 24 in Y Z at 36IN R AT 90 deg")
    assert reply.startswith(
        "HOME X Y Z R: register 0; X at 609.6 mm of its travel, 0 to 1219.2 mm, steps -38400 to 38400; Y at 0 mm"
    )
    assert console.registers() == [0] * 4
    assert console.desk.session.counts.tolist() == [38400, 0, 57600, 100]
    assert "outside -38400 to 38400" in console.say("POS X CW 38401")[0]
    console.say("POS X CW 38400")
    assert console.wait() == ["DONE"]
    assert "cannot go further" in console.say("JOG X CW")[0]
    # the seed's own example (F.3), and F.5: any point becomes the register's zero, and the slide
    # ends where it did
    console.say("POS X CCW 8400 Z CCW 20")
    assert console.wait() == ["DONE"]
    assert console.say("HOME X")[0].endswith("steps -68400 to 8400")
    assert console.registers() == [0, 0, -20, 0]
    assert "outside -68400 to 8400" in console.say("POS X CW 8401")[0]
    assert "x 1085.8500" in console.say("WHERE")[0]  # 68400 steps from the switch


@pytest.mark.parametrize("first", ["HOME X Z", "HOME X AT 24 in Z AT 36 in"])
def test_the_examples_of_the_help_can_be_done_wherever_home_was_said(talk, first):
    console = talk()
    console.say(first)
    examples = re.findall(r"(?:JOG|POS|HOME) X[^;(]*(?= \()", console.say("HELP")[0])
    assert len(examples) == 4
    for example in examples:
        replies = console.say(example) + console.wait(1.0) + console.say("STOP") + console.wait()
        assert not any(reply.startswith("ERROR") for reply in replies)


@pytest.mark.parametrize(
    ("said", "told"),
    [
        ("HOME X AT 49 in", "outside its travel, 0 to 1219.2 mm"),
        ("HOME X AT -1 in", "outside its travel"),
        ("HOME X AT 24 deg", "24 deg"),
        ("HOME X AT 24", "AT takes where the slide stands"),
        ("HOME X AT", "AT takes where"),
        ("HOME AT 24 in", "AT is not an axis"),
        ("HOME X AT 24 furlong", "furlong"),
        ("HOME X AT nan in", "AT takes where"),
        ("HOME X AT 24 in X", "given twice"),
        ("HOME R AT 999999 rev", "counter"),
    ],
)
def test_a_place_that_cannot_be_is_refused(talk, said, told):
    console = talk()
    before = console.desk
    (reply,) = console.say(said)
    assert reply.startswith("ERROR")
    assert told.lower() in reply.lower()
    assert console.desk is before


def test_a_place_beyond_which_the_axis_has_been_is_not_its_switch(talk):
    console = talk(homed=False)
    console.say("POS X CW 400")
    console.wait()
    (reply,) = console.say("HOME X")
    assert "X has been -6.35 mm from here" in reply
    assert "HOME X AT" in reply
    assert console.desk.session.unknown() == ("X", "Y", "Z", "R")
    assert console.say("HOME X AT 0.25 in")[0].endswith("steps -400 to 76400")


def test_axes_wired_the_other_way_and_legs_by_their_stroke(talk):
    legs = talk("hexapod", homed=False)
    reply = legs.say("HOME LEG1 AT 25 mm LEG2")[0]
    assert "LEG1 at 24.9998 mm of its travel, 0 to 50.8 mm, steps -34400 to 33333" in reply
    legs.say("POS LEG1 CW 33333")
    assert legs.wait() == ["DONE"]
    assert legs.desk.session.counts[0] == 0
    assert "cannot go further" in legs.say("JOG LEG1 CW")[0]


def test_registers_and_places_outlive_the_session(talk, tmp_path):
    console = talk(homed=False)
    console.say("HOME X AT 24 in Y")
    console.say("POS X CCW 300 Y CW 20")
    console.wait()
    console.say("HOME Y")
    console.say("POS Y CW 7")
    console.wait()
    file = tmp_path / "state.json"
    register_file.write(file, snapshot_session(console.desk.session, console.t))
    again = open_session(load_machine("traverser"), register_file.read(file))
    assert snapshot_session(again, 0.0) == register_file.read(file)  # what is not accepted is kept
    desk, replies = take_line(Dispatcher(again), CONSOLE, TextLine("ACCEPT"), 0.0)
    assert replies[0][1] == "ACCEPTED X -300 Y 7 Z ?0 R ?0"
    assert desk.session.counts.tolist() == [38100, 27, 0, 0]
    # a file of before, whose registers counted from the switch
    old = json.loads(file.read_text())
    old["registers"] = {**old.pop("counters")}
    file.write_text(json.dumps({**old, "schema": 1}))
    desk, _ = take_line(
        Dispatcher(open_session(load_machine("traverser"), register_file.read(file))),
        CONSOLE,
        TextLine("ACCEPT"),
        0.0,
    )
    assert desk.session.counts.tolist() == [38100, 27, 0, 0]


def test_theta_is_the_rotary_axis_of_the_keyboard_alone():
    names = ("X", "Y", "Z", "R")
    for word in ("θ", "Θ", "theta", "R"):
        assert parse_operator_line(f"pos {word} cw 5", names) == parse_operator_line(
            "POS R CW 5", names
        )
    with pytest.raises(MisreadLine, match="THETA is not an axis"):
        parse_operator_line("JOG θ CW", ("LEG1", "LEG2"))
    for word in ("θ", "THETA"):
        with pytest.raises(MisreadLine):
            remote(f"P {word} + 5", names)


SAID = st.one_of(
    st.builds("{} {} {} {}".format, st.just("POS"), st.sampled_from("XZR"), st.sampled_from(["CW", "CCW"]),
              st.sampled_from([1, 400, 20000, 38400, 76800, 115200])),
    st.builds("P {} {} {}".format, st.sampled_from("XZR"), st.sampled_from("+-"), st.sampled_from([1, 30000, 76800])),
    st.builds("JOG {} {}".format, st.sampled_from("XZ"), st.sampled_from(["CW", "CCW"])),
    st.sampled_from(["HOME X", "HOME Z", "HOME X Z R", "HOME θ", "AT X", "AT Z", "REM", "MAN", "STOP"]),
    st.just("MOVE 900 0 900"),
)  # fmt: skip


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    st.sampled_from([(0.0, 0.0), (0.5, 0.5), (1.0, 0.25), (0.3, 1.0)]),
    st.lists(st.tuples(SAID, st.sampled_from([0.5, 20.0, 400.0])), max_size=12),
)
def test_whatever_is_said_the_true_slide_is_never_left(stands, said):
    """The slides' true places follow the pulses fired; what the operator says of them is true."""
    console = Talk("traverser", homed=False)
    length = np.array([76800, 76800, 115200])
    x, z = (round(share * 48) * 1600 for share in stands)
    place = np.array([x, 0, z])
    console.say(f"HOME X AT {x / 1600} in Y Z AT {z / 1600} in R")
    base = place - console.fired[:3]
    remote_drives = False
    for words, seconds in said:
        true = base + (_fired(console)[:3])
        line, who = words, CONSOLE
        if words.startswith(
            "AT "
        ):  # said again, wherever it stands, which is only true where it stands still
            if console.desk.session.motion is not None:
                continue
            axis = "XYZ".index(words[3])
            line = f"HOME {words[3]} AT {true[axis] / 1600} in"
        who = REMOTE if words[0] == "P" and words[1] == " " and remote_drives else CONSOLE
        console.say(line, who)
        remote_drives = console.desk.session.mode == "REM"
        console.wait(seconds)
        true = base + _fired(console)[:3]
        assert ((true >= 0) & (true <= length)).all(), (line, true)
        np.testing.assert_array_equal(console.desk.session.counters(console.t)[:3], true)


def _fired(console):
    """All pulses so far, those of the motion under way among them."""
    motion = console.desk.session.motion
    if motion is None:
        return console.fired
    here = [of.sum(dtype=np.int64) for of in motion.directions_between(console._seen, console.t)]
    return console.fired + here
