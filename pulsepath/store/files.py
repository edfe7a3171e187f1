"""Names of the files in a plan's folder."""

from pulsepath.output.directory import REPORT

SOURCES = {"program": "program.toml", "machine": "machine.toml"}
MOTION = "motion.bin"
# Chosen orientation of free segments, by their index from 0.
ORIENTATION = "orientation.json"
TRAJECTORY = "trajectory.csv"
CSV, BINARY = "pulses.csv", "pulses.bin"
# File of the pulses, by its requested form.
PULSES = {"csv": CSV, "binary": BINARY, "none": None}
# Verdict on the file of pulses.
CERTIFICATE = "certificate.json"
# Triggers, if the program has any.
TRIGGERS = "triggers.csv"
# Table of stops, if it was requested.
STOPS = "stops.csv"
# Errors of tracking laws, written by the command track.
TRACK = "track.json"
# Files that no command reads, so that they may be missing.
DERIVED = (
    TRAJECTORY,
    CSV,
    BINARY,
    CERTIFICATE,
    TRIGGERS,
    STOPS,
    REPORT,
    "figures",
)
