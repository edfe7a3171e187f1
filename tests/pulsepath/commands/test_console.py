"""The command `console`: scripts, registers that survive, an operator at a terminal,
interruptions.
"""

import json
import os
import re
import select
import shutil
import signal
import socket
import subprocess
import sys
import time
from itertools import product

import pytest

from controllers.console import open_session, snapshot_session
from kinematics import MotionError, load_machine
from pulsepath.output import register_file

pty = pytest.importorskip("pty")  # not on Windows, where the console is refused


@pytest.fixture
def state(tmp_path):
    return tmp_path / "deep" / "registers.json"


def console(state, script, *options, machine="traverser"):
    command = [
        sys.executable,
        "-m",
        "pulsepath",
        "console",
        "--machine",
        machine,
        "--state",
        str(state),
        *options,
    ]
    return subprocess.run(command, input=script, capture_output=True, text=True, timeout=60)


def wait_until_x_moves(port):
    """Until X has left 0, as a remote line is told: it may ask in any mode, and ends no jog by
    it.
    """
    end = time.monotonic() + 30
    with socket.create_connection(("127.0.0.1", port), timeout=30) as client:
        replies = client.makefile("rb")
        while True:
            client.sendall(b"WHERE\r")
            if not replies.readline().startswith((b"X 0 ", b"X ?0 ")):
                return
            assert time.monotonic() < end


@pytest.mark.parametrize("home", ["/dev/null", "/proc/nothing"])
def test_a_home_that_cannot_be_written_is_bad_input_with_a_way_out(home, state):
    """As of a service's user, or on a computer whose disk is read-only."""
    environment = {key: value for key, value in os.environ.items() if key != "XDG_STATE_HOME"} | {
        "HOME": home
    }
    command = [sys.executable, "-m", "pulsepath", "console", "--machine", "traverser", "--fast"]
    run = {
        "input": "WHERE\n",
        "capture_output": True,
        "text": True,
        "timeout": 60,
        "env": environment,
    }
    done = subprocess.run(command, check=False, **run)
    assert done.returncode == 2
    said = rf"error: {home}/\S+: position registers cannot be kept there: [\w ]+; "
    assert re.fullmatch(said + r"give a file for the registers with --state FILE\n", done.stderr)
    if home == "/dev/null":
        assert subprocess.run([*command, "--state", str(state)], check=False, **run).returncode == 0


def test_a_register_file_that_is_a_directory_is_bad_input_with_a_way_out(state):
    state.mkdir(parents=True)
    done = console(state, "WHERE\n")
    assert done.returncode == 2
    assert (
        done.stderr
        == f"error: {state}: Is a directory; give a file for the registers with --state FILE\n"
    )


def test_a_script_runs_line_by_line_and_the_registers_survive(state):
    done = console(
        state, "HOME X Y Z R\nPOS X CW 100 Z CW 20\nWHERE\nPOS X CCW 101\nPOS Y", "--fast"
    )
    assert done.returncode == 2  # a line was refused
    lines = done.stdout.splitlines()
    assert lines[:3] == [
        "HOME X Y Z R: register 0; X at 0 mm of its travel, 0 to 1219.2 mm, steps 0 to 76800; "
        "Y at 0 mm of its travel, 0 to 1219.2 mm, steps 0 to 76800; "
        "Z at 0 mm of its travel, 0 to 1828.8 mm, steps 0 to 115200; R at 0 deg",
        "DONE",
        "X 100 Y 0 Z 20 R 0 = x 1.5875 y 0.0000 z 0.3175 mm rz 0.0000 deg",
    ]
    assert lines[3].startswith("ERROR axis X to -1 steps is outside 0 to 76800")
    assert lines[4] == "ERROR the input ended within a line; no motion"
    assert "position unknown" in done.stderr
    again = console(state, "WHERE\nACCEPT\n", "--fast")
    assert again.returncode == 0
    assert "last known position X 100 Y 0 Z 20 R 0: ACCEPT or HOME" in again.stderr
    assert again.stdout.splitlines() == [
        "X ?0 Y ?0 Z ?0 R ?0 (?: not counted from home)",
        "ACCEPTED X 100 Y 0 Z 20 R 0",
    ]


def test_bad_input_is_told(state, call):
    for options, words in (
        (["--machine", "traverser", "--listen", "0.0.0.0"], "--listen needs --tcp"),
        (["--machine", "traverser", "--serial", "/dev/nowhere"], "nowhere"),
        (["--machine", "traverser", "--baud", "100"], "110"),
    ):
        done = call("console", *options, "--state", state)
        assert done.exit_code == 2
        assert words in done.stderr
    assert not state.exists()


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        '{"kind": "other"}',
        '{"kind": "pulsepath console", "schema": 1}',
        "\x00" * 100,
    ],
)
def test_a_state_file_that_is_not_whole_is_refused(tmp_path, text):
    path = tmp_path / "state.json"
    path.write_text(text)
    with pytest.raises(MotionError, match=re.escape(str(path))):
        register_file.read(path)


def test_wrong_values_in_a_state_file_are_refused(state):
    assert console(state, "HOME X\n").returncode == 0
    good = json.loads(state.read_text())
    assert register_file.read(state) is not None
    for key, value in (
        ("registers", {"X": 1}),
        ("homed", {**good["homed"], "X": 1}),
        ("machine", 3),
        ("extra", 1),
    ):
        state.write_text(json.dumps({**good, key: value}))
        with pytest.raises(MotionError, match="state"):
            register_file.read(state)
    for key, value in product(
        ("registers", "counters", "pulses"), (2**64, -(2**63), 10**400, 2**53 + 1)
    ):
        state.write_text(json.dumps({**good, key: {**good[key], "X": value}}))
        with pytest.raises(MotionError, match=rf"{key}: X is .*, limit {2**53}; remove the file"):
            register_file.read(state)


def test_killed_in_a_motion_it_does_not_offer_what_moved(state):
    process = subprocess.Popen(
        [sys.executable, "-m", "pulsepath", "console", "--machine", "traverser", "--state", str(state), "--tcp", "0"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    port = int(process.stderr.readline().rpartition(" ")[2])
    process.stdin.write("HOME X Y Z R\nPOS X CW 48000\n")
    process.stdin.flush()
    wait_until_x_moves(port)
    assert json.loads(state.read_text())["moving"]["X"]
    # while it runs, the registers are its own
    second = console(state, "WHERE\n")
    assert second.returncode == 2
    assert "another console" in second.stderr
    process.kill()
    process.communicate()
    again = console(state, "ACCEPT\nWHERE\n")
    assert "Y 0 Z 0 R 0: ACCEPT or HOME; X unknown: HOME" in again.stderr
    assert again.stdout.splitlines()[1] == "X ?0 Y 0 Z 0 R 0 (?: not counted from home)"


@pytest.mark.parametrize(
    ("sent", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)]
)
def test_interrupted_it_stops_and_says_what_was_left(state, sent, code):
    process = subprocess.Popen(
        [sys.executable, "-m", "pulsepath", "console", "--machine", "traverser", "--state", str(state), "--tcp", "0"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    port = int(process.stderr.readline().rpartition(" ")[2])
    process.stdin.write("HOME X Y Z R\nPOS X CW 48000\n")
    process.stdin.flush()
    wait_until_x_moves(port)
    process.send_signal(sent)
    out, err = process.communicate(timeout=30)
    assert process.returncode == code
    left = int(re.search(r"interrupted: X (\d+) Y 0 Z 0 R 0, saved in", err)[1])
    assert 0 < left < 48000
    assert f"STOPPED X {left}" in out
    record = json.loads(state.read_text())
    assert record["registers"]["X"] == left
    assert not any(record["moving"].values())


def test_a_remote_computer_on_the_loopback(state):
    process = subprocess.Popen(
        [sys.executable, "-m", "pulsepath", "console", "--machine", "traverser", "--state", str(state), "--tcp", "0",
         "--fast"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    port = int(re.fullmatch(r"TCP 127\.0\.0\.1 port (\d+)\n", process.stderr.readline())[1])
    with socket.create_connection(("127.0.0.1", port), timeout=20) as client:
        replies = client.makefile("rb")
        client.sendall(b"P X + 1\r")
        assert replies.readline().startswith(b"ERROR the console is in mode MAN")
        process.stdin.write("HOME X Y Z R\nREM\n")
        process.stdin.close()  # the remote line is served on
        assert [process.stdout.readline().split()[0] for _ in range(2)] == ["HOME", "REM:"]
        client.sendall(b"P X + 100 Y + 40 Z + 80\rP X - 40\r\nP X - 61\n")
        assert [replies.readline() for _ in range(2)] == [b"DONE\r\n"] * 2
        assert replies.readline().startswith(b"ERROR axis X to -1 steps")
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=30) == 130
    assert json.loads(state.read_text())["registers"] == {"X": 60, "Y": 40, "Z": 80, "R": 0}
    process.stdout.close()
    process.stderr.close()


def test_a_session_goes_on_without_its_state_directory_and_says_so_once(state):
    process = subprocess.Popen(
        [sys.executable, "-m", "pulsepath", "console", "--machine", "traverser", "--state", str(state), "--fast"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    process.stdin.write("HOME X Y Z R\n")
    process.stdin.flush()
    assert process.stdout.readline().startswith("HOME")
    shutil.rmtree(state.parent)
    out, err = process.communicate("POS X CW 10\nPOS X CW 10\nWHERE\n", timeout=30)
    assert process.returncode == 0
    assert out.splitlines()[:2] == ["DONE", "DONE"]
    assert out.splitlines()[2].startswith("X 20 ")
    assert err.count(f"registers are no longer saved: {state}: No such file") == 1


def test_registers_of_before_are_not_left_to_be_offered(state, monkeypatch):
    told = []
    with register_file.lock_file(state):
        last = snapshot_session(open_session(load_machine("traverser")), 0.0)
        keeper = register_file.Keeper(state, told.append)
        keeper.save(last)
        assert register_file.read(state) == last

        def full(path, text):
            raise OSError(28, "No space left on device")

        with monkeypatch.context() as patch:
            patch.setattr(register_file, "write_whole", full)
            keeper.save(last)
            keeper.save(last)
        assert register_file.read(state) is None
        assert len(told) == 1
        assert "No space left on device; home the axes" in told[0]
        assert "not saved" in keeper.describe
        keeper.save(last)
        assert told[1:] == [f"registers are saved again in {state}"]
        assert register_file.read(state) == last


SEQUENCE = re.compile(r"\x1b\[[?0-9;]*[A-Za-z]")
"""Moves the cursor, or changes how the terminal draws."""


class Seat:
    """An operator at a terminal of the console's own."""

    def __init__(self, state, *options):
        command = [
            "-m",
            "pulsepath",
            "console",
            "--machine",
            "traverser",
            "--state",
            str(state),
            *options,
        ]
        self.pid, self.terminal = pty.fork()
        if self.pid == 0:
            os.execv(sys.executable, [sys.executable, *command])
        self.shown, self.ended = "", False

    def type(self, keys):
        os.write(self.terminal, keys)

    def expect(self, text, seconds=30):
        """What was shown up to a text, which comes by then; a space may have been shown as a move
        of the cursor.
        """
        end = time.monotonic() + seconds
        while text not in self.shown and time.monotonic() < end:
            if select.select([self.terminal], [], [], 0.1)[0]:
                self.shown = SEQUENCE.sub("", self.shown + os.read(self.terminal, 4096).decode())
        assert text in self.shown, self.shown
        before, _, self.shown = self.shown.partition(text)
        return before

    def code(self):
        self.ended = True
        return os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])


@pytest.fixture
def seat(state):
    seats = []

    def take(*options):
        seats.append(Seat(state, *options))
        return seats[-1]

    yield take
    for taken in seats:
        if not taken.ended:
            os.kill(taken.pid, signal.SIGKILL)
            os.waitpid(taken.pid, 0)
        os.close(taken.terminal)


def test_an_operator_at_a_terminal_ends_a_jog_by_any_key(state, seat):
    """By a space, by Escape, and by Ctrl-D, which ends the console elsewhere."""
    operator = seat("--tcp", "0")
    operator.expect("port ")
    port = int(operator.expect("\r\n"))
    operator.expect("MAN>")
    for key in (b" ", b"\x1b", b"\x04"):
        operator.type(b"HOME X Y Z R\n")
        operator.expect("register 0")
        operator.expect("MAN>")
        operator.type(b"jo\tx cw\n")  # completed
        wait_until_x_moves(port)
        operator.type(key)
        operator.expect("STOPPED X ")
        operator.expect("MAN>")
    operator.type(b"EXIT\n")
    assert operator.code() == 0
    assert 0 < json.loads(state.read_text())["registers"]["X"] < 76800  # the end of travel


def test_a_half_typed_line_holds_up_neither_remote_lines_nor_their_stop(seat):
    operator = seat("--tcp", "0")
    operator.expect("port ")
    port = int(operator.expect("\r\n"))
    operator.type(b"HOME X Y Z R\nREM\n")
    operator.expect("REM>")
    with socket.create_connection(("127.0.0.1", port), timeout=10) as client:
        replies = client.makefile("rb")
        client.sendall(b"P X + 48000\r")
        wait_until_x_moves(port)
        operator.type(b"wh")  # stray keys, and no Enter
        operator.expect("wh")
        client.sendall(b"WHERE\r")
        assert replies.readline().startswith(b"X ")
        client.sendall(b"STOP\r")
        assert re.fullmatch(rb"STOPPED X \d+ Y 0 Z 0 R 0\r\n", replies.readline())
        operator.type(b"ere\n")  # the line is still there
        operator.expect("mm rz 0.0000 deg")
    operator.type(b"\x04")
    assert operator.code() == 0


def test_keys_at_a_terminal(seat):
    operator = seat("--fast")
    operator.expect("MAN>")
    operator.type(b"HOME X Y Z R\n")
    operator.expect("register 0")
    operator.type("POS θ CW 4\nPOS X CW 7\n".encode())
    operator.expect("DONE")
    operator.expect("DONE")
    operator.type(b"\x1b[A\x1b[A\n")  # the last line but one
    operator.expect("DONE")
    operator.type(b"P" * 121 + b"\n")
    operator.expect("ERROR a line is longer than 120 characters; no motion")
    operator.type(b"WHERX\x7fE\n")
    operator.expect("X 7 Y 0 Z 0 R 8 =")
    operator.type(b"WHE\x04")  # Ctrl-D leaves an empty line alone
    operator.expect("WHE")
    operator.type(b"\x15qu\t\n")
    assert operator.code() == 0


def test_ctrl_c_at_a_terminal_ends_the_console_and_leaves_the_terminal_as_it_was(seat):
    import termios

    operator = seat()
    before = termios.tcgetattr(operator.terminal)
    operator.expect("MAN>")
    assert termios.tcgetattr(operator.terminal) != before
    operator.type(b"half a line\x03")
    operator.expect("interrupted: X ?0 Y ?0 Z ?0 R ?0, saved in")
    assert operator.code() == 130
    assert termios.tcgetattr(operator.terminal) == before


def test_a_terminal_that_hangs_up_ends_the_console_in_order(state, seat):
    operator = seat("--tcp", "0")
    operator.expect("port ")
    port = int(operator.expect("\r\n"))
    operator.type(b"HOME X Y Z R\nPOS X CW 48000\n")
    operator.expect("register 0")
    wait_until_x_moves(port)
    os.close(operator.terminal)
    operator.terminal = os.open(os.devnull, os.O_RDONLY)  # for the fixture to close
    assert operator.code() == 129
    record = json.loads(state.read_text())
    assert 0 < record["registers"]["X"] < 48000
    assert not any(record["moving"].values())
