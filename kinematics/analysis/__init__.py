"""What is computed of a machine: forward kinematics, singularities, workspace, clearance,
forces.
"""
