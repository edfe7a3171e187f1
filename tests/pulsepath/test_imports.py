"""What the front door loads, and when."""

import ast
import json
import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import pulsepath as pp
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
    "prompt_toolkit",
}


def loaded_after(code):
    """Those of the slow packages that a fresh interpreter has loaded after some code."""
    report = f"import json, sys\n{code}\nprint(json.dumps(sorted({SLOW!r} & set(sys.modules))), file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", report], input="", capture_output=True, text=True, check=True)
    return json.loads(done.stderr.splitlines()[-1])


@pytest.mark.parametrize("arguments", [["--help"], ["plan", "--help"], ["console", "--help"], ["--version"]])
def test_help_loads_nothing_slow(arguments):
    code = f"from pulsepath.cli import main\ntry: main({arguments!r})\nexcept SystemExit as end: assert not end.code"
    assert loaded_after(code) == []


@pytest.mark.skipif(os.name != "posix", reason="Windows has no console")
def test_a_script_from_a_pipe_needs_no_prompt(tmp_path):
    arguments = ["console", "--machine", "traverser", "--fast", "--state", str(tmp_path / "state.json")]
    code = f"from pulsepath.cli import main\ntry: main({arguments!r})\nexcept SystemExit as end: assert not end.code"
    loaded = loaded_after(code)
    assert "numpy" in loaded
    assert "prompt_toolkit" not in loaded


def test_importing_the_package_loads_nothing_slow():
    assert loaded_after("import pulsepath as pp; pp.__version__; dir(pp)") == []
    assert "numpy" in loaded_after("import pulsepath as pp; pp.Axis")


@pytest.mark.skipif(os.name != "posix", reason="asks the system what its children cost")
def test_help_within_150_ms_of_a_bare_interpreter():
    """Of CPU time, which the children alone use: on the wall it is that, and what else the computer does."""
    import resource

    def least(*arguments):
        def once():
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            subprocess.run([sys.executable, *arguments], capture_output=True, check=True)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime

        return min(once() for _ in range(5))

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
        assert not isinstance(value, type(sys))


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'plann'"):
        _ = pp.plann
