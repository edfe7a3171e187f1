"""Many programs on a cluster: each one's own plan or refusal, in order."""

import sys

import numpy as np
import pytest

from kinematics import MotionError
from planner import Infeasible, Line, Plan, Program, plan, plan_many


def programs(count):
    """Lines upwards, of which every third leads out of travel."""
    return [
        Program((Line(np.array([0, 0, 0.2 if n % 3 == 2 else 1e-3 * (n + 1)])),), name=f"line-{n}")
        for n in range(count)
    ]


def test_each_program_gets_its_plan_or_its_refusal_in_order(hexapod):
    pytest.importorskip("distributed", reason="the extra cluster")
    told, asked = [], programs(3)
    found = plan_many(asked, hexapod, order=2, progress=lambda done, of: told.append((done, of)))
    assert told == [(n, 3) for n in range(1, 4)]
    for n, (one, program) in enumerate(zip(found, asked, strict=True)):
        if n % 3 == 2:
            assert isinstance(one, Infeasible)
            assert one.kind == "travel"
            continue
        assert isinstance(one, Plan)
        assert one.program.name == program.name
        here = plan(program, hexapod, order=2)
        assert one.trajectory.duration == here.trajectory.duration
        assert one.certificate.worst == here.certificate.worst
        assert all(
            np.array_equal(a.ticks, b.ticks)
            for a, b in zip(one.pulses.axes, here.pulses.axes, strict=True)
        )


def test_an_existing_cluster_by_address(hexapod):
    distributed = pytest.importorskip("distributed", reason="the extra cluster")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address="127.0.0.1:0"
    ) as cluster:
        (found,) = plan_many(programs(1), hexapod, order=2, address=cluster.scheduler_address)
        assert found.certificate.holds
        with pytest.raises(MotionError, match="order 4"):
            raise plan_many(programs(1), hexapod, order=4, address=cluster.scheduler_address)[0]


def test_no_answer_says_where(connection_time, hexapod):
    pytest.importorskip("distributed", reason="the extra cluster")
    connection_time(0.5)
    with pytest.raises(MotionError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:9"):
        plan_many(programs(1), hexapod, address="tcp://127.0.0.1:9")


def test_without_dask_the_extra_is_named(monkeypatch, hexapod):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MotionError, match=r"pulsepath\[cluster\]"):
        plan_many(programs(1), hexapod)


def test_nothing_to_plan(hexapod):
    assert plan_many([], hexapod) == []
