"""A grid of runs, and what they run on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING

from benchmarks.sweep.cell import VARIATIONS, Cell, Setting, Variation
from kinematics.errors import MotionError

if TYPE_CHECKING:
    from controllers.rig import Rig
    from controllers.task import Task


@dataclass(frozen=True, slots=True)
class Bench:
    """A rig and the tasks it is given."""

    name: str
    rig: Rig
    tasks: tuple[Task, ...]

    def task(self, name: str) -> Task:
        """The task of a name. Raises MotionError."""
        for task in self.tasks:
            if task.name == name:
                return task
        raise MotionError(
            f'rig {self.name} has no task "{name}"; its tasks: {", ".join(task.name for task in self.tasks)}'
        )


@dataclass(frozen=True, slots=True)
class Grid:
    """Every setting on every task, on every variation of the rig, for every seed."""

    settings: tuple[Setting, ...]
    tasks: tuple[str, ...]
    variations: tuple[Variation, ...] = VARIATIONS
    seeds: tuple[int, ...] = field(default=(0,))

    def __iter__(self) -> Iterator[Cell]:
        for setting, task, variation, seed in product(
            dict.fromkeys(self.settings), dict.fromkeys(self.tasks), self.variations, dict.fromkeys(self.seeds)
        ):
            yield Cell(setting, task, variation, seed)
