"""Signals held back: noted, and given to their handlers afterwards."""

import os
import signal
import sys
from threading import Thread

import pytest

from kinematics.files.atomic_files import SIGNAL_NAMES, defer_signals, stage_file
from pulsepath.process import ending

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="a process there cannot send itself these signals")


def come(number=signal.SIGINT):
    os.kill(os.getpid(), number)


def test_it_waits_for_the_end_of_the_block():
    reached = []

    def block():
        with defer_signals() as signals:
            come()
            reached.append(signals.came)

    with pytest.raises(KeyboardInterrupt):
        block()
    assert reached == [signal.SIGINT]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_one_block_in_another_waits_for_the_outer_one():
    reached = []

    def blocks():
        with defer_signals():
            with defer_signals():
                come()
            reached.append("outer")

    with pytest.raises(KeyboardInterrupt):
        blocks()
    assert reached == ["outer"]


def test_what_is_ignored_stays_so():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with defer_signals() as signals:
            come()
        assert signals.came is None
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_other_threads_hold_nothing():
    seen = []

    def block():
        with defer_signals():
            seen.append(signal.getsignal(signal.SIGINT))

    thread = Thread(target=block)
    thread.start()
    thread.join()
    assert seen == [signal.default_int_handler]


def test_the_command_line_ends_by_the_same_signals():
    assert ending.NAMES == SIGNAL_NAMES


@pytest.mark.parametrize("broken", ["_make_directory", "end"])
def test_nothing_staged_is_left_where_making_or_removing_it_is_broken_off(tmp_path, monkeypatch, broken):
    from kinematics.files import atomic_files

    done = getattr(atomic_files, broken)

    def interrupted(*arguments):
        come()
        return done(*arguments)

    monkeypatch.setattr(atomic_files, broken, interrupted)
    with pytest.raises(KeyboardInterrupt), stage_file(tmp_path / "file") as file:
        file.write_text("new")
    # where the signal came while it was removed, the file was in its place already
    assert [path.name for path in tmp_path.iterdir()] == ([] if broken == "_make_directory" else ["file"])
