"""Work beside: in another process where there is one; here where there is none, it died, or cannot be sent."""

import multiprocessing
import os
from functools import partial

import pytest

from kinematics import MotionError
from planner.beside import NO_PROCESS, side_process
from planner.workers import Worker


def die():
    os._exit(1)


def refused():
    raise MotionError("no")


@pytest.fixture(scope="module")
def other():
    worker = Worker()
    with side_process((worker.process, worker.pipe)) as found:
        yield found


def test_it_is_done_there(other):
    assert other.start(os.getpid).result(die) not in (os.getpid(), None)


def test_one_after_the_other(other):
    begun = [other.start(partial(pow, 2, k)) for k in range(5)]
    assert [one.result(die) for one in begun] == [1, 2, 4, 8, 16]


def test_without_a_process_it_is_done_here():
    assert NO_PROCESS.start(die).result(os.getpid) == os.getpid()


def test_what_cannot_be_sent_is_done_here(other):
    assert other.start(lambda: 1).result(os.getpid) == os.getpid()


def test_what_raised_there_raises_here(other):
    with pytest.raises(MotionError, match="no"):
        other.start(refused).result(refused)


def test_where_the_process_dies_it_is_done_here():
    worker = Worker()
    with side_process((worker.process, worker.pipe)) as other:
        first, second = other.start(die), other.start(die)
        assert first.result(os.getpid) == second.result(os.getpid) == os.getpid()


def interrupted(worker):
    with side_process((worker.process, worker.pipe)) as other:
        other.start(partial(pow, 10, 10**9))  # takes for ever
        raise KeyboardInterrupt


def test_no_process_is_left_whatever_happens():
    worker = Worker()
    with pytest.raises(KeyboardInterrupt):
        interrupted(worker)
    assert worker.process not in multiprocessing.active_children()
