"""The command `send`: a grbl that is emulated on a pseudo terminal takes every line, once and in order."""

import os
import re
import signal
import threading
import time
import tty
from collections import deque
from contextlib import suppress
from itertools import count
from types import SimpleNamespace

import pytest

pytest.importorskip("serial")

RX_BUFFER = 128  # bytes; what does not fit is lost, as on the board


class Grbl(threading.Thread):
    """grbl 1.1's side of the line: a receive buffer, lines of at most 80, ok, error:N, ALARM:N, ?, ! and 0x18.

    pace     s that a line takes
    answers  what it says to a line of a number (from 1 after the first empty one) instead of ok
    """

    def __init__(self, pace=0.0, answers=(), place=(0.0, 0.0, 0.0), state="Idle", deaf=False):
        super().__init__(daemon=True)
        self.here, there = os.openpty()
        tty.setraw(self.here)
        tty.setraw(there)
        self.there, self.port = there, os.ttyname(there)
        self.pace, self.answers, self.place, self.state, self.deaf = pace, dict(answers), list(place), state, deaf
        self.waiting, self.taken, self.events = deque(), [], []
        self.most, self.lost, self.used, self.on_line = 0, 0, [], {}
        self.offset, self.over = [10.0, 0.0, -5.0], False
        self.start()

    def say(self, text):
        with suppress(OSError):
            os.write(self.here, text.encode() + b"\r\n")

    def run(self):
        os.set_blocking(self.here, False)
        ready = 0.0
        while not self.over:
            with suppress(BlockingIOError, OSError):
                for byte in os.read(self.here, 4096):
                    self.receive(bytes([byte]))
            if b"\n" in self.waiting and time.monotonic() >= ready and self.state in ("Idle", "Run"):
                self.take()
                ready = time.monotonic() + self.pace
            elif b"\n" not in self.waiting and self.state == "Run" and time.monotonic() >= ready:
                self.state = "Idle"
            time.sleep(1e-4)

    def receive(self, byte):
        if byte in (b"?", b"!", b"\x18"):
            if byte != b"?":
                self.events.append(byte)
            elif not self.deaf:
                machine = ",".join(f"{a + b:.3f}" for a, b in zip(self.place, self.offset, strict=True))
                self.say(f"<{self.state}|MPos:{machine}|FS:0,0|WCO:{','.join(map(str, self.offset))}>")
            if byte == b"!" and self.state in ("Run", "Idle"):
                self.state = "Hold:0"
            if byte == b"\x18":
                self.waiting.clear()
                self.state = "Idle"
                self.say("Grbl 1.1h ['$' for help]")
            return
        self.waiting.append(byte)
        self.most = max(self.most, len(self.waiting))
        if len(self.waiting) > RX_BUFFER:
            self.waiting.pop()
            self.lost += 1

    def take(self):
        self.used.append(len(self.waiting))
        line = b""
        while (byte := self.waiting.popleft()) != b"\n":
            line += byte
        text = line.decode()
        if text:
            self.taken.append(text)
            self.state = "Run"
            for letter, number in re.findall(r"([XYZ])(-?[\d.]+)", text):
                self.place["XYZ".index(letter)] = float(number)
        answer = self.answers.get(len(self.taken), "ok") if text else "ok"
        assert len(text) < 80
        if answer.startswith("ALARM"):
            self.state = "Alarm"
        self.say(answer)
        self.on_line.get(len(self.taken), lambda: None)()

    def close(self):
        self.over = True
        self.join()
        os.close(self.here)
        os.close(self.there)


@pytest.fixture
def grbl():
    made = []

    def make(**options):
        made.append(Grbl(**options))
        return made[-1]

    yield make
    for each in made:
        each.close()


@pytest.fixture
def program(tmp_path):
    """Lines of 5 to 40 characters, with a header as export writes it."""
    moves = [f"G1 X{k * 1.25:.6f}" + f" Y{-k}.5" * (k % 3 > 0) + f" Z{k}.123456" * (k % 3 > 1) + " F3000"
             for k in range(400)]  # fmt: skip
    head = ["(pulsepath: what? is! it~)", "(the axes must stand at X1.500000 Y0.000000 Z-2.000000)", "G21 G90 G93"]
    file = tmp_path / "way.ngc"
    file.write_text("\n".join([*head, *moves, "G4 P0.1", "", "G94", "M2"]) + "\n")
    return file


START = (1.5, 0.0, -2.0)


def lines_of(file):
    plain = [re.sub(r"\(.*\)|\s", "", line) for line in file.read_text().splitlines()]
    return [line for line in plain if line]


def test_every_line_is_taken_once_and_the_buffer_is_kept_full(call, grbl, program):
    board = grbl(pace=5e-4, place=START)
    done = call("send", program, "--port", board.port)
    assert done.exit_code == 0, done.stderr
    assert board.taken == lines_of(program)
    assert board.lost == 0
    assert board.most <= 127
    # in the middle of the way there is never room for the next line but while an answer is on its way
    middle = sorted(board.used[50:350])
    assert middle[len(middle) // 2] >= 127 - max(map(len, board.taken)) - 1
    assert f"{len(board.taken)} lines taken and moved" in done.stdout
    assert not board.events


def test_a_larger_buffer_is_used_where_it_is_told(call, grbl, program):
    board = grbl(pace=5e-4, place=START)
    assert call("send", program, "--port", board.port, "--buffer", "64", "--line", "50").exit_code == 0
    assert board.most <= 64
    assert board.taken == lines_of(program)


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        ("error:33", 'line 61 "G1X71.250000F3000": error:33 (a target that is none)'),
        ("ALARM:1", "ALARM:1 (a hard limit), at line 61 or before"),
        ("Grbl 1.1h ['$' for help]", "the board was reset, at line 61 or before"),
    ],
)
def test_nothing_is_sent_after_a_refusal_and_the_axes_are_stopped(call, grbl, program, answer, words):
    board = grbl(pace=2e-3, place=START, answers={59: answer})
    done = call("send", program, "--port", board.port)
    assert done.exit_code == 2
    assert words in done.stderr
    assert board.events == [b"!", b"\x18"]
    held = 127 // 8
    assert len(board.taken) <= 59 + held  # at most what was in its buffer
    taken = len(board.taken)
    time.sleep(0.05)
    assert len(board.taken) == taken
    assert board.taken == lines_of(program)[:taken]


def test_ctrl_c_holds_and_then_resets(call, grbl, program):
    board = grbl(pace=2e-3, place=START)
    board.on_line[80] = lambda: os.kill(os.getpid(), signal.SIGINT)
    done = call("send", program, "--port", board.port)
    assert done.exit_code == 130
    assert "feed hold and soft reset: the axes stand" in done.stderr
    assert board.events == [b"!", b"\x18"]
    assert 80 <= len(board.taken) < 400
    assert not board.waiting


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"state": "Alarm"}, "in the state Alarm, not Idle; unlock it ($X) or home it ($H) first"),
        ({"place": (1.5, 0.1, -2.0)}, "axis Y is at 0.100 in work coordinates, and has to be at 0.000 within 0.02"),
        ({"deaf": True}, "nothing that is grbl answers within 0.3 s"),
    ],
)
def test_a_board_that_is_not_ready_gets_no_line(call, grbl, program, monkeypatch, options, words):
    monkeypatch.setattr("controllers.console.grbl.START_PATIENCE", 0.3)
    board = grbl(**{"place": START, **options})
    done = call("send", program, "--port", board.port)
    assert done.exit_code == 2
    assert words in done.stderr
    assert not board.taken


def test_a_board_that_falls_silent_is_given_up(call, grbl, program, monkeypatch):
    monkeypatch.setattr("controllers.console.grbl.PATIENCE", 0.4)
    monkeypatch.setattr("controllers.console.grbl.STOP_PATIENCE", 0.4)
    board = grbl(pace=1e-3, place=START)

    def fall_silent():
        board.deaf, board.state = True, "Hung"

    board.on_line[30] = fall_silent
    done = call("send", program, "--port", board.port)
    assert done.exit_code == 2
    assert "no answer for 0.4 s; check the cable" in done.stderr
    assert "it does not tell of a rest" in done.stderr
    assert board.events == [b"!", b"\x18"]


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("G1 X1 !", "way.ngc:405: '!' is no character of a line of G-code"),
        ("G1 X1 µ", "way.ngc:405: 'µ' is no character"),
        ("#oid0=0", "way.ngc:405: #oid0=0 is no line of G-code"),
        ("queue_step oid=1", "is no line of G-code: letters, each with a number"),
        ("G1 " + "X1.0000000000 " * 7, "way.ngc:405: 93 characters without spaces and comments, limit 79"),
    ],
)
def test_a_line_that_grbl_cannot_take_is_told_before_the_port_is_opened(call, program, line, words):
    with program.open("a") as file:
        file.write(line + "\n")
    lines = program.read_text().splitlines()
    words = words.replace(":405:", f":{len(lines)}:")
    done = call("send", program, "--port", "/dev/nowhere")
    assert done.exit_code == 2
    assert words in done.stderr


def test_lines_that_are_too_long_are_told_once(call, program):
    with program.open("a") as file:
        file.write(("G1 " + "X1.0000000000 " * 7 + "\n") * 500)
    done = call("send", program, "--port", "/dev/nowhere")
    assert "93 characters without spaces and comments, and 499 lines more, limit 79" in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_a_file_without_a_header_is_refused_unless_it_may_begin_anywhere(call, grbl, tmp_path):
    plain = tmp_path / "plain.nc"
    plain.write_text("G21\nG90\nG1 X20 F600\n", encoding="utf-8")
    done = call("send", plain, "--port", "/dev/nowhere")
    assert done.exit_code == 2
    assert "no header of pulsepath export --format g93" in done.stderr
    board = grbl(place=START)
    assert call("send", plain, "--port", board.port, "--anywhere").exit_code == 0
    assert board.taken == ["G21", "G90", "G1X20F600"]


def test_a_computer_that_is_held_up_does_not_take_that_for_silence(call, grbl, program, monkeypatch):
    """Of its own time a minute is lost, once and for all; the board answers each question."""
    asked = count()
    clock = SimpleNamespace(monotonic=lambda: time.monotonic() + 60.0 * (next(asked) > 30))
    monkeypatch.setattr("controllers.console.grbl.time", clock)
    done = call("send", program, "--port", grbl(place=START).port)
    assert done.exit_code == 0, done.stderr
    assert next(asked) > 31


def test_axes_that_did_not_get_there_are_told_to_be_homed(call, grbl, program):
    board = grbl(place=START)
    board.on_line[len(lines_of(program))] = lambda: board.place.__setitem__(0, 498.0)
    done = call("send", program, "--port", board.port)
    assert done.exit_code == 2
    assert "after the last line" in done.stderr
    assert "it has lost steps, or does not move: home it" in done.stderr


def test_a_port_that_is_none_is_told(call, program):
    done = call("send", program, "--port", "/dev/nowhere")
    assert done.exit_code == 2
    assert "/dev/nowhere" in done.stderr
