"""Compiled kernels and tapes: CasADi's own values to the last bit, and what is said while they are
compiled.
"""

import importlib
import os
import subprocess
import sys
from collections import Counter
from functools import cache

import casadi as ca
import numba  # tapes serve where the compiler is loaded
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba.core import event

from kinematics.foundation import casadi_function, kernels
from kinematics.foundation.casadi_function import FEW_CELLS, Expression, enclose_without_compiler
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
    st.tuples(st.sampled_from([*UNARY, *BINARY]), st.integers(0, 99), st.integers(0, 99)),
    min_size=1,
    max_size=30,
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
        Series(
            rng.normal(size=(d + 1, cells)), np.abs(error * rng.normal(size=(d + 1, cells))), order
        )
        for d in degrees
    ]
    found = expression.enclose(inputs)
    with np.errstate(all="ignore"):
        expected = expression.walk(inputs, lambda value: Series.constant(np.array([value]), order))
    for ours, theirs in zip(found, expected, strict=True):
        full = theirs.pad(order)
        yield (
            ours,
            Series(
                np.broadcast_to(full.mid, ours.mid.shape),
                np.broadcast_to(full.rad, ours.rad.shape),
                order,
            ),
        )


@settings(max_examples=60, deadline=None)
@given(
    STEPS,
    st.integers(0, 2**32),
    st.sampled_from([1, 8, 31, 70]),
    st.integers(0, 5),
    st.sampled_from([0.0, 1e-3]),
)
def test_a_taylor_tape_gives_the_balls_of_series(steps, seed, cells, order, error):
    """To the last bit, of random expressions, unbounded where these are."""
    x = ca.SX.sym("x", 3)
    values = [*ca.vertsplit(x), ca.SX(0.25)]
    for name, first, second in steps:
        if name not in ("exp", "log"):
            a, b = values[first % len(values)], values[second % len(values)]
            values.append(UNARY[name](a) if name in UNARY else BINARY[name](a, b))
    expression = Expression("f", x, ca.vertcat(*values[-5:]))
    degrees = np.random.default_rng(seed).integers(0, order + 1, 3)
    for ours, theirs in enclosed(expression, degrees, error, cells, order, seed):
        assert_same_balls(ours, theirs)


def assert_same_balls(ours, theirs):
    """Assert that both are bounded alike, and the same to the last bit there."""
    bounded = np.isfinite(theirs.rad) & np.isfinite(theirs.mid)
    assert np.array_equal(bounded, np.isfinite(ours.rad) & np.isfinite(ours.mid))
    assert np.array_equal(ours.mid[bounded], theirs.mid[bounded])
    assert np.array_equal(ours.rad[bounded], theirs.rad[bounded])


@pytest.mark.parametrize("name", ["sin", "cos", "atan2"])
@pytest.mark.parametrize("error", [0.0, 1e-3, 1.0])
@pytest.mark.parametrize("order", [0, 1, 6, 12])
@pytest.mark.parametrize("cells", [1, 500])
def test_taylor_tapes_of_angles_are_those_of_series(name, error, order, cells):
    """numpy's own sines would be another library's; sums of many terms have one order for any
    number of cells.
    """
    x = ca.SX.sym("x", 2)
    expression = Expression(
        "f", x, UNARY[name](x[0]) if name in UNARY else BINARY[name](x[0], x[1])
    )
    for degrees in ((order, order), (0, order), (0, 0)):
        for ours, theirs in enclosed(expression, degrees, error, cells, order, 7):
            assert_same_balls(ours, theirs)


@pytest.mark.parametrize("order", [0, 1, 5, 12])
@pytest.mark.parametrize("cells", [1, FEW_CELLS - 1])
def test_few_cells_have_the_same_balls_without_the_compiler(cells, order):
    """To the last bit, of columns of several degrees, some of them zero: processes differ in what
    they have loaded.
    """
    x = ca.SX.sym("x", 4)
    turned = [ca.sin(x[2]) * x[0], ca.cos(x[1]) / (3 + x[2]), ca.atan2(x[3], 2 + x[1])]
    values = [
        x[0] * x[2],
        x[1] * x[2],
        x[1] * x[3] - x[2],
        ca.sqrt(3 + x[2] * x[2]),
        *turned,
        ca.exp(x[1]),
        2.0,
    ]
    rng = np.random.default_rng(cells)
    wide = Series(
        rng.uniform(-1, 1, (order + 1, cells, 3)),
        1e-9 * rng.uniform(size=(order + 1, cells, 3)),
        order,
    )
    wide.mid[:, :, 0] = wide.rad[:, :, 0] = 0.0
    wide.mid[1:, :, 1] = wide.rad[1:, :, 1] = 0.0
    constant = Series.constant(rng.uniform(-1, 1, (cells, 1)), order)
    for several in (values, values[:-2]):  # no tape knows an exponential
        expression = Expression("f", x, ca.vertcat(*several))
        compiled, walked = (
            enclose_as(expression, loaded, wide, constant) for loaded in (True, False)
        )
        assert np.isfinite(compiled.rad).all()
        assert_same_balls(compiled.pad(order), walked.pad(order))


def enclose_as(expression, is_loaded, *columns):
    """Enclose in a process that has loaded the compiler, or has not."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(casadi_function, "compiler_is_loaded", lambda: is_loaded)
        return expression.enclose_columns(*columns)


def test_what_encloses_depends_on_the_work_alone(monkeypatch):
    """Many cells are never enclosed as the process happens to have loaded: their radii may
    differ.
    """
    x = ca.SX.sym("x", 1)
    expression = Expression("f", x, ca.sqrt(2 + x))
    operations = expression.function.n_instructions()
    taped = []
    monkeypatch.setattr(casadi_function, "enclose_tape", lambda *_: taped.append(1))

    def count_tapes(cells, is_loaded):
        taped.clear()
        monkeypatch.setattr(casadi_function, "compiler_is_loaded", lambda: is_loaded)
        expression.enclose([Series.constant(np.ones(cells), 2)])
        return len(taped)

    much = int(casadi_function.MUCH_WORK / operations) + 1
    for is_loaded in (False, True):
        assert [count_tapes(cells, is_loaded) for cells in (FEW_CELLS, much)] == [1, 1]
        with enclose_without_compiler():
            assert [count_tapes(cells, is_loaded) for cells in (1, FEW_CELLS, much)] == [0, 0, 1]
    assert [count_tapes(1, is_loaded) for is_loaded in (False, True)] == [0, 1]


def test_large_batches_give_the_values_of_small_ones():
    """Whether the tape or CasADi runs them is decided by size alone."""
    x = ca.SX.sym("x", 2)
    both = Expression("f", x, ca.vertcat(ca.sin(x[0]) * x[1], ca.sqrt(x[0] ** 2 + x[1] ** 2)))
    points = np.random.default_rng(1).normal(size=(40_000, 2))
    run(both.function, points[:2])  # the compiler is loaded
    assert np.array_equal(
        both(points)[::997], np.concatenate([both(point[None]) for point in points[::997]])
    )


TINY = """
from kinematics.foundation.kernels import Floats1, kernel

@kernel
def scale(x: Floats1, factor: float) -> float:
    total = 0.0
    for k in range(len(x)):
        x[k] *= factor
        total += x[k]
    return total

@kernel
def scale_twice(x: Floats1) -> float:
    scale(x, 3.0)
    return scale(x, 1.0)

@kernel
def scale_thrice(x: Floats1) -> float:
    return scale(x, 2.0) + scale(x, 3.0) + scale(x, 4.0)
"""
"""A module with three kernels, of which two call the first."""

SCALED = 6.0, 3.0, 3.0


@pytest.fixture
def load_tiny(tmp_path, monkeypatch):
    """Import the small kernels anew, as a new process does, with a folder of its own for machine
    code.
    """
    (tmp_path / "tiny.py").write_text(TINY)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "stored"))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    monkeypatch.setattr(numba.config, "DISABLE_JIT", 0)
    monkeypatch.setattr(kernels, "find_folder", kernels.find_folder.__wrapped__)
    monkeypatch.setattr(kernels, "_LOST", [])
    for report in ("_announce", "_report_lost"):
        monkeypatch.setattr(kernels, report, cache(getattr(kernels, report).__wrapped__))

    def load():
        forget_tiny()
        return importlib.import_module("tiny")

    yield load
    forget_tiny()


def forget_tiny():
    for name in ("tiny", "base"):
        sys.modules.pop(name, None)


def call_twice(tiny):
    """Return what `scale_twice` returns, and what it makes of its array."""
    x = np.ones(2)
    total = tiny.scale_twice(x)
    return total, *x


def count_loaded(tiny):
    """Count the signatures of `scale_twice` that came from disk."""
    return sum(tiny.scale_twice.compiled.stats.cache_hits.values())


@pytest.fixture
def run_tiny(tmp_path):
    """Run code with the small kernels in a process, with a folder of its own for machine code."""
    (tmp_path / "tiny.py").write_text(TINY)
    roots = os.pathsep.join([str(tmp_path), os.getcwd()])  # noqa: PTH109
    environment = os.environ | {
        "PYTHONPATH": roots,
        "NUMBA_CACHE_DIR": str(tmp_path / "stored"),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    environment.pop("NUMBA_DISABLE_JIT", None)

    def start(code):
        code = "import os, sys, threading, time\nimport numpy as np, tiny\n" + code
        return subprocess.Popen(
            [sys.executable, "-c", code], env=environment, stdout=subprocess.PIPE, text=True
        )

    return start


def stored(folder, suffix):
    return sorted((folder / "stored").rglob(f"*{suffix}"))


def test_a_kernel_is_stored_and_contains_those_that_it_calls(load_tiny, tmp_path):
    for loaded in (0, 1):
        tiny = load_tiny()
        assert call_twice(tiny) == SCALED
        assert count_loaded(tiny) == loaded
    names = [path.name.partition("-")[0] for path in stored(tmp_path, ".nbc")]
    assert names == ["tiny.scale_twice"]


def test_a_change_of_a_callee_in_another_file_is_seen(load_tiny, tmp_path):
    """numba alone looks at the file of the kernel that is called."""
    base, caller = TINY.split("@kernel\ndef scale_twice")
    head = "from kinematics.foundation.kernels import Floats1, kernel\nfrom base import scale\n\n"
    (tmp_path / "tiny.py").write_text(f"{head}@kernel\ndef scale_twice{caller}")
    changed = base.replace("total = 0.0", "total = 1.0")
    results = []
    for text, runs in ((base, 1), (changed, 2), (base, 1)):
        (tmp_path / "base.py").write_text(text)
        for _ in range(runs):
            tiny = load_tiny()
            results.append((*call_twice(tiny), count_loaded(tiny)))
    new = 7.0, 3.0, 3.0
    assert results == [(*SCALED, 0), (*new, 0), (*new, 1), (*SCALED, 1)]


def test_another_setting_of_the_compiler_uses_another_folder(load_tiny, monkeypatch):
    folder = kernels.find_kernel_folder(load_tiny().scale)
    assert folder == kernels.find_kernel_folder(load_tiny().scale)
    monkeypatch.setenv("NUMBA_OPT", "1")
    assert folder != kernels.find_kernel_folder(load_tiny().scale)


def test_a_damaged_file_is_replaced(load_tiny, tmp_path):
    """Files that were cut off, each of which is loaded twice."""
    call_twice(load_tiny())
    for suffix in ("nbi", "nbc"):
        for length in (0, 40, -1):
            (path,) = stored(tmp_path, suffix)
            path.write_bytes(path.read_bytes()[:length])
            for loaded in (0, 1):
                tiny = load_tiny()
                assert call_twice(tiny) == SCALED
                assert count_loaded(tiny) == loaded


def test_a_full_disk_loses_what_was_compiled_and_reports_it(load_tiny, monkeypatch, caplog):
    def fail(*_):
        raise OSError(28, "No space left on device")

    tiny = load_tiny()
    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", fail)
        assert call_twice(tiny) == SCALED
    assert count_loaded(tiny) == 0
    assert caplog.text.count("No space left") == 1
    assert "NUMBA_CACHE_DIR" in caplog.text


def test_a_folder_that_cannot_be_written_is_left_alone(load_tiny, tmp_path, monkeypatch, caplog):
    """Also where numba would then store beside the source, whatever callees there were."""
    (tmp_path / "stored").write_text("a file")
    monkeypatch.setattr(kernels, "PATIENCE", 0.0)
    monkeypatch.setattr(kernels, "LOOK", 0.001)
    assert call_twice(load_tiny()) == SCALED
    assert "every run" in caplog.text
    assert "NUMBA_CACHE_DIR" in caplog.text
    assert not list(tmp_path.rglob("*.nbi"))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork there")
def test_a_fork_waits_for_the_compiler(run_tiny):
    code = """
import numba
thread = threading.Thread(target=tiny.scale_twice, args=(np.ones(1),))
thread.start()
time.sleep(0.02)
child = os.fork()
if child == 0:
    os._exit(int(tiny.scale_twice(np.ones(2))))
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
thread.join()
"""
    assert run_tiny(code).communicate()[0] == "6\n"


def test_processes_that_store_at_once_agree(run_tiny, load_tiny, tmp_path):
    runs = [run_tiny("print(tiny.scale_twice(np.ones(2)))") for _ in range(2)]
    assert [run.communicate()[0] for run in runs] == ["6.0\n", "6.0\n"]
    assert len(stored(tmp_path, ".nbc")) == 1
    tiny = load_tiny()
    assert call_twice(tiny) == SCALED
    assert count_loaded(tiny) == 1


def test_arrays_of_another_type_are_copied_and_written_back_or_refused(load_tiny):
    scale = load_tiny().scale
    wide, whole, fixed = np.ones((2, 2)), np.ones(2, int), np.ones(2)
    fixed.flags.writeable = False
    assert (scale(wide[:, 0], 3), *wide.ravel()) == (6, 3, 1, 3, 1)
    assert (scale(whole, 2.0), *whole) == (4, 2, 2)
    assert (scale(fixed, 2.0), *fixed) == (4, 1, 1)
    assert len(scale.compiled.signatures) == 1
    for refused, reason in (
        (wide, "of 1 dimensions, not 2"),
        (np.ones(2, complex), "of float64, not complex128"),
        ([1.0, 2.0], "of float64, not <class 'list'>"),
    ):
        with pytest.raises(TypeError, match=f"^a kernel takes an array {reason}$"):
            scale(refused, 2.0)


def test_nothing_is_stored_for_a_user_without_a_home_directory(monkeypatch):
    def fail():
        raise RuntimeError("Could not determine home directory.")

    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(kernels.Path, "home", fail)
    monkeypatch.setattr(kernels, "_LOST", [])
    assert kernels.find_folder.__wrapped__() is None
    assert kernels._LOST == ["Could not determine home directory."]


def test_a_kernel_runs_as_python_where_compiling_is_disabled(load_tiny, monkeypatch):
    monkeypatch.setattr(numba.config, "DISABLE_JIT", 1)
    tiny = load_tiny()
    assert call_twice(tiny) == SCALED
    assert tiny.scale_twice.compiled is tiny.scale_twice.function


def test_little_work_does_not_load_the_compiler(run_tiny):
    code = "from kinematics.foundation.kernels import call_light\n"
    code += "print(call_light(tiny.scale_twice, np.ones(2)), 'numba' in sys.modules)"
    assert run_tiny(code).communicate()[0] == "6.0 False\n"


def test_compiling_is_announced_once_and_loading_is_not(load_tiny, monkeypatch, caplog):
    monkeypatch.setattr(kernels, "PATIENCE", 0.001)
    monkeypatch.setattr(kernels, "LOOK", 0.001)
    for announcements in (1, 0):
        caplog.clear()
        kernels._announce.cache_clear()
        tiny = load_tiny()
        tiny.scale_twice(np.ones(2))
        tiny.scale(np.ones(2), 1.0)
        assert caplog.text.count("compiling numerical kernels") == announcements
        assert count_loaded(tiny) == 1 - announcements


def test_kernels_are_compiled_ahead(load_tiny):
    names = ["tiny:scale", "tiny:scale_twice"]
    for is_stored in (False, True):
        tiny = load_tiny()
        assert kernels.are_stored(names) == is_stored
        kernels.compile_kernels(names)
        assert kernels.are_stored(names)
        assert count_loaded(tiny) == is_stored


def test_a_process_that_another_started_leaves_the_announcement_to_it(monkeypatch, caplog):
    monkeypatch.setattr(kernels, "parent_process", lambda: "one")
    kernels._announce.cache_clear()
    with caplog.at_level("WARNING", "pulsepath"):
        kernels._announce()
    kernels._announce.cache_clear()
    assert caplog.records == []


def test_machine_code_of_a_few_states_of_a_kernel_is_retained(load_tiny, tmp_path, monkeypatch):
    monkeypatch.setattr(kernels, "MOST_FOLDERS", 1)
    for number in range(3):
        (tmp_path / "tiny.py").write_text(TINY + f"# {number}\n")
        call_twice(load_tiny())
    assert len(stored(tmp_path, ".nbc")) == 2  # one, and the one that was compiled last


def test_the_folders_used_last_are_retained(tmp_path, monkeypatch):
    for number in range(5):
        folder = tmp_path / f"pulsepath-kernels-{number}"
        folder.mkdir()
        (folder / "file").touch()
        os.utime(folder, (number, number))
    (tmp_path / "other").mkdir()
    monkeypatch.setattr(kernels, "MOST_FOLDERS", 2)
    kernels._remove_old_folders(tmp_path, "pulsepath-kernels-*")
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["other", "pulsepath-kernels-3", "pulsepath-kernels-4"]


def test_what_does_not_plan_does_not_load_the_compiler():
    code = (
        "import sys, pulsepath.cli, kinematics, planner; kinematics.load_machine('hexapod');"
        "print('numba' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


COMPILED = """
import sys
from kinematics.foundation.kernels import Kernel
import pulsepath as pp

def find_kernels():
    ours = [name for name in sys.modules if name.startswith(("kinematics.", "planner."))]
    values = [value for name in ours for value in vars(sys.modules[name]).values()]
    return {value for value in values if isinstance(value, Kernel)}

def list_callees(kernel):
    for callee in kernel.callees.values():
        yield callee
        yield from list_callees(callee)

copied = []
original = Kernel.call_with_copies

def call_with_copies(self, arguments):
    copied.append(self.__name__)
    return original(self, arguments)

Kernel.call_with_copies = call_with_copies
plan = pp.plan("circle", "hexapod")
early = [kernel.__module__ for kernel in find_kernels() if kernel.compiled is not None]
print("bound", *[module for module in early if module.startswith("planner.bounds")])
plan.bound, plan.pulses
roots = {kernel for kernel in find_kernels() if kernel.compiled is not None}
callees = {callee for kernel in roots for callee in list_callees(kernel)}
print("twice", *[kernel.__name__ for kernel in roots & callees])
print("signatures", {len(kernel.compiled.signatures) for kernel in roots})
print("copied", *copied)
print(*[f"{kernel.__module__}:{kernel.__name__}" for kernel in roots | callees])
"""
"""Prints which kernels a plan compiles or loads."""


def test_a_plan_compiles_each_kernel_once():
    """The first plan of a user waits for each signature; kernels of the bound wait for a bound.

    A kernel that Python calls is compiled with all that it calls. So a kernel is compiled twice if
    both Python and another kernel call it.
    """
    code = [sys.executable, "-c", COMPILED]
    done = subprocess.run(code, capture_output=True, text=True, check=True)
    *lines, names = done.stdout.splitlines()
    assert lines == ["bound", "twice", "signatures {1}", "copied"]
    assert len(names.split()) > 60
    assert "planner.bounds.lower_bound:bound_cells" in names.split()


def test_a_kernel_that_two_kernels_call_is_compiled_once(load_tiny):
    compiled = Counter()

    class Listener(event.Listener):
        def on_start(self, event):
            compiled[event.data["dispatcher"].py_func.__name__] += 1

        def on_end(self, event):
            pass

    tiny = load_tiny()
    with event.install_listener("numba:compile", Listener()):
        for kernel in (tiny.scale_twice, tiny.scale_thrice, tiny.scale_twice):
            kernel(np.ones(2))
    assert compiled == {"scale": 1, "scale_twice": 1, "scale_thrice": 1}
