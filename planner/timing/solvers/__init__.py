"""Solvers of timing problems: one file each; adapters of libraries end in an underscore."""
