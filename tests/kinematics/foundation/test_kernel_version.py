"""The version of the compiled kernels changes with their sources: else old machine code would run."""

import ast
import inspect
import textwrap
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from types import FunctionType
from typing import get_type_hints

import numpy as np
import pytest

from kinematics.foundation import kernels
from kinematics.foundation.kernels import Kernel, find_type
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


def describe_source(function):
    """Return the source without comments, docstring and layout."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    body = tree.body[0].body
    if isinstance(body[0], ast.Expr) and isinstance(body[0].value, ast.Constant):
        del body[0]
    return ast.unparse(tree)


def describe_constants(function):
    """Return the values of the global names that a function reads, except functions and modules."""
    for name in function.__code__.co_names:
        value = function.__globals__.get(name)
        if isinstance(value, np.ndarray):
            yield f"{name} = {value.tolist()}"
        elif isinstance(value, (bool, int, float, str, tuple)):
            yield f"{name} = {value!r}"


def describe_record(kind):
    """Yield the fields of a record in their order, by which machine code reads them, and of records in it."""
    hints = get_type_hints(kind, include_extras=True)
    yield f"{kind.__qualname__}: {list(hints)}"
    for hint in hints.values():
        if is_record(hint):
            yield from describe_record(hint)


def is_record(hint):
    return isinstance(hint, type) and issubclass(hint, tuple) and hasattr(hint, "_fields")


def describe(kernel):
    """Return all that enters the machine code of a kernel, except its callees."""
    function = kernel.function
    hints = get_type_hints(function, include_extras=True)
    types = [str(find_type(hint)) for name, hint in hints.items() if name != "return"]
    made = [function.__globals__.get(name) for name in function.__code__.co_names]
    records = [line for hint in (*hints.values(), *made) if is_record(hint) for line in describe_record(hint)]
    return "\n".join([describe_source(function), *types, *records, *describe_constants(function)])


def compute_version():
    parts = [f"{name}\n{describe(kernel)}" for name, kernel in sorted(list_kernels().items())]
    parts.append(describe_source(kernels._decorate))  # the options of the compiler
    return sha256("\n".join(parts).encode()).hexdigest()[:16]


def test_the_version_is_that_of_the_sources():
    version = compute_version()
    assert version == kernels.VERSION, (
        f"a kernel has changed: write VERSION = {version!r} in kinematics/foundation/kernels.py"
    )


def test_every_kernel_calls_kernels_that_the_version_covers():
    """A plain function or a kernel of another package would change machine code unnoticed."""
    known = list_kernels()
    assert len(known) > 80
    for name, kernel in known.items():
        for callee in kernel.callees.values():
            assert f"{callee.function.__module__}.{callee.function.__name__}" in known, name
        for used in kernel.function.__code__.co_names:
            value = kernel.function.__globals__.get(used)
            assert not isinstance(value, FunctionType), f"{name} calls {used}, which is no kernel"


def test_a_changed_callee_changes_the_version(monkeypatch):
    assert stages.advance in riccati.recur_forward.callees.values()

    def advance(v: float, a: float, j: float, h: float) -> tuple[float, float]:
        return v + h * (a + h * j / 2), a

    monkeypatch.setattr(stages.advance, "function", advance)
    assert compute_version() != kernels.VERSION


def test_the_order_of_a_record_changes_the_version(monkeypatch):
    """Two arrays of one type change places: the types of arguments stay the same."""
    first, second, *others = kkt.Iterate.__annotations__.items()
    assert first[1] == second[1]
    monkeypatch.setattr(kkt.Iterate, "__annotations__", dict([second, first, *others]))
    assert compute_version() != kernels.VERSION


@pytest.mark.parametrize("value", [2e-9, np.float64(1e-9) * (1 + 1e-15)])
def test_a_changed_constant_changes_the_version(monkeypatch, value):
    monkeypatch.setattr(riccati, "MIN_CURVATURE", value)
    assert compute_version() != kernels.VERSION
