"""Verify that a directory still holds what was proved: digests of its files, and the proof itself.

Digests show accidental changes. They can be forged, so nothing relies on them alone: a motion is certified again
whenever it is loaded, and pulses are compared with those that were checked.
"""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from hashlib import file_digest, sha256
from pathlib import Path
from typing import Any

from kinematics.files.chunk_file import holds_chunks
from kinematics.foundation.errors import MotionError
from kinematics.machine.axis import Axis
from kinematics.machine.machine import Machine
from planner.certificate.certify import Certificate, certify
from planner.limits import Limit
from planner.parallel import Progress, ignore_progress
from planner.plan_source import PlanSource
from planner.pulses import AxesMotion, PulseCheck, PulseSchedule, check, check_file
from planner.pulses.checking.edge_reader import check_file_parts
from planner.shaping.shaped_motion import shape_motion
from planner.shaping.shaped_proof import ShapedProof, prove_shaped
from planner.trajectory import Trajectory
from pulsepath.output.directory import RECORD

Record = dict[str, Any]

REMEDY = "plan it again, or give --unverified to continue"
PROVENANCE, FILES, SELF = "provenance", "files", "record"


def seal_record(record: Record, folder: Path) -> Record:
    """Return the record with the SHA-256 of every file in the folder, and of the record without its own digest."""
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    files = {path.relative_to(folder).as_posix(): digest(path) for path in paths}
    known = {**record, PROVENANCE: {**record[PROVENANCE], FILES: files}}
    return {**known, PROVENANCE: {**known[PROVENANCE], SELF: _digest_record(known)}}


def digest(path: Path) -> str:
    """SHA-256 of a file's content, in hexadecimal digits."""
    with path.open("rb") as file:
        return file_digest(file, "sha256").hexdigest()


def digest_pulses(parts: Iterable[PulseSchedule]) -> str:
    """SHA-256 of the SHA-256 of each axis' ticks, and of its directions, in turn: int64 and int8, little end first.

    Of a schedule in one or more parts, wherever it is cut.
    """
    found: list[Any] = []
    for part in parts:
        found = found or [sha256() for _ in range(2 * len(part.axes))]
        for k, axis in enumerate(part.axes):
            found[2 * k].update(axis.ticks.astype("<i8", copy=False).tobytes())
            found[2 * k + 1].update(axis.direction.astype("i1", copy=False).tobytes())
    return sha256(b"".join(each.digest() for each in found)).hexdigest()


def find_differences(
    record: Record, folder: Path, name: str, needed: Sequence[str] = (), derived: Sequence[str] = ()
) -> list[str]:
    """What in a folder is not as its record, the file `name`, has it.

    needed: files that the record must have; derived: those that may be gone
    """
    provenance = record.get(PROVENANCE)
    files = provenance.get(FILES) if isinstance(provenance, dict) else None
    if not isinstance(provenance, dict) or not isinstance(files, dict):
        return [f"{folder / name} has no digests of the files beside it"]
    known = {**record, PROVENANCE: {key: value for key, value in provenance.items() if key != SELF}}
    found = (
        [] if _digest_record(known) == provenance.get(SELF) else [f"{folder / name} was changed after it was written"]
    )
    for file in dict.fromkeys((*needed, *files)):
        path = folder / file
        if file not in files:
            found.append(f"{path} is not in {name}")
        elif path.is_file():
            if digest(path) != files[file]:
                found.append(f"{path} was changed after it was written")
        elif file.partition("/")[0] not in derived:
            found.append(f"{path} is not there")
    return found


def changes(record: Record, folder: Path, name: str, target: Path, made: Path) -> bool:
    """Whether `made`, in the target's place, would differ from what the record, the file `name` of a folder, holds."""
    provenance = record.get(PROVENANCE)
    files = provenance.get(FILES) if isinstance(provenance, dict) else None
    place = target.resolve()
    if place == (folder / name).resolve():
        return True
    known = files if isinstance(files, dict) else {}
    return any(place == (folder / file).resolve() and digest(made) != known[file] for file in known)


def prove_motion(
    trajectory: Trajectory, limits: Sequence[Limit], axes: Sequence[Axis]
) -> tuple[Certificate, ShapedProof | None]:
    """Return the certificate of a motion, and the proof after the input shapers of its axes.

    There is a second proof only for axes with shapers, and if the certificate holds.
    """
    certificate = certify(trajectory, limits)
    shaped = shape_motion(trajectory, axes) if certificate.holds else None
    if shaped is None:
        return certificate, None
    return certificate, prove_shaped(shaped, trajectory, axes, limits, certificate)


def find_violation(trajectory: Trajectory, limits: Sequence[Limit], axes: Sequence[Axis] = ()) -> str | None:
    """Return why a motion does not keep its limits, of several the worst; None where it is proved that it does.

    axes: behind whose input shapers it has to keep them as well
    """
    certificate, shaped = prove_motion(trajectory, limits, axes)
    proofs: list[tuple[str, Certificate | ShapedProof]] = [("", certificate)]
    if shaped is not None:
        proofs.append((" behind its input shapers", shaped))
    for where, proof in proofs:
        if not proof.holds:
            name = max(proof.worst, key=lambda each: proof.worst[each])
            return f"the motion{where} uses {proof.worst[name]:.6g} times its limit on {name}, at {proof.where[name]}"
    return None


def refuse(doubts: Sequence[str]) -> None:
    """Raise MotionError for what was found, if anything."""
    if doubts:
        raise MotionError(f"{'; '.join(doubts)}: {REMEDY}")


def _digest_record(record: Any) -> str:
    return sha256(json.dumps(record, sort_keys=True).encode()).hexdigest()


def refuse_own(folder: Path, target: Path, made: Path) -> None:
    """Raise MotionError where `made`, in the target's place, would change a file of the plan in a folder."""
    record = json.loads((folder / RECORD).read_bytes())
    if changes(record, folder, RECORD, target, made):
        raise MotionError(
            f"{target} is one of the plan's own files, and replacing it would invalidate the plan: give another --out"
        )


def check_pulses(
    file: Path | None,
    machine: Machine,
    source: PlanSource,
    progress: Progress = ignore_progress,
) -> PulseCheck:
    """Check a file of pulses, or without a file the pulses themselves, against the motion of a plan.

    The motion of a plan that was made in parts is followed part by part, in little memory. A file of
    edges is checked against the whole motion.
    """
    if file is None:
        pulses = source.read_pulses(progress)
        return check(pulses, source.counted, machine.axes, machine.home_q)
    if source.in_parts and holds_chunks(file):
        return check_file_parts(file, source.schedule, machine, source.follow(), progress)
    return check_file(file, StatedPulses(machine, source.counted, source.schedule), progress)


@dataclass(frozen=True, slots=True)
class StatedPulses:
    """Statements about the pulses of a motion, which a file is checked against."""

    machine: Machine
    counted: AxesMotion
    pulses: PulseSchedule
