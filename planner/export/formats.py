"""Which formats there are: one line each, loaded when one is asked for."""

from planner.export.format import Format
from planner.plugged import plugged

FORMATS = {
    "pulses": "planner.export.pulse_csv:PulseCsv",
    "vcd": "planner.export.vcd:Vcd",
    "steps": "planner.export.steps:Steps",
    "npz": "planner.export.npz:Npz",
    "zaber": "planner.export.zaber:ZaberCsv",
    "xps": "planner.export.xps:Xps",
    "pmac": "planner.export.pmac:Pmac",
    "g93": "planner.export.g93:InverseTime",
    "ros": "planner.export.ros:JointTrajectory",
    "halstreamer": "planner.export.halstreamer:Halstreamer",
    "galil": "planner.export.galil:Galil",
    "adlink": "planner.export.adlink_c:AdlinkC",
    "adlink-csv": "planner.export.adlink_csv:AdlinkCsv",
    "kmitl-arms": "planner.export.kmitl_arms:KmitlArms",
    "kmitl-positions": "planner.export.kmitl_positions:KmitlPositions",
    "byte": "planner.export.kmitl_byte:KmitlByte",
    "sahbaz": "planner.export.sahbaz:Sahbaz",
    "sasidhar": "planner.export.sasidhar:Sasidhar",
}
"""Module and class by the name that the command line knows."""


def find_format(name: str) -> type[Format]:
    """The format of a name. Raises MotionError for an unknown one, with the nearest and all known ones."""
    found: type[Format] = plugged("format", FORMATS, name)
    return found
