"""Ours beside toppra, copp-py, ruckig and IPOPT on the same paths, in one go: `python -m benchmarks.evidence.peers`.

Peers come with `pip install '.[peers]'` in the clone; those that are absent are listed as absent.
"""
