"""Processor and wall time of whole commands, each in a new process and an empty folder.

Commands that do not plan may take 0.5 s of processor time, with bytecode and kernels on disk. Cold
plans may take 3 s and 4 s of wall time on two idle cores. The fastest of `--rounds` counts.
"""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.evidence.measuring import Measured, measure_here
from benchmarks.evidence.table import Row, Table
from kinematics.foundation.errors import MotionError

# s of processor time of a command that does not plan
ALLOWED = 0.5
# Commands that plan, and s of wall time that each may take.
PLANS = {
    "plan bare-circle --machine hexapod --no-figures --out out": 3.0,
    "plan circle --machine hexapod --out out": 4.0,
}
# An installed package has its bytecode on disk, even if this process must write none.
ENVIRONMENT = os.environ | {"PYTHONDONTWRITEBYTECODE": ""}

FILES = {
    "part.nc": "G21 G90\nG1 X10 F600\nG1 Y10\nM30\n",
    "key.toml": 'schema = 1\nmachine = "hexapod"\n[[segment]]\nlin = { to = [1, 2, 3] }\n',
    "unit.toml": 'schema = 1\nmachine = "hexapod"\nspeed = "3 kg"\n[[segment]]\nline = { to = [1, 2, 3] }\n',
    "syntax.toml": "schema = = 1\n",
    "name.toml": 'schema = 1\nmachine = "hexapodd"\n[[segment]]\nline = { to = ["1 mm", "2 mm", "3 mm"] }\n',
    "segment.toml": 'schema = 1\nmachine = "hexapod"\n[[segment]]\nline = { to = ["0 mm", "0 mm", "0 mm"] }\n'
    '[[segment]]\nspline = { through = [["1 mm", "0 mm", "9 mm"], ["1 mm", "0 mm", "9 mm"]] }\n',
    "machine.toml": 'schema = 1\nkind = "hexapodd"\n',
    "machine-key.toml": 'schema = 1\nkind = "hexapod"\nbase_radios = "1 mm"\n',
    "rig.toml": 'schema = 1\nposition_gain = "30 s"\n',
    "measured.toml": "schema = 1\n",
    "bad.nc": "G21 G90\nG1 X10 F600 QQ\n",
    "full/notes.txt": "mine\n",
}
"""Files that the commands read."""
COMMANDS = {
    "--help": "Usage",
    "--version": "pulsepath",
    "plan --help": "Usage",
    "machines": "hexapod",
    "programs": "circle",
    "rigs": "servo-rig",
    "laws": "feedforward",
    "rules": "nearest",
    "completion bash": "complete",
    "plan missing --out out": "missing",
    "plan circle --machine missing --out out": "missing",
    "plan syntax.toml --out out": "not TOML",
    "plan key.toml --out out": "lin",
    "plan unit.toml --out out": "3 kg",
    "plan name.toml --out out": "hexapodd",
    "plan segment.toml --out out": "spline",
    "plan circle --machine machine.toml --out out": "hexapodd",
    "plan circle --machine machine-key.toml --out out": "base_radios",
    "plan circle --rig rig.toml --out out": "position_gain",
    "plan circle --rig missing --out out": "missing",
    "plan circle --rule nearst --out out": "nearest",
    "plan circle --rule sampled:period=50 --out out": "period",
    "plan circle --objective tim --out out": "tim",
    "plan circle --gap 3 --out out": "per cent",
    "plan circle --effort 2 --out out": "--effort needs",
    "plan circle --fit 3 --out out": "--fit",
    "plan circle --duration 3 --out out": "--duration",
    "plan circle --out part.nc": "not a directory",
    "plan circle --out full": "not empty",
    "plan bad.nc --machine hexapod --out out": "bad.nc",
    "check bad.nc --machine hexapod": "bad.nc",
    "check key.toml": "lin",
    "check full": "no plan",
    "check circle --machine machine-key.toml": "base_radios",
    "export missing --format vcd": "missing",
    "track missing --rig servo-rig": "missing",
    "export full --format vcd": "no plan",
    "export full --format vdc": "vdc",
    "track full": "no plan",
    "track full --law 9": "9",
    "track full --law 3:gian=1": "no plan",
    "hold full --at 1s": "no plan",
    "hold full --at 1": "no plan",
    "view full": "no plan",
    "compare missing --out out": "missing",
    "compare rig.toml --out out": "position_gain",
    "compare servo-rig --law 9 --out out": "9",
    "compare servo-rig --law 3:gian=1 --out out": "gian",
    "compare --from full --out out": "full",
    "compare servo-rig --out full": "full",
    "calibrate missing cmm --out out": "missing",
    "calibrate hexapod missing --out out": "missing",
    "calibrate hexapod measured.toml --out out": "measured",
    "calibrate machine-key.toml cmm --out out": "base_radios",
    "console --machine machine-key.toml": "base_radios",
    "init . --machine missing": "missing",
    "import bad.nc --out part.toml": "bad.nc",
    "import part.nc --out key.toml": "key.toml",
    "import part.xyz --out part.toml": "part.xyz",
    "import missing.nc --out part.toml": "missing.nc",
    "pose hexapod 5,5": "2 entries",
    "pose hexapod 5,5,3g": "3g",
    "pose hexapod 5,5,5 --turn 400,0,0": "whole turn",
    "pose hexapod --counts 1,2": "entries",
    "pose machine-key.toml": "base_radios",
    "pose hexapod 500,5,35": "leg",
    "init mine": "mine",
    "import part.nc --out part.toml": "part.toml",
    "pose hexapod 5,5,35": "leg1",
    "check circle --machine hexapod": "travel",
    "check part.nc --machine cartesian": "travel",
}
"""Commands, and a word of their output: of the result, or of the refusal."""


def run_command(
    command: str,
    message: str = "",
) -> Measured[subprocess.CompletedProcess[str]]:
    """Run a command in a new process.

    Raises MotionError if its output does not hold the message.
    """
    words = [sys.executable, "-m", "pulsepath", *command.split()]
    with TemporaryDirectory() as name:
        folder = Path(name)
        for file, text in FILES.items():
            (folder / file).parent.mkdir(exist_ok=True)
            (folder / file).write_text(text, encoding="utf-8")

        def run() -> subprocess.CompletedProcess[str]:
            return subprocess.run(
                words, capture_output=True, text=True, env=ENVIRONMENT, cwd=folder
            )

        measured = measure_here(run)
    output = measured.result.stdout + measured.result.stderr
    unknown = "no such option" in output.lower() or "Traceback" in output
    if message not in output or unknown:
        raise MotionError(f"pulsepath {command}: does not say {message}:\n{output}")
    return measured


def measure(rounds: int = 3) -> Iterator[Table]:
    """Yield the time of each command, then of plans."""

    def find_fastest(command: str, message: str = "") -> Row:
        runs = [run_command(command, message) for _ in range(rounds)]
        return [
            f"`{command}`",
            min(run.processor for run in runs),
            min(run.wall for run in runs),
        ]

    quick_rows = (
        [*find_fastest(command, message), ALLOWED] for command, message in COMMANDS.items()
    )
    plan_rows = ([*find_fastest(command), limit] for command, limit in PLANS.items())
    columns = ("command", "processor time (s)", "wall time (s)")
    yield Table("Commands that do not plan", (*columns, "allowed processor time (s)"), quick_rows)
    load = f"load of this machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
    yield Table("Cold plans", (*columns, "allowed wall time (s)"), plan_rows, load)
