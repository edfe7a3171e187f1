"""`pulsepath positions`: show and edit a position list."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from pulsepath.command_group import Commands
from pulsepath.commands.common import FIGURE_SUFFIXES
from pulsepath.options import ALLOW_MINUS, read_quantity

if TYPE_CHECKING:
    from kinematics.files.atomic_files import Destination
    from planner.sources.position_list import PositionList

SIMULATED = (".csv", ".json", *FIGURE_SUFFIXES)
"""Suffix of a saved simulation of the arms."""


@dataclass(frozen=True, slots=True)
class ListFile:
    """The file of a command, whether it prints JSON, and the identity of the file when the command began.

    bundled  whether it is a list of this package, which stays unchanged
    """

    path: Path
    as_json: bool
    destination: "Destination"
    bundled: bool = False

    @property
    def name(self) -> str:
        """Path of the file, or name of a bundled list."""
        return self.path.stem if self.bundled else str(self.path)

    def read(self, machine: str = "tripod") -> "PositionList":
        """The list; machine: that a file of the three-armed machine is of."""
        from planner.sources.positions import Positions

        return Positions(arms=machine).load(self.path)[0]

    def write(self, listed: "PositionList") -> None:
        """Write a CSV file, completely or not at all. Raises MotionError for another suffix."""
        from kinematics import MotionError
        from planner.sources.position_list import positions_csv

        if self.bundled:
            raise MotionError(f'{self.name} is bundled with this package; "save" it as a CSV file first')
        if self.path.suffix.lower() != ".csv":
            raise MotionError(f'{self.path}: lists are changed as CSV; "save" it as one first')
        self.destination.write(positions_csv(listed))
        self.tell(listed)

    def tell(self, listed: "PositionList") -> None:
        from pulsepath.output import record, tables

        if self.as_json:
            click.echo(record.as_json(record.of_positions(listed, self.name)), nl=False)
        else:
            tables.show(tables.of_positions(listed, self.name))


class ListCommands(Commands):
    """Commands on a list; --json may stand at any place."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        asked = ["--json"] if "--json" in args else []
        return super().parse_args(ctx, [*asked, *(arg for arg in args if arg != "--json")])


@click.group(cls=ListCommands, invoke_without_command=True)
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of a table.")
@click.pass_context
def positions(context: click.Context, file: Path, as_json: bool) -> None:
    """Show or edit the position list in FILE.

    FILE is a CSV file, a list of the three-armed machine, or "tripod-start-up", the bundled list
    with which that machine's own program starts.

    "arms" shows the arm lengths of a three-armed machine at each pose, rotated poses included.

    A POSE is "10 mm, 0 mm, 25 mm", followed by three angles if it is rotated. Run a list, or part of it, with
    "pulsepath import FILE --first 2 --last 5 --out PROGRAM".

    Example: pulsepath positions poses.csv record "10 mm, 0 mm, 25 mm"
    """
    from kinematics.files.atomic_files import Destination

    bundled = _find_bundled(file)
    path = bundled or file
    # a command overwrites the version that it read, nothing newer
    context.obj = ListFile(path, as_json, Destination(path, force=True), bundled is not None)
    if context.invoked_subcommand is None:
        context.obj.tell(context.obj.read())


def _find_bundled(file: Path) -> Path | None:
    """Return the file of a bundled list, by its name; None for any other file."""
    from importlib.resources import files

    preset = Path(str(files("planner"))) / "presets" / f"{file.name}.csv"
    is_name = file.name == str(file) and not file.suffix
    return preset if is_name and not file.exists() and preset.is_file() else None


dwell_option = click.option("--dwell", metavar="TIME", help='Dwell at the pose, as "0.2 s". Default: none.')


def _read_dwell(dwell: str | None) -> float:
    return 0.0 if dwell is None else read_quantity("--dwell", dwell, "s", least=0.0)


@positions.command(context_settings=ALLOW_MINUS)
@click.argument("pose")
@dwell_option
@click.pass_obj
def record(to: ListFile, pose: str, dwell: str | None) -> None:
    """Append POSE to the list; create FILE if it does not exist.

    Example: pulsepath positions poses.csv record "10 mm, 0 mm, 25 mm, 0 deg, 0 deg, 5 deg"
    """
    import numpy as np

    from planner.sources.position_list import PositionList
    from planner.sources.positions import read_six

    listed = to.read() if to.path.exists() else PositionList(np.zeros((0, 6)))
    to.write(listed.record(read_six(pose, "pose"), _read_dwell(dwell)))


@positions.command(context_settings=ALLOW_MINUS)
@click.argument("number", type=int)
@click.argument("pose")
@dwell_option
@click.pass_obj
def insert(to: ListFile, number: int, pose: str, dwell: str | None) -> None:
    """Insert POSE as number NUMBER.

    Example: pulsepath positions poses.csv insert 2 "5 mm, 0 mm, 25 mm"
    """
    from planner.sources.positions import read_six

    to.write(to.read().insert(number, read_six(pose, "pose"), _read_dwell(dwell)))


@positions.command()
@click.argument("first", type=int)
@click.argument("last", type=int, required=False)
@click.pass_obj
def remove(of: ListFile, first: int, last: int | None) -> None:
    """Remove pose FIRST, or poses FIRST to LAST.

    Example: pulsepath positions poses.csv remove 3 5
    """
    of.write(of.read().remove(first, last))


@positions.command()
@click.option("--machine", default="tripod", metavar="MACHINE", show_default=True, help="A machine with three arms.")
@click.option("--frame", type=click.Choice(("home", "base")), help="Frame of the poses. Default: as FILE states.")
@click.option("--steps", is_flag=True, help="Show every step of the machine's own rule: one unit, or 1 deg.")
@click.option("--first", type=int, help="Number of the first pose. Default 1.")
@click.option("--last", type=int, help="Number of the last pose. Default: the last in the list.")
@click.option(
    "--out", type=click.Path(path_type=Path), help="Save the table (CSV, JSON) or the figure (PNG, SVG, PDF)."
)
@click.option("--force", is_flag=True, help="Overwrite the file of --out.")
@click.pass_obj
def arms(
    of: ListFile,
    machine: str,
    frame: Literal["home", "base"] | None,
    steps: bool,
    first: int | None,
    last: int | None,
    out: Path | None,
    force: bool,
) -> None:
    """Show three arm lengths at each pose, rotated poses included.

    The plate of a three-armed machine cannot rotate: rotated poses are simulated only, as its authors do, and are not
    turned into motion. The last column is the error of the end point if the machine were driven to these lengths.
    MACHINE may be the source's own geometry file, Basiclength.txt.

    Example: pulsepath positions poses.csv arms --steps
    """
    from dataclasses import replace

    from kinematics import MotionError, load_machine
    from kinematics.files.atomic_files import Destination
    from planner.export.formats.kmitl import UNIT_LENGTH
    from planner.sources.arm_simulation import simulate_arms
    from pulsepath.output import record, tables

    if out is not None and out.suffix.lower() not in SIMULATED:
        raise MotionError(
            f"{out}: a simulation is saved as one of {', '.join(SIMULATED)}; give --out one of these suffixes"
        )
    destination = None if out is None else Destination(out, force=force)
    listed = of.read(machine).part(first, last)
    listed = replace(listed, frame=frame or listed.frame)
    found = simulate_arms(listed, load_machine(machine), unit=UNIT_LENGTH if steps else None)
    if destination is not None:
        kind = destination.path.suffix.lower()
        with destination.stage() as file:
            if kind in FIGURE_SUFFIXES:
                figure = found.plot().get_figure(root=True)
                if figure is not None:
                    figure.savefig(file, format=kind[1:], dpi=150)
            else:
                found.files()[kind](file)
    if of.as_json:
        click.echo(record.as_json(record.of_arms(found, of.name)), nl=False)
    else:
        tables.show(tables.of_results(found))


@positions.command()
@click.argument("target", type=click.Path(path_type=Path))
@click.option("--first", type=int, help="Number of the first pose. Default 1.")
@click.option("--last", type=int, help="Number of the last pose. Default: the last in the list.")
@click.option("--machine", metavar="MACHINE", help="Tripod that a TXT file is for. Default: tripod.")
@click.option("--force", is_flag=True, help="Overwrite TARGET.")
@click.pass_obj
def save(of: ListFile, target: Path, first: int | None, last: int | None, machine: str | None, force: bool) -> None:
    """Save the list, or part of it, as TARGET.

    The suffix sets the format: CSV, or TXT as the three-armed machine reads it. A TXT file has seven characters per
    number, in mm and degrees, and poses in the base frame of MACHINE.

    Example: pulsepath positions poses.csv save part.csv --first 2 --last 5
    """
    from kinematics import MotionError
    from kinematics.files.atomic_files import Destination

    to = ListFile(target, of.as_json, Destination(target, force=force))
    part = of.read().part(first, last)
    if target.suffix.lower() != ".txt":
        if machine is not None:
            raise MotionError(f"{target}: --machine is for TXT files; a CSV file is for any machine")
        to.write(part)
        return
    from kinematics import load_machine
    from planner.export.formats.kmitl import list_text

    to.destination.write(list_text(part, load_machine(machine or "tripod")))
    to.tell(to.read())
