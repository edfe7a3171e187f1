"""Times on the lines STEP and DIR against the needs of the drives, from the record of a plan's pulses."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from math import inf
from typing import Any

from kinematics.foundation.table import Column, Table

CLOSE = 1.2
"""Multiple of a drive's need below which a time is reported on the first screen."""
TIMES = {"high": "STEP high", "low": "STEP low", "setup": "DIR set-up", "hold": "DIR hold"}
BY_MOTION = ("low", "setup")
"""The times that the pulses decide; the others are the width of STEP, which is chosen."""


def tabulate_drives(pulses: Mapping[str, Any]) -> list[Table]:
    """Return tables of the shortest times and highest rates of each axis, and of its drive's needs."""
    timed = {name: axis for name, axis in pulses["axes"].items() if axis.get("lines_s")}
    if not timed:
        return []
    columns = [Column("axis", [*timed])]
    for key, title in TIMES.items():
        kept = [axis["lines_s"][key] for axis in timed.values()]
        needed = [(axis["drive_needs_s"] or {}).get(key) for axis in timed.values()]
        columns.append(Column(f"{title} (µs)", [_pair(*of, 1e6) for of in zip(kept, needed, strict=True)], right=True))
    rates = [_pair(axis["highest_rate_hz"], _find_rate(axis), 1e-3) for axis in timed.values()]
    columns.append(Column("highest rate (kHz)", rates, right=True))
    notes = ["DIR changes when STEP falls, and is right for the first pulse from time 0 on"]
    if not any(axis["drive_needs_s"] for axis in timed.values()):
        notes.append('the machine states no timing of its drives: timing = "DRV8825" in [axes] has it checked')
    return [
        Table(
            "lines of STEP and DIR: the least time kept, and behind / what the drive needs",
            tuple(columns),
            tuple(notes),
        )
    ]


def add_close_drives(tables: Sequence[Table], pulses: Mapping[str, Any]) -> list[Table]:
    """Add a line to the first screen about the drive that is closest to its needs, if one is close."""
    close = sorted(_find_close(pulses))
    if not close:
        return [*tables]
    first, *rest = tables
    what, values = first.columns
    message = f"{close[0][1]}; all with -v"
    return [
        replace(
            first,
            columns=(
                replace(what, values=[*what.values, "drive timing"]),
                replace(values, values=[*values.values, message]),
            ),
        ),
        *rest,
    ]


def find_drive_margin(pulses: Mapping[str, Any]) -> float | None:
    """Return the smallest ratio of a line's time to the drive's need. None: no drive states its needs.

    Rates count too: the largest that an axis allows over its highest.
    """
    shares = []
    for axis in pulses["axes"].values():
        lines, needs = axis.get("lines_s") or {}, axis.get("drive_needs_s") or {}
        shares += [lines[key] / needs[key] for key in TIMES if lines.get(key) is not None and needs.get(key)]
        if needs and axis["highest_rate_hz"] and needs.get("max_rate"):
            shares.append(needs["max_rate"] / axis["highest_rate_hz"])
    return min(shares, default=None)


def _find_close(pulses: Mapping[str, Any]) -> Iterator[tuple[float, str]]:
    """Return the ratio and a description of each drive that is close to its needs."""
    for name, axis in pulses["axes"].items():
        lines, needs = axis.get("lines_s"), axis.get("drive_needs_s")
        if not lines or not needs:
            continue
        for key in BY_MOTION:
            kept, needed = lines[key], needs[key]
            if kept is not None and kept < CLOSE * needed:
                message = f"{TIMES[key]} of {name} {1e6 * kept:.4g} us, its drive needs {1e6 * needed:.4g}"
                yield kept / needed, message
        rate, most = axis["highest_rate_hz"], needs["max_rate"]
        if rate and most and CLOSE * rate > most:
            yield most / rate, f"{name} up to {rate / 1e3:.4g} kHz, its drive takes {most / 1e3:.4g}"


def _find_rate(axis: Mapping[str, Any]) -> float | None:
    """1/s: the most pulses that the axis takes, by its drive or as stated; None: any."""
    needs = axis["drive_needs_s"]
    rates = [axis["max_pulse_rate_hz"]]
    if needs:
        rates += [1 / (needs["high"] + needs["low"]), needs["max_rate"]]
    least = min((rate for rate in rates if rate), default=inf)
    return None if least == inf else least


def _pair(kept: float | None, needed: float | None, scale: float) -> str:
    """Format kept / needed; "–" without pulses to time, and kept alone without a need."""
    had = "–" if kept is None else f"{scale * kept:.6g}"
    return had if needed is None else f"{had} / {scale * needed:.6g}"
