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
# **A hexapod was measured on a coordinate-measuring machine. How much of its error can parameters of the machine
# explain, how far are they to be trusted, and which pose should be measured next?**
#
# The measurements are those of a thesis [Sahbaz 2007, Tables 6.2 to 6.4].

# %%
# %matplotlib inline
import matplotlib.pyplot as plt
import numpy as np

import pulsepath as pp
from pulsepath import plots

machine = pp.load_machine("hexapod")
data = pp.load_measurements("cmm")
shift = data.measured.translation - data.commanded.translation
print(f"{'commanded (mm)':<26}{'off by (µm)':<26}")
for label, to, off in zip(data.labels, 1e3 * data.commanded.translation, 1e6 * shift, strict=True):
    if label.startswith("pose"):
        print("({:5.1f}, {:5.1f}, {:5.1f})".format(*to), "    ({:6.0f}, {:6.0f}, {:6.0f})".format(*off), "  ", label)

# %% [markdown]
# The height is off by more the further up the platform goes. Something is longer than it is believed to be.
#
# ## A model of the error
#
# One factor on the pulse of all legs, and where and how the measuring frame stands: five parameters in all. They are
# fitted to the measured positions.

# %%
calibration = pp.calibrate(machine, data)
print(calibration)

# %%
before, after, left_out = (
    1e6 * calibration.rms(errors) for errors in (calibration.before, calibration.after, calibration.left_out)
)
print(f"RMS per component: {before:.1f} µm before, {after:.1f} µm after, {left_out:.1f} µm left out")
calibration.plot().figure

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
        f"{name:<30}{len(trial.parameters):11}{errors[0]:9.1f}{errors[1]:10.1f}  {trial.observability.indices['O3']:.4f}"
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
# Each parameter has a standard error. A singular value belongs to each combination of parameters that the poses tell
# apart; a small one means that the combination is hardly seen.

# %%
observability = calibration.observability
weakest = dict(zip(calibration.names, observability.weakest, strict=True))
print("least seen:", max(weakest, key=lambda name: abs(weakest[name] / calibration[name].error)))
for name, value in observability.indices.items():
    print(f"{name}: {value:.4f}")

# %%
plots.singular_values(calibration).figure

# %%
factor = calibration["factor"]
catalogue, programmed = 0.762, 1e6 * machine.axes[0].pulse  # µm: half a step of the actuator, and what was programmed
print(f"the factor is {factor.value:.4f} ± {factor.error:.4f}: a pulse of {programmed * factor.value:.4f} µm")
print(f"the actuator's catalogue says {catalogue} µm, which would be a factor of {catalogue / programmed:.4f}")
print(f"{abs(factor.value - catalogue / programmed) / factor.error:.1f} standard errors lie between the two")

# %% [markdown]
# So most of the error is a rounded number in a program. The catalogue explains it nearly; what is beyond the standard
# errors is not explained by it.
#
# ## What to measure next
#
# A further pose is worth what it takes off the standard errors. That can be known beforehand: it depends on where the
# pose is, not on what will be measured. So each candidate is tried with the position that the calibration predicts.

# %%
heights, sides = (0.005, 0.015, 0.025, 0.035, 0.045), (0.0, 0.010)
candidates = [np.array([x, 0, z]) for z in heights for x in sides]
noise = pp.Noise(position=calibration.scale, rotation=calibration.scale / machine.characteristic_length)
fitted = data.fit


def positions(commanded: np.ndarray, measured: np.ndarray) -> pp.Calibration:
    """A calibration from positions alone, their noise that of the residuals."""
    poses = pp.Pose.from_translation(commanded)
    return pp.calibrate(machine, pp.measured_positions(poses, measured, noise=noise))


asked, seen = data.commanded.translation[fitted], data.measured.translation[fitted]
now = positions(asked, seen)
predicted = asked + (seen - asked)  # of a linear model, where a pose is does not matter
names = ("factor", "frame x", "frame z", "frame rz")
print(f"{'measured too (mm)':<22}" + "".join(f"{name:>12}" for name in names))
print(f"{'nothing':<22}" + "".join(f"{now[name].error:12.3g}" for name in names))
