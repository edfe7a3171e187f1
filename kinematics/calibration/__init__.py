"""Calibration: the parameters of a machine, identified from poses that were measured.

Counts are exact and poses are not. A commanded pose T_c fixes what is sent, the displacements c =
q(T_c) − q_home of the nominal machine (counts · pulse). What the machine then does is the pose T
that solves, axis by axis,

    q(T; joints) = q_home + offset + factor ∘ c,

with q its inverse map (leg lengths ‖p + R a − b‖ of a hexapod). It is measured in a frame F near
the home pose, with Gaussian noise of standard deviation σ_p (m) and σ_r (rad) on each component:

    T_measured = F · T_home⁻¹ · T · noise.

The residual is the pose itself, divided by its noise, not the leg length: the noise is on the pose,
so this is its maximum-likelihood estimate, and it is the only one that poses measured in part
(position, or position and the direction of one axis) leave. T follows from forward kinematics and
its derivatives from the implicit function theorem: J dT = d(offset + factor ∘ c) − ∂q/∂joints,
exactly. (Length residuals weighted with J Σ Jᵀ are the same to first order where the whole pose is
measured.) For fully measured poses the legs decouple into eight unknowns each [Zhuang and Roth
1991].
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
