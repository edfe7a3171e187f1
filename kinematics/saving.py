"""What results of this package are saved as, beside tables."""

from collections.abc import Callable, Mapping
from pathlib import Path

from kinematics.foundation.result import saves
from kinematics.machine.machine import Machine
from kinematics.machine.machine_writer import machine_toml


@saves(Machine)
def machine_files(machine: Machine) -> Mapping[str, Callable[[Path], object]]:
    """.toml: a file that `load_machine` reads, where `machine_toml` can write the kind."""
    return {".toml": lambda path: path.write_bytes(machine_toml(machine).encode())}
