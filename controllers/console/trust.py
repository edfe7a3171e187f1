"""Whether a link that anything may have opened speaks the console's language: a web page's POST shall move nothing."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from controllers.console.grammar import Misread, remote
from controllers.console.lines import Line

MISREAD = 3
"""Lines in a row that are no commands, from the first on, after which a link is shut: HTTP has more before its body."""
HTTP = re.compile(r"\s*[A-Z]+ +\S+ +HTTP/", re.ASCII | re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Trust:
    """What a link's lines have shown so far.

    known    whether one of them was a command: a computer that knows them may err as often as it likes
    misread  how many were none before that
    shut     why the link is to be closed; "": it is not
    """

    known: bool = False
    misread: int = 0
    shut: str = ""

    def after(self, line: Line, names: Sequence[str]) -> Trust:
        """With a line; names: of the axes, in capitals."""
        if self.known or self.shut:
            return self
        if not self.misread and HTTP.match(line.text):
            return replace(self, shut="this line speaks no HTTP")
        try:
            if not line.fault:
                remote(line.text, names)
                return replace(self, known=True)
        except Misread:
            pass
        misread = self.misread + 1
        return replace(self, misread=misread, shut=f"{misread} lines were no commands" if misread >= MISREAD else "")
