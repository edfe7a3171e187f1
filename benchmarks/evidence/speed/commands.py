"""Processor time of commands that do not plan, in new processes: `python -m benchmarks.evidence.speed.commands`.

Lists, help and refusals are to take 0.4 s at most, with bytecode and kernels on disk. Each command is run in an empty
folder; the fastest of so many rounds counts (3, or as told: `python -m benchmarks.evidence.speed.commands 5`).
"""

import resource
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.evidence.speed.cold_plan import ENVIRONMENT

ALLOWED = 0.4
"""s of processor time of a command that computes nothing."""
FILES = {
    "part.nc": "G21 G90\nG1 X10 F600\nG1 Y10\nM30\n",
    "key.toml": 'schema = 1\nmachine = "hexapod"\n[[segment]]\nlin = { to = [1, 2, 3] }\n',
    "unit.toml": 'schema = 1\nmachine = "hexapod"\nspeed = "3 kg"\n[[segment]]\nline = { to = [1, 2, 3] }\n',
    "syntax.toml": "schema = = 1\n",
    "name.toml": 'schema = 1\nmachine = "hexapodd"\n[[segment]]\nline = { to = ["1 mm", "2 mm", "3 mm"] }\n',
    "machine.toml": 'schema = 1\nkind = "hexapodd"\n',
}
"""What the commands read."""
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
    "plan circle --machine machine.toml --out out": "hexapodd",
    "check key.toml": "lin",
    "export missing --format vcd": "missing",
    "track missing --rig servo-rig": "missing",
    "compare missing --out out": "missing",
    "init mine": "mine",
    "import part.nc --out part.toml": "part.toml",
    "pose hexapod 5,5,35": "leg1",
    "check circle --machine hexapod": "travel",
}
"""And what they say, whether it is a result or a refusal."""
COMPUTING = ("init", "import", "pose", "check circle")
"""What computes something: it is told, and held against nothing."""


def measure(command: str, said: str) -> float:
    """s of processor time of a command and all its processes. Raises RuntimeError where it says something else."""
    with TemporaryDirectory() as folder:
        for name, text in FILES.items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        call = [sys.executable, "-m", "pulsepath", *command.split()]
        done = subprocess.run(call, capture_output=True, text=True, env=ENVIRONMENT, cwd=folder)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if said not in done.stdout + done.stderr or "Try 'pulsepath" in done.stderr or "Traceback" in done.stderr:
        raise RuntimeError(f"pulsepath {command}: does not say {said}:\n{done.stdout}{done.stderr}")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main(rounds: int = 3) -> None:
    """A row for each command, and how many keep to what is allowed."""
    print("| command | processor time (s) |\n| --- | --- |")
    slow = []
    for command, said in COMMANDS.items():
        took = min(measure(command, said) for _ in range(rounds))
        if took > ALLOWED and not command.startswith(COMPUTING):
            slow.append(command)
        print(f"| `{command}` | {took:.2f} |", flush=True)
    told = f"above {ALLOWED:g} s: {', '.join(slow)}" if slow else f"none above {ALLOWED:g} s"
    print(f"of {len(COMMANDS)} commands {told}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
