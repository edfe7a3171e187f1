"""Export formats of a plan, one file each."""
