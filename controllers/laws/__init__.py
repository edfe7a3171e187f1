"""The tracking laws: one file each, found by name in `registry`."""
