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
# # Your own machine in 30 lines
#
# **How much must be said of a machine until its workspace, plans, proofs and pulses follow?**
#
# Three ways: as a text that is a file, as joint centres in Python, and as a new kind of machine by
# its formula.

# %%
# %matplotlib inline
from pathlib import Path
from tempfile import TemporaryDirectory

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import pulsepath as pp
from pulsepath import plots

# %% [markdown]
# ## As a text
#
# A small hexapod on two joint circles. Lengths have units, limits belong to the legs, and unknown
# words are refused.

# %%
TEXT = """
schema = 1
kind = "hexapod"

[geometry]
base_radius = "80 mm"
base_gap = "20 deg"
base_height = "0 mm"
platform_radius = "50 mm"
platform_gap = "40 deg"
platform_height = "0 mm"
home = { to = ["0 mm", "0 mm", "120 mm"], rotate = ["0 deg", "0 deg", "0 deg"] }
max_tilt = "40 deg"

[axes]
travel = ["-15 mm", "15 mm"]
pulse = "1 um"
max_speed = "50 mm/s"
max_acceleration = "1 m/s^2"
max_jerk = "50 m/s^3"
"""
with TemporaryDirectory() as folder:
    file = Path(folder, "small.toml")
    file.write_text(TEXT)
    small = pp.load_machine(file)
print("legs at home:", np.round(1e3 * small.home_q, 3), "mm")
small

# %% [markdown]
# Where can it go? Everything grey is proved: every position in it is within travel and tilt.

# %%
reach = pp.workspace(small, y=0.0, cells=24)
box = reach.largest_box()
print(
    f"the largest box in this plane: {1e3 * box.size[0]:.1f} mm wide, {1e3 * box.size[2]:.1f} mm high"
)
reach.plot()

# %% [markdown]
# A typing error in the text is told with its line and the nearest word:

# %%
with TemporaryDirectory() as folder:
    file = Path(folder, "small.toml")
    file.write_text(TEXT.replace("max_speed", "max_sped"))
    try:
        pp.load_machine(file)
    except pp.FileError as refusal:
        print(str(refusal).replace(folder, ""))

# %% [markdown]
# ## As joint centres
#
# Joints need not lie on circles. Here the legs stand at the corners and the middles of the sides of
# a triangle.

# %%
corner = np.deg2rad([90, 210, 330])
middle = corner + np.deg2rad(60)
base = np.zeros((6, 3))
base[::2, :2] = 0.100 * np.column_stack([np.cos(corner), np.sin(corner)])
base[1::2, :2] = 0.070 * np.column_stack([np.cos(middle), np.sin(middle)])
platform = np.zeros((6, 3))
angle = np.deg2rad([110, 130, 230, 250, 350, 10])
platform[:, :2] = 0.060 * np.column_stack([np.cos(angle), np.sin(angle)])
own = pp.Hexapod(
    base,
    platform,
    axes=[
        pp.Axis(
            f"leg{n}", travel=(-0.02, 0.02), max_speed=0.05, max_acceleration=1.0, max_jerk=50.0
        )
        for n in range(1, 7)
    ],
    home=pp.Pose.from_translation([0, 0, 0.130]),
    name="triangle",
)
margins = own.check(own.home)
print(
    f"home is {'fine' if margins.ok else margins.worst()}; conditioning {margins.conditioning[0]:.3f}"
)

# %% [markdown]
# ## As a new kind
#
# A linear delta, as printers have it: three carriages on upright rails, joined to an effector by
# rods of one length. Where the carriages must be for a position of the effector is one formula:
#
# $$q_i = z + \sqrt{L^2 - |\mathbf{r}_i - (x, y)|^2},$$
#
# with the rail $\mathbf{r}_i$, drawn in by the effector's own radius. It is written once, with
# CasADi's symbols; speeds, accelerations, jerks, proofs and forward kinematics all come from it.


# %%
class LinearDelta(pp.Machine):
    """Three carriages at heights q on upright rails, joined to the effector by rods of one
    length.
    """

    freedom = ("x", "y", "z")
    sorts = ("linear",) * 3

    def __init__(self, radius: float, rod: float, axes: list[pp.Axis], home: pp.Pose) -> None:
        at = np.deg2rad([90, 210, 330])
        self.rails, self.rod = radius * np.column_stack([np.cos(at), np.sin(at)]), rod
        self.characteristic_length = radius
        super().__init__("linear delta", axes, home)

    def expression(self, position: ca.SX, rotation: ca.SX, near: ca.SX) -> ca.SX:
        gaps = [ca.sumsqr(rail - position[:2]) for rail in self.rails]
        heights: ca.SX = ca.vertcat(*(position[2] + ca.sqrt(self.rod**2 - gap) for gap in gaps))
        return heights


delta = LinearDelta(
    radius=0.110,
    rod=0.250,
    axes=[
        pp.Axis(
            f"tower{n}",
            travel=(-0.15, 0.15),
            pulse=5e-6,
            max_speed=0.3,
            max_acceleration=3.0,
            max_jerk=100.0,
        )
        for n in (1, 2, 3)
    ],
    home=pp.Pose.from_translation([0, 0, 0]),
)

# %% [markdown]
# That was all. Is it right? The formula against itself, the other way round: carriages to pose and back.

# %%
random = np.random.default_rng(2)
poses = pp.Pose.from_translation(random.uniform([-0.07, -0.07, -0.1], [0.07, 0.07, 0.1], (200, 3)))
q = delta.inverse(poses)
found = delta.forward(q, near=poses)
back = np.abs(found.pose.translation - poses.translation).max()
print(
    f"200 positions to carriages and back: within {1e12 * back:.1f} pm, all certified: {found.certified.all()}"
)
assert back < 1e-9

# %% [markdown]
# Where can it go? Half way up, and seen from above:

# %%
disc = pp.workspace(delta, z=0.0, cells=32)
print(f"the largest circle has a radius of {1e3 * disc.largest_sphere().radius:.1f} mm")
disc.plot()

# %% [markdown]
# ## The same program on all of them
#
# A program with rounded corners counts from each machine's own home. Every plan has its proof and
# its pulses.

# %%
side = 0.004
corners = side * np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
rounded = [pp.Line(to=to, join=pp.Blend(0.0002)) for to in corners]
square = pp.Program((*rounded, pp.Line(to=corners[0]), pp.Line(to=np.zeros(3))), name="square")
plans = {machine.name: pp.plan(square, machine) for machine in (small, own, delta)}
for name, plan in plans.items():
    proof = "holds" if plan.certificate.holds else "fails"
    print(
        f"{name:<14}{plan.trajectory.duration:.4f} s, {plan.pulses.total:6} pulses, the certificate {proof}"
    )
    assert plan.certificate.holds

# %%
figure, rows = plt.subplots(len(plans), 1, figsize=(9, 6.5), layout="constrained")
for ax, (name, plan) in zip(rows, plans.items(), strict=True):
    plots.axis_motion(plan, "speed", ax)
    ax.set_title(name, loc="left", fontsize="medium")
    ax.legend(frameon=False, loc="upper left", bbox_to_anchor=(1, 1), fontsize="small")
plt.show()

# %% [markdown]
# ## The answer

# %%
lines = len(TEXT.strip().splitlines())
print(
    f"A machine of a known kind is {lines} lines of text; a new kind is one formula in a class of a few lines.\n"
    f"Then the square takes {plans['small'].trajectory.duration:.2f} s on the small hexapod and "
    f"{plans['linear delta'].trajectory.duration:.2f} s on the linear delta, each proved."
)
assert lines <= 30

# %% [markdown]
# **What to try next.** Give the delta's effector a mass with `delta.carrying(...)`, and forces are looked at too. Write
# your hexapod's file and plan from the command line: `pulsepath plan circle --machine mine.toml --out out/mine`. Then
# ask [what limits its speed](4_what_limits_the_speed.py).
