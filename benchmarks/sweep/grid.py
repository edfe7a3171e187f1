"""A grid of runs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from benchmarks.sweep.cell import VARIATIONS, Cell, Setting, Variation


@dataclass(frozen=True, slots=True)
class Grid:
    """Every setting on every task, on every variation of the rig, for every seed; what is named twice is run once."""

    settings: tuple[Setting, ...]
    tasks: tuple[str, ...]
    variations: tuple[Variation, ...] = VARIATIONS
    seeds: tuple[int, ...] = (0,)

    def __iter__(self) -> Iterator[Cell]:
        return (
            Cell(setting, task, variation, seed)
            for setting in dict.fromkeys(self.settings)
            for task in dict.fromkeys(self.tasks)
            for variation in dict.fromkeys(self.variations)
            for seed in dict.fromkeys(self.seeds)
        )
