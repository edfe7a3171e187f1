"""What was proved of a written file of pulses, as plain data: the content of certificate.json."""

from collections.abc import Iterable
from dataclasses import asdict
from hashlib import file_digest
from math import isfinite
from pathlib import Path

from planner import Plan
from planner.pulses import PulseCheck
from pulsepath.record import SCHEMA, Record


def of_pulse_file(path: Path, plan: Plan, verdict: PulseCheck) -> Record:
    """What was proved of a file of pulses; times in s, None where there is nothing to time."""
    return {
        "schema": SCHEMA,
        "kind": "pulsepath pulse certificate",
        "file": path.name,
        "sha256": _digest(path),
        "clock_hz": plan.pulses.clock_hz,
        "rule": plan.pulses.rule,
        "duration_s": plan.pulses.duration,
        "holds": verdict.holds,
        "faults": [asdict(fault) for fault in verdict.faults],
        "axes": {
            one.name: {
                "pulses": one.pulses,
                "start_count": held.start,
                "final_count": held.final,
                "final_error_pulses": _finite(one.final_error),
                "bound_pulses": held.bound,
                "time_error_ticks": None if one.time_error is None else _finite(one.time_error),
                "position_error_beyond_bound_pulses": _finite(one.position_error),
                "error_behind_play_and_screw_pulses": None if one.behind is None else _finite(one.behind),
                "smallest_interval_s": _finite(one.smallest_interval),
                "highest_rate_hz": 1 / one.smallest_interval if one.smallest_interval > 0 else None,
                "lines_s": _times(one.lines, ("high", "low", "setup", "hold")),
                "drive_needs_s": _times(driven.timing, ("high", "low", "setup", "hold", "max_rate")),
            }
            for one, held, driven in zip(verdict.axes, plan.pulses.axes, plan.machine.axes, strict=True)
        },
    }


def _finite(value: float) -> float | None:
    return value if isfinite(value) else None


def _times(of: object, names: Iterable[str]) -> Record | None:
    if of is None:
        return None
    return {name: None if (value := getattr(of, name)) is None else _finite(value) for name in names}


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return file_digest(file, "sha256").hexdigest()
