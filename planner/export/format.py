"""The plug point of the export formats: what a format takes, its options, and what it reports; and
the formats by name.

Each is one line of `FORMATS`, loaded when it is asked for.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar, Protocol

import numpy as np

from kinematics.files.atomic_files import Destination, require_folder
from kinematics.foundation.errors import MotionError
from kinematics.foundation.options import load_plugin, make_with
from kinematics.machine.machine import Machine
from planner.export.trigger_lines import describe_lost
from planner.parallel import Progress, ignore_progress
from planner.pulses.compensation.compensate import counted_motion
from planner.pulses.generation.sent import SentPulses
from planner.pulses.motion import AxesMotion
from planner.pulses.schedule import PulseSchedule
from planner.pulses.triggers import Triggered
from planner.trajectory import Trajectory

PHASE_ROUNDING = 1e-9
"""s that count as none between the rows of two files."""


@dataclass(frozen=True, slots=True)
class ExportSource:
    """A certified motion of a machine and its checked pulses, to be exported.

    name      of the program, for formats that state one
    tell      receives how much is written, and of how much, from formats that write in parts
    made      the motion after shaping and compensation, where it is known; None: it is made here
    since     s of the motion sent before, at which this one continues it; None: it begins at rest
    sent      the last pulses of the motion sent before
    triggers  of the program, at times from the start of this motion
    counted   the motion for a controller of the axes: that of the motors for axes that compensate
    """

    name: str
    machine: Machine
    trajectory: Trajectory
    pulses: PulseSchedule
    tell: Progress = ignore_progress
    made: AxesMotion | None = field(default=None, repr=False)
    since: float | None = None
    sent: tuple[SentPulses, ...] = ()
    triggers: tuple[Triggered, ...] = ()
    counted: AxesMotion = field(init=False, repr=False)

    def __post_init__(self) -> None:
        counted = self.made or counted_motion(
            self.trajectory, self.machine.axes, self.machine.home_q
        )
        object.__setattr__(self, "counted", counted)

    @property
    def goes_on(self) -> bool:
        """Whether it begins in the midst of a motion that was sent before."""
        return self.since is not None

    def describe_phase(self, period: float) -> tuple[str, ...]:
        """What is to be known of rows at a period (s) that go on with others, which began with that
        motion.
        """
        late = 0.0 if self.since is None else self.since - period * round(self.since / period)
        if abs(late) <= PHASE_ROUNDING:
            return ()
        rows = f"{1e3 * abs(late):.6g} ms {'behind' if late > 0 else 'ahead of'} those of the motion before it"
        return (
            f"its rows are {rows}: make the instant a multiple of {1e3 * period:.6g} ms to go on in step with it",
        )


@dataclass(frozen=True, slots=True)
class Exported:
    """What a file holds of the motion, found by decoding it as its consumer would.

    error    pulses, the largest by which any axis of the decoded file is from what was exported
    against  what it is measured against, and how, in words: "the pulses, edge by edge"
    notes    what its user has to know: a spacing that was chosen, what the format cannot hold
    moves    how many pulses, calls, lines or segments of the decoded file move an axis
    by_axis  pulses by which each axis is off at most: 0 for one that does not move
    """

    error: float
    against: str
    notes: tuple[str, ...] = ()
    moves: int | None = None
    by_axis: tuple[float, ...] = ()


def export(format_: "Format", name: str, source: ExportSource, path: Path) -> Exported:
    """Write a file in a format called `name`.

    Return the error of its decoded contents against the plan, and notes.

    Triggers are named in a warning if the format does not hold them. Raises MotionError for
    contents of another motion, or of no motion where the plan moves; else as the format does.
    """
    done = format_.write(source, path)
    if not done.error < np.inf:
        raise MotionError(
            f"format {name}: the written file decodes to another motion than the plan's, against {done.against}; "
            "the file was discarded: report this, and use another format"
        )
    if done.moves == 0 and is_moving(source):
        few = "stays within half a pulse of its start: use a shorter pulse, or a longer motion"
        told = (
            few if not source.pulses.total else "cannot be expressed in it: choose another format"
        )
        raise MotionError(
            f"format {name}: the file would hold no move, and the plan's motion {told}"
        )
    lost = () if holds_triggers(type(format_)) else describe_lost(source.triggers)
    by_axis = done.by_axis or tuple(done.error if len(axis) else 0.0 for axis in source.pulses.axes)
    return replace(done, notes=(*done.notes, *lost), by_axis=by_axis)


def is_moving(source: ExportSource) -> bool:
    """Return whether the motion must move an axis in a file.

    A stop just before a rest may be too short for a pulse.
    """
    if source.pulses.total > 0:
        return True
    return not source.goes_on and bool(np.ptp(source.trajectory.path.breaks) > 0)


def refuse_compensated(source: ExportSource, format_: str) -> None:
    """Raise MotionError for axes that compensate, in a format whose controller makes its own way
    from stop to stop.
    """
    for axis in source.machine.axes:
        if axis.compensate:
            raise MotionError(
                f"{format_}: axis {axis.name} compensates {' and '.join(axis.compensate)} along the motion, which its "
                "controller does not follow; take compensate out of the machine's file"
            )
    refuse_shaped(source, format_)


def refuse_shaped(source: ExportSource, format_: str) -> None:
    """Raise MotionError for axes with input shapers, in a format that is made from the path."""
    for axis in source.machine.axes:
        if axis.shaper:
            raise MotionError(
                f"{format_}: axis {axis.name} has an input shaper ({axis.shaper}), and this format follows the path "
                "before it; take a format of pulses or of positions over time, or take shaper out of the machine's file"
            )


class Format(Protocol):
    """A file format: a frozen dataclass whose fields, made by `option`, are its options.

    The first line of its docstring is what the command's help says of it; the rest states units,
    line ends and limits. One that starts and ends at rest, so that it cannot hold a stop, which
    begins in motion, states `from_rest`: what messages call it. One that writes the source's
    triggers states `triggered = True`; for others a warning names them.
    """

    suffix: ClassVar[str]

    def write(self, source: ExportSource, path: Path, /) -> Exported:
        """Write the file.

        Raises MotionError, before anything is written where it can, for what it cannot hold.
        """


FORMATS = {
    "pulses": "planner.export.formats.pulse_csv:PulseCsv",
    "vcd": "planner.export.formats.vcd:Vcd",
    "steps": "planner.export.formats.steps:Steps",
    "npz": "planner.export.formats.npz:Npz",
    "binary": "planner.export.formats.binary:Binary",
    "zaber": "planner.export.formats.pvt:ZaberCsv",
    "xps": "planner.export.formats.pvt:Xps",
    "pmac": "planner.export.formats.pvt:Pmac",
    "g93": "planner.export.formats.g93:InverseTime",
    "ros": "planner.export.formats.ros:JointTrajectory",
    "halstreamer": "planner.export.formats.halstreamer:Halstreamer",
    "csp": "planner.export.formats.csp:CyclicPosition",
    "galil": "planner.export.formats.galil:Galil",
    "adlink": "planner.export.formats.adlink:AdlinkC",
    "adlink-csv": "planner.export.formats.adlink:AdlinkCsv",
    "kmitl-arms": "planner.export.formats.kmitl:KmitlArms",
    "kmitl-positions": "planner.export.formats.kmitl:KmitlPositions",
    "byte": "planner.export.formats.kmitl:KmitlByte",
    "sahbaz": "planner.export.formats.sahbaz:Sahbaz",
    "sasidhar": "planner.export.formats.sasidhar:Sasidhar",
}
"""Module and class by the name that the command line knows."""


def takes_stop(kind: type[Format]) -> bool:
    """Whether a format can hold a stop, which begins in motion."""
    return not getattr(kind, "from_rest", "")


def holds_triggers(kind: type[Format]) -> bool:
    """Return True for formats whose files hold the triggers of a program."""
    return bool(getattr(kind, "triggered", False))


def find_format(name: str) -> type[Format]:
    """The format of a name.

    Raises MotionError for an unknown one, with the nearest and all known ones.
    """
    found: type[Format] = load_plugin("format", FORMATS, name)
    return found


def write_export(
    source: ExportSource,
    name: str,
    path: str | PathLike[str],
    force: bool,
    options: Mapping[str, Any],
) -> Exported:
    """What `Plan.export` does; the file is there whole or not at all."""
    place = Path(path)
    require_folder(f"export {place}", place)
    target = Destination(
        place, force=force, remedy="give force=True to replace it, or another path"
    )
    return write_export_to(target, source, name, options)


def write_export_to(
    destination: Destination, source: ExportSource, name: str, options: Mapping[str, Any]
) -> Exported:
    """Write a file in the format called `name`, whole or not at all.

    Raises as `export` and `Destination.stage`.
    """
    format_ = make_with(find_format(name), f"format {name}", options)
    with destination.stage() as file:
        return export(format_, name, source, file)
