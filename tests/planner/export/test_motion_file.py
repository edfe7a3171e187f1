"""motion.bin: the same floats to the last bit; a file that is cut or damaged is refused."""

import json
import os
import struct
import tracemalloc
from itertools import pairwise
from types import SimpleNamespace
from zlib import compress, crc32

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics import FileError, MotionError
from planner.export import motion_file
from planner.export.motion_file import PIECES, MotionWriter, motion_parts, read_motion
from tests import motion_pieces

NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
ROWS = st.lists(st.tuples(*[NUMBERS] * 4, st.integers(0, 2)), min_size=1, max_size=12)
ALONG = SimpleNamespace(breaks=np.arange(4.0))


def motion_of(rows, knots=None):
    *numbers, piece = (np.array(column) for column in zip(*rows, strict=True))
    knots = np.arange(len(rows) + 1) / 3 if knots is None else knots
    return SimpleNamespace(knots=knots, **dict(zip(PIECES, (*numbers, piece), strict=True)))


def slice_of(motion, first, last):
    rest = {name: getattr(motion, name)[first:last] for name in PIECES}
    return SimpleNamespace(knots=motion.knots[first : last + 1], **rest)


def bits(motion):
    return [np.asarray(getattr(motion, name)).tobytes() for name in ("knots", *PIECES)]


@settings(max_examples=60, derandomize=True, deadline=None)
@given(ROWS, st.integers(1, 12))
def test_any_motion_comes_back_to_the_last_bit(tmp_path_factory, rows, size):
    motion, path = motion_of(rows), tmp_path_factory.mktemp("motion") / "motion.bin"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(motion_file, "MAX_CHUNK_PIECES", size)
        motion_file.write_motion(motion, path)
    assert bits(read_motion(path, ALONG)) == bits(motion)
    assert len(list(motion_parts(path))) == -(-len(rows) // size)


@pytest.fixture
def parted(tmp_path):
    """A file written in three steps, and its motion."""
    rng = np.random.default_rng(2)
    motion = motion_of([(*rng.normal(size=4), 1) for _ in range(12)])
    path = tmp_path / "motion.bin"
    with path.open("wb") as file:
        writer = MotionWriter(file)
        for first, last in pairwise([0, 3, 7, 12]):
            writer.add(slice_of(motion, first, last))
        writer.finish()
    return path, motion


def test_cut_at_any_byte_it_is_refused(parted, tmp_path):
    path, motion = parted
    assert bits(read_motion(path, ALONG)) == bits(motion)
    content, cut = path.read_bytes(), tmp_path / "cut"
    cut.write_bytes(content)
    for size in reversed(range(len(content))):
        os.truncate(cut, size)
        with pytest.raises(FileError):
            read_motion(cut, ALONG)


def test_damaged_anywhere_it_is_refused(parted):
    path, _ = parted
    content = path.read_bytes()
    for at in range(0, len(content), 3):
        path.write_bytes(content[:at] + bytes([content[at] ^ 16]) + content[at + 1 :])
        with pytest.raises(FileError):
            read_motion(path, ALONG)


def test_pieces_that_leave_a_gap_in_time_are_not_written(parted, tmp_path):
    _, motion = parted
    with (tmp_path / "gap.bin").open("wb") as file:
        writer = MotionWriter(file)
        writer.add(slice_of(motion, 0, 3))
        with pytest.raises(MotionError, match=r"begin at 1\.33\d* s, and those before end at 1 s"):
            writer.add(slice_of(motion, 4, 7))
        with pytest.raises(
            MotionError, match=r"the part begins at 2 s, and those before end at 1 s"
        ):
            writer.add(slice_of(motion, 3, 7), motion_file.PartHead(2.0, 0.0, 0, 1))


def crafted(content, kind, change):
    """A file whose last chunk of a kind has other contents, with checksums that are right."""
    at, places = 12, {}
    while at < len(content):
        name, _, length = struct.unpack_from("<4sIQ", content, at)
        places[name.decode()] = at, at + 24 + length
        at += 24 + length
    begin, end = places[kind]
    held = change(content[begin + 24 : end])
    header = content[begin : begin + 8] + struct.pack("<QI", len(held), crc32(held))
    return content[:begin] + header + struct.pack("<I", crc32(header)) + held + content[end:]


def said(kind, **change):
    return lambda content: crafted(
        content, kind, lambda held: json.dumps(json.loads(held) | change).encode()
    )


def counted(count, inflated=None):
    """A chunk that states so many pieces, and inflates to so many zeros."""

    def change(held):
        return struct.pack("<Q", count) + (
            held[8:] if inflated is None else compress(bytes(inflated), 1)
        )

    return lambda content: crafted(content, "MOTN", change)


def numbered(value):
    """A chunk of the right pieces, all of whose numbers are this one."""

    def change(held):
        (count,) = struct.unpack_from("<Q", held)
        words = np.full(6 * count + 1, value).view(np.uint8).reshape(-1, 8)
        return held[:8] + compress(words.T.tobytes())

    return lambda content: crafted(content, "MOTN", change)


HUGE = 10**400
CRAFTED = {
    "2^64 - 1 pieces": counted((1 << 64) - 1),
    "2^63 pieces": counted(1 << 63),
    "2^60 pieces": counted(1 << 60),
    "10^11 pieces": counted(10**11),
    "no piece and a bomb": counted(0, 1 << 27),
    "a bomb of its size": counted((1 << 27) // 48, 1 << 27),
    "more pieces than the mark states": said("MARK", pieces=1),
    "fewer pieces than the mark states": said("MARK", pieces=10**11),
    "infinitely many pieces": said("MARK", pieces=float("inf")),
    "pieces in words": said("MARK", pieces="5"),
    "a duration of infinity": said("MARK", duration=float("inf")),
    "a duration of 10^400": said("MARK", duration=HUGE),
    "numbers that are infinite": numbered(np.inf),
    "numbers that are none": numbered(np.nan),
    "a part at infinity": said("PART", begin=float("inf")),
    "a part at 10^400": said("PART", begin=HUGE),
    "a part of infinite length": said("PART", length=float("inf")),
    "a part at step infinity": said("PART", step=float("inf")),
    "a part at step 10^400": said("PART", step=HUGE),
    "a part of 2^64 steps": said("PART", steps=1 << 64),
    "a part of steps in words": said("PART", steps="1"),
    "a part near infinity": said("PART", near=[float("inf")]),
    "a part near 10^400": said("PART", near=[HUGE]),
    "a part near words": said("PART", near="here"),
    "a deep part": lambda content: crafted(content, "PART", lambda _: b'{"begin":' * 100_000),
}


@pytest.mark.parametrize("make", CRAFTED.values(), ids=CRAFTED)
def test_a_crafted_file_is_refused_in_little_memory(tmp_path, make):
    """Whoever passes a file on may have written anything into it, with checksums that are right."""
    path, motion = (
        tmp_path / "motion.bin",
        motion_of([(0.0, 0.0, 1.0, 0.0, 0), (1.0, 1.0, -1.0, 0.0, 0)]),
    )
    with path.open("wb") as file:
        writer = MotionWriter(file)
        writer.add(motion, motion_file.PartHead(0.0, 0.0, 0, 1))
        writer.finish()
    assert bits(read_motion(path, ALONG)) == bits(motion)
    path.write_bytes(make(path.read_bytes()))
    tracemalloc.start()
    try:
        with pytest.raises(FileError) as refused:
            read_motion(path, ALONG)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(str(refused.value)) < 1000
    assert peak < 64e6


@pytest.mark.parametrize("duration", [float("inf"), float("nan"), HUGE, "1", None, -1.0])
def test_a_stated_duration_that_is_none_is_refused(tmp_path, duration):
    motion_pieces.store(
        tmp_path / "m",
        {"knots": [0.0, 1.0], "s": [0.0], "v": [0.0], "a": [0.0], "j": [0.0], "piece": [0]},
    )
    content = (tmp_path / "m").read_bytes()
    (tmp_path / "m").write_bytes(said("MARK", duration=duration)(content))
    with pytest.raises(FileError, match="states no duration"):
        motion_file.read_duration(tmp_path / "m")


def test_it_is_read_by_what_is_written_of_it(tmp_path):
    """Without the reader: the numbers of the one chunk, byte by byte."""
    from zlib import decompress

    motion = motion_of([(1.0, -0.0, 3.5, 1e-320, 2), (np.pi, 2.0, 0.1, -5.0, 1)])
    motion_file.write_motion(motion, tmp_path / "m")
    content = (tmp_path / "m").read_bytes()
    at = 12 + 24 + struct.unpack_from("<Q", content, 12 + 8)[0]
    kind, _, length = struct.unpack_from("<4sIQ", content, at)
    held = content[at + 24 : at + 24 + length]
    planes, numbers = decompress(held[8:]), 6 * 2 + 1
    words = [bytes(planes[k * numbers + n] for k in range(8)) for n in range(numbers)]
    floats = [struct.unpack("<d", word)[0] for word in words[:11]]
    assert (kind, struct.unpack_from("<Q", held)[0]) == (b"MOTN", 2)
    assert floats == [0.0, 1 / 3, 2 / 3, 1.0, np.pi, -0.0, 2.0, 3.5, 0.1, 1e-320, -5.0]
    assert [int.from_bytes(word, "little") for word in words[11:]] == [2, 1]


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"knots": [1.0, 0.0]}, "do not make a motion"),
        ({"a": [np.inf]}, "do not make a motion"),
        ({"piece": [3]}, "belongs to another path"),
        ({"piece": [-1]}, "belongs to another path"),
        ({name: [] for name in PIECES} | {"knots": [0.0]}, "holds no motion"),
    ],
)
def test_pieces_that_make_no_motion_are_refused(tmp_path, change, told):
    right = {"knots": [0.0, 1.0], "s": [0.0], "v": [0.0], "a": [0.0], "j": [0.0], "piece": [0]}
    motion_pieces.store(tmp_path / "m", right | change)
    with pytest.raises(FileError, match=told):
        read_motion(tmp_path / "m", ALONG)
