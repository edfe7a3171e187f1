"""Random bytes and random lines for the console: nothing crashes, nothing moves unasked, and registers are true.

python -m benchmarks.evidence.trials.console             100 000 byte strings on the remote line
python -m benchmarks.evidence.trials.console 10000 7     so many, of another seed
python -m benchmarks.evidence.trials.console crowd       20 000 lines of several remote computers, at random instants
python -m benchmarks.evidence.trials.console crowd 5000 7

Each string (noise, text, commands, commands with bytes changed, several in a packet) is cut at random and fed to a
dispatcher in mode REM. What ought to happen is read from the bytes by one regular expression, which knows nothing of
the console's grammar. At a random instant of every motion and at its end, each register is held against home's and the
pulses that the card fired, counted one by one.

Of the crowd, whose lines come mid-move, in the queue, and STOP among them, a model of a dozen lines says who is
answered what and when: commands wait for one another, 16 at most; STOP drops them and ends the motion. At every arrival
and every end of a motion the registers are held against the pulses that the card fired; a motion that ends by itself
is where it was sent, one that was stopped between its two ends.
"""

from __future__ import annotations

import re
import sys
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from time import perf_counter

import numpy as np

from controllers.console import Dispatcher, Partial, TextLine, advance_time, drop_remote, open_session, take_line
from controllers.console.motion import SessionMotion
from kinematics import load_machine

COMMAND = re.compile(rb"[ \t]*P((?:[ \t]+[XYZR][ \t]+[+-][ \t]+[0-9]{1,9})+)[ \t]*")
AXIS_MOVE = re.compile(rb"([XYZR])[ \t]+([+-])[ \t]+([0-9]{1,9})")
AXES = b"XYZR"
TRAVEL = (76800, 76800, 115200, 2**27 - 1)
"""Steps from home: 48, 48 and 72 in of 0.000625 in; the rotary axis to the end of the 28-bit counter, both ways."""
MAX_LINE_LENGTH = 120
REMOTE = 1


@dataclass(frozen=True, slots=True)
class FuzzReport:
    """What was fed and what happened; faults: whatever was not as it ought to be."""

    strings: int
    lines: int
    motions: int
    refused: int
    seconds: float
    faults: tuple[str, ...]


def fuzz(strings: int, seed: int = 1) -> FuzzReport:
    """Feed so many random byte strings."""
    random, begin = np.random.default_rng(seed), perf_counter()
    session = open_session(load_machine("traverser"))
    start = np.array([30000, 30000, 30000, 0])
    session = replace(session, mode="REM", counts=start, homed=np.ones(4, bool))
    desk, partial, expected, tail = Dispatcher(session), Partial(), start.astype(np.int64), b""
    t, lines, motions, refused, faults = 0.0, 0, 0, 0, []
    for number in range(strings):
        data = _string(random)
        wanted, expected, tail = expected_replies(tail + data, expected)
        replies: list[tuple[int, str]] = []
        for chunk in _cut(random, data):
            partial, found = partial.feed(chunk)
            for line in found:
                desk, said = take_line(desk, REMOTE, line, t)
                replies += said
        while desk.session.motion is not None:
            motion, before = desk.session.motion, desk.session.counts
            middle = motion.begun + random.random() * (motion.end - motion.begun)
            for instant in (middle, motion.end):
                fired = np.array(
                    [int(of.sum()) for of in motion.directions_between(motion.begun, np.nextafter(instant, np.inf))]
                )
                if (desk.session.registers(instant) != before + fired).any():
                    faults.append(f"string {number}: registers {desk.session.registers(instant)} of {before + fired}")
            t, motions = motion.end, motions + 1
            desk, said = advance_time(desk, t)
            replies += said
        texts = ["DONE" if text == "DONE" else text.split()[0] for _, text in replies]
        lines, refused = lines + len(wanted), refused + texts.count("ERROR")
        if texts != wanted:
            faults.append(f"string {number} {data!r}: replied {texts}, not {wanted}")
        if (desk.session.counts != expected).any():
            faults.append(f"string {number} {data!r}: stands at {desk.session.counts}, not {expected}")
        if random.random() < 0.02:  # the client vanishes, and with it what has no end yet
            desk, partial, tail = drop_remote(desk, REMOTE), Partial(), b""
    return FuzzReport(strings, lines, motions, refused, perf_counter() - begin, tuple(faults))


def expected_replies(data: bytes, at: np.ndarray) -> tuple[list[str], np.ndarray, bytes]:
    """The replies that bytes deserve, in turn, where the axes then stand, and the line that has no end yet."""
    *ended, tail = re.split(rb"[\r\n]", data)
    wanted = []
    for line in ended:
        if not line.strip(b" \t"):
            continue
        done = COMMAND.fullmatch(line) if len(line) <= MAX_LINE_LENGTH else None
        goal, named = np.array(at), []
        for axis, sign, steps in AXIS_MOVE.findall(done[1]) if done else ():
            named.append(AXES.index(axis))
            goal[named[-1]] += int(steps) * (1 if sign == b"+" else -1)
        low = np.array([0, 0, 0, -(2**27)])
        fits = done and len(set(named)) == len(named) and (goal >= low).all() and (goal <= TRAVEL).all()
        at = goal if fits else at
        wanted.append("DONE" if fits else "ERROR")
    return wanted, at, tail


def _string(random: np.random.Generator) -> bytes:
    kind = random.integers(6)
    if kind == 0:
        return random.bytes(int(random.integers(1, 300)))
    if kind == 1:
        return bytes(random.choice(list(b"PXYZR+-0123456789 \t\r\nMOVEWHJGCpx.;\x00\xff"), random.integers(1, 200)))
    data = b"".join(random_command(random) for _ in range(random.integers(1, 4)))
    if kind < 5:  # a few bytes left out, put in or changed
        held = bytearray(data)
        for _ in range(random.integers(1, 6)):
            place = int(random.integers(len(held))) if held else 0
            held[place : place + int(random.integers(2))] = random.bytes(int(random.integers(2)))
        return bytes(held)
    return data


def random_command(random: np.random.Generator) -> bytes:
    words = [b"P"]
    for axis in random.permutation(4)[: random.integers(1, 5)]:
        # mostly short ways, since every pulse is counted; now and then one that is out of a slide's travel, or may be
        far = axis < 3 and random.random() < 0.05
        steps = random.integers(20_000, 100_000) if far else random.integers(400)
        words += [AXES[axis : axis + 1], (b"+", b"-")[random.integers(2)], str(steps).encode()]
    return b" ".join(words) + (b"\r", b"\n", b"\r\n")[random.integers(3)]


def _cut(random: np.random.Generator, data: bytes) -> list[bytes]:
    places = [0, *sorted(random.integers(len(data) + 1, size=random.integers(3))), len(data)]
    return [data[a:b] for a, b in pairwise(places)]


QUEUE = 16
CLIENT_COUNT = 3
START = (30000, 30000, 30000, 0)


@dataclass(slots=True)
class Model:
    """What ought to be: where the axes stand or stood last, the motion's goal and who is told, and what waits."""

    at: np.ndarray
    goal: np.ndarray | None = None
    told: list[int] = field(default_factory=list)
    waiting: list[tuple[int, bytes]] = field(default_factory=list)
    stopped: bool = False

    def line(self, who: int, line: bytes) -> list[tuple[int, str]]:
        """The replies to a line that comes now."""
        if line == b"STOP":
            dropped = [(other, "ERROR") for other, _ in self.waiting]
            self.waiting.clear()
            if self.goal is None:
                return [(who, "STOPPED")]
            self.stopped = True
            self.told += [who] * (who not in self.told)
            return dropped
        if self.goal is None:
            return self._begin(who, line)
        if len(self.waiting) == QUEUE:
            return [(who, "ERROR")]
        self.waiting.append((who, line))
        return []

    def end(self, stands: np.ndarray) -> list[tuple[int, str]]:
        """The replies at the end of the motion; stands: where a stop has left the axes."""
        replies = [(who, "STOPPED" if self.stopped else "DONE") for who in self.told]
        self.at = stands if self.stopped or self.goal is None else self.goal
        self.goal, self.told, self.stopped = None, [], False
        while self.waiting and self.goal is None:
            replies += self._begin(*self.waiting.pop(0))
        return replies

    def _begin(self, who: int, line: bytes) -> list[tuple[int, str]]:
        (reply,), goal, _ = expected_replies(line + b"\r", self.at)
        if reply == "ERROR" or (goal == self.at).all():
            return [(who, reply)]
        self.goal, self.told = goal, [who]
        return []


@dataclass(frozen=True, slots=True)
class CrowdReport:
    """What was said and what happened; faults: whatever was not as it ought to be."""

    lines: int
    midway: int
    done: int
    stopped: int
    faults: tuple[str, ...]


def run_crowd(lines: int, seed: int = 1) -> CrowdReport:
    """Let a few computers say so many lines, and all motions end."""
    random = np.random.default_rng(seed)
    session = open_session(load_machine("traverser"))
    desk = Dispatcher(replace(session, mode="REM", counts=np.array(START), homed=np.ones(4, bool)))
    model = Model(np.array(START, np.int64))
    t, midway, done, stopped, faults = 0.0, 0, 0, 0, []
    counted, seen = model.at, 0.0  # where all pulses fired before `seen` have brought the axes

    def compare(what: str, replies: tuple[tuple[int, str], ...], wanted: list[tuple[int, str]]) -> None:
        firsts = [(who, text.split()[0]) for who, text in replies]
        if firsts != wanted:
            faults.append(f"{what}: replied {firsts}, not {wanted}")
        if (desk.end is None) != (model.goal is None):
            faults.append(f"{what}: a motion is {'' if desk.end else 'not '}under way")

    for number in range(lines + 1):
        until = np.inf if number == lines else t + random.exponential(0.3) * (random.random() < 0.7)
        while desk.session.motion is not None and desk.session.motion.end <= until:
            motion, t = desk.session.motion, desk.session.motion.end
            stands = counted = counted + _sum_fired_pulses(motion, seen, np.inf)
            if model.goal is not None and not model.stopped and (stands != model.goal).any():
                faults.append(f"before line {number}: stands at {stands}, not {model.goal}")
            low, high = np.sort([model.at, stands if model.goal is None else model.goal], axis=0)
            if ((stands < low) | (stands > high)).any():
                faults.append(f"before line {number}: stopped at {stands}, outside {low} to {high}")
            done, stopped = done + (not model.stopped), stopped + model.stopped
            desk, replies = advance_time(desk, motion.end)
            seen = t
            compare(f"before line {number}", replies, model.end(stands))
        if number == lines:
            break
        t, who = float(until), int(random.integers(1, CLIENT_COUNT + 1))
        text = (b"STOP", b"P X + nothing", random_command(random).strip())[random.choice(3, p=[0.04, 0.05, 0.91])]
        midway += desk.end is not None
        counted, seen = counted + _sum_fired_pulses(desk.session.motion, seen, t), t
        if (desk.session.counters(t) != counted).any():
            faults.append(f"line {number}: counters {desk.session.counters(t)} of {counted} pulses")
        desk, replies = take_line(desk, who, TextLine(text.decode()), t)
        compare(f"line {number} {text!r}", replies, model.line(who, text))
    return CrowdReport(lines, midway, done, stopped, tuple(faults))


def _sum_fired_pulses(motion: SessionMotion | None, since: float, until: float) -> np.ndarray:
    """Of each axis the sum of the pulses fired from `since` to before `until`, one by one."""
    if motion is None:
        return np.zeros(len(START), np.int64)
    return np.array([of.sum(dtype=np.int64) for of in motion.directions_between(since, until)])


def main() -> None:
    crowd = sys.argv[1:2] == ["crowd"]
    numbers = [int(word) for word in sys.argv[1 + crowd :]]
    found = run_crowd(*numbers or [20_000]) if crowd else fuzz(*numbers or [100_000])
    said = [f"{value} {name}" for name, value in asdict(found).items() if name != "faults"]
    print(", ".join(said), f"{len(found.faults)} faults", *found.faults[:20], sep="\n")
    raise SystemExit(bool(found.faults))


if __name__ == "__main__":
    main()
