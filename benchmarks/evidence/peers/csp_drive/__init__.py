"""Rows of the export `csp` through emulated CiA 402 drives."""
