"""A process beside this one: work is done there where there is one, and here where there is none or
it cannot be.
"""

import multiprocessing
import os
import select
import signal
import subprocess
import sys
from functools import partial

import pytest

from kinematics import MotionError
from planner import parallel
from planner.parallel import NO_PROCESS, side_process


def die():
    os._exit(1)


def refuse():
    raise MotionError("no")


@pytest.fixture(autouse=True)
def two_cores(monkeypatch):
    monkeypatch.setattr(parallel, "cores", lambda: 2)


@pytest.fixture(scope="module")
def other():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(parallel, "cores", lambda: 2)
        with side_process() as found:
            yield found


def test_it_is_done_there(other):
    assert other.start(os.getpid).result(die) not in (os.getpid(), None)


def test_one_after_the_other(other):
    begun = [other.start(partial(pow, 2, k)) for k in range(5)]
    assert [one.result(die) for one in begun] == [1, 2, 4, 8, 16]


def test_large_results_come_whole(other):
    assert other.start(partial(bytes, 10**7)).result(die) == bytes(10**7)


@pytest.mark.parametrize("none", [NO_PROCESS, "one core"])
def test_without_a_process_it_is_done_here(monkeypatch, none):
    if none == "one core":
        monkeypatch.setattr(parallel, "cores", lambda: 1)
        with side_process() as none:
            pass
    assert none.start(die).result(os.getpid) == os.getpid()


def test_what_cannot_be_sent_is_done_here(other):
    assert other.start(lambda: 1).result(os.getpid) == os.getpid()


def test_what_raised_there_raises_here(other):
    with pytest.raises(MotionError, match="no"):
        other.start(refuse).result(refuse)


def test_where_the_process_dies_it_is_done_here():
    with side_process() as other:
        first, second = other.start(die), other.start(die)
        assert first.result(os.getpid) == second.result(os.getpid) == os.getpid()
        assert other.start(die).result(os.getpid) == os.getpid()


def interrupt(begun):
    before = multiprocessing.active_children()
    with side_process() as other:
        other.start(partial(pow, 10, 10**9))  # takes for ever
        begun += [process for process in multiprocessing.active_children() if process not in before]
        raise KeyboardInterrupt


def test_no_process_is_left_whatever_happens():
    begun = []
    with pytest.raises(KeyboardInterrupt):
        interrupt(begun)
    assert begun
    assert not {*begun} & {*multiprocessing.active_children()}


SCRIPT = """
import os
print("run", flush=True)
from planner import parallel
parallel.cores = lambda: 2
with parallel.side_process(["fractions"]) as other:
    print(other.start(int).result(lambda: "here"), flush=True)
"""


def test_a_script_that_calls_the_command_line_runs_once(tmp_path):
    """No `if __name__ == "__main__"` stands in it, and its folder has modules of other names than
    they should.
    """
    (tmp_path / "mine.py").write_text(SCRIPT)
    (tmp_path / "signal.py").write_text("raise SystemExit('not this one')")
    path = os.pathsep.join(filter(None, sys.path))
    done = subprocess.run(
        [sys.executable, "-P", "mine.py"],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": path},
    )
    assert done.stdout.splitlines() == ["run", "0"]
    assert done.stderr == ""


INTERRUPTED = """
import signal
from planner import parallel
signal.signal(signal.SIGINT, lambda *_: None)  # printing is no good: one that comes while another prints fails
parallel.cores = lambda: 2
with parallel.side_process() as other:
    print("begun", flush=True)
    print(other.start(int).result(lambda: "here"), flush=True)
"""


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="no signal masks here")
def test_ctrl_c_while_it_starts_is_not_for_it():
    """A terminal's Ctrl-C reaches the whole group, and the other process while Python starts in
    it.
    """
    with subprocess.Popen(
        [sys.executable, "-c", INTERRUPTED],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        assert process.stdout.readline() == "begun\n"
        while not select.select([process.stdout], [], [], 0.02)[0]:
            os.killpg(process.pid, signal.SIGINT)
        assert process.communicate(timeout=60) == ("0\n", "")  # done there


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="no signal masks here")
def test_ctrl_c_is_let_in_again():
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    main = sys.modules["__main__"]
    with side_process():
        assert signal.pthread_sigmask(signal.SIG_BLOCK, ()) == before
        assert sys.modules["__main__"] is main


@pytest.mark.parametrize(
    "lacking", ["multiprocessing.Pipe", "loky.backend.process.LokyProcess.start"]
)
def test_where_none_can_be_started_all_is_done_here(monkeypatch, lacking):
    """As at the system's limit of processes or of open files."""

    def refuse(*_, **__):
        raise BlockingIOError(11, "Resource temporarily unavailable")

    monkeypatch.setattr(lacking, refuse)
    with side_process() as other:
        assert other.start(os.getpid).result(lambda: "here") == "here"
