"""What one run of a sweep is made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from controllers.laws.law import Law
from controllers.laws.registry import LAWS, find_law
from controllers.rig import Rig
from kinematics.foundation.arrays import finite_array
from kinematics.foundation.errors import MotionError
from planner.options import split_options


@dataclass(frozen=True, slots=True)
class Setting:
    """A law by its name, and values for all of its gains."""

    law: str
    gains: tuple[tuple[str, float], ...] = ()

    @property
    def text(self) -> str:
        """As `read_setting` reads it: "closed-position:gain=0.7"."""
        return self.law + "".join(f"{',' if n else ':'}{name}={value!r}" for n, (name, value) in enumerate(self.gains))

    @property
    def label(self) -> str:
        """For tables and figures: "closed-position gain 0.7"."""
        return " ".join([self.law, *(f"{name.replace('_', ' ')} {value:g}" for name, value in self.gains)])

    def made(self, rig: Rig | None = None) -> Law:
        """The law itself; a law by model knows the axes of the rig, or those that it assumes where none is given."""
        return find_law(self.law, rig, **dict(self.gains))


def read_setting(text: str) -> Setting:
    """The setting of "closed-position", "6" or "6:gain=0.7"; a gain that is not given has the law's own value.

    Raises MotionError for an unknown law or gain, and for a value that the law refuses.
    """
    name, given = split_options(text, "law")
    values = {}
    for gain, value in given.items():
        try:
            values[gain] = float(finite_array(float(value), f"law {name}: {gain}", ()))
        except ValueError:
            raise MotionError(f'law {name}: {gain}: "{value}" is not a number') from None
    law = find_law(name, None, **values)
    return Setting(_full_name(name), tuple((gain, float(getattr(law, gain))) for gain in law.grid))


def settings_of(name: str) -> list[Setting]:
    """A law over the grid of gains that it states for reports."""
    grid = find_law(name).grid
    return [Setting(_full_name(name), tuple(zip(grid, values, strict=True))) for values in product(*grid.values())]


def _full_name(name: str) -> str:
    return next(known[-1] for known in LAWS if name in known)


def batch_law(settings: Sequence[Setting], rig: Rig) -> Law:
    """One law whose gains are arrays (B, 1), of B settings of the same law; the rig as stated is what it knows of."""
    values = {gain: np.array([[dict(setting.gains)[gain]] for setting in settings]) for gain, _ in settings[0].gains}
    return find_law(settings[0].law, rig, **values)


@dataclass(frozen=True, slots=True)
class Variation:
    """How a rig differs from what its file states: factors of the inertia and of all friction."""

    name: str
    inertia: float = 1.0
    friction: float = 1.0


NOMINAL = Variation("as stated")
VARIATIONS = (
    NOMINAL,
    Variation("inertia +30 %", inertia=1.3),
    Variation("inertia −30 %", inertia=0.7),
    Variation("friction +30 %", friction=1.3),
    Variation("friction −30 %", friction=0.7),
)
"""The rig as stated, and the rigs that gains must hold on too."""


@dataclass(frozen=True, slots=True)
class Cell:
    """One run. seed: added to that of the rig's host, whose timing is drawn by chance where it sleeps."""

    setting: Setting
    task: str
    variation: Variation = NOMINAL
    seed: int = 0
