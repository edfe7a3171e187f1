"""A machine: its maps, axes, poses, load, drawing, and the files that state it."""
