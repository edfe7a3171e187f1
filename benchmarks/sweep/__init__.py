"""Grids of closed-loop runs: law × gains × task × rig × seed, run once and kept."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
