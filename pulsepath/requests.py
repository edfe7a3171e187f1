"""Requests of commands in addition to `planner.request.PlanRequest`: the inputs, and the report.

Commands import this module before anything that computes is loaded.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from planner.request import MOST_WHOLE, option

if TYPE_CHECKING:
    from pulsepath.inputs import Inputs

PROGRAMMED = "programmed"
SYNCHRONISED = "synchronised"
MACHINE_HELP = "Preset or file. Default: the machine that the program names."
# Time pieces up to which a lower bound is proved without an option that asks for it.
MOST_BOUNDED = 20_000


@dataclass(frozen=True, slots=True, kw_only=True)
class InputRequest:
    """A program and a machine as the command line names them.

    given  options of the format of the program's file
    """

    program: str
    machine: str | None = option(
        None,
        MACHINE_HELP,
        metavar="MACHINE",
        names="machines",
        files=True,
    )
    fit: float | None = option(
        None,
        'Tolerance of smooth curves fitted to the path, and of rounded corners, as "0.02 mm".',
        unit="m",
        like="0.02 mm",
        above=0.0,
        metavar="LENGTH",
    )
    motion: str = option(
        PROGRAMMED,
        "synchronised: point to point with a stop at each pose, all axes starting and stopping "
        "together; the deviation from a straight line is reported.",
        choices=(PROGRAMMED, SYNCHRONISED),
    )
    given: Mapping[str, Any] = field(default_factory=dict)

    def read(self, ready: Callable[[], object] = lambda: None) -> "Inputs":
        """Read both files. Raises as `pulsepath.inputs.read_inputs`, which explains `ready`."""
        from pulsepath.inputs import read_inputs

        origin = None
        if self.given:  # only then are the formats worth loading
            from pulsepath.format_options import find_origin

            origin = find_origin(self.program, self.given, self.fit)
        inputs = read_inputs(self.program, self.machine, self.fit, origin, ready)
        return inputs if self.motion == PROGRAMMED else _synchronise(inputs)


def _synchronise(inputs: "Inputs") -> "Inputs":
    """Replace the program by synchronised moves; print a note on each segment that goes."""
    from planner import synchronise
    from planner.program.program_writer import program_toml
    from pulsepath.progress import note

    program, left_out = synchronise(inputs.program, inputs.machine)
    for number in left_out:
        note(f"note: segment {number} ends where it starts: skipped, since no axis would move")
    about = f"The program {program.name} as synchronised moves, by --motion {SYNCHRONISED}."
    text = program_toml(program, about).encode()
    return replace(inputs, program=program, program_toml=text, origin=None, fit=None)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportRequest:
    """Results that the command `plan` adds to a plan, and how it plans."""

    figures: bool = option(
        True,
        "Draw figures in the report. Without them it keeps all text and tables and is faster.",
        opposite="no-figures",
    )
    baselines: bool | None = option(
        None,
        "Compare with every baseline timing, as a trapezoid from stop to stop, or with none, so "
        "that no time saved is printed. Default: compare with the one within the same limits.",
        opposite="no-baselines",
    )
    bound: str | None = option(
        None,
        "Effort on the lower bound, which proves how near the motion is to the fastest. auto: no "
        "longer than planning; full: until it is near; none: no bound. Default: auto; with "
        "--worth, full.",
        choices=("auto", "full", "none"),
    )
    worth: bool | None = option(
        None,
        "Also find what each limit is worth, and plan with more of the best. Default: by the quick "
        f"lower bound, up to {MOST_BOUNDED} time pieces, without planning again. --no-worth: no "
        "lower bound either, unless --bound asks.",
        opposite="no-worth",
    )
    pulses: str = option(
        "binary",
        "Pulse file: pulses.csv, one row per edge; pulses.bin, compressed; or none.",
        choices=("csv", "binary", "none"),
    )
    stops: int | None = option(
        None,
        "Also prove the earliest stop along the path from COUNT instants: stops.csv, and a figure.",
        least=1,
        metavar="COUNT",
    )
    rig: str | None = option(
        None,
        'Also track the plan on this rig, preset or file; "pulsepath rigs" lists them.',
        metavar="RIG",
        names="rigs",
        files=True,
    )
    cross_check: bool = option(
        False,
        "Also solve order 2 with toppra, and report its motion and certificate.",
    )
    stream: bool | None = option(
        None,
        "Plan part by part while PROGRAM is read, in constant memory, or as a whole, with a more "
        f"detailed report. Default: --stream above {MOST_WHOLE} segments.",
        opposite="whole",
    )
    keep_certified: bool = option(
        False,
        "With --stream: if a segment cannot be planned, keep the certified motion before it, which "
        "ends at rest. Default: all or nothing.",
    )
    cluster: str | None = option(
        None,
        "With --stream: plan the parts between stops on the workers of this Dask scheduler (its "
        "address or its --scheduler-file); the result is identical, byte for byte.",
        metavar="ADDRESS",
    )

    @property
    def examines_motion(self) -> bool:
        """True if a requested result needs the whole motion of a plan in parts in memory."""
        requests = (self.rig, self.stops, self.worth or None)
        return (
            self.cross_check or self.bound == "full" or any(each is not None for each in requests)
        )

    @property
    def bound_effort(self) -> str:
        """Effort on the lower bound: "auto", "full" or "none"."""
        if self.bound is not None:
            return self.bound
        if self.worth is None:
            return "auto"
        return "full" if self.worth else "none"
