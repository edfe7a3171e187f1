import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import cumulative_simpson

from kinematics import Beam, MotionError

BEAM, LOAD = Beam(2.0, 2e11, 3e-8), 500.0


def integrated(beam, load, place):
    """Deflection and slope under the load, by integrating E I y″ = −M twice from both supports'
    conditions.

    M is linear on each side of the load, so Simpson's rule on a grid with a knot under it is exact.
    """
    x = np.unique(np.concatenate([np.linspace(0, place, 201), np.linspace(place, beam.span, 201)]))
    at = int(np.searchsorted(x, place))
    reaction = load * (beam.span - place) / beam.span
    moment = reaction * x - load * np.clip(x - place, 0, None)
    bend = -moment / (beam.modulus * beam.second_moment)
    slope = np.concatenate(
        [cumulative_simpson(bend[: at + 1], x=x[: at + 1], initial=0), np.zeros(len(x) - at - 1)]
    )
    slope[at:] = slope[at] + cumulative_simpson(bend[at:], x=x[at:], initial=0)
    sag = np.concatenate(
        [cumulative_simpson(slope[: at + 1], x=x[: at + 1], initial=0), np.zeros(len(x) - at - 1)]
    )
    sag[at:] = sag[at] + cumulative_simpson(slope[at:], x=x[at:], initial=0)
    start = -sag[-1] / beam.span  # the slope at the first support brings the end back to zero
    return sag[at] + start * place, slope[at] + start


@pytest.mark.parametrize("share", [0.05, 0.2113, 0.4, 0.5, 0.7887, 0.93])
def test_under_the_load_as_by_integrating_the_bending_line(share):
    place = share * BEAM.span
    sag, slope = integrated(BEAM, LOAD, place)
    assert float(BEAM.deflection(LOAD, place)) == pytest.approx(sag, rel=1e-9)
    # Simpson's rule is exact for the piecewise parabola; what is left is rounding, of the size of
    # the largest slope
    assert float(BEAM.slope(LOAD, place)) == pytest.approx(
        slope, rel=1e-9, abs=1e-12 * BEAM.largest_slope(LOAD)
    )


@given(st.floats(0, 1))
def test_symmetry_and_bounds(share):
    here, there = share * BEAM.span, BEAM.span - share * BEAM.span
    assert float(BEAM.deflection(LOAD, here)) == pytest.approx(
        float(BEAM.deflection(LOAD, there)), rel=1e-9, abs=1e-18
    )
    assert float(BEAM.slope(LOAD, here)) == pytest.approx(
        -float(BEAM.slope(LOAD, there)), rel=1e-9, abs=1e-15
    )
    assert 0 <= BEAM.deflection(LOAD, here) <= BEAM.largest_deflection(LOAD) * (1 + 1e-12)
    assert abs(BEAM.slope(LOAD, here)) <= BEAM.largest_slope(LOAD) * (1 + 1e-12)


def test_the_largest_are_attained():
    assert float(BEAM.deflection(LOAD, BEAM.span / 2)) == pytest.approx(
        BEAM.largest_deflection(LOAD), rel=1e-14
    )
    places = BEAM.span * (3 + np.array([-1, 1]) * np.sqrt(3)) / 6
    assert BEAM.slope(LOAD, places) == pytest.approx(
        BEAM.largest_slope(LOAD) * np.array([1, -1]), rel=1e-12
    )


def test_bad_beams():
    with pytest.raises(MotionError, match="modulus -1"):
        Beam(1.0, -1.0, 1.0)
    with pytest.raises(MotionError, match=r"2.1 m is off its 2.0 m"):
        BEAM.slope(LOAD, [0.0, 2.1])
