"""Machines by name, and what every table of names shares: bundled presets, and the nearest name to
a mistaken one.
"""

from collections.abc import Iterable
from difflib import get_close_matches
from importlib.resources import files
from importlib.resources.abc import Traversable
from os import PathLike, fspath
from pathlib import Path

from kinematics.foundation.errors import BadValue, MotionError


def presets(package: str) -> dict[str, Traversable]:
    """The TOML files in a package's folder `presets`, by name."""
    entries = (files(package) / "presets").iterdir()
    return {
        e.name.removesuffix(".toml"): e
        for e in sorted(entries, key=lambda e: e.name)
        if e.name.endswith(".toml")
    }


def find(package: str, what: str, name_or_path: str | PathLike[str]) -> Path | Traversable:
    """Where a preset or a file is: a plain word is a preset's name, anything with a folder or
    suffix a file's path.
    """
    if not isinstance(name_or_path, str | PathLike):
        raise MotionError(
            f"{add_article(what)} is given by its name or the path of a file, or as it is, not as {name_or_path!r:.80}"
        )
    path = Path(name_or_path)
    name = fspath(name_or_path)
    if isinstance(name_or_path, PathLike) or path.suffix or path.name != name:
        if name in presets(package) and not path.exists():
            raise MotionError(
                f'no such file: {name}; the bundled {what} is given as a text, "{name}"'
            )
        return path
    known = presets(package)
    if name not in known:
        raise BadValue(
            f'no {what} is called "{name}"{nearest(name, known)}; bundled: {", ".join(known)}; '
            f"or give the path of a file, e.g. {_suggest_file(what, name)}",
            allowed=", ".join(known),
            nearest=closest(name, known),
        )
    return known[name]


def _suggest_file(what: str, name: str) -> str:
    """Return the path of a file that may be meant: one in the folder of this name, as `pulsepath
    init` writes it.
    """
    inside = sorted(Path(name).glob(f"*{what}.toml")) if name else []
    return str(inside[0]) if inside else f"{name or what}.toml"


def source_folder(package: str, source: Path | Traversable) -> Path | Traversable:
    """The folder of what `find` found, where the files are that it names."""
    return source.parent if isinstance(source, Path) else files(package) / "presets"


def unknown_name(what: str, name: str, known: Iterable[str]) -> BadValue:
    """The refusal of a name that is in no table of these names, to be raised."""
    known = tuple(known)
    return BadValue(
        f'no {what} is called "{name}"{nearest(name, known)}; {what}s: {", ".join(known)}',
        allowed=", ".join(known),
        nearest=closest(name, known),
    )


def add_article(noun: str) -> str:
    """A noun as a sentence has it: "a hexapod", "an arm", and of a plural "a set of equations"."""
    if noun.endswith("s") and not noun.endswith(("ss", "is")):
        return f"a set of {noun}"
    return f"{'an' if noun[:1].lower() in 'aeiou' else 'a'} {noun}"


def count_noun(count: float, noun: str, form: str = "") -> str:
    """A number, in a form, and its noun: "1 pulse", "0 pulses", "2 axes", "3 entries", "4
    stretches", "0.5 pulses".
    """
    shown = f"{count:{form}}"
    if shown == "1":
        return f"1 {noun}"
    if noun.endswith("axis"):
        return f"{shown} {noun[:-2]}es"
    if noun.endswith(("ch", "sh", "x")):
        return f"{shown} {noun}es"
    return f"{shown} {noun[:-1]}ies" if noun.endswith(("ry", "ty")) else f"{shown} {noun}s"


def nearest(name: str, choices: Iterable[str]) -> str:
    """The clause that names the choice nearest to a mistaken name, empty if none comes close."""
    found = closest(name, choices)
    return f', nearest is "{found}"' if found else ""


def closest(name: str, choices: Iterable[str]) -> str:
    """The choice nearest to a mistaken name, empty if none comes close."""
    choices = tuple(choices)
    lower = {choice.lower(): choice for choice in reversed(choices)}
    matches = get_close_matches(name, choices, 1) or [
        lower[match] for match in get_close_matches(name.lower(), lower, 1)
    ]
    return matches[0] if matches else ""
