"""A cluster whose workers would compute something else gets no work."""

import logging
import os
import pickle
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import planner
from kinematics import MotionError
from planner import Line, Program, plan_many
from planner.cluster import _wrap_checked, open_cluster, run_on_cluster
from planner.environment import FIRST_FACTS, describe_mismatches, make_fact_finder

LOADED = "import sys, cloudpickle; print(cloudpickle.loads(bytes.fromhex(sys.argv[1]))())"


def test_other_sources_on_a_worker_are_refused_before_any_work(tmp_path, connection_time, hexapod):
    """One worker with a copy of the planner that differs by a comment: nothing is planned there."""
    distributed = pytest.importorskip("distributed", reason="the extra cluster")
    connection_time(60.0)
    copy = tmp_path / "planner"
    shutil.copytree(
        Path(planner.__file__).parent, copy, ignore=shutil.ignore_patterns("__pycache__")
    )
    with (copy / "plan.py").open("a") as file:
        file.write("# of tomorrow\n")
    command = [
        sys.executable,
        "-m",
        "distributed.cli.dask_worker",
        "--nthreads=1",
        "--no-nanny",
        "--no-dashboard",
    ]
    paths, asked = [str(tmp_path), *filter(None, sys.path)], [Program((Line((0, 0, 1e-3)),))]
    with (
        distributed.LocalCluster(
            n_workers=0, processes=True, dashboard_address="127.0.0.1:0"
        ) as cluster,
        subprocess.Popen(
            [*command, cluster.scheduler_address],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            cwd=tmp_path,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
        ) as worker,
    ):
        try:
            with pytest.raises(MotionError) as refused:
                plan_many(asked, hexapod, address=cluster.scheduler_address)
        finally:
            worker.kill()
    told = str(refused.value)
    assert told.startswith("1 of the cluster's workers, as tcp://")
    assert "would give different results: other sources of planner. Install the same there" in told


def test_another_library_on_the_workers_is_refused(monkeypatch):
    distributed = pytest.importorskip("distributed", reason="the extra cluster")
    look = make_fact_finder()
    key = next(key for key, facts in FIRST_FACTS.items() if facts == look())
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=True, dashboard_address="127.0.0.1:0"
    ) as cluster:
        numpy = look()["numpy"]
        monkeypatch.setitem(FIRST_FACTS, key, {**look(), "numpy": "1.0"})
        with pytest.raises(
            MotionError, match=rf"different results: numpy {numpy} \(here 1\.0\)\. Install the same"
        ):
            list(run_on_cluster(divmod, [7], 2, cluster.scheduler_address))


def test_a_worker_that_differs_later_gets_no_more(monkeypatch):
    """What it was given is done here, which is told."""
    distributed = pytest.importorskip("distributed", reason="the extra cluster")
    look, told = make_fact_finder(), []
    key = next(key for key, facts in FIRST_FACTS.items() if facts == look())
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=True, dashboard_address="127.0.0.1:0"
        ) as made,
        open_cluster(made.scheduler_address, tell=told.append) as cluster,
    ):
        assert cluster.prepare(abs)(-7).result(lambda: None) == 7
        monkeypatch.setitem(FIRST_FACTS, key, {**look(), "numpy": "1.0"})
        assert cluster.prepare(abs)(-7).result(lambda: "here") == "here"
        assert cluster.find_workers() == []
        monkeypatch.undo()
        assert (
            cluster.prepare(divmod)(7).result(lambda: "here") == "here"
        )  # of one argument: it raises
    assert "done by this computer instead of the cluster" in told[0]
    assert "numpy" in told[0]
    assert "TypeError" in told[-1]


def test_without_its_scheduler_all_is_done_here(connection_time):
    distributed = pytest.importorskip("distributed", reason="the extra cluster")
    connection_time(0.5)
    told = []
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=False, dashboard_address="127.0.0.1:0"
        ) as made,
        open_cluster(made.scheduler_address, tell=told.append) as cluster,
    ):
        submit = cluster.prepare(abs)
        assert submit(-7).result(lambda: None) == 7
        assert submit(lambda: 0).result(lambda: "here") == "here"  # pickle cannot send it
        made.close()
        assert submit(-7).result(lambda: "here") == "here"
        end = time.monotonic() + 10
        while cluster.room() and time.monotonic() < end:
            time.sleep(0.1)
        assert cluster.room() == 0
    assert "it cannot be sent" in told[0]
    assert "instead of the cluster: it" in told[1]  # has no scheduler any more, or no worker


def test_a_cluster_without_workers_is_told(connection_time):
    distributed = pytest.importorskip("distributed", reason="the extra cluster")
    connection_time(0.5)
    with (
        distributed.LocalCluster(
            n_workers=0, processes=False, dashboard_address="127.0.0.1:0"
        ) as cluster,
        pytest.raises(MotionError, match=r"no worker after 0\.5 s: start some"),
    ):
        list(run_on_cluster(divmod, [7], 2, cluster.scheduler_address))


def test_a_worker_looks_again_before_each_task():
    """One that joins later: its facts in place of a result, before anything of ours is unpacked
    there.
    """
    look = make_fact_finder()
    task, shared = pickle.dumps(7), pickle.dumps(2)
    assert _wrap_checked(divmod, look, look())(task, shared) == ((3, 1), None)
    assert _wrap_checked(divmod, look, {**look(), "python": "2.7"})(b"of another world", b"") == (
        None,
        look(),
    )


def test_it_looks_where_another_version_is(tmp_path):
    """Sent as code: in a process that has a planner of old, without any of this, it finds that."""
    cloudpickle = pytest.importorskip("cloudpickle", reason="the extra cluster")
    (tmp_path / "planner").mkdir()
    (tmp_path / "planner" / "__init__.py").write_text("old = True\n")
    sent = cloudpickle.dumps(make_fact_finder()).hex()
    done = subprocess.run(
        [sys.executable, "-c", LOADED, sent],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), *filter(None, sys.path)])},
    )
    here, there = make_fact_finder()(), eval(done.stdout)  # noqa: S307  # of our own process
    assert describe_mismatches(here, there) == ["other sources of planner"]
    assert describe_mismatches(here, here) == []
    assert describe_mismatches(here, {}) == [
        f"{what} not installed (here {value[:12]})" for what, value in here.items()
    ]


def test_ctrl_c_reaches_no_worker_and_dask_says_nothing_of_itself():
    """A terminal sends it to every process in front; the first one ends the others."""

    pytest.importorskip("distributed", reason="the extra cluster")

    def see_blocked():
        return signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, [])

    before = logging.getLogger("distributed").level
    with open_cluster(most=1) as cluster:
        assert list(cluster.client.run(see_blocked).values()) == [True]
        assert not logging.getLogger("distributed").isEnabledFor(logging.ERROR)
        spoken = cluster.client.run(
            lambda: logging.getLogger("distributed.worker").isEnabledFor(logging.ERROR)
        )
        assert list(spoken.values()) == [False]
    assert logging.getLogger("distributed").level == before
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])
