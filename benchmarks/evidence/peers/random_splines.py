"""COPP's random splines, to the bit: the numbers of `tests/test_random_spline.rs` in its sources.

Quintics through waypoints drawn from ±½, with q′ = q″ = 0 at both ends; limits on speed,
acceleration and jerk drawn within ±10 %, different ones towards each side.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.evidence.peers.problems import rest_spline
from kinematics.foundation.arrays import Array


@dataclass(frozen=True, slots=True)
class Suite:
    """Sizes and seed; limits: means of the speeds, accelerations and jerks that are drawn."""

    axes: int = 7
    waypoints: int = 50
    limits: tuple[float, float, float] = (1.0, 5.0, 50.0)
    seed: int = 20260414
    count: int = 100

    @staticmethod
    def read(path: Path) -> "Suite":
        """Read the first `TestConfig` of COPP's test."""
        text = path.read_text(encoding="utf-8")
        config = text.partition("let config = TestConfig {")[2].partition("}")[0]
        values = {name: float(value) for name, value in re.findall(r"(\w+): ([\d.]+),", config)}
        return Suite(
            int(values["dim"]),
            int(values["num_waypoints"]),
            (values["velocity_max"], values["acceleration_max"], values["jerk_max"]),
            int(values["seed"]),
            int(values["n_exp"]),
        )

    def problems(self) -> Iterator[tuple[Any, Array]]:
        """Yield each path over [0, 1] and its bounds (3, 2, n), as `PathProblem` has them."""
        points = self.axes * self.waypoints
        numbers = chacha_numbers(self.seed, self.count * (points + 6 * self.axes))
        for drawn in numbers.reshape(self.count, -1):
            waypoints = drawn[:points].reshape(self.axes, self.waypoints).T - 0.5
            shares = (0.9 + (1.1 - 0.9) * drawn[points:]).reshape(3, 2, self.axes)
            upper_last = shares[:, ::-1]
            yield rest_spline(waypoints), np.array(self.limits)[:, None, None] * upper_last


def chacha_numbers(seed: int, count: int) -> Array:
    """Return numbers in [0, 1) of Rust's `StdRng` for a seed: ChaCha of 12 rounds, 52 bits each.

    The key is drawn from the seed by PCG32 [O'Neill 2014]; ChaCha: Bernstein 2008.
    """
    state = seed
    key = []
    for _ in range(8):
        state = (state * 6364136223846793005 + 11634580027462260723) % 2**64
        word = (((state >> 18) ^ state) >> 27) % 2**32
        turn = state >> 59
        key.append((word >> turn | word << (32 - turn)) % 2**32)
    blocks = -(-count // 8)
    first = np.zeros((16, blocks), np.uint32)
    first[:4] = np.frombuffer(b"expand 32-byte k", "<u4")[:, None]
    first[4:12] = np.array(key, np.uint32)[:, None]
    first[12] = np.arange(blocks)
    x = first.copy()
    a, b, c, d = (np.arange(row, row + 4) for row in (0, 4, 8, 12))
    for number in range(12):
        # columns in even rounds, diagonals in odd ones
        shift = number % 2
        rows = a, np.roll(b, -shift), np.roll(c, -2 * shift), np.roll(d, -3 * shift)
        _mix(x, *rows)
    words = (x + first).T.astype(np.uint64).ravel()
    pairs = words[::2] | words[1::2] << np.uint64(32)
    numbers: Array = (pairs >> np.uint64(12))[:count] / 2.0**52
    return numbers


def _mix(x: Any, a: Any, b: Any, c: Any, d: Any) -> None:
    """Apply ChaCha's quarter round to four rows at once."""
    for target, source, turned, bits in ((a, b, d, 16), (c, d, b, 12), (a, b, d, 8), (c, d, b, 7)):
        x[target] += x[source]
        x[turned] ^= x[target]
        x[turned] = x[turned] << np.uint32(bits) | x[turned] >> np.uint32(32 - bits)
