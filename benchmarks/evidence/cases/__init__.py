"""Cases of the evidence: one file each, with a function `measure` that yields tables."""
