"""How fast closed loops are simulated, and judged: `python -m benchmarks.evidence.speed.closed_loop`.

1000 runs of the thesis reference (the task `line` of the rig `servo-rig`: three axes, 41 samples, 5 s and half a second
of settling) under law 6, each with a gain of its own, in parts, in as many processes as asked for. Then the figures
alone, in this process: errors every 5 ms through the arm's forward kinematics and beside the path, settling, vibration
and effort at every sample of the record.

Options: --runs N, --workers N (0: in this process), --part N.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from resource import RUSAGE_CHILDREN, RUSAGE_SELF, getrusage
from time import perf_counter, process_time

import numpy as np

from benchmarks.evidence.measuring import time_calls
from controllers.laws.registry import find_law
from controllers.metrics import evaluate_runs
from controllers.rig_file import load_rig
from controllers.simulate import Runs, sample, simulate
from kinematics.foundation.arrays import Array

PERIOD = 1e-3
BATCH_SIZE = 250
"""Runs that are simulated at once: with the records of one part in memory, not of all."""


@dataclass(frozen=True, slots=True)
class RunBatch:
    """Runs of the thesis reference, by their gains."""

    gains: tuple[float, ...]

    def runs(self) -> Runs:
        rig = load_rig("servo-rig")
        task = rig.task("line")
        reference = sample(task.motion, rig.machine, task.dt)
        law = find_law("6", gain=np.array(self.gains)[:, None])
        return simulate(reference, law, [rig] * len(self.gains), period=PERIOD)

    def __call__(self) -> Array:
        """RMS (B, n) of what each axis lags behind the card's counter, pulses."""
        runs = self.runs()
        return np.asarray(np.sqrt(np.mean((runs.command - runs.actual) ** 2, 0)))


def run(part: RunBatch) -> Array:
    return part()


def simulate_runs(gains: Sequence[float], workers: int, size: int = BATCH_SIZE) -> Array:
    """The figures (runs, n) of all gains, in parts of a size, in this process (0 workers) or in others."""
    parts = [RunBatch(tuple(gains[first : first + size])) for first in range(0, len(gains), size)]
    if not workers:
        return np.concatenate([part() for part in parts])
    with ProcessPoolExecutor(workers) as pool:
        return np.concatenate(list(pool.map(run, parts)))


def time_metrics(gains: list[float], size: int = BATCH_SIZE) -> tuple[list[dict[str, float]], float, float]:
    """The figures of every gain; seconds on the clock and of the processor for them, simulation left out."""
    rig = load_rig("servo-rig")
    task = rig.task("line")
    figures: list[dict[str, float]] = []
    clock = processor = 0.0
    for first in range(0, len(gains), size):
        part = RunBatch(tuple(gains[first : first + size]))
        runs = part.runs()
        begun = perf_counter(), process_time()
        figures += [metrics.figures() for metrics in evaluate_runs(runs, task, [rig] * len(part.gains))]
        clock, processor = clock + perf_counter() - begun[0], processor + process_time() - begun[1]
    return figures, clock, processor


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--part", type=int, default=BATCH_SIZE)
    options = parser.parse_args()
    gains = np.linspace(0.0, 1.0, options.runs).tolist()
    rms, (seconds,) = time_calls(lambda: simulate_runs(gains, options.workers, options.part), clock=perf_counter)
    used = sum(sum(getrusage(who)[:2]) for who in (RUSAGE_SELF, RUSAGE_CHILDREN))
    print(
        f"{options.runs} closed-loop runs of the thesis reference (3 axes, 5 s) on {options.workers} workers: "
        f"{seconds:.2f} s\n"
        f"{used:.2f} s of processor time, imports and rigs included; RMS lag {rms.mean(0).round(1)} pulses"
    )
    figures, clock, processor = time_metrics(gains, options.part)
    contour = np.array([run["contour_rms"] for run in figures])
    print(
        f"{len(figures[0])} figures each of {options.runs} runs of the thesis reference, recorded every "
        f"{PERIOD * 1e3:g} ms: "
        f"{clock:.2f} s, {processor:.2f} s of one processor; RMS contour error from {contour.min() * 1e6:.1f} µm"
    )


if __name__ == "__main__":
    main()
