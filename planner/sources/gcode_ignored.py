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
