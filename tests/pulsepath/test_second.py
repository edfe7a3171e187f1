"""The command line's second process: it is no one's concern but the command's."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time

import pytest

from pulsepath import second as module
from pulsepath.second import second

SCRIPT = """
import sys
print("run", flush=True)
import pulsepath.second
pulsepath.second._cores = lambda: 2
with pulsepath.second.second(False) as other:
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


@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no SIGINT to a group of processes")
@pytest.mark.parametrize("after", [0.02, 0.05, 0.1, 0.2])
def test_ctrl_c_while_it_starts_says_nothing(after):
    """A terminal's Ctrl-C reaches the whole group, and the second process while Python starts in it."""
    code = "import time, pulsepath.second as s; s._started(False); print('begun', flush=True); time.sleep(60)"
    with subprocess.Popen(
        [sys.executable, "-c", code],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        assert process.stdout.readline() == "begun\n"
        time.sleep(after)
        os.killpg(process.pid, signal.SIGINT)
        said = process.communicate(timeout=30)[1]
    assert said.count("Traceback") == 1, said  # the first process' own
    assert "spawn_main" not in said


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
