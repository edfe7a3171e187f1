"""Errors that are raised on purpose, from one root, and the error of a validator of a file's
values.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from typing import Any, Self, TypeVar

from pydantic_core import PydanticCustomError


class MotionError(Exception):
    """An error that the user can act on: it names what, where, value, limit, unit and remedy.

    segment  number of the program's segment that the error is about, from 1; None: none, or unknown
    """

    segment: int | None = None

    def in_segment(self, number: int | None) -> Self:
        """Return the error, with the number of the segment that it is about."""
        self.segment = number
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the state: the constructors of subclasses take more than the message."""
        return _restore_error, (type(self), self.args, self.__dict__)


def _restore_error(
    kind: type[MotionError], args: tuple[Any, ...], state: dict[str, Any]
) -> MotionError:
    error = kind.__new__(kind, *args)
    error.__dict__.update(state)
    return error


Result = TypeVar("Result")


def require(result: Result | MotionError) -> Result:
    """Return a result. Raise it if it is an error."""
    if isinstance(result, MotionError):
        raise result
    return result


def attempt(work: Callable[[], Result]) -> Result | MotionError:
    """Return the result of a function, or its error, for a caller that has an alternative."""
    try:
        return work()
    except MotionError as error:
        return error


def take_items(items: Iterator[Result], most: int) -> tuple[list[Result], Iterator[Result]]:
    """Return the first items, `most` at most, and an iterator of the others.

    An error while taking the first ones is raised by that iterator.
    """
    taken: list[Result] = []
    try:
        taken.extend(islice(items, most))
    except MotionError as error:
        return taken, refuse_items(error)
    return taken, items


def refuse_items(error: MotionError) -> Iterator[Any]:
    """Return an iterator whose first item raises an error."""
    raise error
    yield


class BadValue(MotionError):
    """An invalid value.

    allowed  values that are valid there
    nearest  valid name that is nearest to the value
    key      place in the table that was read, if it is not the whole table
    """

    def __init__(
        self, message: str, *, allowed: str = "", nearest: str = "", key: tuple[str | int, ...] = ()
    ) -> None:
        self.allowed, self.nearest, self.key = allowed, nearest, key
        super().__init__(message)


@dataclass(frozen=True, slots=True)
class Fault:
    """One error in a file.

    key      dotted path (`axes.travel`, `segment[2].arc.angle`)
    line     from 1; None: not in the text
    value    value as it is written, if there is one
    allowed  values that are valid there
    nearest  nearest valid name
    """

    key: str
    message: str
    line: int | None = None
    value: Any = None
    allowed: str = ""
    nearest: str = ""


NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
# Faults that differ in numbers alone, as one cause has at every pose, up to which each is listed.
MAX_ALIKE = 5


def _mask_numbers(fault: Fault) -> str:
    return NUMBER.sub("#", f"{fault.key}: {fault.message}")


class FileError(MotionError):
    """A file that cannot be used; `faults` has all its errors, from one pass.

    The message lists each. Of many that differ in numbers alone it lists the first, and their
    number.
    """

    def __init__(self, file: str, faults: Sequence[Fault]) -> None:
        self.file = file
        self.faults = tuple(faults)
        super().__init__("\n".join(self._list_lines()))

    def _list_lines(self) -> Iterator[str]:
        groups: dict[str, list[Fault]] = {}
        for fault in self.faults:
            groups.setdefault(_mask_numbers(fault), []).append(fault)
        for fault in self.faults:
            group = groups[_mask_numbers(fault)]
            if len(group) <= MAX_ALIKE:
                yield self.describe(fault)
            elif fault is group[0]:
                line = group[-1].line
                last = "" if line is None else f", the last in line {line}"
                yield f"{self.describe(fault)} (and {len(group) - 1} more like it{last})"

    def describe(self, fault: Fault) -> str:
        """Return one line: file, line, key and message of a fault."""
        place = self.file if fault.line is None else f"{self.file}:{fault.line}"
        return (
            f"{place}: {fault.key}: {fault.message}" if fault.key else f"{place}: {fault.message}"
        )


class NotInstalled(MotionError):
    """A package required for `what` is missing.

    extra  our extra that installs it; None: it has no wheel for this platform
    """

    def __init__(
        self, what: str, package: str, extra: str | None = None, instead: str = ""
    ) -> None:
        self.package = package
        remedy = (
            "it has no wheel for this platform"
            if extra is None
            else f"pip install 'pulsepath[{extra}]' brings it"
        )
        super().__init__(
            f"{what} needs {package}, which is not installed: {remedy}{instead and f'; {instead}'}"
        )


class OutOfReach(MotionError):
    """No actuator coordinates exist for a pose (or no pose for actuator coordinates)."""


class NotFree(OutOfReach):
    """A pose that is off home in a component that its machine does not move: no scale of the others
    helps.

    pose  index of the pose in the call, from 0
    """

    def __init__(self, message: str, pose: int) -> None:
        self.pose = pose
        super().__init__(message)


@contextmanager
def locate_errors(where: str) -> Iterator[None]:
    """Add a place to the message of an error that is raised inside: "option --speed: …"."""
    try:
        yield
    except BadValue as error:
        located = BadValue(f"{where}: {error}", allowed=error.allowed, nearest=error.nearest)
        raise located.in_segment(error.segment) from None
    except MotionError as error:
        raise MotionError(f"{where}: {error}").in_segment(error.segment) from None


@contextmanager
def as_validation_error() -> Iterator[None]:
    """Convert an error that is raised inside to one that pydantic collects."""
    try:
        yield
    except MotionError as error:
        raise validation_error(error) from None


def validation_error(reason: str | MotionError, kind: str = "fault") -> PydanticCustomError:
    """Return the error for a validator to raise.

    The fault of the file gets its message and facts.
    """
    facts = {"message": str(reason)}
    if isinstance(reason, BadValue):
        facts |= {"allowed": reason.allowed, "nearest": reason.nearest}
    return PydanticCustomError(kind, "{message}", facts)
