"""Edges of every STEP and DIR line, from the pulses of a plan, as a board with DMA or an FPGA plays them:

    python pulse_edges.py pulses.bin edges.bin --wiring=-1,-1,-1 --high 2e-6

Whole numbers and numpy only. edges.bin holds two numbers of 8 bytes, little end first, for each instant at which a line
changes: the clock tick, and the levels from it on. Bit 2k is STEP of axis k, bit 2k + 1 its DIR.
"""

import json
import struct
import sys
from argparse import ArgumentParser
from pathlib import Path
from zlib import crc32, decompress

import numpy as np


def read_pulses(path):
    """The file's head, and the ticks and directions (+1, -1 in q) of each axis."""
    content, at, chunks = Path(path).read_bytes(), 12, []
    if content[:12] != b"\x89PPB\r\n\x1a\n\x01\0\0\0":
        sys.exit(f"{path}: is no file of pulses, or of another version")
    while at + 24 <= len(content):
        kind, number, length, of_held, of_header = struct.unpack_from("<4sIQII", content, at)
        held = content[at + 24 : at + 24 + length]
        if (
            number != len(chunks)
            or crc32(content[at : at + 20]) != of_header
            or crc32(held) != of_held
        ):
            sys.exit(f"{path}: is damaged at byte {at}")
        chunks.append((kind, held))
        at += 24 + length
    head = json.loads(chunks[0][1])
    if chunks[-1][0] != b"MARK":
        sys.exit(f"{path}: its end is missing")
    axes = [([], []) for _ in head["axes"]]
    for kind, held in chunks[1:-1]:
        if kind != b"PULS":
            sys.exit(f"{path}: has a chunk of kind {kind!r}, which holds no pulses")
        begin, _, _ = struct.unpack_from("<qqQ", held)
        for (ticks, directions), (own, signs) in zip(
            axes, decode(decompress(held[24:]), len(axes)), strict=True
        ):
            ticks.append(begin + own)
            directions.append(signs)
    return head, [(np.concatenate(ticks), np.concatenate(directions)) for ticks, directions in axes]


def decode(content, axes):
    """Ticks behind the chunk's first, and directions, of each axis."""
    at = 0
    for _ in range(axes):
        count, width, escapes = struct.unpack_from("<IBI", content, at)
        codes = np.frombuffer(content, f"<u{width}", count, at + 9).astype(np.uint64)
        at += 9 + count * width
        codes[codes == 256**width - 1] = np.frombuffer(content, "<u8", escapes, at)
        at += 8 * escapes
        back = np.unpackbits(
            np.frombuffer(content, np.uint8, -(-count // 8), at), count=count
        ).astype(np.int8)
        at += -(-count // 8)
        change = (codes >> 1).astype(np.int64) ^ -(codes & 1).astype(np.int64)
        yield change.cumsum().cumsum(), 1 - 2 * back


def find_edges(axes, wiring, high):
    """Instants (ticks), and the levels of all lines from each on. STEP is high for so many ticks; DIR changes as it
    falls, for the pulse that comes next."""
    instants = np.unique(
        np.concatenate([[0], *(ticks + part for ticks, _ in axes for part in (0, high))])
    )
    words = np.zeros(len(instants), np.uint64)
    for k, ((ticks, directions), sign) in enumerate(zip(axes, wiring, strict=True)):
        if len(ticks):
            risen, fallen = (np.searchsorted(ticks + part, instants, "right") for part in (0, high))
            way = directions[np.minimum(fallen, len(ticks) - 1)] == sign
            words |= ((risen - fallen) << 2 * k | way.astype(np.int64) << (2 * k + 1)).astype(
                np.uint64
            )
    return instants, words


def main():
    parser = ArgumentParser()
    parser.add_argument("pulses")
    parser.add_argument("edges")
    parser.add_argument(
        "--wiring", required=True, help="`direction` of each axis in the machine's file, 1 or -1"
    )
    parser.add_argument("--high", type=float, default=2e-6, help="s that STEP is high")
    asked = parser.parse_args()
    head, axes = read_pulses(asked.pulses)
    high = round(asked.high * head["clock_hz"])
    if high < 1 or any(len(ticks) > 1 and np.diff(ticks).min() <= high for ticks, _ in axes):
        sys.exit(
            f"STEP high for {high} ticks: must be 1 or more, and less than the closest pulses are apart"
        )
    instants, words = find_edges(axes, [int(sign) for sign in asked.wiring.split(",")], high)
    np.stack([instants.astype("<u8"), words.astype("<u8")], 1).tofile(asked.edges)
    print(
        f"{len(instants)} instants of {head['clock_hz']} Hz; pulses:",
        *(len(ticks) for ticks, _ in axes),
    )


if __name__ == "__main__":
    main()
