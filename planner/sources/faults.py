"""What is wrong with a file, gathered in one pass and bounded: a reader adds, and in the end refuses."""

from kinematics.errors import BadValue, Fault, FileError, MotionError

MOST = 100
"""Faults that are told; a file with more is another format as a rule, or broken."""


class Faults:
    """The faults of a file, in the order in which they are found."""

    def __init__(self, file: str) -> None:
        self.file = file
        self._found: list[Fault] = []

    def add(self, told: str | MotionError, line: int | None = 1, key: str = "", value: str | None = None) -> None:
        """One fault; key says where on its line, or in which entity, value what stands there.

        Raises FileError where there are too many.
        """
        known = (told.allowed, told.nearest) if isinstance(told, BadValue) else ()
        self._found.append(Fault(key, str(told), line, value, *known))
        if len(self._found) == MOST:
            last = Fault("", f"{MOST} faults, and what follows is not looked at", line)
            raise FileError(self.file, [*self._found, last])

    def __bool__(self) -> bool:
        return bool(self._found)

    def refuse(self) -> None:
        """Raise FileError if there is any, with the faults in the order of their lines."""
        if self._found:
            raise FileError(self.file, sorted(self._found, key=lambda fault: fault.line or 0))
