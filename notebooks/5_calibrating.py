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
# # Calibrating from measurements
#
# **A hexapod was measured on a coordinate-measuring machine. How much of its error can parameters
# of the machine
# explain, how far are they to be trusted, and which pose should be measured next?**
#
# The measurements are those of a thesis [Sahbaz 2007, Tables 6.2 to 6.4].

# %%
# %matplotlib inline
import matplotlib.pyplot as plt
import numpy as np

import pulsepath as pp

machine = pp.load_machine("hexapod")
data = pp.load_measurements("cmm")
shift = data.measured.translation - data.commanded.translation
print(f"{'commanded (mm)':<26}{'off by (µm)':<26}")
for label, to, off in zip(data.labels, 1e3 * data.commanded.translation, 1e6 * shift, strict=True):
    if label.startswith("pose"):
        print(
            "({:5.1f}, {:5.1f}, {:5.1f})".format(*to),
            "    ({:6.0f}, {:6.0f}, {:6.0f})".format(*off),
            "  ",
            label,
        )

# %% [markdown]
# The height is off by more the further up the platform goes. Something is longer than it is believed to be.
#
# ## A model of the error
#
# One factor on the pulse of all legs, and where and how the measuring frame stands: five parameters
# in all. They are fitted to the measured positions.

# %%
calibration = pp.calibrate(machine, data)
calibration

# %%
before, after, left_out = (
    1e6 * calibration.rms(errors)
    for errors in (calibration.before, calibration.after, calibration.left_out)
)
print(
    f"RMS per component: {before:.1f} µm before, {after:.1f} µm after, {left_out:.1f} µm left out"
)
calibration.plot()

# %% [markdown]
# "After" flatters: the parameters were chosen to make it small. "Left out" is honest: each pose is predicted from the
# other poses alone. As long as the two are close, the model is not fitted to noise.
#
# ## How much model do the data bear?

# %%
models = {
    "factor, frame turned about z": ("factor", "frame-yaw"),
    "factor, whole frame": ("factor", "frame"),
    "a factor for each leg, frame": ("factors", "frame-yaw"),
}
print(f"{'model':<30}{'parameters':>11}{'after':>9}{'left out':>10}  weakest σ")
trials = {name: pp.calibrate(machine, data, parts) for name, parts in models.items()}
for name, trial in trials.items():
    errors = [1e6 * trial.rms(stage) for stage in (trial.after, trial.left_out)]
    print(
        f"{name:<30}{len(trial.parameters):11}{errors[0]:9.1f}{errors[1]:10.1f}"
        f"  {trial.observability.indices['O3']:.4f}"
    )

# %% [markdown]
# More parameters always look better after the fit. Left out, six factors are hardly better than one, and the poses show
# the weakest of their combinations far less well. All joints at once are not to be had from so few poses at all:

# %%
try:
    pp.calibrate(machine, data, ("factors", "offsets", "joints", "frame"))
except pp.MotionError as refusal:
    print(refusal)

# %% [markdown]
# ## How far to trust it
#
# Each parameter has a standard error. A singular value belongs to each combination of parameters
# that the poses tell apart; a small one means that it is hardly seen. The usual indices sum them
# up: more is better.

# %%
calibration.observability

# %%
calibration.observability.plot()

# %%
factor = calibration["factor"]
catalogue, programmed = (
    0.762,
    1e6 * machine.axes[0].pulse,
)  # µm: half a step of the actuator, and what was programmed
print(
    f"the factor is {factor.value:.4f} ± {factor.error:.4f}: a pulse of {programmed * factor.value:.4f} µm"
)
print(
    f"the actuator's catalogue says {catalogue} µm, which would be a factor of {catalogue / programmed:.4f}"
)
print(
    f"{abs(factor.value - catalogue / programmed) / factor.error:.1f} standard errors lie between the two"
)

# %% [markdown]
# So most of the error is a rounded number in a program. The catalogue explains it nearly; what is beyond the standard
# errors is not explained by it.
#
# ## What to measure next
#
# A further pose is worth what it takes off the standard errors. That is known beforehand: it
# depends on where the pose is, not on what will be read there. (White: the legs do not reach it.)

# %%
heights, asides = np.linspace(0.005, 0.045, 9), np.linspace(0.0, 0.025, 6)
places = [[x, 0, z] for z in heights for x in asides]
poses = pp.Pose.from_translation(places)
reachable = machine.check(machine.home * poses).ok
foreseen = pp.foreseen_errors(calibration, poses[reachable])
gain = np.full((2, len(places)), np.nan)
for row, name in enumerate(("factor", "frame rz")):
    k = calibration.names.index(name)
    gain[row, reachable] = 100 * (1 - foreseen[:, k] / calibration[name].error)

# %%
figure, axes = plt.subplots(1, 2, figsize=(9, 3.8), layout="constrained", sharey=True)
for ax, values, name in zip(axes, gain, ("pulse's length", "frame's turn about z"), strict=True):
    shown = values.reshape(len(heights), len(asides))
    mesh = ax.pcolormesh(1e3 * asides, 1e3 * heights, shown, cmap="viridis", vmin=0)
    figure.colorbar(mesh, ax=ax, label="taken off (%)")
    ax.set(xlabel="x of a further pose, at y = 0 (mm)", title=f"standard error of the {name}")
x, y, z = 1e3 * data.commanded.translation[data.fit].T
axes[0].plot(
    np.hypot(x, y), z, "o", color="white", mec="black", label="measured, as far from the middle"
)
axes[0].set_ylabel("z of a further pose (mm)")
axes[0].legend(loc="lower right", fontsize="small")
plt.show()

# %%
best = np.nanargmax(gain[0])
middle = places.index([0.0, 0, 0.025])
x, _, z = 1e3 * np.array(places[best])
print(
    f"best for the pulse's length: x = {x:.0f} mm, z = {z:.0f} mm takes {gain[0, best]:.1f} % off its standard error"
)
print(f"one more in the middle, at z = 25 mm, takes {gain[0, middle]:.1f} % off")
aside = np.nanargmax(gain[1])
print(
    f"best for the frame's turn: x = {1e3 * places[aside][0]:.0f} mm takes {gain[1, aside]:.1f} % off"
)

# %% [markdown]
# A pulse that is too long shows most where the legs are longest; a frame that is turned shows most far from its middle.
#
# ## The answer

# %%
print(
    f"One number, a pulse {100 * (factor.value - 1):.2f} % longer than programmed, and the place of the frame bring\n"
    f"the error from {before:.0f} to {after:.0f} µm per component, and {left_out:.0f} µm for poses left out.\n"
    f"The data bear no model of all joints. Measure next at the top of the stroke (z = {z:.0f} mm), and far aside."
)
assert after < left_out < before
assert gain[0, best] > 4 * gain[0, middle]

# %% [markdown]
# **What to try next.** Write the calibrated machine as a file, `print(pp.machine_toml(calibration.machine))`, and plan
# on it: [the notebook on path error](2_path_error.py) shows what that buys. With your own measurements, begin with
# `pp.measured_positions(commanded, measured)`.
