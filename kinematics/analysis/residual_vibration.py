"""What input shapers leave of the vibrations that they are for, by the residual of their
impulses.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from kinematics.foundation.table import Column, Table
from kinematics.machine.axis import Axis
from kinematics.machine.shaper import Shaper

BESIDE = 0.1
"""Share of the stated frequency, below and above, at which the residual is told as well."""


@dataclass(frozen=True, slots=True)
class Residual:
    """What is left of one vibration, as a share of the unshaped, behind all shapers of the axes
    that have this one.

    mode                    its frequency and damping, as the shaper states them
    axes                    names
    below, stated, above    at (1 − BESIDE) f, f and (1 + BESIDE) f: V of [Singer and Seering 1990]
    """

    mode: Shaper
    axes: tuple[str, ...]
    below: float
    stated: float
    above: float

    def describe(self) -> str:
        """In a line."""
        f, beside = self.mode.frequency, sorted((self.below, self.above))
        shares = " to ".join(dict.fromkeys(f"{100 * each:.1f}" for each in beside))
        return (
            f"{self.mode}: {100 * self.stated:.1f} % at {f:g} Hz, {shares} % at ±{100 * BESIDE:g} %"
        )


def find_residuals(axes: Sequence[Axis]) -> tuple[Residual, ...]:
    """Of each vibration that an axis is shaped against; axes with the same shapers together."""
    alike: dict[object, list[Axis]] = {}
    for axis in axes:
        if axis.shaper is not None:
            alike.setdefault(axis.shaper, []).append(axis)
    found = []
    for group in alike.values():
        shaper, names = group[0].shaper, tuple(axis.name for axis in group)
        assert shaper is not None  # as they were chosen
        for mode in shaper.parts:
            left = [
                shaper.vibration(share * mode.frequency, mode.damping)
                for share in (1 - BESIDE, 1.0, 1 + BESIDE)
            ]
            found.append(Residual(mode, names, *left))
    return tuple(found)


def tabulate_residuals(residuals: Sequence[Residual]) -> Table:
    """A row for each."""
    columns = (
        Column("shaper", [str(each.mode) for each in residuals]),
        Column("axes", [", ".join(each.axes) for each in residuals]),
        Column(
            f"{100 - 100 * BESIDE:g} % of f",
            [100 * each.below for each in residuals],
            "%",
            form=".1f",
        ),
        Column("at f", [100 * each.stated for each in residuals], "%", form=".1f"),
        Column(
            f"{100 + 100 * BESIDE:g} % of f",
            [100 * each.above for each in residuals],
            "%",
            form=".1f",
        ),
    )
    return Table("vibration left behind the input shapers, of the unshaped", columns)
