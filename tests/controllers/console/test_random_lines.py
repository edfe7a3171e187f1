"""Random bytes of several remote computers: no crash, no motion without a command, and registers
that are true.

The computers send noise, text, commands, and commands with changed bytes, cut at random, at random
instants. A regular expression that knows nothing of the console's grammar reads the commands. A
model says who gets which reply: commands wait for one another, 16 at most; STOP drops them and ends
the motion. At every arrival and every end of a motion the registers are compared with the pulses
that the card has fired.
"""

import re
from collections import Counter
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import pytest

from controllers.console import (
    Dispatcher,
    Partial,
    advance_time,
    drop_remote,
    links,
    open_session,
    serve,
    take_line,
)
from kinematics import load_machine

COMMAND = re.compile(rb"[ \t]*P((?:[ \t]+[XYZR][ \t]+[+-][ \t]+[0-9]{1,9})+)[ \t]*")
AXIS_MOVE = re.compile(rb"([XYZR])[ \t]+([+-])[ \t]+([0-9]{1,9})")
AXES = b"XYZR"
LOW = (0, 0, 0, -(2**27))
HIGH = (76800, 76800, 115200, 2**27 - 1)
"""Steps from home: 48, 48 and 72 in of 0.000625 in; the rotary axis to the ends of the 28-bit
counter.
"""
START = (30000, 30000, 30000, 0)
LONGEST_LINE = 120
QUEUE = 16
CLIENTS = (1, 2, 3)


def find_goal(line, at):
    """Return where a command moves the axes from `at`; None for a line that is no command, or out
    of travel.
    """
    command = COMMAND.fullmatch(line)
    if command is None or len(line) > LONGEST_LINE:
        return None
    moves = AXIS_MOVE.findall(command[1])
    goal = np.array(at)
    for axis, sign, steps in moves:
        goal[AXES.index(axis)] += int(sign + steps)
    once = len({axis for axis, *_ in moves}) == len(moves)
    return goal if once and (goal >= LOW).all() and (goal <= HIGH).all() else None


@dataclass
class Model:
    """Where the axes rest or began to move; the goal of the motion and who waits for its end; what
    waits.
    """

    at: np.ndarray
    goal: np.ndarray | None = None
    listeners: list = field(default_factory=list)
    waiting: list = field(default_factory=list)
    stopped: bool = False

    def take(self, who, line):
        """Return the replies to a line that comes now."""
        if line == b"STOP":
            dropped = [(other, "ERROR") for other, _ in self.waiting]
            self.waiting.clear()
            if self.goal is None:
                return [(who, "STOPPED")]
            self.stopped = True
            self.listeners += [who] * (who not in self.listeners)
            return dropped
        if self.goal is None:
            return self.begin(who, line)
        if len(self.waiting) == QUEUE:
            return [(who, "ERROR")]
        self.waiting.append((who, line))
        return []

    def begin(self, who, line):
        """Return the reply to a line that acts now."""
        goal = find_goal(line, self.at)
        if goal is None or (goal == self.at).all():
            return [(who, "ERROR" if goal is None else "DONE")]
        self.goal, self.listeners = goal, [who]
        return []

    def end(self, at):
        """Return the replies at the end of the motion, which leaves the axes at `at`."""
        replies = [(who, "STOPPED" if self.stopped else "DONE") for who in self.listeners]
        self.at, self.goal, self.listeners, self.stopped = at, None, [], False
        while self.waiting and self.goal is None:
            replies += self.begin(*self.waiting.pop(0))
        return replies

    def drop(self, who):
        """Forget a computer that is gone."""
        self.listeners = [other for other in self.listeners if other != who]
        self.waiting = [pair for pair in self.waiting if pair[0] != who]


def draw_command(random):
    """Return a command with its end: mostly short ways, since every pulse is counted, some out of
    travel.
    """
    words = [b"P"]
    for axis in random.permutation(4)[: random.integers(1, 5)]:
        far = axis < 3 and random.random() < 0.05
        steps = random.integers(20_000, 100_000) if far else random.integers(400)
        words += [AXES[axis : axis + 1], (b"+", b"-")[random.integers(2)], str(steps).encode()]
    return b" ".join(words) + (b"\r", b"\n", b"\r\n")[random.integers(3)]


def draw_bytes(random):
    """Return what a computer sends at a time."""
    kind = random.choice(5, p=[0.04, 0.08, 0.08, 0.2, 0.6])
    if kind == 0:
        return b"\rSTOP\r"
    if kind == 1:
        return random.bytes(int(random.integers(1, 300)))
    if kind == 2:
        letters = list(b"PXYZR+-0123456789 \t\r\nMOVEWHJGCpx.;\x00\xff")
        return bytes(random.choice(letters, random.integers(1, 200)).tolist())
    data = bytearray(draw_command(random))
    for _ in range(random.integers(1, 6) if kind == 3 else 0):  # bytes left out, put in or changed
        place = int(random.integers(len(data) + 1))
        data[place : place + int(random.integers(2))] = random.bytes(int(random.integers(2)))
    return bytes(data)


def sum_pulses(motion, since, until):
    """Return the sums of the pulses fired from `since` to before `until`."""
    if motion is None:
        return np.zeros(len(START), np.int64)
    return np.array(
        [directions.sum(dtype=np.int64) for directions in motion.directions_between(since, until)]
    )


def run(strings, seed):
    """Let the computers send so many byte strings, and compare each reply and each register.

    Return how often what.
    """
    random = np.random.default_rng(seed)
    session = open_session(load_machine("traverser"))
    desk = Dispatcher(replace(session, mode="REM", counts=np.array(START), homed=np.ones(4, bool)))
    model = Model(np.array(START, np.int64))
    partial = dict.fromkeys(CLIENTS, Partial())
    tails = dict.fromkeys(CLIENTS, b"")
    counts, since, t = (
        model.at,
        0.0,
        0.0,
    )  # where all pulses fired before `since` have brought the axes
    numbers = Counter()

    def compare(replies, expected):
        assert [(who, text.split()[0]) for who, text in replies] == expected
        assert (desk.end is None) == (model.goal is None)
        numbers.update(kind for _, kind in expected)

    for number in range(strings + 1):
        until = (
            np.inf if number == strings else t + random.exponential(0.3) * (random.random() < 0.7)
        )
        while desk.end is not None and desk.end <= until:
            t = desk.end
            counts = counts + sum_pulses(desk.session.motion, since, np.inf)
            since = t
            low, high = np.sort([model.at, model.goal], axis=0)
            assert ((counts >= low) & (counts <= high)).all()
            assert model.stopped or (counts == model.goal).all()
            desk, replies = advance_time(desk, t)
            compare(replies, model.end(counts))
        if number == strings:
            return numbers
        t = float(until)
        counts, since = counts + sum_pulses(desk.session.motion, since, t), t
        np.testing.assert_array_equal(desk.session.counters(t), counts)
        who = int(random.choice(CLIENTS))
        data = draw_bytes(random)
        *ended, tails[who] = re.split(rb"[\r\n]", tails[who] + data)
        numbers["midway"] += desk.end is not None
        expected = [
            reply for line in ended if line.strip(b" \t") for reply in model.take(who, line)
        ]
        replies = []
        for begin, end in pairwise([0, *sorted(random.integers(len(data) + 1, size=2)), len(data)]):
            partial[who], lines = partial[who].feed(data[begin:end])
            for line in lines:
                desk, own = take_line(desk, who, line, t)
                replies += own
        compare(replies, expected)
        if random.random() < 0.02:  # a computer is gone, and what it has not ended with it
            desk, partial[who], tails[who] = drop_remote(desk, who), Partial(), b""
            model.drop(who)


def test_nothing_moves_without_a_command_and_stop_drops_what_waits():
    numbers = run(3000, seed=2)
    # enough of each kind that the run means something
    assert numbers["midway"] > 1500
    assert numbers["DONE"] > 150
    assert numbers["ERROR"] > 1000
    assert numbers["STOPPED"] > 50


def test_a_shorter_queue_is_noticed(monkeypatch):
    monkeypatch.setattr(serve, "WAITING", 4)
    with pytest.raises(AssertionError):
        run(500, seed=3)


def test_a_console_that_ignores_noise_is_noticed(monkeypatch):
    monkeypatch.setattr(links, "_read", lambda line: links.TextLine(line.decode("ascii", "ignore")))
    with pytest.raises(AssertionError):
        run(500, seed=3)
