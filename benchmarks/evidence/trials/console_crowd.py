"""Random lines of several remote computers at random instants: mid-move, in the queue, STOP among them.

python -m benchmarks.evidence.trials.console_crowd           20 000 lines
python -m benchmarks.evidence.trials.console_crowd 5000 7    so many, of another seed

A model of a dozen lines says who is answered what and when: commands wait for one another, 16 at most; STOP drops them
and ends the motion; what a command means is read as in `benchmarks.evidence.trials.console_fuzz`. At every arrival
and every end of a
motion the registers are held against the pulses that the card fired, counted one by one; a motion that ends by itself
is where it was sent, one that was stopped between its two ends.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field, replace

import numpy as np

from benchmarks.evidence.trials.console_fuzz import expected_replies, random_command
from controllers.console import Dispatcher, TextLine, advance_time, open_session, take_line
from controllers.console.motion import SessionMotion
from kinematics import load_machine

QUEUE = 16
CLIENTS = 3
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
        t, who = float(until), int(random.integers(1, CLIENTS + 1))
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
    return np.array([of.sum(dtype=np.int64) for of in motion.fired(since, until)])


def main() -> None:
    found = run_crowd(*(int(word) for word in sys.argv[1:])) if len(sys.argv) > 1 else run_crowd(20_000)
    print(
        f"{found.lines} lines, {found.midway} of them mid-move, {found.done} motions done, {found.stopped} stopped, "
        f"{len(found.faults)} faults"
    )
    for fault in found.faults[:20]:
        print(fault)
    raise SystemExit(bool(found.faults))


if __name__ == "__main__":
    main()
