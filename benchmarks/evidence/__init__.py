"""Measurements behind every published figure. They are not installed with the packages."""
