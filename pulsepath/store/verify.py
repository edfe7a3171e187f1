"""Verify the folder of a plan: the digests of its files, the proof of its motion, and its pulses.

Digests show accidental changes. They can be forged, so no command relies on them alone: a motion is
certified again whenever it is loaded, and pulses are compared with the checked ones.
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
    """Return the record with the SHA-256 of every file in the folder, and of the record without its
    own digest.
    """
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    files = {path.relative_to(folder).as_posix(): digest(path) for path in paths}
    known = {**record, PROVENANCE: {**record[PROVENANCE], FILES: files}}
    return {**known, PROVENANCE: {**known[PROVENANCE], SELF: _digest_record(known)}}


def digest(path: Path) -> str:
    """SHA-256 of a file's content, in hexadecimal digits."""
    with path.open("rb") as file:
        return file_digest(file, "sha256").hexdigest()


def digest_pulses(parts: Iterable[PulseSchedule]) -> str:
    """Return a SHA-256 of pulses, which does not depend on how they are cut into parts.

    It is the SHA-256 of the SHA-256 of each axis' ticks and of its directions, in turn, as
    little-endian int64 and int8.
    """
    hashes: list[Any] = []
    for part in parts:
        hashes = hashes or [sha256() for _ in range(2 * len(part.axes))]
        for k, axis in enumerate(part.axes):
            hashes[2 * k].update(axis.ticks.astype("<i8", copy=False).tobytes())
            hashes[2 * k + 1].update(axis.direction.astype("i1", copy=False).tobytes())
    return sha256(b"".join(each.digest() for each in hashes)).hexdigest()


def find_differences(
    record: Record,
    folder: Path,
    name: str,
    needed: Sequence[str] = (),
    derived: Sequence[str] = (),
) -> list[str]:
    """Return the differences between the files of a folder and the digests in its record.

    name: file of the record. needed: files that the record must list. derived: files that may be
    missing.
    """
    provenance = record.get(PROVENANCE)
    files = provenance.get(FILES) if isinstance(provenance, dict) else None
    if not isinstance(provenance, dict) or not isinstance(files, dict):
        return [f"{folder / name} has no digests of the other files"]
    without_own = {key: value for key, value in provenance.items() if key != SELF}
    known = {**record, PROVENANCE: without_own}
    differences: list[str] = []
    if _digest_record(known) != provenance.get(SELF):
        differences.append(f"{folder / name} was changed after it was written")
    for file in dict.fromkeys((*needed, *files)):
        path = folder / file
        if file not in files:
            differences.append(f"{path} is not in {name}")
        elif path.is_file():
            if digest(path) != files[file]:
                differences.append(f"{path} was changed after it was written")
        elif file.partition("/")[0] not in derived:
            differences.append(f"{path} is missing")
    return differences


def changes(record: Record, folder: Path, name: str, target: Path, made: Path) -> bool:
    """Return whether `made`, in the target's place, would change a file that a record lists.

    name: file of the record in the folder.
    """
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


def describe_violation(certificate: Certificate, shaped: ShapedProof | None) -> str | None:
    """Return why a motion does not keep its limits, by its worst one.

    None: it is proved that it does.
    """
    proofs: list[tuple[str, Certificate | ShapedProof]] = [("", certificate)]
    if shaped is not None:
        proofs.append((" after its input shapers", shaped))
    for name, proof in proofs:
        if not proof.holds:
            limit = max(proof.worst, key=lambda each: proof.worst[each])
            use = f"{proof.worst[limit]:.6g} times its limit on {limit}, at {proof.where[limit]}"
            return f"the motion{name} uses {use}"
    return None


def refuse(doubts: Sequence[str]) -> None:
    """Raise MotionError if there is any doubt."""
    if doubts:
        raise MotionError(f"{'; '.join(doubts)}: {REMEDY}")


def _digest_record(record: Any) -> str:
    return sha256(json.dumps(record, sort_keys=True).encode()).hexdigest()


def refuse_own(folder: Path, target: Path, made: Path) -> None:
    """Raise MotionError if `made`, in the target's place, would change a file of the plan in a
    folder.
    """
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
    """Check a file of pulses, or without a file the pulses themselves, against the motion of a
    plan.

    The motion of a plan that was made in parts is followed part by part, in little memory. A file
    of edges, and pulses of axes that make up for play or lead error, are checked against the whole
    motion.
    """
    if file is None:
        pulses = source.read_pulses(progress)
        return check(pulses, source.counted, machine.axes, machine.home_q)
    compensated = any(axis.compensate for axis in machine.axes)
    if source.in_parts and holds_chunks(file) and not compensated:
        return check_file_parts(file, source.schedule, machine, source.follow(), progress)
    return check_file(file, StatedPulses(machine, source.counted, source.schedule), progress)


@dataclass(frozen=True, slots=True)
class StatedPulses:
    """Statements about the pulses of a motion, which a file is checked against."""

    machine: Machine
    counted: AxesMotion
    pulses: PulseSchedule
