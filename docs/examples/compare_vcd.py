"""What a logic analyser recorded, beside what was to be played: python compare_vcd.py planned.vcd recorded.vcd

Both are value change dumps: of `pulsepath export DIR --format vcd`, and as PulseView exports them. Lines are found by
their names, such as leg1_STEP and leg1_DIR. Times count from the first pulse in each file. Exit code 1: pulses are
missing, are more, or have the other direction.
"""

import sys
from pathlib import Path

import numpy as np

UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "ps": 1e-12, "fs": 1e-15}


def read_pulses(path):
    """Of each axis the times (s) at which STEP rises, and the levels of DIR there."""
    head, _, body = Path(path).read_text().partition("$enddefinitions")
    words = head.split()
    names = {words[k + 3]: words[k + 4] for k, word in enumerate(words) if word == "$var"}
    unit = "".join(words[words.index("$timescale") + 1 :][:2]).removesuffix(
        "$end"
    )  # "1 ns" or "1ns"
    number = unit.rstrip("munpfs")
    scale = float(number) * UNITS[unit[len(number) :]]
    pulses = {name.removesuffix("_STEP"): [] for name in names.values() if name.endswith("_STEP")}
    now, levels = 0, {}
    for word in body.split():
        if word[0] == "#":
            now = int(word[1:])
        elif word[0] in "01" and word[1:] in names:
            name, level = names[word[1:]], int(word[0])
            axis = name.removesuffix("_STEP")
            if axis in pulses and level > levels.get(name, 1):
                pulses[axis].append((now, levels[f"{axis}_DIR"]))
            levels[name] = level
    first = min(found[0][0] for found in pulses.values() if found)
    tables = {axis: np.array(found, np.int64).reshape(-1, 2) for axis, found in pulses.items()}
    return {axis: (scale * (table[:, 0] - first), table[:, 1]) for axis, table in tables.items()}


def main(planned, recorded):
    theirs, wrong = read_pulses(recorded), False
    for axis, (times, ways) in read_pulses(planned).items():
        if axis not in theirs:
            sys.exit(
                f"{recorded} has no lines {axis}_STEP and {axis}_DIR: name them in the recording"
            )
        at, way = theirs[axis]
        same = min(len(times), len(at))
        off = abs(at[:same] - times[:same])
        told = f"{axis}: {len(times)} pulses, {len(at)} recorded"
        if len(times) == len(at):
            turned = int((way != ways).sum())
            told += (
                f", {turned} of the other direction, at most {1e9 * off.max(initial=0):.0f} ns off"
            )
        else:
            turned = 0
            beside = np.flatnonzero(off > np.diff(times).min(initial=1.0) / 2)
            k = int(beside[0]) if len(beside) else same
            told += f"; pulse {k + 1} is the first that differs, {max(times, at, key=len)[k]:.6f} s after the first"
        print(told)
        wrong |= turned > 0 or len(times) != len(at)
    return int(wrong)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
