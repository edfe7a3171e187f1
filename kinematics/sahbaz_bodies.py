"""What the parts of the thesis' hexapod weigh, as far as it is known: bodies for the preset `hexapod`.

The thesis [Sahbaz 2007] prints the mass of an actuator (241 g, Table 3.1) and its size (43 × 43 × 162 mm), and the
platform's plate (a disc 250 mm wide and 10 mm thick). ASSUMPTIONS: everything else here. How the 241 g are shared and
spread, the plate's aluminium, that joints weigh nothing, and which way the universal joints are turned.
"""

import numpy as np

from kinematics.body import Leg, cylinder

ALUMINIUM = 2700.0
"""kg/m³."""

PLATE = cylinder(ALUMINIUM * np.pi * 0.125**2 * 0.010, 0.125, -0.005, 0.005, "plate")
"""The platform's plate about the platform's origin, the middle of its thickness."""

# As wide as its square of 43 mm has area; the screw and its tip as a rod of steel of 41 g.
LEG = Leg(
    barrel=cylinder(0.200, 0.043 / np.sqrt(np.pi), 0.010, 0.110, "motor"),
    rod=cylinder(0.041, 0.003, -0.162, -0.010, "screw"),
)
