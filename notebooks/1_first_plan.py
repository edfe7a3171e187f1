# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # A first plan
#
# **How fast can a hexapod run a given path, how do we know that it keeps every limit, and what do its motors get?**
#
# In goes a machine and a program of lines and arcs. Out comes a motion, a proof, and the pulses.

# %%
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np

import pulsepath as pp

print("machines:", ", ".join(pp.machine_names()))
print("programs:", ", ".join(pp.program_names()))

# %% [markdown]
# ## What goes in
#
# A machine says what its actuators may do. This one has six legs, alike but for their names.

# %%
machine = pp.load_machine("hexapod")
leg = machine.axes[0]
print(f"{machine.name}: {len(machine.axes)} axes that control {', '.join(machine.freedom)}")
print(f"travel        {1e3 * leg.travel[0]:.1f} to {1e3 * leg.travel[1]:.1f} mm")
print(f"speed         {1e3 * leg.max_speed:.0f} mm/s")
print(f"acceleration  {1e3 * leg.max_acceleration:.0f} mm/s²")
print(f"jerk          {1e3 * leg.max_jerk:.0f} mm/s³")
print(f"pulse         {1e6 * leg.pulse:.2f} µm")

# %% [markdown]
# A program says where the tool goes. It may be a file, or be written here: up, out, and once around a circle.

# %%
up = np.array([0, 0, 0.025])
out = up + [0.015, 0, 0]
program = pp.Program((pp.Line(up), pp.Line(out), pp.Arc(centre=up, normal=[0, 0, 1], angle=2 * np.pi)), name="round")
program.segments
