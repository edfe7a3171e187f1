"""CiA 402 cyclic synchronous position for EtherCAT drives: a row per cycle, in whole increments.

    # pulsepath "circle": cyclic synchronous position (CiA 402, mode 8), a row every 1 ms; set
    0x60C2 to it; 0x607A in
      increments, 0x60B1 in increments/s, 0x60B2 in 0.1 % of the rated torque     (of the same line)
    # axis 0 = "leg1": starts at 0, second difference at most 12 increments
    cycle,0x607A:0,0x60B1:0,0x60B2:0
    0,0,0,118
    1,2,1500,121

- 0x607A target position, increments of the axis' wiring from home; 0x60B1 velocity offset,
  increments/s: of the motion at that instant, 0 in the first and last row; 0x60B2 torque offset,
  0.1 % of the rated torque, where `rated` tells what that is at the axis and the machine states its
  masses.
- A row is q(k T) rounded, so no rounding adds up: it is off by half an increment at most. The last
  row is the end of the motion, or the cycle after it.
- An axis that keeps |q̈| <= A has second differences of at most A T² and 2 increments that rounding
  may add: q((k+1)T) - 2 q(kT) + q((k-1)T) is T² times a mean of q̈. What a drive adds between rows
  is at most A T²/8 and half an increment if it goes straight, A T²/4 and 0.625 increments if it
  goes along the parabola of a row, the one before and the one after (a chord and a second
  difference that is weighed with u (1 - u)/2).
- The columns of an axis stand together, axes in the machine's order. ASCII, line ends \\n, names
  with JSON's escapes.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from kinematics.analysis.dynamics import forces
from kinematics.foundation.arrays import Array, finite_array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from kinematics.foundation.options import option
from kinematics.machine.axis import directional_bounds
from planner.export.columns import Columns, line_blocks, make_columns
from planner.export.format import Exported, ExportSource, refuse_shaped
from planner.export.knots import (
    CHECK_PROBES,
    Knots,
    choose_knots,
    compare,
    refuse_moving_ends,
    steps_to_seconds,
)
from planner.export.trigger_lines import ALL, MAX_LINES
from planner.pulses.triggers import Triggered

SHORTEST_CYCLE, LONGEST_CYCLE = 0.25e-3, 4e-3
"""s"""
ROUNDING = 1e-9
"""Share by which a cycle that is meant to be one of these may differ."""
OBJECTS = {
    "0x607A": ("target position", "increments", 32),
    "0x60B1": ("velocity offset", "increments/s", 32),
    "0x60B2": ("torque offset", "0.1 % of the rated torque", 16),
}
"""What the columns are called, their units, and the bits of each object with its sign."""
PER_MILLE = 1000
ROUNDED_DIFFERENCE, ROUNDED_CHORD, ROUNDED_PARABOLA = 2.0, 0.5, 0.625
"""Increments that rounding adds: half of one times the sum of the weights' magnitudes, 4, 1 and
1.25.
"""

Whole = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class CyclicPosition:
    """EtherCAT (CiA 402) cyclic synchronous position: increments, velocity and torque offsets, a
    row per cycle.
    """

    suffix: ClassVar[str] = ".csv"
    triggered: ClassVar[bool] = True
    cycle: float = option(
        1e-3, "cycle time of the fieldbus, 0.25 to 4 ms. Default 1 ms", "s", like="1 ms"
    )
    increments: int = option(1, "increments of the drive per pulse of the machine. Default 1")
    rated: str | None = option(
        None,
        "N or N m at the axis at the motor's rated torque, one number or one per axis: adds torque offsets",
    )

    def write(self, source: ExportSource, path: Path) -> Exported:
        axes, motion = source.machine.axes, source.counted
        each = self._find_cycle()
        if self.increments < 1:
            raise MotionError(f"increments {self.increments} per pulse: must be 1 or more")
        rated = self._find_rated(source)
        if not source.goes_on:  # a stop is sent behind the rows before it
            refuse_moving_ends(motion, axes, "cyclic synchronous position")
        knots = choose_knots(motion, axes, 1, step=each, tolerance=None, spacing=each)
        form = replace(make_columns(source, None, unit="counts"), decimals=0)
        form = replace(form, factor=form.factor * self.increments)
        kinds = tuple(OBJECTS)[: 2 if rated is None else 3]
        allowed = self._bound_differences(source)
        marks = _find_rows(source.triggers, each, int(knots.steps[-1]))
        with path.open("w", encoding="ascii", newline="") as file:
            file.write(
                f"# pulsepath {json.dumps(source.name)}: cyclic synchronous position (CiA 402, mode 8), "
            )
            units_of_kinds = ", ".join(f"{kind} in {OBJECTS[kind][1]}" for kind in kinds)
            file.write(f"a row every {1e3 * each:.6g} ms; set 0x60C2 to it; {units_of_kinds}\n")
            start = next(iter(form.blocks(source, knots, 1)))[1][0, 0]
            for k, axis in enumerate(axes):
                most = (
                    ""
                    if np.isinf(allowed[k])
                    else f", second difference at most {_floor(allowed[k])} increments"
                )
                file.write(
                    f"# axis {k} = {json.dumps(axis.name)}: starts at {start[k]:.0f}{most}\n"
                )
            for k, name in enumerate(marks):
                file.write(f"# trigger {k} = {json.dumps(name)}\n")
            columns = [f"{kind}:{k}" for k in range(len(axes)) for kind in kinds]
            columns += [f"trigger:{k}" for k in range(len(marks))]
            file.write(",".join(["cycle", *columns]) + "\n")
            first = 0
            for _, units in form.blocks(source, knots, 2, rest=not source.goes_on):
                nth = np.arange(first, first + units.shape[1])
                parts = [*units]
                if rated is not None:
                    parts.append(_find_torques(source, steps_to_seconds(nth, each), rated))
                _refuse_large(source, kinds, parts, nth, each)
                table = np.stack(parts, 2).reshape(len(nth), -1).astype(np.int64)
                counts = [
                    np.bincount(rows, minlength=first + len(nth))[first : nth[-1] + 1]
                    for rows in marks.values()
                ]
                table = np.column_stack([table, *counts])
                file.writelines(
                    f"{k},{','.join(map(str, row))}\n"
                    for k, row in zip(nth, table.tolist(), strict=True)
                )
                first += len(nth)
        layout = Layout(len(axes), len(kinds), marks)
        return self._compare(source, form, knots, path, layout, allowed)

    def _find_cycle(self) -> float:
        each = float(finite_array(self.cycle, "cycle", (), unit="s"))
        if not SHORTEST_CYCLE * (1 - ROUNDING) <= each <= LONGEST_CYCLE * (1 + ROUNDING):
            raise MotionError(
                f"cycle {1e3 * each:.6g} ms: must be from {1e3 * SHORTEST_CYCLE:g} to {1e3 * LONGEST_CYCLE:g} ms; "
                "give that of your fieldbus"
            )
        return each

    def _find_rated(self, source: ExportSource) -> Array | None:
        """(n,) N or N·m."""
        if self.rated is None:
            return None
        machine, n = source.machine, len(source.machine.axes)
        try:
            given = np.array([float(word) for word in self.rated.split(",")])
        except ValueError:
            given = np.empty(0)
        if len(given) not in (1, n) or not (np.isfinite(given) & (given > 0)).all():
            raise MotionError(
                f'rated "{self.rated}": give one number above 0 in N or N m, or {n} with commas between'
            )
        if not machine.loaded:
            raise MotionError(
                f"machine {machine.name}: it states no masses, friction or wrench, so there are no torques to offset; "
                "state them in the machine's file, or leave rated out"
            )
        return np.broadcast_to(given, (n,))

    def _bound_differences(self, source: ExportSource) -> Array:
        """(n,) increments: what the limits allow a second difference to be; ∞ where none follows
        from them.
        """
        axes = source.machine.axes
        most = [
            np.inf if axis.compensate else max(directional_bounds(axis.max_acceleration))
            for axis in axes
        ]
        per_meter = np.array([self.increments / axis.pulse for axis in axes])
        return np.asarray(np.array(most) * self.cycle**2 * per_meter + ROUNDED_DIFFERENCE)

    def _compare(
        self,
        source: ExportSource,
        form: Columns,
        knots: Knots,
        path: Path,
        layout: "Layout",
        allowed: Array,
    ) -> Exported:
        axes = source.machine.axes
        notes = [
            f"a row every {1e3 * knots.step:.6g} ms; {count_noun(self.increments, 'increment')} a "
            "pulse, from home, as wired"
        ]
        differences, parabola = _measure(source, form, knots, _read(path, layout))
        k = int(differences.argmax())
        limit = "" if np.isinf(allowed[k]) else f"; its limits allow {_floor(allowed[k])}"
        notes.append(
            f"second difference: at most {differences[k]:.0f} increments a cycle² (axis {axes[k].name}){limit}"
        )
        room = (allowed - ROUNDED_DIFFERENCE).max()
        if np.isfinite(room):
            notes.append(
                f"between rows, by the limits: straight within {room / 8 + ROUNDED_CHORD:.3g} increments, "
                f"along parabolas within {room / 4 + ROUNDED_PARABOLA:.3g}"
            )
        notes.append(
            f"between rows, measured along parabolas: within {parabola.max():.3g} increments"
        )
        notes += source.describe_phase(knots.step)
        if layout.marks:
            fired = sum(map(len, layout.marks.values()))
            notes.append(f"triggers: {fired}, each in the first row at or after it")
        points = (
            (
                steps_to_seconds(first + np.arange(len(rows)), knots.step),
                form.natural(rows[None].astype(float)),
            )
            for first, rows in _read(path, layout)
        )
        return compare(source.counted, axes, knots, points, tuple(notes))


def _floor(increments: float) -> int:
    """What whole numbers may be, but for the rounding of the bound."""
    return int(np.floor(increments * (1 + ROUNDING)))


def _find_torques(source: ExportSource, t: Array, rated: Array) -> Array:
    """(K, n) whole thousandths of the rated torque, in the sense of the wiring."""
    refuse_shaped(source, "csp with rated")
    state = source.trajectory.at(np.minimum(t, source.trajectory.duration))
    signs = np.array([axis.direction for axis in source.machine.axes])
    return np.rint(forces(source.machine, state).force * (signs * PER_MILLE / rated)) + 0.0


def _refuse_large(
    source: ExportSource, kinds: tuple[str, ...], parts: list[Array], nth: Whole, each: float
) -> None:
    """Raise MotionError for a number that its object does not hold."""
    for kind, numbers in zip(kinds, parts, strict=True):
        name, _, bits = OBJECTS[kind]
        row, k = np.unravel_index(int(abs(numbers).argmax()), numbers.shape)
        if abs(numbers[row, k]) >= 2 ** (bits - 1):
            remedy = (
                "a larger rated"
                if kind == "0x60B2"
                else "fewer increments per pulse, or a longer pulse"
            )
            raise MotionError(
                f"axis {source.machine.axes[k].name}: {name} {kind} of {numbers[row, k]:.0f} at "
                f"{each * nth[row]:.6g} s, limit {2 ** (bits - 1) - 1} ({bits} bits with a sign); give {remedy}"
            )


@dataclass(frozen=True, slots=True)
class Layout:
    """Columns of a file.

    axes   number of axes
    width  number of columns of each
    marks  for each column of triggers, by its name, the rows at which they fire
    """

    axes: int
    width: int
    marks: dict[str, Whole]


def _find_rows(triggers: Sequence[Triggered], each: float, last: int) -> dict[str, Whole]:
    """Return for each name the first rows at or after its triggers; all names as one if there are
    many.
    """
    together = len({event.name for event in triggers}) > MAX_LINES
    rows: dict[str, list[int]] = {}
    for event in triggers:
        row = min(int(np.ceil(event.time / each * (1 - ROUNDING))), last)
        rows.setdefault(ALL if together else event.name, []).append(row)
    return {name: np.array(numbers, np.int64) for name, numbers in rows.items()}


def _read(path: Path, layout: Layout) -> Iterator[tuple[int, Whole]]:
    """Yield the number of the first row and the positions (K, n), in blocks."""
    skip = layout.axes + len(layout.marks) + 2
    for lines in line_blocks(path, skip):
        table = np.array([line.split(",") for line in lines]).astype(np.int64)
        yield int(table[0, 0]), table[:, 1 : 1 + layout.axes * layout.width : layout.width]


def _measure(
    source: ExportSource, form: Columns, knots: Knots, blocks: Iterator[tuple[int, Whole]]
) -> tuple[Array, Array]:
    """(n,) largest second difference, and how far parabolas of three rows are from the motion, in
    increments.

    Before the first row, but that of a motion that goes on, and after the last the axes stand.
    Between probes an error e of a piece of length d grows by at most d² max|ë| / 8.
    """
    n, each, motion = len(source.machine.axes), knots.step, source.counted
    most, off = np.zeros(n), np.zeros(n)
    held = np.empty((0, n), np.int64)
    u = np.linspace(0.0, 1.0, CHECK_PROBES + 1)[:, None, None]
    for first, rows in blocks:
        held = np.concatenate([held if len(held) or source.goes_on else rows[:1], rows])
        twice = np.diff(held, 2, axis=0)
        most = np.maximum(most, abs(twice).max(0, initial=0))
        begin = first + len(rows) - len(held) + 1
        t = each * (begin + np.arange(len(twice)) + u[..., 0])
        state = motion.at(np.minimum(t, motion.duration).ravel())
        exact, bend = (part.reshape(*t.shape, n) for part in (state.q - form.zero, state.qdd))
        moving = (t < motion.duration)[..., None]
        way = held[1:-1] + u * np.diff(held[1:], axis=0) - u * (1 - u) / 2 * twice
        error = abs(way - exact * form.factor).max((0, 1), initial=0)
        second = abs(twice - bend * moving * form.factor * each**2)[1:-1].max((0, 1), initial=0)
        off = np.maximum(off, error + second / (8 * CHECK_PROBES**2))
        held = held[-2:]
    last = abs(np.diff(held, axis=0)).max(0, initial=0)
    return np.maximum(most, last), off
