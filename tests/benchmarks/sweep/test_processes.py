"""Whatever a rig or a task can contain is the same in another process."""

import operator
import pickle
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from benchmarks.sweep import Cell, Grid, read_setting, run, sweep
from benchmarks.sweep.result import NOMINAL
from benchmarks.sweep.run import Digests, score
from controllers.reference_file import Recorded
from controllers.rig import Task, assumed_rig, time_path
from controllers.rig_file import load_rig, rig_names
from kinematics import MotionError, load_machine, machine_names
from planner import load_program
from planner.parallel import open_pool
from planner.path.actuation import actuate

HEAD = 'schema = 1\nmachine = "five-axis"\nlength = "mm"\nangle = "deg"\n'
SEGMENTS = {
    "line": "line = { to = [9, 4, 2], rotate = [0, 0, 0] }",
    "blend": "line = { to = [9, 0, 0] }\njoin = { blend = 0.05 }\n[[segment]]\nline = { to = [9, 9, 0] }",
    "arc": "arc = { centre = [5, 0, 0], normal = [0, 0, 1], angle = 90, rise = 1 }",
    "spline": "spline = { through = [[3, 1, 0], [5, 4, 1], [9, 5, 0]] }",
    "equations": 'curve = { x = "r * sin(t)", y = "r * (1 - cos(t))", z = "0.5 * t", '
    "constants = { r = 5 }, from = 0, to = 2 }",
    "turning equations": 'curve = { x = "8 * t", y = "t**3", z = "0", rz = "10 * t", '
    "from = 0, to = 1 }\njoin = { blend = 0.05 }\n[[segment]]\nline = { to = [9, 9, 0] }",
    "synchronised": "synchronised = { to = [5, 2, 1] }",
    "fit": "\n[[segment]]\n".join(
        f"line = {{ to = [{x}, {x * x / 9:.3f}, 0] }}" + "\njoin = { fit = 0.05 }" * (x < 9)
        for x in (3, 6, 9)
    ),
}


def path_task(text, machine, folder):
    file = folder / "own.toml"
    file.write_text(text)
    path = actuate(load_program(file), machine)
    return Task("own", time_path(path, "trapezoid", 0.2, 1.0), 0.025)


@pytest.fixture(scope="module")
def process():
    """One other process, which calls what it is sent."""
    with open_pool(pickle.dumps(operator.call), 1) as pool:

        def call(work):
            pending = pool.submit(work)
            assert pending.future.result(60), "it cannot leave the process, or raises there"
            return pending.read()

        yield call


@pytest.mark.parametrize("name", SEGMENTS)
def test_every_kind_of_segment_is_the_same_motion_in_a_process(tmp_path, process, name):
    machine = load_machine("five-axis")
    rig = replace(
        assumed_rig(machine),
        tasks=(path_task(f"{HEAD}[[segment]]\n{SEGMENTS[name]}\n", machine, tmp_path),),
    )
    assert process(partial(Digests, rig)).as_record() == Digests(rig).as_record()


@pytest.mark.parametrize("name", rig_names())
def test_every_task_of_every_bundled_rig_is_the_same_in_a_process(process, name):
    rig = load_rig(name)
    assert process(partial(Digests, rig)).tasks == Digests(rig).tasks


@pytest.mark.parametrize("name", machine_names())
def test_every_bundled_machine_is_the_same_in_a_process(process, name):
    machine = load_machine(name)
    there = process(partial(machine.inverse, machine.home))
    np.testing.assert_allclose(there, machine.inverse(machine.home), rtol=0, atol=1e-15)


def test_positions_from_a_file_are_the_same_motion_in_a_process(process):
    rig = load_rig("servo-rig")
    t = np.linspace(0, 1, 11)
    home = rig.machine.home_q
    motion = Recorded(home, t, np.outer(t**2, np.ones(3)), np.outer(2 * t, np.ones(3)))
    rig = replace(rig, tasks=(Task("own", motion, 0.05),))
    assert process(partial(Digests, rig)).tasks == Digests(rig).tasks


def test_runs_of_equations_are_the_same_in_a_process(tmp_path, process):
    """The simulation itself, with errors to the path in space."""
    machine = load_machine("tripod")
    text = HEAD.replace("five-axis", "tripod") + f"[[segment]]\n{SEGMENTS['equations']}\n"
    rig = replace(assumed_rig(machine), tasks=(path_task(text, machine, tmp_path),))
    cells = [Cell(read_setting("6:gain=0.7"), "own", NOMINAL)]
    (here,), (there,) = score(cells, rig), process(partial(score, cells, rig))
    assert not here.failure
    assert there.figures == here.figures
    np.testing.assert_array_equal(there.series.actual, here.series.actual)


def test_a_rig_that_cannot_leave_this_process_is_run_here(tmp_path, monkeypatch):
    """Its motion is of a caller's own, which no pickle has."""
    rig = load_rig("servo-rig")
    task = rig.task("sine")
    motion = replace(task.motion, duration=0.2)
    own = type(
        "Own", (), {"duration": 0.2, "knots": motion.knots, "at": lambda self, t: motion.at(t)}
    )()
    rig = replace(rig, tasks=(Task("own", own, task.dt),))
    grid = Grid((read_setting("3"), read_setting("6:gain=0.7")), ("own",))
    monkeypatch.setattr(run, "MIN_CLUSTER_BATCHES", 1)
    said = []
    found = sweep(grid, rig, tmp_path, tell=said.append)
    assert len(found.results) == 10
    assert not any(one.failure for one in found.results.values())
    assert "cannot be sent to other processes" in said[0]
    with pytest.raises(MotionError, match="cannot be sent to other processes"):
        sweep(grid, rig, tmp_path / "other", address="tcp://127.0.0.1:1")
