"""grbl, grblHAL or FluidNC on a serial line: G-code sent with the receive buffer kept full, and a safe stop.

grbl answers each line with ok or error:N once it has taken it out of its receive buffer. So what it holds is known by
counting characters, and the buffer is kept full without ever flowing over [grbl wiki, Interface, "Streaming a G-Code
Program"]. Feed hold (!), soft reset (0x18) and the question for its status (?) are taken at once, past the buffer.
"""

import re
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from kinematics.foundation.errors import Fault, FileError, MotionError, NotInstalled
from kinematics.foundation.names import count_noun

BUFFER = 127
"""Bytes that every grbl takes: its buffer has 128 places, and early versions leave one empty."""
LONGEST_LINE = 79
"""Characters of a line of grbl's: its line buffer has 80 with the end."""
HOLD, RESET, STATUS = b"!", b"\x18", b"?"
REAL_TIME = "!~?"
"""Characters that grbl takes out of lines and obeys at once, comments too."""
READ_TIMEOUT, STATUS_PERIOD = 0.02, 0.25
"""s that a read waits, and between two questions for the status."""
START_PATIENCE, PATIENCE, STOP_PATIENCE = 5.0, 5.0, 10.0
"""s within which a board starts, answers a question, and slows down to rest."""
STAND_TOLERANCE = 0.02
"""mm or degrees by which the axes may stand off where the file begins: grbl tells thousandths, steps are up to 1/80."""
ERRORS = {
    1: "a word without its letter",
    2: "a number that is none",
    3: "a $ command that it does not know",
    8: "not idle",
    9: "locked by an alarm or by jogging",
    10: "soft limits need homing",
    11: "the line is too long",
    20: "a command that it does not know",
    21: "two commands of a group in a block",
    22: "no feed rate",
    23: "a command needs a whole number",
    24: "two commands that need axis words",
    26: "a command without its axis words",
    33: "a target that is none",
}
ALARMS = {1: "a hard limit", 2: "a target beyond soft limits", 3: "reset in motion, its position is lost"}
WORDS = re.compile(r"(?:[A-Za-z][+-]?(?:\d+\.?\d*|\.\d+))+|\$.*")
"""A line of G-code without spaces, or one of grbl's own commands."""
MAX_FAULTS = 20
"""Faults of a file that are told."""
STAND = re.compile(r"\(the axes must stand at ([^)]*)\)")
LETTERS = "XYZABCUVW"
"""Axes in the order in which a status tells them."""


@dataclass(frozen=True, slots=True)
class GcodeLine:
    """A line as it is sent: without comments and spaces; number: of the file."""

    number: int
    text: str


@dataclass(frozen=True, slots=True)
class GcodeFile:
    """What is sent of a file; start: where its header has the axes stand, by letter, end: where its last move leads."""

    lines: tuple[GcodeLine, ...]
    start: dict[str, float]
    end: dict[str, float]


def read_gcode(path: Path, longest: int, anywhere: bool = False) -> GcodeFile:
    """The lines that a controller is to take; anywhere: also of a file that does not say where its axes must stand.

    Raises FileError, one fault a line, for what is no G-code or has characters that a controller obeys at once, and one
    for all lines that are too long; MotionError for a file without lines or without that.
    """

    text = path.read_text(encoding="utf-8", errors="replace")
    lines, faults, long = [], [], []
    for number, line in enumerate(text.splitlines(), 1):
        plain = re.sub(r"\([^()]*\)|;.*|\s", "", line)
        bad = sorted({char for char in plain if not "!" <= char <= "~" or char in REAL_TIME})
        if bad:
            faults.append(Fault("", f"{bad[0]!r} is no character of a line of G-code: take it out", number))
        elif plain in ("", "%"):
            continue
        elif not WORDS.fullmatch(plain):
            faults.append(Fault("", f"{plain[:40]} is no line of G-code: letters, each with a number", number))
        elif len(plain) > longest:
            long.append((number, len(plain)))
        else:
            lines.append(GcodeLine(number, plain))
    if long:
        more = f", and {count_noun(len(long) - 1, 'line')} more" if len(long) > 1 else ""
        told = (
            f"{max(length for _, length in long)} characters without spaces and comments{more}, limit {longest}; "
            "export fewer axes, or state the controller's own limit with --line"
        )
        faults.append(Fault("", told, long[0][0]))
    faults = faults if len(faults) <= MAX_FAULTS else [*faults[:MAX_FAULTS], Fault("", "and more such lines")]
    if faults:
        raise FileError(str(path), faults)
    if not lines:
        raise MotionError(f"{path}: there is no line to send; give a file of G-code")
    header = STAND.search(text)
    if header is None and not anywhere:
        raise MotionError(
            f"{path}: it has no header of pulsepath export --format g93, so where its axes must stand is not known; "
            "give --anywhere to send it nevertheless"
        )
    start = _words(header[1]) if header else {}
    moves = [line.text for line in lines if line.text.startswith("G1")]
    end = {letter: at for letter, at in _words(moves[-1]).items() if letter in start} if moves else {}
    return GcodeFile(tuple(lines), start, end)


def _words(text: str) -> dict[str, float]:
    return {letter: float(number) for letter, number in re.findall(r"([A-Z])(-?\d+(?:\.\d*)?)", text)}


class Controller:
    """grbl on a port that reads and writes bytes: how much of its buffer is used, and what it says."""

    def __init__(self, port: Any, name: str, buffer: int = BUFFER) -> None:
        self.port, self.name, self.buffer = port, name, buffer
        self._held: deque[tuple[int, GcodeLine]] = deque()
        self._partial = b""
        self._asked, self._unanswered = time.monotonic(), 0
        self._offset: list[float] | None = None
        self.state, self.place = "", {}  # type: tuple[str, dict[str, float]]

    def wake(self) -> None:
        """Wait until the board has started, and drop what is left of a line. Raises MotionError unless it is idle."""

        while not self.state:
            if self._is_silent(START_PATIENCE):
                raise MotionError(
                    f"{self.name}: nothing that is grbl answers within {START_PATIENCE:g} s; "
                    "check the port, its --baud and the board"
                )
            self._ask()
            self._listen()
        if self._base != "Idle":
            remedy = "unlock it ($X) or home it ($H) first" if self._base == "Alarm" else "wait until it is idle"
            raise MotionError(f"{self.name}: the controller is in the state {self.state}, not Idle; {remedy}")
        self.stream([GcodeLine(0, "")])

    @property
    def _base(self) -> str:
        return self.state.partition(":")[0]

    def find_place(self) -> dict[str, float]:
        """Where the axes stand in work coordinates, by letter; {}: the controller does not tell."""
        self.place, self._offset, self._unanswered = {}, None, 0
        while not self.place and not self._is_silent(PATIENCE):
            self._ask()
            self._listen()
        return self.place

    def stream(self, lines: Sequence[GcodeLine], tell: Callable[[int, int], None] = lambda done, of: None) -> None:
        """Send lines, the buffer as full as it gets, until each is answered.

        Raises MotionError for the first that is refused, an alarm, a reset of the board, or silence.
        """

        done = sent = self._unanswered = 0
        while done < len(lines):
            while sent < len(lines) and self._used + len(lines[sent].text) + 1 <= self.buffer:
                data = lines[sent].text.encode("ascii") + b"\n"
                self._held.append((len(data), lines[sent]))
                self._write(data)
                sent += 1
            for answer in self._listen():
                at = self._held[0][1] if self._held else GcodeLine(0, "")
                if answer == "ok" and self._held:
                    self._held.popleft()
                    done += 1
                elif answer.startswith("error:"):
                    raise MotionError(f'line {at.number} "{at.text}": {answer}{_explain(answer, ERRORS)}')
                elif answer.startswith("ALARM:"):
                    raise MotionError(f"{self.name}: {answer}{_explain(answer, ALARMS)}, at line {at.number} or before")
                elif answer.lower().startswith("grbl"):
                    raise MotionError(f"{self.name}: the board was reset, at line {at.number} or before")
            tell(done, len(lines))
            self._ask()
            self._refuse_silence()

    @property
    def _used(self) -> int:
        return sum(length for length, _ in self._held)

    def wait_idle(self) -> None:
        """Until all that was sent has been moved. Raises MotionError for an alarm, or silence."""

        self.state, self._unanswered = "", 0
        while self._base != "Idle":
            for answer in self._listen():
                if answer.startswith("ALARM:"):
                    raise MotionError(f"{self.name}: {answer}{_explain(answer, ALARMS)}")
            self._ask()
            self._refuse_silence()

    def stop(self) -> bool:
        """Feed hold, then, once the axes stand, a soft reset, which drops all that is left; whether they came to rest.

        grbl keeps its position when it is reset at rest.
        """
        begin, self.state = time.monotonic(), ""
        self._write(HOLD)
        rest = False
        while not rest and time.monotonic() - begin < STOP_PATIENCE:
            self._ask()
            self._listen()
            rest = self.state == "Hold:0" or self._base in ("Idle", "Alarm", "Check")
        self._write(RESET)
        self._held.clear()
        self._listen()
        return rest

    def _write(self, data: bytes) -> None:
        self.port.write(data)

    def _ask(self) -> None:
        if time.monotonic() - self._asked > STATUS_PERIOD:
            self._asked = time.monotonic()
            self._unanswered += 1
            self._write(STATUS)

    def _is_silent(self, patience: float) -> bool:
        """Whether questions of so many s have no answer: the clock alone goes on while this process is held up."""
        return self._unanswered * STATUS_PERIOD > patience

    def _refuse_silence(self) -> None:
        if self._is_silent(PATIENCE):
            raise MotionError(f"{self.name}: no answer for {PATIENCE:g} s; check the cable and the board")

    def _listen(self) -> list[str]:
        """The lines that have come, but for the status, which is noted."""
        data = self.port.read(max(1, self.port.in_waiting))
        *ended, self._partial = (self._partial + data).replace(b"\r", b"\n").split(b"\n")
        answers = [text for line in ended if (text := line.decode("ascii", "replace").strip())]
        if answers:
            self._unanswered = 0
        for answer in answers:
            if answer.startswith("<") and answer.endswith(">"):
                self._note_status(answer[1:-1])
        return [answer for answer in answers if not answer.startswith("<")]

    def _note_status(self, text: str) -> None:
        self.state, *fields = text.split("|")
        told = {name: values.split(",") for name, _, values in (field.partition(":") for field in fields)}
        try:
            if "WCO" in told:
                self._offset = [float(value) for value in told["WCO"]]
            if "WPos" in told:
                at = [float(value) for value in told["WPos"]]
            elif "MPos" in told and self._offset is not None:
                at = [float(m) - w for m, w in zip(told["MPos"], self._offset, strict=True)]
            else:
                return
        except ValueError:  # a line that noise has changed
            return
        self.place = dict(zip(LETTERS, at, strict=False))


def _explain(answer: str, known: dict[int, str]) -> str:
    code = answer.partition(":")[2]
    told = known.get(int(code)) if code.isdigit() else None
    return f" ({told})" if told else ""


def refuse_elsewhere(place: dict[str, float], wanted: dict[str, float], what: str, remedy: str) -> None:
    """Raise MotionError, with the remedy, where an axis is not where it should be, or the controller does not tell."""

    for letter, at in wanted.items():
        if letter not in place:
            raise MotionError(f"{what}: the controller does not tell where axis {letter} is; --anywhere goes on")
        if abs(place[letter] - at) > STAND_TOLERANCE:
            raise MotionError(
                f"{what}: axis {letter} is at {place[letter]:.3f} in work coordinates, and has to be at {at:.3f} "
                f"within {STAND_TOLERANCE:g}; {remedy}"
            )


def open_port(port: str, baud: int) -> Any:
    """A serial port, 8N1, by pyserial. Raises MotionError where it cannot be opened."""

    try:
        import serial
    except ImportError:
        raise NotInstalled("pulsepath send", "pyserial", "serial") from None
    try:
        return serial.Serial(port, baud, timeout=READ_TIMEOUT, write_timeout=PATIENCE, exclusive=True)
    except (OSError, ValueError) as error:  # SerialException is an OSError
        raise MotionError(f"serial port {port} at {baud} baud: {error}") from None
