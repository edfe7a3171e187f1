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
# # What limits the speed
#
# **A circle takes the hexapod a certain time at best. Which limit of which leg costs that time, and
# what would a better
# actuator buy: more speed, more acceleration, or more jerk?**

# %%
# %matplotlib inline
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import pulsepath as pp
from pulsepath import plots

machine = pp.load_machine("hexapod")
circle = pp.load_program("bare-circle")
plan = pp.plan(circle, machine)
duration = plan.trajectory.duration
print(f"the fastest circle takes {duration:.4f} s")

# %% [markdown]
# ## Which limit, where
#
# Below, every limit's proven use along the path; on top, the colour of the limit that holds the
# motion back there.

# %%
figure, ax = plt.subplots(figsize=(9, 3.8), layout="constrained")
plots.limit_use(plan, ax)
figure.legend(loc="outside upper center", ncols=6, frameon=False)
plt.show()

# %%
active, steps = plots.active_limits(plan), np.diff(plan.trajectory.knots)
share = {limit.name: steps[active == n].sum() / duration for n, limit in enumerate(plan.limits)}
for name, part in share.items():
    print(f"{name:<14}holds the motion back {100 * part:5.1f} % of the time")

# %% [markdown]
# ## Which leg
#
# The legs take turns: while some run at full speed, others have little to do. Dark is a limit that
# is reached.

# %%
t = np.linspace(0, duration, 600)
state = plan.trajectory.at(t)
uses = {
    "speed": np.abs(state.qd) / [axis.max_speed for axis in machine.axes],
    "acceleration": np.abs(state.qdd) / [axis.max_acceleration for axis in machine.axes],
    "jerk": np.abs(state.qddd) / [axis.max_jerk for axis in machine.axes],
}
figure, rows = plt.subplots(3, 1, figsize=(9, 5), layout="constrained", sharex=True)
for ax, (name, use) in zip(rows, uses.items(), strict=True):
    mesh = ax.pcolormesh(t, np.arange(1, 7), use.T, cmap="viridis_r", vmin=0, vmax=1)
    ax.set(ylabel="leg", yticks=np.arange(1, 7))
    ax.set_title(name, loc="left", fontsize="medium")
rows[-1].set_xlabel("time (s)")
figure.colorbar(mesh, ax=rows, label="share of the limit")
plt.show()

# %%
used_up = {name: (use >= 0.99).mean(0) for name, use in uses.items()}
for name, shares in used_up.items():
    print(
        f"{name:<14}reached, of the time: "
        + ", ".join(f"leg {n + 1} {100 * u:.0f} %" for n, u in enumerate(shares))
    )

# %% [markdown]
# ## What a little more is worth
#
# Raise one limit of all legs a little, plan again, and see by how much the time falls. The marginal
# value is the change of the time, in per cent, for one per cent more of the limit.

# %%
LIMITS = ("max_speed", "max_acceleration", "max_jerk")


def with_limits(**factors: float) -> pp.Machine:
    """The same machine with limits of its legs that are so many times as high."""
    axes = [
        replace(leg, **{name: factor * getattr(leg, name) for name, factor in factors.items()})
        for leg in machine.axes
    ]
    return machine.driven_by(axes)


def fastest(**factors: float) -> float:
    return pp.plan(circle, with_limits(**factors)).trajectory.duration


step = 0.05
value = {
    name: np.log(fastest(**{name: 1 + step}) / fastest(**{name: 1 - step}))
    / np.log((1 + step) / (1 - step))
    for name in LIMITS
}
for name, change in value.items():
    print(f"1 % more {name.removeprefix('max_'):<13} {change:+.3f} % time")

# %% [markdown]
# There is a check on these numbers. With *k* times the speed, *k²* times the acceleration and *k³* times the jerk, the
# same motion runs *k* times as fast. So the value of speed, twice that of acceleration and thrice that of jerk must
# add up to minus one (Euler's theorem on homogeneous functions). The planner was told nothing of this.

# %%
total = value["max_speed"] + 2 * value["max_acceleration"] + 3 * value["max_jerk"]
print(f"speed + 2 · acceleration + 3 · jerk = {total:.4f}")
assert abs(total + 1) < 0.005

# %% [markdown]
# ## What much more is worth
#
# A marginal value holds for a little more. A really better actuator meets the next limit.

# %%
factors = (0.5, 1.0, 2.0)
bought = {
    name.removeprefix("max_"): [
        duration if factor == 1 else fastest(**{name: factor}) for factor in factors
    ]
    for name in LIMITS
}
bought["all three"] = [
    duration if factor == 1 else fastest(**dict.fromkeys(LIMITS, factor)) for factor in factors
]
print(f"{'duration (s), limit ×':<22}" + "".join(f"{factor:8.2f}" for factor in factors))
for name, values in bought.items():
    print(f"{name:<22}" + "".join(f"{duration:8.3f}" for duration in values))

# %% [markdown]
# Speed is worth most, but only up to a point; behind it acceleration and jerk hold the motion back, and more speed buys
# nothing. Where that point is, a plan tells whose speed has no say: it is as fast as the legs ever get.

# %%
free = pp.plan(circle, with_limits(max_speed=10.0))
moments = np.linspace(0, free.trajectory.duration, 2001)
enough = np.abs(free.trajectory.at(moments).qd).max() / machine.axes[0].max_speed
least = free.trajectory.duration
print(
    f"a speed limit {enough:.2f} times as high is never reached: {least:.3f} s, whatever the motors could do beyond"
)
assert abs(bought["speed"][-1] / least - 1) < 1e-3

# %%
figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
curves = {name: (list(factors), values) for name, values in bought.items()}
half, full, twice = bought["speed"]
curves["speed"] = [0.5, 1.0, enough, 2.0], [half, full, least, twice]
for (name, (times, values)), mark in zip(curves.items(), "osD^", strict=True):
    ax.loglog(times, values, marker=mark, label=name)
ax.loglog(
    factors,
    [duration / factor for factor in factors],
    ":",
    color="grey",
    label="1/×: nothing else in the way",
)
ax.set_xticks(factors, [f"{factor:g}" for factor in factors])
ax.set_yticks([0.5, 1, 2], ["0.5", "1", "2"])
ax.minorticks_off()
ax.set(xlabel="times the limit", ylabel="duration of the circle (s)")
ax.legend(title="raised limit", frameon=False)
plt.show()

# %% [markdown]
# ## The answer

# %%
few, most = 100 * used_up["speed"].min(), 100 * used_up["speed"].max()
print(
    f"Speed holds the circle back {100 * share['speed']:.0f} % of the time: that of every leg in turn, each for "
    f"{few:.0f} to {most:.0f} %.\n1 % more of it saves {-value['max_speed']:.2f} %. Legs {enough:.2f} times as fast "
    f"bring {duration:.2f} s down to {least:.2f} s;\nto go below, acceleration and jerk must rise as well."
)
assert min(value, key=lambda name: value[name]) == "max_speed"

# %% [markdown]
# **What to try next.** Do the same for your own program: a path of short moves is held back by jerk instead. Raise the
# limits of one leg only. Or ask what a heavier platform does: give the machine a load with `machine.carrying(...)`.
