"""What comes with this package, as plain data: programs, rigs and laws; what each is, its own file says."""

import tomllib
from functools import partial
from inspect import getdoc
from typing import Any

from controllers.laws.registry import LAWS
from kinematics.foundation.names import presets

Record = dict[str, Any]


def programs() -> list[Record]:
    """Each program with its machine and the number of its segments."""
    return [
        {"name": name, "machine": data.get("machine"), "segments": len(data["segment"]), "about": about}
        for name, data, about in _read_presets("planner")
    ]


def rigs() -> list[Record]:
    """Each rig with its machine and the names of its tasks."""
    return [
        {
            "name": name,
            "machine": data["machine"],
            "tasks": list(dict.fromkeys(task["name"] for task in data.get("task", []))),
            "about": about,
        }
        for name, data, about in _read_presets("controllers")
    ]


def laws() -> list[Record]:
    """Each law by number and by name, with the gains that `compare` tries."""
    found = []
    for (number, name), make in LAWS.items():
        told = getdoc(make.func if isinstance(make, partial) else make) or ""
        own = make.keywords if isinstance(make, partial) else {}
        about = told.splitlines()[0] + "".join(f" ({key}: {value})" for key, value in own.items())
        gains = {gain: [float(value) for value in values] for gain, values in make().grid.items()}
        found.append({"number": number, "name": name, "gains": gains, "about": about})
    return found


def _read_presets(package: str) -> list[tuple[str, Record, str]]:
    """Name, data and the first sentence of each preset of a package."""
    texts = {name: file.read_text(encoding="utf-8") for name, file in presets(package).items()}
    return [(name, tomllib.loads(text), _sentence(text)) for name, text in texts.items()]


def _sentence(text: str) -> str:
    """The first of a comment at the head of a file."""
    lines: list[str] = []
    for line in text.splitlines():
        if not line.startswith("# "):
            break
        lines.append(line[2:])
    first, stop, _ = " ".join(lines).partition(". ")
    return first.rstrip(".") + (stop.strip() or ".")
