"""Files of this package's results, next to tables."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from kinematics.foundation.result import saves
from planner.export import motion_file, plan_files
from planner.export.formats import binary, npz
from planner.interruption.hold import Stops
from planner.program.model import Program
from planner.program.program_writer import program_toml
from planner.pulses.schedule import PulseSchedule
from planner.sources.position_list import PositionList, positions_csv
from planner.trajectory import Trajectory

Files = Mapping[str, Callable[[Path], object]]


@saves(Program)
def program_files(program: Program) -> Files:
    """Save a program as .toml, which `load_program` reads."""
    return {".toml": lambda path: path.write_bytes(program_toml(program).encode())}


@saves(Trajectory)
def trajectory_files(trajectory: Trajectory) -> Files:
    """Save a trajectory as .csv: `data()` in 12 digits; .bin and .json: its exact pieces."""
    return {
        ".csv": partial(plan_files.write_trajectory_csv, trajectory),
        ".bin": partial(motion_file.write_motion, trajectory),
        ".json": partial(motion_file.write_motion_json, trajectory),
    }


@saves(PulseSchedule)
def schedule_files(schedule: PulseSchedule) -> Files:
    """Save pulses as .bin and .npz: exact, as `export` writes them."""
    return {".bin": partial(binary.write, schedule), ".npz": partial(npz.write, schedule)}


@saves(Stops)
def stop_files(stops: Stops) -> Files:
    """Save stops as .npz: t, place, time and distance, little-endian float64, for `numpy.load`."""

    def write_arrays(path: Path) -> None:
        arrays = {
            name: getattr(stops, name).astype("<f8") for name in ("t", "place", "time", "distance")
        }
        with path.open("wb") as file:
            np.savez(file, **arrays)

    return {".npz": write_arrays}


@saves(PositionList)
def list_files(listed: PositionList) -> Files:
    """Save positions as .csv in mm and degrees, which `load_positions` reads."""
    return {".csv": lambda path: path.write_bytes(positions_csv(listed).encode())}
