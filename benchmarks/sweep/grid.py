"""A grid of runs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

from benchmarks.sweep.cell import VARIATIONS, Cell, Setting, Variation


@dataclass(frozen=True, slots=True)
class Grid:
    """Every setting on every task, on every variation of the rig, for every seed; what is named twice is run once."""

    settings: tuple[Setting, ...]
    tasks: tuple[str, ...]
    variations: tuple[Variation, ...] = VARIATIONS
    seeds: tuple[int, ...] = (0,)

    def __iter__(self) -> Iterator[Cell]:
        every = (self.settings, self.tasks, self.variations, self.seeds)
        for setting, task, variation, seed in product(*(dict.fromkeys(one) for one in every)):
            yield Cell(setting, task, variation, seed)  # type: ignore[arg-type]
