"""`plan --cluster`: the same bytes as on one computer, also where workers die, and refusals that
say what to do.
"""

import os
import signal
import sys
from functools import partial

import pytest

from planner import parallel
from pulsepath.process.exits import describe_error
from pulsepath.store import write as store
from tests.windows import small_windows

ASKED = ("--machine", "hexapod", "--order", "2", "--no-figures")
SAME = ("motion.bin", "pulses.bin", "plan.json", "report.html", "certificate.json")


def code(strokes, bad=""):
    """Strokes of rounded corners, a wait before each but the first."""
    lines = ["G21 G90 G64 P0.02", "G1 X0 Y0 Z4 F600"]
    for n in range(strokes):
        lines += [
            f"G1 X{1 + 0.1 * n:.1f} Y0.5",
            f"G1 X0.5 Y{1 + 0.1 * n:.1f}",
            "G1 X0 Y0.2",
            "G4 P0.01",
        ]
    return "\n".join([*lines, bad, "G1 X0 Y0", "M2", ""])


@pytest.fixture(scope="module")
def cluster():
    """Two workers, each of which is started again where it dies."""
    distributed = pytest.importorskip("distributed", reason="the extra cluster")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address="127.0.0.1:0"
        ) as made,
        distributed.Client(made, set_as_default=False) as client,
    ):
        yield client


@pytest.fixture(scope="module", autouse=True)
def windows():
    with small_windows(16):
        yield


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    made = tmp_path_factory.mktemp("cluster") / "strokes.nc"
    made.write_text(code(6))
    return made


@pytest.fixture(scope="module")
def alone(call, file):
    done = call("plan", file, *ASKED, "--stream", "--out", file.with_name("alone"), "--json")
    assert done.exit_code == 0, done.stderr
    return file.with_name("alone")


def compare(folder, other):
    for name in SAME:
        assert (folder / name).read_bytes() == (other / name).read_bytes(), name


def when_written(monkeypatch, number, act):
    """Act when so many parts are written. Return a list with an entry for each part."""
    written = []

    def write(*given):
        add(*given)
        written.append(None)
        if len(written) == number:
            act()

    add = store.PartsWriter.add
    monkeypatch.setattr(store.PartsWriter, "add", write)
    return written


def kill(client, count):
    for pid in list(client.run(os.getpid).values())[:count]:
        os.kill(pid, signal.SIGKILL)


def test_processes_of_this_computer_make_the_same_bytes(call, file, alone, tmp_path, monkeypatch):
    monkeypatch.setattr(parallel, "MIN_POOL_WORK", 0.0)
    monkeypatch.setattr(parallel, "cores", lambda: 2)
    given = []
    submit = parallel.Pool.submit
    monkeypatch.setattr(
        parallel.Pool, "submit", lambda *asked: given.append(asked) or submit(*asked)
    )
    assert call("plan", file, *ASKED, "--stream", "--out", tmp_path / "out").exit_code == 0
    assert len(given) > 2
    compare(tmp_path / "out", alone)


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize("killed", [1, 2])
def test_the_same_bytes_whoever_dies(call, file, alone, tmp_path, cluster, monkeypatch, killed):
    cluster.wait_for_workers(2, timeout=30)
    written = when_written(monkeypatch, 1, partial(kill, cluster, killed))
    address = cluster.scheduler.address
    done = call("plan", file, *ASKED, "--stream", "--cluster", address, "--out", tmp_path / "out")
    assert done.exit_code == 0, done.stderr
    assert len(written) > 3
    assert "instead of the cluster" not in done.stderr
    compare(tmp_path / "out", alone)


def test_what_cannot_be_planned_is_told_alike(call, tmp_path, cluster):
    file = tmp_path / "far.nc"
    file.write_text(code(4, "G1 X500"))
    asked = ("plan", file, *ASKED, "--stream", "--keep-certified", "--out")
    here = call(*asked, tmp_path / "alone")
    there = call(*asked, tmp_path / "out", "--cluster", cluster.scheduler.address)
    assert here.exit_code == there.exit_code == 1
    assert here.stderr.splitlines()[-1] == there.stderr.splitlines()[-1]
    compare(tmp_path / "out", tmp_path / "alone")


def test_without_workers_it_is_planned_here(call, file, alone, tmp_path, monkeypatch):
    """All die at once, and none comes again."""
    distributed = pytest.importorskip("distributed", reason="the extra cluster")
    monkeypatch.setattr("planner.cluster.MAX_CONNECTION_TIME", 1.0)

    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address="127.0.0.1:0"
    ) as made:
        when_written(monkeypatch, 1, lambda: made.scale(0))
        address = made.scheduler_address
        done = call(
            "plan", file, *ASKED, "--stream", "--cluster", address, "--out", tmp_path / "out"
        )
    assert done.exit_code == 0, done.stderr
    assert "done by this computer instead of the cluster: it has no worker any more" in done.stderr
    compare(tmp_path / "out", alone)


def test_a_program_without_stops_is_planned_here(call, tmp_path, cluster):
    file = tmp_path / "whole.nc"
    file.write_text(code(4).replace("G4 P0.01\n", ""))
    address = cluster.scheduler.address
    done = call("plan", file, *ASKED, "--stream", "--cluster", address, "--out", tmp_path / "out")
    assert done.exit_code == 0, done.stderr
    told = [line for line in done.stderr.splitlines() if line.startswith("note:")]
    assert len(told) == 1
    assert told[0].startswith("note: from segment 1 on the motion goes on for long without a stop")


def test_refusals(call, file, tmp_path, monkeypatch):
    monkeypatch.setattr("planner.cluster.MAX_CONNECTION_TIME", 0.5)
    asked = ("plan", file, *ASKED, "--out", tmp_path / "out")
    for address, told in (
        ("tcp://127.0.0.1:9", "no Dask scheduler answers at tcp://127.0.0.1:9"),
        ("nowhere", "no Dask scheduler answers at nowhere: missing port number"),
        ("tls://127.0.0.1:9", "TLS"),
        (
            str(tmp_path / "none.json"),
            "there is no such file; give the address, or the --scheduler-file",
        ),
    ):
        done = call(*asked, "--stream", "--cluster", address)
        assert done.exit_code == 2
        assert told in done.stderr
    assert "--cluster is for --stream" in call(*asked, "--cluster", "tcp://127.0.0.1:9").stderr
    monkeypatch.setattr("pulsepath.command_group.describe_error", describe_error)
    monkeypatch.setitem(sys.modules, "distributed", None)
    done = call(*asked, "--stream", "--cluster", "tcp://127.0.0.1:9")
    assert done.exit_code == 2
    assert "pulsepath[cluster]" in done.stderr
    assert not [*tmp_path.iterdir()]
