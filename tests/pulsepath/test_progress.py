"""Progress goes to stderr, and Ctrl-C gets through."""

import os
import signal
from contextlib import suppress

import pytest

from pulsepath.progress import step


def interrupt():
    os.kill(os.getpid(), signal.SIGINT)


def test_a_step_tells_what_and_how_long_on_stderr(capsys):
    with step("counting"):
        assert capsys.readouterr() == ("", "")
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("counting: ")
    assert err.endswith(" s\n")


def test_an_interruption_that_the_work_swallows_comes_at_the_end():
    reached = []
    with pytest.raises(KeyboardInterrupt):
        swallow(reached)
    assert reached == ["after"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def swallow(reached):
    with step("solving"):
        with suppress(KeyboardInterrupt):
            interrupt()
        reached.append("after")


def test_an_interruption_ends_the_work():
    reached = []
    with pytest.raises(KeyboardInterrupt):
        be_interrupted(reached)
    assert reached == []


def be_interrupted(reached):
    with step("solving"):
        interrupt()
        reached.append("after")


def test_whoever_ignores_interruptions_still_does():
    previous = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with step("in the background"):
            interrupt()
    finally:
        signal.signal(signal.SIGINT, previous)
    assert previous is signal.default_int_handler
