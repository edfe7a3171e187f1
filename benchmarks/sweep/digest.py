"""What a run depends on, as one hash: the same hash, the same result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, is_dataclass, replace
from functools import cache
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from platform import python_version
from typing import Any

import numpy as np

from benchmarks.sweep.cell import Cell
from controllers.rig import Rig
from controllers.task import Task
from kinematics.errors import MotionError
from kinematics.machine import Machine
from planner.actuation import MachinePath
from planner.environment import LIBRARIES
from planner.trajectory import Trajectory

PERIOD = 1e-3
"""s between the instants at which a motion is hashed."""
PACKAGES = ("kinematics", "planner", "controllers", "benchmarks.sweep")
"""Whose source makes the results."""


def digest(cell: Cell, of: Digests) -> str:
    """SHA-256 of the cell, its rig, its task, the code, its libraries and Python, as 32 hexadecimal digits."""
    return _hash([cell, of.rig, of.tasks[cell.task], of.code, of.libraries, of.python])[:32]


class Digests:
    """The hashes that the cells on a rig share."""

    def __init__(self, rig: Rig) -> None:
        self.rig = _hash(replace(rig, tasks=()))
        self.tasks = {task.name: _hash(task) for task in rig.tasks}
        self.code = code()
        self.libraries = versions(LIBRARIES)
        self.python = python_version()

    def as_record(self) -> dict[str, Any]:
        return {"rig": self.rig, "tasks": self.tasks, "code": self.code}


@cache
def code() -> str:
    """Of the source that makes the results: another simulator, other runs."""
    found = sha256()
    for package in PACKAGES:
        pending = [files(package)]
        while pending:
            entries = sorted(pending.pop().iterdir(), key=lambda entry: entry.name)
            pending += [entry for entry in entries if entry.is_dir() and entry.name != "__pycache__"]
            for entry in entries:
                if entry.name.endswith(".py"):
                    found.update(entry.read_bytes())
    return found.hexdigest()


def versions(packages: Sequence[str]) -> dict[str, str]:
    """Of the packages that are installed, and which are not."""
    found = {}
    for package in packages:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


def _hash(value: object) -> str:
    found = sha256()
    _feed(value, found)
    return found.hexdigest()


def _feed(value: object, found: Any) -> None:
    """Types and contents, so that no two values are taken for one another."""
    match value:
        case None | bool() | int() | float() | str() | bytes():
            found.update(f"{type(value).__name__}:{value!r};".encode())
        case np.generic():
            _feed(value.item(), found)
        case np.ndarray():
            found.update(f"array:{value.dtype}{value.shape};".encode())
            found.update(np.ascontiguousarray(value).tobytes())
        case Machine():
            home = value.home.as_matrix()
            # the map from poses to axes enters by its slope here, and by the task's own poses and positions
            _feed((type(value).__name__, value.name, value.axes, home, value.home_q, value.jacobian(value.home)), found)
        case Task():
            _feed((value.name, value.dt, _motion(value.motion)), found)
        case dict():
            _feed(sorted(value.items()), found)
        case tuple() | list():
            found.update(f"{len(value)}(".encode())
            for one in value:
                _feed(one, found)
        case _ if is_dataclass(value):
            found.update(f"{type(value).__qualname__}(".encode())
            for field in fields(value):
                _feed((field.name, getattr(value, field.name)), found)
        case _:
            raise MotionError(f"sweep: {type(value).__name__} {value!r:.80} has no hash; give rigs plain data")


def _motion(motion: Any) -> list[Any]:
    t = np.append(np.arange(0.0, motion.duration, PERIOD), motion.duration)
    state = motion.at(t)
    found = [t, state.q, state.qd]
    if isinstance(motion, Trajectory) and isinstance(motion.path, MachinePath):
        found += [state.s, motion.path.pose_numbers(state.s, state.piece)]
    return found
