"""Work spread over processes: the same results, the same refusals, and what is spread can leave its
process.
"""

import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import textwrap
import threading
import time
from contextlib import ExitStack
from functools import partial

import numpy as np
import pytest

from kinematics import Fault, FileError, MotionError, OutOfReach, load_machine, machine_names
from planner import Infeasible, Line, Place, Program, parallel, plan
from planner.limits import limits_of
from planner.path.actuation import actuate
from planner.timing import certified_solve
from tests.planner.tasks import multiply, where


@pytest.fixture
def eager(processes):
    """Two processes, however little there is to do."""
    processes()


def zigzag(count):
    """Lines that stop at each end."""
    return Program(tuple(Line(np.array([2e-3 * (k % 2), 1e-3 * k, 20e-3])) for k in range(count)))


def test_results_come_in_order_and_from_other_processes(eager):
    told = []
    found = parallel.spread(where, range(20), lambda task, result: told.append((task, result)))
    assert [task for task, _ in found] == list(range(20))
    assert told == list(zip(range(20), found, strict=True))
    processes = {process for _, process in found[parallel.FIRST_TASKS :]}
    assert os.getpid() not in processes
    assert {process for _, process in found[: parallel.FIRST_TASKS]} == {os.getpid()}


def test_what_a_task_raises_is_raised_as_itself(eager):
    with pytest.raises(Infeasible, match="36 deg is beyond 35 deg") as caught:
        parallel.spread(where, [1, 2, 3, "infeasible", 5])
    assert (caught.value.kind, caught.value.axis, caught.value.limit) == (
        "tilt",
        "leg1 base joint",
        35.0,
    )
    assert caught.value.place == Place(0.1, 2, 0.5, "leg1")
    assert not multiprocessing.active_children()


def test_work_that_is_lost_with_its_process_is_done_here(eager):
    found = parallel.spread(where, [1, 2, 3, "dies", 5])
    assert [task for task, _ in found] == [1, 2, 3, "dies", 5]
    assert found[3][1] == os.getpid()


@pytest.mark.parametrize("moment", ["starting", "a moment later", 10])
def test_a_killed_process_costs_only_time(eager, moment):
    """Work and results are larger than what a pipe holds, so that either end may be in the midst of
    one.
    """
    work = partial(multiply, np.random.default_rng(1).random(2**17))
    killed, found = [], []

    def kill():
        for process in multiprocessing.active_children()[:1]:
            os.kill(process.pid, signal.SIGKILL)
            killed.append(process.pid)

    def done(task, result):
        if len(told) == moment and not killed:
            kill()
        told.append(task)

    def early():
        while not multiprocessing.active_children():
            time.sleep(0.001)
        time.sleep(0.3 if moment == "a moment later" else 0)
        kill()

    told, tasks = [], range(1, 30)
    if isinstance(moment, str):
        threading.Thread(target=early, daemon=True).start()
    spread = threading.Thread(
        target=lambda: found.extend(parallel.spread(work, tasks, done)), daemon=True
    )
    spread.start()
    spread.join(60)
    assert not spread.is_alive()
    assert len(killed) == 1
    assert told == list(tasks)
    assert all(np.array_equal(have, work(task)) for task, have in zip(tasks, found, strict=True))
    assert not multiprocessing.active_children()


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_no_process_outlives_the_one_that_began_it(tmp_path):
    process = begin_sleeping(tmp_path)
    process.kill()
    process.communicate(timeout=15)
    assert ends(process.pid)


def test_local_helpers_start_late_and_again_where_they_die(processes):
    def here(task):
        return lambda: ("here", task)

    processes()
    with ExitStack() as stack:
        helpers = parallel.LocalHelpers(stack)
        assert helpers.room() == 0  # there is no work yet
        submit = helpers.prepare(where)
        processes(least=np.inf)
        assert helpers.room() == 0
        assert submit(1).result(here(1)) == ("here", 1)
        processes()
        for _ in range(parallel.MAX_DEATHS):
            assert helpers.room() == 3
            found = [each.result(here(n)) for n, each in enumerate([submit(0), submit(1)])]
            assert [task for task, _ in found] == [0, 1]
            assert os.getpid() not in {process for _, process in found}
            assert submit("infeasible").result(here(5)) == ("here", 5)
            assert submit("dies").result(here(6)) == ("here", 6)
            assert submit(7).result(here(7)) == ("here", 7)
        assert helpers.room() == 0
    assert not multiprocessing.active_children()


def test_nothing_is_started_where_that_is_ruled_out(eager):
    with parallel.without_processes():
        assert {process for _, process in parallel.spread(where, range(20))} == {os.getpid()}


def test_work_that_cannot_leave_the_process_is_done_here(eager):
    found = parallel.spread(lambda task: (task, os.getpid()), range(5))
    assert found == [(task, os.getpid()) for task in range(5)]


def test_little_work_stays_here():
    assert {process for _, process in parallel.spread(where, range(50))} == {os.getpid()}


@pytest.mark.parametrize("order", [2, 3])
def test_the_same_motion_to_the_bit(processes, order, hexapod):
    path = actuate(zigzag(16), hexapod)
    limits, told = limits_of(path, hexapod.axes, order), []
    processes()
    spread = certified_solve(path, limits, order, lambda done, of: told.append((done, of)))
    processes(least=np.inf)
    alone = certified_solve(path, limits, order)
    for name in ("knots", "s", "v", "a", "j", "piece"):
        assert np.array_equal(getattr(spread.trajectory, name), getattr(alone.trajectory, name)), (
            name
        )
    assert spread.certificate.worst == alone.certificate.worst
    assert spread.methods == alone.methods
    assert told == [(8, 16), (16, 16)]
    assert spread.certificate.holds


SCRIPT = """
    from functools import partial
    from planner import parallel
    from tests.planner import tasks
    print("begins", flush=True)
    parallel.MIN_POOL_WORK, parallel.cores = 0.0, lambda: 2
    try:
        print(sum(parallel.spread({work}, [0.01] * 2 + [{wait}] * 6) or [0]), flush=True)
    except KeyboardInterrupt:
        print("ended", flush=True)
"""


def script(tmp_path, work, wait):
    file = tmp_path / "script.py"
    file.write_text(textwrap.dedent(SCRIPT.format(work=work, wait=wait)))
    return [sys.executable, str(file)], {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}


def begin_sleeping(tmp_path):
    """Start a group of a process and two that it began, all of which sleep for a minute."""
    folder = tmp_path / "sleeping"
    folder.mkdir()
    command, environment = script(tmp_path, f"partial(tasks.sleep, {str(folder)!r})", 60)
    process = subprocess.Popen(
        command,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    for _ in range(3000):
        if len(list(folder.iterdir())) == 3:
            return process
        time.sleep(0.02)
    raise AssertionError("no processes began within a minute")


def ends(group):
    """Whether all of a group of processes end: Python's own helper does so a moment after the
    others.
    """
    for _ in range(100):
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.1)
    return False


def test_a_script_without_a_main_guard_is_not_run_again(tmp_path):
    command, environment = script(tmp_path, "abs", 1)
    done = subprocess.run(
        command, env=environment, capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout.split() == ["begins", "6.02"]
    assert not done.stderr


@pytest.mark.skipif(os.name != "posix", reason="signals of a terminal")
def test_ctrl_c_ends_all_processes(tmp_path):
    process = begin_sleeping(tmp_path)
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=15)
    assert (out, process.returncode) == ("begins\nended\n", 0), err
    assert not err
    assert ends(process.pid)


@pytest.mark.parametrize(
    "error",
    [
        MotionError("what, where"),
        OutOfReach("too far"),
        FileError("program.toml", [Fault("segment[2].arc", "no centre", 7)]),
        Infeasible("speed", "leg1", None, 2.0, 1.0, "mm/s", "slower"),
    ],
)
def test_errors_pickle_as_they_are(error):
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error)
    assert str(again) == str(error)
    assert again.__dict__ == error.__dict__


@pytest.mark.parametrize("name", machine_names())
def test_machines_pickle(name):
    machine = load_machine(name)
    machine.check(machine.home)
    again = pickle.loads(pickle.dumps(machine))
    assert (again.name, again.axes) == (machine.name, machine.axes)
    assert np.array_equal(again.inverse(again.home), machine.inverse(machine.home))
    assert np.array_equal(again.jacobian(again.home), machine.jacobian(machine.home))


def test_plans_pickle(planned):
    made = planned("bare-circle", 2)
    again = pickle.loads(pickle.dumps(made))
    t = np.linspace(0, made.trajectory.duration, 101)
    assert np.array_equal(again.trajectory.at(t).q, made.trajectory.at(t).q)
    assert np.array_equal(again.pulses.axes[0].ticks, made.pulses.axes[0].ticks)
    assert again.certificate.worst == made.certificate.worst


def test_progress_of_a_plan(hexapod):
    told = []
    plan(zigzag(10), hexapod, order=2, progress=lambda done, of: told.append((done, of)))
    assert told[:2] == [(8, 10), (10, 10)]
    pulses = [done / of for done, of in told[2:]]  # of each of the six legs in turn
    assert pulses == sorted(set(pulses))
    assert pulses[-1] == 1
