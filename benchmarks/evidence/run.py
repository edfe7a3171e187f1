"""Run one case of the evidence and print its tables: `python -m benchmarks.evidence NAME`.

Without a name, the cases are listed. A case is a file in `benchmarks/evidence/cases`. Its function
`measure` yields tables and paragraphs, which are printed as soon as they are measured. The
function's parameters are the case's options: `measure(count: int = 100)` is run with `--count 100`.
`--out FILE` writes the text to a file.
"""

import argparse
import inspect
import sys
import types
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from benchmarks.evidence.table import Table
from kinematics.foundation.errors import MotionError

Measure = Callable[..., Iterator[Table | str]]

CASES = {
    "assembly_modes": "how often all forty modes of Dietmaier's platform are found, and in which time",
    "cam_files": "planning of G-code files: motion, baseline, bound, time and memory",
    "circle": "the bare circle, certified, against legs computed by hand",
    "commands": "processor and wall time of whole commands, and of cold plans",
    "compiling": "seconds of compiling and signatures of each kernel of a plan",
    "design": "a stepper sized, actuators and joints selected",
    "findings": "the page of a thesis' findings: which hold on the emulated rig",
    "forward": "certified forward kinematics against independent proofs, and its time",
    "holds": "stops at random instants, and motions on from there",
    "laws_compared": "tracking laws on the servo rig: contour errors at their best gains",
    "limit_worths": "savings predicted for each limit, compared with planning again",
    "linuxcnc_suite": "LinuxCNC's files for its planner: planned and certified, or refused",
    "lower_bounds": "proved lower bounds of durations, and how far durations are above them",
    "page_pictures": "pictures of every report page, for the documentation",
    "peers": "two paths and a line by us, toppra, copp-py, ruckig and IPOPT",
    "peers_page": "the page docs/peers.md, from the table of peers",
    "published": "the page of published numbers next to ours",
    "pulse_trials": "random machines on random programs, whose pulses are all checked",
    "pulses": "speed and memory of pulse schedules and of their files",
    "random_splines": "COPP's random splines by us and copp-py",
    "robustness": "random problems and programs, all to be solved and certified",
    "ruckig_moves": "random moves of one axis by us and ruckig",
    "shaped_plans": "plans after input shapers: limits, deviations and vibrations",
    "solve_times": "time to solve and certify the bare circle, next to the solvers alone",
    "toppra_suite": "toppra's hard problems by us and toppra",
}
"""Names of the cases, which are those of their files, with one line of help."""


def find_case(name: str) -> types.ModuleType:
    """Import the file of a case."""
    return import_module(f"benchmarks.evidence.cases.{name}")


def render_lines(blocks: Iterator[Table | str]) -> Iterator[str]:
    """Yield the lines of a case's tables and paragraphs, with an empty line between two of them."""
    for number, block in enumerate(blocks):
        if number:
            yield ""
        if isinstance(block, Table):
            yield from block.lines()
        else:
            yield block


def render_case(name: str, **options: Any) -> str:
    """Run a case and return its text."""
    return "\n".join(render_lines(find_case(name).measure(**options))) + "\n"


def main() -> None:
    """Run the case that the command line names, or list the cases."""
    words = sys.argv[1:]
    if not words or words[0] in ("-h", "--help"):
        print(list_cases())
        return
    name, *rest = words
    if name not in CASES:
        print(f"{name!r} is no case of the evidence\n\n{list_cases()}", file=sys.stderr)
        sys.exit(2)
    case = find_case(name)
    options = vars(build_parser(name, case).parse_args(rest))
    out = options.pop("out")
    try:
        write_lines(render_lines(case.measure(**options)), out)
    except (MotionError, OSError) as error:
        sys.exit(f"{name}: {error}")
    except KeyboardInterrupt:
        sys.exit(130)


def list_cases() -> str:
    """Return the names of all cases with their help."""
    width = max(map(len, CASES))
    cases = [f"  {name:<{width}}  {line}" for name, line in CASES.items()]
    head = "python -m benchmarks.evidence NAME [--option VALUE …]; NAME --help explains a case.\n"
    return "\n".join([head, *cases])


def build_parser(name: str, case: types.ModuleType) -> argparse.ArgumentParser:
    """Return a parser with one option for each parameter of a case's `measure`."""
    parser = argparse.ArgumentParser(
        prog=f"python -m benchmarks.evidence {name}",
        description=case.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    for parameter in inspect.signature(case.measure, eval_str=True).parameters.values():
        add_option(parser, parameter)
    parser.add_argument("--out", type=Path, help="write the text to this file")
    return parser


def add_option(parser: argparse.ArgumentParser, parameter: inspect.Parameter) -> None:
    """Add the option of a parameter.

    Its type is bool, int, float, str, Path or a Literal, or one of these or None.
    """
    flag = f"--{parameter.name.replace('_', '-')}"
    required = parameter.default is parameter.empty
    kind = parameter.annotation
    if isinstance(kind, types.UnionType):
        kind = next(one for one in get_args(kind) if one is not type(None))
    if kind is bool:
        parser.add_argument(flag, action="store_true")
        return
    settings: dict[str, Any] = {"type": kind}
    if get_origin(kind) is Literal:
        choices = get_args(kind)
        settings = {"type": type(choices[0]), "choices": choices}
    if not required:
        settings |= {"default": parameter.default, "help": f"default: {parameter.default}"}
    parser.add_argument(flag, required=required, **settings)


def write_lines(lines: Iterator[str], path: Path | None) -> None:
    """Print each line as soon as it is there, or write all of them to a file when the last one
    is.
    """
    if path is None:
        for line in lines:
            print(line, flush=True)
        return
    # before the measurement, which may take hours
    path.parent.mkdir(parents=True, exist_ok=True)
    text = "\n".join(lines) + "\n"
    path.write_text(text, encoding="utf-8")
