"""Runs of tracking laws whose errors are known, saved as a sweep saves them."""

from math import inf

import numpy as np

from benchmarks.sweep import VARIATIONS, Cell, RunResult, RunSeries, Setting
from benchmarks.sweep.result import Store, load_runs

DT = 0.01
# by which each rig multiplies the errors
FACTORS = (1, 1.1, 0.9, 1.2, 0.8)


def course(offset, turn=1.0, radius=0.1):
    """Once round a circle in 4 s, `offset` too large a circle, and 1 s of rest."""
    t = np.arange(0, 5, DT)
    angle = turn * 2 * np.pi * np.minimum(t / 4, 1)
    ray = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    planned = radius * ray
    actual = (radius + offset) * ray
    length = radius * abs(angle)
    size = np.full(len(t), abs(offset))
    torque = np.column_stack([0.2 * np.sin(t), 0.1 * np.cos(t)])
    axes = np.column_stack([angle, 2 * angle])
    return RunSeries(t, length, planned, actual, size, size, torque, axes, axes + offset)


def result(setting, task, variation, error, end=4.1, failure=""):
    cell = Cell(setting, task, variation)
    if failure:
        return RunResult(cell, failure=failure)
    figures = {
        "contour_rms": error,
        "contour_max": 2 * error,
        "tracking_rms": 5 * error,
        "late": end - 4,
        "end_time": end,
    }
    figures |= {"torque_rms": 0.1, "torque_peak": 0.2 + error, "vibration_power": 1e-12}
    return RunResult(cell, figures, series=course(error, -1.0 if task == "back" else 1.0))


def law(gain):
    return Setting("closed-position", (("gain", gain),))


BASE, GOOD, SAME, WORSE, WILD, DEAD = (law(gain) for gain in (0.7, 0.3, 0.71, 0.9, 1.2, 1.5))
ERRORS = {BASE: 100e-6, GOOD: 40e-6, SAME: 100.2e-6, WORSE: 150e-6, WILD: 9000e-6, DEAD: 100e-6}


def saved(folder, tasks=("there", "back"), rig="rig", errors=ERRORS):
    """Save runs whose errors are known: each rig multiplies them by its factor.

    Of GOOD, the factors grow by 5 % from rig to rig. DEAD fails on the second one, and WILD never
    comes to its goal.
    """
    store = Store(folder)
    keys = []
    for setting, error in errors.items():
        end = inf if setting == WILD else 4.1
        for task in tasks:
            for n, (variation, factor) in enumerate(zip(VARIATIONS, FACTORS, strict=True)):
                factor = factor * 1.05**n if setting == GOOD else factor
                failure = "refused: too fast" if setting == DEAD and n == 1 else ""
                one = result(setting, task, variation, error * factor, end, failure)
                keys.append(f"{len(keys):04d}")
                store.keep(keys[-1], one)
    record = {
        "rig": rig,
        "sha256": {"rig": "1" * 64, "tasks": dict.fromkeys(tasks, "2" * 64), "code": "3" * 64},
        "seeds": [0],
        "variations": [variation.name for variation in VARIATIONS],
        "tasks": {
            task: {
                "duration_s": 4.0,
                "dt_s": 0.125,
                "unit": "m" if space else "rad",
                "space": space,
                "resolution": 1e-6,
                "corners": [{"t_s": 1.0, "s_m": 0.1}],
            }
            for task in tasks
            for space in [not task.startswith("axes")]
        },
        "axes": {"a": "rad", "b": "rad"},
        "versions": {"pulsepath": "0.0"},
    }
    store.record(record, keys)
    return load_runs(folder)
