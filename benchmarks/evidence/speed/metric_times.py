"""How fast a batch of runs is judged: `python -m benchmarks.evidence.speed.metric_times`.

1000 runs of the thesis reference (the task `line` of the rig `servo-rig`: three axes, 41 samples, 5 s and half a second
of settling) under law 6, each with a gain of its own, are simulated in parts
(`benchmarks.evidence.speed.closed_loop`); timed are the
figures alone, in this process: errors every 5 ms through the arm's forward kinematics and beside the path, settling,
vibration and effort at every sample of the record.

Options: --runs N, --part N.
"""

from __future__ import annotations

import argparse
from time import perf_counter, process_time

import numpy as np

from benchmarks.evidence.speed.closed_loop import BATCH_SIZE, PERIOD, RunBatch
from controllers.metrics import evaluate_runs
from controllers.rig_file import load_rig


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
    parser.add_argument("--part", type=int, default=BATCH_SIZE)
    options = parser.parse_args()
    figures, clock, processor = time_metrics(np.linspace(0.0, 1.0, options.runs).tolist(), options.part)
    contour = np.array([run["contour_rms"] for run in figures])
    print(
        f"{len(figures[0])} figures each of {options.runs} runs of the thesis reference, recorded every "
        f"{PERIOD * 1e3:g} ms: "
        f"{clock:.2f} s, {processor:.2f} s of one processor; RMS contour error from {contour.min() * 1e6:.1f} µm"
    )


if __name__ == "__main__":
    main()
