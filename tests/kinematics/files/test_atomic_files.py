"""Signals held back: noted, and given to their handlers afterwards."""

import os
import signal
import sys
from threading import Thread

import pytest

from kinematics.files.atomic_files import (
    SIGNAL_NAMES,
    Destination,
    defer_signals,
    move_aside,
    stage_directory,
    stage_file,
)
from kinematics.files.leftovers import MARK, NEW, OLD, clear, shorten_name
from pulsepath.process import ending

pytestmark = pytest.mark.skipif(
    sys.platform == "win32", reason="a process there cannot send itself these signals"
)


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
    assert ending.SIGNAL_NAMES == SIGNAL_NAMES


@pytest.mark.parametrize("broken", ["_make_directory", "end"])
def test_nothing_staged_is_left_where_making_or_removing_it_is_broken_off(
    tmp_path, monkeypatch, broken
):
    from kinematics.files import atomic_files

    done = getattr(atomic_files, broken)

    def interrupted(*arguments):
        come()
        return done(*arguments)

    monkeypatch.setattr(atomic_files, broken, interrupted)
    with pytest.raises(KeyboardInterrupt), stage_file(tmp_path / "file") as file:
        file.write_text("new")
    # where the signal came while it was removed, the file was in its place already
    assert [path.name for path in tmp_path.iterdir()] == (
        [] if broken == "_make_directory" else ["file"]
    )


LONG_NAMES = ["d" * 240, "d" * 255, "é" * 127, "d" * 250 + ".yaml"]
"""Of 240 to 255 bytes, which is what file systems take."""


@pytest.mark.parametrize("name", LONG_NAMES)
def test_names_as_long_as_the_system_takes_them_are_written(tmp_path, name):
    place = tmp_path / name
    Destination(place).write("first")
    with stage_file(place) as file:
        file.write_text("second")
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [(name, "second")]
    (tmp_path / "new").write_text("third")
    aside = move_aside(tmp_path / "new", place)
    assert aside.read_text() == "third"
    assert len(os.fsencode(aside.name)) <= 255
    assert aside.name.endswith(f".kept{place.suffix}")


@pytest.mark.parametrize("name", [*LONG_NAMES, "short"])
def test_what_a_killed_run_had_set_aside_returns_under_its_whole_name(tmp_path, name):
    place = tmp_path / name
    with stage_directory(place) as made:
        left = tmp_path / made.name
        (made / NEW).mkdir()
        mark = (made / MARK).read_bytes()
    left.mkdir()  # as if the run had been killed where it had moved the old result aside
    (left / OLD).write_text("old")
    (left / MARK).write_bytes(mark)
    clear(tmp_path)
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [(name, "old")]


def test_a_mark_leads_nowhere_else(tmp_path):
    folder = tmp_path / "in"
    left = folder / ".out-12345678.staged"
    left.mkdir(parents=True)
    (left / OLD).write_text("old")
    (left / MARK).write_bytes(b"../out")
    clear(folder)
    assert [path.name for path in folder.iterdir()] == ["out"]
    assert [path.name for path in tmp_path.iterdir()] == ["in"]


def test_shortened_names_differ_where_their_names_do():
    one, other = (shorten_name("d" * 250 + end, 20) for end in "ab")
    assert one != other
    assert len(one) == len(other) == 235
    assert shorten_name("d" * 235, 20) == "d" * 235
