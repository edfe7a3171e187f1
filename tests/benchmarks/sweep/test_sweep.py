"""Sweeps: every run once, kept whole, the same whoever runs it."""

import multiprocessing
import os
import signal
import sys
import threading
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.sweep import (
    VARIATIONS,
    Grid,
    Setting,
    described,
    list_cells,
    load_runs,
    read_setting,
    run,
    settings_of,
    sweep,
)
from benchmarks.sweep.result import CELLS, DamagedRun, RunResult, RunSeries, Store
from benchmarks.sweep.run import Digests, digest, find_corners, score
from controllers.rig import Host, Task, assumed_rig, time_path
from kinematics import MotionError, load_machine
from planner import Blend, Line, Program, Spline, plan
from planner.path.actuation import actuate

SETTINGS = tuple(map(read_setting, ("3", "6:gain=0.5", "6:gain=0.7")))


@pytest.fixture(scope="module")
def rig():
    machine = load_machine("arm")

    def task(name, *points):
        program = Program(tuple(Line(np.array(point) * 1e-3) for point in points), name=name)
        return Task(name, plan(program, machine, order=2).trajectory, 0.025)

    tasks = (task("bend", (-20, 10, 20), (-20, 30, 20)), task("dash", (-25, 5, 0)))
    return replace(assumed_rig(machine), name="small", tasks=tasks)


@pytest.fixture(scope="module")
def grid():
    return Grid(SETTINGS, ("bend", "dash"), VARIATIONS[:2])


@pytest.fixture
def alone(monkeypatch):
    """No Dask, and a count of what is run."""
    ran = []

    def counting(cells, rig):
        ran.extend(cells)
        return score(cells, rig)

    monkeypatch.setattr(run, "is_installed", lambda: False)
    monkeypatch.setattr(run, "score", counting)
    return ran


def test_what_is_kept_is_not_run_twice(tmp_path, rig, grid, alone):
    told, said = [], []
    first = sweep(
        grid, rig, tmp_path, progress=lambda done, of: told.append((done, of)), tell=said.append
    )
    assert sorted(map(repr, alone)) == sorted(map(repr, grid))
    assert told[0] == (0, 12)
    assert told[-1] == (12, 12)
    assert "Dask is not installed" in said[0]
    alone.clear()
    again = sweep(grid, rig, tmp_path)
    assert alone == []
    assert again.results == first.results
    # one more gain, on both tasks and both rigs: four runs more
    more = replace(grid, settings=(*SETTINGS, read_setting("6:gain=0.9")))
    assert len(sweep(more, rig, tmp_path).results) == 16
    assert {cell.setting.text for cell in alone} == {"closed-position:gain=0.9"}
    assert len(alone) == 4
    # what was lost or damaged is run again, nothing else is
    alone.clear()
    lost, *damaged = list(first.results)[3:8]
    (tmp_path / CELLS / f"{lost}.npz").unlink()
    with pytest.raises(MotionError, match=r"lost or damaged; run the sweep again"):
        load_runs(tmp_path)
    for key, damage in zip(damaged, (shorter, emptied, flipped, exchanged), strict=True):
        file = tmp_path / CELLS / f"{key}.npz"
        file.write_bytes(damage(file))
    assert sweep(grid, rig, tmp_path).results == first.results
    assert sorted(map(repr, alone)) == sorted(
        repr(first.results[key].cell) for key in (lost, *damaged)
    )


def shorter(file):
    return file.read_bytes()[:-100]


def emptied(file):
    return b""


def flipped(file):
    """One bit of the course that it holds, far from the record."""
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 4
    return bytes(content)


def exchanged(file):
    """Another run's file under this one's name."""
    return next(
        other for other in sorted(file.parent.iterdir()) if other != file and other.stat().st_size
    ).read_bytes()


def test_no_flipped_bit_passes_for_a_run(rig):
    """Every fourth byte of a small run: it is told to be damaged, or what is read is what was
    written.
    """
    few = np.linspace(0, 1, 4)
    rows = np.column_stack([few, -few])
    series = RunSeries(few, few, rows, rows, few, few, rows, rows, rows)
    whole = RunResult(
        next(iter(Grid(SETTINGS[:1], ("dash",)))), {"contour_rms": 1e-6}, series=series
    )
    packed, refused = whole.pack(), 0
    for place in range(0, len(packed), 4):
        content = bytearray(packed)
        content[place] ^= 1 << place // 4 % 8
        try:
            assert RunResult.unpack(bytes(content)) == replace(whole, series=None)
        except DamagedRun:
            refused += 1
            continue
        read = RunSeries.unpack(bytes(content))
        assert all(
            np.allclose(getattr(read, name), getattr(series, name)) for name in RunSeries.__slots__
        )
    assert refused > len(packed) / 8


def test_a_run_that_was_edited_is_told(tmp_path, rig, alone):
    """Whole by its own checksums, but not what was run."""
    runs = sweep(Grid(SETTINGS[:1], ("dash",), VARIATIONS[:1]), rig, tmp_path)
    (key,) = runs.results
    better = replace(runs.results[key], figures=dict.fromkeys(runs.results[key].figures, 0.0))
    Store(tmp_path).keep(key, better)
    with pytest.raises(
        MotionError, match=r"is not the run that was recorded; remove it and run the sweep again"
    ):
        load_runs(tmp_path)


def test_a_damaged_record_is_told(tmp_path, rig, alone):
    runs = sweep(Grid(SETTINGS[:1], ("dash",), VARIATIONS[:1]), rig, tmp_path)
    record = tmp_path / "runs.json"
    text = record.read_text()
    assert load_runs(tmp_path).record == runs.record
    for damage in (
        text.replace('"dt_s": 0.025', '"dt_s": 0.035'),
        text.replace('"cells": [', '"cellt": ['),
    ):
        assert damage != text
        record.write_text(damage)
        with pytest.raises(MotionError, match=r"runs\.json is damaged; run the sweep again"):
            load_runs(tmp_path)
    record.write_text("")
    with pytest.raises(MotionError, match="holds no saved runs"):
        load_runs(tmp_path)
    sweep(Grid(SETTINGS[:1], ("dash",), VARIATIONS[:1]), rig, tmp_path)
    assert load_runs(tmp_path).record == runs.record


def test_results_do_not_depend_on_the_batch(rig, grid):
    cells = [cell for cell in grid if cell.task == "bend" and cell.setting.law == "closed-position"]
    together = score(cells, rig)
    for cell, result in zip(cells, together, strict=True):
        (alone,) = score([cell], rig)
        assert result.cell == cell == alone.cell
        assert result.figures == pytest.approx(alone.figures, rel=1e-12, abs=1e-15)


@pytest.fixture(scope="module")
def dash(grid):
    return replace(grid, tasks=("dash",))


@pytest.fixture(scope="module")
def one(dash, rig, tmp_path_factory):
    """The runs of the shorter task by one process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "is_installed", lambda: False)
        patch.setattr(run, "MAX_LANES", 1)
        return sweep(dash, rig, tmp_path_factory.mktemp("one"))


def test_results_do_not_depend_on_the_number_of_processes_nor_on_one_that_is_killed(
    tmp_path, rig, dash, one, monkeypatch, processes
):
    monkeypatch.setattr(run, "is_installed", lambda: False)
    monkeypatch.setattr(run, "MAX_LANES", 1)
    processes()
    workers, killed = set(), []

    def progress(done, of):
        alive = {process.pid for process in multiprocessing.active_children()}
        workers.update(alive)
        if done >= 3 and alive and not killed:
            killed.append(max(alive))
            os.kill(killed[0], signal.SIGKILL)

    two = sweep(dash, rig, tmp_path / "two", progress=progress)
    # whether the one that takes a killed one's place is seen depends on when it starts
    assert len(workers) >= 2
    assert killed
    assert not multiprocessing.active_children()
    assert set(two.results) == set(one.results)
    for key, result in two.results.items():
        assert result.figures == pytest.approx(one.results[key].figures, rel=1e-12, abs=1e-15)


def test_a_run_that_fails_is_a_result_and_spoils_no_other(rig):
    wild = [read_setting(f"5:gain={gain}") for gain in (1e300, 0.5)]
    cells = list(Grid(tuple(wild), ("dash",), VARIATIONS[:1]))
    broken, whole = score(cells, rig)
    assert broken.failure
    assert not broken.figures
    assert whole.figures == score(cells[1:], rig)[0].figures


def test_a_failed_run_is_kept_too(tmp_path, rig):
    cell = next(iter(Grid(SETTINGS[:1], ("dash",), VARIATIONS[:1])))
    store = Store(tmp_path)
    store.keep("key", RunResult(cell, failure="refused: <why>"))
    assert store.find("key") == RunResult(cell, failure="refused: <why>")
    assert [path.name for path in (tmp_path / CELLS).iterdir()] == ["key.npz"]


def test_a_result_is_read_as_it_was_written(rig, grid):
    (result,) = score([next(iter(grid))], rig)
    packed = result.pack()
    assert RunResult.unpack(packed) == replace(result, series=None)
    read = RunSeries.unpack(packed)
    np.testing.assert_allclose(read.actual, result.series.actual, rtol=1e-7)  # single precision
    # the figures are of the same course: RMS and maximum to single precision
    assert result.figures["contour_rms"] == pytest.approx(
        np.sqrt(np.mean(read.contour**2)), rel=1e-6
    )
    assert result.figures["torque_peak"] == pytest.approx(np.abs(read.torque).max(), rel=1e-6)


def test_every_input_changes_the_name(rig, grid):
    cells = list(grid)
    digests = Digests(rig)
    names = {digest(cell, digests) for cell in cells} | {digest(replace(cells[0], seed=1), digests)}
    assert len(names) == len(cells) + 1
    others = [
        replace(rig, drives=(replace(rig.drives[0], torque_limit=1.0), *rig.drives[1:])),
        replace(rig, host=Host(seed=5)),
        replace(rig, tasks=(replace(rig.tasks[0], dt=0.05), rig.tasks[1])),
        replace(rig, tasks=(replace(rig.tasks[0], motion=rig.tasks[1].motion), rig.tasks[1])),
    ]
    assert len({digest(cells[0], Digests(other)) for other in (rig, *others)}) == 5
    assert digest(cells[0], Digests(replace(rig))) == digest(cells[0], digests)


@pytest.mark.parametrize(
    "library", ["numpy", "scipy", "casadi", "numba", "osqp", "pin", "pulsepath"]
)
def test_another_version_of_a_library_changes_the_name(rig, grid, monkeypatch, library):
    cell, now = next(iter(grid)), run.version
    name = digest(cell, Digests(rig))
    monkeypatch.setattr(
        run, "version", lambda package: "0.0" if package == library else now(package)
    )
    assert digest(cell, Digests(rig)) != name


def test_another_python_changes_the_name(rig, grid, monkeypatch):
    name = digest(next(iter(grid)), Digests(rig))
    monkeypatch.setattr(run, "python_version", lambda: "3.0.0")
    assert digest(next(iter(grid)), Digests(rig)) != name


@pytest.mark.parametrize("package", ["kinematics", "planner", "controllers", "benchmarks.sweep"])
def test_another_source_changes_the_name(tmp_path, monkeypatch, package):
    monkeypatch.setattr(run, "files", lambda name: tmp_path / name)
    for name in run.PACKAGES:
        (tmp_path / name / "inner").mkdir(parents=True)
    code = run.code.__wrapped__
    before = code()
    (tmp_path / package / "inner" / "module.py").write_text("x = 1")
    assert code() != before


def test_settings_are_read_and_written():
    assert read_setting("6") == Setting("closed-position", (("gain", 0.7),))
    for setting in (*settings_of("5"), *settings_of("3"), *settings_of("6")):
        assert read_setting(setting.text) == setting
    assert len(settings_of("3")) == 1
    assert len(set(settings_of("6"))) == len(settings_of("6")) > 3
    with pytest.raises(MotionError, match="no gain 'gian'"):
        read_setting("6:gian=1")
    with pytest.raises(MotionError, match="is not a number"):
        read_setting("6:gain=big")
    with pytest.raises(MotionError, match=r"^law 6: gain must be one finite number"):
        read_setting("6:gain=nan")


def test_an_unknown_task_or_folder_is_named(tmp_path, rig):
    with pytest.raises(MotionError, match='no task "bent"'):
        sweep(Grid(SETTINGS, ("bent",)), rig, tmp_path)
    with pytest.raises(MotionError, match="holds no saved runs"):
        load_runs(tmp_path)


def test_an_address_without_dask_is_refused(tmp_path, rig, grid, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MotionError, match=r"pulsepath\[cluster\]"):
        sweep(grid, rig, tmp_path, address="tcp://127.0.0.1:9")


def test_a_cluster_of_this_computer_is_for_much(tmp_path, rig, grid, monkeypatch):
    def refuse(_, batches, *__, **___):
        raise NotImplementedError(f"{len(batches)} batches")

    monkeypatch.setattr(run, "is_installed", lambda: True)
    monkeypatch.setattr(run, "run_on_cluster", refuse)
    assert len(sweep(grid, rig, tmp_path / "little").results) == 12
    monkeypatch.setattr(run, "MAX_LANES", 1)
    with pytest.raises(NotImplementedError, match="12 batches"):
        sweep(grid, rig, tmp_path / "much")


def test_a_killed_worker_loses_nothing(tmp_path, rig, grid, one, monkeypatch):
    distributed = pytest.importorskip("distributed", reason="the extra cluster")
    monkeypatch.setattr(run, "MAX_LANES", 1)
    grid = replace(grid, tasks=("dash",), variations=VARIATIONS[:1])
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address="127.0.0.1:0"
    ) as cluster:
        first, *_ = (worker.pid for worker in cluster.workers.values())
        killed = threading.Event()

        def kill(done, of):
            if done and not killed.is_set():
                killed.set()
                os.kill(first, signal.SIGKILL)

        runs = sweep(
            grid, rig, tmp_path / "cluster", address=cluster.scheduler_address, progress=kill
        )
        assert killed.is_set()
    assert {key for key in one.results if key in runs.results} == set(runs.results)
    assert len(runs.results) == len(SETTINGS)
    for key, result in runs.results.items():
        assert result.figures == pytest.approx(one.results[key].figures, rel=1e-12, abs=1e-15)


def without_friction(rig):
    return tuple(replace(drive, friction=0.0, coulomb=0.0) for drive in rig.drives)


@pytest.mark.parametrize(
    ("host", "friction", "expected"),
    [
        # 5 seeds, 5 variations, 2 laws: nothing is drawn where the host polls the card's counter
        (Host(), True, {"closed-position": 5, "open-velocity-sleep": 5}),
        (Host(), False, {"closed-position": 3, "open-velocity-sleep": 3}),
        # law 2 sleeps on whatever host: its timer has a granularity, or wakes late
        (Host(granularity=0.01), False, {"closed-position": 3, "open-velocity-sleep": 15}),
        (Host(jitter=0.001), True, {"closed-position": 5, "open-velocity-sleep": 25}),
        (Host(timer="sleep"), True, {"closed-position": 5, "open-velocity-sleep": 5}),
        (
            Host(timer="sleep", jitter=0.001),
            True,
            {"closed-position": 25, "open-velocity-sleep": 25},
        ),
    ],
)
def test_equal_runs_are_made_once(rig, host, friction, expected):
    grid = Grid(tuple(map(read_setting, ("6", "2"))), ("dash",), seeds=tuple(range(5)))
    drives = rig.drives if friction else without_friction(rig)
    bench = replace(rig, host=host, drives=drives)
    cells = list_cells(grid, bench)
    assert {law: [cell.setting.law for cell in cells].count(law) for law in expected} == expected
    facts = described(grid, bench)
    assert len(facts["variations"]) == (5 if friction else 3)
    assert len(facts["seeds"]) == (5 if max(expected.values()) > 5 else 1)


def test_runs_that_are_left_out_equal_those_that_stand_for_them(rig):
    """Every run of the grid, against the one that is made in its place; the others differ."""
    bench = replace(rig, host=Host(jitter=0.01), drives=without_friction(rig))
    grid = Grid(tuple(map(read_setting, ("6", "2"))), ("dash",), seeds=(0, 1, 2))
    figures = [[], []]
    for n, cells in enumerate(([*grid], list_cells(grid, bench))):
        for law in ("closed-position", "open-velocity-sleep"):
            own = [cell for cell in cells if cell.setting.law == law]
            figures[n] += [tuple(one.figures.items()) for one in score(own, bench)]
    assert len(figures[0]) == 30
    assert len(figures[1]) == 3 + 9
    assert set(figures[0]) == set(figures[1])
    assert len(set(figures[1])) == len(figures[1])


CORNERS = {
    # points (m), and the shares of the way and of the time at which corners are
    "square": (((0.02, 0, 0), (0.02, 0.02, 0), (0, 0.02, 0), (0, 0, 0)), (0.25, 0.5, 0.75)),
    "straight on": (((0.01, 0, 0), (0.02, 0, 0)), (0.5,)),
}


@pytest.mark.parametrize("name", CORNERS)
def test_corners_are_where_the_path_turns_or_rests(name):
    points, shares = CORNERS[name]
    machine = load_machine("cartesian")
    path = actuate(Program(tuple(Line(np.array(point)) for point in points)), machine)
    corners = find_corners(time_path(path, "trapezoid", 0.1, 4.0), machine)
    assert [one["t_s"] for one in corners] == pytest.approx([4.0 * share for share in shares])
    length = float(path.breaks[-1])
    assert [one["s_m"] for one in corners] == pytest.approx([length * share for share in shares])


@pytest.mark.parametrize("kind", ["spline", "blend"])
def test_what_is_smooth_has_no_corners(kind):
    """Forty points of a spline, and a corner that is rounded."""
    machine = load_machine("cartesian")
    angle = np.linspace(0, 2 * np.pi, 41)[1:]
    points = 0.02 * np.column_stack([np.sin(angle), 1 - np.cos(angle), 0 * angle])
    segments = {
        "spline": (Spline(points),),
        "blend": (Line([0.02, 0, 0], join=Blend(1e-4)), Line([0.02, 0.02, 0])),
    }
    path = actuate(Program(segments[kind]), machine)
    assert len(path.pieces) > 2
    assert find_corners(time_path(path, "trapezoid", 0.1, 4.0), machine) == []
