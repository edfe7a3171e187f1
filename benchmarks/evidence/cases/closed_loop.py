"""Time to simulate closed loops, and to evaluate them.

Runs of the thesis reference (the task `line` of the rig `servo-rig`: three axes, 41 samples, 5 s
and half a second of settling) under law 6, each with a gain of its own, in batches. Evaluated are
errors every 5 ms through the arm's forward kinematics and next to the path, settling, vibration and
effort at every sample of the record. The simulation runs on `--workers` processes, or in this one
for 0; the evaluation runs in this process.
"""

from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from benchmarks.evidence.measuring import measure_here
from benchmarks.evidence.table import Row, Table
from controllers.laws.registry import find_law
from controllers.metrics import evaluate_runs
from controllers.rig_file import load_rig
from controllers.simulate import Runs, sample, simulate
from kinematics.foundation.arrays import Array

PERIOD = 1e-3
# Runs that are simulated together: the records of one batch are in memory.
BATCH_SIZE = 250


def cut_batches(gains: Sequence[float], size: int = BATCH_SIZE) -> list[Sequence[float]]:
    """Return the gains in batches of a size."""
    return [gains[first : first + size] for first in range(0, len(gains), size)]


def simulate_batch(gains: Sequence[float]) -> Runs:
    """Simulate one run of the thesis reference for each gain."""
    rig = load_rig("servo-rig")
    task = rig.task("line")
    reference = sample(task.motion, rig.machine, task.dt)
    law = find_law("6", gain=np.array(gains)[:, None])
    return simulate(reference, law, [rig] * len(gains), period=PERIOD)


def find_lag(gains: Sequence[float]) -> Array:
    """Return the RMS lag (runs, axes) of each axis against the card's counter, in pulses."""
    runs = simulate_batch(gains)
    return np.asarray(np.sqrt(np.mean((runs.command - runs.actual) ** 2, 0)))


def simulate_runs(gains: Sequence[float], workers: int, size: int = BATCH_SIZE) -> Array:
    """Return the lags of all gains, simulated by worker processes, or here for 0 workers."""
    batches = cut_batches(gains, size)
    if not workers:
        return np.concatenate([find_lag(batch) for batch in batches])
    with ProcessPoolExecutor(workers) as pool:
        return np.concatenate(list(pool.map(find_lag, batches)))


def evaluate_batch(gains: Sequence[float], runs: Runs) -> list[dict[str, float]]:
    """Return the figures of each run of a batch."""
    rig = load_rig("servo-rig")
    metrics = evaluate_runs(runs, rig.task("line"), [rig] * len(gains))
    return [metric.figures() for metric in metrics]


def measure(runs: int = 1000, workers: int = 2, size: int = BATCH_SIZE) -> Iterator[Table]:
    """Yield the times of both."""
    gains = np.linspace(0.0, 1.0, runs).tolist()
    simulated = measure_here(simulate_runs, gains, workers, size)
    evaluated = [measure_here(evaluate_batch, batch, simulate_batch(batch)) for batch in cut_batches(gains, size)]
    wall = sum(batch.wall for batch in evaluated)
    processor = sum(batch.processor for batch in evaluated)
    rows: list[Row] = [
        [f"simulation, {workers} workers", simulated.wall, simulated.processor],
        ["evaluation", wall, processor],
    ]
    yield Table(f"{runs} closed loops", ("work", "wall time (s)", "processor time (s)"), rows)
