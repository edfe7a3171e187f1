"""Solvers: how fast a path can be run within rows of limits, and the classical profiles as baselines."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
