"""Stored machine code is that of the present sources: a changed source changes a kernel's
description.
"""

import math
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from types import BuiltinFunctionType, CodeType, ModuleType

import numpy as np
import pytest

from kinematics.foundation import kernels
from kinematics.foundation.kernels import Kernel, describe_kernel
from planner.timing.order3 import kkt, riccati, stages

ROOT = Path(__file__).parents[3]
PACKAGES = ("kinematics", "planner", "controllers")


def list_kernels():
    """Return all kernels of the packages, by module and name."""
    result = {}
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            if "\n@kernel\n" not in path.read_text():
                continue
            name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
            for value in vars(import_module(name)).values():
                if isinstance(value, Kernel) and value.function.__module__ == name:
                    result[f"{name}.{value.function.__name__}"] = value
    return result


CONSTANTS = (bool, int, float, str, tuple, np.ndarray)


def is_described(value):
    """Return whether a description states all of a global value that a kernel reads."""
    if isinstance(value, ModuleType):
        return value in (np, math)
    is_record = isinstance(value, type) and issubclass(value, tuple) and hasattr(value, "_fields")
    return is_record or isinstance(value, (Kernel, BuiltinFunctionType, *CONSTANTS))


def test_kernels_read_nothing_that_their_description_omits():
    """A plain function, a nested one and a value of another module would change machine code
    unnoticed.
    """
    known = list_kernels()
    assert len(known) > 75
    for name, kernel in known.items():
        code = kernel.function.__code__
        assert not any(isinstance(value, CodeType) for value in code.co_consts), name
        assert not code.co_freevars, name
        for used in code.co_names:
            value = kernel.function.__globals__.get(used, 0)
            assert is_described(value), f"{name} reads {used}"


def test_a_changed_callee_changes_the_description(monkeypatch):
    assert stages.advance in riccati.recur_forward.callees.values()
    before = describe_kernel(riccati.recur_forward)

    def advance(v: float, a: float, j: float, h: float) -> tuple[float, float]:
        return v + h * (a + h * j / 2), a

    monkeypatch.setattr(stages.advance, "function", advance)
    assert describe_kernel(riccati.recur_forward) != before


def test_the_order_of_a_record_changes_the_description(monkeypatch):
    """Two arrays of one type change places: the types of arguments stay the same."""
    before = describe_kernel(kkt.linearize)
    first, second, *others = kkt.Iterate.__annotations__.items()
    assert first[1] == second[1]
    monkeypatch.setattr(kkt.Iterate, "__annotations__", dict([second, first, *others]))
    assert describe_kernel(kkt.linearize) != before


@pytest.mark.parametrize("value", [2e-9, np.float64(1e-9) * (1 + 1e-15), np.array([1e-9])])
def test_a_changed_constant_changes_the_description(monkeypatch, value):
    before = describe_kernel(riccati.solve_newton)
    monkeypatch.setattr(riccati, "MIN_CURVATURE", value)
    assert describe_kernel(riccati.solve_newton) != before


@pytest.mark.parametrize("annotation", ["Floats2", "int"])
def test_a_changed_type_changes_the_description(monkeypatch, annotation):
    before = describe_kernel(stages.advance)
    monkeypatch.setitem(
        stages.advance.function.__annotations__, "v", getattr(kernels, annotation, int)
    )
    assert describe_kernel(stages.advance) != before


def test_a_module_in_a_kernel_is_refused():
    """A change of its constant would leave the description as it is; those of numpy come with its
    version.
    """

    @kernels.kernel
    def scale(x: float) -> float:
        return x * riccati.MIN_CURVATURE * np.pi * math.e

    with pytest.raises(
        TypeError, match=r"reads planner\.timing\.order3\.riccati as a module: import .* by name"
    ):
        describe_kernel(scale)
    with pytest.raises(TypeError, match="as a module"):
        scale(1.0)


def test_a_description_does_not_depend_on_the_process():
    code = "from kinematics.foundation.kernels import describe_kernel; from planner.timing.order3 import riccati;"
    code += "print(repr(describe_kernel(riccati.solve_newton)))"
    texts = {
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout
        for _ in range(2)
    }
    assert len(texts) == 1
