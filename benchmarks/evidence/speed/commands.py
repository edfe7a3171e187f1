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
from kinematics.foundation.names import find


def _change(package: str, name: str, old: str, new: str) -> str:
    """The text of a bundled file with a fault in it."""
    return find(package, "file", name).read_text(encoding="utf-8").replace(old, new)


ALLOWED = 0.4
"""s of processor time of a command that computes nothing."""
FILES = {
    "part.nc": "G21 G90\nG1 X10 F600\nG1 Y10\nM30\n",
    "key.toml": 'schema = 1\nmachine = "hexapod"\n[[segment]]\nlin = { to = [1, 2, 3] }\n',
    "unit.toml": 'schema = 1\nmachine = "hexapod"\nspeed = "3 kg"\n[[segment]]\nline = { to = [1, 2, 3] }\n',
    "syntax.toml": "schema = = 1\n",
    "name.toml": 'schema = 1\nmachine = "hexapodd"\n[[segment]]\nline = { to = ["1 mm", "2 mm", "3 mm"] }\n',
    "segment.toml": 'schema = 1\nmachine = "hexapod"\n[[segment]]\nline = { to = ["0 mm", "0 mm", "0 mm"] }\n'
    '[[segment]]\nspline = { through = [["1 mm", "0 mm", "9 mm"], ["1 mm", "0 mm", "9 mm"]] }\n',
    "machine.toml": 'schema = 1\nkind = "hexapodd"\n',
    "machine-key.toml": _change("kinematics", "hexapod", "base_radius", "base_radios"),
    "machine-unit.toml": _change("kinematics", "hexapod", '"149 mm"', "149"),
    "machine-range.toml": _change("kinematics", "hexapod", '"149 mm"', '"-149 mm"'),
    "machine-arm.toml": _change("kinematics", "arm", "joints =", "joint ="),
    "rig.toml": _change("controllers", "servo-rig", '"30 1/s"', '"30 s"'),
    "measured.toml": "schema = 1\n",
    "bad.nc": "G21 G90\nG1 X10 F600 QQ\n",
    "full/notes.txt": "mine\n",
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
    "plan segment.toml --out out": "spline",
    "plan circle --machine machine.toml --out out": "hexapodd",
    "plan circle --machine machine-key.toml --out out": "base_radios",
    "plan circle --machine machine-unit.toml --out out": "149",
    "plan circle --machine machine-range.toml --out out": "-149 mm",
    "plan circle --machine machine-arm.toml --out out": "joint",
    "plan circle --rig rig.toml --out out": "30 s",
    "plan circle --rig missing --out out": "missing",
    "plan circle --rule nearst --out out": "nearest",
    "plan circle --rule sampled:period=50 --out out": "period",
    "plan circle --objective tim --out out": "tim",
    "plan circle --gap 3 --out out": "per cent",
    "plan circle --effort 2 --out out": "--effort is of",
    "plan circle --fit 3 --out out": "--fit",
    "plan circle --duration 3 --out out": "--duration",
    "plan circle --resume --whole --out out": "is for --stream",
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
    "hold full --at 1": "--at",
    "view full": "no plan",
    "compare missing --out out": "missing",
    "compare rig.toml --out out": "30 s",
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
}
"""And what they say, whether it is a result or a refusal."""
COMPUTING = {
    "init mine",
    "import part.nc --out part.toml",
    "pose hexapod 5,5,35",
    "pose hexapod 500,5,35",
    "pose hexapod --counts 1,2",
    "check circle --machine hexapod",
    "plan circle --rule sampled:period=50 --out out",
}
"""What computes something, makes a machine, or is refused by what computes: a firing rule. It is told, and held against
nothing."""


def measure(command: str, said: str) -> float:
    """s of processor time of a command and all its processes. Raises RuntimeError where it says something else."""
    with TemporaryDirectory() as folder:
        for name, text in FILES.items():
            (Path(folder) / name).parent.mkdir(exist_ok=True)
            (Path(folder) / name).write_text(text, encoding="utf-8")
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        call = [sys.executable, "-m", "pulsepath", *command.split()]
        done = subprocess.run(call, capture_output=True, text=True, env=ENVIRONMENT, cwd=folder)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if said not in done.stdout + done.stderr or "no such option" in done.stderr.lower() or "Traceback" in done.stderr:
        raise RuntimeError(f"pulsepath {command}: does not say {said}:\n{done.stdout}{done.stderr}")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main(rounds: int = 3) -> None:
    """A row for each command, and how many keep to what is allowed."""
    print("| command | processor time (s) |\n| --- | --- |")
    slow: list[str] = []
    computing: list[str] = []
    for command, said in COMMANDS.items():
        took = min(measure(command, said) for _ in range(rounds))
        if took > ALLOWED:
            (computing if command in COMPUTING else slow).append(command)
        print(f"| `{command}` | {took:.2f} |", flush=True)
    told = f"above {ALLOWED:g} s: {', '.join(slow)}" if slow else f"none above {ALLOWED:g} s"
    print(f"of {len(COMMANDS)} commands {told}, but for {len(computing)} that compute: {', '.join(computing)}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
