"""What is wrong with a file, gathered in one pass and bounded: a reader adds, and in the end refuses."""

from kinematics.errors import Fault, FileError

MOST = 100
"""Faults that are told; a file with more is another format as a rule, or broken."""


class Faults:
    """The faults of a file, in the order in which they are found."""

    def __init__(self, file: str) -> None:
        self.file = file
        self._found: list[Fault] = []

    def add(self, message: str, line: int | None = None, key: str = "") -> None:
        """One fault; key says where on its line, or in which entity. Raises FileError where there are too many."""
        self._found.append(Fault(key, message, line))
        if len(self._found) == MOST:
            told = Fault("", f"{MOST} faults, and what follows is not looked at", line)
            raise FileError(self.file, [*self._found, told])

    def __bool__(self) -> bool:
        return bool(self._found)

    def refuse(self) -> None:
        """Raise FileError if there is any."""
        if self._found:
            raise FileError(self.file, self._found)
