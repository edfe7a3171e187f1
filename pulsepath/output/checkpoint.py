"""checkpoint.json: where a plan stands that is made part by part, so that a run that was killed is gone on with.

It holds plain numbers only, and what the plan is of: a run with other inputs or options does not go on with it.
"""

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from kinematics import Machine, MotionError
from kinematics.files.atomic_files import name_file
from planner.avoidable_stops import AvoidableStops
from planner.certificate.certify import Certificate
from planner.path.outcome import FitSummary
from planner.place import Place
from planner.plan_parts import PlanMark, PlanStanding
from planner.pulses import PulseSchedule, find_rule
from planner.pulses.generation.stream import PulseStream
from planner.pulses.schedule import AxisPulses, MovedPulses
from planner.pulses.trigger_stream import Crossing
from planner.timing.problem import Continuation
from planner.windows import Start
from pulsepath import __version__
from pulsepath.output.directory import CHECKPOINT

KIND, SCHEMA = "pulsepath unfinished plan", 2
Record = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """Where a plan stands: sizes: bytes of the files that grow; complete: all is planned, to be checked and reported.

    reached: the same in words; command: that goes on from there
    ending: why it ends before its program does
    """

    mark: PlanMark
    sizes: Mapping[str, int]
    complete: bool
    reached: str
    command: str
    ending: str = ""


def write_checkpoint(folder: Path, of: Mapping[str, Any], reached: Checkpoint) -> None:
    """of: inputs and options. The file is replaced at once, or not at all."""
    record = {
        "kind": KIND,
        "schema": SCHEMA,
        "version": __version__,
        "of": of,
        "sizes": reached.sizes,
        "complete": reached.complete,
        "reached": reached.reached,
        "command": reached.command,
        "ending": reached.ending,
        "standing": _standing_record(reached.mark.standing),
        "stream": reached.mark.stream.mark(),
        "waiting": [asdict(crossing) for crossing in reached.mark.waiting],
    }
    new = folder / f"{CHECKPOINT}.new"
    with name_file(folder / CHECKPOINT), new.open("w", encoding="utf-8") as file:
        json.dump(record, file)
        file.flush()
        os.fsync(file.fileno())
    new.replace(folder / CHECKPOINT)


def holds_checkpoint(folder: Path) -> bool:
    return (folder / CHECKPOINT).is_file()


def read_checkpoint(folder: Path, of: Mapping[str, Any], machine: Machine) -> Checkpoint:
    """Where the plan in a folder stands. Raises MotionError for another plan's."""
    file = folder / CHECKPOINT
    try:
        record = json.loads(file.read_bytes())
        known = record["kind"], record["schema"]
        held, sizes = record["of"], {name: int(size) for name, size in record["sizes"].items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise MotionError(f"{file}: no checkpoint can be read from it ({error}): omit --resume") from None
    if known != (KIND, SCHEMA) or record.get("version") != __version__:
        raise MotionError(f"{file} was written by another version of pulsepath: omit --resume to begin anew")
    for name, value in json.loads(json.dumps(of)).items():
        if held.get(name) != value:
            told = f"other {name}" if isinstance(value, dict) else f"{name} {held.get(name)}, not {value}"
            raise MotionError(f"{file}: the plan was begun with {told}: give the same, or omit --resume")
    try:
        standing = _read_standing(record["standing"], machine)
        rule = find_rule(standing.pulses.rule)
        stream = PulseStream.resume(machine, standing.pulses.clock_hz, rule, record["stream"])
        waiting = tuple(
            Crossing(one["name"], Place(**one["where"]), tuple(map(float, one["numbers"]))) for one in record["waiting"]
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise MotionError(f"{file}: no checkpoint can be read from it ({error!r}): omit --resume") from None
    words = (str(record.get(name, "")) for name in ("reached", "command", "ending"))
    return Checkpoint(PlanMark(standing, stream, waiting), sizes, bool(record["complete"]), *words)


def _standing_record(standing: PlanStanding) -> Record:
    proof, pulses = standing.certificate, standing.pulses
    return {
        "program": standing.program,
        "order": standing.order,
        "start": _start_record(standing.start),
        "segment": standing.segment,
        "windows": standing.windows,
        "certificate": {
            "holds": proof.holds,
            "worst": proof.worst,
            "where": {name: asdict(place) for name, place in proof.where.items()},
            "use": {name: use.tolist() for name, use in proof.use.items()},
            "attained": {name: attained.tolist() for name, attained in proof.attained.items()},
        },
        "fit": None if standing.fit is None else asdict(standing.fit),
        "blends": standing.blends,
        "stops": standing.stops,
        "pulses": {
            "clock_hz": pulses.clock_hz,
            "rule": pulses.rule,
            "duration": pulses.duration,
            "axes": [[axis.name, axis.start, axis.pulse, axis.home, axis.bound] for axis in pulses.axes],
            "moves": [asdict(one) for one in pulses.moves],
        },
        "counted": standing.counted,
        "rounds": standing.rounds,
        "methods": dict(standing.methods),
        "triggers": standing.triggers,
        "avoidable": None if standing.avoidable is None else asdict(standing.avoidable),
    }


def _start_record(start: Start) -> Record:
    onward = start.continuation
    return {
        "elapsed": start.elapsed.as_integer_ratio(),
        "length": start.length,
        "steps": start.steps,
        "pieces": start.pieces,
        "speed": start.speed,
        "near": None if start.near is None else start.near.tolist(),
        "continuation": None
        if onward is None
        else {
            "s": onward.s.tolist(),
            "columns": onward.columns.tolist(),
            "room": {name: values.tolist() for name, values in onward.room.items()},
            "acceleration": onward.acceleration,
        },
    }


def _read_standing(record: Record, machine: Machine) -> PlanStanding:
    proof, pulses, fit = record["certificate"], record["pulses"], record["fit"]
    none = np.empty(0, np.int64), np.empty(0, np.int8)
    axes = [AxisPulses(name, *none, start, pulse, home, bound) for name, start, pulse, home, bound in pulses["axes"]]
    moves = tuple(MovedPulses(**one) for one in pulses["moves"])
    return PlanStanding(
        record["program"],
        machine,
        record["order"],
        _read_start(record["start"]),
        record["segment"],
        record["windows"],
        Certificate(
            proof["holds"],
            proof["worst"],
            {name: Place(**place) for name, place in proof["where"].items()},
            {name: np.array(use, float) for name, use in proof["use"].items()},
            {name: np.array(attained, float) for name, attained in proof["attained"].items()},
        ),
        None if fit is None else FitSummary(**fit | {"deviates_at": Place(**fit["deviates_at"])}),
        record["blends"],
        record["stops"],
        PulseSchedule(pulses["clock_hz"], tuple(axes), pulses["duration"], pulses["rule"], moves),
        tuple((number, net) for number, net in record["counted"]),
        record["rounds"],
        record["methods"],
        record["triggers"],
        None if record["avoidable"] is None else AvoidableStops(**record["avoidable"]),
    )


def _read_start(record: Record) -> Start:
    held, near = record["continuation"], record["near"]
    onward = None
    if held is not None:
        room = {name: np.array(values, float) for name, values in held["room"].items()}
        onward = Continuation(np.array(held["s"], float), np.array(held["columns"], float), room, held["acceleration"])
    return Start(
        Fraction(*record["elapsed"]),
        record["length"],
        record["steps"],
        record["pieces"],
        record["speed"],
        None if near is None else np.array(near, float),
        onward,
    )
