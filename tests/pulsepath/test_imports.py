"""What the front door loads, and when."""

import ast
import json
import os
import re
import subprocess
import sys
from functools import partial
from importlib import import_module
from pathlib import Path

import pytest
from click.testing import CliRunner

import pulsepath as pp
from pulsepath.cli import main
from tests.pace import slowness

SLOW = {
    "numpy",
    "scipy",
    "casadi",
    "toppra",
    "matplotlib",
    "pint",
    "pydantic",
    "rich",
    "jinja2",
    "numba",
    "loky",
    "prompt_toolkit",
}


ROOT = Path(__file__).parents[2]


def run_fresh(code, folder=ROOT):
    """What a fresh interpreter prints on stderr that runs some code in a folder, with the packages
    of this tree.
    """
    command = [sys.executable, "-c", code]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        command, input="", capture_output=True, text=True, check=True, env=environment, cwd=folder
    )
    return done.stderr


def loaded_after(code, folder=ROOT):
    """List those of the slow packages that a fresh interpreter has loaded after some code."""
    report = f"import json, sys\n{code}\nprint(json.dumps(sorted({SLOW!r} & set(sys.modules))), file=sys.stderr)"
    return json.loads(run_fresh(report, folder).splitlines()[-1])


CALL = """
import io, json, sys
from contextlib import redirect_stderr
from pulsepath.cli import main
results = []
for arguments in {commands!r}:
    text = io.StringIO()
    with redirect_stderr(text):
        try:
            main(arguments)
            code = 0
        except SystemExit as end:
            code = end.code or 0
    results.append((code, text.getvalue(), sorted({slow!r} & set(sys.modules))))
print(json.dumps(results), file=sys.stderr)
"""
"""What a process loads it keeps: where the last command has loaded nothing slow, none has."""


def call_fresh(commands, folder=ROOT):
    """Call commands one after the other in a fresh interpreter.

    Returns for each its exit code, what it wrote to stderr, and the slow packages that are loaded
    by then.
    """
    output = run_fresh(CALL.format(commands=commands, slow=SLOW), folder)
    return dict(zip(map(" ".join, commands), json.loads(output.splitlines()[-1]), strict=True))


def test_help_loads_nothing_slow():
    helped = ("plan", "console", "export", "import", "hold")
    commands = [["--help"], *([name, "--help"] for name in helped), ["--version"]]
    for command, (code, _, loaded) in call_fresh(commands).items():
        assert (code, loaded) == (0, []), command


UNKNOWN = [
    ["check", "circel"],
    ["plan", "circle", "--machine", "hexapodd", "--out", "o"],
    ["plan", "circle", "--rule", "nearst", "--out", "o"],
    ["plan", "circle", "--rig", "servo", "--out", "o", "--json"],
    ["pose", "hexapodd"],
    ["init", "--machine", "hexapodd"],
    ["calibrate", "hexapodd", "cmm", "--out", "o"],
    ["console", "--machine", "hexapodd"],
    ["track", "o", "--law", "9"],
    ["compare", "servo", "--out", "o"],
    ["export", "o", "--format", "zabber"],
]


def test_a_mistake_in_a_command_loads_nothing_that_computes(tmp_path):
    for command, (code, text, loaded) in call_fresh(UNKNOWN, tmp_path).items():
        assert code == 2, command
        assert set(loaded) <= {"rich"}, command
        assert ("nearest is" in text) == (not command.endswith("9")), text


COMPUTING = {"scipy", "numba", "loky", "matplotlib", "toppra", "jinja2", "pint"}
FAULTY = {
    "segment.toml": 'schema = 1\nmachine = "hexapod"\n[[segment]]\ndwell = "3 kg"\n',
    "machine.toml": 'schema = 1\nkind = "hexapod"\n[geometry]\nbase_radios = "149 mm"\nbase_gap = 30\n',
    "rig.toml": 'schema = 1\nmachine = "arm"\nservo = { gear = { ratio = 74 } }\n[[axis]]\nname = "elbwo"\n[[task]]\n'
    'name = "line"\nprogram = "arm-line"\nramp = "1 s"\nduration = "5 s"\nsamples = 41\n',
    "part.nc": "G21 G90\nG1 X10 F600 QQ\n",
    "full/notes.txt": "mine\n",
}
REFUSED = {
    "check segment.toml": '"3 kg"',
    "plan segment.toml --out o": '"3 kg"',
    "check circle --machine machine.toml": 'nearest is "base_radius"',
    "plan circle --machine machine.toml --out o": 'nearest is "base_radius"',
    "console --machine machine.toml": 'nearest is "base_radius"',
    "calibrate machine.toml cmm --out o": 'nearest is "base_radius"',
    "pose machine.toml": 'nearest is "base_radius"',
    "plan circle --rig rig.toml --out o": 'nearest is "elbow"',
    "compare rig.toml --out o": 'missing: write e.g. "30 1/s"',
    "compare servo-rig --law 3:gian=1 --out o": "no gain",
    "plan part.nc --machine hexapod --out o": "column 13",
    "check part.nc --machine hexapod": "column 13",
    "import part.nc --out o.toml": "column 13",
    "plan circle --objective tim --out o": "not known",
    "plan circle --out full": "not empty",
    "compare servo-rig --out full": "no saved runs",
    "plan circle --gap 3 --out o": "per cent",
    "plan circle --effort 2 --out o": "--gap",
    "check full": "holds no plan",
    "hold full --at 1s": "holds no plan",
    "export full --format vcd": "holds no plan",
    "track full": "holds no plan",
    "pose hexapod 5,5": "2 entries",
    "pose hexapod 5,5,5 --turn 400,0,0": "whole turn",
}
"""What is refused by what files and arguments say, and with which words."""


def test_a_mistake_in_a_file_is_refused_before_what_computes_is_loaded(tmp_path):
    for name, text in FAULTY.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    refusals = call_fresh([command.split() for command in REFUSED], tmp_path)
    assert refusals.keys() == REFUSED.keys()
    for command, (code, text, loaded) in refusals.items():
        assert code == 2, (command, text)
        assert REFUSED[command] in text, command
        assert not COMPUTING & set(loaded), command


LOADED = {
    "machines": {"numpy", "casadi", "pydantic", "rich"},
    "programs": {"numpy", "rich"},
    "rigs": {"numpy", "rich"},
    "laws": {"numpy", "casadi", "rich"},
    "rules": {"numpy", "casadi", "rich"},
    "figures": {"numpy", "casadi", "rich"},
    "pose hexapod 5,5,35 --turn 3,-4,2": {"numpy", "casadi", "pydantic", "rich"},
    "pose tripod --travel 1,2,3": {"numpy", "casadi", "pydantic", "rich"},
    "init mine": {"numpy", "casadi", "pydantic"},
    "init ours --machine tripod --all": {"numpy", "casadi", "pydantic"},
    "check part.nc --machine cartesian": {"numpy", "casadi", "pydantic", "rich"},
    "check circle": {"numpy", "casadi", "pydantic", "rich", "scipy"},
    "import part.nc --out part.toml": {"numpy", "casadi", "pydantic"},
}
"""Slow packages that commands without a plan load: all others would delay them."""


@pytest.mark.parametrize("packages", sorted({tuple(sorted(each)) for each in LOADED.values()}))
def test_a_command_that_does_not_plan_loads_what_it_uses(packages, tmp_path):
    """Commands that load the same are called in one process: none after the first loads more."""
    (tmp_path / "part.nc").write_text("G21 G90\nG1 X10 F600\nG2 X20 Y10 I0 J10\nM30\n")
    commands = [command.split() for command, own in LOADED.items() if own == set(packages)]
    for command, (code, _, loaded) in call_fresh(commands, tmp_path).items():
        assert code == 0, command
        assert set(loaded) == set(packages), command


def test_the_list_of_machines_makes_none(monkeypatch):
    """The files state what it shows."""
    monkeypatch.setattr(
        "kinematics.machine.machine_file._make_machine", partial(pytest.fail, "made a machine")
    )
    assert CliRunner().invoke(main, ["machines"]).exit_code == 0


def test_a_check_of_a_program_loads_no_solver_and_no_pulses():
    code = "import planner; planner.check('bare-circle', 'hexapod')"
    packages = (
        "planner.bounds",
        "planner.export",
        "planner.interruption",
        "planner.pulses",
        "planner.timing",
    )
    report = (
        f"import sys; {code}; print(*sorted({set(packages)!r} & set(sys.modules)), file=sys.stderr)"
    )
    assert run_fresh(report).splitlines()[-1].split() == []


def test_the_first_of_two_processes_draws_no_figure(tmp_path):
    """The second one loads what draws, while the first one plans."""
    code = """
from planner import parallel
from pulsepath.cli import main
parallel.cores = lambda: 2
few = ["--order", "2", "--pulses", "none", "--no-worth", "--no-baselines"]
main(["-q", "plan", "bare-circle", *few, "--out", "out"], standalone_mode=False)
"""
    assert "matplotlib" not in loaded_after(code, tmp_path)
    names = {file.stem for file in (tmp_path / "out" / "figures").iterdir()}
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert names == set(
        re.findall(r'<figure data-figure="(\w+)"', page)
    )  # no figure that is not shown
    assert names == {"axes", "path", "limits", "pulses", "realised"}


@pytest.mark.skipif(os.name != "posix", reason="Windows has no console")
def test_a_script_from_a_pipe_needs_no_prompt(tmp_path):
    arguments = [
        "console",
        "--machine",
        "traverser",
        "--fast",
        "--state",
        str(tmp_path / "state.json"),
    ]
    ((code, _, loaded),) = call_fresh([arguments]).values()
    assert code == 0
    assert "numpy" in loaded
    assert "prompt_toolkit" not in loaded


def test_importing_the_package_loads_nothing_slow():
    assert (
        loaded_after("import pulsepath as pp; pp.__version__; dir(pp); assert 'plots' in dir(pp)")
        == []
    )
    assert "numpy" in loaded_after("import pulsepath as pp; pp.Axis")


def test_a_loaded_machine_needs_numbers_formulas_and_file_keys_alone():
    """SciPy's rotations take as long to load as all the rest: a home that is not turned does
    without them.
    """
    code = f"""
import pulsepath as pp
for name in ("hexapod", "tripod", "traverser", "scara", "linkage"):
    machine = pp.load_machine(name)
print(json.dumps(sorted({SLOW!r} & set(sys.modules))), file=sys.stderr)
machine.home"""
    first = run_fresh(f"import json, sys{code}; assert 'scipy' in sys.modules")
    assert set(json.loads(first.splitlines()[-1])) == {"numpy", "casadi", "pydantic"}


@pytest.mark.skipif(os.name != "posix", reason="asks the system what its children cost")
def test_help_within_150_ms_of_a_bare_interpreter():
    """Of CPU time, which the children alone use: on the wall it is that, and what else the computer
    does.
    """
    import resource

    def least(*arguments):
        def once():
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            subprocess.run([sys.executable, *arguments], capture_output=True, check=True)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime

        return min(once() for _ in range(3))

    assert least("-m", "pulsepath", "--help") - least("-c", "pass") < 0.150 * slowness()


def test_every_name_is_the_one_that_the_type_checker_is_told():
    """By the stub: the names of some packages, and all that others list."""
    told = {}
    for node in ast.parse(Path(pp.__file__).with_suffix(".pyi").read_text()).body:
        if isinstance(node, ast.ImportFrom):
            module = import_module(node.module)
            names = [alias.name for alias in node.names]
            told |= dict.fromkeys(module.__all__ if names == ["*"] else names, module)
    assert set(pp.__all__) <= set(told)
    for name, module in told.items():
        value = getattr(pp, name)
        assert value is getattr(module, name)
        assert isinstance(value, type(sys)) == (name == "plots")


def test_the_figures_are_there_without_an_import_of_their_own():
    assert "matplotlib" in loaded_after(
        "import pulsepath as pp; assert pp.plots.limit_use.__name__ == 'limit_use'"
    )


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'plann'"):
        _ = pp.plann
