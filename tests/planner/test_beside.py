"""Work beside: done once, in another process where there is one, here where there is none or it died."""

import os
from functools import partial

import pytest

from kinematics import MotionError
from planner.beside import beside


def nothing():
    pass


def die():
    os._exit(1)


def refused():
    raise MotionError("no")


def unless_in(process):
    """Dies in every process but one."""
    if os.getpid() != process:
        os._exit(1)
    return "done here"


@pytest.fixture(params=[1, 2])
def cores(request, monkeypatch):
    monkeypatch.setattr("planner.beside.cores", lambda: request.param)
    return request.param


def test_it_is_done_once_and_elsewhere_if_it_can_be(cores):
    with beside(nothing) as other:
        result = other.start(os.getpid)
        assert (result() != os.getpid()) is (cores == 2)
        assert result() == result()


def test_what_it_raises_is_raised_here(cores):
    with beside(nothing) as other:
        result = other.start(refused)
        with pytest.raises(MotionError, match="no"):
            result()


@pytest.mark.parametrize("ready", [nothing, die])
def test_where_the_process_dies_it_is_done_here(monkeypatch, ready):
    monkeypatch.setattr("planner.beside.cores", lambda: 2)
    with beside(ready) as other:
        assert other.start(partial(unless_in, os.getpid()))() == "done here"


def test_no_process_is_left_whatever_happens(monkeypatch):
    import multiprocessing

    monkeypatch.setattr("planner.beside.cores", lambda: 2)
    with pytest.raises(KeyboardInterrupt), beside(nothing) as other:
        other.start(partial(unless_in, 0))
        assert multiprocessing.active_children()
        raise KeyboardInterrupt
    assert not multiprocessing.active_children()
