"""From bytes to lines: whatever comes in, in whatever pieces, with a bounded memory."""

from __future__ import annotations

from dataclasses import dataclass

LONGEST = 120
"""Bytes of a line, its end left out."""
THETA = ("θ".encode(), "Θ".encode())
"""The one key of an operator that ASCII does not have; the remote line's language refuses it."""


@dataclass(frozen=True, slots=True)
class Line:
    """A line that has come to its end: its text, or else the fault for which it is not read."""

    text: str
    fault: str = ""


@dataclass(frozen=True, slots=True)
class Partial:
    """What has come of a line that has no end yet: up to one byte more than a line may have."""

    held: bytes = b""

    def fed(self, data: bytes) -> tuple[Partial, tuple[Line, ...]]:
        """With bytes that have come: lines that end among them. CR, LF and both end a line; an empty one is none."""
        *ended, rest = data.replace(b"\n", b"\r").split(b"\r")
        lines, held = [], self.held
        for part in ended:
            whole = held + part[: LONGEST + 1 - len(held)]
            held = b""
            if whole.strip(b" \t"):
                lines.append(_read(whole))
        return Partial(held + rest[: LONGEST + 1 - len(held)]), tuple(lines)

    def broken_off(self) -> tuple[Line, ...]:
        """What is left when no more comes: a fault, since a line without its end may not be all of it."""
        return (Line("", "the input ended within a line"),) if self.held.strip(b" \t") else ()


def _read(line: bytes) -> Line:
    if len(line) > LONGEST:
        return Line("", f"a line is longer than {LONGEST} characters")
    plain = line
    for key in THETA:
        plain = plain.replace(key, b"T" * len(key))
    for place, byte in enumerate(plain):
        if not (0x20 <= byte < 0x7F or byte == 0x09):
            return Line("", f"byte 0x{byte:02X} at {place + 1} of a line is no character of a command")
    return Line(line.decode())
