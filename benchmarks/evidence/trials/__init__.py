"""Random and exhaustive trials that look for faults."""
