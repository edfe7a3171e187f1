"""Drives at work: lanes of axes (runs by axes) stepped from sample to sample."""
