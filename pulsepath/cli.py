"""The command line: options in, tables or JSON out. Slow modules load inside the commands."""

import click

from pulsepath import __version__
from pulsepath.command_group import Commands
from pulsepath.commands.calibrate import calibrate
from pulsepath.commands.check import check
from pulsepath.commands.compare import compare
from pulsepath.commands.completion import completion
from pulsepath.commands.console import console
from pulsepath.commands.export import export
from pulsepath.commands.hold import hold
from pulsepath.commands.import_ import import_
from pulsepath.commands.init import init
from pulsepath.commands.lists import figures, laws, machines, programs, rigs, rules
from pulsepath.commands.plan import plan
from pulsepath.commands.pose import pose
from pulsepath.commands.positions import positions
from pulsepath.commands.studio import studio
from pulsepath.commands.track import track
from pulsepath.commands.view import view
from pulsepath.process.exits import BAD_INPUT, INFEASIBLE, INTERNAL, INTERRUPTED

SECTIONS = {
    "Plan": (init, pose, check, plan, view, studio, export, hold),
    "Import programs": (import_, positions),
    "Run and measure": (track, compare, calibrate, console),
    "List bundled data": (machines, programs, rigs, laws, rules, figures),
}


@click.group(
    cls=Commands,
    sections=SECTIONS,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog=f"Exit codes: 0 done, {INFEASIBLE} infeasible, {BAD_INPUT} bad input, {INTERNAL} internal error, "
    f"{INTERRUPTED} interrupted.",
)
@click.version_option(__version__, prog_name="pulsepath")
def main() -> None:
    """Plan the fastest motion a machine can make along a path, proved to respect every limit, as
    exact pulse times.

    PROGRAM and MACHINE are preset names or paths of TOML files.

    To begin: pulsepath init mine, then pulsepath plan mine/program.toml --out first
    """


main.add_command(completion)
