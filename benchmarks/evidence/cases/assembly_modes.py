"""Forty assembly modes of Dietmaier's platform: how often all are found, and in which time.

Each seed draws another machine to start from. Times are seconds of processor time.
"""

from collections.abc import Iterator

from benchmarks.evidence.measuring import time_calls
from benchmarks.evidence.published.conformance import PUBLISHED, published_hexapod
from benchmarks.evidence.table import Row, Table
from kinematics.analysis.assembly_modes import assembly_modes, solve_generic


def measure(seeds: int = 20) -> Iterator[Table]:
    """Yield the number of modes and the times for each seed."""
    columns = ("seed", "modes", "start system (s)", "modes (s)")
    yield Table("Modes by seed", columns, map(measure_seed, range(seeds)))


def measure_seed(seed: int) -> Row:
    """Return the row of a seed."""
    machine = published_hexapod("dietmaier")
    lengths = PUBLISHED["dietmaier"]["lengths"]
    # the second call uses the stored result of the first
    _, (start,) = time_calls(lambda: solve_generic(seed))
    modes, (seconds,) = time_calls(lambda: assembly_modes(machine, lengths, seed=seed))
    return [str(seed), len(modes), start, seconds]
