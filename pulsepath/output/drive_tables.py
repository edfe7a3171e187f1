"""Times on the lines STEP and DIR against the needs of drives, from the record of pulses."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from kinematics.foundation.table import Column, Table

# Multiple of a drive's need below which a time is reported on the first screen.
CLOSE = 1.2
TIMES = {"high": "STEP high", "low": "STEP low", "setup": "DIR set-up", "hold": "DIR hold"}
# What the width of STEP decides, which is chosen; the motion decides the rest.
CHOSEN = ("high", "hold")
RATE = "highest rate"


class Margin(NamedTuple):
    """Margin of an axis' drive: ratio of a time to the need, or of the largest rate to the
    highest.
    """

    ratio: float
    message: str
    key: str


def tabulate_drives(pulses: Mapping[str, Any]) -> list[Table]:
    """Return the table of the shortest times and highest rates of axes, and of their drives'
    needs.
    """
    timed = {name: axis for name, axis in pulses["axes"].items() if axis.get("lines_s")}
    if not timed:
        return []
    columns = [Column("axis", [*timed])]
    for key, title in TIMES.items():
        cells = []
        for axis in timed.values():
            needs = axis["drive_needs_s"] or {}
            cells.append(_pair(axis["lines_s"][key], needs.get(key), 1e6))
        columns.append(Column(f"{title} (µs)", cells, right=True))
    rates = [_pair(axis["highest_rate_hz"], _find_rate(axis), 1e-3) for axis in timed.values()]
    columns.append(Column(f"{RATE} (kHz)", rates, right=True))
    notes = ["DIR changes when STEP falls, and is right for the first pulse from time 0 on"]
    if not any(axis["drive_needs_s"] for axis in timed.values()):
        notes.append(
            'the machine states no timing of its drives: timing = "DRV8825" in [axes] checks it',
        )
    title = "lines of STEP and DIR: the shortest time, and after / the time that the drive needs"
    return [Table(title, tuple(columns), tuple(notes))]


def add_close_drives(tables: Sequence[Table], pulses: Mapping[str, Any]) -> list[Table]:
    """Add the drive that is closest to its needs to the first screen, if it is close."""
    margins = [each for each in _list_margins(pulses) if each.key not in CHOSEN]
    closest = min(margins, default=None)
    if closest is None or closest.ratio >= CLOSE:
        return [*tables]
    first, *rest = tables
    labels, values = first.columns
    columns = (
        replace(labels, values=[*labels.values, "drive timing"]),
        replace(values, values=[*values.values, f"{closest.message}; all with -v"]),
    )
    return [replace(first, columns=columns), *rest]


def find_drive_margin(pulses: Mapping[str, Any]) -> float | None:
    """Return the smallest ratio of a line's time to the drive's need. None: no drive states any.

    Rates count too: the largest that an axis allows over its highest.
    """
    return min((margin.ratio for margin in _list_margins(pulses)), default=None)


def _list_margins(pulses: Mapping[str, Any]) -> Iterator[Margin]:
    """Yield the margin of each time and rate that a drive states."""
    for name, axis in pulses["axes"].items():
        lines = axis.get("lines_s") or {}
        needs = axis.get("drive_needs_s") or {}
        for key, title in TIMES.items():
            time = lines.get(key)
            needed = needs.get(key)
            if time is not None and needed:
                measured = f"{title} of {name} {1e6 * time:.4g} us"
                message = f"{measured}, its drive needs {1e6 * needed:.4g}"
                yield Margin(time / needed, message, key)
        rate = axis["highest_rate_hz"] if needs else None
        most = needs.get("max_rate")
        if rate and most:
            message = f"{name} up to {rate / 1e3:.4g} kHz, its drive takes {most / 1e3:.4g}"
            yield Margin(most / rate, message, RATE)


def _find_rate(axis: Mapping[str, Any]) -> float | None:
    """Return the most pulses (1/s) that the axis takes, by its drive or as stated. None: any."""
    needs = axis["drive_needs_s"]
    rates = [axis["max_pulse_rate_hz"]]
    if needs:
        rates += [1 / (needs["high"] + needs["low"]), needs["max_rate"]]
    return min((rate for rate in rates if rate), default=None)


def _pair(time: float | None, needed: float | None, scale: float) -> str:
    """Format time / need; "–" without pulses to time, and the time alone without a need."""
    shown = "–" if time is None else f"{scale * time:.6g}"
    return shown if needed is None else f"{shown} / {scale * needed:.6g}"
