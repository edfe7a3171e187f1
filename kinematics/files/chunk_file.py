"""A file of chunks, written from its start to its end; the last chunk shows that it is complete.

    8 bytes   89 50 50 42 0D 0A 1A 0A
    uint32    version of this layout: 1
    chunks, one after the other:
        4 bytes   kind, in ASCII: HEAD, MARK, or one of this kind of file
        uint32    number, from 0
        uint64    length of the contents, bytes
        uint32    CRC-32 of the contents
        uint32    CRC-32 of the 20 bytes before
        contents

All numbers are little-endian. The first chunk is the HEAD, a JSON object with `kind` and `schema`
of the contents. The last chunk is the MARK, a JSON object with the totals and `"complete": true`. A
file without it was cut, and is refused.

A chunk has at most 2²⁸ bytes of contents.
"""

import json
import os
import struct
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from math import inf, isfinite
from os import PathLike
from pathlib import Path
from typing import Any, BinaryIO
from zlib import crc32

from kinematics.files.toml_document import unreadable_error
from kinematics.foundation.errors import Fault, FileError, MotionError

SIGNATURE = b"\x89PPB\r\n\x1a\n"
"""First bytes of such a file; transfers as text or by seven-bit lines would change them."""
VERSION = 1
HEAD, MARK = "HEAD", "MARK"
START = struct.Struct("<8sI")
HEADER, CHECKSUM = struct.Struct("<4sIQI"), struct.Struct("<I")
HEADER_BYTES = HEADER.size + CHECKSUM.size
MAX_CONTENTS = 1 << 28
"""Largest size (bytes) of the contents of a chunk, which are in memory at once."""
MAX_INTEGER = (1 << 63) - 1
"""Largest magnitude of an integer in a record: it fits into an int64."""
AGAIN = "write it again"


@dataclass(frozen=True, slots=True)
class Chunk:
    """A chunk in a file: the place (byte) and the length (bytes) of its contents."""

    kind: str
    number: int
    begin: int
    length: int
    checksum: int

    @property
    def end(self) -> int:
        return self.begin + self.length


@dataclass(frozen=True, slots=True)
class ChunkFile:
    """A complete file, whose chunks are read one by one.

    head, mark  the objects of its first and its last chunk
    chunks      the chunks between them, in order
    size        bytes of the file
    """

    path: Path
    head: Mapping[str, Any]
    mark: Mapping[str, Any]
    chunks: tuple[Chunk, ...]
    size: int

    def contents(self) -> Iterator[tuple[Chunk, bytes]]:
        """Read the chunks in order, one at a time. Raises FileError for a damaged one."""
        with self.path.open("rb") as file:
            for chunk in self.chunks:
                yield chunk, _read_contents(file, chunk, self.path)


class ChunkWriter:
    """Writes a file chunk by chunk."""

    __slots__ = ("_file", "_number")

    def __init__(self, file: BinaryIO, head: Mapping[str, Any]) -> None:
        """Write the start of a file and its HEAD."""
        self._file = file
        self._number = 0
        file.write(START.pack(SIGNATURE, VERSION))
        self.add(HEAD, _encode_record(head))

    def add(self, kind: str, contents: bytes) -> None:
        """Write a chunk."""
        if len(contents) > MAX_CONTENTS:
            raise MotionError(
                f"a chunk of {len(contents)} bytes: write parts of at most {MAX_CONTENTS}"
            )
        header = HEADER.pack(kind.encode("ascii"), self._number, len(contents), crc32(contents))
        self._file.write(header + CHECKSUM.pack(crc32(header)))
        self._file.write(contents)
        self._number += 1

    def finish(self, totals: Mapping[str, Any]) -> None:
        """Write the MARK, after which nothing may be added."""
        self.add(MARK, _encode_record({"complete": True, **totals}))
        self._file.flush()  # so that a full disk shows here, where the caller can name the file


def holds_chunks(path: str | PathLike[str]) -> bool:
    """Return whether a file begins with the signature."""
    with Path(path).open("rb") as file:
        return file.read(len(SIGNATURE)) == SIGNATURE


def open_chunks(
    path: str | PathLike[str],
    kind: str,
    schema: int,
    chunk_kinds: Collection[str],
) -> ChunkFile:
    """Find the chunks of a complete file of a kind; their contents are read later, one by one.

    chunk_kinds: kinds that the chunks between HEAD and MARK may have. Raises FileError for a file
    of another kind or version, one that is not complete, and one that cannot be opened.
    """
    place = Path(path)
    try:
        opened = place.open("rb")
    except (OSError, ValueError) as error:
        raise unreadable_error(place, error) from None

    with opened as file:
        size = os.fstat(file.fileno()).st_size
        _read_start(file, place)
        chunks, fault = _scan(file, size)
        if not chunks or chunks[0].kind != HEAD:
            raise _refusal(place, fault or f"has no {HEAD} at byte {START.size}", AGAIN)
        head = _read_record(file, chunks[0], place)
        _check_head(head, kind, schema, place)

        if not fault and chunks[-1].kind != MARK:
            fault = f"is not finished: it ends at byte {size} without a {MARK}"
        if fault:
            raise _refusal(place, fault, AGAIN)
        mark = _read_record(file, chunks[-1], place)
        if mark.get("complete") is not True:
            message = f"is not finished: its {MARK} does not say that it is complete"
            raise _refusal(place, message, AGAIN)

    between = chunks[1:-1]
    for chunk in between:
        if chunk.kind not in chunk_kinds:
            known = " and ".join(chunk_kinds)
            message = f"has chunk {chunk.number} of kind {chunk.kind!r}"
            raise _refusal(place, f"{message}, and this pulsepath reads {known}", AGAIN)
    return ChunkFile(place, head, mark, tuple(between), size)


def _read_start(file: BinaryIO, place: Path) -> None:
    start = file.read(START.size)
    if start[: len(SIGNATURE)] != SIGNATURE[: len(start)]:
        raise _refusal(
            place, f"is not a binary file of pulsepath: it begins with {start[:8]!r}", "give one"
        )
    if len(start) < START.size:
        raise _refusal(place, f"is cut at byte {len(start)}, before its first chunk", AGAIN)
    version = START.unpack(start)[1]
    if version != VERSION:
        message = f"is of version {version}, and this pulsepath reads version {VERSION}"
        raise _refusal(place, message, f"read it with the pulsepath that wrote it, or {AGAIN}")


def _check_head(head: Mapping[str, Any], kind: str, schema: int, place: Path) -> None:
    if head.get("kind") != kind:
        raise _refusal(place, f"holds {head.get('kind')!r:.60}, not {kind!r}", "give another file")
    if head.get("schema") != schema:
        message = f"has {kind} of schema {head.get('schema')!r:.60}, and this pulsepath reads schema {schema}"
        raise _refusal(place, message, f"read it with the pulsepath that wrote it, or {AGAIN}")


def _scan(file: BinaryIO, size: int) -> tuple[list[Chunk], str]:
    """Find the chunks by their headers.

    Return them, and why there are no more if that is a fault.
    """
    chunks: list[Chunk] = []
    at = START.size
    while at < size:
        file.seek(at)
        header = file.read(HEADER_BYTES)
        if len(header) < HEADER_BYTES:
            return chunks, f"is cut at byte {size}, within the header of chunk {len(chunks)}"
        kind, number, length, checksum = HEADER.unpack_from(header)
        if crc32(header[: HEADER.size]) != CHECKSUM.unpack_from(header, HEADER.size)[0]:
            return chunks, f"is damaged in the header of chunk {len(chunks)}, at byte {at}"
        if number != len(chunks):
            return chunks, f"has chunk {number} at byte {at}, where chunk {len(chunks)} should be"
        if length > MAX_CONTENTS:
            return (
                chunks,
                f"states {length} bytes for chunk {number}, and a chunk has at most {MAX_CONTENTS}",
            )
        chunk = Chunk(kind.decode("ascii", "replace"), number, at + HEADER_BYTES, length, checksum)
        if chunk.end > size:
            return (
                chunks,
                f"is cut at byte {size}, within chunk {number}, which ends at byte {chunk.end}",
            )
        chunks.append(chunk)
        at = chunk.end
    return chunks, ""


def _read_contents(file: BinaryIO, chunk: Chunk, place: Path) -> bytes:
    file.seek(chunk.begin)
    contents = file.read(chunk.length)
    if crc32(contents) != chunk.checksum:
        where = f"chunk {chunk.number} ({chunk.kind}, bytes {chunk.begin} to {chunk.end})"
        raise _refusal(place, f"is damaged: {where} has another checksum than was written", AGAIN)
    return contents


def read_integer(value: object, least: int = -MAX_INTEGER, most: int = MAX_INTEGER) -> int:
    """Return a whole number of a record, as JSON has it.

    Raises ValueError for anything else, and out of its range.
    """
    if type(value) is not int or not least <= value <= most:
        raise ValueError(f"{_shorten(value)} is no whole number from {least} to {most}")
    return value


def read_number(value: object, least: float = -inf) -> float:
    """Return a finite number of a record, as JSON has it.

    Raises ValueError for anything else, and below `least`.
    """
    if type(value) is float or (type(value) is int and abs(value) <= MAX_INTEGER):
        number = float(value)
        if isfinite(number) and number >= least:
            return number
    raise ValueError(
        f"{_shorten(value)} is no finite number{f' from {least:g} on' if isfinite(least) else ''}"
    )


def _shorten(value: object) -> str:
    """Return a value for a message: an integer of many digits, and a deep list, have no text that
    can be read.
    """
    if type(value) is int and abs(value) > MAX_INTEGER:
        return "an integer beyond 63 bits"
    return (
        f"{value!r:.60}"
        if isinstance(value, str | int | float | None)
        else f"a {type(value).__name__}"
    )


def _encode_record(record: Mapping[str, Any]) -> bytes:
    return json.dumps(record, ensure_ascii=False, separators=(",", ":")).encode()


def _read_record(file: BinaryIO, chunk: Chunk, place: Path) -> Mapping[str, Any]:
    try:
        record = json.loads(_read_contents(file, chunk, place))
    except (ValueError, RecursionError) as error:
        raise _refusal(
            place, f"chunk {chunk.number} ({chunk.kind}) is no JSON: {error}", AGAIN
        ) from None
    if not isinstance(record, dict):
        raise _refusal(place, f"chunk {chunk.number} ({chunk.kind}) is not a JSON object", AGAIN)
    return record


def _refusal(place: Path, message: str, remedy: str) -> FileError:
    return FileError(str(place), [Fault("", f"{message}: {remedy}")])
