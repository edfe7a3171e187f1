"""The passes against linear programmes, point by point."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from planner.timing import largest_speeds
from planner.timing.order2.passes import largest_ends

# What linear programmes and passes may differ by: HiGHS keeps rows to 1e-7.
TOLERANCE = 1e-6


def drawn(seed, ends):
    """Rows of a rough course, some with a share that only holds, some points with a ceiling, and x
    at both ends.
    """
    rng = np.random.default_rng(seed)
    intervals, rows = rng.integers(2, 9), rng.integers(1, 6)
    a, b, c = np.cumsum(rng.normal(size=(3, intervals + 1, rows)), 1) / np.sqrt(intervals)
    c = np.clip(0.3 * c, -0.9, 0.9) * rng.integers(0, 2)
    ceiling = np.where(
        rng.random(intervals + 1) < 0.5, np.inf, 10 ** rng.uniform(-2, 1, intervals + 1)
    )
    step = rng.random(intervals) + 0.1
    return (
        [a, b * rng.choice([0.1, 1.0, 10.0]), c],
        ceiling,
        step / step.sum(),
        tuple(ends * rng.random(2)),
    )


def programmed(rows, ceiling, step, ends):
    """The same by two linear programmes in (x, u) per point, and one in u on the way back; None
    where there is none.
    """
    a, b, c = rows
    low = high = ends[1]
    reached = [(low, high)]
    for i in reversed(range(len(step))):
        both = np.column_stack([b[i], a[i]])
        onward = np.array([[1.0, 2 * step[i]]])
        sides = np.concatenate([both, -both, onward, -onward])
        bound = np.concatenate([1 - c[i], 1 + c[i], [high, -low]])
        found = [
            linprog([-s, 0], sides, bound, bounds=[(0, ceiling[i]), (None, None)]) for s in (1, -1)
        ]
        if any(each.status for each in found):
            return None
        high, low = (float(each.x[0]) for each in found)
        reached.append((low, high))
    if not reached[-1][0] <= ends[0] <= reached[-1][1]:
        return None
    x = [ends[0]]
    for i, (_, top) in enumerate(reached[-2::-1]):
        sides, bound = (
            np.concatenate([a[i], -a[i]]),
            np.concatenate([1 - c[i] - b[i] * x[-1], 1 + c[i] + b[i] * x[-1]]),
        )
        most = linprog([-1], sides[:, None], bound, bounds=[(None, (top - x[-1]) / (2 * step[i]))])
        x.append(x[-1] + 2 * step[i] * float(most.x[0]))
    return np.array(x)


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.05]))
def test_they_find_what_linear_programmes_find(seed, ends):
    problem = drawn(seed, ends)
    wanted, found = programmed(*problem), largest_speeds(*problem)
    if wanted is None:
        assert not found.any()
    else:
        assert found == pytest.approx(wanted, abs=TOLERANCE * wanted.max() + TOLERANCE)


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1))
def test_no_faster_start_leads_to_the_end(seed):
    rows, ceiling, step, (first, last) = drawn(seed, 3.0)
    most, end = largest_ends(rows, ceiling, step, (first, last))
    if most < first and end == last:  # otherwise it is the end that is too fast
        assert largest_speeds(rows, ceiling, step, (most * (1 - 1e-6), last)).any()
        assert not largest_speeds(rows, ceiling, step, (most * (1 + 1e-6), last)).any()
