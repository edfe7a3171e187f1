"""`pulsepath positions`: show and edit a position list."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from planner.request import option
from pulsepath.command_group import Commands
from pulsepath.commands.common import FIGURE_SUFFIXES, print_result, refuse_suffix
from pulsepath.options import ALLOW_MINUS, json_option, read_quantity
from pulsepath.request_options import with_request

if TYPE_CHECKING:
    from kinematics.files.atomic_files import Destination
    from planner.sources.position_list import PositionList

# Suffixes of a saved simulation of the arms.
SIMULATED = (".csv", ".json", *FIGURE_SUFFIXES)
TRIPOD = "tripod"


@dataclass(frozen=True, slots=True)
class ListFile:
    """A position list of a command.

    destination  the file as it was when the command began
    bundled      True for a list of this package, which stays unchanged
    """

    path: Path
    as_json: bool
    destination: "Destination"
    bundled: bool = False

    @property
    def name(self) -> str:
        """Path of the file, or name of a bundled list."""
        return self.path.stem if self.bundled else str(self.path)

    def read(self, machine: str = TRIPOD) -> "PositionList":
        """Read the list. machine: of a file of the three-armed machine"""
        from planner.sources.positions import Positions

        return Positions(arms=machine).load(self.path)[0]

    def write(self, positions: "PositionList") -> None:
        """Write a CSV file, completely or not at all. Raises MotionError for another suffix."""
        from kinematics.foundation.errors import MotionError
        from planner.sources.position_list import positions_csv

        remedy = '"save" it as a CSV file first'
        if self.bundled:
            raise MotionError(f"{self.name} is bundled with this package; {remedy}")
        if self.path.suffix.lower() != ".csv":
            raise MotionError(f"{self.path}: lists are changed as CSV; {remedy}")
        self.destination.write(positions_csv(positions))
        self.show(positions)

    def show(self, positions: "PositionList") -> None:
        """Print a list."""
        from pulsepath.output import record, tables

        name = self.name
        print_result(
            record.record_positions(positions, name),
            tables.tabulate_positions(positions, name),
            self.as_json,
        )


class ListCommands(Commands):
    """Commands on a list; --json may stand at any place."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        others = [arg for arg in args if arg != "--json"]
        first = ["--json"] if "--json" in args else []
        return super().parse_args(ctx, [*first, *others])


@click.group(cls=ListCommands, invoke_without_command=True)
@click.argument("file", type=click.Path(path_type=Path))
@json_option
@click.pass_context
def positions(context: click.Context, file: Path, as_json: bool) -> None:
    """Show or edit the position list in FILE.

    FILE is a CSV file, a list of the three-armed machine, or "tripod-start-up", the bundled list
    with which that machine's own program starts.

    "arms" shows the arm lengths of a three-armed machine at each pose, rotated poses included.

    A POSE is "10 mm, 0 mm, 25 mm", followed by three angles if it is rotated. Run a list, or part
    of it, with "pulsepath import FILE --first 2 --last 5 --out PROGRAM".

    Example: pulsepath positions poses.csv record "10 mm, 0 mm, 25 mm"
    """
    from kinematics.files.atomic_files import Destination

    bundled = _find_bundled(file)
    path = bundled or file
    # A command overwrites the version that it read, nothing newer.
    destination = Destination(path, force=True)
    context.obj = ListFile(path, as_json, destination, bundled is not None)
    if context.invoked_subcommand is None:
        context.obj.show(context.obj.read())


def _find_bundled(file: Path) -> Path | None:
    """Return the file of a bundled list, by its name; None for any other file."""
    from importlib.resources import files

    preset = Path(str(files("planner"))) / "presets" / f"{file.name}.csv"
    is_name = file.name == str(file) and not file.suffix
    return preset if is_name and not file.exists() and preset.is_file() else None


def _read_dwell(context: click.Context, parameter: click.Parameter, text: str | None) -> float:
    return 0.0 if text is None else read_quantity("--dwell", text, "s", least=0.0)


dwell_option = click.option(
    "--dwell",
    metavar="TIME",
    callback=_read_dwell,
    help='Dwell at the pose, as "0.2 s". Default: none.',
)


@positions.command(context_settings=ALLOW_MINUS)
@click.argument("pose")
@dwell_option
@click.pass_obj
def record(to: ListFile, pose: str, dwell: float) -> None:
    """Append POSE to the list; create FILE if it does not exist.

    Example: pulsepath positions poses.csv record "10 mm, 0 mm, 25 mm, 0 deg, 0 deg, 5 deg"
    """
    import numpy as np

    from planner.sources.position_list import PositionList
    from planner.sources.positions import read_six

    before = to.read() if to.path.exists() else PositionList(np.zeros((0, 6)))
    to.write(before.record(read_six(pose, "pose"), dwell))


@positions.command(context_settings=ALLOW_MINUS)
@click.argument("number", type=int)
@click.argument("pose")
@dwell_option
@click.pass_obj
def insert(to: ListFile, number: int, pose: str, dwell: float) -> None:
    """Insert POSE as number NUMBER.

    Example: pulsepath positions poses.csv insert 2 "5 mm, 0 mm, 25 mm"
    """
    from planner.sources.positions import read_six

    to.write(to.read().insert(number, read_six(pose, "pose"), dwell))


@positions.command()
@click.argument("first", type=int)
@click.argument("last", type=int, required=False)
@click.pass_obj
def remove(file: ListFile, first: int, last: int | None) -> None:
    """Remove pose FIRST, or poses FIRST to LAST.

    Example: pulsepath positions poses.csv remove 3 5
    """
    file.write(file.read().remove(first, last))


@dataclass(frozen=True, slots=True, kw_only=True)
class PartRequest:
    """A part of a list."""

    first: int | None = option(None, "Number of the first pose. Default 1.")
    last: int | None = option(None, "Number of the last pose. Default: the last in the list.")


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmsRequest(PartRequest):
    """Poses of a three-armed machine, and the file for the lengths of its arms."""

    machine: str = option(TRIPOD, "A machine with three arms.", metavar="MACHINE")
    frame: Literal["home", "base"] | None = option(
        None,
        "Frame of the poses. Default: as FILE states.",
        choices=("home", "base"),
    )
    steps: bool = option(False, "Show every step of the machine's own rule: one unit, or 1 deg.")
    out: Path | None = option(
        None,
        "Save the table (CSV, JSON) or the figure (PNG, SVG, PDF).",
    )
    force: bool = option(False, "Overwrite the file of --out.")


@positions.command()
@with_request(ArmsRequest)
@click.pass_obj
def arms(file: ListFile, request: ArmsRequest) -> None:
    """Show three arm lengths at each pose, rotated poses included.

    The plate of a three-armed machine cannot rotate: rotated poses are simulated only, as its
    authors do, and are not turned into motion. The last column is the error of the end point if the
    machine were driven to these lengths. MACHINE may be the source's own geometry file,
    Basiclength.txt.

    Example: pulsepath positions poses.csv arms --steps
    """
    from kinematics import load_machine
    from kinematics.files.atomic_files import Destination
    from planner.export.formats.kmitl import UNIT_LENGTH
    from planner.sources.arm_simulation import simulate_arms
    from pulsepath.output import record, tables

    destination = None
    if request.out is not None:
        refuse_suffix(request.out, "a simulation is saved as", SIMULATED)
        destination = Destination(request.out, force=request.force)
    poses = file.read(request.machine).part(request.first, request.last)
    poses = replace(poses, frame=request.frame or poses.frame)
    unit = UNIT_LENGTH if request.steps else None
    result = simulate_arms(poses, load_machine(request.machine), unit=unit)
    if destination is not None:
        suffix = destination.path.suffix.lower()
        with destination.stage() as staged:
            figure = None
            if suffix in FIGURE_SUFFIXES:
                figure = result.plot().get_figure(root=True)
            else:
                result.files()[suffix](staged)
            if figure is not None:
                figure.savefig(staged, format=suffix[1:], dpi=150)
    print_result(record.record_arms(result, file.name), tables.list_tables(result), file.as_json)


@dataclass(frozen=True, slots=True, kw_only=True)
class SaveRequest(PartRequest):
    """The file for a part of a list."""

    target: Path
    machine: str | None = option(
        None,
        "Tripod that a TXT file is for. Default: tripod.",
        metavar="MACHINE",
    )
    force: bool = option(False, "Overwrite TARGET.")


@positions.command()
@click.argument("target", type=click.Path(path_type=Path))
@with_request(SaveRequest)
@click.pass_obj
def save(file: ListFile, request: SaveRequest) -> None:
    """Save the list, or part of it, as TARGET.

    The suffix sets the format: CSV, or TXT as the three-armed machine reads it. A TXT file has
    seven characters per number, in mm and degrees, and poses in the base frame of MACHINE.

    Example: pulsepath positions poses.csv save part.csv --first 2 --last 5
    """
    from kinematics.files.atomic_files import Destination
    from kinematics.foundation.errors import MotionError

    target = request.target
    to = ListFile(target, file.as_json, Destination(target, force=request.force))
    part = file.read().part(request.first, request.last)
    if target.suffix.lower() != ".txt":
        if request.machine is not None:
            raise MotionError(
                f"{target}: --machine is for TXT files; a CSV file is for any machine",
            )
        to.write(part)
        return
    from kinematics import load_machine
    from planner.export.formats.kmitl import list_text

    to.destination.write(list_text(part, load_machine(request.machine or TRIPOD)))
    to.show(to.read())
