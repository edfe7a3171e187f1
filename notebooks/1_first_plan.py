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
# **How fast can a hexapod run a given path, how do we know that it keeps every limit, and what do
# its motors get?**
#
# In go a machine and a program of lines and arcs. Out come a motion, its proof, and the pulses.

# %%
# %matplotlib inline
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np

import pulsepath as pp
from pulsepath import plots

print("machines:", ", ".join(pp.machine_names()))
print("programs:", ", ".join(pp.program_names()))

# %% [markdown]
# ## What goes in
#
# A machine says where its joints are and what its actuators may do. Limits belong to the legs, not
# to the tool: these lines hold for each of the six.

# %%
machine = pp.load_machine("hexapod")
print(pp.machine_toml(machine).partition("[axes]\n")[2].partition("\n\n")[0])

# %% [markdown]
# A program says where the platform goes: up, out, and once around. It may be a file, as the bundled ones are, or be
# written here. Arrays are in metres and radians, positions count from home.

# %%
centre = np.array([0, 0, 0.025])
program = pp.Program(
    (
        pp.Line(to=centre),
        pp.Line(to=centre + np.array([0.015, 0, 0])),
        pp.Arc(centre=centre, normal=np.array([0, 0, 1]), angle=2 * np.pi),
    ),
    name="round",
)

# %% [markdown]
# ## What comes out: the motion
#
# One call finds the fastest motion that the legs can make along this path, and stops where the path
# has corners.

# %%
plan = pp.plan(program, machine)
print(
    f"{plan.trajectory.duration:.4f} s along {1e3 * plan.path.breaks[-1]:.1f} mm, order {plan.order}"
)
plan.plot()

# %% [markdown]
# Results print as tables, draw themselves by `.plot()`, become data frames by `.to_pandas()`, files by `.save(path)`.
# The state at any time is exact: it comes from closed formulas, not from samples. Its pose is in the machine's base
# frame; programs count from home.

# %%
state = plan.trajectory.at([0.5, 1.0, 1.5])
for t, pose, speed in zip(state.t, state.pose.translation, state.qd[:, 0], strict=True):
    x, y, z = 1e3 * pose
    print(
        f"t = {t:.1f} s: platform at ({x:7.3f}, {y:7.3f}, {z:7.3f}) mm, leg 1 runs at {1e3 * speed:+6.2f} mm/s"
    )

# %% [markdown]
# ## Reading the certificate
#
# Each line is a limit: the largest share of it that the motion uses, *proved* over continuous time,
# and where. A share of one is the limit itself. The proof is made from the motion alone and shares
# no code with the solver, so a bug in the solver shows here; a plan whose certificate does not hold
# is refused.

# %%
plan.certificate

# %% [markdown]
# The same over time: which limit is used how much. The band on top has the colour of the limit that holds the motion
# back at that moment. Practically all the time one does, as it must where a motion is the fastest.

# %%
figure, ax = plt.subplots(figsize=(9, 3.8), layout="constrained")
plots.limit_use(plan, ax, over="time")
figure.legend(loc="outside upper center", ncols=6, frameon=False)
plt.show()

# %%
active = plots.active_limits(plan)
held = np.diff(plan.trajectory.knots)[active >= 0].sum() / plan.trajectory.duration
print(f"some limit is used to 99 % and more during {100 * held:.1f} % of the time")

# %% [markdown]
# You need not believe it. A hundred thousand instants, looked at with nothing but the definition of each limit, come
# close to the proven bounds and never exceed them.

# %%
looked = plan.trajectory.at(np.linspace(0, plan.trajectory.duration, 100_001))
met = {
    "speed": np.abs(looked.qd).max() / 0.020,
    "acceleration": np.abs(looked.qdd).max() / 0.225,
    "jerk": np.abs(looked.qddd).max() / 4.0,
}
for name, value in met.items():
    proved = np.ceil(1e9 * plan.certificate.worst[name]) / 1e9  # a bound is rounded upwards
    print(f"{name:<13} met {value:.9f}  proved ≤ {proved:.9f}")
    assert value <= plan.certificate.worst[name]

# %% [markdown]
# ## The pulses
#
# A stepper moves by pulses. Each falls on a whole tick of a stated clock, where the leg is half way
# between two counts, so the counts are never further from the motion than half a pulse and what the
# leg moves in one tick.

# %%
pulses = plan.pulses
print("the first of leg 1 fall at ticks", pulses.axes[0].ticks[:6])
pulses

# %%
t = np.random.default_rng(1).uniform(0, plan.trajectory.duration, 20_000)
away = (plan.trajectory.at(t).q - machine.home_q) / [
    axis.pulse for axis in machine.axes
] - pulses.counts(t)
print(
    f"at 20000 random instants the counts are at most {np.abs(away).max():.4f} pulses from the motion"
)

# %%
figure, ax = plt.subplots(figsize=(9, 3.2), layout="constrained")
plots.pulse_rate(plan, ax)
figure.legend(loc="outside upper center", ncols=6, frameon=False)
plt.show()

# %% [markdown]
# ## To a controller
#
# The plan is written in the format that a controller reads, decoded again as the controller would,
# and compared.

# %%
with TemporaryDirectory() as folder:
    for format_, name in (
        ("pulses", "round.csv"),
        ("vcd", "round.vcd"),
        ("zaber", "round-pvt.csv"),
    ):
        file = Path(folder) / name
        done = plan.export(format_, file)
        print(
            f"{name:<14} {file.stat().st_size / 1e3:8.0f} kB, {done.error:.3g} pulses from {done.against}"
        )

# %% [markdown]
# ## What it refuses
#
# What cannot be done is refused with the place, the amount, and what would help.

# %%
try:
    pp.plan(pp.Program((pp.Line(to=np.array([0, 0, 0.060])),)), machine)
except pp.Infeasible as refusal:
    print(refusal)

# %% [markdown]
# ## The answer

# %%
beyond = 1e6 * max(max(plan.certificate.worst[name] for name in met) - 1, 0)
print(
    f"The hexapod runs this path in {plan.trajectory.duration:.3f} s. Proved: no leg exceeds a limit of speed,\n"
    f"acceleration or jerk by more than {np.ceil(10 * beyond) / 10:.1f} millionths at any instant; the motors get "
    f"{pulses.total} pulses."
)
assert plan.certificate.holds

# %% [markdown]
# **What to try next.** Round the corners: give the lines `join=pp.Blend(0.0005)` and see what half a millimetre buys.
# Ask for a calmer motion: `pp.plan(program, machine, duration=4.0)`. Or go on with
# [what limits the speed](4_what_limits_the_speed.py).
