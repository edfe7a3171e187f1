"""Units that are read without pint are what pint says."""

import subprocess
import sys

import pytest

from kinematics.foundation.units import USUAL_UNITS, factor_by_pint


@pytest.mark.parametrize("unit", sorted(USUAL_UNITS))
def test_what_is_known_without_pint_is_what_pint_says(unit):
    assert factor_by_pint(unit) == USUAL_UNITS[unit]


def test_the_usual_units_are_read_without_pint():
    code = (
        "import sys, kinematics.foundation.units as u; u.quantity('2.5 mm/s', 'm/s'); assert 'pint' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
