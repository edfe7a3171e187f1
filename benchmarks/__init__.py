"""Gain sweeps, published cases, comparisons with peers, reports and figures."""
