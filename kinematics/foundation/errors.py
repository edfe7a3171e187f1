"""Every error that is raised on purpose, from one root; and what a validator of a file's values raises."""

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from typing import Any, Self, TypeVar

from pydantic_core import PydanticCustomError


class MotionError(Exception):
    """An error that the user can act on: the message names what, where, value, limit, unit and remedy.

    segment  number of the program's segment that the error is about, from 1; None: of none, or not known
    """

    segment: int | None = None

    def in_segment(self, number: int | None) -> Self:
        """Return the error, with the number of the segment that it is about."""
        self.segment = number
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        """As it is: Python's own way calls the class with the message alone, which few of these take."""
        return _restore_error, (type(self), self.args, self.__dict__)


def _restore_error(kind: type[MotionError], args: tuple[Any, ...], state: dict[str, Any]) -> MotionError:
    error = kind.__new__(kind, *args)
    error.__dict__.update(state)
    return error


Found = TypeVar("Found")


def require(found: Found | MotionError) -> Found:
    """What was found; at the boundary, where a refusal was found instead, it is raised."""
    if isinstance(found, MotionError):
        raise found
    return found


def attempt(work: Callable[[], Found]) -> Found | MotionError:
    """What work comes to, a refusal as a value: for whoever has another way to go."""
    try:
        return work()
    except MotionError as no:
        return no


def take_items(items: Iterator[Found], most: int) -> tuple[list[Found], Iterator[Found]]:
    """So many items at most, and the others: which raise where taking these does."""
    taken: list[Found] = []
    try:
        taken.extend(islice(items, most))
    except MotionError as no:
        return taken, refuse_items(no)
    return taken, items


def refuse_items(no: MotionError) -> Iterator[Any]:
    """What refuses as soon as it is asked for an item."""
    raise no
    yield


class BadValue(MotionError):
    """A value that cannot be: `allowed` is what may stand there, `nearest` the valid name that it is nearest to.

    key  where it stands in the table that was read, if it is not all of it
    """

    def __init__(self, message: str, *, allowed: str = "", nearest: str = "", key: tuple[str | int, ...] = ()) -> None:
        self.allowed, self.nearest, self.key = allowed, nearest, key
        super().__init__(message)


@dataclass(frozen=True, slots=True)
class Fault:
    """One error in a file.

    `key` is the dotted path (`axes.travel`, `segment[2].arc.angle`), `line` counts from 1 (None: not in the text).
    As far as the fault has them: `value` as it is written, what is `allowed` there, and the `nearest` valid name.
    """

    key: str
    message: str
    line: int | None = None
    value: Any = None
    allowed: str = ""
    nearest: str = ""


NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
MAX_ALIKE = 5
"""Faults that differ in numbers alone, as one cause has at every pose, up to which a message tells each."""


class FileError(MotionError):
    """A file that cannot be used; `faults` holds all its errors, found in one pass.

    The message tells each, but of many that differ in numbers alone the first, and how many more there are.
    """

    def __init__(self, file: str, faults: Sequence[Fault]) -> None:
        self.file = file
        self.faults = tuple(faults)
        super().__init__("\n".join(self._list_lines()))

    def _list_lines(self) -> Iterator[str]:
        alike: dict[str, list[Fault]] = {}
        for fault in self.faults:
            alike.setdefault(NUMBER.sub("#", f"{fault.key}: {fault.message}"), []).append(fault)
        many = {id(fault): group for group in alike.values() if len(group) > MAX_ALIKE for fault in group}
        for fault in self.faults:
            group = many.get(id(fault), [fault])
            if fault is group[0]:
                more = f" (and {len(group) - 1} more like it, the last in line {group[-1].line})" if group[1:] else ""
                yield self.describe(fault) + more.replace(", the last in line None", "")

    def describe(self, fault: Fault) -> str:
        """Return one line: file, line, key and message of a fault."""
        place = self.file if fault.line is None else f"{self.file}:{fault.line}"
        return f"{place}: {fault.key}: {fault.message}" if fault.key else f"{place}: {fault.message}"


class NotInstalled(MotionError):
    """A package required for `what` is missing. `extra`: our extra that installs it; None: no wheel here."""

    def __init__(self, what: str, package: str, extra: str | None = None, instead: str = "") -> None:
        self.package = package
        remedy = "it has no wheel for this platform" if extra is None else f"pip install 'pulsepath[{extra}]' brings it"
        super().__init__(f"{what} needs {package}, which is not installed: {remedy}{instead and f'; {instead}'}")


class OutOfReach(MotionError):
    """No actuator coordinates exist for a pose (or no pose for actuator coordinates)."""


class NotFree(OutOfReach):
    """A pose that is off home in a component that its machine does not move: no scale of the others helps.

    pose  index of the pose in the call, from 0
    """

    def __init__(self, message: str, pose: int) -> None:
        self.pose = pose
        super().__init__(message)


@contextmanager
def locate_errors(where: str) -> Iterator[None]:
    """What is refused inside is told with where it stands: "option --speed: …"; what a BadValue knows stays."""
    try:
        yield
    except BadValue as no:
        located = BadValue(f"{where}: {no}", allowed=no.allowed, nearest=no.nearest)
        raise located.in_segment(no.segment) from None
    except MotionError as no:
        raise MotionError(f"{where}: {no}").in_segment(no.segment) from None


@contextmanager
def as_validation_error() -> Iterator[None]:
    """What is refused inside a validator becomes what pydantic collects."""
    try:
        yield
    except MotionError as no:
        raise validation_error(no) from None


def validation_error(told: str | MotionError, kind: str = "fault") -> PydanticCustomError:
    """What a validator raises; the message becomes the fault's, and what a BadValue knows beside it."""
    known = {"allowed": told.allowed, "nearest": told.nearest} if isinstance(told, BadValue) else {}
    return PydanticCustomError(kind, "{message}", {"message": str(told), **known})
