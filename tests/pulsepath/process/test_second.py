"""The command line's second process: it is no one's concern but the command's."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time

import pytest

from pulsepath.process import second as module
from pulsepath.process.second import second

SCRIPT = """
import sys
print("run", flush=True)
import pulsepath.process.second
pulsepath.process.second._cores = lambda: 2
with pulsepath.process.second.second(False) as other:
    print(other.start(int).result(lambda: "here"), flush=True)
"""


def test_a_script_that_calls_the_command_line_runs_once(tmp_path):
    """No `if __name__ == "__main__"` stands in it: a process that is spawned would run it again."""
    (tmp_path / "mine.py").write_text(SCRIPT)
    path = os.pathsep.join(filter(None, sys.path))
    done = subprocess.run(
        [sys.executable, tmp_path / "mine.py"],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
        env=os.environ | {"PYTHONPATH": path},
    )
    assert done.stdout.splitlines() == ["run", "0"]
    assert done.stderr == ""


INTERRUPTED = """
import os, signal, sys
import pulsepath.process.second as s
from planner.beside import side_process
signal.signal(signal.SIGINT, lambda *_: None)  # printing is no good: one that comes while another prints fails
started = s._started(False)
print("begun", flush=True)
sys.stdin.readline()
with side_process(started) as other:
    print(other.start(os.getpid).result(lambda: "here") == started[0].pid, flush=True)
"""


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="no signal masks here")
def test_ctrl_c_while_it_starts_is_not_for_it():
    """A terminal's Ctrl-C reaches the whole group, and the second process while Python starts in it."""
    with subprocess.Popen(
        [sys.executable, "-c", INTERRUPTED],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        assert process.stdout.readline() == "begun\n"
        for _ in range(10):
            os.killpg(process.pid, signal.SIGINT)
            time.sleep(0.02)
        assert process.communicate("\n", timeout=60) == ("True\n", "")  # it waited for what it is to do


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="no signal masks here")
def test_ctrl_c_is_let_in_again():
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    main = sys.modules["__main__"]
    with second(False):
        assert signal.pthread_sigmask(signal.SIG_BLOCK, ()) == before
        assert sys.modules["__main__"] is main


@pytest.mark.parametrize("lacking", ["Pipe", "start"])
def test_where_none_can_be_started_all_is_done_here(monkeypatch, lacking):
    """As at the system's limit of processes or of open files."""

    def refuse(*_, **__):
        raise BlockingIOError(11, "Resource temporarily unavailable")

    context = multiprocessing.get_context("spawn")
    monkeypatch.setattr(module, "_cores", lambda: 2)
    monkeypatch.setattr(*((context, "Pipe") if lacking == "Pipe" else (context.Process, "start")), refuse)
    with second(False) as other:
        assert other.start(os.getpid).result(lambda: "here") == "here"
