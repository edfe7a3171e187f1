"""Words of G-code that may be left out, since the path is the same without them."""

SILENT = frozenset("STHD")
"""Speed of the spindle, tool, and the numbers of its offsets: letters that may be left out with any number."""
SILENT_G = frozenset({40.0, 43.0, 49.0, *map(float, range(54, 60)), 80.0, 97.0, 98.0, 99.0})
"""Offsets of tool and work, and modes of cycles and spindles; none is a path by itself."""
LOUD_M = frozenset({2.0, 30.0, *map(float, range(96, 100))})
"""Ends and calls of programs."""


def ignored(letter: str, value: float, words: frozenset[str]) -> str | None:
    """The word, M3 or S as `words` has it, if it is to be left out."""
    word = f"{letter}{value:g}"
    if word in words and ignorable(word):
        return word
    return letter if letter in words and _silent(letter, value) else None


def ignorable(word: str) -> bool:
    """Whether a word without leading zeros, or all of a letter, may be left out."""
    letter, number = word[:1], word[1:]
    if not number:
        return letter in SILENT or letter == "M"
    try:
        return _silent(letter, float(number))
    except ValueError:
        return False


def _silent(letter: str, value: float) -> bool:
    if letter == "G":
        return value in SILENT_G
    return letter in SILENT or (letter == "M" and value not in LOUD_M)


class Offsets:
    """What words that are left out say of the coordinates: one offset of the work and one of the tool, or none.

    A program that moves under two of a kind is another path without them: what holds when it moves is compared with
    what held before. Where it has said nothing yet, any is as good.
    """

    def __init__(self) -> None:
        self._said: dict[str, str] = {}
        self._moved: dict[str, str] = {}
        self._tool = self._loaded = ""

    def block(self, left_out: list[tuple[str, float]]) -> None:
        """The words of a block that are left out, letters and numbers."""
        number = {letter: value for letter, value in left_out if letter != "G" and letter != "M"}
        self._tool = f"T{number['T']:g}" if "T" in number else self._tool
        if ("M", 6.0) in left_out:
            self._loaded = self._tool
        for letter, value in left_out:
            if letter == "G" and 54 <= value <= 59:
                self._said["work"] = f"G{value:g}"
            elif letter == "G" and value == 49:
                self._said["tool"] = "G49"
            elif letter == "G" and value == 43:
                self._said["tool"] = f"G43 H{number['H']:g}" if "H" in number else f"G43 {self._loaded}".strip()

    def changed(self) -> tuple[str, str] | None:
        """Two offsets, the one under which it moved and the one under which it moves now, if they are not the same."""
        for kind, now in self._said.items():
            if self._moved.setdefault(kind, now) != now:
                return self._moved[kind], now
        return None
