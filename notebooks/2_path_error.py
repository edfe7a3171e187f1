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
# # The path error of a circle
#
# **How far is a hexapod from the circle it was asked for, and what of that is due to whole pulses,
# to its geometry not
# being the drawn one, and to drives that follow late?**
#
# The path error is the distance to the circle, whenever the platform gets there. Being late along
# the circle is none.

# %%
# %matplotlib inline
import matplotlib.pyplot as plt
import numpy as np

import pulsepath as pp
from controllers.drives.servo import leg_servo

drawn = pp.load_machine("hexapod")
circle = pp.load_program("bare-circle")
plan = pp.plan(circle, drawn)
print(f"the fastest circle takes {plan.trajectory.duration:.3f} s")

# %% [markdown]
# ## A way to look
#
# Given how long the legs are, forward kinematics tells where the platform stands. On a flat circle
# the path error has two parts, both signed: `radial`, outwards, and `axial`, upwards. Errors that
# are signed can be added.

# %%
RADIUS, HEIGHT = 0.015, 0.025  # m, of the program bare-circle, from home
MIDDLE = drawn.home * pp.Pose.from_translation([0, 0, HEIGHT])


def off_circle(machine: pp.Machine, q: np.ndarray) -> np.ndarray:
    """(N, 2) radial and axial deviation in m, when the legs of a machine are q (N, 6) long."""
    pose = machine.forward(q, near=MIDDLE, certify=False).pose
    x, y, z = (drawn.home.inv() * pose).translation.T
    return np.stack([np.hypot(x, y) - RADIUS, z - HEIGHT], 1)


def row(name: str, off: np.ndarray) -> None:
    """RMS and largest path error, and the mean of its parts, in µm."""
    error, (radial, axial) = 1e6 * np.linalg.norm(off, axis=1), 1e6 * off.mean(0)
    print(f"{name:<30}{np.sqrt((error**2).mean()):9.2f}{error.max():9.2f}{radial:9.2f}{axial:9.2f}")


def head() -> None:
    print(f"{'path error, µm':<30}{'RMS':>9}{'largest':>9}{'radial':>9}{'axial':>9}")


t = np.linspace(0, plan.trajectory.duration, 2001)
planned = plan.trajectory.at(t).q
head()
row("as planned", off_circle(drawn, planned))

# %% [markdown]
# ## Whole pulses
#
# The legs stand where whole pulses put them, within half a pulse of where they should be.

# %%
pulse = np.array([axis.pulse for axis in drawn.axes])
quantized = off_circle(drawn, drawn.home_q + plan.pulses.counts(t) * pulse)
head()
row("quantization", quantized)

# %% [markdown]
# The library looks at every pulse instead of at some instants, and knows the largest error that theory allows. An error
# budget, which needs no motion at all, predicts the same RMS: a rounding error is as likely to be anywhere within half
# a pulse.

# %%
realised = plan.realised()["position"]
budget = pp.error_budget(drawn, plan.trajectory.at(t).pose, [pp.Quantization()])
predicted = np.sqrt(np.trace(budget.total.covariance[:, :3, :3], axis1=1, axis2=2).mean())
print(
    f"position error at every pulse: RMS {1e6 * realised.rms:.2f} µm, largest {1e6 * realised.max:.2f} µm"
)
print(f"theory: RMS {1e6 * predicted:.2f} µm, at most {1e6 * realised.bound:.2f} µm")
assert abs(realised.rms / predicted - 1) < 0.05

# %% [markdown]
# (This is the error of the position at its time; the path error leaves out the part along the circle, so it is less.)

# %% [markdown]
# ## A geometry that is not the drawn one
#
# The hexapod was measured on a coordinate-measuring machine. Its legs move further per pulse than
# its drawings say; [the notebook on calibration](5_calibrating.py) tells how that is found. A
# machine that was planned by its drawings and is as it was built does this:

# %%
calibration = pp.calibrate(drawn, pp.load_measurements("cmm"))
built = calibration.machine
factor = calibration["factor"]
print(f"a pulse is {factor.value:.4f} ± {factor.error:.4f} times as long as drawn")


def as_built(q: np.ndarray) -> np.ndarray:
    """The true leg lengths when the counts say q: the same counts, other pulses."""
    counts = (q - drawn.home_q) / pulse
    return np.asarray(built.home_q + counts * [axis.pulse for axis in built.axes])


geometry = off_circle(built, as_built(planned))
head()
row("geometry", geometry)

# %% [markdown]
# The circle is too wide and too high, by nearly the same amount all around: it is an error of size and of place, hardly
# one of form.

# %% [markdown]
# ## Drives that follow late
#
# A tracking law tells the motion card what to do, step by step; drives behind it follow the card's
# pulses. The hexapod has steppers, which hardly come behind (the bundled rig `hexapod-steppers`).
# What if its legs had servos, as the thesis' other rig has? `leg_servo` is such a drive, with what
# is assumed of it in its documentation. Law 3 sends the planned positions as they are, open loop.
# Feedforward sends them ahead by what a nominal drive lags.


# %%
servos = pp.Rig(drawn, tuple(leg_servo(axis) for axis in drawn.axes), name="legs with servos")


def followed(motion: pp.Plan, law: str) -> np.ndarray:
    """(N, 6) what the legs do, every millisecond of the motion."""
    tracking = pp.track(motion, drawn, pp.find_law(law, servos), rig=servos, period=1e-3)
    return tracking.actual[tracking.t <= motion.trajectory.duration]


legs = {"open loop": followed(plan, "3"), "feedforward": followed(plan, "ff")}
tracked = {name: off_circle(drawn, q) for name, q in legs.items()}
head()
for name, off in tracked.items():
    row(f"tracking, {name}", off)

# %% [markdown]
# Lag makes a circle too small. Being late alone would not: the platform would stand elsewhere on the circle. But a
# drive whose position loop has the gain *K* does not do the full swing of a sine of ω rad/s, only a share of it,
# $1/\sqrt{1 + (\omega/K)^2}$. The speed along the circle is nearly constant, so the radius falls by nearly the same
# amount all around.

# %%
moments = np.arange(len(legs["open loop"])) * 1e-3
steady = np.abs(moments / plan.trajectory.duration - 0.5) < 0.3
omega, gain = (
    np.median(plan.trajectory.at(moments[steady]).sd) / RADIUS,
    leg_servo(drawn.axes[0]).position_gain,
)
swing = 1 / np.sqrt(1 + (omega / gain) ** 2)
narrower = -np.median(tracked["open loop"][steady, 0])
told = RADIUS * (1 - swing)
print(
    f"ω = {omega:.2f} rad/s, K = {gain:.0f} 1/s: by this formula the radius falls by {1e6 * told:.0f} µm,"
)
print(f"as simulated, with a speed loop behind the position loop, by {1e6 * narrower:.0f} µm")
assert abs(narrower / told - 1) < 0.1

# %% [markdown]
# ## All of it at once
#
# Now the whole chain: the drives follow the card late, and the machine is as it was built. Is that
# the sum of what each does alone? (The card fires whole pulses, so they are part of the tracking
# here already.)

# %%
total = {name: off_circle(built, as_built(q)) for name, q in legs.items()}
alone = off_circle(built, as_built(plan.trajectory.at(moments).q))
head()
row("geometry", alone)
for name, together in total.items():
    row(f"tracking, {name}", tracked[name])
    row("    sum of the two, signed", alone + tracked[name])
    row("    simulated together", together)

# %%
for name, together in total.items():
    beside = 1e6 * np.abs(together - alone - tracked[name]).max()
    print(f"{name}: the sum of signed errors is within {beside:.1f} µm of what is simulated")
    assert beside < 10

# %% [markdown]
# The signed errors add up; their sizes do not. Geometry widens the circle and lag narrows it, so the sloppier law gives
# the *better* circle on this machine. That is luck of the signs: with pulses shorter than drawn both would narrow it.

# %%
shown = {
    "geometry": (alone, "#0072B2"),
    "tracking, open loop": (tracked["open loop"], "#E69F00"),
    "both": (total["open loop"], "#000000"),
    "tracking, feedforward": (tracked["feedforward"], "#009E73"),
}
figure, (left, right) = plt.subplots(
    1, 2, figsize=(10, 4.6), layout="constrained", width_ratios=(1, 1.1)
)
angle, magnified = np.linspace(0, 2 * np.pi, 361), 20
left.plot(
    1e3 * RADIUS * np.cos(angle), 1e3 * RADIUS * np.sin(angle), ":", color="grey", label="asked for"
)
turned = drawn.home.inv() * plan.trajectory.at(moments).pose
where = np.arctan2(turned.translation[:, 1], turned.translation[:, 0])
for name, (off, color) in shown.items():
    r = 1e3 * (RADIUS + magnified * off[:, 0])
    left.plot(r * np.cos(where), r * np.sin(where), color=color, label=name, linewidth=1.3)
left.set(
    xlabel="x (mm)",
    ylabel="y (mm)",
    title=f"radial errors magnified {magnified} times",
    aspect="equal",
)

bars = {
    "whole pulses": quantized,
    "geometry": alone,
    "tracking, open loop": tracked["open loop"],
    "geometry and open loop": total["open loop"],
    "tracking, feedforward": tracked["feedforward"],
    "geometry and feedforward": total["feedforward"],
}
sizes = [1e6 * np.linalg.norm(off, axis=1) for off in bars.values()]
at = np.arange(len(bars))
right.plot([np.sqrt((size**2).mean()) for size in sizes], at, "o", label="RMS", color="#0072B2")
right.plot(
    [size.max() for size in sizes], at, "D", label="largest", color="#E69F00", fillstyle="none"
)
right.grid(axis="y", linewidth=0.5)
right.set_yticks(at, list(bars))
right.invert_yaxis()
right.set(xlabel="path error (µm)", xscale="log", title="contributions and their sums")
right.legend(frameon=False, loc="center left")
figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=5, frameon=False)
plt.show()

# %% [markdown]
# ## What slowing down buys
#
# Lag costs radius by about the square of the speed. Whole pulses and geometry do not care.

# %%
slower = {None: plan} | {
    duration: pp.plan(circle, drawn, duration=duration) for duration in (2.5, 5.0)
}
durations = [motion.trajectory.duration for motion in slower.values()]


def rms(off: np.ndarray) -> float:
    return float(1e6 * np.sqrt((off**2).sum(1).mean()))


curves: dict[str, list[float]] = {name: [] for name in ("whole pulses", "geometry", *tracked)}
sums: dict[str, list[float]] = {f"geometry, {name}": [] for name in tracked}
for motion in slower.values():
    moments = np.linspace(0, motion.trajectory.duration, 1001)
    counted = drawn.home_q + motion.pulses.counts(moments) * pulse
    curves["whole pulses"].append(rms(off_circle(drawn, counted)))
    curves["geometry"].append(rms(off_circle(built, as_built(motion.trajectory.at(moments).q))))
    for name, law in (("open loop", "3"), ("feedforward", "ff")):
        done = followed(motion, law)
        curves[name].append(rms(off_circle(drawn, done)))
        sums[f"geometry, {name}"].append(rms(off_circle(built, as_built(done))))

print(f"{'duration':<22}" + "".join(f"{duration:9.2f} s" for duration in durations))
for name, values in (curves | sums).items():
    print(f"{name:<22}" + "".join(f"{value:8.2f} µm" for value in values))

# %% [markdown]
# The slower the motion, the less lag there is to narrow the circle: what open loop was lucky with fades, and geometry
# is what remains.

# %%
figure, ax = plt.subplots(figsize=(7, 3.8), layout="constrained")
for (name, values), mark in zip(curves.items(), "osD^", strict=True):
    ax.loglog(
        durations,
        values,
        marker=mark,
        label=name if name in ("whole pulses", "geometry") else f"tracking, {name}",
    )
ax.set_xticks(durations, [f"{duration:.2f}" for duration in durations])
ax.xaxis.set_minor_formatter("")
ax.set(xlabel="duration of the circle (s)", ylabel="RMS path error (µm)")
ax.legend(frameon=False, loc="upper left", bbox_to_anchor=(1, 1))
plt.show()

# %% [markdown]
# ## What calibration buys
#
# Planned on the calibrated machine, the circle has the right size. Two things are left. One is what
# the measurements could not tell: the standard error of the pulse's length. (The budget takes
# bounds of an even distribution, √3 standard deviations.) The other is what one factor cannot
# describe: how far off poses are that were left out of the fit tells that, with the errors of
# measuring in it.

# %%
better = pp.plan(circle, built)
poses = better.trajectory.at(np.linspace(0, better.trajectory.duration, 201)).pose
unknown = pp.PulseLength(np.sqrt(3) * factor.error / factor.value, common=True, name="pulse length")
left_over = pp.error_budget(built, poses, [pp.Quantization(), unknown])
left_over

# %%
remaining = np.sqrt(np.trace(left_over.total.covariance[:, :3, :3], axis1=1, axis2=2).mean())
unseen = np.sqrt(3) * calibration.rms(calibration.left_out)  # of three components
print(f"geometry, RMS: {curves['geometry'][0]:.0f} µm as drawn")
print(
    f"as calibrated: {1e6 * remaining:.0f} µm by the standard error, {1e6 * unseen:.0f} µm in poses left out of the fit"
)
assert remaining < unseen < 0.1 * rms(geometry) * 1e-6

# %% [markdown]
# ## The answer

# %%
print(
    f"At full speed the circle errs by {rms(total['open loop']):.0f} µm RMS. Geometry alone gives {rms(alone):.0f} µm, "
    f"late drives {rms(tracked['open loop']):.0f} µm\nand whole pulses {rms(quantized):.1f} µm. "
    f"Calibrate first, then feed forward ({rms(tracked['feedforward']):.0f} µm), or slow down.\n"
    "Finer pulses buy nothing."
)
assert rms(alone) > rms(tracked["open loop"]) > rms(tracked["feedforward"]) > rms(quantized)

# %% [markdown]
# **What to try next.** Put the preview law `"mpc"` beside the two. Track `better` instead of `plan` and see that the
# errors of geometry are gone from the sum. Or measure where it tells most: [calibrating](5_calibrating.py).
