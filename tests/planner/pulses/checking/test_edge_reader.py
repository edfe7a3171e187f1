"""Rows laid out alike are read digit by digit: the very numbers that numpy's own reader finds, or
not at all.
"""

from io import BytesIO

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.pulses.checking.edge_reader import _read_even_rows


@given(
    st.integers(1, 6),
    st.integers(1, 9),
    st.lists(
        st.tuples(st.integers(0, 10**15 - 1), st.lists(st.booleans(), min_size=3, max_size=3)),
        min_size=2,
    ),
    st.sampled_from([b", ", b","]),
    st.sampled_from([b"\n", b"\r\n"]),
)
def test_they_are_what_numpy_reads(whole, decimals, rows, comma, end):
    """Up to 15 digits, by strtod: both are the floats nearest to the decimals."""
    digits = [b"%0*d" % (whole + decimals, number % 10 ** (whole + decimals)) for number, _ in rows]
    levels = [b"".join(comma + b"%d" % level for level in row) for _, row in rows]
    lines = [
        each[:whole] + b"." + each[whole:] + row for each, row in zip(digits, levels, strict=True)
    ]
    text = end.join(lines) + end[:-1]
    found = _read_even_rows(text, 4)
    assert found is not None
    np.testing.assert_array_equal(found, np.loadtxt(BytesIO(text), delimiter=","))


@pytest.mark.parametrize(
    "second",
    [
        b"0.20, 0, 2",
        b"0.2x, 0, 1",
        b"0.20; 0, 1",
        b"10.20, 0, 1",
        b"0.200, 0, 1",
        b"-.20, 0, 1",
        b"0.20, 0, 1, 1",
        b"0,20, 0, 1",
        b"0.20, 0,/1",
        b"",
    ],
)
def test_what_is_laid_out_otherwise_is_left_to_others(second):
    assert _read_even_rows(b"0.10, 0, 1\n" + second, 3) is None


@pytest.mark.parametrize(
    "first",
    [b"-0.10, 0, 1", b"1e-3, 0, 1", b"0.1000000000000000, 0, 1", b"0.1, 0", b"nan, 0, 1", b""],
)
def test_so_is_a_first_row_of_another_kind(first):
    assert _read_even_rows(first + b"\n" + first, 3) is None
