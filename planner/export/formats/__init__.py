"""The export formats: one file each, found by name in `planner.export.format`."""
