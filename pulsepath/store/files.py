"""Names of the files in a plan's folder."""

from pulsepath.output.directory import REPORT, TRIGGERS

CERTIFICATE = "certificate.json"
"""Verdict of the check of the pulse file."""
TRAJECTORY = "trajectory.csv"
TRACK = "track.json"
BINARY = "pulses.bin"
PULSES = {"csv": "pulses.csv", "binary": BINARY, "none": None}
"""File of the pulses, by its requested form."""
STOPS = "stops.csv"
"""Table of stops, if it was requested."""
ORIENTATION = "orientation.json"
"""Chosen orientation of free segments, by their index from 0."""
SOURCES = {"program": "program.toml", "machine": "machine.toml"}
DERIVED = (
    TRAJECTORY,
    "pulses.csv",
    BINARY,
    CERTIFICATE,
    TRIGGERS,
    STOPS,
    REPORT,
    "figures",
)
"""Files that no command reads, so that they may be missing."""
