"""Compiled kernels and tapes: CasADi's own values to the last bit, and what is said while they are compiled."""

import os
import subprocess
import sys
from time import sleep

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics.foundation import kernels
from kinematics.foundation.casadi_function import Expression
from kinematics.foundation.tape import BLOCK, make_tape, run_tape
from kinematics.foundation.taylor_model import Series

UNARY = {
    "sin": ca.sin,
    "cos": ca.cos,
    "sqrt": ca.sqrt,
    "exp": ca.exp,
    "log": ca.log,
    "fabs": ca.fabs,
    "sign": ca.sign,
    "square": lambda a: a**2,
    "negative": lambda a: -a,
    "inverse": lambda a: 1 / a,
    "twice": lambda a: 2 * a,
}
BINARY = {
    "add": lambda a, b: a + b,
    "subtract": lambda a, b: a - b,
    "multiply": lambda a, b: a * b,
    "divide": lambda a, b: a / b,
    "atan2": ca.atan2,
}
STEPS = st.lists(
    st.tuples(st.sampled_from([*UNARY, *BINARY]), st.integers(0, 99), st.integers(0, 99)), min_size=1, max_size=30
)


def run(function, x):
    tape = make_tape(function)
    assert tape is not None
    out = np.empty((len(x), function.size1_out(0)))
    run_tape(tape, x, out)
    return out


@settings(max_examples=60, deadline=None)
@given(STEPS, st.integers(0, 2**32), st.sampled_from([1, BLOCK - 1, BLOCK, 2 * BLOCK + 5]))
def test_a_tape_gives_casadis_values(steps, seed, count):
    """Of random expressions, NaN and infinities among them, whatever the number of points."""
    x = ca.SX.sym("x", 3)
    values = [*ca.vertsplit(x), ca.SX(0.25)]
    for name, first, second in steps:
        a, b = values[first % len(values)], values[second % len(values)]
        values.append(UNARY[name](a) if name in UNARY else BINARY[name](a, b))
    function = ca.Function("f", [x], [ca.densify(ca.vertcat(*values[-5:]))], {"cse": True})
    points = np.random.default_rng(seed).normal(size=(count, 3))
    with np.errstate(all="ignore"):
        expected = np.array(function.map(count)(points.T)).T
        assert np.array_equal(run(function, points), expected, equal_nan=True)


def test_an_operation_that_no_tape_knows_is_left_to_casadi():
    x = ca.SX.sym("x", 1)
    assert make_tape(ca.Function("f", [x], [ca.erf(x)])) is None
    points = np.linspace(0, 1, 40_000)[:, None]
    values = Expression("f", x, ca.erf(x))(points)
    assert values[-1, 0] == pytest.approx(0.8427007929497149, rel=1e-12)


def enclosed(expression, degrees, error, cells, order, seed):
    """Series by the tape and by Python, padded alike."""
    rng = np.random.default_rng(seed)
    inputs = [
        Series(rng.normal(size=(d + 1, cells)), np.abs(error * rng.normal(size=(d + 1, cells))), order) for d in degrees
    ]
    found = expression.enclose(inputs)
    with np.errstate(all="ignore"):
        expected = expression.walk(inputs, lambda value: Series.constant(np.array([value]), order))
    for ours, theirs in zip(found, expected, strict=True):
        full = theirs.pad(order)
        yield ours, Series(np.broadcast_to(full.mid, ours.mid.shape), np.broadcast_to(full.rad, ours.rad.shape), order)


@settings(max_examples=60, deadline=None)
@given(STEPS, st.integers(0, 2**32), st.sampled_from([8, 31, 70]), st.integers(0, 5), st.sampled_from([0.0, 1e-3]))
def test_a_taylor_tape_gives_the_balls_of_series(steps, seed, cells, order, error):
    """To the last bit, of random expressions, unbounded where these are."""
    x = ca.SX.sym("x", 3)
    values = [*ca.vertsplit(x), ca.SX(0.25)]
    for name, first, second in steps:
        if name not in ("exp", "log", "sin", "cos", "atan2"):
            a, b = values[first % len(values)], values[second % len(values)]
            values.append(UNARY[name](a) if name in UNARY else BINARY[name](a, b))
    expression = Expression("f", x, ca.vertcat(*values[-5:]))
    degrees = np.random.default_rng(seed).integers(0, order + 1, 3)
    for ours, theirs in enclosed(expression, degrees, error, cells, order, seed):
        bounded = np.isfinite(theirs.rad)
        assert np.array_equal(bounded, np.isfinite(ours.rad))
        assert np.array_equal(ours.mid[bounded], theirs.mid[bounded], equal_nan=True)
        assert np.array_equal(ours.rad[bounded], theirs.rad[bounded])


@pytest.mark.parametrize("cells", [3, 40])
def test_columns_side_by_side_are_enclosed_as_each_by_itself(cells):
    """By the tape and without it, of inputs of several degrees, some of them constant."""
    x = ca.SX.sym("x", 4)
    expression = Expression("f", x, ca.vertcat(x[0] * x[1] + x[3], ca.sqrt(9 + x[2] * x[3]), 2.0, x[2] / (4 + x[0])))
    rng = np.random.default_rng(cells)
    wide = Series(rng.uniform(-1, 1, (4, cells, 2)), 1e-9 * rng.uniform(size=(4, cells, 2)), 5)
    flat = Series.constant(rng.uniform(-1, 1, (cells, 2)), 3)
    found = expression.enclose_columns(wide, flat)
    assert found.mid.shape == (4, cells, 4)
    columns = [part[:, k].cut(3) for part in (wide, flat) for k in range(2)]
    for k, each in enumerate(expression.enclose(columns)):
        one = each.pad(3)
        assert (np.abs(found.mid[:, :, k] - one.mid) <= 1e-15).all()
        assert (found.rad[:, :, k] <= one.rad * (1 + 1e-9) + 1e-15).all()
        assert (found.rad[:, :, k] >= one.rad * (1 - 1e-6) - 1e-14).all()


@pytest.mark.parametrize("name", ["sin", "cos", "atan2"])
@pytest.mark.parametrize("error", [0.0, 1e-3, 1.0])
@pytest.mark.parametrize("order", [0, 1, 6])
def test_taylor_tapes_of_angles_are_those_of_series(name, error, order):
    """Of another library's sines, two units in the last place apart at most."""
    x = ca.SX.sym("x", 2)
    expression = Expression("f", x, UNARY[name](x[0]) if name in UNARY else BINARY[name](x[0], x[1]))
    for degrees in ((order, order), (0, order), (0, 0)):
        for ours, theirs in enclosed(expression, degrees, error, 500, order, 7):
            bounded = np.isfinite(theirs.rad)
            assert np.array_equal(bounded, np.isfinite(ours.rad))
            size = np.abs(theirs.mid).max(0) * np.ones_like(theirs.mid) + theirs.rad
            assert (np.abs(ours.mid - theirs.mid)[bounded] <= 1e-14 * size[bounded]).all()
            assert np.allclose(ours.rad[bounded], theirs.rad[bounded], rtol=1e-9, atol=0)


def test_large_batches_give_the_values_of_small_ones():
    """Whether the tape or CasADi runs them is decided by size alone."""
    x = ca.SX.sym("x", 2)
    both = Expression("f", x, ca.vertcat(ca.sin(x[0]) * x[1], ca.sqrt(x[0] ** 2 + x[1] ** 2)))
    points = np.random.default_rng(1).normal(size=(40_000, 2))
    run(both.function, points[:2])  # the compiler is loaded
    assert np.array_equal(both(points)[::997], np.concatenate([both(point[None]) for point in points[::997]]))


def test_a_first_call_that_takes_long_is_announced_once(monkeypatch, caplog):
    monkeypatch.setattr(kernels, "PATIENCE", 0.0)
    monkeypatch.setattr(kernels, "_keep", lambda _: None)  # what is on disk may be there before anything is said
    kernels._announce.cache_clear()

    @kernels.Kernel
    def double(x):
        return 2 * x

    monkeypatch.setattr(sys.modules[__name__], "double", double, raising=False)
    with caplog.at_level("WARNING", "pulsepath"):
        assert double(3) == 6
        assert double(4) == 8
    assert [record.message.split(":")[0] for record in caplog.records] == ["compiling numerical kernels"]


def test_a_kernel_that_is_on_disk_is_not_said_to_be_compiling(monkeypatch, caplog):
    """However long a busy computer takes to load it."""
    monkeypatch.setattr(kernels, "PATIENCE", 0.01)
    kernels._announce.cache_clear()
    store = kernels._Store.__new__(kernels._Store)

    def load(signature, context):
        sleep(0.1)
        return "found"

    monkeypatch.setattr(store, "_read", load, raising=False)
    monkeypatch.setattr(store, "_function", load, raising=False)

    def work():
        return store.load_overload(None, None)

    with caplog.at_level("WARNING", "pulsepath"):
        assert kernels._run_in_thread(work, ()) == "found"
    assert caplog.records == []
    monkeypatch.setattr(store, "_read", lambda *_: None)

    def compile_slowly():
        store.load_overload(None, None)
        sleep(0.1)

    with caplog.at_level("WARNING", "pulsepath"):
        kernels._run_in_thread(compile_slowly, ())
    assert [record.message.split(":")[0] for record in caplog.records] == ["compiling numerical kernels"]


def test_a_process_that_another_started_leaves_it_to_that(monkeypatch, caplog):
    monkeypatch.setattr(kernels, "parent_process", lambda: "one")
    kernels._announce.cache_clear()
    with caplog.at_level("WARNING", "pulsepath"):
        kernels._announce()
    kernels._announce.cache_clear()
    assert caplog.records == []


def test_what_does_not_plan_does_not_load_the_compiler():
    code = (
        "import sys, pulsepath.cli, kinematics, planner; kinematics.load_machine('hexapod');"
        "print('numba' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


SIGNATURES = """
import sys
import pulsepath as pp
from numba.core.types import unliteral

plan = pp.plan("circle", "hexapod")
plan.bound, plan.pulses
for name, module in sorted(sys.modules.items()):
    for kernel in list(vars(module).values()) if name.startswith(("kinematics.", "planner.")) else ():
        if hasattr(kernel, "py_func") and kernel.py_func.__module__ == name:
            signatures = {tuple(map(unliteral, types)) for types in kernel.signatures}
            print(name, kernel.py_func.__name__, len(signatures))
"""
"""Prints each kernel with the number of its signatures; a constant among the arguments counts as its type."""


def test_a_plan_compiles_each_kernel_once(tmp_path):
    """The first plan of a user waits for each signature: array layouts and integer types must not differ."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}  # what is on disk hides inner kernels
    code = [sys.executable, "-c", SIGNATURES]
    done = subprocess.run(code, capture_output=True, text=True, check=True, env=environment)
    counts = {tuple(line.split()[:2]): int(line.split()[2]) for line in done.stdout.splitlines()}
    assert counts["planner.certificate.ranges", "bound_motion"] == 1
    assert counts["kinematics.foundation.taylor_tape", "_multiply"] == 1
    assert {kernel: count for kernel, count in counts.items() if count > 1} == {}


TINY = """
import os, sys, threading, time
from kinematics.foundation.kernels import kernel
from constants import SCALE

@kernel
def scale(x):
    return SCALE * x

if __name__ == "__main__":
    if "fork" in sys.argv:
        import numba
        thread = threading.Thread(target=scale, args=(1.0,))
        thread.start()
        time.sleep(0.02)
        child = os.fork()
        if child == 0:
            os._exit(int(scale(2.0)))
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
        thread.join()
    if "full" in sys.argv:
        import pathlib
        def fail(*_): raise OSError(28, "No space left on device")
        pathlib.Path.write_bytes = fail
    print(scale(1.0), len(scale.stats.cache_hits))
"""


@pytest.fixture
def tiny(tmp_path):
    """Runs one small kernel in a process of its own, with its own cache."""

    def call(*arguments, scale=3, timeout=60):
        (tmp_path / "tiny.py").write_text(TINY)
        (tmp_path / "constants.py").write_text(f"SCALE = {scale}.0\n")
        roots = os.pathsep.join([str(tmp_path), os.getcwd()])  # noqa: PTH109
        environment = os.environ | {"PYTHONPATH": roots, "NUMBA_CACHE_DIR": str(tmp_path / "kept")}
        environment |= {"PYTHONDONTWRITEBYTECODE": "1"}
        environment.pop("NUMBA_DISABLE_JIT", None)
        return subprocess.run(
            [sys.executable, tmp_path / "tiny.py", *arguments],
            env=environment,
            capture_output=True,
            text=True,
            timeout=timeout,
            check=True,
        )

    return call


def test_a_constant_of_another_file_is_compiled_anew(tiny):
    assert [tiny(scale=value).stdout for value in (3, 3, 4, 3)] == ["3.0 0\n", "3.0 1\n", "4.0 0\n", "3.0 1\n"]


@pytest.mark.parametrize("length", [0, 40, -1])
def test_a_damaged_file_is_replaced(tiny, tmp_path, length):
    tiny()
    (kept,) = (tmp_path / "kept").rglob("*scale*.*")
    kept.write_bytes(kept.read_bytes()[:length])
    assert [tiny().stdout for _ in range(2)] == ["3.0 0\n", "3.0 1\n"]


def test_a_full_disk_loses_what_was_compiled_and_says_so(tiny):
    done = tiny("full")
    assert done.stdout == "3.0 0\n"
    assert "No space left" in done.stderr
    assert "NUMBA_CACHE_DIR" in done.stderr


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork there")
def test_a_fork_waits_for_the_compiler(tiny):
    assert tiny("fork").stdout.splitlines()[0] == "6"


def test_files_of_a_kernel_are_bounded(tmp_path, monkeypatch):
    for number in range(5):
        (tmp_path / f"tiny.scale-{number}.kernel").touch()
        os.utime(tmp_path / f"tiny.scale-{number}.kernel", (number, number))
    monkeypatch.setattr(kernels, "KEPT", 2)
    store = object.__new__(kernels._Store)
    store.cache_path, store._name = str(tmp_path), "tiny.scale"
    store._clear()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["tiny.scale-3.kernel", "tiny.scale-4.kernel"]


def test_what_cannot_be_kept_is_not_said_to_be(monkeypatch, caplog):
    monkeypatch.setattr(kernels, "_LOST", ["read-only"])
    kernels._announce.cache_clear()
    with caplog.at_level("WARNING", "pulsepath"):
        kernels._announce()
    kernels._announce.cache_clear()
    assert "later runs find" not in caplog.text
    assert "NUMBA_CACHE_DIR" in caplog.text
