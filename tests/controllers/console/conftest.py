"""The traverser's console, and a way to talk to it without a clock."""

from dataclasses import replace

import numpy as np
import pytest

from controllers.console import CONSOLE, Dispatcher, TextLine, advance_time, open_session, take_line
from kinematics import load_machine


class Talk:
    """A desk that is spoken to at instants; every pulse of every motion is counted on the side, one
    by one.
    """

    def __init__(self, machine, *, homed=True, mode="MAN"):
        session = open_session(load_machine(machine))
        n = len(session.counts)
        self.desk = Dispatcher(replace(session, homed=np.full(n, homed), mode=mode))
        self.t, self.fired, self._seen = 0.0, np.zeros(n, np.int64), 0.0

    def say(self, text, who=CONSOLE):
        """Replies to a line, as texts."""
        before = self._counted(self.t)
        self.desk, replies = take_line(self.desk, who, TextLine(text), self.t)
        self._resume(before)
        return [reply for _, reply in replies]

    def wait(self, seconds=None):
        """Replies by then; None: until all stands."""
        replies, until = [], np.inf if seconds is None else self.t + seconds
        while self.desk.end is not None and self.desk.end <= until:
            self.t = self.desk.end
            before = self._counted(np.nextafter(self.t, np.inf))
            self.desk, told = advance_time(self.desk, self.t)
            self._resume(before)
            replies += [reply for _, reply in told]
        if seconds is not None:
            self.t = until
        return replies

    def registers(self):
        return self.desk.session.registers(self.t).tolist()

    def assert_true(self):
        """The registers are what the pulses have brought them to, now."""
        motion = self.desk.session.motion
        here = 0 if motion is None else _net(motion, self._seen, self.t)
        np.testing.assert_array_equal(self.desk.session.counters(self.t), self.fired + here)

    def _counted(self, t):
        """The motion under way, and its pulses from where they were last counted to before t."""
        motion = self.desk.session.motion
        return motion, 0 if motion is None else _net(motion, self._seen, t), t

    def _resume(self, before):
        motion, fired, t = before
        if self.desk.session.motion is not motion:
            self.fired = self.fired + fired
            self._seen = (
                self.desk.session.motion.begun if motion is None and self.desk.session.motion else t
            )


def _net(motion, since, until):
    return np.array([of.sum(dtype=np.int64) for of in motion.directions_between(since, until)])


@pytest.fixture
def talk():
    return lambda machine="traverser", **known: Talk(machine, **known)
